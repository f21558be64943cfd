#!/bin/sh
# Runs the tests on SwiftShader, a Vulkan driver with other rounding, other limits and another compiler than Mesa's lavapipe.
# Debian's package chromium-common and Google Chrome contain SwiftShader. If its vk_swiftshader_icd.json is in another place,
# set SWIFTSHADER_ICD to the path of this file.
# Usage, from the root of the repository: tests/swiftshader.sh [ARGUMENTS OF CARGO TEST]
# All tests together are slow on SwiftShader: choose some with --test NAME.
set -eu

if [ -n "${SWIFTSHADER_ICD:-}" ]; then
    [ -r "$SWIFTSHADER_ICD" ] || { echo "SWIFTSHADER_ICD is $SWIFTSHADER_ICD, which cannot be read; set it to the path of vk_swiftshader_icd.json" >&2; exit 1; }
    icd=$SWIFTSHADER_ICD
else
    icd=
    for file in /usr/lib/chromium /opt/google/chrome /usr/share/vulkan/icd.d /etc/vulkan/icd.d; do
        [ -z "$icd" ] && [ -r "$file/vk_swiftshader_icd.json" ] && icd=$file/vk_swiftshader_icd.json
    done
fi
if [ -z "$icd" ]; then
    echo "skipped: SwiftShader was not found; install chromium-common, or set SWIFTSHADER_ICD to the path of vk_swiftshader_icd.json"
    exit 0
fi
echo "driver: $icd"
VK_DRIVER_FILES=$icd VK_ICD_FILENAMES=$icd exec cargo test --release "$@"
