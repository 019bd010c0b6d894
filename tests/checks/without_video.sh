#!/bin/bash
# without_video.sh RELIGHTD RELIGHT_RENDER, both linked without libavcodec and libavformat: a video as a source and a video
# as output are refused with the reason, and relightd serves without H.264.
set -euo pipefail
relightd=$1 render=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export XDG_CACHE_HOME=$work

fail() {
    echo "FAILED: $*"
    cat "$work/said"
    exit 1
}

refused() { # PATTERN COMMAND...
    local pattern=$1
    shift
    if "$@" >"$work/said" 2>&1; then fail "not refused: $*"; fi
    grep -q "$pattern" "$work/said" || fail "no '$pattern': $*"
}

# What is refused is not offered, by --help, the manual or the completions.
for program in "$relightd" "$render"; do
    for text in '--help all' --print-manual --print-completion-bash --print-completion-zsh --print-completion-fish; do
        # shellcheck disable=SC2086 # two words
        "$program" $text >"$work/said"
        if grep -iE 'h\.?264|video|mp4|rtsp|publish| pq' "$work/said"; then fail "$program $text offers it"; fi
    done
done

touch "$work/sky.mp4"
refused 'this build reads no video' "$relightd" --port 0 --source "$work/sky.mp4"
refused 'this build reads no video' "$render" --source "$work/sky.mp4" --out "$work/a.png"
refused 'this build writes no video' "$render" --size 16x9 --samples 1 --frames 0-0 --out "$work/a.mp4"

"$relightd" --port 0 --size 16x9 --samples 1 --paths direct --frames 0-0 --once >"$work/said" 2>&1 &
server=$!
for _ in $(seq 600); do
    if grep -q 'listening on' "$work/said"; then break; fi
    sleep 0.05
done
kill -TERM $server || fail "relightd does not run"
wait $server || fail "relightd ends with $?"
