#!/usr/bin/env bash
# The tests of `./test --long`: minutes to hours. RELIGHT_SOURCE and RELIGHT_BUILD name the folders; each sanitizer
# has its own build below the latter, kept for the next run.
. "$(dirname "$0")/../integration/lib.sh"
here="$(dirname "$(readlink -f "$0")")"
source=${RELIGHT_SOURCE:?} build=${RELIGHT_BUILD:?}

sanitized() { # sanitized NAME CMAKE-ARGUMENTS...: configured and built in $build/NAME
    local name=$1
    shift
    local generator=()
    [ -f "$build/$name/CMakeCache.txt" ] || generator=(-G Ninja)
    cmake -S "$source" -B "$build/$name" "${generator[@]}" -DCMAKE_BUILD_TYPE=Debug -Wno-dev --log-level=WARNING "$@"
}

no_sanitizer_of_addresses_speaks() {
    sanitized addresses -DRELIGHT_SANITIZE=ON -DCMAKE_C_FLAGS_DEBUG="-O1 -g1"
    cmake --build "$build/addresses" >"$work/log" || { tail -n 40 "$work/log"; fail "it does not build"; }
    ctest --test-dir "$build/addresses" -j2 -LE long -E '^(checks|package|bench|chart|references|browser)' \
        --timeout 3000 --output-on-failure | tail -n 60
}

an_hour_of_random_clients_finds_nothing() {
    sanitized addresses -DRELIGHT_SANITIZE=ON -DCMAKE_C_FLAGS_DEBUG="-O1 -g1"
    cmake --build "$build/addresses" --target relightd relight-decoder >"$work/log" || { tail -n 40 "$work/log"; fail "it does not build"; }
    RELIGHT_BIN=$build/addresses/bin RELIGHT_SANITIZED=1 python3 -B "$here/../model/model.py" --seconds 3600
}

no_race_is_found_under_load() {
    command -v clang-14 >/dev/null || { echo "skipped: clang-14 is not installed"; exit 77; }
    sanitized threads -DCMAKE_C_COMPILER=clang-14 -DRELIGHT_SANITIZE=thread -DCMAKE_C_FLAGS_DEBUG="-O1 -g1"
    cmake --build "$build/threads" --target relightd load >"$work/log" || { tail -n 40 "$work/log"; fail "it does not build"; }
    cp -f "$build/bin/relight-decoder" "$build/threads/bin/" # it has one thread, and its filter lets no sanitizer work
    # Archer informs ThreadSanitizer of OpenMP's barriers.
    local archer
    archer=$(find /usr/lib/llvm-14/lib -name 'libarcher.so' | head -n 1)
    [ -n "$archer" ] || { echo "skipped: libomp-14-dev has no Archer here"; exit 77; }
    export OMP_TOOL_LIBRARIES=$archer ARCHER_OPTIONS=verbose=0
    export TSAN_OPTIONS="ignore_noninstrumented_modules=1 suppressions=$here/tsan.supp log_path=$work/race exitcode=0"
    export RELIGHT_BIN=$build/threads/bin RELIGHT_SANITIZED=1
    "$build/threads/bin/load" || fail "fifty viewers"
    local suite
    for suite in a_handshake b_frames c_protocol d_images e_clients; do
        python3 -B "$here/$suite.py" || fail "$suite"
    done
    cat "$work"/race* 2>/dev/null | head -n 100
    [ -z "$(find "$work" -name 'race*' -size +0)" ] || fail "races"
}

a_million_frames_leave_memory_as_it_was() {
    /usr/bin/python3 -B "$here/soak.py" "${RELIGHT_SOAK:-1000000}"
}

a_hundred_thousand_connections_come_and_go() {
    RELIGHT_CYCLES=${RELIGHT_CYCLES:-100000} \
        /usr/bin/python3 -B "$here/f_host.py" F92_connections_that_come_and_go
}

fuzzers_look_for_ten_minutes_each() {
    command -v clang-14 >/dev/null || { echo "skipped: clang-14 is not installed"; exit 77; }
    "$source/tests/fuzz/run.sh" "${RELIGHT_FUZZ_S:-600}" "$build/fuzz"
}

two_hundred_viewers_beside_nginx() {
    local unpacked=$build/tools/usr/sbin/nginx # by `./test --long`
    [ -n "${RELIGHT_NGINX:-}" ] || [ ! -x "$unpacked" ] || export RELIGHT_NGINX=$unpacked
    [ -n "${RELIGHT_NGINX:-}" ] || command -v nginx >/dev/null || { echo "skipped: nginx is not installed"; exit 77; }
    /usr/bin/python3 -B "$here/crowd.py"
}

five_hundred_hls_clients_beside_one() {
    RELIGHT_TOOLS=$build/tools /usr/bin/python3 -B "$here/../deploy/hls_crowd.py"
}

"$@"
