#!/bin/sh
# Runs all suites, one after the other. Each suite first renders its references, then its variants. Its results are in a folder
# of its own in bench-all.
#
#     cargo build --release
#     benches/all.sh [DIVISOR [REPETITIONS [SUITE...]]]
#
# The rendering time of every suite is divided by DIVISOR. With DIVISOR 1 and three repetitions, the variants take about six hours,
# and the references at least as long. A reference takes up to 40 times the time of its suite (about 20 times is enough to be
# accurate). Suites share references with the same scene, gate and size. After an interrupt, the same command continues with the
# unfinished parts.
set -u
divisor=${1:-1}
[ $# -gt 0 ] && shift
repetitions=${1:-3}
[ $# -gt 0 ] && shift
root=$(dirname "$0")/..
taugate=${TAUGATE:-$root/target/release/taugate}
code=0
for suite in ${*:-quick fig1 fig6 fig4 table1 fig7 fig8 fig9 no-gate lamps thin-gates ablation scaling}; do
    file=$root/benches/suites/$suite.toml
    time=$(awk -F'"' -v by="$divisor" '/^time/ { printf "%.3g", $2 / by; exit }' "$file")
    out=bench-all/$suite
    if ! grep -q '^errors = false' "$file"; then
        "$taugate" bench "$file" --time "${time}s" --out "$out" --reference
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
