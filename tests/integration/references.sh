#!/usr/bin/env bash
# Pictures of all paths against another renderer's: those that were made once, and new ones where Blender is installed.
. "$(dirname "$0")/lib.sh"
references="$(dirname "$(readlink -f "$0")")/../references"

# A planted fault costs as much as the comparison itself, so only `./test --long` renders it.
planted=$(count "" 1)

# against NAME SCENE SOURCE MEAN RELMSE FLAGS...: relMSE 1e-3 is the bound of pictures of 1024 samples a pixel or more.
# Each commit makes pictures of fewer paths and allows their noise; the mean is held as sharply.
against() {
    local name=$1 scene=$2 source=$3 mean=$4 relmse=$5
    shift 5
    "$bin/relight-render" --scene "$scenes/$scene.json" --source "$source" --size "$size" --samples "$(count 256 512)" \
        --paths all "$@" --out "$work/$name.exr"
    "$bin/relight-diff" "$work/$name.exr" "$(of_size "$name")" --trim "$trim" --max-relmse "$relmse" --max-mean "$mean"
}

# The mean square of a picture's noise falls from 1.3e-2 at 32 eye paths a point to 3.5e-3 at 128 and 9.5e-4 at 640;
# without indirect light it is 1.7e-1.
indirect_light_agrees_with_cycles_under_a_low_sun() {
    need_data
    local sky="$data/sky/sky.0012.exr" relmse
    relmse=$(count 5e-3 1e-3)
    if [ "$planted" ] && against plaza_all_sky0012 plaza "$sky" 0.005 "$relmse" --samples 64 --indirect none; then
        fail "an image without indirect light passes"
    fi
    against plaza_all_sky0012 plaza "$sky" 0.005 "$relmse" --eye-paths "$(count 128 704)"
}

# Of 48 eye paths a point it is 2.0e-3, without caustics 2.3e-2.
mirror_glass_and_caustics_agree_with_cycles_under_overcast() {
    need_data
    local sky="$data/env/overcast_city_1k.hdr" relmse
    relmse=$(count 3e-3 1e-3)
    if [ "$planted" ] && against ring_all_overcast_city ring "$sky" 0.01 "$relmse" --samples 64 --caustics none; then
        fail "a picture without caustics passes"
    fi
    against ring_all_overcast_city ring "$sky" 0.01 "$relmse" --eye-paths "$(count 48 128)"
}

# prepared NAME SCENE SOURCE RELMSE FLAGS...: the same by the cache of light transport, computed once for a scene.
prepared() {
    local name=$1 scene=$2 source=$3 relmse=$4
    shift 4
    "$bin/relight-render" --method cached --cache-file "$work/$scene.transport" --scene "$scenes/$scene.json" \
        --source "$source" --size "$size" --samples 256 "$@" --out "$work/$name.exr"
    "$bin/relight-diff" "$work/$name.exr" "$(of_size "$name")" --trim "$trim" --max-relmse "$relmse" --max-mean 0.005
}

# Seen: 1.3e-4 against 2048 samples a pixel, 5.1e-4 and 1.4e-3 against 256, whose noise is most of it; with all paths
# 1.5e-3, where records and tents leave 1.7e-3 of the bounce. At a sixteenth of the pixels 4.6e-4, 2.0e-4 and 3.3e-3.
light_transport_agrees_with_cycles_on_the_plaza() {
    need_data
    local sun="$data/sky/sky.0012.exr"
    prepared plaza_direct_sky0012 plaza "$sun" "$(count 8e-4 5e-4)" --paths direct
    if [ -n "${RELIGHT_LONG:-}" ]; then
        prepared plaza_direct_kloppenheim plaza "$data/env/partlycloudy_kloppenheim_05_1k.hdr" 2e-3 --paths direct
    fi
    prepared plaza_direct_overcast_city plaza "$data/env/overcast_city_1k.hdr" 3e-3 --paths direct
    prepared plaza_all_sky0012 plaza "$sun" "$(count 3.5e-3 2.5e-3)" --paths all
    if [ "$planted" ] && prepared plaza_direct_sky0012 plaza "$sun" 5e-4 --paths direct --rotate 1; then
        fail "a sky turned by a degree passes"
    fi
    if [ "$planted" ] && prepared plaza_all_sky0012 plaza "$sun" 2.5e-3 --paths all --indirect none; then
        fail "an image without indirect light passes"
    fi
}

