#!/usr/bin/env bash
# Beside Radiance's own programs, where they are installed: skies, direct light in real units, components in both directions, headers.
. "$(dirname "$0")/lib.sh"
render=$bin/relight-render
examples="$(dirname "$(readlink -f "$0")")/../../docs/examples"

# Skips the test where a program of Radiance is missing.
need() {
    local program
    for program in "$@"; do
        command -v "$program" >/dev/null && continue
        echo "skipped: Radiance's $program is not installed"
        exit 77
    done
    # Its libraries of functions lie beside the programs where nobody says else.
    [ -n "${RAYPATH:-}" ] || RAYPATH=.:$(dirname "$(command -v "$1")")/../lib:/usr/local/radiance/lib
    export RAYPATH
}

# A plane with a box, in lib.sh's axes and in Radiance's; box.rad is the same with X to the east, Y to the north.
scene() {
    box_scene "$work"
    sed -i 's/"box": {.*/"box": {"type": "lambert", "albedo": [0.4, 0.1, 0.1]}/' "$work/box.json"
    cat >"$work/box.rad" <<'RAD'
void plastic floor 0 0 5 .5 .5 .5 0 0
void plastic box 0 0 5 .4 .1 .1 0 0
floor polygon ground 0 0 12  5 -5 0  5 5 0  -5 5 0  -5 -5 0
box polygon top 0 0 12  -1 -1 2  1 -1 2  1 1 2  -1 1 2
box polygon south 0 0 12  -1 -1 0  1 -1 0  1 -1 2  -1 -1 2
box polygon north 0 0 12  1 1 0  -1 1 0  -1 1 2  1 1 2
box polygon east 0 0 12  1 -1 0  1 1 0  1 1 2  1 -1 2
box polygon west 0 0 12  -1 1 0  -1 -1 0  -1 -1 2  -1 1 2
RAD
}

weather() {
    "$examples/weather.py" --latitude 48 --longitude 11 --zone 1 >"$work/x.epw"
}

# The annual picture of a day's noon, out/picture-*-1230.hdr: hour DAY KEYS FLAGS...
hour() {
    local day=$1 keys=$2
    shift 2
    "$render" --scene "$work/box.json" --source "epw:$work/x.epw,days=$day$keys" --annual "$work/out" --pictures "${day}T12:30" \
        --method mis --paths direct "$@" 2>"$work/stderr" || { cat "$work/stderr"; fail "--annual"; }
}

# The camera of a picture, in Radiance's words.
view_of() {
    getinfo "$1" | sed -n 's/^[[:space:]]*VIEW= //p'
}

# In python: pixels FILE, rows of the table of hours, means.
cat >"$work/tell.py" <<'PY'
import csv, math, struct, subprocess, sys

def pixels(path):
    """Radiance's own reading: three floats a pixel, W sr^-1 m^-2, EXPOSURE undone."""
    data = subprocess.run(["pvalue", "-H", "-h", "-o", "-df", path], capture_output=True, check=True).stdout
    v = struct.unpack(f"{len(data) // 4}f", data)
    return [v[i:i + 3] for i in range(0, len(v), 3)]

def noon(folder):
    return next(h for h in csv.DictReader(open(f"{folder}/hours.csv")) if abs(float(h["clock_h"]) - 12.5) < 0.1)

def near(have, want, within, what):
    print(f"{what}: {have:.6g}, {want:.6g}: ratio {have / want:.5f}")
    if not abs(have / want - 1) <= within:
        sys.exit(f"FAILED: {what}: {have:.6g} instead of {want:.6g}")
PY
export PYTHONPATH=$work PYTHONDONTWRITEBYTECODE=1

