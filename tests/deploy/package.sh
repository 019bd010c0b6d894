#!/usr/bin/env bash
# The Debian package: its contents, their completeness, and that they work when unpacked.
. "$(dirname "$0")/../integration/lib.sh"
here=$(cd "$(dirname "$0")" && pwd)
source=$(dirname "$(dirname "$here")")
packed=${RELIGHT_PACKED:?the folder of the package}
root=$packed/root
programs="relightd relight-bench relight-chart relight-diff relight-feed relight-record relight-render"

need() {
    command -v "$1" >/dev/null || { echo "skipped: no $1 here"; exit 77; }
}

a_package_can_be_made() {
    need dpkg-shlibdeps
    rm -rf "$packed"
    mkdir -p "$packed"
    (cd "$work" && cpack -G DEB --config "${RELIGHT_BUILD:?}/CPackConfig.cmake" -B "$packed") >"$work/log" 2>&1 ||
        { cat "$work/log"; fail "cpack"; }
    mv "$packed"/relightd_*.deb "$packed/relightd.deb"
    dpkg-deb -x "$packed/relightd.deb" "$root"
    dpkg-deb -e "$packed/relightd.deb" "$packed/control"
}

# Made again later and with another umask, it is the same to the bit. Each commit tells cpack the dependencies of the first
# one: finding them (dpkg-shlibdeps) takes ten times as long as all the rest; `./test --long` finds them twice.
it_can_be_reproduced() {
    need dpkg-shlibdeps
    local told=()
    if [ -z "${RELIGHT_LONG:-}" ]; then
        told=(-D CPACK_DEBIAN_PACKAGE_SHLIBDEPS=OFF -D "CPACK_DEBIAN_PACKAGE_DEPENDS=$(dpkg-deb -f "$packed/relightd.deb" Depends)")
    fi
    (cd "$work" && umask 002 && cpack -G DEB --config "${RELIGHT_BUILD:?}/CPackConfig.cmake" "${told[@]}" -B "$work/again") \
        >"$work/log" 2>&1 || { cat "$work/log"; fail "cpack"; }
    cmp "$packed/relightd.deb" "$work"/again/*.deb || fail "two packages of one build differ"
    [ "$(dpkg-deb -f "$work"/again/*.deb Package)" = relightd ] || fail "no package"
}

it_holds_what_is_to_be_installed() {
    local program file
    for program in $programs; do
        [ -x "$root/usr/bin/$program" ] || fail "no $program"
        [ -s "$root/usr/share/man/man1/$program.1.gz" ] || fail "no manual page of $program"
        for file in bash-completion/completions/$program zsh/vendor-completions/_$program fish/vendor_completions.d/$program.fish; do
            [ -s "$root/usr/share/$file" ] || fail "no $file"
        done
        [ "$("$root/usr/bin/$program" --version)" = "$("$bin/$program" --version)" ] || fail "another $program"
    done
    [ "$(ls "$root/usr/bin" | wc -w)" = "$(wc -w <<<"$programs")" ] || fail "more programs than are known here"
    diff -r "$source/clients/web" "$root/usr/share/relightd/web" || fail "another page"
    for file in relightd.py example.py; do
        cmp "$source/clients/python/$file" "$root/usr/share/relightd/python/$file" || fail "no $file"
    done
    for file in copyright changelog.gz CHANGELOG.md LICENSE NOTICES; do
        [ -s "$root/usr/share/doc/relightd/$file" ] || fail "no $file"
    done
    [ -x "$root/usr/lib/relightd/relight-decoder" ] || fail "no decoder for what producers send"
    [ -x "$root/usr/lib/relightd/relight-reader" ] || fail "no reader of scene files"
    "$root/usr/bin/relight-bench" --live --help | grep -q -- --patience || fail "no scripts of relight-bench --live"
    [ -x "$root/usr/lib/relightd/relight-scripts/chart.py" ] || fail "no scripts of relight-chart"
    [ -x "$root/usr/lib/relightd/relight-demux" ] && [ -x "$root/usr/lib/relightd/relight-video" ] || fail "no video sources"
    [ -s "$root/usr/lib/systemd/system/relightd.service" ] || fail "no unit"
    [ -s "$root/etc/relightd/relightd.json" ] || fail "no configuration"
    grep -qx /etc/relightd/relightd.json "$packed/control/conffiles" || fail "an upgrade would overwrite the configuration"
}

# Every library of a program belongs to a package in Depends, or to an alternative of one (libopenblas0-pthread for
# libopenblas0); so do those that relightd loads when it needs them.
it_depends_on_what_it_is_linked_with() {
    local program library package depends triple
    triple=$(dpkg-architecture -qDEB_HOST_MULTIARCH)
    depends=$(sed -n 's/^Depends: //p' "$packed/control/control" | tr -d ' ' | sed 's/([^)]*)//g; s/|/,/g')
    dpkg -S "*/$triple/*.so.*" >"$work/owners" # once: each question reads all lists of files
    for program in $programs $(cd "$root/usr/bin" && ls -d ../lib/relightd/* | grep -v relight-scripts); do
        objdump -p "$root/usr/bin/$program" | sed -n "s|^ *NEEDED *|$program |p"
        grep -aoE 'lib(avcodec|avformat|avutil)[.]so[.][0-9]+' "$root/usr/bin/$program" | sed "s|^|$program |" || true
    done >"$work/needed"
    grep -q '^relightd libavcodec' "$work/needed" || ! "$bin/relightd" --help all | grep -q -e --no-h264 || fail "relightd loads no libavcodec"
    while read -r program library; do
        package=$(sed -n "s|^\([^:]*\).*/$library\$|\1|p" "$work/owners" | sort -u)
        [ -n "$package" ] || fail "nobody owns $library"
        [[ ",$depends," == *",$package,"* || ",$depends," == *",${package%-*},"* ]] ||
            fail "$program needs $library of $package, which is not in: $depends"
    done < <(sort -u -k2,2 "$work/needed")
}

