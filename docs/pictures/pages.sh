#!/bin/sh
# Takes the screenshots that docs/internals/testing.md lists, one per state of the page, from running servers in Debian's Chromium.
#     docs/pictures/pages.sh BUILD [NAME ...]        uses BUILD/bin/relightd; with names, only those
set -eu
here=$(cd "$(dirname "$0")" && pwd)
[ $# -ge 1 ] || { echo "usage: $0 BUILD [NAME ...]" >&2; exit 2; }
build=$(cd "$1" && pwd)
shift
RELIGHT_RELIGHTD=$build/bin/relightd exec node "$here/../../tests/browser/pages.mjs" "$here" "$@"
