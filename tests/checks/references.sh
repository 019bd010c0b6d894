#!/bin/bash
# Every work that is cited as [Author 1999], [LPG13] or [Archimedes], with or without what follows a comma, stands in
# docs/REFERENCES.md. Every finding is one line, file: citation; exit 1 when there is any.
# usage: references.sh ROOT
set -euo pipefail
cd "$1"

citations() { # FILE: one a line, those of a pair apart; comments that go over a line's end are joined
    sed -E 's|^ *\*+ ?||' "$1" | tr '\n' ' ' |
        { grep -oE '\[[A-Z][^][()]*\](\(|.|$)' || true; } | { grep -v '($' || true; } | # [text](address) is a link
        sed -E 's/^\[//; s/\].?$//' | tr ';' '\n' | sed -E 's/^ +//' |
        sed -nE "s/^([A-Z][A-Za-z',. -]* (18|19|20)[0-9]{2})([ ,].*)?$/\1/p; s/^([A-Z]+[0-9]{2})(,.*)?$/\1/p
                 s/^([A-Z][a-z]{3,}[0-9A-Z]*)$/\1/p; s/^((CIE|IEC|ITU-R|RFC|SMPTE) [^,]*)(,.*)?$/\1/p" | sort -u
}

missing=0
while IFS= read -r file; do
    while IFS= read -r work; do
        if ! grep -qF -- "- [$work" docs/REFERENCES.md; then
            echo "$file: [$work] is not in docs/REFERENCES.md"
            missing=1
        fi
    done < <(citations "$file")
done < <(find server clients protocol docs -name node_modules -prune -o -type f \
    \( -name '*.c' -o -name '*.h' -o -name '*.md' -o -name '*.js' \) ! -path docs/REFERENCES.md -print | sort)
exit "$missing"
