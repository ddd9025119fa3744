#!/bin/sh
# Runs the paper's experiments: tables and CSV files go to build/paper/, the plots to examples/paper/plots/, and
# examples/paper/RESULTS.md is written anew. With --quick the finest meshes are left out and everything goes to
# build/paper/. With --page nothing is run: the page is written from the tables that are there. Run it from the top of
# the repository, after the programs are built into build/paper/.
set -u
here=examples/paper
work=build/paper
page=$here/RESULTS.md
pictures=$here/plots
quick=
run=1
case ${1:-} in
    --quick) quick=--quick page=$work/RESULTS.md pictures=$work/plots ;;
    --page) run=0 ;;
    '') ;;
    *) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" | grep -v ^set; exit 2 ;;
esac
mkdir -p "$work" "$pictures"
programs='fig1 fig2 fig3 fig4 table1 fig9 cantilever fig11 fig12 cook convergence patch invariance spin'

for program in $programs; do
    [ $run = 1 ] || break
    echo "$program"
    # shellcheck disable=SC2086
    "$work/$program" $quick --markdown --csv "$work/$program.csv" > "$work/$program.md" || {
        echo "$program failed"
        exit 1
    }
done

if command -v gnuplot > /dev/null; then
    gnuplot -e "from='$work'; to='$pictures'" "$here/plots.gp" > "$work/plots.log" 2>&1 || head -n 5 "$work/plots.log"
else
    echo "no plots: gnuplot is not installed"
fi

# heading PROGRAM: what its section is called.
heading() {
    case $1 in
        fig1) echo "Fig. 1: consistency" ;;
        fig2) echo "Fig. 2: errors and condition numbers of a Poisson problem" ;;
        fig3) echo "Fig. 3: from continuous elements to rigid cells" ;;
        fig4) echo "Fig. 4: integration over a polyhedron" ;;
        table1) echo "Table 1: sparsity and times" ;;
        fig9) echo "Fig. 9: locking" ;;
        cantilever) echo "Section 9.5: bending" ;;
        fig11) echo "Fig. 11: slivers" ;;
        fig12) echo "Fig. 12: thin features" ;;
        cook) echo "Cook's membrane" ;;
        convergence) echo "Convergence" ;;
        patch) echo "Patch test" ;;
        invariance) echo "Objectivity, definiteness, place and units" ;;
        spin) echo "Free spin" ;;
    esac
}

# The tables titled "... row by row ..." come first, the others are folded away.
split_page() {
    awk -v want="$1" '
        /^\*\*/ { part = /row by row/ ? "rows" : "all" }
        part == want { print }
    ' "$2"
}

section() {
    printf '\n## %s\n\n' "$(heading "$1")"
    sed -n '1,/\*\/$/p' "$here/$1.c" | sed 's/^\/\* //; s/ *\*\/$//; s/^   //' > "$work/about.txt"
    printf '```text\n%s\n```\n\n' "$(cat "$work/about.txt")"
    split_page rows "$work/$1.md"
    if [ -e "$pictures/$1.png" ]; then printf '\n![%s](plots/%s.png)\n' "$(heading "$1")" "$1"; fi
    split_page all "$work/$1.md" > "$work/all.txt"
    [ -s "$work/all.txt" ] || return 0
    printf '\n<details><summary>All figures</summary>\n\n'
    cat "$work/all.txt"
    printf '\n</details>\n'
}

{
    cat << 'END'
# The paper's experiments, repeated

P. Kaufmann, S. Martin, M. Botsch, M. Gross, "Flexible simulation of deformable models using discontinuous Galerkin FEM"
(2009), figure by figure, and classical tests of a finite-element code beside it. `make paper` runs everything and
writes this page. `--csv` and `--quick` are options of each program.

Columns: *ours* is what the programs in this directory computed with `dgfem.h`; *paper* is what the paper says or prints
(its plots give no numbers); *published* is a value from the literature, named in the section; *expected* is theory, or an
independent calculation made before this library. CG are continuous, BZ and IP the paper's two discontinuous methods.
END
    for program in $programs; do section "$program"; done
} | cat -s > "$page.$$" && mv "$page.$$" "$page"
echo "written: $page"
