#!/usr/bin/env bash
# relight-bench: checks what it measures, not speeds. usage: bench.sh CLAIM
. "$(dirname "$0")/lib.sh"

quick=(--size 32x18 --samples 2 --rounds 3 --particles 2048 --viewers 3 --source sky:size=128x64)

rows='EXR decode
resample, CDFs, samples / copy
shadow rays of the direct stage
shading a sample at a point
rays of the light tracer
tone map / copy
JPEG / libjpeg-turbo
delivery / bare sockets
pipeline / its slowest stage
light: one thread / all
one thread / pipeline
four times the pixels
16 times the triangles
allocations after frame 10
no visibility, 60 samples'

every_row_is_measured_and_its_figures_are_numbers() {
    local threads
    box_scene "$work"
    for threads in 2 1; do
        "$bin/relight-bench" "${quick[@]}" --scene "$work/box.json" --threads $threads --json >"$work/bench.json"
        echo "$rows" | /usr/bin/python3 -c '
import json, math, sys
report, threads, wanted = json.load(open(sys.argv[1])), int(sys.argv[2]), sys.stdin.read().splitlines()
assert [r["name"] for r in report["rows"]] == wanted, [r["name"] for r in report["rows"]]
verdicts = ("holds", "does not hold", "stated")
for r in report["rows"]:
    alone = r["name"].startswith(("shading", "allocations"))
    if threads == 1 and "one thread" in r["name"]: # nothing to compare with
        assert r["verdict"] == "not measured" and r["skipped"], r
        continue
    if r["name"].startswith("allocations") and "allocator of its own" in r.get("skipped", ""):
        continue # with sanitizers
    assert r["verdict"] in verdicts and r["unit"] and r["rounds"] >= 1, r
    for key in ("ours",) if alone else ("ours", "bare", "ratio"):
        assert math.isfinite(r[key]) and (r[key] > 0 or r["name"].startswith("allocations")), r
    if "at_least" in r:
        assert (r["verdict"] == "holds") == (r["ratio"] >= r["at_least"]), r
    elif "at_most" in r:
        assert (r["verdict"] == "holds") == (r["ours" if alone else "ratio"] <= r["at_most"]), r
    else:
        assert r["verdict"] == "stated", r
    if not alone and r["rounds"] == 1: # then the ratio is that of the two figures
        assert abs(r["ratio"] * r["bare"] / r["ours"] - 1) < 1e-3, r
' "$work/bench.json" $threads || fail "with $threads threads"
    done
}

the_table_has_a_line_for_each_row() {
    "$bin/relight-bench" "${quick[@]}" >"$work/table"
    while read -r row; do
        grep -qF -- "$row" "$work/table" || { cat "$work/table"; fail "no line for '$row'"; }
    done <<<"$rows"
    grep -q '^the built-in scene, [0-9]* triangles, sky: frame 0, .* (128x64, 8 frames), 32x18, mis, 2 samples, ' "$work/table" ||
        { cat "$work/table"; fail "no title"; }
    grep -q ' holds$\| does not hold$' "$work/table" || fail "no verdicts"
    expect 1 'No space left on device' sh -c '"$0" "$@" >/dev/full' "$bin/relight-bench" "${quick[@]}"
}

# The user's own scene and sky: decodes the file's own bytes.
files_are_measured_as_they_are() {
    box_scene "$work"
    "$bin/relight-render" --scene "$work/box.json" --source sky:size=64x32 --size 64x32 --samples 1 --out "$work/sky.exr"
    "$bin/relight-bench" "${quick[@]}" --scene "$work/box.json" --scene-fine "$work/box.json" --source "$work/sky.exr" --json \
        >"$work/bench.json"
    grep -q "same $(stat -c %s "$work/sky.exr") bytes" "$work/bench.json" || fail "these were not the file's bytes"
    grep -Eq 'light alone; ([0-9]+) triangles over \1"' "$work/bench.json" || fail "not the fine scene that was given"
}

# A sky that stands still plants a reuse: the cache lights it once. One file is turned, and a moving sky moves.
a_frame_that_is_not_computed_whole_is_refused() {
    box_scene "$work"
    local out
    out=$("$bin/relight-bench" --speed --size 16x9 --rounds 3 --scenes "$work/box.json" \
        --sources "still=sky:size=64x32,speed=0" 2>&1) && fail "a still sky was timed: $out"
    grep -q 'still: refused: [0-9]* % of the frame was computed' <<<"$out" || fail "another error: $out"
}

# One line for each scene, size, CPU level and sky, and one for each scene, size and level.
speed_prints_one_table_of_all_scenes_and_skies() {
    box_scene "$work"
    # captured, without a sun; lit alike all around, it would be refused
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n\x80\x80\x80\x81\x60\x80\x80\x81\x80\x70\x80\x81\x80\x80\x50\x81\x40\x40\x40\x81\x40\x30\x40\x81\x40\x40\x50\x81\x40\x40\x40\x81' >"$work/flat.hdr"
    "$bin/relight-bench" --help | grep -q -- --speed || fail "no --speed in --help"
    "$bin/relight-bench" --speed --cpu v3 --size 16x9 --samples 2 --rounds 3 --scenes "crate=$work/box.json" \
        --sources "noon=sky:size=64x32,hour=12;flat=$work/flat.hdr" >"$work/table"
    [ "$(grep -c '^crate .* noon  *[0-9]' "$work/table")" = 2 ] || { cat "$work/table"; fail "lines of noon"; }
    [ "$(grep -c '^crate .* flat  *[0-9]' "$work/table")" = 2 ] || { cat "$work/table"; fail "lines of flat"; }
    [ "$(grep -c 'precomputation of all light' "$work/table")" = 2 ] || fail "lines of precomputation"
    grep -q '^crate *16x9 .*four times the pixels: .* 16 times the triangles: ' "$work/table" || fail "no growth"
    [ "$(grep -c '^targets at ' "$work/table")" = 2 ] || { cat "$work/table"; fail "lines of targets"; }
    # Each sky of the first size is judged, and none by what was known of the one before.
    python3 -c '
import re, sys
line = r"crate +16x9 +v3 +(noon|flat) +direct light without the sky.s sun; relMSE ([-0-9.e]+); delta E ([0-9.e-]+); % of seams ([0-9.e-]+); second differences in codes ([0-9.e-]+)"
found = dict((m[1], m.groups()[1:]) for m in re.finditer(line, open(sys.argv[1]).read().replace(" >", "")))
assert set(found) == {"noon", "flat"} and found["noon"] != found["flat"], found
for sky, (error, colour, seams, motion) in found.items(): # at this size they need not be small
    assert abs(float(error)) < 1e-3 and 0 <= float(colour) < 1, found
    assert 0 <= float(seams) <= 100, found
    assert 0 <= float(motion) < (4 if sky == "noon" else 1e-2), found
' "$work/table" || { cat "$work/table"; fail "biases"; }
    awk '/^crate.*(noon|flat)/ && !/without the sky.s sun/ { for (k = 5; k <= NF; k++) if ($k !~ /^([<>-]|[0-9.e+-]+)$/) exit 1 }' "$work/table" ||
        { cat "$work/table"; fail "a figure is no number"; }
}

what_it_cannot_measure_is_refused() {
    expect 2 "'path' is not available here" "$bin/relight-bench" --method path
    expect 2 'rounds' "$bin/relight-bench" --rounds 2
    expect 2 'viewers' "$bin/relight-bench" --viewers 65
    expect 1 'nowhere.json' "$bin/relight-bench" --scene "$work/nowhere.json"
}

"$1"
