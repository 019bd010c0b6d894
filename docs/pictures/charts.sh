#!/bin/bash
# Makes the charts of docs/internals/speed-and-accuracy.md and docs/internals/transport-cache.md with relight-chart, on an idle machine:
#     docs/pictures/charts.sh [FOLDER OF THE PROGRAMS] [FOLDER FOR THE WHOLE PAGES] [court|leaves|ring|masks ...]
# One thread took 35 minutes for the court, 28 for the leaves, 32 for the ring and 3 for the masks; each prints its time. The
# complete pages, with tables and images, are in the second folder, where a run that was interrupted finds its references again.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"
pages="${2:-$here/../../build/charts}"
names=("${@:3}")
((${#names[@]})) || names=(court leaves ring masks)
less=(--seeds 8)
mkdir -p "$pages"

chart() { # NAME, FLAGS of relight-chart
    "$bin/relight-chart" --out "$pages/$1" --cache "$pages/references" "${@:2}"
}

take() { # CHART NAME
    cp "$pages/$1" "$here/chart-$2.svg"
}

make_court() {
    chart court "${less[@]}" --budgets 4,8,16,32
    take court/01-builtin-noon-direct-light.rel_mse.svg court-noon-direct
    take court/02-builtin-noon-all-light.rel_mse.svg court-noon-all
    take court/03-builtin-overcast-direct-light.rel_mse.svg court-overcast-direct
    take court/04-builtin-overcast-all-light.rel_mse.svg court-overcast-all
}

make_leaves() {
    /usr/bin/python3 "$here/../examples/foliage.py" "$pages"
    chart leaves "${less[@]}" --scenes "leaves=$pages/foliage.json" --techniques mis,brdf,rules,denoised,cached,auto
    take leaves/01-leaves-noon-direct-light.noise.svg leaves-noon-direct
}

make_ring() {
    chart ring "${less[@]}" --scenes "ring=$here/../examples/ring.json" \
        --techniques mis/light,mis/eye,rules,denoised,cached,auto,path
    take ring/02-ring-noon-all-light.delta_e.svg ring-noon-all
}

make_masks() {
    python3 "$here/../../tests/references/generate.py" "$pages"
    chart masks --size 96x54 --seeds 4 --budgets 16,64,256 --reference 512 --scenes "masked tree=$pages/tree.glb" \
        --techniques mis,denoised,cached,auto
    take masks/01-masked-tree-noon-direct-light.rel_mse.svg masks-noon-direct
}

for name in "${names[@]}"; do
    [[ "$(type -t "make_$name")" = function ]] || { echo "$0: there is no chart '$name'" >&2; exit 2; }
done
for name in "${names[@]}"; do
    SECONDS=0
    "make_$name"
    echo "$name: $SECONDS s"
done
