#!/usr/bin/env bash
# Renders the pictures of README and GUIDE into the folder of this script:
#
#     cargo build --release
#     docs/pictures/make.sh [SECONDS [RACE_SECONDS]]
#
# SECONDS (default 600) is the rendering time of each image; 0 leaves the images as they are. The estimator is lcs with
# a gate and in fog, otherwise bdpt. RACE_SECONDS (default 30) is the rendering time of each estimator in the row of crops. The
# reference of the row takes 40 times as long, and 160 times at most.
#
# Environment: RESOLUTION of the images (640x360), CROP_RESOLUTION of the row (320x180), TAUGATE, the program
# (target/release/taugate), and PYTHON (python3), which needs Pillow 10.1 or later, numpy, matplotlib, pytest and selenium
# (pip install pillow numpy matplotlib pytest selenium). The pictures of the viewer need Debian's packages chromium and
# chromium-driver. Scenes, EXR files and references stay in bench-pictures.
set -euo pipefail

seconds=${1:-600}
race_seconds=${2:-30}
pictures=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$pictures/../.." && pwd)
taugate=${TAUGATE:-$root/target/release/taugate}
python=${PYTHON:-python3}
resolution=${RESOLUTION:-640x360}
work=$root/bench-pictures

[ -x "$taugate" ] || { echo "there is no program $taugate; run: cargo build --release" >&2; exit 2; }
"$python" -c 'import PIL, numpy, matplotlib, pytest, selenium' 2>/dev/null ||
    { echo "$python lacks a package; run: pip install pillow numpy matplotlib pytest selenium" >&2; exit 2; }

mkdir -p "$work"
"$taugate" generate cluttered-room -o "$work/cluttered-room.glb"

picture() { # NAME SCENE [FLAG...]
    local name=$1 scene=$2
    shift 2
    [ "$seconds" != 0 ] || return 0
    "$taugate" render "$scene" --time "${seconds}s" --resolution "$resolution" \
        -o "$work/$name.exr" --png "$pictures/$name.png" "$@"
}
picture cornell-steady "$root/scenes/cornell-box.glb"
picture cornell-gated "$root/scenes/cornell-box.glb" --gate 6.2m..6.5m
picture door-steady "$root/scenes/door-ajar.glb"
picture door-gated "$root/scenes/door-ajar.glb" --gate 16.8m..17.1m
picture clutter-steady "$work/cluttered-room.glb"
picture clutter-gated "$work/cluttered-room.glb" --gate 7m..7.3m
fog=(--headlamp 20 --headlamp-offset 0.3,0.2,0 --emitters headlamp --visibility 8m --droplet-diameter 15)
picture fog-steady "$work/cluttered-room.glb" "${fog[@]}" --estimator lcs
picture fog-gated "$work/cluttered-room.glb" "${fog[@]}" --gate 8m..8.6m

# The laser, the open shutter and the cloud of GUIDE.
if [ "$seconds" != 0 ]; then
    "$taugate" render "$pictures/laser.toml" --gate-keys 0=4.6m..4.7m --gate-keys 2=5.8m..5.9m --frames 0..3 --time "${seconds}s" \
        -o "$work/laser.#.exr" --contact-sheet "$pictures/laser.png"
    street=("$root/scenes/street.glb" --depth 8m..40m --resolution 400x225 --time "${seconds}s" --exposure 1.8 --at 1.5s)
    "$taugate" render "${street[@]}" -o "$work/still.exr" --png "$work/still.png"
    "$taugate" render "${street[@]}" --shutter 0..200ms -o "$work/shutter.exr" --png "$work/shutter.png"
    "$python" "$pictures/sheet.py" "$pictures/shutter.png" 2 "$work/still.png" "$work/shutter.png"
    "$taugate" render "$root/scenes/street.glb" --at 1s --doppler 12m/s --estimator bdpt --resolution 480x270 --spp 64 -o "$work/doppler.exr" \
        --png "$pictures/doppler.png"
    "$python" "$root/examples/cloud.py" "$work/cloud.npy"
    cloud=("$root/scenes/cornell-box.glb" --density-grid "$work/cloud.npy" --medium-bounds=-0.8,0.8,-0.6,0.8,1.7,0.6 --sigma-s 20
        --phase-g 0.5 --resolution 240x240 --time "${seconds}s")
    "$taugate" render "${cloud[@]}" -o "$work/cloud-steady.exr" --png "$pictures/cloud-steady.png"
    "$taugate" render "${cloud[@]}" --gate 4.4m..4.9m -o "$work/cloud-gated.exr" --png "$pictures/cloud-gated.png"
