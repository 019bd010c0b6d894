#!/usr/bin/env bash
# relight-render from scripts: whole sequences, independent references, every map, bad input.
. "$(dirname "$0")/lib.sh"

# 67 frames of a day at full size; each is an image, and the light moves.
renders_a_day_of_67_frames() {
    need_data
    "$bin/relight-render" --scene "$scenes/plaza.json" --source "$data/sky/sky.%04d.exr" --size 160x90 --method mis \
        --samples 16 --paths direct --out "$work/plaza.%04d.exr" --stats "$work/stats.json"
    [ "$(find "$work" -name 'plaza.*.exr' | wc -l)" = 67 ] || fail "not 67 pictures"
    [ "$(grep -c '"frame"' "$work/stats.json")" = 67 ] || fail "not 67 objects of statistics"
    local n
    for n in 0000 0012 0033 0066; do
        [ -s "$work/plaza.$n.exr" ] || fail "frame $n is missing"
    done
    # Noon is brighter than before sunrise, and morning differs from noon by more than a gain.
    "$bin/relight-diff" "$work/plaza.0012.exr" "$work/plaza.0033.exr" --json >"$work/diff.json"
    grep -q rel_mse "$work/diff.json" || fail "relight-diff printed no relMSE"
    if "$bin/relight-diff" "$work/plaza.0012.exr" "$work/plaza.0033.exr" --max-relmse 0.05 >/dev/null; then
        fail "morning and noon are the same picture"
    fi
}

# against NAME SOURCE BOUND SAMPLES: the mean within 0.5 %, relMSE without the worst pixels (lib.sh) below BOUND.
against() {
    "$bin/relight-render" --scene "$scenes/plaza.json" --source "$2" --size "$size" --method mis --samples "$4" \
        --paths direct --out "$work/$1.exr"
    "$bin/relight-diff" "$work/$1.exr" "$(of_size "$1")" --trim "$trim" --max-relmse "$3" --max-mean 0.005
}

direct_light_agrees_with_cycles_under_a_low_sun() {
    need_data
    against plaza_direct_sky0012 "$data/sky/sky.0012.exr" "$(count 8e-4 1e-3)" "$(count 512 1024)"
}

# These two references have 256 samples per pixel and their own noise: their README asks for 5e-3. 320 samples of ours
# gave 4.6e-4 and 1.9e-3.
direct_light_agrees_with_cycles_under_broken_cloud() {
    need_data
    against plaza_direct_kloppenheim "$data/env/partlycloudy_kloppenheim_05_1k.hdr" 5e-3 "$(count 320 1024)"
}

direct_light_agrees_with_cycles_under_overcast() {
    need_data
    against plaza_direct_overcast_city "$data/env/overcast_city_1k.hdr" 5e-3 "$(count 320 1024)"
}

# The check can fail: it detects the same image rotated by a degree (1.3e-3; 6.2e-4 if it is not, of 512 samples at a sixteenth
# of the pixels).
a_sky_turned_by_a_degree_is_told_from_the_reference() {
    need_data
    "$bin/relight-render" --scene "$scenes/plaza.json" --source "$data/sky/sky.0012.exr" --rotate 1 --size "$size" \
        --method mis --samples 256 --paths direct --out "$work/turned.exr"
    expect 1 'relMSE' "$bin/relight-diff" "$work/turned.exr" "$(of_size plaza_direct_sky0012)" --trim "$trim" --max-relmse "$(count 8e-4 1e-3)"
}

