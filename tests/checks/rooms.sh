#!/bin/bash
# Who may include whom: holds every #include "room/x.h" in server/ to server/rooms.txt, and docs/internals/rooms.md to what is there.
# Every finding is one line; exit 1 when there is any. --write renews the table and the drawing in docs/internals/rooms.md.
# usage: rooms.sh ROOT [--write]
set -euo pipefail
cd "$1"
table=server/rooms.txt page=docs/internals/rooms.md
lines_max=7000

declare -A allowed=() purpose=()
rooms=()
while IFS='|' read -r room may what; do
    room="${room// /}"
    rooms+=("$room")
    allowed["$room"]=" $(tr -s ' ' <<<"$may" | sed 's/^ //; s/ $//; s/^-$//') "
    purpose["$room"]="$(sed 's/^ *//; s/ *$//' <<<"$what")"
done < <(grep -v '^#' "$table")

declare -A counted=()
while read -r count file; do # no program for each room: there are forty, and this is asked twice
    room="${file#server/}"
    [[ "$file" == total ]] || counted["${room%%/*}"]=$((${counted["${room%%/*}"]:-0} + count))
done < <(find server -name '*.[ch]' -print0 | xargs -r -0 wc -l)

lines() { # ROOM: lines of C
    echo "${counted[$1]:-0}"
}

findings() {
    local room file line header target count
    for room in "${rooms[@]}"; do
        [[ -d server/$room ]] || { echo "$table: there is no server/$room"; continue; }
        [[ -f server/$room/README.md ]] || echo "server/$room: has no README.md"
        count="$(lines "$room")"
        ((count <= lines_max)) || echo "server/$room: $count lines, at most $lines_max"
        for target in ${allowed[$room]}; do
            [[ -v allowed["$target"] ]] || echo "$table: $room may include $target, which is no room"
        done
    done
    for room in server/*/; do
        room="${room%/}"
        room="${room##*/}"
        [[ -v allowed["$room"] ]] || echo "server/$room: is not in $table"
    done
    while IFS=: read -r file line header; do
        room="${file#server/}"
        room="${room%%/*}"
        [[ -v allowed["$room"] ]] || continue
        header="${header#*\"}"
        header="${header%%\"*}"
        target="${header%%/*}"
        if [[ "$header" != */* || ! -f "server/$header" ]]; then
            [[ "$header" == protocol/* && -f "$header" ]] ||
                echo "$file:$line: \"$header\" names no room and header of server/"
        elif [[ "$target" != "$room" && "${allowed[$room]}" != *" $target "* ]]; then
            echo "$file:$line: $room may not include \"$header\""
        fi
    done < <(find server -name '*.[ch]' -print0 | sort -z | xargs -r -0 grep -HnE '^ *#include *"' || true)
}

# What a room includes that no other room it includes already brings: the arrows worth drawing.
direct() { # ROOM
    local target other hidden
    for target in ${allowed[$1]}; do
        hidden=
        for other in ${allowed[$1]}; do
            [[ "$other" != "$target" && "${allowed[$other]}" == *" $target "* ]] && hidden=1
        done
        [[ -n "$hidden" ]] || echo "$target"
    done
}

tables() { # without the numbers of lines, which change with every commit: $1 empty
    local room target
    echo '| room | what it is for | may include | lines |'
    echo '|---|---|---|---|'
    for room in "${rooms[@]}"; do
        echo "| \`$room\` | ${purpose[$room]} | $(sed 's/^ *//; s/ *$//' <<<"${allowed[$room]:-}") | $((($(lines "$room") + 50) / 100 * 100)) |"
    done
    printf '\n```mermaid\nflowchart BT\n'
    for room in "${rooms[@]}"; do
        for target in $(direct "$room"); do
            echo "    $room --> $target"
        done
    done
    echo '```'
}

if [[ "${2:-}" == --write ]]; then
    tables >"$page.table"
    awk -v table="$page.table" '
        /^<!-- rooms -->/ { print; while ((getline line < table) > 0) print line; skip = 1; next }
        /^<!-- end -->/ { skip = 0 }
        !skip' "$page" >"$page.new"
    mv "$page.new" "$page"
    rm "$page.table"
    exit
fi

found="$(findings)"
without_lines() { sed -E 's/ [0-9]+ \|$/ |/'; }
shown="$(awk '/^<!-- rooms -->/ { on = 1; next } /^<!-- end -->/ { on = 0 } on' "$page" 2>/dev/null | without_lines || true)"
if [[ "$shown" != "$(tables | without_lines)" ]]; then
    found+="${found:+$'\n'}$page: does not show $table; tests/checks/rooms.sh . --write renews it"
fi
if [[ -n "$found" ]]; then
    echo "$found"
    exit 1
fi
echo "${#rooms[@]} rooms, nothing found"
