#!/usr/bin/python3
"""Prints the table of figures of docs/clusters.md: relight-render as an MPI job on this machine.

usage: ranks.py BIN [--size WxH] [--frames N] [--rounds N] [--cache-dir DIR]

BIN is the folder of the programs. Times are processor time, so that other work on the machine disturbs them little: a job is
as fast as its busiest rank, and what starting costs is taken away by running one frame, too. Runs alternate; medians of rounds."""

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

SKY = ["--source", "sky:date=06-21,time=12:00,speed=5"]
RANK = 'exec 3>&2; TIMEFORMAT="cpu %U %S"; { time "$@" 2>&3; } 2>>"$RANK_TIMES.${OMPI_COMM_WORLD_RANK:-0}"'
SUMMARY = re.compile(r"([0-9.]+) KB to each rank and ([0-9.]+) MB from all")


class Runs:
    def __init__(self, options, work):
        self.render, self.work, self.options = Path(options.bin) / "relight-render", work, options
        self.cache = options.cache_dir or str(work / "cache")
        self.log = ""

    def cpu(self, ranks, frames, *flags):
        """Processor seconds of each rank of a run that writes numbered pictures to self.out."""
        self.out = self.work / "pictures"
        self.out.mkdir(exist_ok=True)
        times = self.work / "times"
        for old in self.work.glob("times.*"):
            old.unlink()
        env = dict(os.environ, RANK_TIMES=str(times), OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
        command = ["bash", "-c", RANK, "rank", str(self.render), *SKY, "--size", self.options.size, "--frames", f"0-{frames - 1}",
                   "--cache-dir", self.cache, "--out", str(self.out / "%03d.exr"), *flags]
        if ranks > 1:
            command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
        done = subprocess.run(command, env=env, capture_output=True, text=True)
        self.log = done.stderr
        if done.returncode:
            sys.exit(f"{' '.join(command)}\n{done.stderr}")
        return [sum(map(float, re.findall(r"[0-9.]+", path.read_text()))) for path in sorted(self.work.glob("times.*"))]

    def frame_s(self, ranks, *flags):
        """Seconds of a frame: those of the busiest rank, divided by its threads, without the start."""
        many, threads = self.options.frames, int(flags[flags.index("--threads") + 1])
        whole, one = self.cpu(ranks, many, *flags), self.cpu(ranks, 1, *flags)
        if ranks > 1 and "--split-frames" not in flags:  # frames are dealt: the sum of all, evenly
            return (sum(whole) - sum(one)) / (many - 1) / ranks
        return max(w - o for w, o in zip(whole, one)) / (many - 1) / threads

    def pictures(self, ranks, *flags):
        for path in self.out.iterdir():
            path.unlink()
        self.cpu(ranks, 2, *flags)
        kept = {path.name: path.read_bytes() for path in self.out.iterdir()}
        for path in self.out.iterdir():
            path.unlink()
        return kept


def medians(runs, cases, rounds):
    seen = [[] for _ in cases]
    for _ in range(rounds):
        for k, (ranks, flags) in enumerate(cases):
            seen[k].append(runs.frame_s(ranks, *flags))
    return [statistics.median(values) for values in seen]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--cache-dir")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(options, Path(folder))
        cached, split = ("--method", "cached"), "--split-frames"
        runs.cpu(1, 1, *cached)  # computes the cache
        one, two_threads, two_dealt, two_split = medians(
            runs, [(1, (*cached, "--threads", "1")), (1, (*cached, "--threads", "2")), (2, (*cached, "--threads", "1")),
                   (2, (*cached, "--threads", "1", split))], options.rounds)
        runs.cpu(2, 4, *cached, "--threads", "1", split)
        sent, back = map(float, SUMMARY.search(runs.log).groups())
        same, methods = 0, ("auto", "mis", "faces", "faces-uniform", "brdf", "uniform", "light", "cached")
        for method in methods:
            flags = ("--method", method, "--threads", "1", *(() if method == "cached" else ("--samples", "2")))
            want = runs.pictures(1, *flags)
            same += all(runs.pictures(n, *flags, split) == want and runs.pictures(n, *flags) == want for n in (2, 3, 4))
        print(f"Court at noon, {options.size}, cached, {options.frames} frames, {options.rounds} rounds, load "
              f"{os.getloadavg()[0]:.1f}; ms of processor time a frame: one rank {1e3 * one:.1f}, one process of two threads "
              f"{1e3 * two_threads:.1f} a thread, two ranks {1e3 * two_dealt:.1f} by frames and {1e3 * two_split:.1f} by parts.\n")
        print("| what | measured |\n|---|---|")
        print(f"| time of 2 ranks x 1 thread / 1 process x 2 threads, by frames | {two_dealt / two_threads:.2f} |")
        print(f"| the same, by parts of each frame | {two_split / two_threads:.2f} |")
        print(f"| speed-up of 2 ranks over 1, by frames | {one / two_dealt:.2f} |")
        print(f"| the same, by parts of each frame (the busiest rank's time) | {one / two_split:.2f} |")
        print(f"| bytes per frame to each of 2 ranks | {sent:.1f} KB |")
        print(f"| bytes per frame from all others of 2 ranks, floats (half of it live) | {back:.2f} MB |")
        print(f"| methods with identical bits on 1, 2, 3 and 4 ranks, by frames and by parts | {same} of {len(methods)} |")


if __name__ == "__main__":
    main()
