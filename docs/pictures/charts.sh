#!/bin/bash
# Makes the charts of docs/internals/speed-and-accuracy.md and docs/internals/transport-cache.md with relight-chart, on an idle machine:
#     docs/pictures/charts.sh [FOLDER OF THE PROGRAMS] [FOLDER FOR THE WHOLE PAGES]
# Takes an hour on two cores. The complete pages, with tables and images, are in the second folder.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"
pages="${2:-$here/../../build/charts}"
mkdir -p "$pages"

"$bin/relight-chart" --out "$pages/court" --budgets 4,8,16,32
/usr/bin/python3 "$here/../examples/foliage.py" "$pages"
less=(--seeds 8)
"$bin/relight-chart" --out "$pages/leaves" "${less[@]}" --scenes "leaves=$pages/foliage.json" --techniques mis,brdf,rules,cached,auto
"$bin/relight-chart" --out "$pages/ring" "${less[@]}" --scenes "ring=$here/../examples/ring.json" \
    --techniques mis/light,mis/eye,rules,cached,auto,path
python3 "$here/../../tests/references/generate.py" "$pages"
"$bin/relight-chart" --out "$pages/masks" --size 96x54 --seeds 4 --budgets 16,64,256 --reference 512 --scenes "masked tree=$pages/tree.glb" \
    --techniques mis,cached,auto

take() { # CHART NAME
    cp "$pages/$1" "$here/chart-$2.svg"
}
take court/01-builtin-noon-direct-light.rel_mse.svg court-noon-direct
take court/02-builtin-noon-all-light.rel_mse.svg court-noon-all
take court/03-builtin-overcast-direct-light.rel_mse.svg court-overcast-direct
take court/04-builtin-overcast-all-light.rel_mse.svg court-overcast-all
take leaves/01-leaves-noon-direct-light.noise.svg leaves-noon-direct
take ring/02-ring-noon-all-light.delta_e.svg ring-noon-all
take masks/01-masked-tree-noon-direct-light.rel_mse.svg masks-noon-direct
