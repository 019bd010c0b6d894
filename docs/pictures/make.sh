#!/bin/bash
# Makes the pictures of README.md by the program itself: docs/pictures/make.sh [FOLDER OF THE PROGRAMS]
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"

picture() {
    "$bin/relight-render" --source "sky:$2" --samples 256 --size 640x360 --quality 90 --out "$here/$1.jpg"
}

picture morning time=06:40
picture noon time=11:30
picture evening time=18:50
