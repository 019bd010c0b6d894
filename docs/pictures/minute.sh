#!/bin/bash
# What a viewer of relightd has at 1, 3, 10 and 60 s from its start on, without a cache on disk: scenes with mirrors, glass and leaves,
# in one image, docs/pictures/minute.jpg. On an idle machine: docs/pictures/minute.sh [FOLDER OF THE PROGRAMS]
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"
work="$(mktemp -d)"
server=
watcher=
count=0
stop() {
    kill $watcher $server 2>/dev/null || true
    wait
}
trap 'stop; rm -rf "$work"' EXIT
for scene in house product room; do
    /usr/bin/python3 "$here/../examples/$scene.py" "$work"
done
cp "$here"/../examples/ring.json "$here"/../examples/*.obj "$work"

minute() { # NAME FILE
    local start url shot
    start="$(date +%s%N)"
    "$bin/relightd" --port 0 --cache-dir off --source sky:hour=12,speed=0.25 --scene "$work/$2" 2>"$work/log" &
    server=$!
    until url="$(grep -om1 'http://[0-9.:]*' "$work/log")"; do sleep 0.02; done
    { while :; do curl -sN "$url/stream.mjpeg" >/dev/null; sleep 0.1; done; } 2>/dev/null &
    watcher=$!
    for at in 1 3 10 60; do
        until (($(date +%s%N) >= start + at * 1000000000)); do sleep 0.01; done
        shot="$(printf '%s/shot.%02d.jpg' "$work" "$count")"
        curl -sf "$url/snapshot.jpg" -o "$shot" || # no image yet
            ffmpeg -v error -f lavfi -i color=black:s=640x360 -frames:v 1 "$shot"
        count=$((count + 1))
    done
    stop
}
minute house house.glb
minute product product.json
minute room room.glb
minute ring ring.json
ffmpeg -v error -y -i "$work/shot.%02d.jpg" -vf scale=480:270,tile=4x4:padding=4:color=white -q:v 4 -frames:v 1 "$here/minute.jpg"
