#!/usr/bin/env bash
# Instances of a tree (forest.py) against copies of it: the same picture, and a fraction of the memory.
. "$(dirname "$0")/lib.sh"
forest=$(dirname "$(readlink -f "$0")")/forest.py

# value KEY: that value of the JSON object on standard input.
value() {
    grep -oE "\"$1\": [^,}]*" | cut -d' ' -f2
}

# picture NAME SCENE [FLAG ...]
picture() {
    "$bin/relight-render" --scene "$work/$2.glb" --source sky:time=10:00 --size 96x54 --out "$work/$1.exr" "${@:3}" 2>"$work/$1.log" ||
        fail "$1: $(cat "$work/$1.log")"
}

# Mirrored and stretched trees, whose trunks have normal maps, leaves masks and lamps emissive textures. Only points
# that see another leaf by rounding get other random numbers; a picture of another seed has them everywhere.
instances_look_as_copies_do() {
    local flags=(--samples 32 --tune lamp-samples=16 --paths direct) error noise
    /usr/bin/python3 -B "$forest" "$work/shared.glb" 12 4000
    /usr/bin/python3 -B "$forest" "$work/copied.glb" 12 4000 copies
    picture shared shared "${flags[@]}"
    picture copied copied "${flags[@]}"
    picture other copied "${flags[@]}" --seed 9
    "$bin/relight-diff" "$work/shared.exr" "$work/copied.exr" --max-mean 0.005 --json >"$work/json" || fail "$(cat "$work/json")"
    error=$(value rel_mse_trimmed <"$work/json")
    noise=$("$bin/relight-diff" "$work/other.exr" "$work/copied.exr" --json | value rel_mse_trimmed)
    echo "relMSE $error, of noise alone $noise"
    awk -v e="$error" -v n="$noise" 'BEGIN { exit !(e < 0.6 * n) }' || fail "relMSE $error, of noise alone $noise"
}

# 400 trees of 20,000 triangles: copies take more than 1 GB.
instances_take_no_memory_for_geometry() {
    local peak
    if grep -qa __asan_init "$bin/relight-render"; then
        echo 'skipped: a sanitizer needs memory of its own'
        exit 77
    fi
    /usr/bin/python3 -B "$forest" "$work/many.glb" 400 20000
    peak=$(/usr/bin/python3 -c 'import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=2)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024)' "$bin/relight-render" --scene "$work/many.glb" \
        --source sky:time=10:00 --size 96x54 --samples 1 --tune lamp-samples=1 --paths direct --out "$work/many.exr" 2>"$work/log") ||
        fail "$(cat "$work/log")"
    echo "$peak MB at most"
    [ "$peak" -lt 300 ] || fail "$peak MB"
}

"$1"
