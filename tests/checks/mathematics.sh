#!/bin/bash
# Each function that docs/internals/mathematics.md names, as [`name`](../path), is defined in that file, and each other link leads
# somewhere. Every finding is one line; exit 1 when there is any.
# usage: mathematics.sh ROOT
set -euo pipefail
cd "$1/docs/internals"
page=mathematics.md
found=0

finding() {
    echo "docs/internals/$page: $*"
    found=1
}

# A function (its name at the start of a line or behind its type, and no semicolon after it), a macro, an enum or a
# struct, or a claim of a test script.
defines() { # FILE NAME
    grep -Eq "^(static )?(inline )?[a-z][a-zA-Z0-9_ ]*[ *]$2\(([^;]*|.*\) *\{.*)$|^#define $2\b|^(enum|struct) $2 \{|^$2\(\) \{$|^async def $2\(" "$1"
}

count=0
while IFS='|' read -r name file; do
    count=$((count + 1))
    if [[ ! -f $file ]]; then
        finding "$name: there is no ${file#../../}"
    elif ! defines "$file" "$name"; then
        finding "${file#../../} does not define $name"
    fi
done < <(grep -oE '\[`[A-Za-z0-9_]+`\]\([^)#]+\)' $page | sed -E 's/^\[`([^`]+)`\]\(([^)]+)\)$/\1|\2/' | sort -u)
while IFS= read -r file; do
    [[ -e $file ]] || finding "a link leads to $file, which is not there"
done < <(grep -oE '\]\([^)#:]+\)' $page | sed -E 's/^\]\(([^)]+)\)$/\1/' | sort -u)
while IFS= read -r line; do
    finding "line ${line%%:*}: links within a block of code are not shown as links"
done < <(grep -nE '^    .*\]\(' $page || true)
((count >= 50)) || finding "only $count functions are named"
echo "$count functions are where docs/internals/$page says"
exit "$found"
