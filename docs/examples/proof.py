#!/usr/bin/env python3
"""Writes two scenes and a sky for measurements: plaza.obj and plaza.json (arcades around a paved square with steps and an
obelisk, matte), knot.obj and knot.json (a glossy knot of 240 000 triangles on a plinth), and clouds.hdr (broken clouds
around a sun that is not clipped: 3e4 times the sky), and thousand.hdr (a clear sky whose sun, a disc of 3 degrees, is 1000
times as bright as the rest).

With --clouds N instead: clouds.0000.exr to clouds.<N-1>.exr, clouds that drift before a moving sun of 0.53 degrees, which
is not clipped either: about 2e5 times as bright as the sky.

    python3 proof.py FOLDER
    python3 proof.py FOLDER --clouds N [--step SECONDS] [--hour H]
"""
import argparse
import json
import math
import pathlib
import random
import struct
import zlib

WIDTH, HEIGHT = 512, 256  # of the sky
SUN = (0.8, 0.28)  # its place in the picture
ALONG, AROUND = 3000, 40  # of the knot


class Mesh:
    def __init__(self):
        self.lines, self.count = [], 0

    def use(self, material):
        self.lines.append(f"usemtl {material}")

    def quad(self, *corners):
        self.lines += ["v %.4f %.4f %.4f" % c for c in corners]
        self.lines.append("f %d %d %d %d" % tuple(self.count + k for k in (1, 2, 3, 4)))
        self.count += 4

    def box(self, x0, x1, y0, y1, z0, z1):
        p = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
        for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
            self.quad(p[a], p[b], p[c], p[d])

    def write(self, path):
        path.write_text("\n".join(self.lines) + "\n")


def plaza():
    mesh, rng = Mesh(), random.Random(4)
    mesh.use("paving")
    for i in range(-12, 12):
        for j in range(-12, 12):
            y = rng.uniform(0, 0.01)
            mesh.quad((i, y, j), (i, y, j + 0.97), (i + 0.97, y, j + 0.97), (i + 0.97, y, j))
    mesh.quad((-40, -0.005, -40), (-40, -0.005, 40), (40, -0.005, 40), (40, -0.005, -40))
    mesh.use("stone")
    for k in range(4):  # steps and obelisk
        mesh.box(-2 + 0.4 * k, 2 - 0.4 * k, 0.25 * k, 0.25 * (k + 1), -2 + 0.4 * k, 2 - 0.4 * k)
    mesh.box(-0.4, 0.4, 1, 5.5, -0.4, 0.4)
    mesh.use("plaster")
    for side in range(3):  # arcades on three sides: pillars, lintel, wall behind
        turn = lambda x0, x1, z0, z1: ((x0, x1, z0, z1), (z0, z1, x0, x1), (-z1, -z0, x0, x1))[side]  # noqa: B023, E731
        for k in range(-11, 12, 2):
            x0, x1, z0, z1 = turn(k - 0.3, k + 0.3, -11.5, -10.9)
            mesh.box(x0, x1, 0, 3.2, z0, z1)
        x0, x1, z0, z1 = turn(-11.5, 11.5, -14, -10.9)
        mesh.box(x0, x1, 3.2, 4.4, z0, z1)
        x0, x1, z0, z1 = turn(-11.5, 11.5, -14, -13.7)
        mesh.box(x0, x1, 0, 3.2, z0, z1)
    return mesh, {
        "camera": {"position": [6.5, 3.4, 10.5], "look_at": [-0.5, 1.6, -2], "up": [0, 1, 0], "fov_y_degrees": 48},
        "models": [{"file": "plaza.obj"}],
        "materials": {"paving": {"type": "lambert", "albedo": [0.42, 0.4, 0.37]},
                      "stone": {"type": "lambert", "albedo": [0.62, 0.6, 0.55]},
                      "plaster": {"type": "lambert", "albedo": [0.7, 0.58, 0.45]}},
    }


