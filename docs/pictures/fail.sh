#!/bin/bash
# Renders the images of docs/internals/where-methods-fail.md: docs/pictures/fail.sh [FOLDER OF THE PROGRAMS]
# Pairs use the same number of samples; seeds are fixed.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cp "$here"/../examples/*.obj "$work"

picture() { # NAME [flags]
    local name=$1
    shift
    "$bin/relight-render" --size 320x180 --quality 85 --seed 3 --out "$here/fail-$name.jpg" "$@"
    local bytes
    bytes="$(stat -c %s "$here/fail-$name.jpg")"
    ((bytes <= 40960)) || { echo "fail-$name.jpg: $bytes bytes, at most 40960" >&2 && exit 1; }
}

pair() { # NAME 'flags of what fails' 'flags of what does not' [flags of both]
    local name=$1 bad good
    read -ra bad <<<"$2"
    read -ra good <<<"$3"
    shift 3
    picture "$name" "${bad[@]}" "$@"
    picture "$name-auto" "${good[@]}" "$@"
}

scene() { # NAME 'camera position' 'look at' 'models' 'materials'
    cat >"$work/$1.json" <<TEXT
{"camera": {"position": [$2], "look_at": [$3], "up": [0, 1, 0], "fov_y_degrees": 32},
 "models": [$4],
 "materials": {"top": {"type": "lambert", "albedo": [0.62, 0.6, 0.57]},
  "card": {"type": "lambert", "albedo": [0.5, 0.54, 0.6]}, "glass": {"type": "mirror", "reflectance": [0.9, 0.9, 0.9]},
  $5}}
TEXT
}

# Skies as Radiance files: uniform cloud, and with suns: high, below the horizon, clipped by a half float.
/usr/bin/python3 - "$work" <<'TEXT'
import math, struct, sys
def rgbe(r, g, b):
    m = max(r, g, b)
    if m < 1e-32:
        return b"\0\0\0\0"
    f, e = math.frexp(m)
    s = f * 256.0 / m
    return bytes((int(r * s), int(g * s), int(b * s), e + 128))
def sky(path, width, height, sun, place=0.28):
    with open(path, "wb") as out:
        out.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width))
        for y in range(height):
            up = math.cos(math.pi * (y + 0.5) / height)
            l = (1.0 + 2.0 * up) / 3.0 if up > 0.0 else 0.1
            for x in range(width):
                # A sun of half a degree in the south-east, 40 degrees high.
                lit = sun if abs(x - 0.68 * width) < 0.75 and abs(y - place * height) < 0.75 else 0.0
                out.write(rgbe(0.95 * l + lit, l + 0.9 * lit, 1.05 * l + 0.75 * lit))
sky(sys.argv[1] + "/cloud.hdr", 512, 256, 0.0)
sky(sys.argv[1] + "/sun.hdr", 512, 256, 5e4)
sky(sys.argv[1] + "/down.hdr", 512, 256, 1e6, 0.515)
sky(sys.argv[1] + "/whole.hdr", 512, 256, 4e5)
sky(sys.argv[1] + "/clipped.hdr", 512, 256, 65504.0)
TEXT

cat >"$work/mirror.obj" <<'TEXT'
o plate
usemtl glass
v -1.7 0 -1.1
v 1.9 0 -1.1
v 1.9 1.5 -1.1
v -1.7 1.5 -1.1
f 1 2 3 4
o top
usemtl top
v -3 0 3
v 3 0 3
v 3 0 -3
v -3 0 -3
f 5 6 7 8
TEXT
cat >"$work/plain.obj" <<'TEXT'
o plain
usemtl top
v -3000 -0.001 3000
v 3000 -0.001 3000
v 3000 -0.001 -3000
v -3000 -0.001 -3000
f 1 2 3 4
TEXT
ring='{"file": "ring.obj", "smooth": true}, {"file": "ball.obj", "smooth": true}'
metals='"band": {"type": "mirror", "reflectance": [0.95, 0.75, 0.4]}, "ball": {"type": "glass", "ior": 1.5}'
scene ring '1.0, 2.1, 3.2' '0, 0.25, 0' '{"file": "table.obj"}, '"$ring" "$metals"
scene mirror '0.6, 1.6, 3.4' '0, 0.3, -0.5' '{"file": "mirror.obj"}, '"$ring" "$metals"
scene plain '1.0, 2.1, 3.2' '0, 0.25, 0' '{"file": "plain.obj"}, {"file": "table.obj"}, '"$ring" \
    '"band": {"type": "lambert", "albedo": [0.8, 0.6, 0.3]}, "ball": {"type": "lambert", "albedo": [0.8, 0.8, 0.8]}'
scene gloss '1.0, 2.1, 3.2' '0, 0.25, 0' '{"file": "table.obj"}, '"$ring" \
    '"band": {"type": "ggx", "base_color": [0.95, 0.75, 0.4], "metallic": 1, "roughness": 0.05},
     "ball": {"type": "phong", "diffuse": [0.05, 0.05, 0.05], "specular": [0.9, 0.9, 0.9], "exponent": 10000}'
steps=(--scene "$here/../examples/steps.json")

pair gloss '--method light' '--method auto' --scene "$work/gloss.json" --source "$work/cloud.hdr" --paths direct \
    --samples 64
pair small-sun '--method uniform' '--method auto' "${steps[@]}" --source "$work/sun.hdr" --paths direct --samples 64
pair sun-down '--method light' '--method auto' "${steps[@]}" --source "$work/down.hdr" --paths direct --samples 64
pair cells '--method faces --tune cells=8' '--method auto' "${steps[@]}" --source "$work/sun.hdr" --paths direct --samples 8
pair clipped "--source $work/clipped.hdr" "--source $work/whole.hdr" "${steps[@]}" --paths direct --samples 128
pair caustic '--caustics eye --eye-paths 24' '--caustics auto --particles 700000' --scene "$work/ring.json" \
    --source sky:time=08:30 --samples 64
pair even-sky '--indirect light --particles 921600' '--indirect auto --eye-paths 16' "${steps[@]}" \
    --source "$work/cloud.hdr" --paths indirect --samples 64
pair plain '--indirect light --particles 921600' '--indirect auto --eye-paths 16' --scene "$work/plain.json" \
    --source "$work/cloud.hdr" --paths indirect --samples 64
picture caustic-in-a-mirror --scene "$work/mirror.json" --source sky:time=08:30 --samples 64 --eye-paths 64 \
    --particles 4000000
