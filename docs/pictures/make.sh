#!/bin/bash
# Renders the images of README.md: docs/pictures/make.sh [FOLDER OF THE PROGRAMS]
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

# The denoiser.
for name in noisy denoised; do
    flags=()
    [ $name = noisy ] || flags=(--denoise)
    "$bin/relight-render" --source sky:time=10:00 --samples 8 --size 640x360 --quality 90 --out "$here/$name.jpg" \
        "${flags[@]}"
done

# Caustics: with the light tracer, and with eye paths alone, twice as many, in about the same time.
ring=(--scene "$here/../examples/ring.json")
picture caustics time=08:30 "${ring[@]}" --eye-paths 96 --particles 12000000
picture caustics-from-the-eye time=08:30 "${ring[@]}" --caustics eye --eye-paths 192

# Path tracing, Metropolis sampling and auto with the light tracer, left to right, under a sun of 1000 times the sky's mean
# [DH09, Fig. 5], in equal time: 20 s on one core.
parts="$(mktemp -d)"
trap 'rm -rf "$parts"' EXIT
panel() { # NAME flags
    local name=$1
    shift
    "$bin/relight-render" "${ring[@]}" --source sky:sun_ratio=1000 --size 640x480 --quality 90 \
        --out "$parts/$name.jpg" "$@"
}
panel 1 --method path --samples 32
panel 2 --method mlt --samples 24
panel 3 --samples 64 --caustics light --eye-paths 12 --particles 10000000
# Crops the ring with ImageMagick.
montage "$parts/1.jpg" "$parts/2.jpg" "$parts/3.jpg" -crop 400x280+5+125 +repage \
    -tile 3x1 -geometry +4+0 -quality 88 "$here/equal-time.jpg"
