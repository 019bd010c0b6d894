#!/usr/bin/env python3
"""Writes house.glb: a small house with a garden, made of the features that real glTF files have: textures, leaves with
alpha masks that transmit light, window panes, metal, and two cameras ("garden" and "room").

    python3 house.py FOLDER
"""
import json
import math
import pathlib
import random
import struct
import sys
import zlib

RNG = random.Random(7)


# ---- Textures ----

def png(size, pixel, channels=3):
    """A square PNG file; pixel(x, y) returns values from 0 to 1."""
    rows = b"".join(b"\0" + bytes(max(0, min(255, round(255 * v))) for x in range(size) for v in pixel(x, y))
                    for y in range(size))
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", size, size, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")


def noise(size, cells):
    """Smooth noise from 0 to 1 that repeats at the edges."""
    grid = [[RNG.random() for _ in range(cells)] for _ in range(cells)]
    def at(x, y):
        u, v = x * cells / size, y * cells / size
        i, j = int(u), int(v)
        a, b = u - i, v - j
        a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
        row = [grid[k % cells][i % cells] * (1 - a) + grid[k % cells][(i + 1) % cells] * a for k in (j, j + 1)]
        return row[0] * (1 - b) + row[1] * b
    return at


def grass():
    coarse, fine = noise(256, 8), noise(256, 128)
    return png(256, lambda x, y: [k * (0.55 + 0.25 * coarse(x, y) + 0.4 * fine(x, y)) for k in (0.44, 0.52, 0.24)])


