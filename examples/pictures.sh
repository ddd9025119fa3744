#!/bin/sh
# pictures.sh demo    renders what `make demo` left in build/demo/; without f3d and xvfb it says so and is content
# pictures.sh all     runs the examples and renders examples/pictures/*.png
# Run it from the top of the repository, after `make examples`.
set -u

# f3d draws through OpenGL, which needs a display: xvfb lends one. It must not read the user's settings.
shot() {
    input=$1
    output=$2
    shift 2
    rm -f "$output"
    timeout 120 xvfb-run -a -s "-screen 0 1600x1200x24" f3d "$input" --output "$output" --dry-run --quiet --up=+Z \
        --resolution=1400,700 --bg-color=1,1,1 --camera-view-up=0,0,1 --fxaa "$@" > /dev/null 2>&1
    if [ -s "$output" ]; then echo "picture: $output"; else echo "no picture of $input: f3d failed" && return 1; fi
}

# The skin at several moments on the slope; and the last frame's elements, coloured by stress.
scene() {
    shot "$1/scene.ply" "$2" --scalars=RGB --comp=-2 --ssao --roughness=0.8 --camera-position=0.6,-11,4.2 \
        --camera-focal-point=0,0,0.75 --camera-view-angle=26
}

elements() {
    [ -e "$1/elements_0000.vtu" ] || return 1
    last=$(ls "$1"/elements_*.vtu | tail -n 1)
    shot "$last" "$2" --scalars=von_mises --cells --edges --ssao --roughness=0.8 \
        --colormap=0,0.25,0.45,0.8,0.5,0.9,0.9,0.85,1,0.85,0.25,0.15 --camera-azimuth-angle=25 \
        --camera-elevation-angle=20
}

can_draw() { command -v f3d > /dev/null && command -v xvfb-run > /dev/null; }

all() {
    mkdir -p examples/pictures build/pictures/bunny
    build/examples/bunny --model build/bunny.obj --out build/pictures/bunny > build/pictures/bunny.txt || return 1
    scene build/pictures/bunny examples/pictures/bunny.png || return 1
    elements build/pictures/bunny examples/pictures/elements.png || return 1
}

case ${1:-} in
    demo)
        if ! can_draw; then echo "no pictures: f3d or xvfb-run is not installed"; exit 0; fi
        scene build/demo build/demo/scene.png
        elements build/demo build/demo/elements.png
        exit 0
        ;;
    all)
        can_draw && all && exit 0
        echo "pictures: not all could be rendered"
        exit 1
        ;;
    *) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" | grep -v ^set; exit 2 ;;
esac