# No paths of the build machine, and no page of the build tree in the binaries.
no_folder_of_the_building_machine_is_in_it() {
    if grep -rlaF "$source" "$root" "$packed/control"; then fail "they name $source"; fi
    if grep -rlaF "$RELIGHT_BUILD" "$root" "$packed/control"; then fail "they name $RELIGHT_BUILD"; fi
}

its_files_have_decent_owners_and_modes() {
    dpkg-deb -c "$packed/relightd.deb" >"$work/list"
    if grep -vE '^[-dl]......... root/root ' "$work/list"; then fail "not root's"; fi
    if grep -E '^[^l](....w|.......w|..s|.....s)' "$work/list"; then fail "others may write, or set-id"; fi
    (cd "$root" && md5sum --quiet -c "$packed/control/md5sums") || fail "sums"
    local script
    for script in postinst prerm postrm; do
        [ -x "$packed/control/$script" ] || fail "$script cannot be run"
        sh -n "$packed/control/$script"
    done
}

# The package states the GPL exactly if the binary is bound by it.
its_licence_is_that_of_what_it_is_linked_with() {
    local linked=no said=no
    if grep -qa 'libavcodec[.]so' "$root/usr/bin/relightd"; then linked=yes; fi # it loads it itself
    if grep -q 'General Public License' "$root/usr/share/doc/relightd/copyright"; then said=yes; fi
    [ "$linked" = "$said" ] || fail "libavcodec: $linked, GPL in the copyright file: $said"
    local line
    while read -r line; do
        [ -z "$line" ] || grep -qF "$line" "$root/usr/share/doc/relightd/copyright" || fail "the licence lacks: $line"
    done < <(sed 1,3d "$source/LICENSE")
    zcat "$root/usr/share/doc/relightd/changelog.gz" | dpkg-parsechangelog -l - >"$work/changelog"
    grep -qx "Version: $("$bin/relightd" --version | cut -d' ' -f2)" "$work/changelog" || fail "changelog: $(cat "$work/changelog")"
}

