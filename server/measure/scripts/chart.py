#!/usr/bin/python3
"""chart.py FOLDER: the tables, charts and page of what relight-chart measures; they are written anew after each panel. relight-chart
starts this script."""

import csv
import io
import math
import os
import re
import sys
import time

import page
import plot
from serve import serve
from winners import ERRORS, find_winners, prepare

FLOOR = {"error": "rel_mse_mean", "bias": "bias", "doubt": "bias_doubt", "z": "bias_z", "variance": "variance", "energy": "energy",
         "energy_doubt": "energy_doubt"}  # columns of the CSV


def number(value):
    """An empty field for what is none."""
    return f"{value:.6g}" if math.isfinite(value) else ""


def place(panel, curve):
    return {"scene": panel["scene"], "source": panel["source"], "light": panel["light"], "technique": curve["technique"]}


def banded(name, values):
    return {f"{name}_{part}": number(v) for part, v in zip(("p10", "median", "p90"), values)}


def points(panels):
    """A row for each technique at each budget."""
    for p in panels:
        common = {f"{part}_ms": number(v) for part, v in p["common_ms"].items()}
        once = {key: number(p[key]) for key in ("load_ms", "bvh_ms", "gbuffer_ms", "table_ms", "reference_noise", "reference_doubt")}
        for c in p["measured"]:
            for k in c["points"]:
                row = {**place(p, c), "kind": c["kind"]}
                row.update((key, k[key]) for key in ("budget", "samples", "eye_paths", "particles", "rays"))
                row.update(seeds=p["seeds"], **banded("frame_ms", k["frame_ms"]))
                for kind in ERRORS:
                    row.update(banded(kind, k["bands"][kind]))
                row.update((column, number(k["floor"][key])) for key, column in FLOOR.items())
                yield {**row, "expected_noise": number(k["expected"] or math.nan), **common,
                       "technique_ms": number(k["frame_ms"][1] - sum(p["common_ms"].values())), **once,
                       "prepared_ms": number(c["prepared_ms"]), "reference_samples": p["reference_samples"], "width": p["width"],
                       "height": p["height"]}


def runs(panels):
    """A row for each run, from which the whole chart can be computed again."""
    for p in panels:
        for c in p["measured"]:
            for k in c["points"]:
                for seed, seconds in enumerate(k["seconds"]):
                    yield {**place(p, c), "budget": k["budget"], "seed": seed, "frame_ms": number(1e3 * seconds),
                           **{kind: number(k["errors"][kind][seed]) for kind in ERRORS}}


def table(rows):
    """CSV [RFC 4180] below a header row; times in milliseconds."""
    rows, out = list(rows), io.StringIO()
    writer = csv.DictWriter(out, rows[0] if rows else (), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


class Chart:
    def __init__(self, folder):
        self.folder, self.begun = folder, time.monotonic()
        self.charted, self.sections = [], []  # of each panel: with its winners; HTML
        self.about = None

    def store(self, name, text):
        path = os.path.join(self.folder, name)
        with open(path + ".part", "w", encoding="utf-8", newline="") as file:
            file.write(text)
        os.replace(path + ".part", path)

    def take(self, line):
        if self.about is None:
            self.about = line
            return
        panel = prepare(line)
        winners = find_winners(panel)
        self.charted.append((panel, winners))
        words = re.sub("[^0-9A-Za-z]+", "-", page.title(panel)).lstrip("-")
        for kind in ERRORS:
            self.store(f"{len(self.charted):02}-{words:.80}.{kind}.svg", plot.draw_file(panel, kind))
        self.sections.append(page.section(panel, winners, len(self.charted)))
        for point in (point for curve in panel["measured"] for point in curve["points"]):
            point["image"] = point["map"] = None  # most of the memory
        panels = [p for p, _ in self.charted]
        self.store("chart.csv", table(points(panels)))
        self.store("runs.csv", table(runs(panels)))
        self.store("index.html", page.whole(self.charted, self.sections, self.about, time.monotonic() - self.begun))


if __name__ == "__main__":
    serve(Chart(sys.argv[1]).take)
