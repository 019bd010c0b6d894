#!/usr/bin/env bash
# The linked programs: position-independent, non-executable stack, read-only relocations before main, stack protector
# and fortified calls; control-flow protection in our own objects.
#   hardened.sh PROGRAM...
set -euo pipefail

fail() {
    echo "FAILED: $*"
    exit 1
}

[ $# -gt 0 ] || fail "no program was named"
command -v readelf >/dev/null || { echo "skipped: no readelf"; exit 77; }
for program; do
    [ -x "$program" ] || fail "$program is not there"
    name=$(basename "$program")
    header=$(readelf -hW "$program")
    segments=$(readelf -lW "$program")
    dynamic=$(readelf -dW "$program")
    symbols=$(readelf -W --dyn-syms "$program")
    [[ $header =~ Type:\ +DYN ]] || fail "$name is not position-independent"
    [[ $dynamic =~ FLAGS_1[^$'\n']*PIE ]] || fail "$name is no PIE"
    [[ $segments =~ GNU_RELRO ]] || fail "$name: no RELRO"
    [[ $dynamic =~ FLAGS_1[^$'\n']*NOW ]] || fail "$name: functions are bound late"
    [[ $segments =~ GNU_STACK[^$'\n']*\ RW\  ]] || fail "$name: the stack can be executed"
    [[ ! $segments =~ LOAD[^$'\n']*\ RWE\  ]] || fail "$name: memory that can be written and executed"
    [[ $symbols =~ __stack_chk_fail ]] || fail "$name: no stack protector"
    [[ $symbols =~ __[a-z]+_chk@ ]] || fail "$name: no fortified call"
    if [ "$(uname -m)" = x86_64 ]; then
        # Debian's start-up objects are not marked, so the whole binary is not either: look for endbr64 instead
        pads=$(LC_ALL=C grep -aoP '\xf3\x0f\x1e\xfa' "$program" | wc -l)
        [ "$pads" -ge 20 ] || fail "$name: no control-flow protection ($pads landing pads)"
    fi
done
echo "$# programs"
