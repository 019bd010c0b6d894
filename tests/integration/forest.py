#!/usr/bin/python3
"""Writes a glTF of one tree that stands at many places, some mirrored, turned or stretched:

    forest.py FILE.glb TREES TRIANGLES [copies]

Places alternate between nodes and EXT_mesh_gpu_instancing. A tree has a trunk with a normal map, leaves cut out of
cards, and a lamp with an emissive texture; three quarters of its triangles are leaves. With "copies" each tree is a
mesh of its own, so that nothing can be shared. The same bytes at every run."""

import math
import random
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "references"))
from generate import FLOAT, File, Mesh, cross, leaf, textured, unit  # noqa: E402


def bumps(u, v):
    return (*(0.5 + 0.5 * c for c in unit((0.5 * math.cos(20 * math.pi * u), 0.5 * math.cos(30 * math.pi * v), 1))), 1)


def bark(u, v):
    return 0.3 + 0.1 * u, 0.2, 0.1 + 0.1 * v, 1


def panes(u, v):
    return (1, 0.7, 0.4, 1) if 4 * u % 1 < 0.6 else (0.1, 0, 0, 1)


def cards(count, size):
    """Leaves of a crown."""
    mesh, rng = Mesh(), random.Random(1)
    for _ in range(count):
        p = [rng.gauss(0, 0.4) for _ in range(3)]
        a = unit([rng.gauss(0, 1) for _ in range(3)])
        b = unit(cross(a, [rng.gauss(0, 1) for _ in range(3)]))
        mesh.quad([tuple(c + size * (s * x + t * y) for c, x, y in zip((p[0], 2 + p[1], p[2]), a, b))
                   for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return mesh


def trunk(count):
    mesh, rings = Mesh(), max(1, count // 40)
    for i in range(rings):
        mesh.tube(((0, 2 * i / rings, 0), (0, 2 * (i + 1) / rings, 0)), (0.15, 0.15), 20)
    return mesh


def places(trees):
    """Translation, rotation, scale of each tree: along rows, turned about Y, every third mirrored, every fourth slim."""
    rng, side = random.Random(2), math.ceil(math.sqrt(trees))
    for i in range(trees):
        angle, size = rng.uniform(0, math.pi), rng.uniform(0.7, 1.2)
        tilt = rng.uniform(-0.1, 0.1)
        turn = (math.sin(tilt), math.cos(tilt) * math.sin(angle), 0, math.cos(tilt) * math.cos(angle))
        at = (2.2 * (i % side - 0.5 * side), 0, -2.2 * (i // side))
        yield at, unit4(turn), (size * (-1 if i % 3 == 0 else 1), size, size * (0.6 if i % 4 == 0 else 1))


def unit4(q):
    length = math.sqrt(sum(x * x for x in q))
    return tuple(x / length for x in q)


def write(path, trees, triangles, copies=False):
    file, lamp = File(), Mesh()
    rows = max(2, round(math.sqrt(triangles / 32)))
    lamp.ball((0.6, 0.5, 0), 0.2, rows)
    file.add_ground(60)
    file.add("trunk", trunk(triangles // 8), textured(file.texture(32, 32, bark), 0.7, normalTexture=file.texture(64, 64, bumps)))
    file.add("leaves", cards(triangles * 3 // 8, 0.12 * math.sqrt(3000 / triangles)),
             textured(file.texture(96, 96, leaf), 0.8, alphaMode="MASK", alphaCutoff=0.5, doubleSided=True))
    file.add("lamp", lamp, textured(file.texture(8, 8, bark), 0.8, emissiveFactor=[1, 1, 1],
                                    emissiveTexture=file.texture(32, 8, panes)))
    root = file.json
    tree = {"primitives": [p for mesh in root["meshes"][1:] for p in mesh["primitives"]]}
    root["meshes"][1:], root["nodes"][1:], root["scenes"][0]["nodes"][1:] = [tree], [], []
    all_places = list(places(trees))
    alone = len(all_places) if copies else len(all_places) // 2
    for i, (at, turn, scale) in enumerate(all_places[:alone]):
        if copies and i > 0:
            root["meshes"].append(tree)
        file.node(mesh=1 + (i if copies else 0), translation=at, rotation=turn, scale=scale)
    if alone < len(all_places):
        rest = list(zip(*all_places[alone:]))
        file.node(mesh=1, extensions={"EXT_mesh_gpu_instancing": {"attributes": {
            key: file.accessor(values, kind, FLOAT, None)
            for key, values, kind in zip(("TRANSLATION", "ROTATION", "SCALE"), rest, ("VEC3", "VEC4", "VEC3"))}}})
        root["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
        for view in root["bufferViews"]:
            if view.get("target", 0) is None:
                del view["target"]
    file.add_camera((1, 2.5, 6), (0, 1.2, 0), 50)
    file.write(path)


if __name__ == "__main__":
    write(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), "copies" in sys.argv[4:])
