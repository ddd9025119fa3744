#!/bin/sh
# Checks of the repository and of the headers as a user compiles them, reported in cmocka's form.
#
#   checks.sh headers            the committed headers are what src/ gives
#   checks.sh packer             the packer refuses what it must refuse
#   checks.sh matrix COMPILER    every header compiles without warning: declarations, implementation, static; both reals
#   checks.sh bench              the benchmarks compile without warning
#   checks.sh library            external symbols and macros carry the prefix; the two precisions do not link together;
#                                the programs in the manuals compile as printed and run
#   checks.sh failing            a failing check, a crash and a silent program make a run fail
#   checks.sh readme             the program in the README compiles as printed and runs
#   checks.sh examples           the examples run, print what they promise, and refuse bad input in one line
#
# Run it from the top of the repository. Needs build/gen/* and build/examples/*.
set -u
export LC_ALL=C
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
gcc=${CC:-gcc}
: "${MOMENTS:=$(sed -n 's/^MOMENTS := //p' Makefile)}"
warnings='-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wdouble-promotion -Werror'
products=$(ls dgfem.h dgfem_*.h 2> /dev/null)
declarations_only='-DDGFEM_IMPLEMENTED -DDGFEM_SHELL_IMPLEMENTED -DDGFEM_MVC_IMPLEMENTED'
passed=0
failed=0

# check NAME COMMAND...: one test; the command's output is shown where it fails.
check() {
    title=$1
    shift
    echo "[ RUN      ] $title"
    if "$@" > "$work/log" 2>&1; then
        echo "[       OK ] $title"
        passed=$((passed + 1))
    else
        head -n 40 "$work/log"
        echo "[  FAILED  ] $title"
        failed=$((failed + 1))
    fi
}

finish() {
    echo "[  PASSED  ] $passed test(s)."
    [ "$failed" = 0 ] && exit 0
    echo "[  FAILED  ] $failed test(s), listed above"
    exit 1
}

# ---- headers ----

is_current() {
    mkdir -p "$work/packed"
    build/gen/moments_gen $MOMENTS > "$work/moments_generated.c" &&
        cmp "$work/moments_generated.c" src/dgfem/moments_generated.c &&
        build/gen/pack src "$work/packed" > /dev/null || return 1
    for umbrella in src/*.in.h; do
        product=$(basename "$umbrella" .in.h).h
        cmp "$work/packed/$product" "$product" || return 1
    done
}

check_headers() {
    check "the committed headers are what src/ gives (else: make headers)" is_current
}

# ---- packer ----

small_sources() {
    rm -rf "$work/src" "$work/out"
    mkdir -p "$work/src/lib" "$work/out"
    {
        printf '/* Manual.\n   #include "no.h" */\n#ifndef A\n#include "lib/a.h"\n#endif\n'
        printf '#ifdef B\n#include "lib/b.c"\n#endif\n'
    } > "$work/src/lib.in.h"
    printf '#pragma once\n#include <math.h>\n/* Part a. More. */\nint a;\n' > "$work/src/lib/a.h"
    printf '#pragma once\n#include "a.h"\n/* Part b. */\nstatic const char *b = "/*";\n' > "$work/src/lib/b.c"
}

packs() {
    small_sources
    build/gen/pack "$work/src" "$work/out" && cat "$work/out/lib.h" &&
        grep -q '<math.h>' "$work/out/lib.h" && grep -q '==== b.c ====' "$work/out/lib.h" &&
        ! grep -q 'pragma\|"a.h"\|"lib/' "$work/out/lib.h"
}

# A part without #pragma once is inserted at each of its includes.
packs_repeated() {
    small_sources
    printf '/* Part t. */\nint NAME;\n' > "$work/src/lib/t.c"
    printf '#define NAME c\n#include "t.c"\n#undef NAME\n#define NAME d\n#include "t.c"\n' >> "$work/src/lib/b.c"
    build/gen/pack "$work/src" "$work/out" && cat "$work/out/lib.h" && [ "$(grep -c '^int NAME;' "$work/out/lib.h")" = 2 ]
}

