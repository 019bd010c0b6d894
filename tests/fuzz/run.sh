#!/bin/bash
# Builds the fuzzers with clang and runs each for SECONDS: tests/fuzz/run.sh [SECONDS=60] [BUILD FOLDER=build/fuzz]
# Findings are stored in BUILD FOLDER/found, and the exit code is 1.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
root="$(dirname "$(dirname "$here")")"
seconds="${1:-60}"
build="${2:-$root/build/fuzz}"

mapfile -t parsers < <(sed -n 's/^ *fuzz(\([a-z0-9_]*\) .*/\1/p' "$here/CMakeLists.txt")
generator=()
[[ -f "$build/CMakeCache.txt" ]] || generator=(-G Ninja)
cmake -S "$root" -B "$build" "${generator[@]}" -DCMAKE_C_COMPILER=clang-14 -Wno-dev --log-level=WARNING
cmake --build "$build" --target "${parsers[@]/#/fuzz_}" >"$build/log" || { cat "$build/log"; exit 1; }
mkdir -p "$build/found"
for parser in "${parsers[@]}"; do
    fresh="$(mktemp -d)"
    options=(-max_total_time="$seconds" -max_len=8192 -rss_limit_mb=2048 -artifact_prefix="$build/found/$parser-"
        -print_final_stats=1)
    [[ -f "$here/$parser.dict" ]] && options+=(-dict="$here/$parser.dict")
    if ! "$build/bin/fuzz_$parser" "${options[@]}" "$fresh" "$here/corpus/$parser" 2>"$build/found/$parser.log"; then
        tail -n 40 "$build/found/$parser.log"
        echo "$parser: a fault was found; its input is in $build/found"
        exit 1
    fi
    echo "$parser: $(sed -n 's/^stat::number_of_executed_units: *//p' "$build/found/$parser.log") runs in $seconds s, no fault"
    rm -rf "$fresh"
done
