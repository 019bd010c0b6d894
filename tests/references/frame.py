#!/usr/bin/env python3
"""A single image: processor time of Blender's Cycles over that of relight-render at equal error, direct light and all.

    frame.py [--size 640x360] [--reference 512] [--counts 16,64] [--sky FILE] [NAME=SCENE ...]

Without scenes: the built-in court, all of it matte, and the plaza of docs/examples/proof.py, whose sky with a sun is the default.
Both programs have one thread. The error of each is its noise: relMSE, without the worst 2 % of pixels, against a reference of its
own with other camera rays than its images, so that their aliasing counts, of --reference samples a pixel by Cycles, kept as
compare.sh keeps its pictures, and of as many by relight-render --method path; how far the two references differ is printed first. Cycles' errors are less its reference's share. Its time at our
error lies between its --counts, or beyond them by error ~ 1 / samples. Set-up is the time of an image of one sample. Medians
of three seeds of ours. RELIGHT_BIN names the folder of the programs; left out, that of
./run. Exit code: 0, 1 a program failed, 2 usage, 77 no Blender.
"""
import argparse
import json
import math
import os
import pathlib
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
BIN = pathlib.Path(os.environ.get("RELIGHT_BIN", HERE / "../../build/bin"))
SEEDS, ERROR = (1, 2, 3), 1e-3
OURS = ("--samples 16", "--samples 64", f"--error {ERROR:g}")


def run(*command):
    """Processor time in seconds, and what the command printed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, env=dict(os.environ, OMP_NUM_THREADS="1"))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"frame.py: {command[0]} failed:\n{done.stdout}{done.stderr}")
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stdout


def differ(picture, reference):
    return json.loads(run(BIN / "relight-diff", picture, reference, "--json")[1])


class Case:
    """A scene in one light, its references, and what images of it take."""

    def __init__(self, scene, sky, size, direct, work):
        self.scene, self.sky, self.size, self.work = scene, sky, size, work
        self.direct = ["--direct"] if direct else []
        self.paths = "direct" if direct else "all"
        self.reference = {}

    def ours(self, flags, seed):
        """Processor time, and the image."""
        out = self.work / "ours.exr"
        return run(BIN / "relight-render", "--scene", self.scene, "--source", self.sky, "--size", self.size, "--paths", self.paths,
                   "--threads", 1, "--seed", seed, *flags.split(), "--out", out)[0], out

    def cycles(self, samples):
        out = self.work / "cycles.exr"
        return run("blender", "-b", "-noaudio", "-t", 1, "-P", HERE / "cycles.py", "--", self.scene, self.sky, out,
                   *self.size.split("x"), samples, *self.direct)[0], out

    def error(self, picture):
        return differ(picture, self.reference[picture.stem])["rel_mse_trimmed"]

    def make_references(self, samples):
        """Cycles' has another seed than its images, which would otherwise be parts of it."""
        script = f'. {HERE}/cycles.sh; cycles_picture "$@" >&2 && echo "$reference"'
        out = run("bash", "-c", script, "-", self.scene, self.sky, self.size, samples, *self.direct, "--seed", 1000)[1]
        kept = self.work / f"reference-{self.paths}.exr"
        _, ours = self.ours(f"--method path --samples {samples}", 1000)
        shutil.move(ours, kept)
        self.reference = {"cycles": out.strip().splitlines()[-1], "ours": kept}
        return differ(kept, self.reference["cycles"])


def samples_at(error, points):
    """points: (samples, error), ascending. Straight in logarithms between two, and -1 steep outside."""
    (n0, e0), (n1, e1) = points[0], points[-1]
    for (a, b), (c, d) in zip(points, points[1:]):
        if d <= error <= b:
            return math.exp(math.log(a) + math.log(b / error) * math.log(c / a) / math.log(b / d))
    return n0 * e0 / error if error > e0 else n1 * e1 / error


def compare(name, case, counts, reference):
    both = case.make_references(reference)
    print(f"{name}, {case.paths} light: references differ by {both['mean_ratio'] - 1:+.2%} in the mean, "
          f"relMSE {both['rel_mse_trimmed']:.1e} (ours against Cycles')", flush=True)
    start, points = case.cycles(1)[0], []
    for n in counts:
        seconds, picture = case.cycles(n)
        points.append((n, case.error(picture) / (1 + n / reference)))  # 1/n + 1/reference without the latter
        print(f"  Cycles, {n} samples: {seconds:.2f} s, set-up {start:.2f} s, error {points[-1][1]:.2e}", flush=True)
    each = max(seconds - start, 0) / (counts[-1] - 1)  # of a tiny image nothing can be told
    set_up = statistics.median(case.ours("--samples 1", seed)[0] for seed in SEEDS)
    for flags in OURS:
        made = []
        for seed in SEEDS:
            seconds, picture = case.ours(flags, seed)
            made.append((seconds, case.error(picture)))
        ours, error = (statistics.median(m[k] for m in made) for k in (0, 1))
        n = samples_at(error, points)
        theirs = start + each * (n - 1)
        print(f"  ours, {flags}: {ours:.2f} s, set-up {set_up:.2f} s, error {error:.2e}; Cycles {theirs:.1f} s for {n:.0f} samples: "
              f"{theirs / ours:.1f} times ours, {(theirs - start) / max(ours - set_up, 1e-3):.1f} without set-up", flush=True)


def read_arguments():
    parser = argparse.ArgumentParser(prog="frame.py", usage=__doc__.split("\n\n")[1].strip())
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--reference", type=int, default=512)
    parser.add_argument("--counts", type=lambda text: sorted(int(n) for n in text.split(",")), default=[16, 64])
    parser.add_argument("--sky")
    parser.add_argument("scenes", nargs="*", metavar="NAME=SCENE")
    arguments = parser.parse_args()
    if not all("=" in scene for scene in arguments.scenes) or arguments.counts[0] < 2:
        parser.error("scenes are NAME=FILE, and counts at least 2")
    return arguments


def main():
    arguments = read_arguments()
    if not shutil.which("blender"):
        print("skipped: Blender is not installed (Debian package: blender)")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        run(BIN / "court", work)
        run(sys.executable, HERE / "../../docs/examples/proof.py", work)
        sky = arguments.sky or work / "clouds.hdr"
        for scene in arguments.scenes or [f"court={work}/court.json", f"plaza={work}/plaza.json"]:
            name, path = scene.split("=", 1)
            for direct in (True, False):
                compare(name, Case(path, sky, arguments.size, direct, work), arguments.counts, arguments.reference)
    return 0


if __name__ == "__main__":
    sys.exit(main())
