#!/usr/bin/env bash
# What programs answer to wrong or useless arguments and files: what is wrong, and what would be right.
. "$(dirname "$0")/lib.sh"
small=(--size 16x9 --samples 1 --paths direct)

a_flag_that_does_not_exist_suggests_the_nearest() {
    expect 2 "unknown flag '--sampels': did you mean --samples\? \(see relight-render --help all\)" "$bin/relight-render" --sampels 3
    expect 2 "unknown flag '--expsure': did you mean --exposure\?" "$bin/relight-render" --expsure=follow
    expect 2 "unknown flag '--tokn-viewer': did you mean --token-viewer\?" "$bin/relightd" --tokn-viewer x
    expect 2 "unknown flag '--form': did you mean --from\?" "$bin/relight-record" --form ws://x
    expect 2 "unknown flag '--frobnicate' \(see" "$bin/relight-render" --frobnicate
    local flag
    for flag in --out --denoise --format; do
        expect 2 "unknown flag '$flag' .*those of relight-render" "$bin/relightd" "$flag"
    done
}

flags_without_effect_are_reported() {
    box_scene "$work"
    local render=("$bin/relight-render" "${small[@]}" --out "$work/x.exr")
    expect 0 '--eye-paths has no effect: there is neither indirect light' "${render[@]}" --eye-paths 64
    expect 0 '--caustics has no effect: there are no caustics' "${render[@]}" --caustics eye
    expect 0 '--tone has no effect: .exr files are linear' "${render[@]}" --tone reinhard
    expect 0 '--exposure has no effect: .exr' "${render[@]}" --exposure 2
    expect 0 '--quality has no effect: .exr' "${render[@]}" --quality 40
    expect 0 '--cache-file has no effect: only --method cached' "${render[@]}" --cache-file "$work/none"
    expect 0 '--tune cells has no effect: only --method faces' "${render[@]}" --method brdf --tune cells=2
    expect 0 '--cells is spelt --tune cells=2 now' "${render[@]}" --cells 2
    expect 0 '--tune compensate has no effect: --method faces samples no' "${render[@]}" --method faces --tune compensate=on
    expect 0 '--tune no-visibility has no effect: reference methods' "${render[@]}" --method path --tune no-visibility
    expect 0 '--source-peak has no effect: the source is computed' "${render[@]}" --source sky: --frames 0 --source-peak 5
    expect 0 '--cache-dir has no effect: --cache-file names one' "${render[@]}" --method cached --cache-file "$work/one" --cache-dir "$work/dir"
    expect 0 '--tune lamp-samples has no effect' "${render[@]}" --lamps 0 --tune lamp-samples=3
    expect 0 '--time has no effect: the built-in scene does not move' "${render[@]}" --time 3
    expect 0 '--lamps has no effect: the scene has none' "${render[@]}" --lamps 2
    if "$bin/relight-render" --help all | grep -q -e --split-frames; then
        expect 0 '--split-frames has no effect in one process' "${render[@]}" --split-frames
        expect 0 '--collect has no effect in one process' "${render[@]}" --collect
    fi
    expect 0 '--particles has no effect: the scene has no mirror' "${render[@]}" --scene "$work/box.json" --paths all --particles 9
    expect 0 '--particles has no effect: with this --paths, --caustics' "${render[@]}" --paths all --caustics eye --particles 9
    expect 0 '--reinhart has no effect without' "${render[@]}" --reinhart 2
    expect 0 '--audit has no effect without --stats' "${render[@]}" --audit 1
    expect 0 '--quality has no effect: .png' "$bin/relight-render" "${small[@]}" --quality 40 --out "$work/x.png"
    expect 0 '--luminance has no effect without' "${render[@]}" --luminance radiance
    expect 0 '--sensors and --pictures have no effect without --annual' "${render[@]}" --pictures none
    expect 0 '--half has no effect' "$bin/relight-render" "${small[@]}" --half --out "$work/x.jpg"
    expect 0 '--samples is given more than once: the last one counts' "${render[@]}" --samples 2
    expect 0 '--threads 1000: this machine has [0-9]+ processors' "${render[@]}" --threads 1000
    "${render[@]}" 2>"$work/log"
    if grep -q warning "$work/log"; then cat "$work/log"; fail "warnings without a reason"; fi
    "$bin/relight-render" --size 16x9 --samples 1 --eye-paths 2 --particles 100 --indirect light --tune cells=2 --exposure 1 --tone linear \
        --quality 50 --out "$work/x.jpg" 2>"$work/log"
    if grep -q warning "$work/log"; then cat "$work/log"; fail "warnings of flags that have an effect"; fi
}

