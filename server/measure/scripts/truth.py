"""Converged images to judge delivered ones by: `relight-render --method path`, which has camera rays of its own, in two
independent halves per frame, so that their noise cancels (relight-diff --half). Kept in a folder, since they take long."""

import contextlib
import hashlib
import itertools
import json
import math
import operator
import os
import re
import struct
import subprocess
import zlib

from relightd import Failure, spawn

SMOOTH = 0.9  # cosine between the normals of neighbouring pixels of one surface


class Programs:
    """Runs programs of this build; the one that runs ends with this process."""

    def __init__(self, folder):
        self.folder = folder

    def run(self, name, *arguments):
        """Its standard output."""
        command = [os.path.join(self.folder, name), *map(str, arguments)]
        process = spawn(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        out, said = process.communicate()
        if process.returncode:
            raise Failure(said.strip().split("\n")[-1] or f"{name} ended with {process.returncode}")
        return out


# ---- Layers of relight-render: EXR, one part, scan lines, without compression or with ZIP ----

def read_channels(path, wanted):
    """{name: list of floats, row by row}, width and height."""
    with open(path, "rb") as file:
        data = file.read()
    head, at = {}, 8
    while data[at]:
        end = data.index(b"\0", at)
        kind = data.index(b"\0", end + 1)
        size, = struct.unpack_from("<I", data, kind + 1)
        head[data[at:end].decode()] = data[kind + 5:kind + 5 + size]
        at = kind + 5 + size
    left, top, right, bottom = struct.unpack("<4i", head["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    rows = {0: 1, 2: 1, 3: 16}[head["compression"][0]]
    channels = [(m[1].decode(), "ef"[struct.unpack("<i", m[2])[0] - 1])
                for m in re.finditer(rb"([^\0]+)\0(.{4}).{12}", head["channels"], re.S)]
    line = sum({"e": 2, "f": 4}[kind] for _, kind in channels) * width
    out = {name: [] for name in wanted}
    for chunk in struct.unpack_from(f"<{-(-height // rows)}Q", data, at + 1):
        y, size = struct.unpack_from("<iI", data, chunk)
        count = min(rows, bottom + 1 - y)
        raw = data[chunk + 8:chunk + 8 + size]
        if size < line * count:  # ZIP: differences of bytes, the even ones first
            coded = zlib.decompress(raw)
            halves = bytes(b & 255 for b in itertools.accumulate(coded, lambda a, b: a + b - 128))
            middle = (len(halves) + 1) // 2
            raw = bytearray(len(halves))
            raw[0::2], raw[1::2] = halves[:middle], halves[middle:]
        offset = 0
        for _ in range(count):
            for name, kind in channels:
                if name in out:
                    out[name] += struct.unpack_from(f"<{width}{kind}", raw, offset)
                offset += {"e": 2, "f": 4}[kind] * width
    return out, width, height


def write_mask(path, values, width, height):
    """A grey PNG: white where a value is true."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + bytes(255 if v else 0 for v in values[y * width:(y + 1) * width]) for y in range(height))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


class View:
    """One scene, size and source, and its converged images in a folder of their own."""

    def __init__(self, programs, folder, scene, size, source, samples):
        self.programs, self.samples = programs, samples
        self.seen = ["--size", size, *(["--scene", scene] if scene else [])]
        self.light = ["--source", source]
        key = [programs.run("relight-render", "--version"), size, scene_digest(scene), source_digest(source), str(samples)]
        self.folder = os.path.join(folder, hashlib.sha256("\n".join(key).encode()).hexdigest()[:20])
        os.makedirs(self.folder, exist_ok=True)

    def made(self, name, make):
        """The path of a file of this view; make(path) writes it if it is not there, under another name until it is whole."""
        path = os.path.join(self.folder, name)
        part = os.path.join(self.folder, "part." + name)
        if not os.path.exists(path):
            try:
                make(part)
                os.replace(part, path)
            finally:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(part)
        return path

    def render(self, path, frame, *how):
        self.programs.run("relight-render", *self.seen, *self.light, "--frames", frame, "--out", path, *how)

    def half(self, frame, which):
        return self.made(f"half{which}.{frame}.exr", lambda path: self.render(
            path, frame, "--method", "path", "--samples", self.samples, "--seed", 2 * frame + which))

    def masks(self):
        """Two masks: pixels that show more than plain background; of these, those of one object whose neighbours go on smoothly,
        which leaves out edges."""
        def make(path):
            layers = os.path.join(self.folder, "part.layers.exr")
            self.render(layers, 0, "--method", "mis", "--samples", 1, "--paths", "direct", "--layers")
            try:
                c, width, height = read_channels(layers, ("CryptoObject00.G", "N.X", "N.Y", "N.Z"))
            finally:
                os.unlink(layers)
            normals, covered = list(zip(c["N.X"], c["N.Y"], c["N.Z"])), c["CryptoObject00.G"]
            def smooth(i):
                near = [k for k in (i - width, i + width) if 0 <= k < len(normals)]
                near += [k for k in (i - 1, i + 1) if k // width == i // width]
                return covered[i] > 0.999 and all(sum(map(operator.mul, normals[i], normals[k])) > SMOOTH for k in near)
            write_mask(os.path.join(self.folder, "surfaces.png"), list(map(smooth, range(len(normals)))), width, height)
            write_mask(path, [g > 0 for g in covered], width, height)
        return self.made("seen.png", make), os.path.join(self.folder, "surfaces.png")

    def judge(self, picture, frame):
        """Errors of a linear image of that frame: relMSE with its standard error over all but plain background, over surfaces
        apart from edges, the mean's ratio, FLIP, and FLIP between the halves."""
        halves = [self.half(frame, which) for which in (0, 1)]
        seen, surfaces = self.masks()
        def diff(mask):
            return json.loads(self.programs.run("relight-diff", picture, halves[0], "--half", halves[1], "--mask", mask, "--json"))
        all_of_it, plain = diff(seen), diff(surfaces)
        return {"frame": frame, "rel_mse": all_of_it["rel_mse_halves"], "standard_error": all_of_it["rel_mse_halves_error"],
                "rel_mse_surfaces": plain["rel_mse_halves"], "mean_ratio": all_of_it["mean_ratio"],
                "flip": all_of_it["flip"], "flip_halves": all_of_it["flip_halves"]}

    def exposure(self):
        """Stops for all images of this view: its first frame's log-average at 0.18, to a tenth of a stop."""
        def make(path):
            image = os.path.join(self.folder, "part.first.exr")
            self.render(image, 0, "--method", "mis", "--samples", 16, "--size", "160x90")
            try:
                c, _, _ = read_channels(image, "RGB")
            finally:
                os.unlink(image)
            lit = [y for y in (0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in zip(c["R"], c["G"], c["B"])) if y > 0]
            stops = math.log2(0.18) - sum(map(math.log2, lit)) / len(lit) if lit else 0.0
            with open(path, "w", encoding="ascii") as file:
                file.write(f"{max(-60.0, min(stops, 60.0)):.1f}")
        with open(self.made("exposure", make), encoding="ascii") as file:
            return file.read()

    def converged_flicker(self, frames, samples):
        """Of images as shown, whose noise stands still as far as one seed can make it."""
        for frame in frames:
            self.made(f"shown{samples}.{frame}.png", lambda path, frame=frame: self.render(
                path, frame, "--method", "mis", "--samples", samples, "--exposure", self.exposure()))
        return flicker(self.programs, os.path.join(self.folder, f"shown{samples}.%d.png"), frames[0], frames[-1])


def flicker(programs, pattern, first, last):
    """Of the images of a pattern that exist: percentiles of the second difference in time, in 8-bit codes."""
    said = json.loads(programs.run("relight-diff", "--flicker", f"{first}-{last}", pattern, "--json"))
    return {"triples": said["triples"], "p99_9": said["percentiles"]["99.9"], "most": said["percentiles"]["100"]}


def file_digest(path, out):
    with open(path, "rb") as file:
        for part in iter(lambda: file.read(1 << 20), b""):
            out.update(part)


def scene_digest(scene):
    """Of the scene's file and those beside it that have its name, such as FILE.obj of FILE.json."""
    out = hashlib.sha256()
    if scene and os.path.exists(scene):
        stem, folder = os.path.splitext(os.path.basename(scene))[0], os.path.dirname(scene) or "."
        for name in sorted(os.listdir(folder)):
            if os.path.splitext(name)[0] == stem:
                file_digest(os.path.join(folder, name), out)
    return out.hexdigest()


def source_digest(source):
    """A computed sky's own words; of files what is in them, since examples are written anew for each run."""
    folder = os.path.dirname(source)
    if source.startswith(("sky:", "epw:", "mtx:")) or not os.path.isdir(folder):
        return source
    out = hashlib.sha256()
    for name in sorted(os.listdir(folder)):
        out.update(name.encode())
        file_digest(os.path.join(folder, name), out)
    return os.path.basename(source) + out.hexdigest()