every_map_renders_or_is_refused_with_a_reason() {
    need_data
    local map code name rendered=0
    for map in "$data"/env/*; do
        name=$(basename "$map")
        code=0
        "$bin/relight-render" --source "$map" --size 64x36 --samples 8 --out "$work/map.exr" 2>"$work/stderr" || code=$?
        if [ "$code" = 0 ]; then
            rendered=$((rendered + 1))
        else
            echo "$name: $(cat "$work/stderr")"
            grep -q "$name" "$work/stderr" || fail "$name was refused without being named"
            case $name in # one is not 2:1, two are of a compression that OpenEXRCore 3.1 does not have
            odd_flat_cie_512x512.hdr | dwab_*) ;;
            *) fail "$name should render" ;;
            esac
        fi
    done
    [ "$rendered" -ge 15 ] || fail "only $rendered maps rendered"
    "$bin/relight-render" --source "$data/env/odd_flat_cie_512x512.hdr" --layout latlong --size 64x36 --samples 8 \
        --out "$work/map.exr" || fail "--layout latlong does not help a square map"
}

damaged_files_are_refused_by_name() {
    need_data
    local file name
    for file in "$data"/bad_exr/damaged/*; do
        name=$(basename "$file")
        expect 1 "$name" "$bin/relight-render" --source "$file" --size 16x9 --samples 1 --out "$work/x.exr"
        [ ! -e "$work/x.exr" ] || fail "$name gave a picture"
    done
}

the_same_seed_gives_the_same_bits_at_any_thread_count() {
    constant_sky "$work/sky.hdr"
    box_scene "$work"
    local n
    for n in 1 2 3; do
        "$bin/relight-render" --scene "$work/box.json" --source "$work/sky.hdr" --size 160x90 --samples 16 --seed 5 \
            --threads $n --out "$work/out$n.exr"
    done
    cmp "$work/out1.exr" "$work/out2.exr"
    cmp "$work/out1.exr" "$work/out3.exr"
    "$bin/relight-render" --scene "$work/box.json" --source "$work/sky.hdr" --size 160x90 --samples 16 --seed 6 \
        --out "$work/out4.exr"
    if cmp -s "$work/out1.exr" "$work/out4.exr"; then fail "the seed changes nothing"; fi
}

# Eight samples: relMSE falls to a third or less (a tenth was measured), and the mean stays. The bits depend on no thread
# count, and what cannot be filtered is refused.
denoising_brings_a_noisy_picture_closer() {
    local render=("$bin/relight-render" --source sky:time=10:00 --size 160x90 --method mis --tune sun)
    local noisy denoised n
    "${render[@]}" --samples 128 --eye-paths 64 --out "$work/true.exr"
    "${render[@]}" --samples 8 --out "$work/noisy.exr"
    for n in 1 2; do
        "${render[@]}" --samples 8 --denoise --threads $n --out "$work/denoised$n.exr" --stats "$work/stats$n.json"
    done
    cmp "$work/denoised1.exr" "$work/denoised2.exr" || fail "other bits on two threads"
    grep -q '"filter": [0-9.]*[1-9]' "$work/stats1.json" || fail "the filter took no time"
    "$bin/relight-diff" "$work/noisy.exr" "$work/true.exr" --json >"$work/noisy.json"
    "$bin/relight-diff" "$work/denoised1.exr" "$work/true.exr" --json --max-mean 0.02 >"$work/denoised.json" ||
        fail "the filter shifts the mean"
    noisy=$(sed -E 's/.*"rel_mse": ([^,}]*).*/\1/' "$work/noisy.json" | tr -d '\n')
    denoised=$(sed -E 's/.*"rel_mse": ([^,}]*).*/\1/' "$work/denoised.json" | tr -d '\n')
    awk "BEGIN { exit !($denoised < $noisy / 3) }" || fail "relMSE $noisy, denoised $denoised"
    expect 2 'denoise' "${render[@]}" --method path --denoise --out "$work/x.exr"
    expect 2 'denoise' "$bin/relight-render" --size 16x9 --fps 4 --denoise --out "$work/x.exr"
}

# On a terminal.
a_slow_frame_shows_how_far_it_is() {
    python3 - "$bin/relight-render" "$work/x.exr" <<'PY' || fail "no progress within the frame"
import os, pty, re, sys

child, end = pty.fork()
if child == 0:
    os.execv(sys.argv[1], [sys.argv[1], "--size", "480x270", "--samples", "64", "--out", sys.argv[2]])
text = b""
try:
    while part := os.read(end, 65536):
        text += part
except OSError:
    pass  # the other end is closed
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, text
shares = [int(n) for n in re.findall(rb"rendering  0/1  (\d+) %", text)]
assert len({n for n in shares if 0 < n < 100}) > 3 and shares == sorted(shares), shares
PY
}

built_in_scene_and_sky_need_no_file() {
    "$bin/relight-render" --frames 0-2 --size 96x54 --samples 8 --out "$work/%d.jpg" --stats - >"$work/stats.json"
    [ -s "$work/0.jpg" ] && [ -s "$work/2.jpg" ] || fail "pictures are missing"
    grep -q '"rays"' "$work/stats.json" || fail "no statistics"
}

# A map says nothing of its sun: it is found, stated, and turned to where --sun-azimuth wants it.
statistics_state_where_a_maps_sun_stands() {
    "$bin/relight-feed" --out "$work/sun.exr" --frames 0 'sky:latitude=45,date=06-21,hour=10,size=256x128'
    local flags
    for flags in '' '--rotate 40' '--sun-azimuth 200'; do
        # shellcheck disable=SC2086
        "$bin/relight-render" --source "$work/sun.exr" --size 16x9 --samples 1 --paths direct --out "$work/sun.png" --stats - \
            $flags >"$work/sun.json"
        python3 - "$work/sun.json" "$flags" <<'PY'
import json, sys
sun = json.load(open(sys.argv[1]))[0]["sun"]
# The sun's place by its declination of 23.44 degrees; a texel is 1.4 degrees.
azimuth = {"": 121.4, "--rotate 40": None, "--sun-azimuth 200": 200.0}[sys.argv[2]]
assert abs(sun["elevation"] - 57.5) < 2.0, sun
assert azimuth is None or abs(sun["azimuth"] - azimuth) < 2.0, sun
assert azimuth is not None or abs(abs(sun["azimuth"] - 121.4) - 40.0) < 2.0, sun
PY
    done
    python3 -c 'import sys; sys.stdout.buffer.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n" + b"\x80\x80\x80\x81" * 512)' \
        >"$work/even.hdr"
    "$bin/relight-render" --source "$work/even.hdr" --size 16x9 --samples 1 --paths direct --out "$work/sun.png" --sun-azimuth 200 \
        2>"$work/said"
    grep -q 'no sun is found in it for --sun-azimuth to turn' "$work/said" || fail "a map without a sun is not told: $(cat "$work/said")"
}

