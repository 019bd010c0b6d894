#!/bin/sh
# Takes the pictures of docs/viewer.md: one of each state of the page, from running servers, in Debian's Chromium.
#     docs/pictures/pages.sh BUILD [NAME ...]        BUILD/bin/relightd is taken; names: only those
set -eu
here=$(cd "$(dirname "$0")" && pwd)
[ $# -ge 1 ] || { echo "usage: $0 BUILD [NAME ...]" >&2; exit 2; }
build=$(cd "$1" && pwd)
shift
RELIGHT_RELIGHTD=$build/bin/relightd exec node "$here/../../tests/browser/pages.mjs" "$here" "$@"
