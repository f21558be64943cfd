#!/bin/sh
# Installs the packages that a fresh Debian machine needs to run taugate without a GPU: the Vulkan loader, and Mesa's drivers with
# lavapipe, which renders on the CPU. Does nothing if a loader and lavapipe are installed. It is safe to run this script again.
set -eu

say() { echo "setup: $*"; }

has_loader() {
    for dir in /usr/lib /usr/lib64 /usr/local/lib /usr/lib/*-linux-gnu*; do
        [ -e "$dir/libvulkan.so.1" ] && return 0
    done
    return 1
}

has_driver() {
    # A driver that the environment names counts as installed. Of the others, only lavapipe: the driver of a graphics card may be
    # listed although there is no card, or although the driver cannot be loaded.
    [ -z "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] || return 0
    for file in /usr/share/vulkan/icd.d/lvp_icd*.json /etc/vulkan/icd.d/lvp_icd*.json \
        /usr/local/share/vulkan/icd.d/lvp_icd*.json; do
        [ -e "$file" ] && return 0
    done
    return 1
}

# Whether any driver is listed. It may not work.
has_some_driver() {
    for file in /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json /usr/local/share/vulkan/icd.d/*.json; do
        [ -e "$file" ] && return 0
    done
    return 1
}

missing=
has_loader || missing="libvulkan1"
has_driver || missing="$missing mesa-vulkan-drivers"
if [ -z "$missing" ]; then
    say "a Vulkan loader and the driver lavapipe are installed; nothing to do"
    exit 0
fi
missing=$(echo $missing) # remove a leading space

if ! command -v apt-get >/dev/null 2>&1; then
    if has_loader && has_some_driver; then
        say "a Vulkan loader and a driver are installed, but not lavapipe, which renders without a graphics card"
        exit 0
    fi
    say "this machine has no apt-get; install the Vulkan loader (libvulkan.so.1) and a Vulkan driver, such as Mesa's" >&2
    say "lavapipe, with the package manager of this machine" >&2
    exit 1
fi

if [ "$(id -u)" -eq 0 ]; then
    as_root=
elif command -v sudo >/dev/null 2>&1; then
    as_root=sudo
else
    say "missing: $missing; run this as root: apt-get install $missing" >&2
    # The driver of a graphics card may be enough.
    has_loader && has_some_driver
    exit
fi
export DEBIAN_FRONTEND=noninteractive

suite=bookworm-backports
list=/etc/apt/sources.list.d/taugate-backports.sources

is_bookworm() {
    [ -r /etc/os-release ] && (. /etc/os-release && [ "${ID:-}" = debian ] && [ "${VERSION_ID:-}" = 12 ])
}

has_backports() { apt-cache policy 2>/dev/null | grep -q "n=$suite"; }

# Prints the mirror from which this machine gets Debian 12.
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
        # Update only this suite, so that errors of other suites do not matter here. apt succeeds with a warning if the mirror
        # does not have the suite, so the script tests the result.
        $as_root apt-get update -o Dir::Etc::sourcelist="$list" -o Dir::Etc::sourceparts=- \
            -o APT::Get::List-Cleanup=0 || true
        if ! has_backports; then
            say "the mirror does not have $suite; using the driver of Debian 12"
            $as_root rm -f "$list"
        fi
    fi
fi

say "updating the package lists"
$as_root apt-get update || say "some package lists could not be updated; continuing with the existing lists"

from=
if is_bookworm && has_backports; then
    from="-t $suite"
    say "installing $missing from $suite"
else
    say "installing $missing"
fi
# $from and $missing are unquoted, because the shell must split them into words.
# shellcheck disable=SC2086
if ! $as_root apt-get install -y --no-install-recommends $from $missing; then
    [ -n "$from" ] || { say "the packages could not be installed" >&2; exit 1; }
    say "$suite failed; installing the packages of Debian 12"
    # shellcheck disable=SC2086
    $as_root apt-get install -y --no-install-recommends $missing
fi
say "done"