# The manual contains each flag of --help, with the same words.
the_manual_pages_say_what_help_says() {
    need man
    local program
    for program in $programs; do
        man -l --warnings=w "$root/usr/share/man/man1/$program.1.gz" >"$work/page" 2>"$work/warnings"
        [ ! -s "$work/warnings" ] || { cat "$work/warnings"; fail "roff has something to say of $program"; }
        # Ignore line breaks and capitalised headings.
        MANWIDTH=2000 man -l "$root/usr/share/man/man1/$program.1.gz" | tr -s ' \n' ' ' >"$work/page"
        local flag words page
        page=$(<"$work/page")
        while read -r flag words; do
            [[ $page == *"${words:0:60}"* ]] || fail "$program.1 lacks '$words' of $flag"
            [[ $page == *" $flag "* ]] || fail "$program.1 lacks $flag"
        done < <("$root/usr/bin/$program" --help all | sed -nE 's/^  (--[a-z0-9-]+)( [^ ]+)?  *(.*)$/\1 \3/p' | tr -s ' ')
        whatis=$(sed -n 's/.* NAME \(.*\) SYNOPSIS .*/\1/p' "$work/page")
        [ "${#whatis}" -lt 160 ] && [[ $whatis == "$program - "* ]] || fail "whatis of $program: $whatis"
    done
}

# completed WORD...: bash's completions of the last word; the first is the program.
completed() {
    bash --norc -c '. "$1"; shift
        compopt() { :; }
        COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
        "$(complete -p "$1" | sed "s/.*-F \([^ ]*\).*/\1/")" && printf "%s\n" "${COMPREPLY[@]}"' \
        bash "$root/usr/share/bash-completion/completions/$1" "$@"
}

# not_completed PROGRAM WORD...: those of the words that bash does not offer where each is typed alone.
not_completed() {
    bash --norc -c '. "$1"; program=$2; shift 2
        compopt() { :; }
        offers=$(complete -p "$program" | sed "s/.*-F \([^ ]*\).*/\1/")
        for word; do
            COMP_WORDS=("$program" "$word") COMP_CWORD=1 COMPREPLY=()
            "$offers" && [[ " ${COMPREPLY[*]} " == *" $word "* ]] || echo "$word"
        done' bash "$root/usr/share/bash-completion/completions/$1" "$@"
}

bash_completes_flags_and_files_of_every_program() {
    local program missing flags
    for program in $programs; do
        mapfile -t flags < <("$root/usr/bin/$program" --help all | sed -nE 's/^  (--[a-z0-9-]+).*/\1/p')
        [ "${#flags[@]}" -gt 1 ] || fail "$program: no flags"
        missing=$(not_completed "$program" "${flags[@]}")
        [ -z "$missing" ] || fail "$program: not completed: $missing"
    done
    [ "$(completed relightd --sce)" = --scene ] || fail "--sce: $(completed relightd --sce)"
    touch "$work/some scene.json"
    mkdir "$work/some folder"
    [ "$(completed relightd --scene "$work/some sc")" = "$work/some scene.json" ] || fail "no file for --scene"
    [ "$(completed relightd --web "$work/some ")" = "$work/some folder" ] || fail "no folder for --web"
    [ -z "$(completed relightd --port 80)" ] || fail "something for --port"
    [ "$(completed relightd --method cac)" = cached ] || fail "no method"
}

zsh_and_fish_can_read_their_completions() {
    local program shells=0
    for program in $programs; do
        if command -v zsh >/dev/null; then zsh -n "$root/usr/share/zsh/vendor-completions/_$program" || fail "zsh: $program"; fi
        if command -v fish >/dev/null; then fish -n "$root/usr/share/fish/vendor_completions.d/$program.fish" || fail "fish: $program"; fi
    done
    if command -v fish >/dev/null; then
        shells=1
        fish -c "source $root/usr/share/fish/vendor_completions.d/relightd.fish; complete -C 'relightd --method cac'" >"$work/offers"
        grep -q '^cached' "$work/offers" || fail "fish offers $(cat "$work/offers")"
    fi
    if command -v zsh >/dev/null; then shells=1; fi
    [ $shells = 1 ] || { echo "skipped: neither zsh nor fish here"; exit 77; }
}