an_image_that_is_replaced_is_named_once() {
    local render=("$bin/relight-render" "${small[@]}" --frames 0-2 --out "$work/%d.exr")
    "${render[@]}" 2>"$work/log"
    if grep -q 'is replaced' "$work/log"; then fail "nothing was there"; fi
    "${render[@]}" 2>"$work/log"
    [ "$(grep -c '0.exr exists and is replaced, and so are others' "$work/log")" = 1 ] || { cat "$work/log"; fail "not named"; }
    [ "$(grep -c 'is replaced' "$work/log")" = 1 ] || fail "named more than once"
}

names_and_dates_that_do_not_exist_list_those_that_do() {
    expect 2 "there is no camera 'front'; expected main, sundial and gallery" "$bin/relight-render" "${small[@]}" --camera front --out "$work/x.exr"
    expect 2 'date=2026-02-30: there is no such day; month 2 has the days 1 to 29' "$bin/relight-render" "${small[@]}" \
        --source sky:date=2026-02-30 --out "$work/x.exr"
    expect 2 'date=13-01 is not MM-DD or YYYY-MM-DD' "$bin/relight-render" "${small[@]}" --source sky:date=13-01 --out "$work/x.exr"
    expect 2 "'path' is not available here; expected uniform" "$bin/relightd" --port 0 --method path
    if "$bin/relightd" --help | grep -A3 -e '^  --method' | grep -q 'photons'; then fail "relightd offers a reference method"; fi
    expect 1 'nope.gltf: No such file or directory$' "$bin/relight-render" "${small[@]}" --scene "$work/nope.gltf" --out "$work/x.exr"
    if grep -q 'nope.gltf.*nope.gltf' "$work/stderr"; then fail "the file is named twice"; fi
    expect 1 'nope.json: No such file or directory$' "$bin/relight-render" "${small[@]}" --scene "$work/nope.json" --out "$work/x.exr"
}

files_that_are_no_sky_say_what_they_are() {
    local render=("$bin/relight-render" "${small[@]}" --out "$work/x.exr")
    "$bin/relight-render" "${small[@]}" --size 64x32 --out "$work/whole.exr"
    local bytes cut
    bytes=$(stat -c %s "$work/whole.exr")
    for cut in 400 500 1000 $((bytes - 1)); do
        head -c "$cut" "$work/whole.exr" >"$work/cut.exr"
        if [ "$cut" -gt 450 ]; then
            expect 1 "cut.exr: .*: the file is cut off: it has $cut bytes, and its data go up to byte [0-9]+" "${render[@]}" \
                --source "$work/cut.exr"
        else
            expect 1 "cut.exr: .*the file ends" "${render[@]}" --source "$work/cut.exr"
        fi
    done
    printf 'II*\0\0\0' >"$work/b.jpg"
    expect 1 'b.jpg: is a TIFF file; expected OpenEXR, Radiance .hdr' "${render[@]}" --source "$work/b.jpg"
    local kind
    for kind in moon:now watched:/tmp pulse:; do
        expect 2 "$kind: neither a file nor a kind of source; these are sky:, epw:" "${render[@]}" --source "$kind"
    done
    printf 'glTF\2\0\0\0' >"$work/model.glb"
    expect 1 'model.glb: is a model or scene \(for --scene\), no image' "${render[@]}" --source "$work/model.glb"
    for kind in hdr exr jpg png; do
        touch "$work/light.$kind"
        expect 1 "light.$kind: an image lights a scene: give it with --source" "${render[@]}" --scene "$work/light.$kind"
    done
    mkdir "$work/pictures"
    touch "$work/pictures/a.png"
    expect 1 "no .exr or .hdr file; for others give a pattern such as '$work/pictures/\*.png'" "${render[@]}" --source "$work/pictures"
    printf '#EXTM3U\nfile:///etc/passwd\n' >"$work/live.m3u8"
    expect 1 'live.m3u8: is an HLS playlist file; expected OpenEXR' "${render[@]}" --source "$work/live.m3u8"
    printf '\xff\xd8\xff\xe0\0\x10JFIF\0\1\1\0\0\1\0\1\0\0\xff\xdb' >"$work/picture.mp4"
    expect 1 'picture.mp4: (it is not a video that this program can read|this build reads no video)' "${render[@]}" \
        --source "$work/picture.mp4"
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n' >"$work/odd.hdr"
    printf '\x80\x80\x80\x81%.0s' 1 2 3 4 5 6 >>"$work/odd.hdr"
    expect 0 'odd.hdr: 3x2 is not 2:1, the aspect ratio of a lat-long image: it is stretched' "${render[@]}" --source "$work/odd.hdr" --layout latlong
    expect 1 '3x2' "${render[@]}" --source "$work/odd.hdr"
    expect 1 'error: [^ ]*/odd.hdr: 3x2 is not 2:1, so the layout is ambiguous' "$bin/relight-render" "${small[@]}" --out "$work/x.png" \
        --source "$work/odd.hdr"
    if grep -q 'odd.hdr.*odd.hdr' "$work/stderr"; then fail "the file is named twice"; fi
}

