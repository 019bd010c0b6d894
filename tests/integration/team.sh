#!/usr/bin/env bash
# Pictures that all ranks of an MPI job light together: relight-render --split-frames, and relightd.
. "$(dirname "$0")/lib.sh"
begin_jobs
small=(--source sky:size=64x32,time=09:00,speed=20 --size 64x36 --frames 0-1)
# A box with narrow lobes, whose cache is made in a second.
box_scene .
sed -i 's/"exponent": 60/"exponent": 600/; s/degrees": 40/degrees": 110/' box.json
box=(--scene box.json "${small[@]}" --size 160x90 --method cached --cache-dir cache)

# 1 to 4 ranks, of one thread or two; eye paths of the ring's mirror and glass are dealt too.
parts_of_all_methods_have_the_bits_of_one_process() {
    local methods=(auto mis faces-uniform faces brdf uniform light)
    for k in "${!methods[@]}"; do
        local method=${methods[k]} ranks=$((k % 4 + 1))
        "$render" "${small[@]}" --samples 4 --method "$method" --out "one/$method.%d.exr"
        job $ranks "${small[@]}" --samples 4 --method "$method" --out "many/$method.%d.exr" --split-frames --threads $((k % 2 + 1)) 2>log
        [ $ranks = 1 ] || grep -q "2 images by $ranks ranks, 1 of them ordered early" log || { cat log; fail "$method was not dealt"; }
    done
    same_files
}

# Ranks compute the cache together, keep what their packets need, and store the file of one process.
ranks_share_the_memory_of_the_cache_and_of_the_points() {
    local frames=(--frames 0-15) # after 12, shares are settled and memory is freed
    "$render" "${box[@]}" "${frames[@]}" --out one/%d.exr --stats one.json
    job 4 "${box[@]}" "${frames[@]}" --cache-dir joint --out many/%d.exr --split-frames 2>log
    same_files
    cmp cache/*.transport joint/*.transport || fail "the ranks have computed another cache"
    local most
    most=$(sed -n 's/.*at most \([0-9.]*\) MB on another.*/\1/p' log)
    python3 - one.json "$most" <<'PY'
import json, sys
one = json.load(open(sys.argv[1]))[0]
whole = 1e-6 * (one["gbuffer"]["bytes"] + one["cache"]["bytes"] + one["interreflection"]["bytes"])
share = float(sys.argv[2]) / whole  # parts of so small a picture have much of their own
assert 0.45 < share < 0.7, f"one of 4 ranks keeps {share:.2f} of the {whole:.1f} MB of one process"
PY
}

