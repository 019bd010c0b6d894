#!/bin/bash
# Installs the missing packages of the named groups of packages.txt and lists them. Non-interactive; if nothing is missing it uses neither
# the package manager nor the network.
# usage: deploy/install-packages.sh GROUP...                  (as root, or as a user with sudo)
#        deploy/install-packages.sh --unpack DIR GROUP...     (as any user)
# --unpack downloads and unpacks them into DIR without installing: for tests that need programs of a package whose installation would start
# a service. Packages already in DIR are not downloaded again.
set -euo pipefail
unpack=
if [[ "${1:-}" == --unpack ]]; then
    unpack="$2"
    shift 2
fi

list="$(dirname "$(readlink -f "$0")")/packages.txt"

is_installed() {
    [[ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" == installed ]]
}

is_there() {
    if [[ -n "$unpack" ]]; then [[ -e "$unpack/.$1" ]]; else is_installed "$1"; fi
}

if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
    echo "packages: no apt-get here, so this is not Debian; $list lists the required packages" >&2
    exit 0 # the build reports what is missing
fi

missing=()
for group in "$@"; do
    while read -r of package; do
        if [[ "$of" == "$group" ]] && ! is_there "$package"; then
            missing+=("$package")
        fi
    done <"$list"
done
if ((${#missing[@]} == 0)); then
    exit 0
fi

if [[ -n "$unpack" ]]; then
    echo "packages: unpacking ${missing[*]} into $unpack"
    mkdir -p "$unpack"
    into="$(cd "$unpack" && pwd)"
    fetched="$(mktemp -d)"
    trap 'rm -rf "$fetched"' EXIT
    chmod 755 "$fetched"
    (cd "$fetched" && apt-get -qq -o APT::Sandbox::User=root download "${missing[@]}")
    for deb in "$fetched"/*.deb; do
        dpkg-deb -x "$deb" "$into"
    done
    (cd "$into" && touch "${missing[@]/#/.}")
    exit 0
fi

as_root=()
if (($(id -u) != 0)); then
    if ! command -v sudo >/dev/null; then
        echo "packages: missing, and neither root nor sudo is available; run as root: apt-get install ${missing[*]}" >&2
        exit 1
    fi
    as_root=(sudo)
fi
echo "packages: installing ${missing[*]}"
apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 -qq)
"${apt[@]}" update || echo "packages: some package lists could not be downloaded; continuing with the existing ones" >&2
"${apt[@]}" install --yes --no-install-recommends "${missing[@]}" </dev/null
