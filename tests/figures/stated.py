#!/usr/bin/python3
"""stated.py [--size WxH] [--first SEED] [--seeds N] [--pictures N] [--reference N] [--skies NAME,...] [--keep FOLDER] [SCENE...]: how true is
the error that images state?

Lights each scene (builtin or a file; the default is court, steps, ring, plaza and foliage) under four skies by
build/bin/first_pictures, live, with fixed counts and by the cache, and compares what each image states with its relMSE against a
long run of --reference pairs of passes. Prints a row for each scene and sky, and one for each way: the stated error over the
true one, least, mean and largest, how many lie within 0.67 and 1.5, how many upper bounds hold, and how many images say that
they do not know. Images that are nearer to the truth than its noise, so that a negative relMSE was measured, do not count; their
number is the last line. --keep: keeps truths and rows in FOLDER, so that a run goes on where the last one ended. RELIGHT_BIN: the
programs' folder."""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

BIN = Path(os.environ.get("RELIGHT_BIN", "build/bin"))
EXAMPLES = Path(__file__).resolve().parents[2] / "docs/examples"
SKIES = {"morning": "sky:time=06:30", "noon": "sky:time=12:00", "haze": "sky:time=17:00,turbidity=9", "overcast": "cie:1,lux=10000"}


def lines_of(name, scene, sky, seed, folder, a):
    """What first_pictures prints of one seed."""
    kept = folder / f"{name}-{sky}-{a.size}-{seed}"
    if not kept.exists():
        truth = folder / f"{name}-{sky}-{a.size}-{a.reference}.truth"
        command = [BIN / "first_pictures", a.size, scene, SKIES[sky], f"{seed}-{seed}", a.pictures, a.reference, truth]
        environment = dict(os.environ, XDG_CACHE_HOME=str(folder), CACHE_DIRECTORY=str(folder))
        done = subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True, env=environment)
        kept.with_suffix(".new").write_text(done.stdout)
        kept.with_suffix(".new").rename(kept)
    return kept.read_text().splitlines()


def images(name, scene, sky, folder, a):
    """(way, stated / true, bound / true) of each image, the latter two NaN where no error above 0 was measured."""
    for seed in range(a.first, a.first + a.seeds):
        for line in lines_of(name, scene, sky, seed, folder, a):
            words = line.replace("live cached", "cached-live").split()
            if words[0] != "seed":
                continue
            if a.verbose:
                print(line, file=sys.stderr)
            way = words[2].rstrip(":").split(",", 1)[0].replace("cached-live", "live, cached")
            measured = float(words[4]) > 0
            yield way + (" denoised" if "denoised" in words[2] else ""), *(float(words[k]) if measured else math.nan for k in (8, 10))


def row(name, rows):
    rows = [r for r in rows if not math.isnan(r[1])]
    r = [x for _, x, _ in rows if x > 0]
    bounds = [b for _, x, b in rows if x == 0 and b > 0]
    numbers = f"{min(r):.2f} | {sum(r) / len(r):.2f} | {max(r):.2f}" if r else "- | - | -"
    within = sum(0.67 <= x <= 1.5 for x in r)
    print(f"| {name} | {numbers} | {within} of {len(r)} | {sum(x < 0.33 for x in r)} | {sum(b >= 1 for b in bounds)} of {len(bounds)} | {len(rows) - len(r) - len(bounds)} |", flush=True)


def scenes_of(a, folder):
    if a.scenes:
        return {"court" if s == "builtin" else Path(s).stem: s for s in a.scenes}
    for script in ("proof.py", "foliage.py"):
        subprocess.run(["/usr/bin/python3", "-B", str(EXAMPLES / script), folder], check=True)
    return {"court": "builtin", "steps": EXAMPLES / "steps.json", "ring": EXAMPLES / "ring.json",
            "plaza": f"{folder}/plaza.json", "foliage": f"{folder}/foliage.json"}


def main():
    p = argparse.ArgumentParser(usage=__doc__)
    p.add_argument("scenes", nargs="*")
    p.add_argument("--size", default="112x63")
    p.add_argument("--skies", default=",".join(SKIES))
    p.add_argument("--verbose", action="store_true")
    p.add_argument("--keep", type=Path)
    for flag, value in (("--first", 1), ("--seeds", 2), ("--pictures", 2), ("--reference", 4)):
        p.add_argument(flag, type=int, default=value)
    a = p.parse_args()
    ways = {}
    print("| images | least | mean | largest | within 0.67 and 1.5 | below 0.33 | bounds that hold | not known |\n|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        if a.keep:
            a.keep.mkdir(parents=True, exist_ok=True)
        for name, scene in scenes_of(a, folder).items():
            for sky in a.skies.split(","):
                rows = list(images(name, scene, sky, a.keep or Path(folder), a))
                row(f"{name}, {sky}", rows)
                for r in rows:
                    ways.setdefault(r[0], []).append(r)
    for way, rows in ways.items():
        row(way, rows)
    every = sum(ways.values(), [])
    row("**all**", every)
    print(f"\n{sum(math.isnan(r[1]) for r in every)} more images are nearer to the truth than its noise.")


if __name__ == "__main__":
    main()