# The cache without its texels goes to others in a few KB; narrow lobes, and indirect light of their matte parts, stay right.
parts_by_the_cache_have_the_bits_of_one_process() {
    "$render" "${box[@]}" --out one/%d.exr
    for ranks in 2 3 4; do
        job $ranks "${box[@]}" --out many/%d.exr --split-frames 2>log
        same_files
        # Four ranks find that too many packets have narrow lobes for rank 0 to light them all, and get the faces.
        [ $ranks = 4 ] || grep -Eq "2 images by $ranks ranks, 1 of them ordered early: [12][0-9]\.[0-9] KB to each rank" log || { cat log; fail "more of the sky was sent"; }
        rm many/*
    done
    # Eye paths need all faces of the sky; its sun moves, and texels are bright in one picture and not in the next.
    rm one/*
    local moving=("${box[@]}" --source sky:size=64x32,time=09:00,speed=1440 --frames 22-25 --indirect eye)
    "$render" "${moving[@]}" --out one/%d.exr
    job 2 "${moving[@]}" --out many/%d.exr --split-frames 2>log
    same_files
}

what_ranks_cannot_light_is_refused_by_name() {
    expect 2 'does not work with --method path' job 2 "${small[@]}" --method path --samples 1 --out many/%d.exr --split-frames
    expect 2 'does not work with --method latlong' job 2 "${small[@]}" --method latlong --samples 1 --out many/%d.exr --split-frames
    expect 2 'cannot be used with --denoise' job 2 "${small[@]}" --denoise --out many/%d.exr --split-frames
    expect 2 'cannot be used with --fps or --error' job 2 "${small[@]}" --fps 1 --out many/%d.exr --split-frames
    expect 2 'cannot be used with a ground' job 2 "${small[@]}" --ground --out many/%d.exr --split-frames
    [ -z "$(ls many)" ] || fail "pictures were written"
}

# A server on three ranks: its pictures, to the bit those of one process that rounds alike. A rank that is killed ends it; started again,
# it has the stored cache, and shows the same picture.
a_live_job_shows_the_pictures_of_one_process() {
    local flags=(--scene box.json --source sky:size=64x32,time=09:00,speed=0 --size 160x90 --port 0 --converge off --cache-dir cache --part-floats half --exposure 0)
    "$render" "${box[@]}" --out one/%d.exr 2>log # makes the cache
    local which launcher status=0 victims
    for which in one many again; do
        local words=(mpirun --oversubscribe -n 3 "$bin/relightd")
        [ $which != one ] || words=("$bin/relightd" --method cached --samples 64 --cache-wait)
        timeout 1200 "${words[@]}" "${flags[@]}" 2>$which.log & # ends a hang
        launcher=$!
        waits 'listening on' $which.log $launcher
        timeout 600 "$bin/relight-record" --from "$(sed -n 's/.*listening on http/ws/p' $which.log)" --once --quiet --out $which.exr 2>>$which.log || { cat $which.log; fail "no picture of $which"; }
        mapfile -t victims < <(pgrep -P "$(pgrep -P $launcher)")
        if [ $which = many ]; then
            [ ${#victims[@]} = 3 ] || fail "not three ranks"
            kill -9 "${victims[1]}"
            wait $launcher || status=$?
            [ $status != 0 ] || fail "the job ended well without a rank"
            grep -q 'exited on signal 9' many.log || { cat many.log; fail "mpirun does not say which rank"; }
        else
            [ $which = one ] && victims=($launcher)
            kill "${victims[0]}" # of a job, rank 0: mpirun would not wait for its report
            wait $launcher || true
        fi
    done
    cmp one.exr many.exr || fail "other pictures"
    cmp one.exr again.exr || fail "other pictures after the restart"
    grep -q 'light transport: loaded in' again.log || { cat again.log; fail "the cache was computed again"; }
    # 100 KB to each rank, whatever the size; 5.6 MB from all at 1280x720
    awk '/to each rank and/ { sub(/.*early: /, ""); seen = 1; exit !($1 <= 100 && $7 <= 5.6 * 160 * 90 / (1280 * 720)) } END { if (!seen) exit 1 }' again.log ||
        { cat again.log; fail "too many bytes a picture"; }
}

# While a picture is lit, the next frame goes out already; the pictures stay those of one process.
a_live_job_orders_frames_early() {
    local flags=(--source sky:size=64x32,time=09:00,speed=60 --size 64x36 --rate 0 --fps 240 --port 0 --converge off --method mis --samples 4 --part-floats half --exposure 0)
    local which launcher victim
    for which in one many; do
        local words=(mpirun --oversubscribe -n 3)
        [ $which = many ] || words=()
        timeout 1200 "${words[@]}" "$bin/relightd" "${flags[@]}" 2>$which.log & # ends a hang
        launcher=$!
        waits 'listening on' $which.log $launcher
        timeout 600 "$bin/relight-record" --from "$(sed -n 's/.*listening on http/ws/p' $which.log)" --frames 30 --quiet --out $which/%d.exr 2>>$which.log || { cat $which.log; fail "no pictures of $which"; }
        victim=$launcher
        [ $which = one ] || victim=$(pgrep -P "$(pgrep -P $launcher)" | head -n 1) # rank 0: mpirun would not wait for its report
        kill "$victim"
        wait $launcher || true
    done
    grep -Eq 'images by 3 ranks, [1-9][0-9]* of them ordered early' many.log || { cat many.log; fail "no frame went out early"; }
    local file same=0
    for file in one/*.exr; do
        [ ! -e "many/${file#one/}" ] || { cmp "$file" "many/${file#one/}"; same=$((same + 1)); }
    done
    [ $same -ge 10 ] || fail "only $same pictures of both"
}

"$1"
