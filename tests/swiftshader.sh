#!/bin/sh
# Runs the tests on SwiftShader, a second Vulkan driver beside Mesa's: other rounding, other limits, another compiler.
# Debian's package chromium-common and Google Chrome ship it; SWIFTSHADER_ICD names its vk_swiftshader_icd.json elsewhere.
# Usage: tests/swiftshader.sh [ARGUMENTS OF CARGO TEST], from the root of the repository. It is slow: name a --test.
set -eu

if [ -n "${SWIFTSHADER_ICD:-}" ]; then
    [ -r "$SWIFTSHADER_ICD" ] || { echo "SWIFTSHADER_ICD names $SWIFTSHADER_ICD, which cannot be read" >&2; exit 1; }
    icd=$SWIFTSHADER_ICD
else
    icd=
    for file in /usr/lib/chromium /opt/google/chrome /usr/share/vulkan/icd.d /etc/vulkan/icd.d; do
        [ -z "$icd" ] && [ -r "$file/vk_swiftshader_icd.json" ] && icd=$file/vk_swiftshader_icd.json
    done
fi
if [ -z "$icd" ]; then
    echo "skipped: no SwiftShader; install chromium-common, or set SWIFTSHADER_ICD to its vk_swiftshader_icd.json"
    exit 0
fi
echo "driver: $icd"
VK_DRIVER_FILES=$icd VK_ICD_FILENAMES=$icd exec cargo test --release "$@"