# Direct light and indirect light by the cache, caustics by stored paths, mirror and glass. Seen: 1.4e-3.
light_transport_and_stored_caustics_agree_with_cycles_on_the_ring() {
    need_data
    local sky="$data/env/overcast_city_1k.hdr"
    prepared ring_all_overcast_city ring "$sky" 2.5e-3 --paths all --tune stored-paths="$(count 1500000 20000000)"
    if [ "$planted" ] && prepared ring_all_overcast_city ring "$sky" 2.5e-3 --paths all --caustics none; then
        fail "a picture without caustics passes"
    fi
}

# sky TEXELS RADIANCE: a sky of 1024x512 with a square sun, 31 degrees high and behind the fence on its left.
sky() {
    python3 - "$1" "$2" <<'PY'
import math
import sys

def rgbe(*rgb):
    exponent = math.frexp(max(rgb))[1]
    return bytes([min(255, int(x * 2.0 ** (8 - exponent) + 0.5)) for x in rgb] + [exponent + 128])

side, radiance = int(sys.argv[1]), float(sys.argv[2])
sun = rgbe(radiance, 0.95 * radiance, 0.9 * radiance) * side
sys.stdout.buffer.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 512 +X 1024\n")
for y in range(512):
    height = max(0.0, 1.0 - y / 256)
    plain = rgbe(0.25 + 0.25 * height, 0.35 + 0.35 * height, 0.5 + 0.5 * height) if y < 256 else rgbe(0.25, 0.22, 0.2)
    left = 62 - side // 2
    row = plain * left + sun + plain * (1024 - left - side) if abs(y - 152.5) < side / 2 else plain * 1024
    sys.stdout.buffer.write(row)
PY
}

# compare TEXELS RADIANCE ARGUMENTS...: the blocks under that sky, by both renderers.
compare() {
    local code=0
    sky "$1" "$2" >"$work/sky.hdr"
    shift 2
    RELIGHT_CACHE="$work/cache" "$references/compare.sh" "$references/blocks.json" "$work/sky.hdr" "$@" || code=$?
    [ "$code" != 77 ] || exit 77
    return "$code"
}

shadows_seen_directly_in_a_mirror_and_through_glass_agree_with_cycles_made_now() {
    compare 4 2e4 192x108 256 --direct || fail "another picture"
    if [ "$planted" ] && compare 4 2e4 192x108 256 --direct -- --rotate 1; then fail "a sky turned by a degree is not found out"; fi
}

all_paths_through_mirror_and_glass_agree_with_cycles_made_now() {
    compare 60 30 160x90 256 || fail "another picture"
    [ "$planted" ] || return 0
    sed 's/0.6, 0.55, 0.5/0.63, 0.5775, 0.525/' "$references/blocks.json" >"$work/blocks.json"
    cp "$references/blocks.obj" "$work"
    if compare 60 30 160x90 256 -- --scene "$work/blocks.json"; then
        fail "a floor whose albedo is 5 % too high is not found out"
    fi
}

# What it prints, not speeds; and that the references, of few samples here, are of one scene.
single_images_by_both_are_timed_at_equal_error() {
    local code=0
    PATH=/nowhere /usr/bin/python3 "$references/frame.py" >"$work/none" || code=$?
    [ "$code" = 77 ] || fail "code $code without Blender"
    command -v blender >/dev/null || exit 77
    sky 60 30 >"$work/sky.hdr"
    RELIGHT_CACHE="$work/cache" "$references/frame.py" --size 32x18 --reference 32 --counts 2,8 --sky "$work/sky.hdr" \
        "blocks=$references/blocks.json" >"$work/table"
    python3 - "$work/table" <<'PY' || { cat "$work/table"; fail "another table"; }
import re
import sys

parts = re.split(r"^blocks, ", open(sys.argv[1]).read(), flags=re.M)[1:]
assert [part.split()[0] for part in parts] == ["direct", "all"], parts
for part in parts:
    assert abs(float(re.search(r"differ by ([-+.\d]+)% in the mean", part)[1])) < 10, part
    few, many = (float(e) for e in re.findall(r"Cycles, \d+ samples: .* error ([-+.e\d]+)", part))
    assert 0 < many < few, part
    ours = re.findall(r"ours, --.*: .* error ([-+.e\d]+); .* ([.\d]+) times ours, ([-.\d]+) without", part)
    assert len(ours) == 3 and all(float(x) > 0 for row in ours for x in row[:2]), part
    assert float(ours[1][0]) < float(ours[0][0]), part
PY
}

"$1"
