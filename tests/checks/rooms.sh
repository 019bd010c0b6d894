#!/bin/bash
# Who may include whom: holds every #include "folder/room/x.h" in server/ to server/rooms.txt, and docs/internals/rooms.md to what
# is there. A room may include only rooms that the table names before it, and there are at most twelve folders at the top.
# Every finding is one line; exit 1 when there is any. --write renews the table and the drawing in docs/internals/rooms.md.
# usage: rooms.sh ROOT [--write]
set -euo pipefail
cd "$1"
table=server/rooms.txt page=docs/internals/rooms.md
lines_max=7000 folders_max=12

declare -A allowed=() purpose=()
rooms=()
while IFS='|' read -r room may what; do
    room="${room// /}"
    rooms+=("$room")
    allowed["$room"]=" $(tr -s ' ' <<<"$may" | sed 's/^ //; s/ $//; s/^-$//') "
    purpose["$room"]="$(sed 's/^ *//; s/ *$//' <<<"$what")"
done < <(grep -v '^#' "$table")

room_of() { # FILE below server/: sets room to its folder in the table, or to its first
    local first="${1%%/*}" rest="${1#*/}"
    room="$first/${rest%%/*}"
    [[ -v allowed["$room"] ]] || room="$first"
}

declare -A counted=()
while read -r count file; do # no program for each room: there are forty, and this is asked twice
    [[ "$file" == total ]] && continue
    room_of "${file#server/}"
    counted["$room"]=$((${counted["$room"]:-0} + count))
done < <(find server -name '*.[ch]' -print0 | xargs -r -0 wc -l)

lines() { # ROOM: lines of C
    echo "${counted[$1]:-0}"
}

findings() {
    local room file line header target count from before=" "
    count="$(find server -mindepth 1 -maxdepth 1 -type d | wc -l)"
    ((count <= folders_max)) || echo "server: $count folders, at most $folders_max"
    for room in "${rooms[@]}"; do
        [[ -d server/$room ]] || { echo "$table: there is no server/$room"; continue; }
        [[ -f server/$room/README.md ]] || echo "server/$room: has no README.md"
        count="$(lines "$room")"
        ((count <= lines_max)) || echo "server/$room: $count lines, at most $lines_max"
        for target in ${allowed[$room]}; do
            if [[ ! -v allowed["$target"] ]]; then
                echo "$table: $room may include $target, which is no room"
            elif [[ "$before" != *" $target "* ]]; then
                echo "$table: $room may include $target, which stands below it"
            fi
        done
        before+="$room "
    done
    while read -r file; do # a folder with sources of its own
        room_of "${file#server/}"
        [[ -v allowed["$room"] ]] || echo "server/$room: is not in $table"
    done < <(find server -mindepth 2 -maxdepth 3 -name '*.[ch]' -printf '%h\n' | sort -u)
    while IFS=: read -r file line header; do
        room_of "${file#server/}"
        from="$room"
        [[ -v allowed["$from"] ]] || continue
        header="${header#*\"}"
        header="${header%%\"*}"
        room_of "$header"
        target="$room" room="$from"
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
            echo "    ${room//\//_}[$room] --> ${target//\//_}[$target]"
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