# Pixels that both show lit, away from borders: the mean of each channel agrees within 0.3 %.
the_sun_lights_a_plane_with_a_box_as_rpict_says() {
    need oconv rpict pvalue getinfo
    scene
    weather
    hour 06-21 ,only=sun,ground=0,size=2048x1024 --samples 32 --tune sun --size 96x54
    python3 - "$work/out" >"$work/sun.rad" <<'PY'
import math, sys
from tell import noon
h = noon(sys.argv[1])
altitude, azimuth = math.radians(float(h["sun_altitude_deg"])), math.radians(float(h["sun_azimuth_deg"]))
lux = float(h["open_horizontal_lx"]) / math.sin(altitude)
radiance = lux / 179 / (math.pi * math.radians(0.533 / 2) ** 2)
print("void light sun 0 0 3", *[f"{radiance:.8g}"] * 3)
print("sun source disc 0 0 4", math.sin(azimuth) * math.cos(altitude), math.cos(azimuth) * math.cos(altitude), math.sin(altitude), 0.533)
PY
    oconv "$work/box.rad" "$work/sun.rad" >"$work/sun.oct"
    # shellcheck disable=SC2046 # several words
    rpict -w -ab 0 -ps 1 -pj 0 -dj 0 -x 96 -y 54 $(view_of "$work/out/picture-0621-1230.hdr") "$work/sun.oct" >"$work/sun.hdr"
    python3 - "$work" <<'PY'
import sys
from tell import near, pixels
ours, theirs = pixels(f"{sys.argv[1]}/out/picture-0621-1230.hdr"), pixels(f"{sys.argv[1]}/sun.hdr")
both = [(a, b) for a, b in zip(ours, theirs) if max(b) > 0 and abs(max(a) / max(b) - 1) < 0.05]
lit = [b for b in theirs if max(b) > 0]
assert len(theirs) == 96 * 54 and len(both) > 0.95 * len(lit) > 1000, (len(both), len(lit))
for c in range(3):
    near(sum(a[c] for a, _ in both), sum(b[c] for _, b in both), 0.003, f"channel {c} of {len(both)} pixels")
PY
}

