# Shared by the integration scripts, which source it; $bin is the folder of the programs.
set -euo pipefail
bin=${RELIGHT_BIN:?the folder of the programs}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export XDG_CACHE_HOME=$work/cache

fail() {
    echo "FAILED: $*"
    exit 1
}

# count FEW ALL: a number of samples or a bound, for each commit and for `./test --long`.
count() {
    if [ -n "${RELIGHT_LONG:-}" ]; then echo "$2"; else echo "$1"; fi
}

# Skips the test without external data; sets $data to its folder.
need_data() {
    if [ -z "${RELIGHT_TEST_DATA:-}" ]; then
        echo "skipped: RELIGHT_TEST_DATA is not set"
        exit 77
    fi
    data=$RELIGHT_TEST_DATA
    scenes=$RELIGHT_TEST_DATA/../scenes
    reference=$RELIGHT_TEST_DATA/../reference
}

# Other renderers' pictures in $reference are of 640x360. A pixel is the mean of its area: each commit renders a sixteenth of
# the pixels, of this size, and compares them with the reference's means of 4x4. It leaves out the worst 4 % instead of 2: borders
# of shadows cover twice the share of such pixels. of_size NAME prints the picture to compare with.
side=$(count 4 1)
trim=$(count 0.04 0.02)
size=$((640 / side))x$((360 / side))
of_size() {
    if [ "$size" = 640x360 ]; then echo "$reference/$1.exr"; else
        [ -e "$work/$1.reference.exr" ] || "$bin/shrink" "$reference/$1.exr" "$side" "$work/$1.reference.exr"
        echo "$work/$1.reference.exr"
    fi
}

# expect CODE 'PATTERN' COMMAND...: the command exits with that code, and a line of its standard error matches.
expect() {
    local want=$1 pattern=$2 got=0
    shift 2
    "$@" >"$work/stdout" 2>"$work/stderr" || got=$?
    [ "$got" = "$want" ] || { cat "$work/stderr"; fail "exit code $got instead of $want: $*"; }
    grep -Eq -- "$pattern" "$work/stderr" || { cat "$work/stderr"; fail "no '$pattern' on standard error: $*"; }
}

# waits PATTERN FILE PID: until a line of the program's log matches. Ten minutes only end a hang.
waits() {
    local i
    for ((i = 0; i < 6000; i++)); do
        grep -q -- "$1" "$2" && return
        kill -0 "$3" 2>/dev/null || break
        sleep 0.1
    done
    grep -q -- "$1" "$2" && return # said just before it ended
    cat "$2"
    fail "no '$1' in the log"
}

# A flat Radiance file of 2x1 texels of radiance 1: mantissa 128 of 256, exponent 129.
constant_sky() {
    printf '#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x81' >"$1"
}

# A small generated scene: a box on a floor.
box_scene() {
    cat >"$1/box.obj" <<'OBJ'
v -5 0 -5
v -5 0 5
v 5 0 5
v 5 0 -5
usemtl floor
f 1 2 3 4
v -1 0 -1
v -1 0 1
v 1 0 1
v 1 0 -1
v -1 2 -1
v -1 2 1
v 1 2 1
v 1 2 -1
usemtl box
f 9 10 11 12
f 6 7 11 10
f 7 8 12 11
f 8 5 9 12
f 5 6 10 9
OBJ
    cat >"$1/box.json" <<'JSON'
{
 "camera": {"position": [4, 3, 6], "look_at": [0, 0.8, 0], "up": [0, 1, 0], "fov_y_degrees": 40},
 "models": [{"file": "box.obj"}],
 "materials": {
  "floor": {"type": "lambert", "albedo": [0.5, 0.5, 0.5]},
  "box": {"type": "phong", "diffuse": [0.4, 0.1, 0.1], "specular": [0.4, 0.4, 0.4], "exponent": 60}
 }
}
JSON
}

# For MPI jobs, in $work: pictures of one process go to one/, those of a job to many/.
begin_jobs() {
    command -v mpirun >/dev/null || { echo "skipped: no mpirun"; exit 77; }
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 # in containers
    export OMPI_MCA_orte_tmpdir_base="$work/mpi"                     # jobs at once would take a common folder from each other
    render=$bin/relight-render
    cd "$work"
    mkdir one many mpi
}

# job N ARGUMENT...: relight-render on N ranks.
job() {
    local n=$1
    shift
    mpirun --oversubscribe -n "$n" "$render" "$@"
}

same_files() {
    [ "$(ls one)" = "$(ls many)" ] || fail "other files: $(ls many)"
    for file in one/*; do cmp "$file" "many/${file#one/}"; done
}
