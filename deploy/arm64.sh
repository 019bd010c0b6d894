#!/bin/bash
# Makes the Debian package for arm64 on amd64, in a clean Debian 12 that it sets up in a folder (about 3 GB; kept for the next time).
# The same commit gives the same package, byte for byte. Needs root and debootstrap (deploy/install-packages.sh --unpack).
# usage: deploy/arm64.sh FOLDER [PROGRAM_OF_DEBOOTSTRAP]   -> FOLDER/relightd_VERSION_arm64.deb
set -euo pipefail
here="$(dirname "$(dirname "$(readlink -f "$0")")")"
mkdir -p "${1:?a folder}"
folder="$(readlink -f "$1")"
debootstrap="${2:-debootstrap}"
system="$folder/system"
date="$(git -C "$here" log -1 --format=%ct)"

within() {
    env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive ${http_proxy:+http_proxy=$http_proxy} \
        SOURCE_DATE_EPOCH="$date" chroot "$system" "$@"
}

if [[ ! -e "$system/.made" ]]; then
    mirror="$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 'Codename: bookworm' | head -n 1)"
    rm -rf "$system"
    "$debootstrap" --variant=minbase bookworm "$system" "$mirror"
    cp /etc/resolv.conf "$system/etc/resolv.conf"
    within dpkg --add-architecture arm64
    within apt-get -qq update
    # Libraries for arm64; compilers and tools are this machine's.
    mapfile -t libraries < <(sed -nE 's/^(build|h264|video) (lib[^ ]*-dev)$/\2:arm64/p' "$here/deploy/packages.txt" | sort -u)
    within apt-get -qq --yes --no-install-recommends install binutils dpkg-dev gcc-aarch64-linux-gnu g++-aarch64-linux-gnu \
        cmake file ninja-build pkg-config qemu-user "${libraries[@]}"
    touch "$system/.made"
fi

rm -rf "$system/source" "$system/build"
mkdir "$system/source"
git -C "$here" archive HEAD | tar -x -C "$system/source"
within cmake -S /source -B /build -G Ninja -DCMAKE_TOOLCHAIN_FILE=/source/deploy/arm64.cmake -DCMAKE_BUILD_TYPE=Release -Wno-dev
within ninja -C /build programs
within sh -c 'cd /build && cpack -G DEB -B /build/packed'
cp "$system"/build/packed/relightd_*_arm64.deb "$folder/"
ls -l "$folder"/relightd_*_arm64.deb
