#!/bin/bash
# Recomputes figures of the documentation from what the project ships: docs/reproduce.sh [--list | [--write] --all | CLAIM...]
# Prints each claim, where it is made, the commit, the machine and the date, and then what was measured and for how long;
# --write also stores that in docs/internals/measured/CLAIM.txt, which the pages link to. RELIGHT_BIN: the folder of the programs
# and tests (build/bin). Run it on an idle machine: some claims compare times. Exit code: 0 all ran, 1 one failed, 2 wrong usage.
set -euo pipefail
root="$(dirname "$(dirname "$(readlink -f "$0")")")"
bin="${RELIGHT_BIN:-$root/build/bin}"
measured="$root/docs/internals/measured"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
export RELIGHT_LONG=1 # unit tests draw all of their seeds

# name | where | what
claims() {
    cat <<'END'
gains | mathematics.md 6 | variance times rays of every kind of direct light relative to plain mis
shares | mathematics.md 6 | shares of the six faces and of cells against numbers worked out by hand
variance | mathematics.md 16 | a sample's variance against its closed form
furnace | mathematics.md 16 | a white furnace is white by every method of direct light, by eye paths and by path tracing
vpl | mathematics.md 13 | the indirect light of virtual point lights over that of path tracing, six seeds
photons | mathematics.md 13 | photons and virtual point lights within their bias
materials | mathematics.md 8 | what white surfaces return, by roughness
dh09 | speed-and-accuracy.md | path tracing, Metropolis sampling and light tracing under a sun of 1000, by time and by samples
figure5 | mathematics.md 14 | relMSE times time of eye paths over the light tracer's, and the errors of path and mlt in equal time
changes | transport-cache.md | processor time of a cached picture of which a tenth of the sky has changed, over a whole one's
unbiased | transport-cache.md | what correcting the cache by random samples costs, and the bias that it removes
lpg13 | speed-and-accuracy.md | shares against sixths of the faces, and Delta E by samples, on a plaza and a glossy knot under clouds
stated | speed-and-accuracy.md | the error that images state over their true error
live | performance.md | what a viewer of relightd gets under a moving sky
between | timelapse.md | images between two captured skies against those of the skies that were left out
faults | testing.md | faults that once passed are noticed by a unit test of their own room
END
}

unit() { # ROOM_FILE CLAIM...: what a unit test prints of itself
    local program="$bin/test_$1" name
    shift
    for name in "$@"; do
        "$program" "$name" 2>&1 | grep -v '^\[ *\(=\|RUN\|PASSED\)' || return 1
    done
}

gains() { unit estimators_test_gain sun_as_a_stratum_wins_where_it_is_not_seen; }
shares() { unit estimators_test_shares upright_under_an_even_sky towards_a_corner_of_the_cube cells_have_corners_of_their_own; }
variance() { unit estimators_test_lpg13 a_single_sample_has_the_closed_form_variance; }
furnace() {
    unit estimators_test_direct a_white_furnace_is_white_at_every_method &&
        unit estimators_test_path a_white_furnace_is_white &&
        unit estimators_test_eye_paths a_white_court_with_mirror_and_glass_in_a_white_sky_is_white
}
photons() {
    unit estimators_test_baselines photons_bring_caustics photons_bring_indirect_light point_lights_bring_indirect_light
}
materials() { unit surface_test_lobes white_surfaces_return_nearly_everything_and_no_more; }
figure5() { "$bin/figure5" --size 240x135 --runs 5 --seconds 2 --reference 400; }
changes() { "$bin/changes" --turns 9 2>"$work/log"; }
unbiased() {
    local scene
    for scene in "" "$root/docs/examples/steps.json"; do
        "$bin/unbiased" ${scene:+--scene "$scene"} 2>"$work/log"
    done
}

between() {
    unit between_test_between the_sun_moves_and_dims &&
        unit between_test_restore energy_is_right_for_measured_skies_in_known_units energy_is_right_between_broken_clouds &&
        unit between_test_restore shape_alone_suffices_for_clear_skies_at_high_sun &&
        unit between_test_align rotation_comes_from_ten_skies &&
        /usr/bin/python3 -B "$root/tests/references/between.py" "$bin"
}

lpg13() { # visibility is traced, which the paper leaves out
    local scene method samples seed
    /usr/bin/python3 -B "$root/docs/examples/proof.py" "$work"
    for scene in plaza knot; do
        local render=("$bin/relight-render" --scene "$work/$scene.json" --source "$work/clouds.hdr" --size 96x54 --paths direct)
        "${render[@]}" --method mis --samples 4096 --seed 99 --out "$work/truth.exr" 2>"$work/log"
        for method in faces:60 faces-uniform:60 faces-uniform:180 mis:60 mis:240; do
            samples="${method#*:}"
            for seed in 1 2 3 4 5 6 7 8; do
                "${render[@]}" --method "${method%:*}" --samples "$samples" --seed $seed --out "$work/one.exr" 2>"$work/log"
                echo "$scene ${method%:*} $samples $("$bin/relight-diff" --json "$work/one.exr" "$work/truth.exr" |
                    sed 's/.*"rel_mse": \([0-9.e-]*\).*"delta_e": \([0-9.e-]*\).*/\1 \2/')"
            done
        done
    done | awk '
        function even(shares, some, more) { # by how many even samples, where their error is a + b / N
            b = (some - more) / (1 / 60 - 1 / 180); a = some - b / 60
            return shares > a && b > 0 ? b / (shares - a) : "any number"
        }
        { key = $1 ", " $2 ", " $3 " samples"; if (!n[key]++) keys[++count] = key
          error[key, n[key]] = $4; sum[key] += $4; delta[key] += $5; scenes[$1]
          if (n[key] == 1 || $4 < least[key]) least[key] = $4
          if ($4 > most[key]) most[key] = $4 }
        END { for (i = 1; i <= count; i++) { k = keys[i]
                  printf "%s: relMSE %.2e (%.2e to %.2e), Delta E %.2f, means of %d seeds\n", k, sum[k] / n[k], least[k], most[k], delta[k] / n[k], n[k] }
              split("plaza knot", names)
              for (i = 1; i <= 2; i++) { s = names[i]; f = s ", faces, 60 samples"; u = s ", faces-uniform, 60 samples"; v = s ", faces-uniform, 180 samples"
                  printf "%s: 60 samples by shares are worth %.0f even ones by the mean errors; by seed", s, even(sum[f], sum[u], sum[v])
                  for (j = 1; j <= n[f]; j++) { w = even(error[f, j], error[u, j], error[v, j]); printf w + 0 ? " %.0f" : " %s", w }
                  print "" } }'
}