def knot():
    """A tube about a (2, 3) torus knot, its radius rippled, so that every triangle has another normal."""
    def centre(t):
        r = 1.0 + 0.42 * math.cos(3 * t)
        return r * math.cos(2 * t), 1.75 + 0.55 * math.sin(3 * t), r * math.sin(2 * t)

    mesh = Mesh()
    mesh.use("floor")
    mesh.quad((-9, 0, -9), (-9, 0, 9), (9, 0, 9), (9, 0, -9))
    mesh.use("stone")
    mesh.box(-1.2, 1.2, 0, 0.7, -1.2, 1.2)
    mesh.use("glaze")
    first, lines = mesh.count, mesh.lines
    for i in range(ALONG):
        t = 2 * math.pi * i / ALONG
        a, b = centre(t), centre(t + 1e-4)
        along = [q - p for p, q in zip(a, b)]
        size = math.sqrt(sum(k * k for k in along))
        along = [k / size for k in along]
        side = [along[2], 0, -along[0]]
        size = math.sqrt(sum(k * k for k in side))
        side = [k / size for k in side]
        up = [side[1] * along[2] - side[2] * along[1], side[2] * along[0] - side[0] * along[2], side[0] * along[1] - side[1] * along[0]]
        for j in range(AROUND):
            f = 2 * math.pi * j / AROUND
            r = 0.3 * (1 + 0.05 * math.sin(60 * t) * math.cos(4 * f))
            lines.append("v %.5f %.5f %.5f" % tuple(a[k] + r * (math.cos(f) * side[k] + math.sin(f) * up[k]) for k in range(3)))
    for i in range(ALONG):
        for j in range(AROUND):
            p, q = i * AROUND, (i + 1) % ALONG * AROUND
            corners = (p + j, p + (j + 1) % AROUND, q + (j + 1) % AROUND, q + j)
            lines.append("f %d %d %d %d" % tuple(first + 1 + k for k in corners))
    return mesh, {
        "camera": {"position": [2.6, 2.6, 4.4], "look_at": [0, 1.4, 0], "up": [0, 1, 0], "fov_y_degrees": 38},
        "models": [{"file": "knot.obj", "smooth": True}],
        "materials": {"floor": {"type": "lambert", "albedo": [0.4, 0.4, 0.42]}, "stone": {"type": "lambert", "albedo": [0.6, 0.57, 0.5]},
                      "glaze": {"type": "phong", "diffuse": [0.1, 0.28, 0.36], "specular": [0.55, 0.55, 0.55], "exponent": 150}},
    }


def noise(rng):
    """Smooth noise on the sphere's directions, about 0 to 1: sums of waves of falling size."""
    waves = []
    for octave in range(5):
        for _ in range(6):
            w = [rng.gauss(0, 1) * 2.2 * 2 ** octave for _ in range(3)]
            waves.append((0.5 ** octave, w, rng.uniform(0, 2 * math.pi)))
    return lambda d: 0.5 + 0.13 * sum(a * math.sin(w[0] * d[0] + w[1] * d[1] + w[2] * d[2] + p) for a, w, p in waves)


def direction(u, v):
    phi, theta = math.pi - 2 * math.pi * u, math.pi * v
    return math.sin(theta) * math.sin(phi), math.cos(theta), math.sin(theta) * math.cos(phi)


def clouds(d, sun, cover):
    near = sum(a * b for a, b in zip(d, sun))
    if d[1] < 0:
        return [0.12, 0.11, 0.1]
    cloud = min(1.0, max(0.0, (cover((d[0] / (d[1] + 0.25), 0.0, d[2] / (d[1] + 0.25))) - 0.42) * 4))
    blue = [0.25 + 0.1 * (1 - d[1]), 0.42 + 0.12 * (1 - d[1]), 0.85]
    glow = 1.5 * max(0.0, near) ** 60
    grey = 0.5 + 1.3 * max(0.0, near) ** 8 + 0.3 * (1 - cloud)
    rgb = [(1 - cloud) * (b + glow) + cloud * grey for b in blue]
    if near > math.cos(math.radians(0.55)):
        rgb = [c + 3e4 * k * (1 - 0.999 * cloud) for c, k in zip(rgb, (1, 0.92, 0.8))]
    return rgb


def thousand(d, sun):
    """A clear sky of about 1 and a sun as of [DH09, Fig. 5], wide enough that its shadows and caustics are seen."""
    if sum(a * b for a, b in zip(d, sun)) > math.cos(math.radians(1.5)):
        return [1000.0, 1000.0, 1000.0]
    return [0.9, 1.0, 1.2] if d[1] > 0 else [0.3, 0.3, 0.3]


