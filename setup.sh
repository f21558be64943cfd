#!/bin/sh
# Installs what a fresh Debian machine lacks to run taugate without a GPU: the Vulkan loader and Mesa's drivers, among
# them lavapipe, which renders on the CPU. Does nothing where a loader and a driver are there. Safe to run again.
set -eu

say() { echo "setup: $*"; }

has_loader() {
    for dir in /usr/lib /usr/lib64 /usr/local/lib /usr/lib/*-linux-gnu*; do
        [ -e "$dir/libvulkan.so.1" ] && return 0
    done
    return 1
}

has_driver() {
    # A driver named in the environment is a choice that was made already.
    [ -z "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] || return 0
    for file in /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json /usr/local/share/vulkan/icd.d/*.json; do
        [ -e "$file" ] && return 0
    done
    return 1
}

missing=
has_loader || missing="libvulkan1"
has_driver || missing="$missing mesa-vulkan-drivers"
if [ -z "$missing" ]; then
    say "a Vulkan loader and driver are installed; nothing to do"
    exit 0
fi
missing=$(echo $missing) # without leading space

if ! command -v apt-get >/dev/null 2>&1; then
    say "this machine has no apt-get; install the Vulkan loader (libvulkan.so.1) and a Vulkan driver by hand," >&2
    say "such as Mesa's lavapipe, and run this again" >&2
    exit 1
fi

if [ "$(id -u)" -eq 0 ]; then
    as_root=
elif command -v sudo >/dev/null 2>&1; then
    as_root=sudo
else
    say "missing: $missing; run this as root: apt-get install $missing" >&2
    exit 1
fi
export DEBIAN_FRONTEND=noninteractive

suite=bookworm-backports
list=/etc/apt/sources.list.d/taugate-backports.sources

is_bookworm() {
    [ -r /etc/os-release ] && (. /etc/os-release && [ "${ID:-}" = debian ] && [ "${VERSION_ID:-}" = 12 ])
}

has_backports() { apt-cache policy 2>/dev/null | grep -q "n=$suite"; }

# The mirror that this machine already takes Debian 12 from.
debian_uri() {
    for file in /etc/apt/sources.list.d/*.sources; do
        [ -r "$file" ] || continue
        awk '/^URIs:/ { uri = $2 } /^Suites:/ { for (i = 2; i <= NF; i++) if ($i == "bookworm") found = 1 }
             /^[ \t]*$/ { if (found && uri) exit; uri = ""; found = 0 }
             END { if (found && uri) print uri }' "$file"
    done
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
        [ -r "$file" ] || continue
        sed 's/\[[^]]*\]//' "$file" | awk '$1 == "deb" && $3 == "bookworm" { print $2 }'
    done
}

say "missing: $missing"
if is_bookworm && ! has_backports && [ ! -e "$list" ]; then
    uri=$(debian_uri | head -n 1)
    if [ -n "$uri" ]; then
        say "adding the suite $suite of $uri, whose driver is up to twice as fast"
        printf 'Types: deb\nURIs: %s\nSuites: %s\nComponents: main\nSigned-By: %s\n' \
            "$uri" "$suite" /usr/share/keyrings/debian-archive-keyring.gpg | $as_root tee "$list" >/dev/null
        # Only this suite, so that trouble elsewhere is not blamed on it. apt reports a suite that does not answer as a
        # warning and succeeds, so look at what came of it.
        $as_root apt-get update -o Dir::Etc::sourcelist="$list" -o Dir::Etc::sourceparts=- \
            -o APT::Get::List-Cleanup=0 || true
        if ! has_backports; then
            say "$suite cannot be had from there; taking the stock driver"
            $as_root rm -f "$list"
        fi
    fi
fi

say "updating the package lists"
$as_root apt-get update || say "not all package lists could be updated; going on with those there are"

from=
if is_bookworm && has_backports; then
    from="-t $suite"
    say "installing $missing from $suite"
else
    say "installing $missing"
fi
# The list and the option are meant to be split into words.
# shellcheck disable=SC2086
if ! $as_root apt-get install -y --no-install-recommends $from $missing; then
    [ -n "$from" ] || { say "the packages could not be installed" >&2; exit 1; }
    say "that failed; taking the stock packages"
    # shellcheck disable=SC2086
    $as_root apt-get install -y --no-install-recommends $missing
fi
say "done"
