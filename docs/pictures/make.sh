#!/bin/bash
# Renders the images of README.md and of docs/noise.md: docs/pictures/make.sh [FOLDER OF THE PROGRAMS]
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"

picture() { # NAME SKY [more flags]
    local name=$1 sky=$2
    shift 2
    "$bin/relight-render" --source "sky:$sky" --samples 256 --size 640x360 --quality 90 --out "$here/$name.jpg" "$@"
}

parts="$(mktemp -d)"
trap 'rm -rf "$parts"' EXIT

# A day of clouds over the house: 20 captured skies of a made-up camera, and the images between them.
python3 "$here/../examples/house.py" "$parts"
python3 "$here/../examples/timelapse.py" "$parts/skies" --count 20 --step 1500 --time 09:00:00 --width 1024 --cover 0.35
"$bin/relight-render" --method cached --scene "$parts/house.glb" --source "$parts/skies" --hold 5 --exposure follow --size 640x360 \
    --out "$parts/day.%03d.png"
# Keyframes only (Debian's package webp; -kmax 1): coded as differences, blocks that change slowly would never be updated.
img2webp -loop 0 -kmax 1 -lossy -q 72 -m 6 -d 83 "$parts"/day.*.png -o "$here/day.webp"

# Three images of a film of 240 of the court at noon, 15 s of sky each, four times as large.
"$bin/relight-render" --method cached --source sky:hour=12,speed=0.25 --frames 0-239 --exposure 0 --size 640x360 \
    --out "$parts/film.%03d.png"
for frame in 000 120 239; do
    ffmpeg -v error -i "$parts/film.$frame.png" -vf 'crop=150:110:90:150,scale=600:440:flags=neighbor' "$parts/part.$frame.png"
done
ffmpeg -v error -y -i "$parts/part.000.png" -i "$parts/part.120.png" -i "$parts/part.239.png" -filter_complex hstack=3 -q:v 4 \
    "$here/film.jpg"

# A day of sun in the court (docs/probe.md).
"$bin/relight-render" --sun-hours "$here/sun-hours.png" --source sky: --size 640x360

# The house, as README renders it.
"$bin/relight-render" --scene "$parts/house.glb" --source sky:date=05-10,time=10:00,latitude=48 --denoise --size 1280x720 \
    --samples 64 --eye-paths 48 --particles 16000000 --quality 90 --out "$here/house.jpg"

python3 "$here/../examples/product.py" "$parts"
"$bin/relight-render" --scene "$parts/house.glb" --source sky:date=05-10,time=10:00,latitude=48 --denoise --size 1280x720 \
    --camera '@8.4,1.3,-8.2;6.4,2.35,-4.3;46' --samples 128 --eye-paths 24 --quality 85 --out "$here/leaves.jpg"
"$bin/relight-render" --scene "$parts/product.json" --source "$parts/studio.hdr" --exposure -0.5 --denoise --size 1280x720 \
    --samples 128 --eye-paths 32 --particles 16000000 --quality 90 --out "$here/product.jpg"

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