# refuses FILE TEXT MESSAGE: with TEXT appended to FILE, packing fails, says MESSAGE and writes nothing.
refuses() {
    small_sources
    # shellcheck disable=SC2059
    printf "$2" >> "$work/src/$1"
    build/gen/pack "$work/src" "$work/out" > "$work/said" 2>&1 && return 1
    cat "$work/said"
    grep -q "$3" "$work/said" && [ -z "$(ls "$work/out")" ]
}

refuses_missing() {
    small_sources
    rm "$work/src/lib/b.c"
    build/gen/pack "$work/src" "$work/out" > "$work/said" 2>&1 && return 1
    grep -q 'lib.in.h:7: part "lib/b.c" is missing' "$work/said"
}

check_packer() {
    check "packs" packs
    check "packs a repeated part" packs_repeated
    check "refuses a missing part" refuses_missing
    check "refuses CR" refuses lib/b.c 'int c;\r\n' 'lib/b.c:5: carriage return'
    check "refuses trailing blanks" refuses lib/b.c 'int c; \n' 'lib/b.c:5: trailing blank'
    check "refuses tabs" refuses lib/b.c '\tint c;\n' 'lib/b.c:5: tab'
    check "refuses other bytes" refuses lib/b.c '/* \303\274 */\n' 'lib/b.c:5: byte 0xc3'
    check "refuses #if without #endif" refuses lib/b.c '\n#if 1\n' 'lib/b.c:6: #if without #endif'
    check "refuses #endif without #if" refuses lib/b.c '#endif\n' 'lib/b.c:5: #endif without #if'
    check "refuses an open comment" refuses lib/b.c '/*\n' 'lib/b.c: a comment is left open'
    check "refuses a missing line feed" refuses lib/b.c 'int c;' 'lib/b.c:5: no line feed'
    check "refuses an unlisted part" refuses lib/c.c '/* Part c. */\n' 'lib/c.c: no umbrella lists it'
    check "refuses an unlisted include" refuses lib/b.c '#include "d.h"\n' '"lib/d.h" is not listed'
    check "refuses an include of a later part" refuses lib/a.h '#include "b.c"\n' '"lib/b.c" does not stand above'
    check "refuses a part listed twice" refuses lib.in.h '#include "lib/a.h"\n' '"lib/a.h" is listed twice'
}

# ---- compile matrix ----

# compiles COMPILER FLAGS... : declarations of each header, and all implementations together in two ways. Each header by
# itself is implemented by its manual's program; code is generated elsewhere: by gcc with -O3 for the examples, in both
# precisions for the tests.
compiles() {
    printf '#define DGFEM_STATIC\n#define DGFEM_IMPLEMENTATION\n' > "$work/static.src"
    : > "$work/implement.src"
    for product in $products; do
        printf '#include "%s"\n#include "%s"\nint used;\n' "$product" "$product" > "$work/declare.src"
        "$@" $warnings -I. -fsyntax-only "$work/declare.src" || return 1
        printf '#include "%s"\n' "$product" >> "$work/static.src"
        printf '#include "%s"\n#define DGFEM_IMPLEMENTATION\n#include "%s"\n#include "%s"\n#undef DGFEM_IMPLEMENTATION\n' \
            "$product" "$product" "$product" >> "$work/implement.src"
    done
    echo 'int used;' >> "$work/static.src"
    "$@" $warnings -I. -fsyntax-only "$work/static.src" && "$@" $warnings -I. -fsyntax-only "$work/implement.src"
}

check_matrix() {
    compiler=$1
    if ! command -v "$compiler" > /dev/null; then
        echo "[  SKIPPED ] $compiler is not installed"
        check "no $compiler here" true
        return
    fi
    case $compiler in
        *++) language='-x c++ -std=c++11' ;;
        *) language='-x c -std=c99' ;;
    esac
    for real in double float; do
        # shellcheck disable=SC2086
        check "$compiler $language $real" compiles "$compiler" $language "-DDGFEM_REAL=$real"
    done
}

# ---- benchmarks ----

