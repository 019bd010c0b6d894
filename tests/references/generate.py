"""Writes the glTF models of models.sh that are made here: tree.glb, lantern.glb and chair.glb.

    generate.py FOLDER

Each has a ground, a camera and one feature that pictures are compared for: leaves cut out of cards by alpha, a surface
that emits light through a texture, normal and metallic-roughness maps. The same bytes at every run.
"""
import json
import math
import os
import random
import struct
import sys
import zlib

FLOAT, UINT, ARRAY, ELEMENTS = 5126, 5125, 34962, 34963


def png(width, height, texel):
    """A PNG of RGBA, 8 bits; texel(u, v) gives four values 0..1, v downwards."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = bytearray()
    for y in range(height):
        rows.append(0)
        for x in range(width):
            rows += bytes(round(255 * min(max(c, 0), 1)) for c in texel((x + 0.5) / width, (y + 0.5) / height))
    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(rows), 9)) + chunk(b"IEND", b"")


class Mesh:
    """Quads with flat or given normals, of one material."""

    def __init__(self):
        self.positions, self.normals, self.uvs, self.indices = [], [], [], []

    def quad(self, corners, uvs=((0, 1), (1, 1), (1, 0), (0, 0)), normals=None):
        """Corners counterclockwise, as seen from outside."""
        a, b, c = corners[:3]
        flat = unit(cross(minus(b, a), minus(c, b)))
        first = len(self.positions)
        self.positions += corners
        self.normals += normals or [flat] * 4
        self.uvs += uvs
        self.indices += [first + i for i in (0, 1, 2, 0, 2, 3)]

    def box(self, centre, size, texel=1.0):
        """Each side repeats the texture every `texel` metres."""
        for axis in range(3):
            for side in (1, -1):
                def corner(s, t, axis=axis, side=side):
                    p = list(centre)
                    for k, sign in ((axis, side), ((axis + 1) % 3, s * side), ((axis + 2) % 3, t)):
                        p[k] += 0.5 * sign * size[k]
                    return tuple(p)
                u, v = (size[(axis + k) % 3] / texel for k in (1, 2))
                self.quad([corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)], ((0, v), (u, v), (u, 0), (0, 0)))

    def tube(self, ends, radii, sides):
        """Open, around Y, smooth."""
        slope = (radii[0] - radii[1]) / (ends[1][1] - ends[0][1])
        for i in range(sides):
            ring = []
            for j in (i, i + 1):
                angle = 2 * math.pi * j / sides
                ring.append((math.sin(angle), math.cos(angle)))
            corners, normals, uvs = [], [], []
            for j, end in ((0, 0), (1, 0), (1, 1), (0, 1)):
                s, c = ring[j]
                x, y, z = ends[end]
                corners.append((x + radii[end] * s, y, z + radii[end] * c))
                normals.append(unit((s, slope, c)))
                uvs.append(((i + j) / sides, 1 - end))
            self.quad(corners, uvs, normals)

    def ball(self, centre, radius, rows):
        for i in range(rows):
            for j in range(2 * rows):
                normals, uvs = [], []
                for di, dj in ((1, 0), (1, 1), (0, 1), (0, 0)):
                    theta, phi = math.pi * (i + di) / rows, math.pi * (j + dj) / rows
                    normals.append((math.sin(theta) * math.sin(phi), math.cos(theta), math.sin(theta) * math.cos(phi)))
                    uvs.append(((j + dj) / (2 * rows), (i + di) / rows))
                corners = [tuple(c + radius * n for c, n in zip(centre, normal)) for normal in normals]
                # A quad at a pole is a triangle.
                first = len(self.positions)
                self.positions += corners
                self.normals += normals
                self.uvs += uvs
                self.indices += [first + k for k in ((0, 1, 2) if i == 0 else (1, 2, 3) if i == rows - 1 else (0, 1, 2, 0, 2, 3))]


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return tuple(x / length for x in a)


class File:
    """A binary glTF with one scene."""

    def __init__(self):
        self.data = bytearray()
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
                     "materials": [], "accessors": [], "bufferViews": [], "buffers": [{}]}

    def view(self, data, **more):
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values, kind, component, target, **more):
        flat = [x for v in values for x in v] if kind != "SCALAR" else values
        view = self.view(struct.pack(f"<{len(flat)}{'f' if component == FLOAT else 'I'}", *flat), target=target)
        self.json["accessors"].append({"bufferView": view, "componentType": component, "count": len(values),
                                       "type": kind, **more})
        return len(self.json["accessors"]) - 1

    def texture(self, width, height, texel):
        for key in ("images", "textures"):
            self.json.setdefault(key, [])
        self.json["images"].append({"bufferView": self.view(png(width, height, texel)), "mimeType": "image/png"})
        self.json["textures"].append({"source": len(self.json["images"]) - 1})
        return {"index": len(self.json["textures"]) - 1}

    def node(self, **keys):
        self.json["nodes"].append(keys)
        self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)

    def add(self, name, mesh, material):
        exact = [struct.unpack("<3f", struct.pack("<3f", *p)) for p in mesh.positions]
        attributes = {
            "POSITION": self.accessor(exact, "VEC3", FLOAT, ARRAY, min=[min(p[k] for p in exact) for k in range(3)],
                                      max=[max(p[k] for p in exact) for k in range(3)]),
            "NORMAL": self.accessor(mesh.normals, "VEC3", FLOAT, ARRAY),
        }
        if "exture" in json.dumps(material):  # else the validator calls the coordinates unused
            attributes["TEXCOORD_0"] = self.accessor(mesh.uvs, "VEC2", FLOAT, ARRAY)
        indices = self.accessor(mesh.indices, "SCALAR", UINT, ELEMENTS)
        self.json["materials"].append({"name": name, **material})
        self.json["meshes"].append({"name": name, "primitives": [
            {"attributes": attributes, "indices": indices, "material": len(self.json["materials"]) - 1}]})
        self.node(name=name, mesh=len(self.json["meshes"]) - 1)

    def add_ground(self, size):
        ground = Mesh()
        ground.quad([(-size, 0, size), (size, 0, size), (size, 0, -size), (-size, 0, -size)])
        self.add("ground", ground, matte((0.35, 0.33, 0.3)))

    def add_camera(self, position, target, degrees):
        """As exporters write it: a node with translation and rotation."""
        z = unit(minus(position, target))
        x = unit(cross((0, 1, 0), z))
        y = cross(z, x)
        w = 0.5 * math.sqrt(1 + x[0] + y[1] + z[2])
        turn = [(y[2] - z[1]) / (4 * w), (z[0] - x[2]) / (4 * w), (x[1] - y[0]) / (4 * w), w]
        self.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": math.radians(degrees), "znear": 0.01}}]
        self.node(name="camera", camera=0, translation=list(position), rotation=turn)

    def write(self, path):
        self.data += bytes(-len(self.data) % 4)
        self.json["buffers"][0]["byteLength"] = len(self.data)
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        with open(path, "wb") as out:
            out.write(struct.pack("<III", 0x46546C67, 2, 28 + len(text) + len(self.data)))
            out.write(struct.pack("<II", len(text), 0x4E4F534A) + text)
            out.write(struct.pack("<II", len(self.data), 0x004E4942) + self.data)


def matte(colour, **more):
    return {"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1], "metallicFactor": 0, "roughnessFactor": 0.9}, **more}


def textured(texture, roughness, **more):
    return {"pbrMetallicRoughness": {"baseColorTexture": texture, "metallicFactor": 0, "roughnessFactor": roughness}, **more}


def leaf(u, v):
    """Nine leaves on a card: green inside an ellipse with a soft edge, so that the cutoff decides."""
    s, t = 3 * u % 1 - 0.5, 3 * v % 1 - 0.5
    across, along = 0.8 * s - 0.6 * t, 0.6 * s + 0.8 * t
    edge = (across / 0.2) ** 2 + (along / 0.45) ** 2
    vein = 0.1 if abs(across) < 0.03 else 0
    return 0.22 + vein + 0.1 * u, 0.5 + vein, 0.12 + vein, 1.25 - 0.75 * edge


def make_tree(path):
    file, leaves, trunk, rng = File(), Mesh(), Mesh(), random.Random(1)
    trunk.tube(((0, 0, 0), (0, 2.6, 0)), (0.16, 0.07), 16)
    for _ in range(240):
        while True:
            p = [rng.uniform(-1, 1) for _ in range(3)]
            if sum(x * x for x in p) < 1:
                break
        centre = (1.1 * p[0], 2.5 + p[1], 1.1 * p[2])
        a = unit([rng.gauss(0, 1) for _ in range(3)])
        b = unit(cross(a, [rng.gauss(0, 1) for _ in range(3)]))
        corner = [tuple(c + 0.25 * (s * x + t * y) for c, x, y in zip(centre, a, b))
                  for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        leaves.quad(corner)
    file.add_ground(5)
    file.add("trunk", trunk, matte((0.2, 0.12, 0.07)))
    file.add("leaves", leaves, textured(file.texture(192, 192, leaf), 0.8, alphaMode="MASK", alphaCutoff=0.5, doubleSided=True))
    file.add_camera((4.2, 2.6, 4.6), (0, 1.75, 0), 38)
    file.write(path)


def make_lantern(path):
    file, ball, post = File(), Mesh(), Mesh()
    ball.ball((0, 1.1, 0), 0.5, 24)
    post.box((0, 0.3, 0), (0.5, 0.6, 0.5))
    post.box((-1.2, 0.6, -0.4), (0.4, 1.2, 0.4))

    def windows(u, v):
        lit = abs(8 * u % 1 - 0.5) < 0.3 and abs(5 * v % 1 - 0.5) < 0.3
        return (1, 0.75, 0.4, 1) if lit else (0, 0, 0, 1)

    file.add_ground(5)
    file.add("post", post, matte((0.6, 0.25, 0.2)))
    glow = matte((0.3, 0.3, 0.3), emissiveFactor=[1, 1, 1], emissiveTexture=file.texture(128, 80, windows),
                 extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 6}})
    file.json["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    file.add("lantern", ball, glow)
    file.add_camera((2.4, 2, 3), (-0.1, 0.75, 0), 35)
    file.write(path)


def make_chair(path):
    file, cloth, metal = File(), Mesh(), Mesh()
    cloth.box((0, 0.46, 0), (0.5, 0.08, 0.5), 0.25)
    cloth.box((0, 0.8, -0.23), (0.5, 0.45, 0.06), 0.25)
    for x in (-0.21, 0.21):
        for z in (-0.21, 0.21):
            metal.tube(((x, 0, z), (x, 0.42, z)), (0.022, 0.022), 24)

    def height(u, v):
        """Cloth of eight threads each way, one over the other."""
        i, j = math.floor(8 * u), math.floor(8 * v)
        s, t = 8 * u % 1 - 0.5, 8 * v % 1 - 0.5
        return math.cos(math.pi * (t if (i + j) % 2 else s)) * (0.6 + 0.4 * math.cos(math.pi * (s if (i + j) % 2 else t)))

    def bumps(u, v):
        step, depth = 1 / 512, 0.03
        x = depth * (height(u - step, v) - height(u + step, v)) / (2 * step)
        y = depth * (height(u, v + step) - height(u, v - step)) / (2 * step)  # green is up, v is down
        n = unit((x, y, 1))
        return (*(0.5 + 0.5 * c for c in n), 1)

    def weave(u, v):
        return (0.6, 0.2, 0.12, 1) if (math.floor(8 * u) + math.floor(8 * v)) % 2 else (0.45, 0.3, 0.2, 1)

    def rings(u, v):
        polished = 12 * v % 1 < 0.5
        return 1, 0.25 if polished else 0.7, 1 if polished else 0, 1

    file.add_ground(3)
    file.add("cloth", cloth, textured(file.texture(256, 256, weave), 0.6, normalTexture=file.texture(256, 256, bumps)))
    file.add("metal", metal, {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.78, 0.75, 1],
                                                        "metallicRoughnessTexture": file.texture(4, 192, rings)}})
    file.add_camera((1.1, 1.2, 1.5), (0, 0.48, 0), 34)
    file.write(path)


def main():
    folder = sys.argv[1]
    os.makedirs(folder, exist_ok=True)
    for name, make in (("tree", make_tree), ("lantern", make_lantern), ("chair", make_chair)):
        make(os.path.join(folder, name + ".glb"))


if __name__ == "__main__":
    main()
