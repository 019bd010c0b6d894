#!/usr/bin/env bash
# relight-render as an MPI job: several processes share out the frames of a sequence.
root=$(cd "$(dirname "$0")/../.." && pwd)
. "$(dirname "$0")/lib.sh"
begin_jobs
small=(--source sky:size=64x32,time=09:00,speed=20 --size 64x36)

frames_of_all_methods_have_the_bits_of_one_process() {
    local methods=(auto mis faces brdf path) tiny=("${small[@]}" --size 32x18 --frames 0-6 --samples 2)
    for k in 0 1 2 3 4; do
        "$render" "${tiny[@]}" --method "${methods[k]}" --out "one/${methods[k]}.%02d.exr"
        job $((k % 3 + 2)) "${tiny[@]}" --method "${methods[k]}" --out "many/${methods[k]}.%02d.exr"
    done
    same_files
}

# All light, by a cache that all ranks compute together, whose file is that of one process; exposure is that of frame 0 on all ranks.
cached_light_and_exposure_are_those_of_one_process() {
    box_scene .
    "$render" "${small[@]}" --scene box.json --frames 0-5 --method cached --cache-dir cache1 --out one/%d.jpg
    job 3 "${small[@]}" --scene box.json --frames 0-5 --method cached --cache-dir cache3 --out many/%d.jpg
    same_files
    cmp cache1/*.transport cache3/*.transport || fail "the ranks have computed another cache"
}

statistics_are_joined_in_order_of_frames() {
    job 3 "${small[@]}" --frames 5-24 --samples 1 --out many/%d.exr --stats many/stats.json
    python3 - many/stats.json <<'PY'
import json, sys
frames = [entry["frame"] for entry in json.load(open(sys.argv[1]))]
assert frames == list(range(5, 25)), frames
PY
}

# Whoever is killed, and whenever: what is there is whole, and --resume makes what is missing, once.
a_killed_rank_loses_nothing_that_is_complete() {
    local frames=(--frames 0-23 --samples 16 --size 128x72 --source sky:size=64x32,time=09:00,speed=5)
    "$render" "${frames[@]}" --out one/%02d.exr
    RANDOM=25 # the same places in each run
    local modes=("" --split-frames --collect)
    for round in $(seq 0 $(($(count 1 20) - 1))); do
        rm -f many/*
        local mode=${modes[round % 3]} victims=()
        mpirun --oversubscribe -n 3 "$render" "${frames[@]}" $mode --out many/%02d.exr 2>/dev/null &
        local launcher=$! want=$((RANDOM % 15)) before
        while { [ ${#victims[@]} -lt 3 ] || [ "$(find many -name '*.exr' | wc -l)" -lt "$want" ]; } && kill -0 $launcher 2>/dev/null; do
            sleep 0.02
            mapfile -t victims < <(pgrep -P $launcher)
        done
        sleep "0.0$((RANDOM % 6))"
        kill -9 "${victims[RANDOM % 3]}" 2>/dev/null || true
        if wait $launcher; then fail "the job ended well without a rank"; fi
        before=$(find many -name '*.exr' | wc -l)
        for file in $(find many -name '*.exr'); do cmp "$file" "one/${file#many/}"; done
        job 3 "${frames[@]}" $mode --out many/%02d.exr --resume --stats stats.json 2>log
        [ "$before" = 0 ] || grep -q "$before existing images are kept, $((24 - before)) are new" log || { cat log; fail "not $before kept"; }
        [ "$(grep -c '"frame"' stats.json)" = $((24 - before)) ] || fail "statistics of other frames than the new ones"
        rm -f many/*.part
        same_files
    done
}

# Rank 0 alone sees the folder: others have one of their own, which stays empty.
rank_0_collects_the_pictures_of_all() {
    local flags=(--source sky:size=64x32,time=09:00,speed=20 --size 64x36 --samples 1 --frames 3-14 --collect)
    cat >rank.sh <<RUN
#!/bin/sh
[ "\$OMPI_COMM_WORLD_RANK" = 0 ] || cd elsewhere
exec "$render" "\$@"
RUN
    chmod +x rank.sh
    mkdir elsewhere
    for ending in exr jpg; do
        "$render" "${flags[@]}" --out one/%02d.$ending
        mpirun --oversubscribe -n 3 ./rank.sh "${flags[@]}" --out many/%02d.$ending --stats many.json
        same_files
    done
    python3 -c 'import json; assert [e["frame"] for e in json.load(open("many.json"))] == list(range(3, 15))'
    rm many/05.exr many/11.exr
    echo kept >many/09.exr
    mpirun --oversubscribe -n 3 ./rank.sh "${flags[@]}" --out many/%02d.exr --resume 2>log
    grep -q '10 existing images are kept, 2 are new' log || { cat log; fail "other pictures were kept"; }
    [ "$(cat many/09.exr)" = kept ] || fail "a picture was replaced"
    cp one/09.exr many/
    same_files
    [ -z "$(ls elsewhere)" ] || fail "another rank wrote"
    expect 2 '--collect cannot be used with --layers' job 2 "${flags[@]}" --layers --out many/%02d.exr
}

# The thread that looks into MPI looks often only until a posted picture has been sent.
a_collected_picture_leaves_the_keeper_calm() {
    local library
    library=$(find "$bin/.." -name libkeeper_pauses.so | head -1)
    [ -n "$library" ] || fail "no libkeeper_pauses.so beside $bin"
    mpirun --oversubscribe -n 2 -x LD_PRELOAD="$library" "$render" --source sky:size=64x32,time=09:00,speed=5 --size 128x72 --samples 32 --frames 0-11 \
        --collect --out many/%02d.exr 2>log
    grep -q 'keeper: calm after a post' log || { cat log; fail "the keeper looks as often as before"; }
}

# mpirun passes the signal on; what is there is whole.
a_job_that_is_told_to_end_ends_and_can_be_resumed() {
    local frames=(--frames 0-99 --samples 16 --size 128x72 --source sky:size=64x32,time=09:00,speed=5) status=0
    mpirun --oversubscribe -n 2 "$render" "${frames[@]}" --out many/%02d.exr 2>log &
    local launcher=$!
    while [ "$(find many -name '*.exr' | wc -l)" -lt 3 ] && kill -0 $launcher 2>/dev/null; do sleep 0.02; done
    kill -TERM $launcher
    wait $launcher || status=$?
    [ $status != 0 ] || fail "the job ended as if it were complete"
    local before
    before=$(find many -name '*.exr' | wc -l)
    [ "$before" -lt 100 ] || fail "it went on to the end"
    for file in many/*.exr; do "$bin/relight-diff" "$file" "$file" >/dev/null || fail "$file is not whole"; done
    "$render" "${frames[@]}" --frames 0-"$before" --out many/%02d.exr --resume 2>log
    grep -q 'existing images are kept' log || { cat log; fail "nothing was kept"; }
}

# The command of docs/clusters.md, with smaller and fewer pictures.
the_documented_job_renders_its_sequence() {
    local command
    command=$(sed -n 's/^    \(mpirun -n 2 build\/bin\/relight-render .*\)/\1/p' "$root/docs/clusters.md" | head -1)
    [ -n "$command" ] || fail "no command in docs/clusters.md"
    mkdir -p build pictures
    ln -s "$bin" build/bin
    OMPI_MCA_rmaps_base_oversubscribe=1 bash -c "$command --size 64x36 --frames 0-6"
    [ "$(ls pictures | tr '\n' ' ')" = "$(printf '%03d.exr ' 0 1 2 3 4 5 6)" ] || fail "other pictures: $(ls pictures)"
}

# Job scripts with a stand-in for srun, which notes the frames, or fails twice.
slurm_jobs_cover_each_frame_once_and_start_again() {
    local k status=0
    mkdir path
    cat >path/srun <<'RUN'
#!/bin/sh
echo "$*" >>srun.log
[ -z "${FAIL:-}" ] || [ "$(wc -l <srun.log)" -gt 2 ] || exit 9
RUN
    chmod +x path/srun
    for k in 3 4 5 6; do # of an array that does not begin at 0
        PATH=$work/path:$PATH SLURM_ARRAY_TASK_ID=$k SLURM_ARRAY_TASK_MIN=3 SLURM_ARRAY_TASK_MAX=6 sh "$root/deploy/slurm-frames.sh" 5 14 --out x.exr
    done
    [ "$(sed -n 's/.*--frames \([0-9-]*\) --resume --out x.exr$/\1/p' srun.log | tr '\n' ' ')" = "5-6 7-9 10-11 12-14 " ] || { cat srun.log; fail "other frames"; }
    expect 2 'usage: sbatch --array' sh "$root/deploy/slurm-frames.sh" 5
    rm srun.log
    FAIL=1 PATH=$work/path:$PATH sh "$root/deploy/slurm-live.sh" --size 64x36 2>log || status=$?
    [ "$status:$(wc -l <srun.log)" = 0:3 ] || { cat log; fail "status $status after $(wc -l <srun.log) starts"; }
    grep -q 'ended with status 9 and starts again' log || fail "the script does not say why it starts again"
}

resume_works_alone_and_keeps_what_is_there() {
    "$render" "${small[@]}" --frames 0-3 --samples 1 --out one/%d.exr
    echo kept >many/1.exr
    expect 0 '1 existing images are kept, 3 are new' "$render" "${small[@]}" --frames 0-3 --samples 1 --out many/%d.exr --resume
    [ "$(cat many/1.exr)" = kept ] || fail "a picture was replaced"
    cp one/1.exr many/
    same_files
}

what_cannot_be_shared_is_refused_by_rank_0() {
    expect 2 'a video, or standard output, holds all frames in order' job 2 "${small[@]}" --frames 0-3 --out a.mp4
    [ "$(grep -c relight-render stderr)" = 1 ] || { cat stderr; fail "more than one rank speaks"; }
    expect 2 'which makes each image depend on earlier ones' job 2 "${small[@]}" --frames 0-3 --exposure follow --out %d.jpg
    expect 2 'frames can be taken in any order.*not watch:' job 2 --source watch:. --out %d.exr
    expect 2 '--probe is for one process' job 2 "${small[@]}" --frames 0-3 --probe 1,1
    expect 2 'a video, or standard output, holds all frames in order' "$render" "${small[@]}" --frames 0-3 --resume --out a.mp4
    expect 2 '--resume needs --out' "$render" "${small[@]}" --frames 0-3 --resume --probe 1,1
}

# As on hosts that differ: other flags, another CPU level, another build.
ranks_that_differ_are_refused_by_name() {
    local flags=("${small[@]}" --frames 0-3 --samples 1 --out many/%d.exr)
    if grep -q -m1 avx2 /proc/cpuinfo; then # else there is the baseline only
        expect 2 'rank 0 on .* would use CPU level v[34] and rank 1 on .* baseline.*add --cpu baseline' \
            mpirun --oversubscribe -n 1 "$render" "${flags[@]}" : -n 1 "$render" "${flags[@]}" --cpu baseline
    fi
    expect 2 'rank 1 has other flags than rank 0' mpirun --oversubscribe -n 1 "$render" "${flags[@]}" : -n 1 "$render" "${flags[@]}" --seed 3
    cp "$render" relight-render
    ln -s "$bin"/relight-* . 2>/dev/null || true
    printf 'x' >>relight-render
    expect 2 'different builds of relight-render' mpirun --oversubscribe -n 1 "$render" "${flags[@]}" : -n 1 ./relight-render "${flags[@]}"
    [ -z "$(ls many)" ] || fail "pictures were written"
}

an_mpi_without_threads_is_refused_by_rank_0() {
    local library
    library=$(find "$bin/.." -name libone_thread.so | head -1)
    [ -n "$library" ] || fail "no libone_thread.so beside $bin"
    expect 1 'this MPI does not allow calls from several threads .MPI_THREAD_MULTIPLE.' \
        mpirun --oversubscribe -n 2 -x LD_PRELOAD="$library" "$render" "${small[@]}" --frames 0-3 --out many/%d.exr
    [ "$(grep -c 'error:' stderr)" = 1 ] || { cat stderr; fail "more than one rank speaks"; }
    [ -z "$(ls many)" ] || fail "pictures were written"
}

# Each rank in a network of its own, as on hosts that TCP joins: frames, parts and the cache of both.
ranks_on_several_hosts_have_the_bits_of_one_process() {
    [ "$(id -u)" = 0 ] && [ -w /dev/net/tun ] && command -v ip tc >/dev/null && ip netns list >/dev/null 2>&1 ||
        { echo "skipped: network namespaces need root, ip, tc and /dev/net/tun"; exit 77; }
    box_scene .
    local flags=("${small[@]}" --scene box.json --method cached --frames 0-3)
    "$render" "${flags[@]}" --cache-dir cache1 --out one/%d.exr
    for split in "" --split-frames; do
        "$root/tests/figures/links.py" --hosts 3 --rate 1000 --delay 0.1 -- \
            "$render" "${flags[@]}" --cache-dir "cache3$split" --out many/%d.exr --threads 1 $split
        same_files
        cmp cache1/*.transport cache3$split/*.transport || fail "the ranks have computed another cache"
        rm many/*
    done
}

# What only one rank lacks ends all of them, and is said by that one.
a_file_that_one_rank_cannot_read_is_named_by_it() {
    constant_sky sky.hdr
    mkdir elsewhere
    cat >rank.sh <<RUN
#!/bin/sh
[ "\$OMPI_COMM_WORLD_RANK" != 1 ] || cd elsewhere
exec "$render" --source sky.hdr --size 64x36 --samples 1 --out $work/many/0.exr
RUN
    chmod +x rank.sh
    expect 1 'rank 1 of 3 on .*: error: .*sky.hdr' mpirun --oversubscribe -n 3 ./rank.sh
    grep -q 'rank 0 of 3 on .*: error: rank 1 has failed; all ranks stop' stderr || { cat stderr; fail "rank 0 does not say why it ends"; }
    [ -z "$(ls many)" ] || fail "pictures were written"
}

# A file that may not grow stands for a full disk.
a_full_disk_on_one_rank_ends_all_and_leaves_nothing_half_written() {
    cat >rank.sh <<RUN
#!/bin/bash
[ "\$OMPI_COMM_WORLD_RANK" != 1 ] || { trap '' XFSZ; ulimit -f 4; }
exec "$render" --source sky:size=64x32,time=09:00,speed=20 --size 64x36 --samples 1 --frames 0-199 --out $work/many/%03d.exr
RUN
    chmod +x rank.sh
    expect 1 'rank 1 of 2 on .*: error: .*\.exr: cannot write the file: File too large' mpirun --oversubscribe -n 2 ./rank.sh
    [ "$(find many -name '*.exr' | wc -l)" -lt 200 ] || fail "the other rank went on"
    for file in many/*.exr; do
        "$bin/relight-diff" "$file" "$file" >/dev/null || fail "$file is not whole"
    done
    # Rank 0's disk, while the others light the next picture already.
    sed -i 's/!= 1/!= 0/; s/--samples 1/--samples 1 --split-frames/' rank.sh
    rm many/*
    expect 1 'rank 0 of 2 on .*: error: .*000.exr: cannot write the file: File too large' mpirun --oversubscribe -n 2 ./rank.sh
    [ -z "$(ls many)" ] || fail "pictures were written"
}

"$1"