fi

sequence() { # FLAG...
    [ "$seconds" = 0 ] || "$taugate" render "$@"
}
sequence "$root/scenes/cornell-box.glb" --gate-keys 0=4.4m..4.9m --gate-keys 7=7.9m..8.4m --frames 0..8 --spp 128 \
    --resolution 200x200 -o "$work/transient.#.exr" --contact-sheet "$pictures/transient.png"
if [ "$seconds" != 0 ]; then
    "$taugate" render "$root/scenes/hidden-letter.toml" --spp 4096 -o "$work/letter.npy"
    "$python" "$root/examples/hidden_letter.py" "$work/letter.npy" "$pictures/letter.png"
    "$taugate" render "$root/scenes/street-turn.toml" -o "$work/turn.npy"
    "$taugate" lidar "$work/turn.npy" -o "$work/turn_points.npy"
    "$python" "$pictures/points.py" "$work/turn_points.npy" "$pictures/turn.png" time
    "$taugate" render "$root/scenes/windscreen-lidar.toml" --aov depth,object -o "$work/fog.npy"
    "$taugate" lidar "$work/fog.npy" -o "$work/fog_points.npy" --threshold 0.02
    "$python" "$pictures/points.py" "$work/fog_points.npy" "$pictures/fog-lidar.png" object
fi
sequence "$root/scenes/street-drive.toml" --resolution 192x108 -o "$work/street.##.exr" --gif "$pictures/street.gif"

# The street behind a windscreen, without merging and with it.
if [ "$seconds" != 0 ]; then
    through=("$root/scenes/windscreen.glb" --gate 20m..60m --resolution 480x270 --exposure 3.5)
    "$taugate" render "${through[@]}" --merge off --spp 8 -o "$work/windscreen-off.png"
    "$taugate" render "${through[@]}" --time "${seconds}s" -o "$work/windscreen-on.png"
    "$python" -c 'import sys; from PIL import Image; parts = [Image.open(p).convert("RGB").resize((400, 225)) for p in sys.argv[1:3]]
both = Image.new("RGB", (808, 225), "white"); both.paste(parts[0], (0, 0)); both.paste(parts[1], (408, 0))
both.quantize(128).save(sys.argv[3], optimize=True)' "$work/windscreen-off.png" "$work/windscreen-on.png" "$pictures/windscreen.png"
fi

# A contact sheet of the files of other programs in tests/data/gltf.
if [ "$seconds" != 0 ]; then
    mkdir -p "$work/corpus"
    for file in "$root"/tests/data/gltf/*.gl[bt]*; do
        name=$(basename "${file%.*}")
        "$taugate" render "$file" --camera auto --headlamp --resolution 160x120 --spp 256 --estimator pt --quiet \
            -o "$work/corpus/$name.exr" --png "$work/corpus/$name.png"
    done
    "$python" "$pictures/sheet.py" "$pictures/corpus.png" 6 "$work"/corpus/*.png
fi

# The page of the viewer, in the browser of the tests. A palette makes the files small.
if [ "$seconds" != 0 ]; then
    TAUGATE_PROGRAM=$taugate TAUGATE_PICTURES=$work \
        "$python" -m pytest -q -p no:cacheprovider --noconftest "$root/python/tests/view/test_pictures.py"
    for name in view view-gates; do
        "$python" -c 'import sys; from PIL import Image; Image.open(sys.argv[1]).convert("RGB").quantize(256).save(sys.argv[2], optimize=True)' \
            "$work/$name.png" "$pictures/$name.png"
    done
fi

race=("$taugate" bench "$pictures/crops.toml" --time "${race_seconds}s" --out "$work/crops")
[ -z "${CROP_RESOLUTION:-}" ] || race+=(--resolution "$CROP_RESOLUTION")
# Where a figure is left out because the reference is too poor, --reference goes on from where the reference is.
for attempt in 1 2 3 4; do
    "${race[@]}" --reference || [ $? -eq 1 ]
    rm -f "$work/crops/results.csv"
    "${race[@]}" && "$python" "$pictures/row.py" "$work/crops" lamps "$pictures/crops.png" && exit || code=$?
    [ "$code" -ne 130 ] || exit 130 # Interrupted.
done
echo "the reference of the row is still too poor after $attempt attempts; run this again to extend it" >&2
exit 1
