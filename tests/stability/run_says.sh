#!/bin/bash
# Tests run.sh with programs that only print: its table is aligned, and a failed case or program gives exit code 1.
set -euo pipefail
here="$(dirname "$(readlink -f "$0")")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
mkdir "$work/bin"

fail() {
    echo "run_says.sh: $1" >&2
    exit 1
}

program() { # NAME ROW EXIT
    printf '#!/bin/bash\necho "[ RUN ] a line that is no case"\necho %q\nexit %d\n' "$2" "$3" >"$work/bin/stability_$1"
    chmod +x "$work/bin/stability_$1"
}

for source in "$here"/*.c; do
    program "$(basename "$source" .c)" 'a case | all | error 0.1 | <= 1 | holds' 0
done
table="$("$here/run.sh" "$work")" || fail "all hold, and it does not say so"
[[ "$table" == "case    methods  measured   bound  verdict"* ]] || fail "the head is not as it should be: ${table%%$'\n'*}"
grep -q '^a case  all      error 0.1  <= 1   holds$' <<<"$table" || fail "rows are not aligned"
grep -q ' cases, 0 broken, 0 claims failed$' <<<"$table" || fail "the last line does not count"
table="$("$here/run.sh" --raw "$work")" || fail "--raw fails"
grep -q '^a case | all | error 0.1 | <= 1 | holds$' <<<"$table" || fail "--raw is not raw"

program light 'another | all | error 2 | <= 1 | BROKEN' 1
! table="$("$here/run.sh" "$work" 2>"$work/said")" || fail "a broken case ends in 0"
grep -q '^another .* BROKEN$' <<<"$table" || fail "the broken case is not in the table"
grep -q 'light\.' <<<"$table" || fail "the claim that failed is not named"
program light 'a case | all | error 0.1 | <= 1 | holds' 139
! "$here/run.sh" "$work" >"$work/out" 2>&1 || fail "a program that fails ends in 0"

rm "$work/bin/stability_light"
code=0
"$here/run.sh" "$work" >"$work/out" 2>&1 || code=$?
((code == 2)) || fail "what is not built ends in $code"
code=0
"$here/run.sh" --fast >"$work/out" 2>&1 || code=$?
((code == 2)) || fail "an unknown flag ends in $code"
grep -q -- --full <<<"$("$here/run.sh" --help)" || fail "--help does not help"