# The implementation is left out where the source has no use for its private functions.
check_bench() {
    for source in bench/bench_*.c; do
        grep -q dgfemi_ "$source" && without= || without=$declarations_only
        # shellcheck disable=SC2086
        check "$source compiles" "$gcc" -std=c99 -D_POSIX_C_SOURCE=200809L $warnings $without -I. -Iexamples/common \
            -Itests -Ibench -fsyntax-only "$source"
    done
}

# ---- the library ----

implementation() {
    for product in $products; do printf '#define DGFEM_IMPLEMENTATION\n#include "%s"\n' "$product"; done
}

# Leaves the object for the checks that follow.
symbols_have_prefix() {
    implementation > "$work/a.c"
    "$gcc" -std=c99 "-DDGFEM_REAL=$1" -I. -c -o "$work/$1.o" "$work/a.c" || return 1
    nm -g --defined-only "$work/$1.o" | awk '$3 !~ /^dgfem_/ { print "external symbol", $3; bad = 1 }
        END { if (NR < 10) print "only", NR, "symbols"; exit bad || NR < 10 }'
}

# Prints the names of all macros that are defined at the end of a source.
macros() { "$gcc" -std=c99 "-DDGFEM_REAL=$1" -I. -dM -E "$2" | sed 's/^#define \([A-Za-z0-9_]*\).*/\1/' | sort -u; }

macros_have_prefix() {
    implementation > "$work/with.c"
    grep -h '^#include <' $products | awk '!seen[$0]++' > "$work/without.c"
    macros "$1" "$work/with.c" > "$work/with"
    macros "$1" "$work/without.c" > "$work/without"
    allowed='^DGFEM_'
    [ "$1" = float ] && allowed='^DGFEM_\|^dgfem_[a-z0-9_]*create[a-z0-9_]*$'
    comm -23 "$work/with" "$work/without" > "$work/left"
    [ -s "$work/left" ] && ! grep -v "$allowed" "$work/left"
}

# A DGFEM_STATIC build has no external symbol.
static_is_static() {
    { echo '#define DGFEM_STATIC'; implementation; echo 'int used;'; } > "$work/a.c"
    "$gcc" -std=c99 $warnings -I. -c -o "$work/a.o" "$work/a.c" &&
        [ "$(nm -g --defined-only "$work/a.o" | awk '{ print $3 }')" = used ]
}

# Each creating function that code compiled for one precision calls is not there in the other's library.
precisions_do_not_link() {
    sed -n 's/.*[ *]\(dgfem_[a-z0-9_]*_create[a-z0-9_]*\)(.*/\1/p' $products | grep -v '^dgfem_[a-z]*i_' |
        sort -u > "$work/creating"
    for product in $products; do echo "#include \"$product\""; done > "$work/user.c"
    echo 'typedef void (*any)(void); any used[] = {' >> "$work/user.c"
    sed 's/.*/(any)&,/' "$work/creating" >> "$work/user.c"
    echo '0}; int main(void) { return !used[0]; }' >> "$work/user.c"
    for real in double float; do
        "$gcc" -std=c99 "-DDGFEM_REAL=$real" -I. -c -o "$work/user_$real.o" "$work/user.c" || return 1
        "$gcc" -o "$work/same" "$work/user_$real.o" "$work/$real.o" -lm || return 1
        "$work/same" || return 1
    done
    for pair in "user_double float" "user_float double"; do
        # shellcheck disable=SC2086
        set -- $pair
        "$gcc" -o "$work/mixed" "$work/$1.o" "$work/$2.o" -lm > "$work/mixed.log" 2>&1 && return 1
        while read -r name; do
            grep -q "undefined reference to .${name}[_'\`]" "$work/mixed.log" && continue
            echo "$pair: $name links"
            return 1
        done < "$work/creating"
    done
    [ -s "$work/creating" ]
}

# The indented block under "A WHOLE PROGRAM" at the top of a header.
manual_program() { awk '/^   [A-Z]/ { on = $0 == "   A WHOLE PROGRAM"; next } on { print substr($0, 8) }' "$1"; }

