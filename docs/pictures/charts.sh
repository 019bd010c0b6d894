#!/bin/bash
# Makes the charts of docs/speed-and-accuracy.md by the program itself, on a machine that does nothing else:
#     docs/pictures/charts.sh [FOLDER OF THE PROGRAMS] [FOLDER FOR THE WHOLE PAGES]
# Half an hour on two cores. The pages themselves, with tables and pictures, stay in the second folder.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
bin="${1:-$here/../../build/bin}"
pages="${2:-$here/../../build/charts}"
mkdir -p "$pages"

"$bin/relight-chart" --out "$pages" --budgets 4,8,16,32

take() { # CHART NAME
    cp "$pages/$1" "$here/chart-$2.svg"
}
take 01-builtin-noon-direct-light.rel_mse.svg court-noon-direct
take 02-builtin-noon-all-light.rel_mse.svg court-noon-all
take 03-builtin-overcast-direct-light.rel_mse.svg court-overcast-direct
take 04-builtin-overcast-all-light.rel_mse.svg court-overcast-all
