#!/usr/bin/env bash
# Holds relight-render to Blender's Cycles, for any scene file of Lambert, mirror and glass.
#     compare.sh SCENE ENVIRONMENT [WIDTHxHEIGHT] [SPP] [--direct] [-- FLAGS OF relight-render]
# Without --direct all paths are compared. Pass: the means differ by at most 0.5 % (1 % where there is a mirror or glass),
# and relMSE without the worst 2 % of pixels, where penumbrae and silhouettes lie, is at most 1e-3 from 1024 samples a
# pixel on, 5e-3 from 256 on, below as much more as there are fewer: most of it is Cycles' own noise. A sun that shines
# through glass or off a mirror is beyond Cycles, and will fail. Exit code: 0 pass, 1 fail, 2 usage, 77 no Blender.
# Pictures by Cycles are kept in RELIGHT_CACHE (~/.cache/relight/cycles) under a hash of all that went into them.
# RELIGHT_BIN names the folder of the programs; left out, that of ./run.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${RELIGHT_BIN:-$here/../../build/bin}"

usage() {
    echo "compare.sh: $1" >&2
    sed -n 's/^#     //p' "$0" >&2
    exit 2
}

operands=() direct=()
while (($#)); do
    case $1 in
    --) shift && break ;;
    --direct) direct=(--direct) ;;
    -*) usage "unknown flag '$1'" ;;
    *) operands+=("$1") ;;
    esac
    shift
done
flags=("$@")
((${#operands[@]} >= 2 && ${#operands[@]} <= 4)) || usage 'a scene and an environment are wanted'
scene=${operands[0]} environment=${operands[1]} size=${operands[2]:-320x180} spp=${operands[3]:-256}
[[ $size =~ ^[0-9]+x[0-9]+$ ]] || usage "'$size' is not WIDTHxHEIGHT"
[[ $spp =~ ^[1-9][0-9]*$ ]] || usage "'$spp' is not a number of samples"
[[ -r $scene ]] || usage "$scene cannot be read"
[[ -r $environment ]] || usage "$environment cannot be read"
if ! command -v blender >/dev/null; then
    echo 'skipped: Blender is not installed (Debian package: blender)'
    exit 77
fi

# The files of a scene's models, one a line.
models() {
    python3 -c 'import json, os, sys
for model in json.load(open(sys.argv[1]))["models"]:
    print(os.path.join(os.path.dirname(sys.argv[1]), model["file"]))' "$scene"
}

# A hash of what the picture depends on: contents, not names, so that a scene may be moved or copied.
digest() {
    {
        cat "$here/cycles.py" "$scene" "$environment"
        models | while IFS= read -r file; do sha256sum <"$file"; done
        blender --version
        echo "$size $spp ${direct[*]-}"
    } | sha256sum | cut -c 1-32
}

cache="${RELIGHT_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/relight/cycles}"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
reference="$cache/$(digest).exr"
if [[ ! -s $reference ]]; then
    mkdir -p "$cache"
    echo "rendering $size at $spp samples with Cycles"
    if ! blender -b -noaudio -P "$here/cycles.py" -- "$scene" "$environment" "$work/cycles.exr" "${size%x*}" "${size#*x}" \
        "$spp" "${direct[@]}" >"$work/log" 2>&1 || [[ ! -s $work/cycles.exr ]]; then
        grep -v '^Fra:' "$work/log"
        echo 'FAILED: Blender made no picture'
        exit 1
    fi
    mv "$work/cycles.exr" "$reference.$$"
    mv "$reference.$$" "$reference" # at once, for whoever else looks for it
fi

paths=all mean=0.005 relmse=5e-3 eye_paths=192 # our own noise must stay below the bounds too
((${#direct[@]} == 0)) || paths=direct
((spp < 1024)) || relmse=1e-3 eye_paths=768
((spp >= 256)) || relmse=$(awk "BEGIN { print 5e-3 * 256 / $spp }")
! grep -Eq '"type" *: *"(mirror|glass)"' "$scene" || mean=0.01
"$bin/relight-render" --scene "$scene" --source "$environment" --size "$size" --samples 1024 --paths "$paths" \
    --eye-paths "$eye_paths" --out "$work/ours.exr" "${flags[@]}"
verdict=pass
"$bin/relight-diff" "$work/ours.exr" "$reference" --trim 0.02 --max-mean "$mean" --max-relmse "$relmse" || verdict=FAILED
echo "$verdict: ${scene##*/} under ${environment##*/}, $paths, against $reference"
[[ $verdict == pass ]]
