#!/usr/bin/env bash
# Renders small images with two binaries and compares all channels bit by bit:
#
#     benches/same_bits.sh OLD_BINARY NEW_BINARY [PATTERN]
#
# PATTERN (a bash regular expression) selects images by their arguments. NEW_BINARY generates the scenes. Needs python3. Exit code
# 0: all images are equal, 1: some images differ, 2: wrong arguments, 3: a binary cannot render an image.
set -euo pipefail

[ $# -ge 2 ] && [ -x "$1" ] && [ -x "$2" ] || { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
old=$(realpath "$1")
new=$(realpath "$2")
pattern=${3:-.}
here=$(cd "$(dirname "$0")" && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

for name in cornell-box door-ajar zoo-area zoo-punctual zoo-beam; do
    "$new" generate "$name" -o "$name.glb"
done
cp "$here"/../tests/data/gltf/{layers,sun_and_orthographic}.glb .

# Scene and flags of each image. The list covers every estimator; area, point, spot and beam lights, a sun and a sky; textures, alpha,
# glass, mirror, gloss and a clear coat; fog; an orthographic view; without a gate, with wide, thin and many gates; uniform and
# adaptive sampling; and the flags that select kernels.
images=$(cat <<'LIST'
cornell-box --estimator pt --spp 16
cornell-box --estimator pt --gate 6.2m..6.5m --spp 16
cornell-box --estimator bdpt --spp 16
cornell-box --estimator bdpt --gate 6.2m..6.5m --spp 16
cornell-box --estimator lcs-paper --spp 16
cornell-box --estimator lcs-paper --gate 6.2m..6.5m --sampling adaptive --spp 16
cornell-box --estimator lcs-paper --queries 24 --gate 6.2m..6.5m --spp 8
cornell-box --estimator lcs --spp 16
cornell-box --estimator lcs --gate 6.2m..6.5m --spp 16
cornell-box --estimator lcs --gate 6.2m..6.5m --sampling uniform --crop 8,40,16,32 --spp 16
cornell-box --estimator lcs --gate 6.3m..6.301m --spp 8
cornell-box --estimator lcs --gates 5m..8m/8 --spp 8
cornell-box --estimator lcs --gates 6m..6.2m/4 --spp 8
cornell-box --estimator epc --gate 6.3m..6.31m --spp 4
cornell-box --estimator bdpt --visibility 20m --gate 6.2m..6.5m --spp 8
cornell-box --estimator bdpt --sky 0.5 --ortho 2.5 --spp 8
zoo-area --estimator pt --spp 16
zoo-area --estimator bdpt --gate 7.4m..7.8m --spp 16
zoo-area --estimator lcs-paper --gate 7.4m..7.8m --spp 16
zoo-area --estimator lcs --gate 7.4m..7.8m --spp 16
zoo-area --estimator lcs --gate 7.4m..7.8m --sampling uniform --single-tree=false --queries 4 --spp 8
zoo-area --estimator lcs --strategies paper --importance none --frontier 1 --gate 7m..9m --spp 8
zoo-punctual --estimator pt --gate 5m..8m --spp 16
zoo-punctual --estimator bdpt --spp 16 --no-cull
zoo-punctual --estimator bdpt --emitters spot --gate 5m..8m --sampling uniform --spp 8
zoo-punctual --estimator lcs-paper --emitters point --gate 5m..8m --spp 8
zoo-punctual --estimator lcs --emitters spot --gate 7.9m..8.1m --spp 16
zoo-punctual --estimator lcs --spp 16
zoo-punctual --estimator lcs --sigma-s 0.1 --sigma-a 0.02 --phase-g 0.5 --gate 7.9m..8.1m --spp 8
zoo-beam --estimator bdpt --gate 7m..8m --spp 16
zoo-beam --estimator lcs-paper --gate 7m..8m --spp 16
zoo-beam --estimator lcs --gate 7.5m..7.6m --splat-paths 5000 --spp 16
door-ajar --estimator bdpt --gate 16.8m..17.1m --spp 16
door-ajar --estimator lcs --gate 16.8m..17.1m --spp 16 --light-paths 20000
door-ajar --estimator lcs-paper --gate 16.8m..17.1m --queries 4 --leaf-size 4 --buckets 4 --spp 8
layers --estimator lcs --gate 19m..21m --spp 8
sun_and_orthographic --estimator pt --spp 16
LIST
)

differ=0
count=0
while read -r scene flags; do
    [[ "$scene $flags" =~ $pattern ]] || continue
    count=$((count + 1))
    # The shell must split the flags into words.
    # shellcheck disable=SC2086
    for side in old new; do
        binary=${!side}
        "$binary" render "$scene.glb" -o "$side.exr" --resolution 48x40 --max-depth 12 --seed 7 --quiet $flags </dev/null ||
            { echo "the $side binary cannot render $scene $flags" >&2; exit 3; }
    done
    if python3 "$here/exr_pixels.py" old.exr new.exr; then
        echo "same    $scene $flags"
    else
        echo "DIFFER  $scene $flags"
        differ=$((differ + 1))
    fi
done <<<"$images"
[ "$count" -gt 0 ] || { echo "no image matches '$pattern'" >&2; exit 2; }
echo "$((count - differ)) of $count images have the same bits"
[ "$differ" -eq 0 ]
