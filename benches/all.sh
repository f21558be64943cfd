#!/bin/sh
# All suites after each other: references, then races, each suite into a folder of its own under bench-all.
#
#     cargo build --release
#     benches/all.sh [DIVISOR [REPETITIONS [SUITE...]]]
#
# Every suite gets its own time divided by DIVISOR (1: some seven hours on two cores and references beside that; 20: some forty
# minutes in all), every reference ten times that, and the suite's own number of repetitions unless told another. What is finished
# is kept: after an interrupt the same command goes on. Suites share references where scene, gate and size are the same.
set -u
divisor=${1:-1}
[ $# -gt 0 ] && shift
repetitions=${1:-3}
[ $# -gt 0 ] && shift
root=$(dirname "$0")/..
taugate=${TAUGATE:-$root/target/release/taugate}
code=0
for suite in ${*:-quick fig6 fig4 table1 city fig7 ablation scaling}; do
    file=$root/benches/suites/$suite.toml
    time=$(awk -F'"' -v by="$divisor" '/^time/ { printf "%.3g", $2 / by; exit }' "$file")
    out=bench-all/$suite
    if ! grep -q '^errors = false' "$file" && [ ! -e "$out/report.md" ]; then
        longest=$(awk -v time="$time" 'BEGIN { printf "%.3g", 10 * time }')
        "$taugate" bench "$file" --time "${time}s" --out "$out" --reference --reference-time "${longest}s"
        last=$?
        [ $last -eq 130 ] && exit 130
        [ $last -ne 0 ] && code=1
    fi
    "$taugate" bench "$file" --time "${time}s" --repetitions "$repetitions" --out "$out" --resume
    last=$?
    [ $last -eq 130 ] && exit 130
    [ $last -ne 0 ] && code=1
done
exit $code
