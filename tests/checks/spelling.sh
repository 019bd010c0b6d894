#!/bin/bash
# codespell finds no misspelt word in the text and comments of the project. usage: spelling.sh ROOT
set -euo pipefail
cd "$1"
command -v codespell >/dev/null || { echo "skipped: codespell is not installed"; exit 77; }
words=bringin,fo,hart,lates,lod # names in the code
check() { codespell -L "$words" "$@"; }

seen="$(check - <<<'It is definately so.' || true)"
[[ "$seen" == *definitely* ]] || { echo "codespell does not see a planted fault"; exit 1; }
mapfile -t files < <(git ls-files '*.md' 'server/*.[ch]' 'clients/*' 'protocol/*.[ch]' 'deploy/*' 2>/dev/null | grep -v '\.svg$' || true)
((${#files[@]} > 100)) || mapfile -t files < <(find . -name node_modules -prune -o -name build -prune -o -path ./tests -prune -o \
    -regex '.*\.\(md\|c\|h\|js\|mjs\|sh\|py\|html\)' -print)
check "${files[@]}"
echo "${#files[@]} files, nothing found"