# With the object made before in place of the implementation.
manual_program_runs() {
    manual_program "$2" > "$work/manual.c"
    # shellcheck disable=SC2086
    "$gcc" "-DDGFEM_REAL=$1" -std=c99 $warnings $declarations_only -I. -o "$work/manual" "$work/manual.c" "$work/$1.o" \
        -lm && "$work/manual"
}

check_library() {
    for real in double float; do
        check "external symbols start with dgfem_ ($real)" symbols_have_prefix $real
        check "macros start with DGFEM_ ($real)" macros_have_prefix $real
    done
    check "DGFEM_STATIC leaves no external symbol" static_is_static
    check "float and double do not link together" precisions_do_not_link
    for product in $products; do
        for real in double float; do
            check "the manual's program in $product compiles as printed and runs ($real)" manual_program_runs $real \
                "$product"
        done
    done
}

# ---- a run that fails ----

failing_run_fails() {
    cat > "$work/failing.c" << 'END'
#include "dgfem.h"
#include "check.h"
static void passes(void **state) { (void)state; }
static void fails(void **state) { (void)state; check_near(sqrt(-1.0), 0, 1e300); }
int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(passes), cmocka_unit_test(fails)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
END
    "$gcc" -std=c99 -I. -Itests -w -DDGFEM_IMPLEMENTATION -o "$work/failing" "$work/failing.c" -lcmocka -lm || return 1
    sh tests/run.sh "$work/failing" > "$work/said" 2>&1 && return 1
    cat "$work/said"
    [ "$(tail -n 1 "$work/said")" = "1 passed, 1 failed" ]
}

# run.sh counts one failure for a command that cannot count for itself.
bad_command_fails() {
    sh tests/run.sh "$1" > "$work/said" 2>&1 && return 1
    cat "$work/said"
    [ "$(tail -n 1 "$work/said")" = "0 passed, 1 failed" ]
}

check_failing() {
    check "a check that meets NaN makes the run fail" failing_run_fails
    check "a crash makes the run fail" bad_command_fails "sh -c kill\${IFS}-SEGV\${IFS}\$\$"
    check "a silent program makes the run fail" bad_command_fails true
    check "a missing program makes the run fail" bad_command_fails build/tests/no_such_program
}

# ---- README ----

# The first block fenced as c, and the first fenced as text behind it (its output).
readme_block() { awk -v fence="\`\`\`$1" '$0 == "```" { if (on) exit } on { print } $0 == fence { on = 1 }' README.md; }

readme_program_runs() {
    readme_block c > "$work/readme.c"
    readme_block text > "$work/expected"
    [ -s "$work/readme.c" ] && [ -s "$work/expected" ] || { echo "README.md: no program or no output"; return 1; }
    # shellcheck disable=SC2086
    "$gcc" -std=c99 $warnings -I. -o "$work/readme" "$work/readme.c" -lm && "$work/readme" > "$work/output" &&
        diff "$work/expected" "$work/output"
}

check_readme() {
    check "the README's program compiles as printed and prints what it says" readme_program_runs
}

# ---- examples ----

# prints_keys KEYS COMMAND...: each line of its output is a word and a finite number, and these words are among them.
prints_keys() {
    keys=$1
    shift
    "$@" > "$work/output" || return 1
    cat "$work/output"
    for key in $keys; do grep -q "^$key " "$work/output" || { echo "no line $key"; return 1; }; done
    awk 'NF != 2 || $2 !~ /^-?[0-9][0-9.]*(e[-+][0-9]+)?$/ { exit 1 }' "$work/output"
}

# value KEY: from the last output.
value() { awk -v key="$1" '$1 == key { print $2 }' "$work/output"; }

# near A B TOLERANCE, relative to B.
near() {
    awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN { d = a - b; if (d < 0) d = -d; if (b < 0) b = -b; exit !(d <= t * b) }'
}

slice_keys='triangles elements faces_interior faces_boundary surface_volume mesh_volume surface_area mesh_area'
slice_keys="$slice_keys slivers_merged milliseconds"

