# Plots of the paper's experiments from their CSV files: gnuplot -e "from='build/paper'; to='examples/paper/plots'" plots.gp
# Each program's tables are blocks of its file, told by index.
set datafile separator comma
set grid lc rgb "#dddddd"
set key spacing 1.2 outside right top Left reverse
set style data linespoints
set pointsize 0.9
set linetype 1 lc rgb "#1f5fa8" pt 7 lw 2
set linetype 2 lc rgb "#c2452d" pt 5 lw 2
set linetype 3 lc rgb "#2f8f4e" pt 9 lw 2
set linetype 4 lc rgb "#8a56a8" pt 11 lw 2
set linetype 5 lc rgb "#b8860b" pt 13 lw 2
set linetype 6 lc rgb "#555555" pt 2 lw 2
file(name) = from . "/" . name . ".csv"
picture(name) = to . "/" . name . ".png"
one = "pngcairo size 800,430 font 'sans,10'"
two = "pngcairo size 1040,350 font 'sans,9'"
set format y "10^{%T}"

set term @one
set output picture("fig1")
set title "Fig. 1: IP finds x^2 for every penalty, BZ for none"
set xlabel "penalty eta"
set ylabel "L2 error"
set logscale xy
plot file("fig1") index 0 using 1:2 title "BZ", "" index 0 using 1:5 title "IP"

set term @two
set output picture("fig2")
set multiplot layout 1,2
set title "Fig. 2: L2 error of the Poisson problem"
set xlabel "squares along each side"
set logscale x 2
array method[5] = ["CG bilinear", "BZ p=1", "IP p=1", "BZ p=2", "IP p=2"]
plot for [k=1:5] file("fig2") index 0 every ::1 using 1:k+1 title method[k]
set title "condition number of the matrix"
unset ylabel
plot for [k=1:5] file("fig2") index 1 using 1:k+1 title method[k]
unset multiplot

set term @two
set output picture("fig3")
set multiplot layout 1,2
set logscale x 10
set format x "10^{%T}"
set xtics 1e-4, 1e3
set title "Fig. 3: from rigid cells (left) to CG (right)"
set xlabel "penalty eta"
set ylabel "tip displacement"
plot file("fig3") index 0 using 1:(-column(2)) title "BZ, p = 1", \
     "" index 0 using 1:(-column(2)/column(3)) with lines title "CG", \
     "" index 0 using 1:(-column(2)/column(4)) with lines title "rigid cells, same glue"
set title "where the energy is"
unset logscale y
set format y "%g"
set ylabel "% of the energy in the elements"
plot file("fig3") index 0 using 1:6 notitle
unset multiplot
set xtics autofreq
set format x "%g"
set logscale y
set format y "10^{%T}"

set term @one
set output picture("fig4")
set title "Fig. 4: integral of x^2 y^2 z^2 over the corner-cut cube"
set xlabel "microseconds"
set ylabel "relative error"
set format x "10^{%T}"
plot file("fig4") index 3 using 3:5 title "random points", "" index 2 using 3:5 title "voxels", \
     "" index 1 using 3:5 title "Gauss points on tetrahedra", \
     "" index 0 using 3:5 with points ps 2 title "moments (all up to degree 6)"
set format x "%g"

set output picture("table1")
set title "Table 1: times"
set style data histograms
set style fill solid 0.9 border -1
set xlabel ""
set ylabel "milliseconds"
unset logscale x
set xtics rotate by -20
plot file("table1") index 0 every ::1::5 using 6:xtic(1) lc rgb "#1f5fa8" title "integrate", \
     "" index 0 every ::1::5 using 7 lc rgb "#b9d0ea" title "(paper)", \
     "" index 0 every ::1::5 using 8 lc rgb "#2f8f4e" title "assemble", \
     "" index 0 every ::1::5 using 9 lc rgb "#bfe3c9" title "(paper)", \
     "" index 0 every ::1::5 using 11 lc rgb "#c2452d" title "solve", \
     "" index 0 every ::1::5 using 12 lc rgb "#f0c4ba" title "(paper)"

set output picture("fig9")
set title "Fig. 9: the hanging cube, nu = 0.499"
unset logscale y
set format y "%g"
set ylabel "mean fall of the bottom; asymmetry"
set yrange [0:1.2]
set xtics rotate by -35
set bmargin 11
plot file("fig9") index 0 every ::1 using (-column(5)):xtic(1) title "bottom", "" index 0 every ::1 using 6 title "asymmetry"
set yrange [*:*]
unset bmargin
set style data linespoints
set xtics norotate