def write_sky(path, light):
    """Radiance RGBE without run lengths: exponents hold the sun. light: colour of a direction."""
    with open(path, "wb") as out:
        out.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (HEIGHT, WIDTH))
        for y in range(HEIGHT):
            for x in range(WIDTH):
                rgb = light(direction((x + 0.5) / WIDTH, (y + 0.5) / HEIGHT))
                exponent = math.frexp(max(rgb))[1]
                scale = 256.0 / 2.0 ** exponent
                out.write(struct.pack("4B", *(min(255, int(c * scale)) for c in rgb), exponent + 128))


# ---- A sequence of clouds in OpenEXR ----

WIDE = 1024, 512  # pixels of each image
LATITUDE, DECLINATION = math.radians(45), math.radians(15)
PERIOD, TEXELS = 8, 512  # of the tile of noise: in heights of the clouds' base, 1.5 km, and in samples
WIND = (0.0067, 0.002), (0.004, 0.0045)  # of the large and of the small shapes, 1.5 km/s: 10 and 9 m/s
SUN_COSINE = math.cos(math.radians(0.265))
SUN_RADIANCE = 2e5  # outside the air; the clear sky is about 0.5 to 1


def tile(rng):
    """Smooth noise from 0 to 1 that repeats at the edges: four octaves."""
    out = [[0.0] * TEXELS for _ in range(TEXELS)]
    for octave in range(4):
        cells = 2 * PERIOD << octave
        grid = [[rng.random() for _ in range(cells)] for _ in range(cells)]
        steps = [(int(k * cells / TEXELS), k * cells / TEXELS % 1) for k in range(TEXELS)]
        steps = [(i, (i + 1) % cells, a * a * (3 - 2 * a)) for i, a in steps]
        for row, (j, l, b) in zip(out, steps):
            near = [p * (1 - b) + q * b for p, q in zip(grid[j], grid[l])]
            for x, (i, k, a) in enumerate(steps):
                row[x] += (near[i] * (1 - a) + near[k] * a) * 0.5 ** octave * 8 / 15
    return out


def sun_at(hour):
    """The direction to the sun: Y up, north +Z, east -X."""
    turn = math.radians(15 * (hour - 12))
    up = math.sin(LATITUDE) * math.sin(DECLINATION) + math.cos(LATITUDE) * math.cos(DECLINATION) * math.cos(turn)
    return (math.cos(DECLINATION) * math.sin(turn), up,
            math.sin(DECLINATION) * math.cos(LATITUDE) - math.cos(DECLINATION) * math.sin(LATITUDE) * math.cos(turn))


def covered(x, y, sun):
    """The part of a pixel that the sun covers."""
    inside = 0
    for j in range(16):
        for i in range(16):
            d = direction((x + (i + 0.5) / 16) / WIDE[0], (y + (j + 0.5) / 16) / WIDE[1])
            inside += sum(a * b for a, b in zip(d, sun)) > SUN_COSINE
    return inside / 256


def drifting(noise_tile, pixels, sun, seconds):
    """Three planes of rows. pixels: of each row of the upper half its directions and their places on the clouds' plane."""
    mass = 1 / max(0.03, sun[1] + 0.05)  # of air, relative to that above
    white = [math.exp(-t * mass) for t in (0.1, 0.15, 0.27)]
    bright = 0.25 + 0.75 * max(0.0, sun[1])
    scale = TEXELS / PERIOD
    (ax, az), (bx, bz) = ((seconds * k for k in w) for w in WIND)

    def noise_at(u, v):
        i, j = math.floor(u), math.floor(v)
        a, b = u - i, v - j
        top, low = noise_tile[j % TEXELS], noise_tile[(j + 1) % TEXELS]
        i, k = i % TEXELS, (i + 1) % TEXELS
        return (top[i] * (1 - a) + top[k] * a) * (1 - b) + (low[i] * (1 - a) + low[k] * a) * b

    red, green, blue = [], [], []
    for y, row in enumerate(pixels):
        for x, (dx, dy, dz, px, pz) in enumerate(row):
            shape = 0.65 * noise_at((px - ax) * scale, (pz - az) * scale) + \
                0.35 * noise_at((px - bx) * scale * 2.7, (pz - bz) * scale * 2.7)
            cloud = min(1.0, max(0.0, (shape - 0.47) * 7))
            near = max(0.0, dx * sun[0] + dy * sun[1] + dz * sun[2])
            glow = 1.5 * near ** 60
            grey = cloud * bright * (0.85 + 1.2 * near ** 8 + 0.5 * (1 - cloud))
            clear = 1 - cloud
            rgb = [clear * (bright * (c + (0.35 - 0.25 * k) * (1 - dy)) + glow * w) + grey * (0.3 + 0.7 * w)
                   for k, (c, w) in enumerate(zip((0.2, 0.36, 0.75), white))]
            if near > 0.9999:  # 0.8 degrees: all pixels that the sun may touch
                part = SUN_RADIANCE * covered(x, y, sun) * (1 - 0.999 * cloud)
                rgb = [c + part * w for c, w in zip(rgb, white)]
            red.append(rgb[0])
            green.append(rgb[1])
            blue.append(rgb[2])
    for plane, ground in ((red, 0.12), (green, 0.11), (blue, 0.1)):
        plane += [ground * bright] * (WIDE[0] * (WIDE[1] - len(pixels)))
    return red, green, blue


