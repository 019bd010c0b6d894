#!/usr/bin/env bash
# docs/internals/reliability.md: every row from 1 to 100 is there once, later ones at
# most once, in order, and each names tests that exist, or says that it does not
# apply; every row that is tested stands there. usage: reliability.sh ROOT
set -euo pipefail
shopt -s globstar
cd "${1:-$(dirname "$0")/../..}"
page=docs/internals/reliability.md bad=0

rows=$(sed -n 's/^| \([0-9]\+\) |.*/\1/p' "$page")
[ "$(head -n 100 <<<"$rows")" = "$(seq 1 100)" ] || { echo "$page: its rows are not 1 to 100: $rows"; bad=1; }
sort -nuc <<<"$rows" || { echo "$page: its rows are not in order"; bad=1; }

# exists NAME: SUITE.CLAIM of ctest, by where the claim is written; ROOM.test_FILE is all of
# that file, test_FILE those of all rooms.
exists() {
    local claim=${1##*.}
    case $1 in
    test_*) compgen -G "tests/unit/**/$1.c" >/dev/null && return 0 ;; # in each room that has one
    *.test_*.*) ;;
    *.test_*) compgen -G "tests/unit/**/${1%%.*}/$claim.c" >/dev/null && return 0 ;;
    esac
    grep -rqE "(static void|async def|^)[[:space:]]*$claim\(" tests --include=*.c --include=*.py --include=*.sh
}

while IFS='|' read -r _ row _ _ test figure _; do
    row=${row// /} test=${test// /}
    [[ $row =~ ^[0-9]+$ ]] || continue
    if [ "$test" = none ]; then
        [[ $figure == *"does not apply"* ]] || { echo "$page: row $row has no test and does not say why"; bad=1; }
        continue
    fi
    for name in $(grep -o '`[^`]*`' <<<"$test" | tr -d '`'); do
        exists "$name" || { echo "$page: row $row: $name is no test"; bad=1; }
    done
    [[ $test == *'`'* ]] || { echo "$page: row $row names no test"; bad=1; }
done <"$page"

for name in $(sed -n 's/^async def \([A-Z][0-9]*_[a-z0-9_]*\)(.*/\1/p' tests/faults/*.py); do
    grep -q "faults\.$name" "$page" || { echo "$page: faults.$name has no row"; bad=1; }
done
exit $bad
