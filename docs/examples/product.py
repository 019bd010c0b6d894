#!/usr/bin/env python3
"""Writes a product shot: product.json with product.obj, two bottles of tinted glass with metal caps on a slab of stone, and
studio.hdr, an environment map of three softboxes and a spot.

    python3 product.py FOLDER
"""
import json
import math
import pathlib
import sys

SIDES = 72
CREASE = math.cos(math.radians(40))


class Obj:
    """An OBJ file in pieces."""

    def __init__(self):
        self.lines, self.points, self.normals = [], 0, 0

    def material(self, name):
        self.lines.append(f"usemtl {name}")

    def ring(self, kind, radius, y, x=0, z=0):
        """A circle of points, or of normals; returns the number of its first."""
        self.lines += ["%s %.5f %.5f %.5f" % (kind, x + radius * c, y, z + radius * s) for c, s in map(turn, range(SIDES))]
        first = (self.points if kind == "v" else self.normals) + 1
        if kind == "v":
            self.points += SIDES
        else:
            self.normals += SIDES
        return first

    def revolve(self, profile, x, z):
        """A profile of (radius, height) about a vertical axis. Its right side, seen along it, is outside."""
        slopes = []
        for (r, y), (s, t) in zip(profile, profile[1:]):
            length = math.hypot(s - r, t - y)
            slopes.append(((t - y) / length, (r - s) / length))
        circles = [self.ring("v", r, y, x, z) for r, y in profile]
        for k, slope in enumerate(slopes):
            before, after = (slopes[k - 1] if k > 0 else None), (slopes[k + 1] if k + 1 < len(slopes) else None)
            low = high if k > 0 and smooth(slope, before) else self.ring("vn", *blend(slope, before))
            high = self.ring("vn", *blend(slope, after))
            for i, j in zip(range(SIDES), [*range(1, SIDES), 0]):
                corners = [(circles[k] + i, low + i), (circles[k + 1] + i, high + i), (circles[k + 1] + j, high + j), (circles[k] + j, low + j)]
                if profile[k][0] == 0:
                    corners = corners[:3]
                elif profile[k + 1][0] == 0:
                    corners = [corners[0], corners[1], corners[3]]
                self.lines.append("f " + " ".join("%d//%d" % c for c in corners))

    def strip(self, line, half_width):
        """A line of (y, z), drawn out along x, flat from each point to the next."""
        for y, z in line:
            self.lines += [f"v {x} {y:.5f} {z:.5f}" for x in (-half_width, half_width)]
        for k in range(self.points + 1, self.points + 2 * len(line) - 2, 2):
            self.lines.append(f"f {k} {k + 1} {k + 3} {k + 2}")
        self.points += 2 * len(line)


def turn(j):
    a = 2 * math.pi * (j % SIDES) / SIDES
    return math.cos(a), math.sin(a)


def smooth(normal, other):
    """Whether there is no edge between two neighbours."""
    return other is not None and normal[0] * other[0] + normal[1] * other[1] >= CREASE


def blend(normal, other):
    if not smooth(normal, other):
        return normal
    u, v = normal[0] + other[0], normal[1] + other[1]
    return u / math.hypot(u, v), v / math.hypot(u, v)


def rounded(points, radius, steps=6):
    """A profile whose inner corners are arcs, as smooth as its radius allows."""
    out = [points[0]]
    for a, b, c in zip(points, points[1:], points[2:]):
        u, v = [a[i] - b[i] for i in (0, 1)], [c[i] - b[i] for i in (0, 1)]
        m, n = math.hypot(*u), math.hypot(*v)
        reach = min(radius, 0.49 * m, 0.49 * n)
        start, end = [b[i] + reach * u[i] / m for i in (0, 1)], [b[i] + reach * v[i] / n for i in (0, 1)]
        for k in range(steps + 1):  # a quadratic curve about the corner
            t = k / steps
            out.append(tuple((1 - t) ** 2 * start[i] + 2 * t * (1 - t) * b[i] + t * t * end[i] for i in (0, 1)))
    return out + [points[-1]]


