#!/usr/bin/env bash
# relight-diff from scripts: numbers with closed forms, bounds, maps, bad input.
. "$(dirname "$0")/lib.sh"

# flat FILE WIDTH HEIGHT MANTISSA: a grey Radiance file of MANTISSA / 128.
flat() {
    local texel
    texel=$(printf '\\x%02x\\x%02x\\x%02x\\x81' "$4" "$4" "$4")
    # shellcheck disable=SC2046,SC2059 # a format that is used once for each of the numbers, and prints none of them
    { printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n' "$3" "$2"; printf "$texel%.0s" $(seq $(($2 * $3))); } >"$1"
}

# value KEY: that value of the JSON object in $work/json.
value() {
    grep -oE "\"$1\": [^,}]*" "$work/json" | cut -d' ' -f2
}

# near GOT WANT: to a thousandth of WANT.
near() {
    awk -v got="$1" -v want="$2" 'BEGIN { d = got - want; if (d < 0) d = -d; exit !(d <= 1e-3 * want) }' || fail "$1 is not $2"
}

# 160/128 against 128/128: ratio 1.25, relMSE 0.0625 / 1.01.
numbers_are_those_of_the_formula() {
    flat "$work/a.hdr" 20 10 160
    flat "$work/b.hdr" 20 10 128
    "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --json >"$work/json"
    near "$(value mean)" 1.25
    near "$(value mean_reference)" 1
    near "$(value mean_ratio)" 1.25
    near "$(value rel_mse)" 0.0618812
    near "$(value rel_mse_trimmed)" 0.0618812
    [ "$(value pixels)" = 200 ] || fail "not 200 pixels"
    "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" | grep -Eq '^luminance +1.25 +1 +1.25000$' || fail "the table"
}

a_picture_equals_itself() {
    flat "$work/a.hdr" 20 10 160
    "$bin/relight-diff" "$work/a.hdr" "$work/a.hdr" --max-mean 0 --max-relmse 0 --max-delta-e 0 --max-flip 0 --json >"$work/json"
    [ "$(value rel_mse)" = 0.0 ] || fail "relMSE $(value rel_mse)"
}

# For greys delta E is the difference of L*, and FLIP 0.95 of its power of 0.7 over 0.4 c_max = 16.5105.
flip_of_greys_follows_from_delta_e() {
    flat "$work/a.hdr" 20 10 160
    flat "$work/b.hdr" 20 10 128
    local e
    for e in 67 20; do
        "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --pixels-per-degree "$e" --json >"$work/json"
        near "$(value flip)" "$(awk -v e="$(value delta_e)" 'BEGIN { print 0.95 * e ^ 0.7 / 16.5105 }')"
    done
    expect 2 'pixels-per-degree' "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --pixels-per-degree 0
}

# 160/128 against halves of 120/128 and 136/128, whose mean is 1: 0.3125 * 0.1875 / 1.01.
halves_of_a_reference_are_multiplied() {
    flat "$work/a.hdr" 20 10 160
    flat "$work/b.hdr" 20 10 120
    flat "$work/c.hdr" 20 10 136
    "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --half "$work/c.hdr" --json >"$work/json"
    near "$(value rel_mse_halves)" 0.0580136
    near "$(value mean_ratio)" 1.25
    near "$(value rel_mse)" 0.0618812
    awk -v f="$(value flip_halves)" 'BEGIN { exit !(f > 0.01) }' || fail "the halves do not differ"
    flat "$work/d.hdr" 10 10 136
    expect 1 'd.hdr is 10x10' "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --half "$work/d.hdr"
}

# Light 1, 1/2, 1 is 255, 188, 255 in sRGB: 255 - 2 * 188 + 255. A missing number interrupts the sequence.
flicker_is_the_second_difference_of_codes() {
    local k=0 mantissa
    for mantissa in 128 64 128 128 64 64; do
        k=$((k + 1))
        [ $k = 4 ] || flat "$work/p.$k.hdr" 20 10 "$mantissa"
    done
    "$bin/relight-diff" --flicker 1-9 "$work/p.%d.hdr" --json >"$work/json"
    [ "$(cat "$work/json")" = '{"triples": 1, "percentiles": {"50": 134, "90": 134, "99": 134, "99.9": 134, "100": 134}}' ] ||
        { cat "$work/json"; fail "not 134 codes"; }
    "$bin/relight-diff" --flicker 1-3 "$work/p.%d.hdr" | grep -q ' 99.9 % at most 134$' || fail "the table"
    expect 1 'no three images in a row' "$bin/relight-diff" --flicker 4-6 "$work/p.%d.hdr"
    expect 2 'a pattern with --flicker' "$bin/relight-diff" --flicker 1-3
}

each_bound_ends_with_1_and_is_named() {
    flat "$work/a.hdr" 20 10 160
    flat "$work/b.hdr" 20 10 128
    local diff=("$bin/relight-diff" "$work/a.hdr" "$work/b.hdr")
    expect 1 'mean ratio off by 0.25 exceeds 0.2' "${diff[@]}" --max-mean 0.2
    expect 1 'relMSE .* 0.06188 exceeds 0.06' "${diff[@]}" --max-relmse 0.06
    expect 1 'delta E.* exceeds 0.5' "${diff[@]}" --max-delta-e 0.5
    expect 1 'FLIP .* exceeds 0.1' "${diff[@]}" --max-flip 0.1
    "${diff[@]}" --max-mean 0.26 --max-relmse 0.062 --max-delta-e 50 --max-flip 1 >"$work/stdout" || fail "bounds that hold"
}

maps_are_written_as_png_and_exr() {
    flat "$work/a.hdr" 200 10 160
    flat "$work/b.hdr" 200 10 128
    local diff=("$bin/relight-diff" "$work/a.hdr" "$work/b.hdr")
    "${diff[@]}" --map "$work/map.png" --json >"$work/json"
    # signature, then the width and the height: 10 rows and a scale of 34
    [ "$(od -An -tx1 -N4 "$work/map.png" | tr -d ' ')" = 89504e47 ] || fail "no PNG"
    [ "$(od -An -tx1 -j16 -N8 "$work/map.png" | tr -d ' ')" = 000000c80000002c ] || fail "not 200 x 44"
    "${diff[@]}" --map "$work/map.exr" --json >"$work/json"
    "$bin/relight-diff" "$work/map.exr" "$work/b.hdr" --json >"$work/json"
    near "$(value mean)" 0.0618812
    expect 1 'missing/map.png' "${diff[@]}" --map "$work/missing/map.png"
    expect 1 'missing/map.exr' "${diff[@]}" --map "$work/missing/map.exr"
}

masked_pixels_are_left_out() {
    flat "$work/a.hdr" 2 1 160
    flat "$work/b.hdr" 2 1 128
    # the second texel differs strongly, and is black in the mask
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\xa0\xa0\xa0\x81\x80\x80\x80\x90' >"$work/a.hdr"
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\x0a\x80\x80\x80\x81\x00\x00\x00\x00' >"$work/mask.hdr"
    "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --mask "$work/mask.hdr" --json >"$work/json"
    [ "$(value pixels)" = 1 ] || fail "not 1 pixel"
    near "$(value mean_ratio)" 1.25
    flat "$work/mask.hdr" 2 1 0
    expect 1 'mask is black' "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --mask "$work/mask.hdr"
    flat "$work/mask.hdr" 3 1 128
    expect 1 'mask.hdr is 3x1' "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr" --mask "$work/mask.hdr"
}

pictures_of_two_sizes_are_refused() {
    flat "$work/a.hdr" 20 10 160
    flat "$work/b.hdr" 10 20 160
    expect 1 'a.hdr is 20x10, but .*b.hdr is 10x20' "$bin/relight-diff" "$work/a.hdr" "$work/b.hdr"
}

bad_files_are_named() {
    flat "$work/a.hdr" 20 10 160
    head -c 300 "$work/a.hdr" >"$work/cut.hdr"
    expect 1 'cut.hdr' "$bin/relight-diff" "$work/a.hdr" "$work/cut.hdr"
    expect 1 'nowhere.exr' "$bin/relight-diff" "$work/nowhere.exr" "$work/a.hdr"
}

wrong_usage_ends_with_2_and_says_why() {
    expect 2 'expected two images' "$bin/relight-diff"
    expect 2 'expected two images' "$bin/relight-diff" a.exr
    expect 2 'unexpected argument' "$bin/relight-diff" a.exr b.exr c.exr
    expect 2 '--trim' "$bin/relight-diff" a.exr b.exr --trim 1.5
    expect 2 '--max-mean' "$bin/relight-diff" a.exr b.exr --max-mean none
    expect 2 "neither in .png nor in .exr" "$bin/relight-diff" a.exr b.exr --map map.tiff
}

"$1"
