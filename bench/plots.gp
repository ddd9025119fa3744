# Plots of the benchmarks' CSV files: gnuplot -e "at='build/bench'" bench/plots.gp
set datafile separator comma
set grid lc rgb "#dddddd"
set key left top Left reverse spacing 1.2
set style data linespoints
set pointsize 0.9
set linetype 1 lc rgb "#1f5fa8" pt 7 lw 2
set linetype 2 lc rgb "#2f8f4e" pt 9 lw 2
set linetype 3 lc rgb "#c2452d" pt 5 lw 2
set linetype 4 lc rgb "#8a56a8" pt 11 lw 2
set linetype 5 lc rgb "#b8860b" pt 13 lw 2
set linetype 6 lc rgb "#555555" pt 2 lw 2
file(name) = at . "/" . name . ".csv"
solvers = system("tail -n +2 ".file("size_step")." | cut -d, -f2 | awk '!seen[$0]++'")
rows(solver) = "< grep ,".solver.", ".file("size_step")

set term pngcairo size 1100,800 font 'sans,10'
set logscale xy
set xlabel "unknowns"
set format x "10^{%T}"

set output at . "/size.png"
set multiplot layout 2,2
set title "Time of a step, median (ms)"
plot for [name in solvers] rows(name) using 1:(1e3*$4) title name, 1000.0/60 lw 1 dt 2 lc rgb "#999999" title "60 steps a second"
set title "Cholesky factorization of a step's matrix (ms)"
plot file("size_factor") using 1:(1e3*$2) title "analysis", "" using 1:(1e3*$3) title "factorization", \
     "" using 1:(1e3*$4) title "solve", "" using 1:(1e3*$5) title "product"
set title "Memory of a body (MB)"
plot for [name in solvers] rows(name) using 1:(1e-6*$12) title name
unset logscale y
set yrange [0:]
set title "Rate of the factorization and the product (GFLOP/s), iterations of a step"
plot file("size_factor") using 1:(1e-9*$6/$3) title "factorization", "" using 1:(1e-9*$9/$5) title "product", \
     for [name in solvers] rows(name) using 1:9 title "iterations, ".name
unset multiplot

array method[4] = ["degree 1", "degree 2", "degree 3", "continuous tetrahedra"]
set logscale xy
set autoscale y
set key left bottom
set xlabel "relative error of the tip"
set ylabel "ms"
set output at . "/error.png"
set multiplot layout 2,2
do for [poisson=0:1] {
    name = poisson ? "Poisson's ratio 0.3" : "Poisson's ratio 0"
    set title "Static solve, ".name
    plot for [k=1:4] file("error") index 4*poisson+k-1 every ::1 using 4:5 title method[k]
    set title "Time step, ".name
    plot for [k=1:4] file("error") index 4*poisson+k-1 every ::1 using 4:6 title method[k]
}
unset multiplot