# Frames 4 to 6 have the bytes that they have among 0 to 6, in every format and, in one, by several methods and exposures.
# Fixed exposure, and following it, which depends on the frames before.
a_frame_does_not_depend_on_the_frames_selected() {
    local sky='sky:time=05:30,speed=60,size=64x32' options n kind k=0 last=6 kinds='jpg png exr'
    local render=("$bin/relight-render" --source "$sky" --size 32x18)
    for options in '--samples 4' '--method mis --samples 4 --reseed --paths direct' '--samples 4 --denoise' \
        '--scene @ring --samples 4 --caustics stored --tune renew=4,stored-paths=1000' \
        '--method cached --paths direct' '--samples 4 --exposure 2' '--samples 4 --exposure-frame 9'; do
        options="${options/@ring/$(dirname "$(readlink -f "$0")")/../../docs/examples/ring.json}"
        k=$((k + 1))
        case $options in *--exposure*) kinds=jpg ;; esac
        for kind in $kinds; do
            # shellcheck disable=SC2086
            "${render[@]}" $options --frames 0-$last --out "$work/all.%d.$kind"
            # shellcheck disable=SC2086
            "${render[@]}" $options --frames 4-$last --out "$work/some.%d.$kind"
            for n in $(seq 4 $last); do
                cmp "$work/all.$n.$kind" "$work/some.$n.$kind" || fail "$options, frame $n.$kind"
            done
        done
        cp "$work/all.4.jpg" "$work/with-$k.jpg"
        last=5 kinds=exr # floats tell more; exposure is in images for the screen only
    done
    if cmp -s "$work/with-1.jpg" "$work/with-6.jpg"; then fail "--exposure 2 changes nothing"; fi
    if cmp -s "$work/with-1.jpg" "$work/with-7.jpg"; then fail "--exposure-frame changes nothing"; fi
    for n in 0-6 4-6; do
        "${render[@]}" --samples 4 --exposure follow --frames $n --out "$work/$n.%d.jpg"
    done
    if cmp -s "$work/0-6.4.jpg" "$work/4-6.4.jpg"; then fail "it does not follow"; fi
    expect 2 "'bright' is not a number from -60 to 60, auto or follow" "${render[@]}" --exposure bright --out "$work/x.jpg"
    expect 2 '--exposure-frame is for --exposure auto' "${render[@]}" --exposure follow --exposure-frame 1 --out "$work/x.jpg"
    mkdir "$work/watched"
    expect 2 '--exposure-frame does not work with --source watch:' "$bin/relight-render" --source "watch:$work/watched" \
        --exposure-frame 1 --size 16x9 --out "$work/%d.jpg"
    constant_sky "$work/sky.3.hdr"
    expect 2 'range from 1 to 1; the numbers run from 3' "$bin/relight-render" --source "$work/sky.%d.hdr" \
        --exposure-frame 1 --size 16x9 --samples 1 --out "$work/%d.jpg"
    echo broken >"$work/sky.2.hdr"
    expect 1 '1 of 2 frames' "$bin/relight-render" --source "$work/sky.%d.hdr" --size 16x9 --samples 1 --out "$work/%d.jpg"
    [ -s "$work/3.jpg" ] || fail "no picture, since the first frame could not be measured"
}

# 8 bits, 16, and a foreground with alpha above a ground; flags that the format lacks are refused.
png_files_have_the_bits_and_the_alpha_asked_for() {
    box_scene "$work"
    constant_sky "$work/sky.hdr"
    local render=("$bin/relight-render" --scene "$work/box.json" --source "$work/sky.hdr" --size 48x27 --samples 8)
    "${render[@]}" --out "$work/plain.png"
    "${render[@]}" --bits 16 --out "$work/deep.png"
    "${render[@]}" --ground --alpha --out "$work/alpha.png"
    "${render[@]}" --ground --alpha --bits 16 --out "$work/both.png"
    "${render[@]}" --ground --alpha --out "$work/alpha.exr"
    /usr/bin/python3 - "$work" <<'END'
import struct, sys
for name, bits, kind in ("plain", 8, 2), ("deep", 16, 2), ("alpha", 8, 6), ("both", 16, 6):
    head = open(f"{sys.argv[1]}/{name}.png", "rb").read(33)
    assert head[:16] == b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", name
    assert struct.unpack(">IIBB", head[16:26]) == (48, 27, bits, kind), name
END
    expect 2 '--alpha needs --out in .exr or .png' "${render[@]}" --ground --alpha --out "$work/x.jpg"
    expect 2 '--bits 16 is for --out in .png' "${render[@]}" --bits 16 --out "$work/x.exr"
    expect 2 'add --ground' "${render[@]}" --alpha --out "$work/x.png"
    expect 2 'reference method path' "${render[@]}" --ground --alpha --method path --out "$work/x.png"
    expect 2 "'12' is unknown" "${render[@]}" --bits 12 --out "$work/x.png"
    [ ! -e "$work/x.png" ] || fail "a refused flag left a picture"
}

