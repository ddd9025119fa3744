#!/bin/sh
# pictures.sh demo    renders what `make demo` left in build/demo/; without f3d and xvfb it says so and is content
# pictures.sh shells  runs the examples of shells and renders their pictures
# pictures.sh cuts    runs the examples of cuts and renders their pictures
# pictures.sh polyhedra  runs the examples of polyhedral elements and renders their pictures
# pictures.sh all     runs the examples and renders examples/pictures/*.png
# Run it from the top of the repository, after `make examples`.
set -u

# f3d draws through OpenGL, which needs a display: xvfb lends one. --dry-run keeps it from reading the user's settings.
shot() {
    input=$1
    output=$2
    shift 2
    rm -f "$output"
    timeout 120 xvfb-run -a -s "-screen 0 1600x1200x24" f3d "$input" --output "$output" --dry-run --quiet --up=+Z \
        --bg-color=1,1,1 --camera-view-up=0,0,1 --ssao --fxaa --tone-mapping "$@" > /dev/null 2>&1
    if [ -s "$output" ]; then echo "picture: $output"; else echo "no picture of $input: f3d failed" && return 1; fi
}

# scene FOLDER PICTURE: the skin at several moments.
scene() {
    shot "$1/scene.ply" "$2" --resolution=1400,640 --scalars=RGB --comp=-2 --roughness=0.5 \
        --camera-position=0.3,-11,4.6 --camera-focal-point=-0.05,0,1.15 --camera-view-angle=20
}

# The value that nine in ten elements stay below.
stress_range() {
    sed -n '/von_mises/,/DataArray>/p' "$1" | grep -v DataArray | sort -g |
        awk '{ v[NR] = $1 } END { print v[int(0.9 * NR) + 1] }'
}

# elements FOLDER PICTURE: the elements in the middle of the tumble, coloured by stress.
elements() {
    frame=$1/elements_0012.vtu
    [ -e "$frame" ] || return 1
    shot "$frame" "$2" --resolution=1000,640 --scalars=von_mises --cells --roughness=0.6 \
        --range="0,$(stress_range "$frame")" --colormap=0,0.25,0.45,0.8,0.3,0.9,0.9,0.85,1,0.85,0.25,0.15 \
        --camera-azimuth-angle=25 --camera-elevation-angle=20 --camera-view-angle=20
}

# bar FRAME ARRAY PICTURE RANGE AZIMUTH ANGLE: a bar's elements with their edges, coloured by stress.
bar() {
    shot "$1" "$3" --resolution=1000,480 --scalars="$2" --cells --edges --roughness=0.6 --range="$4" \
        --colormap=0,0.25,0.45,0.8,0.3,0.9,0.9,0.85,1,0.85,0.25,0.15 \
        --camera-azimuth-angle="$5" --camera-elevation-angle=15 --camera-view-angle="$6"
}

# painted FILE PICTURE SIZE EYE FOCUS ANGLE: a coloured surface.
painted() {
    shot "$1" "$2" --resolution="$3" --scalars=RGB --comp=-2 --roughness=0.5 --camera-position="$4" \
        --camera-focal-point="$5" --camera-view-angle="$6"
}

cuts() {
    dir=build/pictures/cuts
    mkdir -p $dir/knife
    build/examples/pencil --ply $dir/pencil.ply > $dir/pencil.txt || return 1
    build/examples/bunny_out_of_cube --model build/bunny.obj --ply $dir/cube.ply > $dir/cube.txt || return 1
    build/examples/knife --model build/bunny.obj --surface --out $dir/knife > $dir/knife.txt || return 1
    painted $dir/pencil.ply examples/pictures/pencil.png 760,360 0.235,-0.13,0.055 0.158,0,-0.012 24 || return 1
    painted $dir/cube.ply examples/pictures/bunny_out_of_cube.png 640,560 2,-4.5,2.2 0,0,0.53 27 || return 1
    for moment in middle end; do
        painted $dir/knife/$moment.ply examples/pictures/knife_$moment.png 640,480 2.2,-3.6,2.2 0,0,0.3 22 || return 1
    done
}