def attribute(name, kind, value):
    """One line of an OpenEXR header."""
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def write_exr(path, planes, size=WIDE, half=False, pack=True, more=b""):
    """planes: red, green and blue, rows from the top. pack: ZIP compression of 16 rows each, else none. more: attributes
    that end the header [OpenEXR file layout]."""
    width, height = size
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(c + b"\0" + struct.pack("<iB3x2i", 1 if half else 2, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    head = struct.pack("<2i", 20000630, 2) + attribute("channels", "chlist", channels) + \
        attribute("compression", "compression", b"\3" if pack else b"\0") + attribute("dataWindow", "box2i", window) + \
        attribute("displayWindow", "box2i", window) + attribute("lineOrder", "lineOrder", b"\0") + \
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1)) + \
        attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)) + \
        attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + more + b"\0"
    red, green, blue = planes
    blocks, rows, row = [], 16 if pack else 1, struct.Struct(f"<{width}{'e' if half else 'f'}")
    for first in range(0, height, rows):
        data = b"".join(row.pack(*plane[y * width:(y + 1) * width])
                        for y in range(first, min(first + rows, height)) for plane in (blue, green, red))
        if pack:
            split = data[::2] + data[1::2]
            steps = bytes([split[0]]) + bytes((b - a + 128) & 255 for a, b in zip(split, split[1:]))
            packed = zlib.compress(steps, 1)
            data = packed if len(packed) < len(data) else data
        blocks.append(struct.pack("<2i", first, len(data)) + data)
    at = len(head) + 8 * len(blocks)
    with open(path, "wb") as out:
        out.write(head)
        for block in blocks:
            out.write(struct.pack("<Q", at))
            at += len(block)
        out.writelines(blocks)


def write_clouds(folder, count, step, hour):
    noise_tile = tile(random.Random(9))
    pixels = []
    for y in range(WIDE[1] // 2):
        row = (direction((x + 0.5) / WIDE[0], (y + 0.5) / WIDE[1]) for x in range(WIDE[0]))
        pixels.append([(*d, d[0] / (d[1] + 0.15), d[2] / (d[1] + 0.15)) for d in row])
    for k in range(count):
        sun = sun_at(hour + k * step / 3600)
        write_exr(folder / f"clouds.{k:04d}.exr", drifting(noise_tile, pixels, sun, k * step))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("--clouds", type=int, metavar="N", help="write N images of moving clouds instead")
    parser.add_argument("--step", type=float, default=15, metavar="SECONDS", help="between two images [15]")
    parser.add_argument("--hour", type=float, default=12, metavar="H", help="of the first image, solar time [12]")
    options = parser.parse_args()
    folder = options.folder
    if options.clouds is not None:
        write_clouds(folder, options.clouds, options.step, options.hour)
        return
    for name, (mesh, scene) in (("plaza", plaza()), ("knot", knot())):
        mesh.write(folder / f"{name}.obj")
        (folder / f"{name}.json").write_text(json.dumps(scene, indent=1) + "\n")
    cover, sun = noise(random.Random(9)), direction(*SUN)
    write_sky(folder / "clouds.hdr", lambda d: clouds(d, sun, cover))
    write_sky(folder / "thousand.hdr", lambda d: thousand(d, sun))


if __name__ == "__main__":
    main()