def boards():
    """Planks along v, eight to a texture."""
    grain = noise(256, 64)
    shade = [RNG.uniform(0.8, 1.0) for _ in range(8)]
    def at(x, y):
        seam = 0.35 if x % 32 < 1 else 1
        return [k * seam * shade[x // 32] * (0.8 + 0.3 * grain(x, y // 16)) for k in (0.74, 0.60, 0.44)]
    return png(256, at)


def tiles(colour, across, down, shift):
    """Rows of tiles with a dark seam."""
    shade = [[RNG.uniform(0.78, 1.0) for _ in range(across)] for _ in range(down)]
    dust = noise(256, 64)
    wide, high = 256 // across, 256 // down
    def at(x, y):
        row = y // high
        x = (x + (wide // 2 if shift and row % 2 else 0)) % 256
        seam = 0.5 if x % wide < 2 or y % high < 2 else 1
        return [k * seam * shade[row][x // wide] * (0.85 + 0.2 * dust(x, y)) for k in colour]
    return png(256, at)


def leaves():
    """A twig: nine leaves about the middle of a card, with alpha."""
    blades = [(2 * math.pi * (k + RNG.random()) / 9, RNG.uniform(16, 40), RNG.uniform(0.75, 1.0)) for k in range(9)]
    def at(x, y):
        for turn, away, shade in blades:
            u, v = x - 64 - away * math.cos(turn), y - 64 - away * math.sin(turn)
            along, across = u * math.cos(turn) + v * math.sin(turn), -u * math.sin(turn) + v * math.cos(turn)
            if (along / 22) ** 2 + (across / (9 - along * 0.2)) ** 2 < 1:
                rib = 1.15 if abs(across) < 0.8 else 1
                return [k * shade * rib for k in (0.38, 0.52, 0.18)] + [1]
        return 0.38, 0.52, 0.18, 0
    return png(128, at, 4)


# ---- Shapes: quads and triangles by material ----

class Shapes:
    def __init__(self):
        self.by_material = {}

    def face(self, material, points, uvs, normals=None):
        p, n, t, indices = self.by_material.setdefault(material, ([], [], [], []))
        if normals is None:
            a, b, c = points[0], points[1], points[2]
            u, v = [b[i] - a[i] for i in range(3)], [c[i] - a[i] for i in range(3)]
            m = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
            length = math.sqrt(sum(k * k for k in m))
            normals = [[k / length for k in m]] * len(points)
        first = len(p)
        p += points
        n += normals
        t += uvs
        for k in range(1, len(points) - 1):
            indices += [first, first + k, first + k + 1]

    def flat(self, material, points, texture_m=1.0):
        """A face whose texture coordinates are metres along its plane."""
        a, b, last = points[0], points[1], points[-1]
        def unit(q):
            d = [q[i] - a[i] for i in range(3)]
            length = math.sqrt(sum(k * k for k in d))
            return [k / length for k in d]
        u, v = unit(b), unit(last)
        uvs = [[sum((q[i] - a[i]) * w[i] for i in range(3)) / texture_m for w in (u, v)] for q in points]
        self.face(material, points, uvs)

    def solid(self, material, bottom, top, texture_m=1.0):
        """The hexahedron between two quads, both counter-clockwise seen from above."""
        self.flat(material, top, texture_m)
        self.flat(material, bottom[::-1], texture_m)
        for k in range(4):
            j = (k + 1) % 4
            self.flat(material, [bottom[k], bottom[j], top[j], top[k]], texture_m)

    def box(self, material, low, high, texture_m=1.0):
        quad = [(low[0], high[2]), (high[0], high[2]), (high[0], low[2]), (low[0], low[2])]
        self.solid(material, [[x, low[1], z] for x, z in quad], [[x, high[1], z] for x, z in quad], texture_m)

    def wall(self, material, low, high, axis, holes):
        """A box with rectangular holes (from, to, bottom, top) along x (axis 0) or z (axis 2)."""
        cuts = sorted({low[axis], high[axis], *(h[k] for h in holes for k in (0, 1))})
        levels = sorted({low[1], high[1], *(h[k] for h in holes for k in (2, 3))})
        for a, b in zip(cuts, cuts[1:]):
            for c, d in zip(levels, levels[1:]):
                if not any(h[0] <= a and b <= h[1] and h[2] <= c and d <= h[3] for h in holes):
                    at, to = list(low), list(high)
                    at[axis], to[axis], at[1], to[1] = a, b, c, d
                    self.box(material, at, to)

    def round(self, material, rings, sides=24):
        """A surface of revolution: rings of (x, y, z of the centre, radius)."""
        for (a, r), (b, s) in zip(rings, rings[1:]):
            rise, run = b[1] - a[1], r - s
            tilt = math.hypot(rise, run)
            for k in range(sides):
                turns = [2 * math.pi * j / sides for j in (k + 1, k)]
                ring = [(math.cos(t), -math.sin(t)) for t in turns]
                points = [[c[0] + q * x, c[1], c[2] + q * z] for c, q in ((a, r), (b, s)) for x, z in ring]
                normals = [[x * rise / tilt, run / tilt, z * rise / tilt] for x, z in ring]
                self.face(material, [points[1], points[0], points[2], points[3]], [[0, 0]] * 4,
                          [normals[1], normals[0], normals[0], normals[1]])

    def ball(self, material, centre, radius, steps=32):
        def at(i, k):
            t, p = math.pi * i / steps, 2 * math.pi * k / (2 * steps)
            return [math.sin(t) * math.cos(p), math.cos(t), -math.sin(t) * math.sin(p)]
        for i in range(steps):
            for k in range(2 * steps):
                n = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]
                if i == 0:
                    n = n[:3]
                elif i == steps - 1:
                    n = [n[0], n[1], n[3]]
                self.face(material, [[centre[j] + radius * m[j] for j in range(3)] for m in n], [[0, 0]] * len(n), n)

    def twig(self, at, size):
        """A card in any direction."""
        def direction():
            z, a = RNG.uniform(-1, 1), RNG.uniform(0, 2 * math.pi)
            r = math.sqrt(1 - z * z)
            return [r * math.cos(a), z, r * math.sin(a)]
        u, w = direction(), direction()
        dot = sum(a * b for a, b in zip(u, w))
        v = [b - dot * a for a, b in zip(u, w)]
        length = math.sqrt(sum(k * k for k in v)) or 1
        v = [k / length for k in v]
        corner = lambda s, t: [at[i] + size * (s * u[i] + t * v[i]) for i in range(3)]
        self.face("leaves", [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)],
                  [[0, 1], [1, 1], [1, 0], [0, 0]])


# ---- The house; its front faces -Z, which is south under a computed sky ----

def house(s):
    wall, top = 0.25, 2.7
    front, back, left, right = -3.0, 3.0, -4.5, 4.5
    glazed = [(-3.6, -0.6, 0.1, 2.3), (2.6, 3.8, 0.9, 2.3)]
    door = (0.4, 1.5, 0.1, 2.3)
    s.wall("plaster", [left, 0, front], [right, top, front + wall], 0, glazed + [door])
    s.wall("plaster", [left, 0, back - wall], [right, top, back], 0, [(-2.5, -1.0, 0.9, 2.1)])
    side = (-1.2, 1.2, 0.9, 2.2)
    s.wall("plaster", [left, 0, front + wall], [left + wall, top, back - wall], 2, [side])
    s.wall("plaster", [right - wall, 0, front + wall], [right, top, back - wall], 2, [side])
    s.box("boards", [left + wall, 0, front + wall], [right - wall, 0.1, back - wall], 1.6)
    s.box("plaster", [left + wall, top - 0.1, front + wall], [right - wall, top, back - wall])
    s.box("boards", [door[0], door[2], front + 0.1], [door[1], door[3], front + 0.16], 0.9)
    for x0, x1, y0, y1 in glazed:
        bars = [x0, x1] if x1 - x0 < 1.5 else [x0, (2 * x0 + x1) / 3, (x0 + 2 * x1) / 3, x1]
        for x in bars:
            s.box("frame", [x - 0.03, y0, front + 0.09], [x + 0.03, y1, front + 0.15])
        for y in (y0 + 0.03, y1 - 0.03):
            s.box("frame", [x0, y - 0.03, front + 0.09], [x1, y + 0.03, front + 0.15])
        s.flat("pane", [[x1, y0, front + 0.12], [x0, y0, front + 0.12], [x0, y1, front + 0.12], [x1, y1, front + 0.12]])
    roof(s, front, back, left, right, top)
    s.box("boards", [-2.6, 0.1, 0.6], [-1.0, 0.82, 1.5], 0.8)
    s.ball("clay", [-1.8, 1.0, 1.05], 0.18, 16)


def roof(s, front, back, left, right, top):
    ridge, over, thick = 4.6, 0.5, 0.14
    for x in (left, right - 0.25):
        gable = [[x, top, front], [x, ridge, 0], [x, top, back]]
        other = [[p[0] + 0.25, p[1], p[2]] for p in gable]
        s.flat("plaster", gable[::-1])
        s.flat("plaster", other)
    slope = (ridge - top) / (0 - front)
    for sign, edge in ((-1, front), (1, back)):
        eaves_z, eaves_y = edge + sign * over, top - slope * over
        line = [[left - over, eaves_y, eaves_z], [right + over, eaves_y, eaves_z], [right + over, ridge, 0], [left - over, ridge, 0]]
        if sign < 0:
            line = [line[1], line[0], line[3], line[2]]
        s.solid("roof", line, [[x, y + thick, z] for x, y, z in line], 1.6)


def garden(s):
    s.flat("grass", [[-40, 0, 40], [40, 0, 40], [40, 0, -40], [-40, 0, -40]], 3.0)
    s.box("paving", [-4.5, 0, -6.0], [4.5, 0.08, -3.0], 2.0)
    s.box("paving", [0.2, 0, -14.0], [1.7, 0.04, -6.0], 2.0)
    s.round("bark", [([6.4, -0.1, -4.6], 0.26), ([6.3, 1.2, -4.6], 0.18), ([6.4, 2.4, -4.5], 0.14), ([6.5, 3.6, -4.5], 0.07)])
    for lean in ((1.1, 0.4), (-0.9, 0.7), (0.2, -1.1)):
        s.round("bark", [([6.35, 1.9, -4.55], 0.1), ([6.4 + lean[0], 3.2, -4.5 + lean[1]], 0.04)], 10)
    for _ in range(2600):
        cx, cy, cz, r = RNG.choice([(6.5, 3.9, -4.5, 1.5), (7.4, 3.3, -4.1, 1.1), (5.6, 3.4, -4.0, 1.1), (6.6, 3.2, -5.5, 1.1)])
        a, z, d = RNG.uniform(0, 2 * math.pi), RNG.uniform(-1, 1), r * RNG.uniform(0.55, 1) ** 0.5
        q = math.sqrt(1 - z * z)
        s.twig([cx + d * q * math.cos(a), cy + d * z, cz + d * q * math.sin(a)], RNG.uniform(0.13, 0.2))
    for _ in range(2400):  # a hedge
        s.twig([RNG.uniform(9.6, 10.5), RNG.uniform(0.05, 1.5), RNG.uniform(-6, 9)], RNG.uniform(0.12, 0.18))
    s.round("paving", [([-2.6, 0.08, -5.2], 0.2), ([-2.6, 0.7, -5.2], 0.16)], 32)
    s.ball("steel", [-2.6, 0.95, -5.2], 0.26)
    s.round("clay", [([3.6, 0.08, -4.6], 0.2), ([3.6, 0.55, -4.6], 0.3)], 32)
    for _ in range(160):
        s.twig([3.6 + RNG.gauss(0, 0.16), 0.75 + RNG.gauss(0, 0.14), -4.6 + RNG.gauss(0, 0.16)], RNG.uniform(0.1, 0.16))


# ---- glTF ----

def material(colour=(1, 1, 1), roughness=0.9, metallic=0.0, texture=None, **more):
    pbr = {"baseColorFactor": [*colour, 1], "roughnessFactor": roughness, "metallicFactor": metallic}
    if texture:
        pbr["baseColorTexture"] = {"index": texture}
    return {"pbrMetallicRoughness": pbr, **more}


MATERIALS = {
    "plaster": material((0.82, 0.79, 0.73)),
    "grass": material(texture="grass"),
    "boards": material(texture="boards", roughness=0.6),
    "roof": material(texture="roof"),
    "paving": material(texture="paving"),
    "bark": material((0.23, 0.17, 0.12)),
    "clay": material((0.62, 0.31, 0.2), 0.7),
    "frame": material((0.08, 0.09, 0.1), 0.4),
    "steel": material((0.75, 0.75, 0.78), 0.0, 1.0),
    "pane": material(roughness=0.0, doubleSided=True, extensions={"KHR_materials_transmission": {"transmissionFactor": 1}}),
    "leaves": material(texture="leaves", roughness=0.7, doubleSided=True, alphaMode="MASK", extensions={
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.4,
                                               "diffuseTransmissionColorFactor": [0.45, 0.6, 0.15]}}),
}


def look(position, target):
    """A node's matrix, column by column, for a camera there that looks at the target."""
    back = [a - b for a, b in zip(position, target)]
    length = math.sqrt(sum(k * k for k in back))
    z = [k / length for k in back]
    across = math.hypot(z[0], z[2])
    x = [z[2] / across, 0, -z[0] / across]
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    return [*x, 0, *y, 0, *z, 0, *position, 1]


class Binary:
    """The buffer of a .glb file, and what describes its parts."""

    def __init__(self):
        self.bytes, self.views, self.accessors = b"", [], []

    def view(self, data):
        self.views.append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data)})
        self.bytes += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def vectors(self, values, kind):
        flat = [k for v in values for k in v]
        a = {"bufferView": self.view(struct.pack(f"<{len(flat)}f", *flat)), "componentType": 5126, "count": len(values), "type": kind}
        if kind == "VEC3":
            rounded = struct.unpack(f"<{len(flat)}f", struct.pack(f"<{len(flat)}f", *flat))
            a["min"], a["max"] = ([f(rounded[i::3]) for i in range(3)] for f in (min, max))
        self.accessors.append(a)
        return len(self.accessors) - 1

    def indices(self, values):
        self.accessors.append({"bufferView": self.view(struct.pack(f"<{len(values)}I", *values)), "componentType": 5125,
                               "count": len(values), "type": "SCALAR"})
        return len(self.accessors) - 1


