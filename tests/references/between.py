#!/usr/bin/env python3
"""How close images between two captured skies come to those of the skies that were left out: the figures of
docs/timelapse.md, by docs/examples/timelapse.py, whose skies are known at any time.

    python3 between.py BIN   # the folder of relight-render and relight-diff; about three minutes
"""
import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
RIG = ROOT / "docs/examples/timelapse.py"
SIZE = ["--size", "320x180"]


class Bench:
    def __init__(self, programs, work):
        self.programs, self.work = pathlib.Path(programs), pathlib.Path(work)
        self.mask = self.work / "mask.exr"
        top = self.work / "top.hdr"  # light from the zenith alone: only surfaces are not black
        rows = bytes((128, 128, 128, 129)) * 64 + bytes(4) * 64 * 31
        top.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n" + rows)
        self.render(top, self.mask, method="mis")

    def skies(self, name, *options):
        folder = self.work / name
        subprocess.run([sys.executable, "-B", RIG, folder, "--width", "1024", *map(str, options)], check=True)
        return folder

    def render(self, source, out, *options, method="cached"):
        command = [self.programs / "relight-render", "--source", source, *SIZE, "--method", method, "--paths", "direct",
                   "--cache-dir", self.work / "cache", "--exposure", "1", "--out", out, *options]
        run = subprocess.run(list(map(str, command)), capture_output=True, text=True)
        if run.returncode:
            sys.exit(run.stderr)
        return run.stderr

    def compare(self, image, reference, masked=False):
        command = [self.programs / "relight-diff", "--json", image, reference] + (["--mask", self.mask] if masked else [])
        return json.loads(subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True).stdout)

    def flicker(self, pattern, last):
        out = subprocess.run([str(self.programs / "relight-diff"), "--json", "--flicker", f"0-{last}", str(pattern)],
                             capture_output=True, text=True, check=True).stdout
        return json.loads(out)


def mean(values):
    values = list(values)
    return sum(values) / len(values)


def left_out(b, count=33):
    """Every second, fourth and eighth sky kept; images of the others against those of the true skies."""
    true = b.skies("true", "--count", count, "--step", 15, "--clear-sun")
    b.render(true, b.work / "true.%04d.exr")
    files = sorted(true.glob("*.exr"))
    print("relMSE of images between, and over that of holding the last sky: all pixels; surfaces alone")
    for keep in (2, 4, 8):
        some = b.work / f"every{keep}"
        some.mkdir()
        for f in files[::keep]:
            shutil.copy(f, some)
        for how in ("hold", "fade", "motion"):
            mode = "off" if how == "hold" else how
            b.render(some, b.work / f"{how}.%04d.exr", "--hold", keep, "--between", mode)
            between = [k for k in range(count) if k % keep]
            errors = [[b.compare(b.work / f"{how}.{k:04d}.exr", b.work / f"true.{k:04d}.exr", masked)["rel_mse"] for k in between]
                      for masked in (False, True)]
            whole, surfaces = map(mean, errors)
            if how == "hold":
                held = whole, surfaces
            print(f"  1 of {keep} {how:7} {whole:.2e} {whole / held[0]:.3f}   {surfaces:.2e} {surfaces / held[1]:.3f}")


def jitter(b, count=24):
    print("flicker: 99.9 % of second differences, 8-bit codes; 5 % scatter of exposure, 3 % of white balance")
    clean = None
    for name, harm, flags in (("clean", (), ()), ("scattered", ("--jitter", 5, "--wb", 3), ()),
                              ("deflickered", ("--jitter", 5, "--wb", 3), ("--deflicker",))):
        folder = b.skies(f"flicker-{name}", "--count", count, "--step", 15, "--clear-sun", *harm)
        b.render(folder, b.work / f"{name}.%04d.png", *flags)
        shown = b.flicker(b.work / f"{name}.%04d.png", count - 1)
        clean = clean or shown
        print(f"  {name:11} {shown}")


def cloud(b):
    print("a cloud takes 90 % of the sun within one interval: mean brightness over that of a straight line, at least and most")
    folder = b.skies("cloud", "--count", 4, "--step", 60, "--cloud-over-sun", 2, "--clear-sun")
    b.render(folder, b.work / "cloud.%04d.exr", "--hold", 10)
    levels = [b.compare(b.work / f"cloud.{k:04d}.exr", b.work / "cloud.0010.exr")["mean_ratio"] for k in range(10, 21)]
    ratios = [level / (levels[0] + (levels[-1] - levels[0]) * k / 10) for k, level in enumerate(levels)]
    print(f"  {min(ratios):.4f} {max(ratios):.4f}, {'falls at every image' if levels == sorted(levels, reverse=True) else 'NOT monotonous'}")


def north(b):
    print("alignment of a rig turned by 37 degrees, by the program's own words")
    for count, tilt, harm in ((1, 0, ()), (10, 0, ()), (10, 6, ()), (10, 6, ("--clip", 2))):
        folder = b.skies(f"north-{count}-{tilt}-{len(harm)}", "--count", count, "--step", 1800, "--time", "08:00:00", "--clear-sun",
                         "--rotate", 37, "--tilt", tilt, *harm)
        said = b.render(folder, b.work / "north.%04d.exr", "--align", "sun", "--place", "45,0")
        print(f"  {count:2} skies, tilt {tilt}{', clipped' if harm else ''}: {[line for line in said.splitlines() if 'north:' in line][-1].partition('north: ')[2]}")


def cost(b):
    print("processor time of 64 images, seconds: 64 skies; 9 skies with 7 images between each two, fading and moving")
    b.skies("many", "--count", 64, "--step", 15, "--clear-sun")
    few = b.skies("few", "--count", 9, "--step", 120, "--clear-sun")
    for source, flags in ((b.work / "many", ()), (few, ("--hold", "8")), (few, ("--hold", "8", "--between", "motion"))):
        spent = []
        for _ in range(3):
            before = os.times()
            b.render(source, b.work / "cost.%04d.exr", *flags)
            after = os.times()
            spent.append(after.children_user + after.children_system - before.children_user - before.children_system)
        print(f"  {' '.join(flags) or 'none between':28} {sorted(spent)[1]:.2f}")


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("programs", metavar="BIN")
    with tempfile.TemporaryDirectory() as work:
        b = Bench(words.parse_args().programs, work)
        for part in (left_out, jitter, cloud, north, cost):
            part(b)


if __name__ == "__main__":
    main()
