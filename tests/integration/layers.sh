#!/usr/bin/env bash
# relight-render --layers, read by OpenImageIO, which reads by OpenEXR's own library.
. "$(dirname "$0")/lib.sh"
ring="$(dirname "$(readlink -f "$0")")/../../docs/examples/ring.json"

need_oiiotool() {
    command -v oiiotool >/dev/null && return
    echo "skipped: oiiotool is missing (openimageio-tools)"
    exit 77
}

# Prints Python that reads files: read(NAME) gives a dictionary of channels for each pixel, attribute(NAME, KEY) a text.
reader() {
    cat <<'PY'
import json, re, struct, subprocess, sys

def oiio(*arguments):
    return subprocess.run(["oiiotool", *arguments], capture_output=True, text=True, check=True).stdout

def read(name):
    said = oiio("--info", "-v", "--dumpdata", name)
    channels = re.search(r"channel list: (.*)", said).group(1)
    channels = re.sub(r" \(\w+\)", "", channels).split(", ")
    found = re.findall(r"Pixel \(\d+, \d+\): (.*)", said)
    assert found, name
    return [dict(zip(channels, map(float, line.split()))) for line in found]

def manifest(name, layer):
    keys = re.findall(r'cryptomatte/(\w+)/name: "(\w+)"', oiio("--info", "-v", name))
    key = [k for k, n in keys if n == layer]
    assert len(key) == 1, keys
    return json.loads(re.search(rf'cryptomatte/{key[0]}/manifest: "(.*)"\n', oiio("--info", "-v", name)).group(1))

def near(a, b):
    return abs(a - b) <= 2e-6 * max(abs(a), abs(b)) + 1e-6

def luminance(p, layer=""):
    return sum(w * p[layer + c] for w, c in zip((0.2126, 0.7152, 0.0722), "RGB"))

LIGHTS = ("direct", "indirect", "caustics", "background")
PY
}

# Of the unfiltered picture where there is a filter. The picture itself is the one that has no layers.
light_layers_add_up_to_the_picture() {
    need_oiiotool
    local options
    for options in '--samples 8' '--samples 8 --eye-paths 4 --denoise' '--method cached' '--method latlong --samples 4 --indirect light' \
        '--samples 4 --eye-paths 4 --caustics stored --tune stored-paths=5000' '--samples 4 --eye-paths 4 --ground --half' \
        '--samples 4 --paths direct'; do
        # shellcheck disable=SC2086
        "$bin/relight-render" --scene "$ring" --source sky:time=09:00,size=256x128 --size 32x18 $options --out "$work/plain.exr"
        # shellcheck disable=SC2086
        "$bin/relight-render" --scene "$ring" --source sky:time=09:00,size=256x128 --size 32x18 $options --layers \
            --out "$work/layers.exr"
        { reader; cat <<'PY'; } | /usr/bin/python3 -B - "$work" "$options" || fail "$options"
plain, layers = read(sys.argv[1] + "/plain.exr"), read(sys.argv[1] + "/layers.exr")
options = sys.argv[2]
same = (lambda a, b: abs(a - b) <= 4e-3 * max(abs(a), abs(b)) + 1e-4) if "--half" in options else near
whole = "unfiltered." if "--denoise" in options else ""
assert ("unfiltered.R" in layers[0]) == bool(whole)
for a, b in zip(plain, layers):
    for c in "RGB":
        assert same(a[c], b[c]), (c, a[c], b[c])
        assert same(sum(b[f"{n}.{c}"] for n in LIGHTS), b[whole + c]), (c, b)
        assert same(b[f"sun.{c}"] + b[f"sky.{c}"], b[f"direct.{c}"]), (c, b)
        if not any(m in options for m in ("cached", "latlong")):
            assert min(b[f"{n}.{c}"] for n in (*LIGHTS, "sun", "sky")) >= -1e-6, (c, b)
        if "--paths direct" in options:
            assert b[f"indirect.{c}"] == b[f"caustics.{c}"] == 0.0
    assert b["A"] == 1.0
total = {n: sum(luminance(b, n + ".") for b in layers) for n in (*LIGHTS, "sun", "sky")}
assert total["sun"] > total["sky"] > 0.0 and total["background"] > 0.0, total
if "--paths direct" not in options:
    assert total["indirect"] > 0.0 and total["caustics"] > 0.0, total
if whole:
    assert any(not near(b["R"], b["unfiltered.R"]) for b in layers)
    image, unfiltered = (sum(luminance(b, n) for b in layers) for n in ("", "unfiltered."))
    assert abs(unfiltered / image - 1.0) < 0.03, (unfiltered, image) # the filter keeps the light; layers have it once
PY
    done
}

# Without a sun all direct light is the sky's; lamps are a layer of their own.
a_grey_sky_has_no_sun_and_lamps_are_apart() {
    need_oiiotool
    box_scene "$work"
    constant_sky "$work/sky.hdr"
    sed -i 's/"type": "lambert"/"type": "lambert", "emission": [0.25, 0.5, 1]/' "$work/box.json"
    "$bin/relight-render" --scene "$work/box.json" --source "$work/sky.hdr" --size 32x18 --samples 4 --layers \
        --out "$work/layers.exr"
    { reader; cat <<'PY'; } | /usr/bin/python3 -B - "$work" || fail "layers"
layers = read(sys.argv[1] + "/layers.exr")
for b in layers:
    for c in "RGB":
        assert b[f"sun.{c}"] == 0.0 and b[f"sky.{c}"] == b[f"direct.{c}"]
        assert near(sum(b[f"{n}.{c}"] for n in (*LIGHTS, "lamps")), b[c]), (c, b)
assert max(b["lamps.B"] for b in layers) >= 1.0
PY
}

