#!/bin/bash
# Every header of ours compiles alone, so that a file may include any of them first. Not compiled here are those that a file
# of the same name includes first: the build has shown it of them.
# usage: headers.sh ROOT COMPILER
set -euo pipefail
root="$1"
cc="$2"

read -ra flags <<<"$(pkg-config --cflags libwebsockets cmocka libpng OpenEXR)"
flags+=(-std=c11 -D_POSIX_C_SOURCE=200809L -DRELIGHT_VERSION='"0"' -Wall -Wextra -Wno-missing-field-initializers -Werror -fsyntax-only -x c)
flags+=("-I$root" "-I$root/server" "-I$root/tests/unit")

failed=0
count=0
while IFS= read -r header; do
    count=$((count + 1))
    source="${header%.h}.c"
    if [[ -f "$source" ]]; then
        first="$(grep -m1 '^#include' "$source")"
        [[ "$first" == "#include \"${header#"$root"/}\"" || "$first" == "#include \"${header#"$root"/server/}\"" ]] && continue
    fi
    if ! printf '#include "%s"\n' "$header" | "$cc" "${flags[@]}" -; then
        echo "${header#"$root"/} does not stand alone"
        failed=1
    fi
done < <(find "$root/server" "$root/protocol" "$root/tests/unit" "$root/clients" -name '*.h' \
    -not -path '*/node_modules/*' | sort)
echo "$count headers"
((count > 0 && failed == 0))