# shell FILE PICTURE AZIMUTH ELEVATION: one shell, from the side.
shell() {
    shot "$1" "$2" --resolution=640,640 --roughness=0.5 --camera-azimuth-angle="$3" --camera-elevation-angle="$4"
}

shells() {
    mkdir -p build/pictures/shells
    build/examples/shell_buckling --out build/pictures/shells > build/pictures/shells/buckling.txt || return 1
    build/examples/shell_sheet --out build/pictures/shells > build/pictures/shells/sheet.txt || return 1
    build/examples/shell_can --out build/pictures/shells > build/pictures/shells/can.txt || return 1
    shell build/pictures/shells/buckling_0005.obj examples/pictures/shell_buckling.png 25 12 || return 1
    shell build/pictures/shells/sheet_0013.obj examples/pictures/shell_sheet.png 60 10 || return 1
    shell build/pictures/shells/can_0010.obj examples/pictures/shell_can.png 25 20 || return 1
}

polyhedra() {
    mkdir -p build/pictures/polyhedra
    build/examples/mvc_slope --ply build/pictures/polyhedra/slope.ply > build/pictures/polyhedra/slope.txt || return 1
    painted build/pictures/polyhedra/slope.ply examples/pictures/mvc_slope.png 900,400 0.75,-4.4,1.15 0.75,0,-0.2 18 || return 1
    build/examples/mvc_cut --ply build/pictures/polyhedra/cut.ply > build/pictures/polyhedra/cut.txt || return 1
    build/examples/mvc_slice --ply build/pictures/polyhedra/slice.ply > build/pictures/polyhedra/slice.txt || return 1
    painted build/pictures/polyhedra/cut.ply examples/pictures/mvc_cut.png 1000,400 0.9,-5,1.6 0.9,0,0.32 11 || return 1
    painted build/pictures/polyhedra/slice.ply examples/pictures/mvc_slice.png 900,330 1.5,-3,0.7 0.62,0.1,0.13 10.5 || return 1
    tetrahedra=build/bunny.1.ele
    [ -s $tetrahedra ] || tetrahedra="--model build/bunny.obj"
    # shellcheck disable=SC2086
    build/examples/mvc_bunny $tetrahedra --ply build/pictures/polyhedra/bunny.ply > build/pictures/polyhedra/bunny.txt || return 1
    painted build/pictures/polyhedra/bunny.ply examples/pictures/mvc_bunny.png 1000,330 2.35,-11,2.9 2.35,0,0.72 13.5 || return 1
}

can_draw() { command -v f3d > /dev/null && command -v xvfb-run > /dev/null; }

all() {
    mkdir -p examples/pictures build/pictures/bunny
    build/examples/bunny --model build/bunny.obj --out build/pictures/bunny > build/pictures/bunny.txt || return 1
    scene build/pictures/bunny examples/pictures/bunny.png || return 1
    elements build/pictures/bunny examples/pictures/elements.png || return 1
    shells || return 1
    cuts || return 1
    polyhedra || return 1
    build/examples/adaptive_bar --vtu build/pictures/eight.vtu > build/pictures/eight.txt || return 1
    bar build/pictures/eight.vtu stress examples/pictures/adaptive_bar_eight.png 0,12000 -25 17 || return 1
    build/examples/adaptive_bar --how two --vtu build/pictures/two.vtu > build/pictures/two.txt || return 1
    bar build/pictures/two.vtu stress examples/pictures/adaptive_bar_two.png 0,12000 -25 17 || return 1
    build/examples/fracture --split --vtu build/pictures/fracture.vtu > build/pictures/fracture.txt || return 1
    bar build/pictures/fracture.vtu tension examples/pictures/fracture.png 0,60000 20 20 || return 1
}

case ${1:-} in
    demo)
        if ! can_draw; then echo "no pictures: f3d or xvfb-run is not installed"; exit 0; fi
        scene build/demo build/demo/scene.png
        elements build/demo build/demo/elements.png
        exit 0
        ;;
    all | shells | cuts | polyhedra)
        can_draw && $1 && exit 0
        echo "pictures: not all could be rendered"
        exit 1
        ;;
    *) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" | grep -v ^set; exit 2 ;;
esac