sizes_and_counts_that_cannot_be_say_what_to_change() {
    expect 1 'more than the allowed [0-9.]+ GiB: use a smaller --size or fewer --edge-rays' "$bin/relight-render" --size 16384x16384 \
        --out "$work/x.exr"
    expect 2 '--samples fixes the sample count; --fps and --error choose it: give one or the other' "$bin/relight-render" "${small[@]}" \
        --fps 5 --out "$work/x.exr"
}

check_config_finds_a_state_that_cannot_be_written() {
    expect 2 'state: /proc/nodir: cannot be written to: .*; name a folder that this user may write' "$bin/relightd" --check-config \
        --state /proc/nodir
    "$bin/relightd" --check-config --state "$work/new" >/dev/null
    "$bin/relightd" --check-config --state "$work" >/dev/null
    [ ! -e "$work/new" ] || fail "a check made the folder"
}

a_server_without_one_good_frame_says_so() {
    printf 'II*\0\0\0' >"$work/b.exr"
    "$bin/relightd" --port 0 --size 16x9 --source "$work/b.exr" 2>"$work/log" &
    local pid=$!
    waits 'none of the' "$work/log" $pid
    kill -TERM $pid
    wait $pid || true
    grep -q "error: none of the 1 frames of --source $work/b.exr can be used: there is no image until one can" "$work/log" ||
        { cat "$work/log"; fail "no word of it"; }
    [ "$(grep -c 'none of the' "$work/log")" = 1 ] || fail "more than one word"
}

servers_that_cannot_be_reached_are_explained() {
    "$bin/relight-feed" --to ws://nowhere.invalid:1 sky: 2>"$work/log" &
    local pid=$! # it tries for ever
    waits "nowhere.invalid:1: cannot be reached: .nowhere.invalid. cannot be resolved" "$work/log" $pid
    kill $pid
    wait $pid || true
}

a_key_of_tune_that_does_not_exist_lists_those_that_do() {
    expect 2 "--tune has no key 'cell'; it has .*cells, sun, .*renew" "$bin/relight-render" --tune sun,cell=2
    expect 2 "--tune cells needs a value: K" "$bin/relightd" --tune cells
    expect 2 "--tune cells '3' is not a power of two" "$bin/relightd" --tune sun,cells=3
    expect 2 "--tune sun takes no value" "$bin/relightd" --tune sun=1
    expect 2 "unknown flag '--cell': did you mean --tune cells" "$bin/relightd" --cell 4
}

helpers_answer_help_with_success() {
    local program
    for program in relight-decoder relight-reader; do
        expect 0 'it cannot be used alone' "$bin/$program" --help
        expect 0 'it cannot be used alone' "$bin/$program" --help all
        expect 2 'it cannot be used alone' "$bin/$program" --halp
    done
}

"$1"
