#!/usr/bin/env python3
"""Writes a tree of 40 000 leaves, foliage.obj and foliage.json: the worst case for the light-transport cache, since
neighbouring points see different parts of the sky.

    python3 foliage.py FOLDER
"""
import json
import math
import pathlib
import random
import sys

LEAVES = 40000


def sphere(rng):
    z, a = rng.uniform(-1, 1), rng.uniform(0, 2 * math.pi)
    r = math.sqrt(1 - z * z)
    return r * math.cos(a), z, r * math.sin(a)


def leaf(rng):
    """A rhombus in a crown of three balls, denser towards the outside; its tip hangs down slightly."""
    cx, cy, cz, radius = rng.choice([(0, 3.2, 0, 1.5), (0.9, 2.6, 0.4, 1.0), (-0.8, 2.7, -0.3, 1.1)])
    x, y, z = (radius * rng.uniform(0.4, 1) * k for k in sphere(rng))
    along = sphere(rng)
    across = sphere(rng)
    length, width = rng.uniform(0.05, 0.09), rng.uniform(0.02, 0.035)
    at = (cx + x, cy + y, cz + z)
    tip = [a + length * (k - (0.4 if i == 1 else 0)) for i, (a, k) in enumerate(zip(at, along))]
    middle = [(a + b) / 2 for a, b in zip(at, tip)]
    return [at, [m + width * k for m, k in zip(middle, across)], tip, [m - width * k for m, k in zip(middle, across)]]


def trunk(sides=16):
    ring = [(0.14 * math.cos(2 * math.pi * k / sides), 0.14 * math.sin(2 * math.pi * k / sides)) for k in range(sides)]
    for k in range(sides):
        (x, z), (u, w) = ring[k], ring[(k + 1) % sides]
        yield [(x, 0, z), (x * 0.6, 2.6, z * 0.6), (u * 0.6, 2.6, w * 0.6), (u, 0, w)]


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__.strip())
    folder = pathlib.Path(sys.argv[1])
    rng = random.Random(1)
    groups = {
        "ground": [[(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)]],
        "bark": list(trunk()),
        "leaf": [leaf(rng) for _ in range(LEAVES)],
    }
    count = 0
    with open(folder / "foliage.obj", "w") as out:
        for name, quads in groups.items():
            out.write(f"usemtl {name}\n")
            for quad in quads:
                out.writelines("v %.5f %.5f %.5f\n" % tuple(p) for p in quad)
                out.write("f %d %d %d %d\n" % tuple(count + k for k in (1, 2, 3, 4)))
                count += 4
    scene = {
        "camera": {"position": [4.6, 2.2, 6.2], "look_at": [0, 2.0, 0], "up": [0, 1, 0], "fov_y_degrees": 40},
        "models": [{"file": "foliage.obj"}],
        "materials": {
            "ground": {"type": "lambert", "albedo": [0.4, 0.38, 0.3]},
            "bark": {"type": "lambert", "albedo": [0.3, 0.22, 0.15]},
            "leaf": {"type": "lambert", "albedo": [0.16, 0.3, 0.08]},
        },
    }
    (folder / "foliage.json").write_text(json.dumps(scene, indent=1) + "\n")


main()
