#!/bin/bash
# The rules that a machine can watch. Every finding is one line, file:line: what; exit 1 when there is any.
# usage: style.sh ROOT
set -euo pipefail
cd "$1"

function_max=100
file_max=600
column_max=120

# Who may include whom, beside itself (docs: the house). What is not listed may include everything.
declare -A may_include=(
    [base]=""
    [source]="base"
    [env]="base source"
    [scene]="base"
    [shade]="base source env scene"
    [plan]="base"
    [film]="base source env scene shade plan"
    [video]="base"
    [chart]="base source env scene shade plan film"
)

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

    # Libraries that one room hides from the others.
    sources server | xargs -r -d '\n' grep -nE '#include *[<"].*(rtcore|embree)' | grep -v '^server/scene/rays\.c:' |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: Embree outside server\/scene\/rays.c/' || true
    sources server clients | xargs -r -d '\n' grep -nE '#include *[<"]libwebsockets' |
        grep -vE '^(server/stream|clients/common)/' |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: libwebsockets outside server\/stream and clients\/common/' || true

    # shade/ knows no socket, no file and no clock.
    sources server | { grep '^server/shade/' || true; } |
        xargs -r -d '\n' grep -nE '#include *[<"](clock\.h|time\.h|sys/(socket|stat|time)\.h|fcntl\.h|unistd\.h)' |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: shade knows no socket, file or clock/' || true

    rooms

    # Paths of one machine, and hosts that packages were fetched from.
    texts | { grep -v '^tests/checks/style' || true; } |
        { xargs -r -d '\n' grep -nE '(^|[^A-Za-z0-9_.])/(home|root|work|mnt|Users)/[A-Za-z0-9_.-]' || true; } |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: path of one machine/'
    texts | { grep -v '^tests/checks/style' || true; } |
        { xargs -r -d '\n' grep -nE 'https?://[^/ "]*(registry|npmjs|artifact|pkg\.dev)' || true; } |
        sed -E 's/^([^:]*:[0-9]+):.*/\1: host of a package registry/'
}

# Each #include "x.h" of a room names a header of its own or of a room that it may know.
rooms() {
    local file room header owner line
    declare -A owner_of=()
    while IFS= read -r file; do
        [[ "$file" == *.h ]] || continue
        room="${file#server/}"
        owner_of["${file##*/}"]+=" ${room%%/*}"
    done < <(sources server)
    while IFS=: read -r file line header; do
        room="${file#server/}"
        room="${room%%/*}"
        [[ -v may_include["$room"] && "$file" == server/*/* ]] || continue
        header="${header#*\"}"
        header="${header%%\"*}"
        [[ -f "server/$room/$header" ]] && continue
        for owner in ${owner_of["${header##*/}"]:-nobody}; do
            [[ " ${may_include[$room]} " == *" $owner "* ]] && continue 2
        done
        echo "$file:$line: $room may not include \"$header\" of ${owner_of["${header##*/}"]:-nobody}"
    done < <(sources server | xargs -r -d '\n' grep -HnE '^ *#include *"' || true)
}

found="$(findings)"
if [[ -n "$found" ]]; then
    echo "$found"
    echo "$(wc -l <<<"$found") findings"
    exit 1
fi
echo "$(sources | wc -l) C files, nothing found"
