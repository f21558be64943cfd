#!/usr/bin/env bash
# Renders scenes in turns with two binaries and prints the ratio of their times:
#
#     benches/ab.sh OLD_BINARY NEW_BINARY SCENE...
#
# Every estimator renders each scene without a gate and with a gate at the median arrival time, ROUNDS times (default 7) after one
# round that does not count. The ratio is render_seconds of NEW / OLD in the same round: below 1, NEW is faster. The table shows its
# median, minimum and maximum. Environment variables: ROUNDS, RESOLUTION (160x120), SPP (16), ESTIMATORS, GATE. Needs python3.
set -euo pipefail

[ $# -ge 3 ] && [ -x "$1" ] && [ -x "$2" ] || { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
old=$(realpath "$1")
new=$(realpath "$2")
shift 2
rounds=${ROUNDS:-7}
resolution=${RESOLUTION:-160x120}
spp=${SPP:-16}
estimators=${ESTIMATORS:-pt bdpt epc lcs-paper lcs}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

gate_of() { # The gate that `info` proposes, as A..B.
    "$old" info "$1" 2>/dev/null | sed -n 's/^try  *--gate \([^ ]*\).*/\1/p' | head -n 1
}

seconds() { # render_seconds of one render; empty if the binary cannot render the scene.
    local binary=$1
    shift
    "$binary" render "$@" -o "$folder/out.exr" --stats "$folder/out.json" --resolution "$resolution" --spp "$spp" --quiet \
        </dev/null >/dev/null 2>&1 || return 0
    python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["render_seconds"])' "$folder/out.json"
}

printf '%-28s %-10s %-22s %8s %8s   %s\n' scene estimator gate "old s" "new s" "new / old, median (min to max)"
for scene in "$@"; do
    gates=("")
    gate=${GATE:-$(gate_of "$scene")}
    [ -z "$gate" ] || gates+=("$gate")
    for gate in "${gates[@]}"; do
        for estimator in $estimators; do
            flags=(--estimator "$estimator")
            [ -z "$gate" ] || flags+=(--gate "$gate")
            : >"$folder/times"
            for round in $(seq 0 "$rounds"); do
                # Alternate the order, so that neither binary always runs second.
                if [ $((round % 2)) = 0 ]; then
                    a=$(seconds "$old" "$scene" "${flags[@]}")
                    b=$(seconds "$new" "$scene" "${flags[@]}")
                else
                    b=$(seconds "$new" "$scene" "${flags[@]}")
                    a=$(seconds "$old" "$scene" "${flags[@]}")
                fi
                if [ "$round" -gt 0 ] && [ -n "$a" ] && [ -n "$b" ]; then
                    echo "$a $b" >>"$folder/times"
                fi
            done
            printf '%-28s %-10s %-22s ' "$(basename "$scene")" "$estimator" "${gate:-steady}"
            python3 - "$folder/times" <<'EOP'
import statistics
import sys

pairs = [tuple(map(float, line.split())) for line in open(sys.argv[1])]
if not pairs:
    print("one of the binaries cannot render this scene")
    sys.exit()
ratios = [b / a for a, b in pairs]
old, new = (statistics.median(side) for side in zip(*pairs))
print(f"{old:8.3f} {new:8.3f}   {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f})")
EOP
        done
    done
done
