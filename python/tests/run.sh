#!/usr/bin/env bash
# Builds the wheel, installs it into a new virtual environment, and runs the tests: those of the module, and those of the page of the
# viewer. Arguments are those of pytest. Without Python, its module venv, or packages from the network, it prints a note and does
# nothing. TAUGATE_PIP names further packages to install.
set -euo pipefail
cd "$(dirname "$0")/../.."
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$PWD/target}" TAUGATE_PROGRAM="${TAUGATE_PROGRAM:-$PWD/target/release/taugate}"
environment="$CARGO_TARGET_DIR/python-tests"
rm -rf "$environment"
if ! python3 -m venv "$environment" || ! "$environment/bin/pip" download --quiet --no-deps --dest "$environment" maturin; then
    echo "Python, its module venv or PyPI are not there; the tests of the Python module and of the page of the viewer are skipped" >&2
    exit 0
fi
# With the profile of the program, whose crates are built already.
export MATURIN_PEP517_ARGS="${MATURIN_PEP517_ARGS:---profile release}"
"$environment/bin/pip" install --quiet "./python[test]" ${TAUGATE_PIP:-}
cd python
exec "$environment/bin/pytest" -q -rs -p no:cacheprovider "$@"
