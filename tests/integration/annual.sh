#!/usr/bin/env bash
# relight-render --annual: tables, measures and maps of some days, what a killed run leaves, and what is refused.
. "$(dirname "$0")/lib.sh"
render=$bin/relight-render
examples="$(dirname "$(readlink -f "$0")")/../../docs/examples"

weather() {
    "$examples/weather.py" --latitude 48 --longitude 11 --zone 1 >"$work/x.epw"
}

# A flat floor under an open sky: every sensor gets what the weather file says. year FOLDER KEYS FLAGS...
year() {
    local folder=$1 keys=$2
    shift 2
    cat >"$work/floor.obj" <<'OBJ'
v -5 0 -5
v -5 0 5
v 5 0 5
v 5 0 -5
usemtl floor
f 1 2 3 4
OBJ
    printf '%s' '{"camera": {"position": [0, 5, 9], "look_at": [0, 0, 0], "fov_y_degrees": 50},
        "models": [{"file": "floor.obj"}], "materials": {"floor": {"type": "lambert", "albedo": [0.5, 0.5, 0.5]}}}' \
        >"$work/floor.json"
    "$render" --scene "$work/floor.json" --source "epw:$work/x.epw,size=256x128$keys" --annual "$work/$folder" \
        --sensors grid:floor,spacing=5,height=1 --size 32x18 --method mis --samples 64 --tune cells=4,sun "$@" 2>"$work/stderr" ||
        { cat "$work/stderr"; fail "relight-render --annual"; }
}

a_year_has_its_tables_measures_and_maps() {
    weather
    year out ,days=06-20:06-22 --pictures 06-21T12:10,06-21T12:30
    python3 - "$work/out" <<'PY'
import csv, json, pathlib, sys

out = pathlib.Path(sys.argv[1])
hours = list(csv.DictReader(open(out / "hours.csv")))
lux = list(csv.DictReader(open(out / "illuminance.csv")))
summary = json.load(open(out / "summary.json"))
sensors = list(csv.DictReader(open(out / "sensors.csv")))
assert len(hours) == len(lux) >= 45, len(hours)
assert len(sensors) == 4 and summary["sensors"] == 4
occupied = autonomous = 0
for h, l in zip(hours, lux):
    want = float(h["open_horizontal_lx"])
    assert h["number"] == l["number"]
    assert abs(float(h["rendered_open_horizontal_lx"]) - want) < 0.03 * want + 1, h  # a coarse sky
    for k in range(4):
        assert abs(float(l[f"lx_{k}"]) / want - 1) < 0.1, (h, l)
    if 8 <= float(h["clock_h"]) < 18:
        occupied += 1
        autonomous += float(l["lx_0"]) >= 300
assert summary["occupied_hours"] == 30 == occupied
assert abs(float(sensors[0]["daylight_autonomy"]) - autonomous / 30) < 1e-4
assert summary["sda"] == 1 and abs(summary["mean_daylight_factor"] - 1) < 0.02
for name in ("index.html", "year-sensors.svg", "year-view.svg", "year-open.svg", "sensors-autonomy.svg",
             "sensors-useful.svg", "sensors-sunlit.svg", "sensors-factor.svg", "picture-0621-1230.png",
             "picture-0621-1230-falsecolour.png", "picture-0621-1230.hdr", "picture-0621-1210.png"):
    assert (out / name).stat().st_size > 200, name
assert b"VIEW= -vtv " in (out / "picture-0621-1230.hdr").read_bytes()[:2000]
PY
}

a_killed_year_goes_on_where_it_ended() {
    weather
    year whole ,days=03-21 --pictures none
    cp -r "$work/whole" "$work/broken"
    # The last row of one table is cut in the middle, two more of the other are missing.
    head -c -20 "$work/whole/hours.csv" >"$work/broken/hours.csv"
    head -n -3 "$work/whole/illuminance.csv" >"$work/broken/illuminance.csv"
    rm "$work/broken/summary.json"
    year broken ,days=03-21 --pictures none --resume
    grep -q 'hours are already done' "$work/stderr" || fail "nothing was kept"
    for f in hours.csv illuminance.csv sensors.csv summary.json; do
        cmp "$work/whole/$f" "$work/broken/$f" || fail "$f differs after --resume"
    done
    for other in days=03-22 'days=03-21 --tune no-visibility' 'days=03-21 --tune cells=2' 'days=03-21 --lamps 5'; do
        # shellcheck disable=SC2086 # several words
        expect 2 'tables for another scene, weather, sensors or settings' "$render" --scene "$work/floor.json" \
            --source "epw:$work/x.epw,size=256x128,"${other} --annual "$work/broken" \
            --sensors grid:floor,spacing=5,height=1 --size 32x18 --method mis --samples 64 --pictures none --resume
    done
}

