#!/usr/bin/env bash
# The package on a bare Debian: a debootstrap system in a folder, into which apt installs the package with its
# dependencies, and where relightd serves an image. Needs root and the machine's own Debian mirror. RELIGHT_CHROOT
# keeps the bare system between runs.
. "$(dirname "$0")/../integration/lib.sh"
packed=${RELIGHT_PACKED:?the folder of the package}
tools=${RELIGHT_TOOLS:-/nonexistent}
base=${RELIGHT_CHROOT:-$work/base}
root=$work/root

skip() {
    echo "skipped: $*"
    exit 77
}

make_base() {
    local debootstrap mirror
    debootstrap=$(command -v debootstrap || echo "$tools/usr/sbin/debootstrap")
    [ -x "$debootstrap" ] || skip "no debootstrap: deploy/install-packages.sh --unpack DIR long, and RELIGHT_TOOLS=DIR"
    [ "$(id -u)" = 0 ] || skip "only root may chroot"
    mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 'Codename: bookworm' | head -n 1)
    [ -n "$mirror" ] || skip "apt knows no mirror of bookworm"
    [ -e "$base/.made" ] && return
    [ -d "$tools/usr/share/debootstrap" ] && export DEBOOTSTRAP_DIR=$tools/usr/share/debootstrap
    rm -rf "$base"
    "$debootstrap" --variant=minbase bookworm "$base" "$mirror" >"$work/log" 2>&1 || {
        grep -qE 'mknod|Operation not permitted|Cannot install into target' "$work/log" && skip "no rights: $(tail -n 1 "$work/log")"
        tail -n 20 "$work/log"
        fail "debootstrap"
    }
    cp /etc/resolv.conf "$base/etc/resolv.conf"
    touch "$base/.made"
}

# Each of these programs replaces itself by the next, so that a signal reaches the last.
within=(env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive ${http_proxy:+http_proxy=$http_proxy}
    chroot "$root")
inside() {
    "${within[@]}" "$@"
}

it_installs_and_serves_in_a_clean_system() {
    make_base
    mkdir "$root"
    cp -a "$base/." "$root/"
    cp "$packed/relightd.deb" "$root/tmp/relightd.deb"
    mkdir -p "$root/proc"
    mount -t proc proc "$root/proc" 2>/dev/null || skip "no rights to mount /proc"
    trap 'umount -l "$root/proc" || true; rm -rf "$work"' EXIT
    inside apt-get -qq update >"$work/log" 2>&1 || { tail "$work/log"; skip "the mirror does not answer"; }
    inside apt-get -qq --yes --no-install-recommends install /tmp/relightd.deb >"$work/log" 2>&1 ||
        { tail -n 20 "$work/log"; fail "apt cannot install it"; }
    inside dpkg --audit >"$work/log"
    [ ! -s "$work/log" ] || { cat "$work/log"; fail "dpkg --audit"; }
    inside relightd --check-config --config /etc/relightd/relightd.json || fail "the example configuration"

    # Like the unit: an unprivileged user with its own folder.
    inside install -d -o nobody -m 700 /var/lib/relightd
    : >"$work/daemon"
    "${within[@]}" setpriv --reuid nobody --regid nogroup --clear-groups --no-new-privs env XDG_CACHE_HOME=/var/lib/relightd \
        relightd --config /etc/relightd/relightd.json --port 0 --size 160x90 --state /var/lib/relightd 2>"$work/daemon" &
    pid=$!
    trap 'kill $pid 2>/dev/null || true; umount -l "$root/proc" || true; rm -rf "$work"' EXIT
    local i url=
    for ((i = 0; i < 600; i++)); do
        url=$(sed -n 's/^relightd: listening on //p' "$work/daemon")
        [ -n "$url" ] && break
        kill -0 "$pid" 2>/dev/null || { cat "$work/daemon"; fail "it ended"; }
        sleep 0.1
    done
    [ -n "$url" ] || { cat "$work/daemon"; fail "it does not listen"; }
    /usr/bin/python3 -B "$(dirname "$0")/first_picture.py" "$url" || { cat "$work/daemon"; fail "no picture"; }
    kill -TERM "$pid"
    local code=0
    wait "$pid" || code=$?
    [ "$code" = 0 ] || { cat "$work/daemon"; fail "exit code $code"; }

    # The tools, too: every library of every program is present.
    inside relight-render --size 32x18 --samples 1 --frames 0-0 --out /tmp/x.exr || fail "relight-render"
    local program
    for program in relight-bench relight-chart relight-diff relight-feed relight-record; do
        inside "$program" --version >/dev/null || fail "$program"
    done
    ! inside sh -c 'ldd /usr/lib/relightd/*' | grep "not found" || fail "a library of a program that they start is missing"
    inside apt-get -qq --yes purge relightd >"$work/log" 2>&1 || { cat "$work/log"; fail "purge"; }
    local left
    left=$(find "$root/usr" "$root/etc" "$root/var/lib" -name '*relight*' ! -path '*/dpkg/*' ! -path "$root/var/lib/relightd*")
    [ -z "$left" ] || fail "purge leaves $left"
}

"$1"
