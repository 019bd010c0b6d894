#!/bin/bash
# Makes the pictures of README.md by the program itself: docs/pictures/make.sh [FOLDER OF THE PROGRAMS]
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"

picture() { # NAME SKY [more flags]
    local name=$1 sky=$2
    shift 2
    "$bin/relight-render" --source "sky:$sky" --samples 256 --size 640x360 --quality 90 --out "$here/$name.jpg" "$@"
}

picture morning time=06:40 --eye-paths 128
picture noon time=11:30 --eye-paths 128
picture evening time=18:50 --eye-paths 128

# Gathered light: traced from the sky, and by eye paths alone, twice as many, in about the same time.
ring=(--scene "$here/../examples/ring.json")
picture caustics time=08:30 "${ring[@]}" --eye-paths 96 --particles 12000000
picture caustics-from-the-eye time=08:30 "${ring[@]}" --caustics eye --eye-paths 192