# The floor is at y = 0; the box is 2 m high. Names come from the model, and from the file where it has none.
surfaces_have_position_depth_and_an_id() {
    need_oiiotool
    box_scene "$work"
    constant_sky "$work/sky.hdr"
    sed -i 's/^usemtl floor/o floor\n&/; s/^usemtl box/o crate\nusemtl crate/' "$work/box.obj"
    sed -i 's/"box":/"crate":/' "$work/box.json"
    "$bin/relight-render" --scene "$work/box.json" --source "$work/sky.hdr" --size 64x36 --samples 2 --paths direct \
        --layers --half --out "$work/layers.exr"
    { reader; cat <<'PY'; } | /usr/bin/python3 -B - "$work" || fail "layers"
name = sys.argv[1] + "/layers.exr"
layers = read(name)
eye, at = (4, 3, 6), (0, 0.8, 0)
ahead = [b - a for a, b in zip(eye, at)]
length = sum(x * x for x in ahead) ** 0.5
ids = {layer: {n: struct.unpack("<f", struct.pack("<I", int(h, 16)))[0] for n, h in manifest(name, layer).items()}
       for layer in ("CryptoObject", "CryptoMaterial")}
assert set(ids["CryptoObject"]) == {"floor", "crate"}, ids
assert set(ids["CryptoMaterial"]) == {"floor", "crate"}, ids
seen = {"floor": 0, "crate": 0, "nothing": 0, "edge": 0}
for b in layers:
    p, n = [b["P." + c] for c in "XYZ"], [b["N." + c] for c in "XYZ"]
    if b["Z"] == 1e10:
        assert p == n == [0, 0, 0]
    else:
        assert near(b["Z"], sum(a * (x - e) for a, x, e in zip(ahead, p, eye)) / length), b
        assert abs(sum(x * x for x in n) - 1) < 2e-3 and -1e-5 <= p[1] <= 2.00001, b
        on_floor = abs(p[1]) < 1e-5
        assert not on_floor or n[1] == 1.0, b
        albedo = [b["albedo." + c] for c in "RGB"]
    for layer in ids:
        ranks = [(b[f"{layer}0{k}.{i}"], b[f"{layer}0{k}.{c}"]) for k in range(3) for i, c in ("RG", "BA")]
        shares = [share for _, share in ranks]
        assert shares == sorted(shares, reverse=True) and 0 <= sum(shares) <= 1 + 1e-6, ranks
        assert all(i in ids[layer].values() for i, share in ranks if share > 0) and all(i == 0 for i, s in ranks if s == 0), ranks
        if layer == "CryptoObject":
            who = {i: n for n, i in ids[layer].items()}
            kind = "nothing" if shares[0] == 0 else "edge" if shares[0] < 1 else who[ranks[0][0]]
            seen[kind if kind in seen else "crate"] += 1
            if b["Z"] < 1e10 and shares[0] == 1:
                assert (who[ranks[0][0]] == "floor") == on_floor, b
                assert all(abs(x - 0.5) < 1e-3 for x in albedo) == on_floor, b
assert min(seen.values()) > 10, seen
PY
}

# The stated error against the true one, without the worst pixels.
the_error_layer_states_the_noise() {
    need_oiiotool
    local render=("$bin/relight-render" --source sky:time=09:00,size=256x128 --size 48x27) options
    "${render[@]}" --samples 512 --eye-paths 256 --seed 5 --out "$work/truth.exr"
    for options in '--samples 16' '--samples 16 --denoise' '--samples 64 --eye-paths 16'; do
        # shellcheck disable=SC2086
        "${render[@]}" $options --layers --out "$work/layers.exr"
        { reader; cat <<'PY'; } | /usr/bin/python3 -B - "$work" || fail "$options"
truth, layers = read(sys.argv[1] + "/truth.exr"), read(sys.argv[1] + "/layers.exr")
layer = "unfiltered." if "unfiltered.R" in layers[0] else ""
lit = [(b["error.Y"] ** 2, (luminance(b, layer) - luminance(a)) ** 2) for a, b in zip(truth, layers) if b["samples.Y"] > 0]
keep = int(0.98 * len(lit))
stated, true = (sum(sorted(x[k] for x in lit)[:keep]) for k in (0, 1))
assert 0.6 < (stated / true) ** 0.5 < 1.6, (stated / true) ** 0.5
PY
    done
}

layers_that_cannot_be_are_refused() {
    local render=("$bin/relight-render" --size 16x9 --samples 1 --layers)
    expect 2 '--layers is for --out in .exr, not in .png' "${render[@]}" --out "$work/x.png"
    expect 2 '--layers does not work with the reference method path' "${render[@]}" --method path --out "$work/x.exr"
    expect 2 '--layers and --alpha exclude each other' "${render[@]}" --ground --alpha --out "$work/x.exr"
    expect 2 '--layers takes --samples and --eye-paths' "$bin/relight-render" --size 16x9 --fps 4 --layers --out "$work/x.exr"
    expect 2 '--layers needs --out' "${render[@]}" --probe 1,1
    [ ! -e "$work/x.exr" ] || fail "a picture all the same"
}

"$1"