# Lamps at scale 0 are as if there were none, to the bit; else they make the picture brighter, and the statistics count
# them. The same seed gives the same bits.
# The bytes of the files, one after the other, and nothing else.
standard_output_gets_the_bytes_of_the_files() {
    local render=("$bin/relight-render" --source sky:size=128x64,time=09:00,speed=20 --size 32x18 --samples 1 --paths direct) kind
    for kind in png jpg exr; do
        "${render[@]}" --frames 0-2 --out "$work/%d.$kind"
        "${render[@]}" --frames 0-2 --out - --format $kind >"$work/all.$kind" 2>"$work/stderr"
        cat "$work"/[012].$kind | cmp - "$work/all.$kind" || fail "other bytes in $kind"
    done
    "${render[@]}" --frames 1 --out "$work/a.exr"
    "${render[@]}" --frames 1 --out - --format exr | cmp - "$work/a.exr" || fail "other bytes in exr"
    "${render[@]}" --frames 0-1 --out - --format png >>"$work/0.png" # nothing there is overwritten
    cat "$work"/[1].png | cmp - <(tail -c "$(stat -c %s "$work/1.png")" "$work/0.png") || fail "not appended"
    local got=0
    "${render[@]}" --frames 0-99 --out - --format png 2>"$work/stderr" | head -c 100 >"$work/head" || got=${PIPESTATUS[0]}
    [ "$got" = 1 ] || fail "exit code $got when the reader ends"
    grep -q 'standard output: the reader has closed it' "$work/stderr" || { cat "$work/stderr"; fail "no message"; }
    expect 2 '--out - needs --format: .*exr, jpg, png, mp4, mkv or webm' "${render[@]}" --out -
    expect 2 "--format 'gif': .*exr, jpg, png" "${render[@]}" --out - --format gif
    expect 2 "--format is for --out -" "${render[@]}" --out "$work/a.png" --format jpg
    expect 2 '--out - and --stats - both write to standard output' "${render[@]}" --out - --format png --stats -
    expect 2 '--out - and --probe both write to standard output' "${render[@]}" --out - --format png --probe 1,1
    ls "$work" | grep -Fxq -- - && fail "a file named -"
    script -qec "${render[*]} --out - --format png" "$work/typescript" >"$work/tty" && fail "a terminal was accepted"
    grep -q 'standard output is a terminal; redirect it' "$work/tty" || { cat "$work/tty"; fail "no message about the terminal"; }
}

lamps_are_a_part_that_a_factor_scales() {
    local dark="$work/dark.json" examples s
    examples=$(cd "$(dirname "$0")/../../docs/examples" && pwd)
    sed -E 's/, "emission": [^}]*//; s/"lights"/"was"/; s#"file": "#&'"$examples"'/#' "$examples/evening.json" >"$dark"
    local render=("$bin/relight-render" --source sky:hour=20 --size 96x54 --method mis --samples 4 --tune lamp-samples=4)
    "${render[@]}" --scene "$dark" --out "$work/dark.exr"
    for s in 0 1 2 again; do
        "${render[@]}" --scene "$examples/evening.json" --lamps "${s/again/1}" --out "$work/lamps$s.exr" \
            --stats "$work/lamps$s.json"
    done
    cmp "$work/dark.exr" "$work/lamps0.exr" || fail "lamps at scale 0 change the picture"
    cmp "$work/lamps1.exr" "$work/lampsagain.exr" || fail "the same seed gave other bits"
    if cmp -s "$work/lamps1.exr" "$work/lamps2.exr"; then fail "the factor changes nothing"; fi
    grep -q '"lamps": {"scale": 2.0, "triangles": 4416, "lights": 1, "samples": 4' "$work/lamps2.json" ||
        fail "the statistics do not count the lamps"
    if grep -q '"lamps"' "$work/lamps0.json"; then fail "lamps at scale 0 were computed"; fi
    expect 2 'lamps' "${render[@]}" --lamps -1 --out "$work/none.exr"
}

