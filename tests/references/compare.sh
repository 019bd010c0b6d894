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
. "$here/cycles.sh"

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
cycles_need

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
if ! cycles_picture "$scene" "$environment" "$size" "$spp" "${direct[@]}"; then
    echo 'FAILED: Blender made no picture'
    exit 1
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
