#!/bin/bash
# style.sh, prototypes.py, rooms.sh and references.py are trusted because they were seen to fail: each planted fault must be
# named, and a clean tree must pass.
set -euo pipefail
style="$(dirname "$(readlink -f "$0")")/style.sh"
tree="$(mktemp -d)"
trap 'rm -rf "$tree"' EXIT

plant() { # FILE, text: a file of that content in an otherwise clean tree
    rm -rf "${tree:?}"/*
    mkdir -p "$tree/server/base" "$tree/server/sky/tables" "$tree/server/light/estimators" "$tree/server/net/stream" "$tree/clients"
    echo '/* base */' >"$tree/server/base/vec.h"
    echo '/* env */' >"$tree/server/sky/tables/cube.h"
    echo '/* stream */' >"$tree/server/net/stream/viewer.h"
    printf '#include "sky/tables/cube.h"\n\n#include "base/vec.h"\n' >"$tree/server/light/estimators/direct.c"
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
plant server/light/estimators/a.c '#include <embree3/rtcore.h>'
expect 'server/light/estimators/a.c:1: Embree outside'
plant server/image/film/a.c '#include <libwebsockets.h>'
expect 'libwebsockets outside'
plant clients/feed/a.c '#include <libwebsockets.h>'
expect 'clients/feed/a.c:1: libwebsockets outside'
plant server/light/estimators/a.c '#include <time.h>'
expect 'the mathematics knows no socket, file or clock'
plant docs/a.md "see /ho""me/someone/notes"
expect 'docs/a.md:1: path of one machine'
plant package-lock.json '"resolved": "https://registry.example.org/a.tgz"'
expect 'host of a package registry'
plant server/base/a.c '/* Told by whom it is held. */'
expect 'server/base/a.c:1: "by whom" is not plain English'
plant docs/a.md 'Who needs that gives `--samples`.'
expect 'docs/a.md:1: "Who needs" is not plain English'

checks="$(dirname "$style")"
prototypes() { # TREE
    /usr/bin/python3 -B "$checks/prototypes.py" "$1"
}
style=prototypes
plant server/base/a.h "$(printf '/* Thread: any. */\n\n/* Adds. */\nint a(int b);\nvoid c(int d,\n       int e); /* beside */\n')"
"$style" "$tree"
plant server/base/a.h "$(printf '/* Thread: any. */\n\n/* Adds. */\nint a(int b);\n\nvoid c(int d,\n       int e);\n')"
expect 'server/base/a.h:6: c has no comment'
plant server/base/a.h "$(printf '/* Adds. */\nint a(int b);\n')"
expect 'server/base/a.h:1: does not say which threads'
callers() { # TREE
    /usr/bin/python3 -B "$checks/callers.py" "$1"
}
style=callers
plant server/base/a.h "$(printf 'int a(int b);\n')"
printf '/* a(1) */\nint a(int b)\n{\n    return b;\n}\n' >"$tree/server/base/a.c"
expect 'server/base/a.h: a: nothing but tests calls it'
echo 'int b = a(1);' >"$tree/server/sky/tables/a.c"
"$style" "$tree"
style="$checks/rooms.sh"
rooms_tree() { # FILE, text: the same, with a table of its rooms
    plant "$1" "$2"
    printf 'base | - | all\nsky/tables | base | skies\nlight/estimators | base sky/tables | light\nnet/stream | base | network\n' >"$tree/server/rooms.txt"
    for room in base sky/tables light/estimators net/stream; do
        echo "# $room" >"$tree/server/$room/README.md"
    done
    mkdir -p "$tree/docs/internals"
    printf '<!-- rooms -->\n<!-- end -->\n' >"$tree/docs/internals/rooms.md"
    "$checks/rooms.sh" "$tree" --write
}
rooms_tree README.md 'clean'
"$style" "$tree"
rooms_tree server/light/estimators/a.c '#include "net/stream/viewer.h"'
expect 'server/light/estimators/a.c:1: light/estimators may not include "net/stream/viewer.h"'
rooms_tree server/sky/tables/a.c '#include "base/nowhere.h"'
expect 'names no room and header'
rooms_tree server/sky/tables/a.c '#include "cube.h"'
expect 'server/sky/tables/a.c:1: "cube.h" names no room and header'
rooms_tree server/cellar/a.c 'int a;'
expect 'server/cellar: is not in server/rooms.txt'
rooms_tree server/sky/tables/a.c "$(lines 7001)"
expect 'lines, at most 7000'
rooms_tree server/sky/a.c 'int a;'
expect 'server/sky: is not in server/rooms.txt'
rooms_tree README.md 'clean'
sed -i 's/| base | skies/| base net\/stream | skies/' "$tree/server/rooms.txt"
expect 'sky/tables may include net/stream, which stands below it'
rooms_tree README.md 'clean'
mkdir "$tree"/server/{a,b,c,d,e,f,g,h,i}
expect 'server: 13 folders, at most 12'
rooms_tree README.md 'clean'
sed -i 's/| skies |/| clouds |/' "$tree/docs/internals/rooms.md"
expect 'docs/internals/rooms.md: does not show'

style="$checks/references.py"
plant docs/REFERENCES.md '- [Known 1999] A. Known, "A Title", 1999.'
mkdir -p "$tree/protocol"
echo '/* [Known 1999, Eq. 1] and a [link](a.md) */ int a[LENGTH + 2000];' >"$tree/server/base/a.c"
"$style" "$tree"
printf '/* as in [Known 1999; Nobody and\n * None 2001, Eq. 3] */\n' >"$tree/server/base/a.c"
expect 'server/base/a.c: [Nobody and None 2001] is not in docs/REFERENCES.md'
echo 'see [ABC12] for it' >"$tree/docs/a.md"
expect 'docs/a.md: [ABC12]'

links() { # TREE
    /usr/bin/python3 -B "$checks/links.py" "$1"
}
style=links
plant docs/a.md "$(for k in {1..100}; do echo "## Part $k"; echo "[see](#part-$k)"; done)"
"$style" "$tree"
plant docs/a.md '[see](b.md)'
expect 'docs/a.md:1: b.md: there is no b.md'
plant docs/a.md '[see](#here)'
expect 'docs/a.md:1: #here: this page has no heading #here'
echo 'every planted fault was named'