def bottle(obj, glass, metal, x, z, radius, height, floor):
    """Walls with a thick base around a cavity, which is closed by the cap's stopper of glass."""
    neck, wall, shoulder = 0.3 * radius, 0.14 * radius, floor + 0.72 * height
    top, base = floor + 0.86 * height, floor + 0.16 * height
    outside = [(0, floor), (radius, floor), (radius, shoulder), (neck, shoulder + 0.06 * height), (neck, top), (0, top)]
    inside = [(0, base), (radius - wall, base), (radius - wall, shoulder - 0.02 * height), (neck - wall, shoulder + 0.035 * height),
              (neck - wall, top - 0.03 * height), (0, top - 0.03 * height)]
    obj.material(glass)
    obj.revolve(rounded(outside, 0.16 * radius), x, z)
    obj.revolve([(r, y) for r, y in rounded(inside, 0.14 * radius)][::-1], x, z)
    obj.material(metal)
    low, high, wide = top + 0.0005, floor + 1.12 * height, 0.56 * radius
    obj.revolve(rounded([(0, low), (wide, low), (wide, high), (0, high)], 0.06 * radius), x, z)


def sweep(obj):
    """Paper that lies on the table, bends and hangs behind it."""
    turns = [math.pi / 2 * k / 24 for k in range(25)]
    obj.material("paper")
    obj.strip([(0.0, 0.7)] + [(0.25 - 0.25 * math.cos(a), -0.25 - 0.25 * math.sin(a)) for a in turns] + [(0.45, -0.5)], 1.6)


SCENE = {
    "camera": {"position": [0.02, 0.17, 0.62], "look_at": [0.004, 0.058, 0], "up": [0, 1, 0], "fov_y_degrees": 16},
    "models": [{"file": "product.obj", "smooth": True}],
    "materials": {
        "paper": {"type": "lambert", "albedo": [0.5, 0.47, 0.43]},
        "stone": {"type": "lambert", "albedo": [0.6, 0.58, 0.55]},
        "gold": {"type": "ggx", "base_color": [0.95, 0.68, 0.32], "metallic": 1, "roughness": 0.12},
        "silver": {"type": "ggx", "base_color": [0.92, 0.92, 0.92], "metallic": 1, "roughness": 0.08},
        "amber": {"type": "glass", "ior": 1.5, "attenuation_color": [0.95, 0.5, 0.12], "attenuation_distance": 0.02},
        "blue": {"type": "glass", "ior": 1.5, "attenuation_color": [0.25, 0.6, 0.9], "attenuation_distance": 0.02},
    },
}


# Softboxes: degrees of azimuth, from the camera's side to the right, and of elevation; radiance. The spot is a degree or two wide.
BOXES = [(-75, -35, 5, 55, 5.0), (62, 80, -5, 65, 8.0), (-40, 40, 72, 88, 2.0), (-152, -148, 48, 52, 1500.0)]


def studio(width=512):
    """A lat-long map in Radiance's format, dark where no light is."""
    def texel(x, y):
        elevation = 90 - 180 * (y + 0.5) / (width / 2)
        azimuth = 180 - 360 * (x + 0.5) / width
        light = 0.06 + 0.08 * max(0, math.sin(math.radians(elevation)))
        for a, b, low, high, radiance in BOXES:
            if a <= azimuth <= b and low <= elevation <= high:
                light = radiance
        mantissa, exponent = math.frexp(light)
        return bytes([int(256 * mantissa)] * 3 + [128 + exponent])
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {width // 2} +X {width}\n".encode()
    return head + b"".join(texel(x, y) for y in range(width // 2) for x in range(width))


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__.strip())
    folder = pathlib.Path(sys.argv[1])
    obj = Obj()
    sweep(obj)
    obj.material("stone")
    obj.revolve(rounded([(0, 0.0005), (0.115, 0.0005), (0.118, 0.008), (0, 0.008)], 0.002), 0, 0)
    bottle(obj, "amber", "gold", -0.028, 0.01, 0.032, 0.1, 0.0085)
    bottle(obj, "blue", "silver", 0.048, -0.012, 0.026, 0.062, 0.0085)
    (folder / "product.obj").write_text("\n".join(obj.lines) + "\n")
    (folder / "product.json").write_text(json.dumps(SCENE, indent=1) + "\n")
    (folder / "studio.hdr").write_bytes(studio())


main()