# Ranks share out the hours; tables and measures are those of one process, also after the job was killed.
a_year_by_several_ranks_has_the_bits_of_one_process() {
    begin_jobs
    weather
    year one ,days=03-21 --pictures 03-21T12:30,03-21T13:30,03-21T14:30,03-21T15:30
    cat >three <<RUN
#!/bin/sh
exec mpirun --oversubscribe -n 3 $render "\$@"
RUN
    chmod +x three
    render=$work/three
    year many ,days=03-21 --pictures 03-21T12:30,03-21T13:30,03-21T14:30,03-21T15:30
    same_files
    # As if it had been killed while a row was written.
    head -n 6 one/hours.csv >many/hours.csv
    head -c -20 one/illuminance.csv | head -n 9 >many/illuminance.csv
    rm many/summary.json many/picture-*
    year many ,days=03-21 --pictures 03-21T12:30,03-21T13:30,03-21T14:30,03-21T15:30 --resume
    grep -q '5 of [0-9]* hours are already done' stderr || { cat stderr; fail "other hours were kept"; }
    same_files
    # A picture that cannot be written ends all ranks.
    rm -r many
    mkdir -p many/picture-0321-1230.png/x
    if (year many ,days=03-21 --pictures 03-21T12:30); then fail "a picture was not written, and nobody says so"; fi
    grep -q 'picture-0321-1230.png' stderr || { cat stderr; fail "the picture is not named"; }
}

# A floor in the open sees the sun for as long as it is up; at the poles the winter has none.
hours_of_sun_are_mapped() {
    weather
    year none ,days=06-20 --pictures none # for the floor
    sun_hours() { # OPEN FILE SOURCE: of the floor, within a tenth
        "$render" --scene "$work/floor.json" --size 32x18 --sun-hours "$work/$2" --source "$3" 2>"$work/stderr" ||
            { cat "$work/stderr"; fail "--sun-hours"; }
        grep -qE "in the open $1," "$work/stderr" || { cat "$work/stderr"; fail "not $1 hours in the open"; }
        python3 - "$work/stderr" <<'PY'
import re, sys
open_h, least, most, mean = map(float, re.search(r"open ([\d.]+), here ([\d.]+) to ([\d.]+), ([\d.]+) on", open(sys.argv[1]).read()).groups())
assert abs(mean - open_h) < 0.1 + 0.01 * open_h and most - least < 0.5 + 0.2 * open_h, (open_h, least, most, mean)
PY
    }
    sun_hours 12.1 day.png sky:date=03-21,latitude=48
    sun_hours 0.0 night.exr sky:date=12-21,latitude=80
    sun_hours '3[0-9].[0-9]' days.exr "epw:$work/x.epw,days=06-20:06-22"
    head -c 4 "$work/days.exr" | cmp - <(printf '\x76\x2f\x31\x01') && head -c 4 "$work/day.png" | cmp - <(printf '\x89PNG')
    expect 2 'sun-hours x.jpg: expected a file name that ends with .png or .exr' "$render" --sun-hours x.jpg --source sky:
    expect 2 "needs the sun's way over a day or a year" "$render" --sun-hours x.png --source cie:5
    expect 2 "needs the sun's way over a day or a year" "$render" --sun-hours x.png --source sky.exr
    expect 2 'out cannot be used with --sun-hours' "$render" --sun-hours x.png --source sky: --out x.exr
    expect 2 'probe cannot be used with --sun-hours' "$render" --sun-hours x.png --source sky: --probe 1,1
    expect 1 "$work/x.epw" "$render" --sun-hours "$work/x.epw/x.png" --source sky: --size 16x9
}