# systemd-analyze looks for programs and manual pages at their installed paths; here they are below $root.
the_unit_is_well_formed_and_lets_little_through() {
    need systemd-analyze
    sed "s|=/usr/bin/relightd|=$root/usr/bin/relightd|" "$root/usr/lib/systemd/system/relightd.service" >"$work/relightd.service"
    MANPATH=$root/usr/share/man systemd-analyze verify --man=yes "$work/relightd.service" >"$work/log" 2>&1 ||
        { cat "$work/log"; fail "systemd-analyze verify"; }
    [ ! -s "$work/log" ] || { cat "$work/log"; fail "systemd-analyze verify has something to say"; }
    systemd-analyze security --offline=true --threshold=12 --no-pager "$root/usr/lib/systemd/system/relightd.service" \
        >"$work/log" 2>&1 || { cat "$work/log"; fail "the exposure is above 1.2 of 10"; }
    tail -n 1 "$work/log"
    local setting
    for setting in Type=notify DynamicUser=yes StateDirectory= CacheDirectory= ProtectSystem=strict MemoryMax= \
        Restart=on-failure NoNewPrivileges=yes WatchdogSec= SystemCallFilter=@system-service; do
        grep -q "^$setting" "$work/relightd.service" || fail "no $setting"
    done
}

# The program finds its page relative to itself, in any folder, and uses nothing of the build tree.
what_is_unpacked_serves_its_page() {
    : >"$work/log"
    (cd / && exec "$root/usr/bin/relightd" --port 0 --size 64x36 --samples 4) 2>"$work/log" &
    pid=$! url= # the trap is obeyed when this function is over
    trap 'kill $pid 2>/dev/null || true; rm -rf "$work"' EXIT
    until url=$(sed -n 's/^relightd: listening on //p' "$work/log") && [ -n "$url" ]; do
        kill -0 "$pid" || { cat "$work/log"; fail "it does not listen"; }
        sleep 0.1
    done
    python3 - "$url" "$root/usr/share/relightd/web/index.html" <<'PY' || fail "another page"
import sys, urllib.request
sys.exit(urllib.request.urlopen(sys.argv[1], timeout=600).read() != open(sys.argv[2], "rb").read())
PY
    kill "$pid"
    wait "$pid" || fail "exit code $?"
}

# So are the programs that it starts to read scenes and videos.
what_is_unpacked_reads_models_and_videos() {
    need ffmpeg
    ffmpeg -nostdin -loglevel error -f lavfi -i testsrc2=s=64x32:r=5:d=1 -c:v mpeg4 "$work/sky.mp4"
    (cd / && "$root/usr/bin/relight-render" --scene "$root/usr/share/doc/relightd/examples/steps.json" --source "$work/sky.mp4" \
        --frames 1-1 --size 32x18 --samples 1 --paths direct --out "$work/out.exr") >"$work/log" 2>&1 || { cat "$work/log"; fail "relight-render"; }
    [ -s "$work/out.exr" ] || fail "no image"
}

# `cmake --install` with another prefix puts everything below it, and the unit names that prefix.
another_prefix_keeps_all_to_itself() {
    cmake --install "$RELIGHT_BUILD" --prefix "$work/opt" >"$work/log" 2>&1 || { cat "$work/log"; fail "cmake --install"; }
    [ -x "$work/opt/bin/relightd" ] && [ -s "$work/opt/etc/relightd/relightd.json" ] || fail "not in the prefix"
    grep -q "^ExecStart=$work/opt/bin/relightd" \
        "$work/opt/lib/systemd/system/relightd.service" || fail "the unit names another program"
}

"$1"
