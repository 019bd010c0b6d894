#!/bin/bash
# Makes the charts of docs/speed-and-accuracy.md by the program itself, on a machine that does nothing else:
#     docs/pictures/charts.sh [FOLDER OF THE PROGRAMS] [FOLDER FOR THE WHOLE PAGES]
# Half an hour on two cores. The pages themselves, with tables and pictures, stay in the second folder.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"
pages="${2:-$here/../../build/charts}"
mkdir -p "$pages"

"$bin/relight-chart" --out "$pages/court" --budgets 4,8,16,32
"$bin/relight-chart" --out "$pages/ring" --budgets 4,8,16,32 --size 160x90 --no-video \
    --scenes "ring=$here/../examples/ring.json"

take() { # PAGE CHART NAME
    cp "$pages/$1/$2" "$here/chart-$3.svg"
}
take court 01-builtin-noon-direct-light.rel_mse.svg court-noon-direct
take court 02-builtin-noon-all-light.rel_mse.svg court-noon-all
take court 03-builtin-overcast-direct-light.rel_mse.svg court-overcast-direct
take court 04-builtin-overcast-all-light.rel_mse.svg court-overcast-all
take ring 02-ring-noon-all-light.rel_mse.svg ring-noon-all
take ring 04-ring-overcast-all-light.rel_mse.svg ring-overcast-all
