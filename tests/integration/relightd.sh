#!/usr/bin/env bash
# relightd for its operator: start, messages, shutdown.
. "$(dirname "$0")/lib.sh"

# A server that outlives a failed test would hold ctest's pipe, and ctest would wait for it.
pid=
trap '[ -z "$pid" ] || kill "$pid" 2>/dev/null || true; rm -rf "$work"' EXIT

# start ARGUMENTS...: starts a small server on a free port; sets $url, $port and $pid once it listens.
start() {
    : >"$work/log"
    "$bin/relightd" --port 0 --size 64x36 --samples 4 "$@" 2>"$work/log" &
    pid=$!
    waits '^relightd: listening on ' "$work/log" "$pid"
    url=$(sed -n 's/^relightd: listening on //p' "$work/log")
    port=${url##*:}
    port=${port%/}
}

# stop: sends SIGTERM; $code is the exit code.
stop() {
    kill -TERM "$pid"
    code=0
    wait "$pid" || code=$?
    pid=
}

# says PATTERN: waits for a matching line in the log.
says() { waits "$1" "$work/log" "$pid"; }

# get PATH: status line, headers and body of one HTTP request.
get() {
    exec 9<>"/dev/tcp/127.0.0.1/$port"
    printf 'GET %s HTTP/1.1\r\nHost: 127.0.0.1:%s\r\nConnection: close\r\n\r\n' "$1" "$port" >&9
    timeout 600 cat <&9 || true # ends a hang
    exec 9>&-
}

the_page_and_its_health_are_served() {
    start --source sky:size=128x64
    get / >"$work/page"
    grep -q '200 OK' "$work/page" || { cat "$work/page"; fail "no page"; }
    grep -q '<canvas' "$work/page" || fail "the page has no canvas"
    get /app.js >"$work/page" && grep -q import "$work/page" || fail "no module"
    get /healthz >"$work/page" && grep -q '200 OK' "$work/page" || fail "no /healthz"
    get /../../etc/passwd >"$work/page"
    if grep -q 'root:' "$work/page"; then fail "files outside of the page are served"; fi
    stop
    [ "$code" = 0 ] || { cat "$work/log"; fail "exit code $code"; }
}

# SIGTERM ends it with code 0, whatever it is doing.
sigterm_ends_it_with_code_0() {
    local i
    for i in 0 0.3 1.1; do
        start --source sky:size=128x64,speed=60
        sleep $i
        stop
        [ "$code" = 0 ] || { cat "$work/log"; fail "exit code $code after $i s"; }
        grep -q 'stopped' "$work/log" || fail "it did not say that it stopped"
    done
}

a_port_in_use_is_said_before_the_long_work() {
    start --source sky:size=128x64
    expect 1 "port $port.*in use" "$bin/relightd" --port "$port" --size 16x9
    stop
}

an_address_of_the_world_is_refused() {
    expect 2 '0\.0\.0\.0' "$bin/relightd" --bind 0.0.0.0 --port 0 --size 16x9
}

bad_usage_and_input_end_it_with_one_line() {
    expect 2 "unknown flag" "$bin/relightd" --prot 3
    expect 2 "'0'" "$bin/relightd" --fps 0
    expect 2 "--method .mlt. is not available here" "$bin/relightd" --method mlt
    expect 2 "'mist'" "$bin/relightd" --method mist
    expect 1 'nowhere' "$bin/relightd" --port 0 --size 16x9 --source "$work/nowhere/%d.exr"
    expect 1 'nowhere.json' "$bin/relightd" --port 0 --size 16x9 --scene "$work/nowhere.json"
    [ "$(wc -l <"$work/stderr")" = 1 ] || { cat "$work/stderr"; fail "more than one line"; }
}

a_bad_frame_is_reported_and_the_server_goes_on() {
    constant_sky "$work/sky.0.hdr"
    echo 'broken' >"$work/sky.1.hdr"
    constant_sky "$work/sky.2.hdr"
    start --source "$work/sky.%d.hdr" --rate 20
    says 'sky.1.hdr'
    kill -0 "$pid" || fail "it died"
    get /healthz >"$work/page" && grep -q '200 OK' "$work/page" || fail "it is not healthy any more"
    stop
    [ "$code" = 0 ] || fail "exit code $code"
}

light_transport_is_computed_beside_the_pictures_and_kept() {
    start --method cached --size 32x18 --source sky:size=128x64
    says 'in the background'
    says 'a coarse version is ready after'
    says 'indirect light: computed in'
    says 'light transport: computed in'
    says 'light transport and indirect light: kept in'
    stop
    [ "$code" = 0 ] || fail "exit code $code"
    start --method cached --size 32x18 --source sky:size=128x64
    says 'loaded in'
    stop
    [ "$code" = 0 ] || fail "exit code $code"
    if grep -q 'computing light\|computed in' "$work/log"; then fail "computed again"; fi
}

# A second signal would kill it; one suffices, whatever is under way, and a partial cache is not stored.
a_signal_ends_it_while_light_transport_is_computed() {
    local i
    for i in 0 0.7; do
        start --method cached --size 640x360 --source sky:size=128x64
        sleep $i
        stop
        [ "$code" = 0 ] || { cat "$work/log"; fail "exit code $code after $i s"; }
        if grep -q 'computed in' "$work/log"; then fail "it was waited for"; fi
    done
    [ ! -e "$XDG_CACHE_HOME/relightd" ] || fail "something was kept"
}

who_wants_to_wait_for_light_transport_waits() {
    start --method cached --cache-wait --cache-file off --size 32x18 --source sky:size=128x64
    grep -q 'the first frame waits for it' "$work/log" || { cat "$work/log"; fail "it does not wait"; }
    stop
    [ "$code" = 0 ] || fail "exit code $code"
}

light_transport_that_is_too_large_leaves_the_pictures_to_auto() {
    start --method cached --cache-memory 1 --size 160x90
    says 'needs about .* MB, more than the limit of 1: .*auto samples the light instead'
    get /healthz >"$work/page" && grep -q '200 OK' "$work/page" || fail "it did not go on"
    stop
    [ "$code" = 0 ] || fail "exit code $code"
}

"$1"
