#!/bin/sh
# All suites after each other: references, then races, each suite into a folder of its own under bench-all.
#
#     cargo build --release
#     benches/all.sh [DIVISOR [REPETITIONS [SUITE...]]]
#
# Every suite gets its own time divided by DIVISOR. With 1 and three repetitions the races alone take some six hours, and references
# as long again and more; they take up to forty times a suite's time each (twenty is what they need to be good enough), but suites
# share them where scene, gate and size are the same. What is finished is kept: after an interrupt the same command goes on.
set -u
divisor=${1:-1}
[ $# -gt 0 ] && shift
repetitions=${1:-3}
[ $# -gt 0 ] && shift
root=$(dirname "$0")/..
taugate=${TAUGATE:-$root/target/release/taugate}
code=0
for suite in ${*:-quick fig6 fig4 table1 city fig7 no-gate lamps ablation scaling}; do
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
