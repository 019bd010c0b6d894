#!/bin/bash
# The rules that a machine can watch. Every finding is one line, file:line: what; exit 1 when there is any.
# usage: style.sh ROOT
set -euo pipefail
cd "$1"

# Word-for-word translations that STYLE.md section 11 replaces (Perl syntax, any case).
phrases='by whom|\b(of|from|to|for) whom\b|\b(is|are|was|were) told (of|to|that)\b|what (is|was) (told|said|asked|wanted)\b'
phrases+='|\bwho(ever)? (needs|wants|asks|makes|sends|holds|reads|looks|samples|finds|writes|takes|must)\b'
phrases+='|\bas (is|was) said\b|of which there|what stands\b|\b(wanted|wished) for\b|\bof late\b'
phrases+='|(?<!there )\bis no (layout|folder|name|key|JSON|configuration|number|picture)\b'

function_max=100
file_max=600
column_max=120

sources() { # ours, C; with an argument: below these folders only
    find "${@:-.}" \( -name .git -o -path './build*' -o -name node_modules \) -prune \
        -o -type f \( -name '*.c' -o -name '*.h' \) -print | sed 's|^\./||' | sort
}

texts() { # everything that a person wrote
    find . \( -name .git -o -path './build*' -o -name node_modules \) -prune -o -type f -print | sed 's|^\./||' | sort |
        { xargs -r -d '\n' grep -Il '' || true; }
}

findings() {
    # A function's body opens and closes in the first column; its length includes both lines.
    sources | xargs -r -d '\n' awk -v function_max=$function_max -v file_max=$file_max -v column_max=$column_max '
        FNR == 1 { body = 0 }
        /^{/ { body = FNR }
        /^}/ { if (body && FNR - body + 1 > function_max)
                   printf "%s:%d: function of %d lines, at most %d\n", FILENAME, body, FNR - body + 1, function_max
               body = 0 }
        FNR == file_max + 1 { printf "%s:%d: more than %d lines\n", FILENAME, FNR, file_max }
        length($0) > column_max { printf "%s:%d: %d columns, at most %d\n", FILENAME, FNR, length($0), column_max }
        /^[ ]*\t/ { printf "%s:%d: tab\n", FILENAME, FNR }
        /[ \t]$/ { printf "%s:%d: blank at the end of the line\n", FILENAME, FNR }
        /^typedef (struct|enum|union)[^(]*$/ { printf "%s:%d: typedef\n", FILENAME, FNR }
        /(^|[^A-Za-z_])(TODO|FIXME|XXX)([^A-Za-z_]|$)/ { printf "%s:%d: unfinished\n", FILENAME, FNR }'

    # Comments, messages and documents are plain English.
    texts | grep -E '^(server|clients|protocol|docs|deploy)/.*\.(c|h|js|md|txt|html)$|^[^/]*\.md$' |
        { grep -v '^CHANGELOG\.md' || true; } |
        { xargs -r -d '\n' grep -noiP "$phrases" || true; } |
        sed -E 's/^([^:]*:[0-9]+):(.*)$/\1: "\2" is not plain English/'

    # Libraries that one room hides from the others.
    sources server | xargs -r -d '\n' grep -nE '#include *[<"].*(rtcore|embree[0-9])' | grep -v '^server/scene/geometry/embree\.h:' |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: Embree outside server\/scene\/geometry\/embree.h/' || true
    sources server clients | xargs -r -d '\n' grep -nE '#include *[<"]libwebsockets' |
        grep -vE '^(server/net/stream|clients/common)/' |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: libwebsockets outside server\/net\/stream and clients\/common/' || true

    # The mathematics knows no socket, no file and no clock.
    sources server | { grep -E '^server/(scene/surface|light/(estimators|cache_direct|cache_indirect|plan))/' || true; } |
        xargs -r -d '\n' grep -nE '#include *[<"](base/clock\.h|time\.h|sys/(socket|stat|time)\.h|fcntl\.h|unistd\.h)' |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: the mathematics knows no socket, file or clock/' || true

    # Paths of one machine, and hosts that packages were fetched from.
    texts | { grep -v '^tests/checks/style' || true; } |
        { xargs -r -d '\n' grep -nE '(^|[^A-Za-z0-9_.])/(home|root|work|mnt|Users)/[A-Za-z0-9_.-]' || true; } |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: path of one machine/'
    texts | { grep -v '^tests/checks/style' || true; } |
        { xargs -r -d '\n' grep -nE 'https?://[^/ "]*(registry|npmjs|artifact|pkg\.dev)' || true; } |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: host of a package registry/'
}

found="$(findings)"
if [[ -n "$found" ]]; then
    echo "$found"
    echo "$(wc -l <<<"$found") findings"
    exit 1
fi
echo "$(sources | wc -l) C files, nothing found"
