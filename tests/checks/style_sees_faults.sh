#!/bin/bash
# style.sh and references.sh are trusted because they were seen to fail: each planted fault must be named, and a clean
# tree must pass.
set -euo pipefail
style="$(dirname "$(readlink -f "$0")")/style.sh"
tree="$(mktemp -d)"
trap 'rm -rf "$tree"' EXIT

plant() { # FILE, text: a file of that content in an otherwise clean tree
    rm -rf "${tree:?}"/*
    mkdir -p "$tree/server/base" "$tree/server/env" "$tree/server/shade" "$tree/server/stream" "$tree/clients"
    echo '/* base */' >"$tree/server/base/vec.h"
    echo '/* env */' >"$tree/server/env/cube.h"
    echo '/* stream */' >"$tree/server/stream/viewer.h"
    printf '#include "cube.h"\n\n#include "vec.h"\n' >"$tree/server/shade/direct.c"
    mkdir -p "$(dirname "$tree/$1")"
    printf '%s\n' "$2" >"$tree/$1"
}

expect() { # what style.sh must say of the tree
    if out="$("$style" "$tree")"; then
        echo "not seen: $1"
        exit 1
    fi
    if ! grep -qF "$1" <<<"$out"; then
        printf 'expected "%s", got:\n%s\n' "$1" "$out"
        exit 1
    fi
}

lines() { # COUNT of empty lines
    printf '%*s' "$1" '' | tr ' ' '\n'
    echo end
}

plant README.md 'clean'
"$style" "$tree"
plant server/base/a.c "void f(void)
{
$(lines 99 | sed 's/end/x;/')
}"
expect 'server/base/a.c:2: function of 102 lines'
plant server/base/a.c "$(lines 600)"
expect 'server/base/a.c:601: more than 600 lines'
plant server/base/a.c "/* $(printf '%120s' x | tr ' ' x) */"
expect 'columns, at most 120'
plant server/base/a.c "$(printf '\tint x;')"
expect 'server/base/a.c:1: tab'
plant server/base/a.c 'int x; '
expect 'blank at the end'
plant server/base/a.h 'typedef struct a { int b; } a;'
expect 'server/base/a.h:1: typedef'
plant server/base/a.c '/* TO''DO later */'
expect 'unfinished'
plant server/shade/a.c '#include <embree3/rtcore.h>'
expect 'server/shade/a.c:1: Embree outside'
plant server/film/a.c '#include <libwebsockets.h>'
expect 'libwebsockets outside'
plant clients/feed/a.c '#include <libwebsockets.h>'
expect 'clients/feed/a.c:1: libwebsockets outside'
plant server/shade/a.c '#include <time.h>'
expect 'shade knows no socket, file or clock'
plant server/shade/a.c '#include "viewer.h"'
expect 'server/shade/a.c:1: shade may not include "viewer.h" of  stream'
plant server/env/a.c '#include "nowhere.h"'
expect 'of nobody'
plant docs/a.md "see /ho""me/someone/notes"
expect 'docs/a.md:1: path of one machine'
plant package-lock.json '"resolved": "https://registry.example.org/a.tgz"'
expect 'host of a package registry'

style="$(dirname "$style")/references.sh"
plant docs/REFERENCES.md '- [Known 1999] A. Known, "A Title", 1999.'
mkdir -p "$tree/protocol"
echo '/* [Known 1999, Eq. 1] and a [link](a.md) */ int a[LENGTH + 2000];' >"$tree/server/base/a.c"
"$style" "$tree"
printf '/* as in [Known 1999; Nobody and\n * None 2001, Eq. 3] */\n' >"$tree/server/base/a.c"
expect 'server/base/a.c: [Nobody and None 2001] is not in docs/REFERENCES.md'
echo 'see [ABC12] for it' >"$tree/docs/a.md"
expect 'docs/a.md: [ABC12]'
echo 'every planted fault was named'