octahedron() {
    printf 'v %s\n' '1 0 0' '-1 0 0' '0 1 0' '0 -1 0' '0 0 1' '0 0 -1'
    printf 'f %s\n' '1 3 5' '3 2 5' '2 4 5' '4 1 5' '3 1 6' '2 3 6' '4 2 6'
    [ "$1" = closed ] && echo 'f 1 4 6'
}

slices_octahedron() {
    octahedron closed > "$work/octahedron.obj"
    prints_keys "$slice_keys" build/examples/slice "$work/octahedron.obj" --cells 5 --obj "$work/out.obj" \
        --vtu "$work/out.vtu" || return 1
    near "$(value surface_volume)" 1.3333333333333333 1e-12 && near "$(value mesh_volume)" 1.3333333333333333 1e-12 &&
        near "$(value mesh_area)" 6.9282032302755088 1e-12 && [ "$(value triangles)" = 8 ] &&
        [ -s "$work/out.obj" ] && [ -s "$work/out.vtu" ] || return 1
    # What it wrote is closed again.
    prints_keys "$slice_keys" build/examples/slice "$work/out.obj" --cells 2 || return 1
    near "$(value mesh_volume)" 1.3333333333333333 1e-12
}

# refuses_model WHAT: exit 1 and one line with the name of the file and a number (of the offender).
refuses_model() {
    build/examples/slice "$1" > "$work/output" 2> "$work/errors"
    [ $? = 1 ] || { echo "exit status is not 1"; return 1; }
    cat "$work/output" "$work/errors"
    [ "$(cat "$work/output" "$work/errors" | wc -l)" = 1 ] && grep -q "$(basename "$1")" "$work/errors"
}

refuses_open() {
    octahedron open > "$work/open.obj"
    refuses_model "$work/open.obj" && grep -q 'edge' "$work/errors" && grep -q 'not closed' "$work/errors"
}

refuses_inside_out() {
    octahedron closed | awk '$1 == "f" { print "f", $2, $4, $3; next } { print }' > "$work/turned.obj"
    refuses_model "$work/turned.obj" && grep -q 'inside out' "$work/errors"
}

refuses_empty() { : > "$work/empty.obj" && refuses_model "$work/empty.obj" && refuses_model "$work/absent.obj"; }

# refuses_option COMMAND...: exit 2 for an argument that is not understood.
refuses_option() {
    "$@" > "$work/output" 2> "$work/errors"
    [ $? = 2 ] && grep -q usage "$work/errors"
}

# refuses_value COMMAND...: exit 1 and one line.
refuses_value() {
    "$@" > "$work/output" 2> "$work/errors"
    [ $? = 1 ] || { echo "exit status is not 1"; return 1; }
    cat "$work/errors"
    [ "$(wc -l < "$work/errors")" = 1 ]
}

beam_keys='elements dofs tip_x tip_y tip_z energy iterations milliseconds_assemble milliseconds_solve'

runs_beam() {
    prints_keys "$beam_keys" build/examples/beam --static --vtu "$work/beam.vtu" && [ -s "$work/beam.vtu" ] &&
        [ "$(value elements)" = 32 ] && [ "$(value dofs)" = 384 ] && near "$(value tip_x)" -0.2858 2e-4 &&
        near "$(value tip_z)" -1.4375 1e-4
}

shell_keys='nodes dofs displacement reference normalised milliseconds'

# runs_shell ARGUMENTS...: the result is within 3 % of the reference.
runs_shell() { prints_keys "$shell_keys" build/examples/shell_benchmark "$@" && near "$(value normalised)" 1 0.03; }

runs_shells() {
    runs_shell --test plate_ss_q --n 6 && runs_shell --test scordelis --n 8 && runs_shell --test hemisphere --n 10 &&
        runs_shell --test plate_cl_q --element t6 --n 12 && runs_shell --test endshear --n 8
}

runs_bunny() {
    mkdir "$work/frames" && build/examples/bunny --out "$work/frames" --seconds 0.1 &&
        [ -s "$work/frames/skin_0000.obj" ] && [ -s "$work/frames/elements_0000.vtu" ]
}