def gltf(s, materials, images, nodes):
    """A .glb file: nodes refer to mesh 0 (the shapes) and camera 0, materials to images by name."""
    b = Binary()
    names = [m for m in materials if m in s.by_material]
    used = {name: json.loads(json.dumps(materials[name])) for name in names}
    primitives = []
    for m in names:
        p, n, t, indices = s.by_material[m]
        attributes = {"POSITION": b.vectors(p, "VEC3"), "NORMAL": b.vectors(n, "VEC3")}
        texture = used[m]["pbrMetallicRoughness"].get("baseColorTexture")
        if texture:
            texture["index"] = list(images).index(texture["index"])
            attributes["TEXCOORD_0"] = b.vectors(t, "VEC2")
        primitives.append({"attributes": attributes, "indices": b.indices(indices), "material": names.index(m)})
    camera = {"type": "perspective", "perspective": {"yfov": 0.72, "znear": 0.05, "aspectRatio": 16 / 9}}
    doc = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes, "cameras": [camera],
           "meshes": [{"primitives": primitives}], "materials": [{"name": m, **used[m]} for m in names],
           "textures": [{"source": k, "sampler": 0} for k in range(len(images))], "samplers": [{}],
           "images": [{"bufferView": b.view(i), "mimeType": "image/png"} for i in images.values()],
           "extensionsUsed": sorted({e for m in used.values() for e in m.get("extensions", {})}),
           "accessors": b.accessors, "bufferViews": b.views, "buffers": [{"byteLength": len(b.bytes)}]}
    text = json.dumps(doc, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(b.bytes)
    return (struct.pack("<III", 0x46546C67, 2, size) + struct.pack("<II", len(text), 0x4E4F534A) + text +
            struct.pack("<II", len(b.bytes), 0x004E4942) + b.bytes)


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__.strip())
    shapes = Shapes()
    house(shapes)
    garden(shapes)
    images = {"grass": grass(), "boards": boards(), "roof": tiles((0.66, 0.36, 0.27), 4, 8, True),
              "paving": tiles((0.62, 0.58, 0.52), 4, 4, False), "leaves": leaves()}
    nodes = [{"mesh": 0, "name": "house and garden"},
             {"camera": 0, "name": "garden", "matrix": look((-5.6, 1.75, -11.5), (0.6, 1.75, -2.0))},
             {"camera": 0, "name": "room", "matrix": look((3.9, 1.6, 2.4), (-1.6, 1.15, -2.2))}]
    (pathlib.Path(sys.argv[1]) / "house.glb").write_bytes(gltf(shapes, MATERIALS, images, nodes))


if __name__ == "__main__":
    main()
