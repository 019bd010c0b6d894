# Pictures by Cycles, kept under a hash of all that goes into them; sourced by compare.sh and models.sh.
cycles_folder="$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")"

cycles_need() {
    if ! command -v blender >/dev/null; then
        echo 'skipped: Blender is not installed (Debian package: blender)'
        exit 77
    fi
}

# The files that a scene consists of, one a line.
cycles_files() {
    python3 - "$1" <<'PY'
import json, os, sys
from urllib.parse import unquote

def files(path):
    yield path
    if not os.path.exists(path):
        return
    folder = os.path.dirname(path)
    if path.endswith(".json"):
        for model in json.load(open(path, encoding="utf-8"))["models"]:
            yield from files(os.path.join(folder, model["file"]))
    elif path.endswith(".gltf"):
        desc = json.load(open(path, encoding="utf-8"))
        for part in desc.get("buffers", []) + desc.get("images", []):
            if not part.get("uri", "data:").startswith("data:"):
                yield os.path.join(folder, unquote(part["uri"]))

print("\n".join(files(sys.argv[1])))
PY
}

# Contents count, not names, so that a scene may be moved or copied.
cycles_digest() {
    {
        cat "$cycles_folder/cycles.py" "$2"
        cycles_files "$1" | while IFS= read -r file; do sha256sum <"$file"; done
        blender --version
        shift 2
        echo "$*"
    } | sha256sum | cut -c 1-32
}

# cycles_picture SCENE ENVIRONMENT WIDTHxHEIGHT SPP FLAGS OF cycles.py: $reference becomes the picture's name.
# False: Blender made none, and said why.
cycles_picture() {
    local scene=$1 environment=$2 size=$3 spp=$4 part
    shift 4
    local cache="${RELIGHT_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/relight/cycles}"
    reference="$cache/$(cycles_digest "$scene" "$environment" "$size" "$spp" "$*").exr"
    [[ ! -s $reference ]] || return 0
    mkdir -p "$cache"
    part="$cache/part.$$"
    echo "rendering $size at $spp samples with Cycles" >&2
    if ! blender -b -noaudio -P "$cycles_folder/cycles.py" -- "$scene" "$environment" "$part.exr" "${size%x*}" "${size#*x}" \
        "$spp" "$@" >"$part.log" 2>&1 || [[ ! -s $part.exr ]]; then
        grep -v '^Fra:' "$part.log" >&2
        rm -f "$part.log" "$part.exr"
        return 1
    fi
    rm "$part.log"
    mv "$part.exr" "$reference" # at once, for whoever else looks for it
}