# The ring's image: what each class adds, that the classes sum to the whole, and the statistics.
a_wish_for_a_rate_or_an_error_is_kept_to_and_told() {
    "$bin/relight-render" --source sky:hour=12 --size 96x54 --paths all --frames 0-9 --fps 4 --out "$work/rate%d.jpg" \
        --stats "$work/rate.json"
    "$bin/relight-render" --source sky:hour=12 --size 96x54 --paths direct --frames 0-5 --error 0.02 \
        --out "$work/error%d.jpg" --stats "$work/error.json" --audit 0.1
    # Too little time for clean indirect light, and far too little for any: it is denoised, and that is said once.
    "$bin/relight-render" --source sky:hour=12 --size 160x90 --samples 256 --eye-paths 48 --out "$work/truth.exr"
    local rate
    for rate in 30 1000; do
        "$bin/relight-render" --source sky:hour=12,speed=0 --size 160x90 --frames 0-15 --reseed --fps $rate \
            --out "$work/hasty$rate.%d.exr" --stats "$work/hasty$rate.json" 2>"$work/stderr"
        [ "$(grep -c 'so the light is denoised' "$work/stderr")" -eq 1 ] || { cat "$work/stderr"; fail "not said once"; }
    done
    [ "$(grep -c 'the fewest samples take' "$work/stderr")" -eq 1 ] || { cat "$work/stderr"; fail "not said once"; }
    "$bin/relight-render" --size 16x9 --samples 2 --frames 0 --out "$work/none.exr" --stats "$work/none.json"
    python3 - "$work" "$bin" <<'PY'
import json
import math
import subprocess
import sys

# All light is there: without indirect light the mean would be 0.79 of the truth. Its standard error is held to a third
# of a per cent, so that a limit of 1 % is three.
for rate in (30, 1000):
    means = [json.loads(subprocess.run([f"{sys.argv[2]}/relight-diff", f"{sys.argv[1]}/hasty{rate}.{k}.exr",
                                        f"{sys.argv[1]}/truth.exr", "--json"], capture_output=True).stdout)["mean_ratio"]
             for k in range(16)]
    mean = sum(means) / 16
    deviation = math.sqrt(sum((m - mean) ** 2 for m in means) / 15 / 16)
    print(f"--fps {rate}: mean {mean:.4f} +- {deviation:.4f}")
    assert deviation < 0.0033 and abs(mean - 1.0) < 0.01, means
    for f in json.load(open(f"{sys.argv[1]}/hasty{rate}.json")):
        assert f["plan"]["left_out"] == ["caustics: the scene has no mirror and no glass"], f["plan"]
        assert f["estimate"]["denoised"] == ("bias" in f), f
    assert rate == 30 or not f["estimate"]["met"], f["estimate"]

rate = json.load(open(f"{sys.argv[1]}/rate.json"))
for f in rate:
    assert f["method"] == "auto" and f["estimate"]["wished_ms"] == 250.0, f["estimate"]
    assert "caustics: the scene has no mirror and no glass" in f["plan"]["left_out"], f["plan"]
    assert f["light_paths"]["particles"] == 0 or f["plan"]["caustics"] == "none", f["plan"]
for f in json.load(open(f"{sys.argv[1]}/error.json")):
    last = f["estimate"]
    assert last["met"] == (max(last["error"], f["error"]["estimate"] or 0.0) <= 0.02), f
none = json.load(open(f"{sys.argv[1]}/none.json"))[0]  # without --audit no ray is spent on the error
assert none["estimate"] is None and none["error"] == {"estimate": None, "upper_bound": None, "pixels": 0, "rays": 0, "ms": 0.0}, none
assert last["wished_error"] == 0.02 and 0.0 < last["error"] < 0.04, last
PY
    local render=("$bin/relight-render" --size 16x9 --out "$work/none.exr")
    expect 2 'fps and --error' "${render[@]}" --fps 4 --samples 16
    expect 2 'fps and --error' "${render[@]}" --error 0.1 --method mis
}

classes_of_light_add_up_and_are_told() {
    local ring paths sum
    ring="$(dirname "$(readlink -f "$0")")/../../docs/examples/ring.json"
    for paths in direct caustics indirect all; do
        "$bin/relight-render" --scene "$ring" --source sky:time=08:30 --size 96x54 --samples 16 --paths $paths \
            --particles 20000 --eye-paths 4 --seed 3 --out "$work/$paths.exr" --stats "$work/$paths.json"
    done
    python3 - "$work" <<'PY'
import json
import sys

def read(paths):
    return json.load(open(f"{sys.argv[1]}/{paths}.json"))[0]["plan"]

every, direct = read("all"), read("direct")
assert every["caustics"] == "light tracer" and every["interreflection"] == "eye paths", every
assert every["particles"] == 20000 and every["eye_paths"] == 4 and every["left_out"] == [], every
assert every["direct"] == {"strata": 7, "sun_apart": True, "compensated": True}, every
assert direct["left_out"] == ["caustics: not requested", "indirect light: not requested"], direct
PY
    for paths in caustics indirect; do
        "$bin/relight-diff" "$work/$paths.exr" "$work/all.exr" >"$work/diff.txt"
        awk -v p=$paths '
            /^luminance/ { if ($2 <= 0 || $2 >= $3) { print p " is no part of the whole: " $0; exit 1 } }' "$work/diff.txt"
    done
    sum="$(for paths in direct caustics indirect; do
        "$bin/relight-diff" "$work/$paths.exr" "$work/all.exr"
    done | awk '/^luminance/ { part += $2; whole = $3 } END { print part / whole }')"
    awk -v s="$sum" 'BEGIN { exit !(s > 0.99 && s < 1.01) }' || fail "the classes sum to $sum of the whole"
}

