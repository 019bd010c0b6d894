#!/usr/bin/env bash
# Six models by relight-render and by Blender's Cycles, as people look at them: a table of differences, and pictures.
#     models.sh [--out FOLDER] [--size WIDTHxHEIGHT] [--spp N] [--environment FILE] [--as-imported] [NAME ...]
# NAME: helmet, tree, table, mixer, lantern or chair; left out, all. Delta E is the mean CIE76 delta E*ab of all pixels
# after one filmic tone map on both, FLIP as by relight-diff; the table's last column says which pictures lie within the
# target of 2 and, in the last row, whether the mean lies within 1.5. FOLDER (build/models) gets for each model our
# picture beside that of Cycles (NAME.jpg), the map of errors (NAME.png), both as EXR, and the table (models.md).
# Cycles renders what glTF says; with --as-imported it keeps the matte part that Blender's importer gives, Disney's.
# helmet, table, mixer and the environment come from RELIGHT_TEST_DATA; generate.py makes tree, lantern and chair.
# Exit code: 0 all within their targets, 1 not, 2 usage, 77 no Blender or no data.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${RELIGHT_BIN:-$here/../../build/bin}"
. "$here/cycles.sh"

usage() {
    echo "models.sh: $1" >&2
    sed -n 's/^#     //p' "$0" >&2
    exit 2
}

out="$bin/../models" size=320x180 spp=256 environment='' flags=() names=()
while (($#)); do
    case $1 in
    --as-imported) flags=("$1") ;;
    --out | --size | --spp | --environment)
        (($# >= 2)) || usage "$1 needs a value"
        declare "${1#--}=$2"
        shift
        ;;
    helmet | tree | table | mixer | lantern | chair) names+=("$1") ;;
    *) usage "'$1' is not known" ;;
    esac
    shift
done
[[ $size =~ ^[0-9]+x[0-9]+$ ]] || usage "'$size' is not WIDTHxHEIGHT"
[[ $spp =~ ^[1-9][0-9]*$ ]] || usage "'$spp' is not a number of samples"
((${#names[@]})) || names=(helmet tree table mixer lantern chair)
cycles_need
if [[ -z ${RELIGHT_TEST_DATA:-} ]]; then
    echo 'skipped: RELIGHT_TEST_DATA is not set'
    exit 77
fi
models="$(readlink -f "$RELIGHT_TEST_DATA")/models"
environment="${environment:-$RELIGHT_TEST_DATA/env/overcast_city_1k.hdr}"

mkdir -p "$out"
python3 "$here/generate.py" "$out"

# placed MODEL POSITION TARGET DEGREES: a JSON scene, for a model without a camera.
placed() {
    printf '{"camera": {"position": %s, "look_at": %s, "fov_y_degrees": %s}, "models": [{"file": "%s"}]}\n' "$2" "$3" "$4" "$1"
}
placed "$models/gltf/FlightHelmet/FlightHelmet.gltf" '[0.75, 0.5, 1.1]' '[0, 0.32, 0]' 34 >"$out/helmet.json"
placed "$models/glass-table.glb" '[3.4, 2.6, 4.6]' '[0, 0.75, 0]' 34 >"$out/table.json"

scene_of() {
    case $1 in
    mixer) echo "$models/gltf/Mixer.glb" ;;
    helmet | table) echo "$out/$1.json" ;;
    *) echo "$out/$1.glb" ;;
    esac
}

# Whether all files of a scene exist.
complete() {
    local file
    while IFS= read -r file; do
        [[ -e $file ]] || return 1
    done < <(cycles_files "$1")
}

# row NAME: one row of the table.
row() {
    local name=$1 scene reference
    scene="$(scene_of "$name")"
    cycles_picture "$scene" "$environment" "$size" "$spp" --smooth-sky "${flags[@]}" || return 1
    cp "$reference" "$out/$name.cycles.exr"
    "$bin/relight-render" --scene "$scene" --source "$environment" --size "$size" --method mis --samples 256 \
        --eye-paths 128 --out "$out/$name.exr" || return 1
    "$bin/beside" "$out/$name.exr" "$out/$name.cycles.exr" "$out/$name.jpg"
    "$bin/relight-diff" "$out/$name.exr" "$out/$name.cycles.exr" --map "$out/$name.png" --json | python3 -c '
import json, sys
d = json.load(sys.stdin)
print("| %s | %.2f | %.3f | %.3f | %s |" % (sys.argv[1], d["delta_e"], d["flip"], d["mean_ratio"], "yes" if d["delta_e"] <= 2 else "no"))' "$name"
}

{
    echo '| model | delta E | FLIP | mean ratio | within |'
    echo '|---|---|---|---|---|'
} | tee "$out/models.md"
for name in "${names[@]}"; do
    if complete "$(scene_of "$name")"; then
        row "$name" || echo "| $name | failed | | | no |"
    else
        echo "| $name | skipped: not in RELIGHT_TEST_DATA | | | |"
    fi | tee -a "$out/models.md"
done
awk -F'|' '$3 + 0 > 0 { sum += $3; n++ } END { if (n) printf "| mean | %.2f | | | %s |\n", sum / n, sum / n <= 1.5 ? "yes" : "no" }' \
    "$out/models.md" | tee -a "$out/models.md"
! grep -q '| no |$' "$out/models.md"