# The pattern over a fisheye that looks up, from the same irradiances: gendaylit's within 1.5 % above 15 degrees, once its total,
# which differs from the weather's by some per cent, is ours.
the_sky_has_the_pattern_of_gendaylit() {
    need gendaylit oconv rpict pvalue getinfo
    scene
    weather
    hour 06-21 ,only=sky,efficacy=179 --samples 4 --size 64x64 --projection equidistant --position 0,90,0 --look-at 0,99,0.0001
    # shellcheck disable=SC2046 # several words
    gendaylit 6 21 12.5 -a 48 -o -11 -m -15 -O 1 -W $(python3 -c "
from tell import noon
h = noon('$work/out')
print(h['direct_normal_w_m2'], h['diffuse_horizontal_w_m2'])") >"$work/sky.rad"
    sed -i '/^void light solar/,/^$/d; /^solar source/,/^$/d' "$work/sky.rad"
    printf 'skyfunc glow sky 0 0 4 1 1 1 0\nsky source dome 0 0 4 0 0 1 180\n' >>"$work/sky.rad"
    oconv "$work/sky.rad" >"$work/sky.oct"
    # shellcheck disable=SC2046 # several words
    rpict -w -ab 0 -ps 1 -pj 0 -x 64 -y 64 $(view_of "$work/out/picture-0621-1230.hdr") "$work/sky.oct" >"$work/sky.hdr"
    python3 - "$work" <<'PY'
import math, sys
from tell import near, noon, pixels
ours, theirs = pixels(f"{sys.argv[1]}/out/picture-0621-1230.hdr"), pixels(f"{sys.argv[1]}/sky.hdr")
sums, total, ratios = [0.0, 0.0], 0.0, []
for i, (a, b) in enumerate(zip(ours, theirs)):
    theta = math.hypot(i % 64 - 31.5, i // 64 - 31.5) * math.pi / 64
    if theta > math.pi / 2:
        continue
    weight = (math.pi / 64) ** 2 * math.sin(theta) / theta * math.cos(theta)
    total += a[1] * weight
    if theta < math.radians(75):
        sums = [s + v[1] * weight for s, v in zip(sums, (a, b))]
        ratios.append(a[1] / b[1])
near(total, float(noon(f"{sys.argv[1]}/out")["diffuse_horizontal_w_m2"]), 0.005, "horizontal irradiance, of the weather")
near(sums[0], sums[1], 0.03, "above 15 degrees, of gendaylit")
mean = sums[0] / sums[1]
print("ratios of pixels to the mean:", min(ratios) / mean, max(ratios) / mean)
assert len(ratios) > 2000 and 0.975 < min(ratios) / mean and max(ratios) / mean < 1.015  # the least one lies beside the sun
PY
}

# Sums of components: of ours by dctimestep, of rcontrib's by this program, and the picture that the matrix itself lights.
components_pass_in_both_directions() {
    need gendaymtx dctimestep rcontrib oconv vwrays pvalue getinfo
    scene
    mkdir "$work/ours" "$work/theirs"
    printf 'place x\nlatitude 48\nlongitude -11\ntime_zone -15\nsite_elevation 0\nweather_data_file_units 1\n6 21 12.5 300 200\n' \
        >"$work/noon.wea"
    gendaymtx -m 1 "$work/noon.wea" >"$work/noon.mtx" 2>/dev/null
    local common=(--scene "$work/box.json" --size 32x18)
    "$render" "${common[@]}" --method mis --samples 64 --paths direct --components "$work/ours/%03d.hdr" 2>/dev/null
    printf 'void glow sky 0 0 4 1 1 1 0\nsky source all 0 0 4 0 0 1 360\n' >"$work/all.rad"
    oconv "$work/box.rad" "$work/all.rad" >"$work/all.oct"
    # shellcheck disable=SC2046 # several words
    vwrays -ff -x 32 -y 18 $(view_of "$work/ours/000.hdr") >"$work/rays"
    rcontrib -w -ffc -x 32 -y 18 -ab 1 -ad 1024 -lw 1e-6 -e MF:1 -f reinhart.cal -b rbin -bn Nrbins -o "$work/theirs/%03d.hdr" -m sky \
        "$work/all.oct" <"$work/rays"
    rcontrib -w -ff -ab 1 -ad 1024 -lw 1e-6 -e MF:1 -f reinhart.cal -b rbin -bn Nrbins -o "$work/view.mtx" -m sky "$work/all.oct" \
        <"$work/rays"
    local who
    for who in ours theirs; do
        dctimestep -oc "$work/$who/%03d.hdr" "$work/noon.mtx" >"$work/$who.hdr" 2>/dev/null
        "$render" "${common[@]}" --method components --parts "$work/$who/%03d.hdr" --source "mtx:$work/noon.mtx" \
            --out "$work/$who.exr" 2>/dev/null
        # relight-diff reads mantissas without Radiance's half, which is 0.3 % of a texel at most.
        "$bin/relight-diff" "$work/$who.exr" "$work/$who.hdr" --max-mean 0.006 --max-relmse 1e-4 || fail "dctimestep's sum of $who"
    done
    "$render" "${common[@]}" --method components --parts "$work/view.mtx" --source "mtx:$work/noon.mtx" --out "$work/view.exr" 2>/dev/null
    "$render" "${common[@]}" --method mis --samples 256 --paths direct --source "mtx:$work/noon.mtx" --out "$work/lit.exr" 2>/dev/null
    "$bin/relight-diff" "$work/ours.exr" "$work/lit.exr" --max-mean 0.005 --max-relmse 0.01 || fail "the sum of ours is not the picture"
    for who in theirs view; do
        "$bin/relight-diff" "$work/$who.exr" "$work/lit.exr" --max-mean 0.03 --max-relmse 0.1 || fail "rcontrib's patches are not ours"
    done
}

# Radiance's programs take view and units from the header, and a glare source for what it is.
headers_are_read_by_radiances_programs() {
    need evalglare pvalue getinfo falsecolor
    scene
    weather
    hour 12-21 ,only=sky --samples 64 --size 256x256 --projection equidistant --position 0,1.6,-4 --look-at 0,1.6,4
    evalglare -d "$work/out/picture-1221-1230.hdr" >"$work/glare" 2>"$work/glare.err" || { cat "$work/glare.err"; fail evalglare; }
    cat "$work/glare.err" "$work/glare"
    python3 - "$work" <<'PY'
import math, re, sys
from tell import near, noon, pixels
h = noon(f"{sys.argv[1]}/out")
line = next(l for l in open(f"{sys.argv[1]}/glare") if l.startswith("dgp,"))
v = [float(x) for x in line.split(":")[1].split()]
near(v[2], float(h["eye_vertical_lx"]), 0.02, "vertical illuminance")
print("dgp", v[0], h["dgp"])
assert 0.2 < v[0] < 1 and abs(v[0] - float(h["dgp"])) < 0.03, (v[0], h["dgp"])
PY
    falsecolor -i "$work/out/picture-1221-1230.hdr" -s 10000 -lw 0 -lh 0 >"$work/false.hdr" || fail falsecolor # without a legend
    getinfo -d "$work/false.hdr" | grep -Eq "256 +.X +256" || fail "falsecolor wrote no picture of this size"
}

"$1"
