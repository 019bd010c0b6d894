#!/usr/bin/python3
"""stated.py [--size WxH] [--seeds N] [--error E | --live N] [--reference N] [SCENE...]: how true is the error that an image states?

Renders each scene under four skies with --error, for N seeds, and compares what each image states (`estimate.error` of its
statistics) with its relMSE against a long run. Prints one row per scene and sky: the stated error over the true one, its
least, mean, and largest value, and the share of images in which it lies within 0.67 and 1.5. --live N: of the second to N-th live image before a cache exists, by
build/bin/first_pictures; --reference is then its pairs of passes. RELIGHT_BIN: the programs' folder."""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

BIN = Path(os.environ.get("RELIGHT_BIN", "build/bin"))
EXAMPLES = Path(__file__).resolve().parents[2] / "docs/examples"
SKIES = {"morning": "sky:time=06:30", "noon": "sky:time=12:00", "haze": "sky:time=17:00,turbidity=9", "overcast": "cie:1,lux=10000"}


def render(out, scene, sky, size, flags):
    stats = f"{out}.json"
    command = [BIN / "relight-render", "--source", sky, "--size", size, "--out", out, "--stats", stats, *flags]
    command += ["--scene", scene] if scene else []
    command += ["--frames", "1"] if sky.startswith("sky:") else []
    subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    with open(stats, encoding="utf-8") as f:
        return json.load(f)[-1].get("estimate")


def true_error(image, reference):
    done = subprocess.run([str(BIN / "relight-diff"), image, reference, "--json"], check=True, capture_output=True, text=True)
    return json.loads(done.stdout)["rel_mse"]


def ratios(scene, sky, a, folder):
    reference = f"{folder}/reference.exr"
    render(reference, scene, sky, a.size, ["--samples", a.reference, "--seed", "1000"])
    out = []
    for seed in range(1, a.seeds + 1):
        estimate = render(f"{folder}/image.exr", scene, sky, a.size, ["--error", a.error, "--seed", str(seed)])
        out.append(estimate["error"] / true_error(f"{folder}/image.exr", reference))
    return sorted(out)


def live_ratios(scene, sky, a, folder):
    command = [BIN / "first_pictures", a.size, scene or "builtin", sky, a.seeds, a.live, a.reference, f"{folder}/truth"]
    done = subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True)
    os.remove(f"{folder}/truth")
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("seed")]
    return sorted(float(r[-1]) for r in rows if float(r[-1]) > 0), len(rows) - a.seeds


def row(name, sky, r, of):
    numbers = f"{r[0]:.2f} | {sum(r) / len(r):.2f} | {r[-1]:.2f}" if r else "- | - | -"
    within = sum(0.67 <= x <= 1.5 for x in r)
    print(f"| {name} | {sky} | {numbers} | {within} of {len(r)}{of} |", flush=True)
    return within, len(r), sum(x < 0.33 for x in r)


def main():
    p = argparse.ArgumentParser(usage=__doc__)
    p.add_argument("scenes", nargs="*")
    for flag, value in (("--size", "96x54"), ("--error", "1e-2"), ("--reference", "4096")):
        p.add_argument(flag, default=value)
    p.add_argument("--seeds", type=int, default=8)
    p.add_argument("--live", type=int, default=0)
    a = p.parse_args()
    scenes = {"court" if s == "builtin" else Path(s).stem: "" if s == "builtin" else s for s in a.scenes} or {"court": "", "steps": EXAMPLES / "steps.json", "ring": EXAMPLES / "ring.json"}
    print("| scene | sky | least | mean | largest | within 0.67 and 1.5 |\n|---|---|---|---|---|---|")
    counts = []
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in scenes.items():
            for sky, source in SKIES.items():
                r, of = live_ratios(scene, source, a, folder) if a.live else (ratios(scene, source, a, folder), 0)
                counts.append(row(name, sky, r, f", {of - len(r)} state none" if a.live else ""))
    print("%d of %d within, %d below 0.33" % tuple(map(sum, zip(*counts))))


if __name__ == "__main__":
    main()