what_makes_no_year_is_refused() {
    weather
    expect 2 'needs the weather of a year: --source epw:FILE' "$render" --annual "$work/no" --source sky:
    expect 1 "$work/none.epw: No such file" "$render" --annual "$work/no" --source "epw:$work/none.epw"
    expect 2 "has no surface 'roof'; it has ground, " "$render" --annual "$work/no" --source "epw:$work/x.epw" \
        --sensors grid:roof --size 16x9
    expect 2 'out cannot be used with --annual' "$render" --annual "$work/no" --source "epw:$work/x.epw" --out x.exr
    expect 2 'not for --annual' "$render" --annual "$work/no" --source "epw:$work/x.epw" --split-frames
    expect 2 '03-21T02:00 is not among the lit hours' "$render" --annual "$work/no" --source "epw:$work/x.epw" \
        --pictures 03-21T02:00
    expect 2 '03-21T09:75 has no time of day; expected 00:00 to 23:59' "$render" --annual "$work/no" \
        --source "epw:$work/x.epw" --pictures 03-21T09:75
    printf '1 2 3 0 1 0\n1 2 3 0 0\n' >"$work/sensors.txt"
    expect 1 'sensors.txt: line 2: number 6 of x y z nx ny nz is missing' "$render" --annual "$work/no" \
        --source "epw:$work/x.epw" --sensors "$work/sensors.txt" --size 16x9
    sed -i '12s/^2021,1,1,\([0-9]*\),/2021,1,1,\1x,/' "$work/x.epw"
    expect 1 "line 12: field 4, the hour, is '4x', which is not a number" "$render" --annual "$work/no" \
        --source "epw:$work/x.epw"
}

# Only the sky: the weather's column has the sky alone too. A name in Latin-1 becomes UTF-8.
what_is_left_out_is_left_out_of_the_weather() {
    weather
    sed -i '1s/Generated/Malm\xf6/' "$work/x.epw"
    year sky ,days=06-21,hours=10-14,only=sky --pictures none --luminance radiance
    python3 - "$work/sky" <<'PY'
import csv, json, pathlib, sys
out = pathlib.Path(sys.argv[1])
for h in csv.DictReader(open(out / "hours.csv")):
    want = float(h["open_horizontal_lx"])
    assert abs(float(h["rendered_open_horizontal_lx"]) / want - 1) < 0.03, h
assert json.load(open(out / "summary.json"))["place"]["name"].startswith("Malm\u00f6, ")
assert "Malm\u00f6, " in (out / "index.html").read_text()
assert all(float(s["sunlit_hours"]) == 0 for s in csv.DictReader(open(out / "sensors.csv")))
PY
}

# A uniform map has pi times its radiance; after --calibrate it is the standard's uniform sky of as many lux, over a white ground.
a_captured_map_is_calibrated() {
    constant_sky "$work/captured.hdr"
    local size=(--size 32x18 --samples 4 --paths direct)
    "$render" "${size[@]}" --source "$work/captured.hdr" --calibrate 20000 --out "$work/calibrated.exr" --stats "$work/calibrated.json"
    "$render" "${size[@]}" --source cie:5,lux=20000,ground=1 --out "$work/uniform.exr" --stats "$work/uniform.json"
    "$render" "${size[@]}" --source "$work/captured.hdr" --probe 9,9 >"$work/captured.json"
    "$render" "${size[@]}" --source sky: --out "$work/sky.exr" --stats "$work/sky.json"
    "$render" "${size[@]}" --source cie:5 --scale 1 --probe 9,9 >"$work/scaled.json"
    local what
    for what in calibrated uniform; do grep -q '"unit": *"W sr^-1 m^-2"' "$work/$what.json" || fail "$what has no unit"; done
    for what in captured sky scaled; do grep -q '"unit": *"relative"' "$work/$what.json" || fail "$what is not relative"; done
    "$bin/relight-diff" "$work/calibrated.exr" "$work/uniform.exr" --max-mean 0.003 --max-relmse 1e-4 ||
        fail "the calibrated map is not the sky of 20,000 lx"
    expect 2 'calibrate cannot be used with --scale' "$render" --calibrate 5 --scale 1 --out "$work/x.exr"
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\0\0\0\0\0\0\0\0' >"$work/black.hdr"
    expect 1 'has no light from above' "$render" --source "$work/black.hdr" --calibrate 5 --size 16x9 --out "$work/x.exr"
}

a_fisheye_view_gets_glare() {
    weather
    year out ,days=06-21,hours=11-13 --pictures none --projection equidistant --position 0,1.5,0 --look-at 0,1.5,-4 \
        --size 64x64
    python3 - "$work/out" <<'PY'
import csv, pathlib, sys
for h in csv.DictReader(open(pathlib.Path(sys.argv[1]) / "hours.csv")):
    eye, dgp = float(h["eye_vertical_lx"]), float(h["dgp"])
    assert min(1, 5.87e-5 * eye + 0.16) <= dgp + 1e-6 <= 1.000002, h
    assert 0.2 < eye / float(h["open_horizontal_lx"]) < 2, h
PY
    [ -s "$work/out/year-glare.svg" ] || fail "no map of glare"
}

"$1"