methods_that_cannot_be_are_refused_by_name() {
    local six="$work/six"
    expect 2 'caustics' "$bin/relight-render" --size 16x9 --samples 1 --paths shiny --out "$work/x.exr"
    expect 2 "'3' is not a power of two" "$bin/relight-render" --size 16x9 --tune cells=3 --out "$work/x.exr"
    mkdir "$six"
    local face
    for face in px nx py ny pz nz; do
        printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\200\200\200\201' >"$six/$face.hdr"
    done
    expect 1 'latlong' "$bin/relight-render" --source "$six/{face}.hdr" --method latlong --size 16x9 --samples 1 \
        --out "$work/x.exr"
    [ ! -e "$work/x.exr" ] || fail "a refused method left a picture"
}

what_the_index_names_is_there() {
    local root program
    root="$(dirname "$(readlink -f "$0")")/../.."
    for program in $(sed -n 's/^| `\(relight[a-z-]*\)`.*/\1/p' "$root/docs/README.md"); do
        grep -q "add_dependencies(programs.*[ (]$program[ )]" "$root/CMakeLists.txt" ||
            fail "./run does not build $program"
        "$bin/$program" --version >/dev/null || fail "$program does not start"
    done
    "$bin/relight-render" --scene "$root/docs/examples/steps.json" --size 96x54 --samples 8 --out "$work/steps.jpg"
}

wrong_usage_ends_with_2_and_says_why() {
    expect 2 '--out is missing' "$bin/relight-render"
    expect 2 "unknown flag '--frobnicate'" "$bin/relight-render" --frobnicate --out x.exr
    expect 2 "'magic' is unknown" "$bin/relight-render" --method magic --out x.exr
    expect 2 '--size' "$bin/relight-render" --size 0x5 --out x.exr
    expect 2 '--samples' "$bin/relight-render" --samples 0 --out x.exr
    expect 2 '\.exr, \.jpg, \.png, \.mp4, \.mkv or \.webm' "$bin/relight-render" --out x.tiff
    expect 2 "other '%'" "$bin/relight-render" --out '%s.exr'
    expect 2 '--frames' "$bin/relight-render" --frames 9-3 --out x.exr
    expect 2 "takes one file, but the source has 4 frames: add %04d" "$bin/relight-render" --frames 0-3 --size 16x9 --out "$work/x.exr"
    expect 2 'nosuch' "$bin/relight-render" --camera nosuch --size 16x9 --out "$work/x.exr"
    expect 2 'turbidty' "$bin/relight-render" --source sky:turbidty=3 --size 16x9 --out "$work/x.exr"
}

bad_input_ends_with_1_and_names_file_and_fault() {
    constant_sky "$work/sky.hdr"
    box_scene "$work"
    local render=("$bin/relight-render" --size 16x9 --samples 1 --out "$work/x.exr")
    expect 1 'nowhere.json' "${render[@]}" --scene "$work/nowhere.json"
    expect 1 'nowhere.exr' "${render[@]}" --source "$work/nowhere.exr"
    head -c 50 "$work/sky.hdr" >"$work/cut.hdr"
    expect 1 'cut.hdr' "${render[@]}" --source "$work/cut.hdr"
    echo 'no picture at all' >"$work/text.exr"
    expect 1 'text.exr' "${render[@]}" --source "$work/text.exr"
    sed 's/"position"/"posiktion"/' "$work/box.json" >"$work/blind.json"
    expect 1 'blind.json: camera' "${render[@]}" --scene "$work/blind.json"
    sed 's/"box": {"type"/"bx": {"type"/' "$work/box.json" >"$work/unknown.json"
    expect 1 "box" "${render[@]}" --scene "$work/unknown.json"
    echo '{ "camera": ' >"$work/broken.json"
    expect 1 'broken.json.*line' "${render[@]}" --scene "$work/broken.json"
    expect 1 'missing/x.exr' "$bin/relight-render" --size 16x9 --samples 1 --out "$work/missing/x.exr"
    [ ! -e "$work/x.exr" ] || fail "a refused input left a picture"
}

