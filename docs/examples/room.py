#!/usr/bin/env python3
"""Writes room.glb: a living room of 5 x 4 x 2.7 m that only daylight through two glazed windows lights, with a mirror,
a sofa, a table with a steel bowl, and a camera inside. The windows face south under a computed sky.

    python3 room.py FOLDER
"""
import math
import pathlib
import sys

sys.dont_write_bytecode = True  # house.py is imported from a folder of sources
from house import MATERIALS, RNG, Shapes, boards, gltf, grass, leaves, look, material, noise, png, tiles  # noqa: E402

LEFT, RIGHT, SOUTH, NORTH, TOP, WALL = -2.5, 2.5, -2.0, 2.0, 2.7, 0.3  # inner faces and the walls' thickness, m
WINDOWS = [(-1.9, -0.4, 0.75, 2.35), (0.5, 2.0, 0.75, 2.35)]  # from, to along x; bottom, top


def weave():
    """Cloth: threads that cross, and a border of stripes."""
    dust = noise(256, 64)
    def at(x, y):
        thread = 0.85 + 0.15 * math.sin(math.pi * x / 2) * math.sin(math.pi * y / 2)
        stripe = 0.55 if y % 64 in (6, 7, 8, 12, 13) else 1
        return [k * stripe * thread * (0.85 + 0.2 * dust(x, y)) for k in (0.62, 0.56, 0.48)]
    return png(256, at)


def shell(s):
    low, high = LEFT - WALL, RIGHT + WALL
    s.wall("plaster", [low, 0, SOUTH - WALL], [high, TOP, SOUTH], 0, WINDOWS)
    s.box("plaster", [low, 0, NORTH], [high, TOP, NORTH + WALL])
    s.box("plaster", [low, 0, SOUTH], [LEFT, TOP, NORTH])
    s.box("plaster", [RIGHT, 0, SOUTH], [high, TOP, NORTH])
    s.box("plaster", [low, TOP, SOUTH - WALL], [high, TOP + WALL, NORTH + WALL])
    s.box("boards", [low, -0.2, SOUTH - WALL], [high, 0, NORTH + WALL], 1.6)
    for x0, x1 in ((LEFT, LEFT + 0.02), (RIGHT - 0.02, RIGHT)):  # skirting boards
        s.box("white", [x0, 0, SOUTH], [x1, 0.09, NORTH])
    s.box("white", [LEFT, 0, SOUTH], [RIGHT, 0.09, SOUTH + 0.02])
    middle = SOUTH - WALL / 2
    for x0, x1, y0, y1 in WINDOWS:
        for x in (x0 + 0.03, (x0 + x1) / 2, x1 - 0.03):
            s.box("white", [x - 0.03, y0, middle - 0.03], [x + 0.03, y1, middle + 0.03])
        for y in (y0 + 0.03, y1 - 0.03):
            s.box("white", [x0, y - 0.03, middle - 0.03], [x1, y + 0.03, middle + 0.03])
        s.box("white", [x0 - 0.05, y0 - 0.04, SOUTH - 0.02], [x1 + 0.05, y0, SOUTH + 0.12])  # the sill
        s.flat("pane", [[x, y, middle] for x, y in ((x1, y0), (x0, y0), (x0, y1), (x1, y1))])


def cushion(s, name, centre, size, steps=24):
    """A box with round edges: |x|^4 + |y|^4 + |z|^4 = 1, stretched to the size."""
    def at(i, k):
        t, p = math.pi * i / steps, math.pi * k / steps
        d = [math.sin(t) * math.cos(p), math.cos(t), -math.sin(t) * math.sin(p)]
        r = sum(c ** 4 for c in d) ** -0.25
        q = [r * c for c in d]
        n = [4 * c ** 3 / h for c, h in zip(q, size)]
        length = math.sqrt(sum(c * c for c in n))
        return [m + h / 2 * c for m, h, c in zip(centre, size, q)], [c / length for c in n]
    for i in range(steps):
        for k in range(2 * steps):
            corners = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]
            corners = corners[:3] if i == 0 else corners[:2] + corners[3:] if i == steps - 1 else corners
            s.face(name, [p for p, _ in corners], [[0, 0]] * len(corners), [n for _, n in corners])