dh09() { # the two rows of the figure: equal time, equal samples a pixel; both of all light, against one reference
    /usr/bin/python3 -B "$root/docs/examples/proof.py" "$work"
    "$bin/figure5" --whole --size 160x90 --runs 8 --reference 200 --sky "$work/thousand.hdr" --seconds 2 --samples 50 |
        sed "s,$work/,,"
}

stated() { # STATED_KEEP: a folder, so that a run goes on where the last one of the same programs ended
    # From seed 4 on: the first three served to choose the audit's constants.
    RELIGHT_BIN="$bin" "$root/tests/figures/stated.py" --reference 8 --first 4 --seeds "${STATED_SEEDS:-2}" ${STATED_KEEP:+--keep "$STATED_KEEP"}
}

live() { # LIVE_FLAGS: of relight-bench, to choose scenes, skies, kernels
    local flags
    read -ra flags <<<"${LIVE_FLAGS:-}"
    echo "relight-bench --live ${flags[*]}"
    "$bin/relight-bench" --live "${flags[@]}" 2>"$work/log" || { tail -n 3 "$work/log"; return 1; }
}
faults() { "$root/tests/mutate/run.sh" --planted; }

vpl() {
    local render=("$bin/relight-render" --source sky: --frames 1 --size 48x27 --paths indirect) lights seed
    "${render[@]}" --method path --samples 2048 --out "$work/path.exr" 2>"$work/log"
    for lights in 256 4096; do
        for seed in 1 2 3 4 5 6; do
            "${render[@]}" --method vpl --samples $lights --seed $seed --out "$work/vpl.exr" 2>"$work/log"
            echo "$lights lights, seed $seed: $("$bin/relight-diff" --json "$work/vpl.exr" "$work/path.exr" |
                sed 's/.*"mean_ratio": \([0-9.e-]*\).*/\1/')"
        done
    done
}

stamp() {
    local commit changed=""
    commit="$(git -C "$root" rev-parse --short HEAD 2>/dev/null || echo "no git")"
    git -C "$root" diff --quiet HEAD -- . ":!docs/internals/measured" 2>/dev/null || changed=", with changes"
    echo "commit $commit$changed; $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -n 1), $(nproc) processors; $(date +%F)"
}

one() { # CLAIM
    local row begun=$SECONDS good=0
    row="$(claims | grep "^$1 |" || true)"
    if [[ -z $row ]]; then
        echo "there is no claim '$1'; docs/reproduce.sh --list names them" >&2
        exit 2
    fi
    echo "== $row"
    stamp
    "$1" || { echo "$1 FAILED"; good=1; }
    echo "($((SECONDS - begun)) s)"
    return $good
}

# That each claim can be made: its function is here, and the unit tests that it names are in the tree.
check() {
    local claim program names name
    while read -r claim _; do declare -F "$claim" >"$work/log" || { echo "$claim has no function"; exit 1; }; done < <(claims)
    while read -r _ _ program names; do
        for name in ${names%%;*}; do
            grep -q "^static void $name(" "$root"/tests/unit/{,*/}"${program/_test_//test_}.c" 2>>"$work/log" || { echo "$program has no $name"; exit 1; }
        done
    done < <(sed -n 's/ &&$//; s/^\([a-z0-9]*()\) { unit /\1 { /p; s/^ *unit \([a-z0-9]*_test\)/x { \1/p' "$0")
}

write=""
if [[ ${1:-} == --write ]]; then
    mkdir -p "$measured"
    write=1
    shift
fi
case "${1:---list}" in
    --list) claims; exit 0 ;;
    --check) check; exit 0 ;;
    --all) mapfile -t wanted < <(claims | cut -d ' ' -f 1) ;;
    -*) sed -n 's/^# //p' "$0" | head -n 4; exit 2 ;;
    *) wanted=("$@") ;;
esac
failed=0
for claim in "${wanted[@]}"; do
    one "$claim" | sed "s,[^ ]*/docs/examples/,docs/examples/,g" | tee "$work/output" || failed=1
    if [[ $write ]] && ! grep -q "^$claim FAILED" "$work/output"; then
        cp "$work/output" "$measured/$claim.txt"
    fi
done
exit "$failed"
