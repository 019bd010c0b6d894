#!/bin/bash
# pages.sh ROOT: user pages have at most 1,200 words, as wc counts them: docs/*.md but the index and the list of works, README.md, SECURITY.md.
set -euo pipefail
cd "$1/docs"
count=0 long=0
for page in *.md ../README.md ../SECURITY.md; do
    [[ $page == README.md || $page == REFERENCES.md ]] && continue
    count=$((count + 1))
    words="$(wc -w <"$page")"
    if ((words > 1200)); then
        echo "docs/$page: $words words, more than 1,200: shorten or split it"
        long=1
    fi
done
((count > 10)) || { echo "only $count pages found"; exit 1; }
exit "$long"