set output picture("fig11")
set yrange [1e2:*]
set title "Fig. 11: a shrinking element"
set xlabel "size of the innermost element"
set ylabel "condition number"
set logscale xy
set format y "10^{%T}"
set format x "%g"
plot file("fig11") index 0 using 1:5 title "p=1, global monomials", "" index 1 using 1:5 title "p=2, global monomials", \
     "" index 0 using 1:4 title "p=1, centred", "" index 1 using 1:4 title "p=2, centred", \
     "" index 0 using 1:3 title "p=1, centred, Jacobi", "" index 1 using 1:3 title "p=2, centred, Jacobi"

set output picture("fig12")
set yrange [*:*]
set title "Fig. 12: a thin feature of height eps"
set xlabel "eps"
set format x "10^{%T}"
plot file("fig12") index 0 using 1:3 title "p=1", "" index 0 using 1:5 title "p=2", "" index 0 using 1:7 title "p=3", \
     "" index 0 using 1:4 title "p=1, Jacobi", "" index 0 using 1:6 title "p=2, Jacobi", "" index 0 using 1:8 title "p=3, Jacobi"
set format x "%g"

set term @two
set output picture("cook")
set multiplot layout 1,2
unset logscale y
set format y "%g"
set logscale x 2
set xlabel "boxes along each side"
set ylabel "vertical displacement of A"
set title "Cook's membrane, nu = 1/3, plane stress"
plot for [p=1:3] file("cook") index 0 using (strstrt(strcol(1), "graded") ? 1/0 : column(1)):2*p title sprintf("p=%d", p), 23.96 with lines title "published"
set title "Cook's membrane, nu = 0.4999, plane strain"
plot for [p=1:3] file("cook") index 2 using (strstrt(strcol(1), "graded") ? 1/0 : column(1)):2*p title sprintf("p=%d", p), 16.442 with lines title "published"
unset multiplot

set output picture("convergence")
set multiplot layout 1,2
set logscale y
set format y "10^{%T}"
set xlabel "unknowns"
set ylabel "L2 error"
set logscale x 10
set format x "10^{%T}"
array mesh[3] = ["cubes", "tetrahedra", "cut cubes"]
set title "IP, default penalty, nu = 0.3"
plot for [m=1:3] for [p=1:3] file("convergence") index m-1 using (column(2)==p ? column(5) : 1/0):7 \
     lt p pt 3+2*m dt m title sprintf("%s p=%d", mesh[m], p)
set title "BZ against IP on cubes"
plot for [p=1:3] file("convergence") index 0 using (column(2)==p ? column(5) : 1/0):7 lt p title sprintf("IP p=%d", p), \
     for [p=1:3] file("convergence") index 4 using (column(2)==p ? column(5) : 1/0):7 lt p dt 2 title sprintf("BZ p=%d, eta 20", p), \
     for [p=1:3] file("convergence") index 5 using (column(2)==p ? column(5) : 1/0):7 lt p dt 3 title sprintf("BZ p=%d, eta 2", p)
unset multiplot

set term @one
set output picture("patch")
unset logscale x
set format x "%g"
set xlabel "mesh"
set ylabel "largest error"
set title "Patch test on polyhedra with slivers, Vmin/Vmax < 1e-6"
set style data points
plot file("patch") index 0 using 0:4 title "p=1", "" index 0 using 0:5 title "p=2", "" index 0 using 0:6 title "p=3", \
     1e-13 with lines lc rgb "#888888" dt 2 lw 1 title "1e-13"

set term @two
set output picture("spin")
set multiplot layout 1,2
set style data linespoints
set logscale x 10
set format x "10^{%T}"
set xlabel "Young's modulus, Pa"
set ylabel "% of angular momentum lost in 3 s"
set title "Free spin, 16 boxes: angular momentum"
step(k) = k == 1 ? "1/60" : "1/30"
plot for [k=1:2] for [p=1:3] file("spin") index 0 using (column(1)==p && strcol(2) eq step(k) ? column(3) : 1/0):5 \
     lt p dt k title sprintf("p=%d, h=%s", p, step(k)), 0.5 with lines lc rgb "#888888" dt 2 lw 1 title "0.5 %"
set ylabel "% of the largest energy"
set title "largest growth of the energy in a step"
plot for [k=1:2] file("spin") index 0 using (column(1)==1 && strcol(2) eq step(k) ? column(3) : 1/0):6 \
     lt 1 dt k title sprintf("first step, h=%s", step(k)), \
     for [k=1:2] file("spin") index 0 using (column(1)==1 && strcol(2) eq step(k) ? column(3) : 1/0):7 \
     lt 2 dt k title sprintf("later, h=%s", step(k)), 1 with lines lc rgb "#888888" dt 2 lw 1 title "1 %"
unset multiplot