# A bad frame in a sequence is named and counted; the others are rendered.
a_bad_frame_does_not_end_the_sequence() {
    constant_sky "$work/sky.0.hdr"
    echo 'broken' >"$work/sky.1.hdr"
    constant_sky "$work/sky.2.hdr"
    expect 1 '1 of 3 frames' "$bin/relight-render" --source "$work/sky.%d.hdr" --size 16x9 --samples 1 --out "$work/%d.exr"
    grep -q 'sky.1.hdr' "$work/stderr" || fail "the bad frame is not named"
    [ -s "$work/0.exr" ] && [ ! -e "$work/1.exr" ] && [ -s "$work/2.exr" ] || fail "not exactly frames 0 and 2"
}

help_and_version_are_there() {
    local program
    for program in relightd relight-render relight-diff relight-bench; do
        "$bin/$program" --help >"$work/help" && grep -q usage "$work/help" || fail "$program --help"
        "$bin/$program" --version | grep -Eq "$program [0-9]+\.[0-9]+\.[0-9]+" || fail "$program --version"
    done
}

# The cache is computed once for all frames, results are close to sampled ones, and the statistics report its cost.
a_cached_sequence_is_near_a_sampled_one() {
    local method n
    for method in 'cached --samples 64' 'mis --tune sun --samples 1024'; do
        # shellcheck disable=SC2086
        "$bin/relight-render" --method $method --source 'sky:time=12:00,speed=60' --frames 0-1 --size "$(count 64x36 96x54)" \
            --paths direct --out "$work/${method%% *}.%d.exr" --stats "$work/${method%% *}.json" 2>"$work/stderr"
    done
    for n in 0 1; do
        "$bin/relight-diff" "$work/cached.$n.exr" "$work/mis.$n.exr" --max-relmse 3e-3 --max-mean 0.01
    done
    /usr/bin/python3 -B - "$work/cached.json" <<'PY' || fail "statistics"
import json, sys
frames = json.load(open(sys.argv[1]))
assert len(frames) == 2 and all(f["method"] == "cached" and "cached" in f["bias"] for f in frames)
caches = [f["cache"] for f in frames]
assert caches[0]["precomputation_ms"] == caches[1]["precomputation_ms"] > 0 < caches[0]["bytes"] < caches[0]["dense_bytes"]
assert all(c["bright"]["texels"] > 0 and 0 < c["bright"]["share"] < 1 for c in caches)
PY
}

# The second run loads the cache that the first has kept and gives the same bits; a changed scene has another, and so has
# another --cpu. A named file is replaced instead.
a_cache_is_kept_and_loaded_again() {
    local run kept="$XDG_CACHE_HOME/relightd" box
    box_scene "$work"
    box=("$bin/relight-render" --method cached --scene "$work/box.json" --size 48x27 --paths direct)
    for run in 1 2; do
        "${box[@]}" --out "$work/$run.exr" --stats "$work/$run.json" 2>"$work/log.$run"
    done
    [ "$(cd "$kept" && echo box.json.main-48x27-*.transport | wc -w)" = 1 ] || fail "no file, but $(ls "$kept")"
    [ "$(grep -c "loaded in .* from $kept/box.json.main-48x27-" "$work/log.2")" = 1 ] || fail "no word of it"
    cmp "$work/1.exr" "$work/2.exr" || fail "other bits"
    /usr/bin/python3 -B - "$work" <<'PY' || fail "statistics"
import json, sys
first, second = (json.load(open(f"{sys.argv[1]}/{k}.json"))[0]["cache"] for k in (1, 2))
assert not first["loaded"] and first["load_ms"] == 0 < first["precomputation_ms"]
assert second["loaded"] and second["precomputation_ms"] == 0 < second["load_ms"] < first["precomputation_ms"]
assert first["bytes"] == second["bytes"] and first["rays"] == second["rays"]
PY
    "${box[@]}" --cpu baseline --out "$work/3.exr"
    CACHE_DIRECTORY="$work/of-service:$work/other" "${box[@]}" --cache-file "$work/file" --out "$work/3.exr"
    [ "$(ls "$kept" | wc -l)" = 2 ] || fail "not one for each --cpu: $(ls "$kept")"
    sed -i 's/0.8, 0/0.9, 0/' "$work/box.json"
    expect 0 "file: was made for another scene" "${box[@]}" --cache-file "$work/file" --out "$work/3.exr"
    expect 0 "loaded in .* from $work/file" "${box[@]}" --cache-file "$work/file" --out "$work/3.exr"
    CACHE_DIRECTORY="$work/of-service:$work/other" "${box[@]}" --out "$work/3.exr"
    "${box[@]}" --cache-dir "$work/mine" --out "$work/3.exr"
    "${box[@]}" --cache-dir off --out "$work/3.exr"
    [ "$(ls "$work/of-service" | wc -l)$(ls "$work/mine" | wc -l)$(ls "$kept" | wc -l)" = 112 ] || fail "kept elsewhere"
}