def furniture(s):
    x = LEFT + 0.06  # the sofa's back, on the west wall under the mirror
    s.box("sofa", [x, 0.1, -0.9], [x + 0.9, 0.32, 1.3])
    s.box("sofa", [x, 0.32, -0.9], [x + 0.2, 0.78, 1.3])
    for z in (-0.9, 1.1):
        s.box("sofa", [x, 0.32, z], [x + 0.9, 0.58, z + 0.2])
    for z in (-0.25, 0.65):
        cushion(s, "sofa", [x + 0.54, 0.39, z], [0.74, 0.2, 0.88])
        cushion(s, "sofa", [x + 0.28, 0.64, z], [0.2, 0.5, 0.84])
    cushion(s, "red", [x + 0.46, 0.62, -0.5], [0.16, 0.4, 0.4])
    for dx in (0.05, 0.85):
        for z in (-0.85, 1.25):
            s.box("dark", [x + dx - 0.03, 0, z - 0.03], [x + dx + 0.03, 0.1, z + 0.03])
    s.box("rug", [-1.3, 0, -1.0], [1.1, 0.012, 1.0], 1.2)
    s.box("boards", [-0.65, 0.4, -0.5], [0.35, 0.44, 0.6], 0.8)  # the table
    for cx in (-0.6, 0.3):
        for z in (-0.45, 0.55):
            s.box("dark", [cx - 0.025, 0, z - 0.025], [cx + 0.025, 0.4, z + 0.025])
    s.round("steel", [([-0.2, 0.44, 0.1], 0.06), ([-0.2, 0.47, 0.1], 0.12), ([-0.2, 0.53, 0.1], 0.16)], 48)
    s.round("steel", [([-0.2, 0.53, 0.1], 0.16), ([-0.2, 0.48, 0.1], 0.11), ([-0.2, 0.47, 0.1], 0.002)], 48)
    for dx, dz, name in ((-0.06, 0.02, "red"), (0.05, 0.05, "green"), (0.01, -0.06, "red")):
        s.ball(name, [-0.2 + dx, 0.515, 0.1 + dz], 0.05, 16)
    s.box("red", [0.02, 0.44, -0.35], [0.22, 0.465, -0.08])  # books
    s.box("white", [0.04, 0.465, -0.33], [0.21, 0.485, -0.1])
    s.round("clay", [([-2.1, 0, -1.6], 0.17), ([-2.1, 0.4, -1.6], 0.24)], 32)  # a pot in the corner
    for _ in range(220):
        s.twig([-2.08 + RNG.gauss(0, 0.13), 0.8 + RNG.gauss(0, 0.17), -1.57 + RNG.gauss(0, 0.13)], RNG.uniform(0.1, 0.16))
    s.box("dark", [LEFT, 1.08, -0.65], [LEFT + 0.03, 2.12, 1.05])  # the mirror and its frame
    front = LEFT + 0.031
    s.flat("mirror", [[front, 1.12, 1.01], [front, 1.12, -0.61], [front, 2.08, -0.61], [front, 2.08, 1.01]])
    s.box("boards", [RIGHT - 0.35, 0, -1.2], [RIGHT, 0.75, 0.6], 0.9)  # a sideboard, seen in the mirror
    s.ball("clay", [RIGHT - 0.18, 0.9, -0.3], 0.15, 16)


def outside(s):
    s.flat("grass", [[-40, -0.2, 40], [40, -0.2, 40], [40, -0.2, -40], [-40, -0.2, -40]], 3.0)
    s.box("paving", [-4, -0.2, -5.0], [4, -0.12, SOUTH - WALL], 2.0)
    s.box("green", [-9, -0.2, -9.0], [6, 1.1, -8.2])  # a hedge
    s.box("clay", [-7.5, -0.2, -16], [-2.5, 3.6, -12])  # a house across the street


LOOKS = {
    **{name: MATERIALS[name] for name in ("plaster", "grass", "boards", "paving", "clay", "steel", "pane", "leaves")},
    "rug": material(texture="rug"),
    "white": material((0.8, 0.8, 0.78), 0.5),
    "sofa": material((0.28, 0.36, 0.42)),
    "red": material((0.55, 0.12, 0.08), 0.6),
    "green": material((0.16, 0.3, 0.08)),
    "dark": material((0.1, 0.07, 0.05), 0.5),
    "mirror": material((0.92, 0.93, 0.92), 0.0, 1.0),
}


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__.strip())
    shapes = Shapes()
    shell(shapes)
    furniture(shapes)
    outside(shapes)
    images = {"grass": grass(), "boards": boards(), "paving": tiles((0.62, 0.58, 0.52), 4, 4, False), "rug": weave(),
              "leaves": leaves()}
    nodes = [{"mesh": 0, "name": "room"}, {"camera": 0, "name": "sofa", "matrix": look((2.25, 1.5, 1.8), (-1.6, 1.05, -0.75))}]
    (pathlib.Path(sys.argv[1]) / "room.glb").write_bytes(gltf(shapes, LOOKS, images, nodes))


if __name__ == "__main__":
    main()
