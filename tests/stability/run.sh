#!/bin/bash
# Runs the stability suite and prints a table of its cases.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"

usage() {
    cat <<'TEXT'
usage: run.sh [--full] [--raw] [BUILD]

Runs the stability suite from a build folder (default: build/ of the project) and prints one row for each case: what was
done to which methods, what was measured, the bound, and whether it holds.

  --full   the long form: more seeds, maps as large as the program takes (about 6 GiB of memory)
  --raw    rows as the programs print them, fields divided by ' | '
  --help   this text

Exit code 1 when a case does not hold or a program fails.
TEXT
}

raw=0 build="$here/../../build"
for word in "$@"; do
    case "$word" in
    --full) export STABILITY_FULL=1 ;;
    --raw) raw=1 ;;
    --help) usage && exit 0 ;;
    -*) echo "run.sh: '$word' is not known; there are --full, --raw and --help" >&2 && exit 2 ;;
    *) build="$word" ;;
    esac
done

programs=()
for source in "$here"/*.c; do
    name="$(basename "$source" .c)"
    [[ -x "$build/bin/stability_$name" ]] || { echo "run.sh: $build/bin/stability_$name is not built" >&2 && exit 2; }
    programs+=("$name")
done

rows="$(mktemp)"
log="$(mktemp)"
trap 'rm -f "$rows" "$log"' EXIT
failed=()
for name in "${programs[@]}"; do
    [[ -t 2 ]] && printf '\rrunning %-12s' "$name" >&2
    # Each claim runs separately, so that a failing one hides no other.
    while read -r claim; do
        "$build/bin/stability_$name" "$claim" >"$log" 2>&1 || { failed+=("$name.$claim") && cat "$log" >&2; }
        awk -F ' [|] ' 'NF == 5' "$log" >>"$rows"
    done < <(sed -nE 's/^static void ([a-z0-9_]+)\(void \*\*state\)$/\1/p' "$here/$name.c")
done
[[ -t 2 ]] && printf '\r%-24s\r' '' >&2

if ((raw)); then
    cat "$rows"
else
    { echo 'case | methods | measured | bound | verdict' && cat "$rows"; } |
        awk -F ' [|] ' '{ for (k = 1; k <= 5; k++) { cell[NR, k] = $k; if (length($k) > wide[k]) wide[k] = length($k) } }
            END { for (r = 1; r <= NR; r++) {
                      line = ""
                      for (k = 1; k <= 5; k++) line = line sprintf("%-" wide[k] "s  ", cell[r, k])
                      sub(/ +$/, "", line)
                      print line
                  } }'
fi
for claim in "${failed[@]}"; do
    echo "failed: $claim"
done
echo "$(wc -l <"$rows") cases, $(grep -c '| BROKEN$' "$rows" || true) broken, ${#failed[@]} claims failed"
((${#failed[@]} == 0))