# Killed at any moment, or beside another that writes the same file: the next run has the same picture, and at most one
# warning.
a_cache_survives_kills_and_company() {
    local k box
    box_scene "$work"
    box=("$bin/relight-render" --method cached --scene "$work/box.json" --size 24x14)
    "${box[@]}" --cache-dir off --out "$work/want.exr"
    for k in 05 1 3; do
        rm -rf "$work/kill"
        timeout -s KILL "0.$k" "${box[@]}" --cache-dir "$work/kill" --out "$work/none.exr" 2>/dev/null || true
        "${box[@]}" --cache-dir "$work/kill" --out "$work/$k.exr" 2>"$work/log"
        cmp "$work/want.exr" "$work/$k.exr" || fail "other bits after $k"
        [ "$(grep -c warning "$work/log")" = 0 ] || fail "$(cat "$work/log")"
    done
    for k in $(seq "$(count 2 3)"); do
        "${box[@]}" --cache-dir "$work/three" --out "$work/three.$k.exr" &
    done
    wait
    "${box[@]}" --cache-dir "$work/three" --out "$work/three.4.exr" 2>"$work/log"
    grep -q 'loaded in' "$work/log" || fail "$(cat "$work/log")"
    for k in $(seq "$(count 2 3)") 4; do
        cmp "$work/want.exr" "$work/three.$k.exr" || fail "other bits"
    done
}

a_cache_that_is_too_large_is_refused() {
    expect 1 'needs about [0-9]+ MB, more than the limit of 1: use a smaller --size or a larger --cache-memory' \
        "$bin/relight-render" --method cached --cache-memory 1 --size 160x90 --paths direct --out "$work/none.exr"
    [ ! -e "$work/none.exr" ] || fail "a picture all the same"
}

# The kernels have the same bits at every CPU level (estimators.kernelcheck, film.test_tone_kernel), but Embree, which is held to
# the level too, rounds hits differently; a point that moves by a rounding may change its place in a packet, and then it draws
# other samples. So the images agree far better than those of two seeds, whose relMSE without the worst 2 % is 0.05 here.
every_cpu_level_gives_the_same_picture() {
    local level code options made=0
    for options in '--method mis --samples 16' '--method auto --samples 7' '--method brdf' \
        '--method faces --tune sun,cells=4 --samples 33' '--method cached --cache-file off --samples 16'; do
        for level in baseline v3 v4; do
            code=0
            # shellcheck disable=SC2086
            "$bin/relight-render" --cpu $level $options --paths direct --size "$(count 33x19 49x29)" --source sky:size=256x128 \
                --out "$work/$level.exr" 2>"$work/stderr" || code=$?
            if [ "$code" = 2 ] && [ "$level" != baseline ] && grep -q 'not supported by this CPU' "$work/stderr"; then
                continue
            fi
            [ "$code" = 0 ] || { cat "$work/stderr"; fail "--cpu $level $options"; }
            "$bin/relight-diff" "$work/$level.exr" "$work/baseline.exr" >"$work/diff"
            awk '/without the worst/ { most = $NF } END { exit !(most != "" && most < 1e-3) }' "$work/diff" ||
                { cat "$work/diff"; fail "$level differs: $options"; }
            made=$((made + 1))
        done
    done
    echo "$made pictures compared"
    expect 2 "unknown or not supported by this CPU" "$bin/relight-render" --cpu v9 --size 16x16 --out "$work/none.exr"
}

# Wrong folders, patterns and file types are rejected before the computation; a small export is complete, and its
# files are readable.
components_for_radiance_are_written_or_refused() {
    local render="$bin/relight-render" size='--size 16x9 --samples 4 --paths direct'
    mkdir "$work/parts"
    expect 2 'names one file, but each patch needs one: add %03d' "$render" --components "$work/parts/one.hdr"
    expect 2 'must end in .hdr' "$render" --components "$work/parts/%03d.exr"
    expect 1 'No such file or directory' "$render" --components "$work/nowhere/%03d.hdr"
    expect 2 'expected 1, 2 or 4' "$render" --components "$work/parts/%03d.hdr" --reinhart 3
    expect 2 'out cannot be used with --components' "$render" --components "$work/parts/%03d.hdr" --out x.exr
    expect 2 'source cannot be used with --components' "$render" --components "$work/parts/%03d.hdr" --source x.exr
    # shellcheck disable=SC2086
    expect 0 '146 component images' "$render" --components "$work/parts/%03d.hdr" $size
    [ "$(find "$work/parts" -name '???.hdr' | wc -l)" = 146 ] || fail "not 146 files"
    grep -aq '^VIEW= -vtv' "$work/parts/145.hdr" || fail "no view"
    if grep -aq 'EXPOSURE' "$work/parts/000.hdr"; then fail "an exposure"; fi
    "$render" --source "$work/parts/145.hdr" --layout latlong --size 16x9 --samples 1 --out "$work/read.exr"
}

"$1"