# The corrected rules pass the patch test on all meshes, the one as published does not.
runs_mvc_patch() {
    for arguments in cube hex voronoi planes "voronoi --quadrature paper" "planes --seed 5 --quadrature paper"; do
        # shellcheck disable=SC2086
        build/examples/mvc_patch --mesh $arguments > "$work/output" || return 1
        cat "$work/output"
        [ "$(head -n 1 "$work/output")" = "elements nodes max_error min_eigen max_eigen" ] &&
            awk 'NR == 2 && NF == 5 && $3 <= 1e-12 && $4 > 0 && $5 > $4 { ok = 1 } END { exit !ok }' "$work/output" ||
            return 1
    done
    build/examples/mvc_patch --mesh voronoi --quadrature paper_raw > "$work/output" || return 1
    awk 'NR == 2 && $3 > 1e-4 { ok = 1 } END { exit !ok }' "$work/output"
}

mvc_slope_keys='elements nodes steps travel most_contacts least_volume largest_volume microseconds_per_step'

mvc_bunny_keys='start_nodes start_elements nodes elements pieces cuts elements_kept volume_error milliseconds_per_cut'

# Volume is kept by all cuts; two tetrahedra from a file are cut as well.
runs_mvc_bunny() {
    build/examples/mvc_bunny --cells 5 --slices 3 --layers 1 --steps 60 --ply "$work/bunny.ply" > "$work/bunny" &&
        prints_keys "$mvc_bunny_keys" sed 1d "$work/bunny" &&
        awk -v e="$(value volume_error)" 'BEGIN { exit !(e != "" && e < 1e-10) }' || return 1
    printf '5 3\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n4 1 1 1\n' > "$work/two.node"
    printf '2 4\n0 0 1 2 3\n1 1 2 3 4\n' > "$work/two.ele"
    prints_keys "$mvc_bunny_keys" build/examples/mvc_bunny "$work/two.ele" --slices 1 --steps 20 &&
        [ "$(value start_elements)" = 2 ] && [ "$(value pieces)" -ge 2 ]
}

check_examples() {
    check "hello runs" build/examples/hello
    check "beam prints its keys, and the tip of the reference" runs_beam
    check "beam refuses an unknown option" refuses_option build/examples/beam --bogus 1
    check "beam refuses Poisson's ratio 0.5" refuses_value build/examples/beam --static --poisson 0.5
    check "beam refuses density 0" refuses_value build/examples/beam --static --density 0
    check "beam refuses dt 0" refuses_value build/examples/beam --steps 1 --dt 0
    check "slice prints its keys, and exact measures" slices_octahedron
    check "slice refuses an open surface and names the edge" refuses_open
    check "slice refuses a surface that is inside out" refuses_inside_out
    check "slice refuses empty and absent files" refuses_empty
    check "shell_benchmark prints its keys, and the references within 3 %" runs_shells
    check "shell_benchmark refuses an unknown test" refuses_option build/examples/shell_benchmark --test bogus
    check "shell_sheet refuses too few steps" refuses_value build/examples/shell_sheet --dt 1
    check "mvc_patch passes with the corrected rules alone" runs_mvc_patch
    check "mvc_slope prints its keys" prints_keys "$mvc_slope_keys" build/examples/mvc_slope --ply "$work/slope.ply"
    check "mvc_slope refuses Young's modulus 0" refuses_value build/examples/mvc_slope --young 0
    check "mvc_bunny cuts its lattice, and tetrahedra of a file" runs_mvc_bunny
    check "mvc_bunny refuses an absent mesh" refuses_value build/examples/mvc_bunny "$work/absent.ele"
    check "mvc_patch refuses an unknown mesh" refuses_option build/examples/mvc_patch --mesh bogus
    check "bunny runs with its own shape" runs_bunny
}

what=${1:-}
case $what in
    headers | packer | bench | library | failing | readme | examples) "check_$what" ;;
    matrix) check_matrix "$2" ;;
    *)
        sed -n '2,/^$/s/^# \{0,1\}//p' "$0"
        exit 2
        ;;
esac
finish
