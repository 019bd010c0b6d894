#!/usr/bin/env bash
# Environment layouts for users: one sky, written by make_sky in each layout, always renders the same image.
. "$(dirname "$0")/lib.sh"

# render_sky LAYOUT WIDTH HEIGHT [FLAGS...]: renders the box under the sky in that layout to $work/LAYOUT.exr.
render_sky() {
    local layout=$1
    "$bin/make_sky" "$layout" "$2" "$3" >"$work/$layout.hdr"
    shift 3
    "$bin/relight-render" --scene "$work/box.json" --source "$work/$layout.hdr" --layout "$layout" "$@" \
        --size 96x54 --samples 128 --paths direct --out "$work/$layout.exr"
}

# Without the worst 2 % of pixels, which a shadow's border may cross; rotated by a quarter the relMSE is 5e-2.
every_layout_renders_the_same_picture() {
    box_scene "$work"
    local turn shape
    for turn in 0 40; do
        render_sky latlong 512 256 --rotate $turn
        for shape in 'latlong-bottom 512 256' 'cube 128 768' 'hcross 512 384' 'vcross 384 512' 'cube-3x2 384 256' 'cube-6x1 768 128' 'fisheye 400 400' \
            'ball 640 640'; do
            # shellcheck disable=SC2086 # name, width and height
            render_sky $shape --rotate $turn
            "$bin/relight-diff" "$work/${shape%% *}.exr" "$work/latlong.exr" --max-relmse 1e-4 ||
                fail "$shape differs from lat-long at $turn degrees"
        done
    done
}

# As ffmpeg's own filter makes them, from a sky of 8 bits.
cube_maps_of_video_look_the_same_way() {
    command -v ffmpeg >/dev/null || { echo "skipped: ffmpeg is not installed"; exit 77; }
    box_scene "$work"
    ffmpeg -v error -f lavfi -i 'gradients=s=1024x512:c0=white:c1=blue:c2=red:c3=green:n=4:x0=0:y0=0:x1=1024:y1=512:seed=4:d=1' \
        -frames:v 1 "$work/flat.png"
    "$bin/relight-render" --scene "$work/box.json" --source "$work/flat.png" --size 160x90 --samples 256 --paths direct \
        --out "$work/flat.exr" 2>"$work/flat.err"
    grep -q 'not HDR' "$work/flat.err" || fail "no warning that a PNG is not HDR"
    local name
    for name in c3x2:cube-3x2 c6x1:cube-6x1; do
        ffmpeg -v error -i "$work/flat.png" -vf "v360=e:${name%:*}" -y "$work/cube.png"
        "$bin/relight-render" --scene "$work/box.json" --source "$work/cube.png" --layout "${name#*:}" --size 160x90 \
            --samples 256 --paths direct --out "$work/cube.exr"
        "$bin/relight-diff" "$work/cube.exr" "$work/flat.exr" --max-relmse 1e-3 || fail "$name differs from lat-long"
    done
}

# The measure can fail: the same sky, rotated.
a_turned_sky_is_another_picture() {
    box_scene "$work"
    render_sky latlong 512 256
    render_sky cube 128 768 --rotate 90
    if "$bin/relight-diff" "$work/cube.exr" "$work/latlong.exr" --max-relmse 1e-2; then fail "no difference"; fi
}

unknown_shapes_ask_for_their_layout() {
    "$bin/make_sky" ball 64 64 >"$work/square.hdr"
    "$bin/make_sky" vcross 48 64 >"$work/cross.hdr"
    local render=("$bin/relight-render" --size 16x9 --samples 1 --out "$work/x.exr")
    expect 1 'square.hdr: 64x64 .*--layout ball or fisheye' "${render[@]}" --source "$work/square.hdr"
    expect 1 'cross.hdr: 48x64 .*--layout vcross' "${render[@]}" --source "$work/cross.hdr"
    expect 1 '48x64 does not fit the layout hcross' "${render[@]}" --source "$work/cross.hdr" --layout hcross
    expect 2 "'mercator' is unknown" "${render[@]}" --source "$work/cross.hdr" --layout mercator
    "${render[@]}" --source "$work/cross.hdr" --layout vcross
}

"$1"
