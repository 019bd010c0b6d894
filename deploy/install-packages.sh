#!/bin/bash
# Installs the packages of the named groups of packages.txt that are missing, and says which. Asks nothing; when nothing
# is missing it touches neither the package manager nor the network.
# usage: deploy/install-packages.sh GROUP...     (as root, or as a user with sudo)
set -euo pipefail

list="$(dirname "$(readlink -f "$0")")/packages.txt"

is_installed() {
    [[ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" == installed ]]
}

if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
    echo "packages: no apt-get here, this is not Debian; what is needed stands in $list" >&2
    exit 0 # the build says what it cannot find
fi

missing=()
for group in "$@"; do
    while read -r of package; do
        if [[ "$of" == "$group" ]] && ! is_installed "$package"; then
            missing+=("$package")
        fi
    done <"$list"
done
if ((${#missing[@]} == 0)); then
    exit 0
fi

as_root=()
if (($(id -u) != 0)); then
    if ! command -v sudo >/dev/null; then
        echo "packages: missing, and neither root nor sudo to install them; as root: apt-get install ${missing[*]}" >&2
        exit 1
    fi
    as_root=(sudo)
fi
echo "packages: installing ${missing[*]}"
apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 -qq)
"${apt[@]}" update || echo "packages: some lists could not be fetched; going on with those at hand" >&2
"${apt[@]}" install --yes --no-install-recommends "${missing[@]}" </dev/null
