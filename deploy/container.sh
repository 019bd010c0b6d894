#!/bin/sh
# Starts relightd in a container; arguments are more flags of relightd. With /etc/relightd/relightd.json, that file decides. Without, it
# shows the built-in scene on all addresses, with a token for each role: made once, kept with the state, and printed as links.
# RELIGHT_NAME is the host name in these links, which browsers must use.
set -eu
config=${RELIGHT_CONFIG:-/etc/relightd/relightd.json}
state=${RELIGHT_STATE:-/var/lib/relightd}

if [ -e "$config" ]; then
    exec relightd --config "$config" --state "$state" "$@"
fi
umask 077
set -- --bind 0.0.0.0 --public-name "${RELIGHT_NAME:-localhost}" --state "$state" "$@"
for role in viewer controller producer; do
    file=$state/token-$role
    [ -s "$file" ] || head -c 18 /dev/urandom | base64 | tr '+/' '-_' >"$file"
    set -- "--token-$role-file" "$file" "$@"
done
relightd "$@" --show-link >&2
exec relightd "$@"
