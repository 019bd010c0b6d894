#!/usr/bin/python3
"""Prints the table of figures of docs/clusters.md: relight-render and relightd as MPI jobs on this machine.

usage: ranks.py BIN [--size WxH] [--frames N] [--rounds N] [--cache-dir DIR] [--only PART,...]

BIN is the folder of the programs. PARTS: speed, memory, bits, links; all by default. Times are by the clock, so nothing else may
run; runs alternate, and medians of rounds count. The links need root: network namespaces (links.py)."""

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import links as net

SKY = ["--source", "sky:date=06-21,time=12:00,speed=5"]
SUMMARY = re.compile(r"([0-9.]+) KB to each rank and ([0-9.]+) MB from all")
MEMORY = re.compile(r"caches: ([0-9.]+) MB on rank 0, at most ([0-9.]+) MB")
SETTLED = 16  # pictures until shares are measured and memory is shared out
METHODS = ("auto", "mis", "faces", "faces-uniform", "brdf", "uniform", "light", "cached")
CPUS = os.cpu_count()


def started(ranks):
    """Words before the program: each rank has a processor of its own where there are enough."""
    if ranks == 1:
        return ["taskset", "-c", "0"]
    return ["mpirun", "--oversubscribe", "--bind-to", "core" if ranks <= CPUS else "none", "-n", str(ranks)]


class Jobs:
    def __init__(self, options, work):
        self.bin, self.work, self.options = Path(options.bin).resolve(), work, options
        self.cache = options.cache_dir or str(work / "cache")
        self.log = ""

    def flags(self, size=None):
        return [*SKY, "--size", size or self.options.size, "--cache-dir", self.cache]

    def render(self, words, frames, *flags, ending="jpg", size=None):
        """Runs relight-render; returns when each picture was written, in order."""
        out = self.work / "pictures"
        out.mkdir(exist_ok=True)
        for path in out.iterdir():
            path.unlink()
        command = [*words, str(self.bin / "relight-render"), *self.flags(size), "--frames", f"0-{frames - 1}", "--out",
                   str(out / f"%04d.{ending}"), *flags]
        done = subprocess.run(command, env=net.environment(), capture_output=True, text=True)
        self.log = done.stderr
        if done.returncode:
            sys.exit(f"{' '.join(command)}\n{done.stderr}")
        self.pictures = {path.name: path.read_bytes() for path in out.iterdir()} if ending == "exr" else {}
        return sorted(path.stat().st_mtime for path in out.iterdir())

    def compute_cache(self, size):
        self.render([], 1, "--method", "cached", size=size)

    def frame_s(self, words, *flags, size=None):
        times = self.render(words, SETTLED + self.options.frames, *flags, size=size)
        return (times[-1] - times[SETTLED - 1]) / self.options.frames

    def live_s(self, words, *flags):
        """Seconds from picture to picture that a recorder of JPEG gets from relightd."""
        log, index = self.work / "live.log", self.work / "live.index"
        index.unlink(missing_ok=True)
        with open(log, "w") as err:
            server = subprocess.Popen([*words, str(self.bin / "relightd"), *self.flags(), "--rate", "0", "--fps", "240", "--method",
                                       "cached", "--samples", "64", "--port", "0", "--converge", "off", "--exposure", "0",
                                       "--cache-wait", *flags], stderr=err, env=net.environment())
        try:
            while not (found := re.search(r"listening on http(\S+)", log.read_text())):
                if server.poll() is not None:
                    sys.exit(log.read_text())
                time.sleep(0.1)
            subprocess.run([str(self.bin / "relight-record"), "--from", "ws" + found[1], "--frames", str(SETTLED + self.options.frames),
                            "--index", str(index), "--quiet", "--out", str(self.work / "live.%06d.jpg")], check=True)
        finally:
            server.terminate()
            server.wait()
        self.log = log.read_text()
        at = [json.loads(line)["published_us"] * 1e-6 for line in index.read_text().splitlines()]
        return (at[-1] - at[SETTLED - 1]) / (len(at) - SETTLED)


def medians(cases, rounds):
    seen = [[] for _ in cases]
    for _ in range(rounds):
        for k, case in enumerate(cases):
            seen[k].append(case())
    return [statistics.median(values) for values in seen]


def speed(jobs):
    one, two = ("--method", "cached", "--threads", "1"), ("--method", "cached", "--threads", "2")
    jobs.compute_cache(jobs.options.size)
    taken = medians([lambda: jobs.frame_s(started(1), *one), lambda: jobs.frame_s([], *two), lambda: jobs.frame_s(started(2), *one),
                     lambda: jobs.frame_s(started(2), *one, "--split-frames"), lambda: jobs.live_s(started(1), "--threads", "1"),
                     lambda: jobs.live_s([], "--threads", "2"), lambda: jobs.live_s(started(2), "--threads", "1")],
                    jobs.options.rounds)
    sent, back = SUMMARY.search(jobs.log).groups()
    f1, f2t, f2, f2s, l1, l2t, l2 = taken
    print(f"Court at noon, {jobs.options.size}, cached, JPEG, medians of {jobs.options.rounds} rounds of {jobs.options.frames} "
          f"pictures; load {os.getloadavg()[0]:.1f}. ms a picture, each rank on a processor of its own: one rank of one thread "
          f"{1e3 * f1:.1f}, one process of two threads {1e3 * f2t:.1f}, two ranks {1e3 * f2:.1f} by frames and {1e3 * f2s:.1f} by parts; "
          f"live {1e3 * l1:.1f}, {1e3 * l2t:.1f}, {1e3 * l2:.1f}.\n")
    return [("time of 2 ranks x 1 thread / 1 process x 2 threads: frames; live", f"{f2 / f2t:.2f}; {l2 / l2t:.2f}", "1.05"),
            ("speed-up of 2 ranks over 1: by frames; by parts; live", f"{f1 / f2:.2f}; {f1 / f2s:.2f}; {l1 / l2:.2f}", "1.85"),
            (f"bytes per live picture, 2 ranks of one {jobs.options.size}: to each rank; from the others", f"{sent} KB; {back} MB",
             "100 KB; 5.6 MB")]


def memory(jobs):
    stats = jobs.work / "stats.json"
    jobs.render([], 1, "--method", "cached", "--stats", str(stats))
    one = json.loads(stats.read_text())[0]
    whole = 1e-6 * sum(one[part]["bytes"] for part in ("gbuffer", "cache", "interreflection"))
    jobs.render(started(4), SETTLED, "--method", "cached", "--threads", "1", "--split-frames")
    first, most = map(float, MEMORY.search(jobs.log).groups())
    return [(f"G-buffer and cache of one of 4 ranks / one process ({whole:.0f} MB): rank 0; the largest other",
             f"{first / whole:.2f}; {most / whole:.2f}", "0.30")]


def bits(jobs):
    same = 0
    for method in METHODS:
        flags = ("--method", method, "--threads", "1", *(() if method == "cached" else ("--samples", "2")))
        jobs.render([], 3, *flags, ending="exr", size="160x90")
        want, equal = jobs.pictures, True
        for ranks in (2, 3, 4):
            for split in ((), ("--split-frames",)):
                jobs.render(started(ranks), 3, *flags, *split, ending="exr", size="160x90")
                equal = equal and jobs.pictures == want
        same += equal
    return [("methods with the bits of one process on 2, 3 and 4 ranks, by frames and by parts", f"{same} of {len(METHODS)}", "all")]


def predict(c, ranks, rate_mbit, delay_ms, processors):
    """Seconds from picture to picture, and what they are spent on. c: light_s and other_s of a picture on one thread, of which rank 0
    does the other work; bytes down to each rank, and up from all if each point were sent."""
    if ranks == 1:
        return c["light_s"] + c["other_s"], "light"
    rate, delay, light, other = rate_mbit * 1e6 / 8, delay_ms * 1e-3, c["light_s"], c["other_s"]
    slow = ranks / min(ranks, processors)  # ranks that share a processor
    link = c["up"] / rate  # into rank 0, whose link all share
    others = max(light * slow / (ranks - 1), link)
    # Rank 0's own part, at which it takes the time of the others, as far from an even share as ranks may go at first.
    own = min(max((others - other) / (light * slow + others), 0.25 / ranks), 1.75 / ranks)
    down = c["down"] / rate * (ranks - 1).bit_length()
    # Orders go out one picture ahead, so half of the way there and back counts, light and bytes included.
    way = (2 * delay + down + (1 - own) * (light * slow / (ranks - 1) + link)) / 2
    return max(((light + other) / min(ranks, processors), "processors"), (other + own * light * slow, "rank 0"),
               ((1 - own) * light * slow / (ranks - 1), "other ranks"), ((1 - own) * link + down, "rank 0's link"), (way, "delay"))


def constants(jobs, size, half):
    """Of one process with one thread, and of two ranks without a network between them."""
    stats = jobs.work / "stats.json"
    jobs.compute_cache(size)
    jobs.render(started(1), 12, "--method", "cached", "--threads", "1", "--stats", str(stats), size=size)
    ms = [entry["ms"] for entry in json.loads(stats.read_text())[2:]]
    median = lambda *names: 1e-3 * statistics.median(sum(m[name] for name in names) for m in ms)
    points = json.loads(stats.read_text())[0]["gbuffer"]["shade_points"]
    jobs.render(started(2), SETTLED, "--method", "cached", "--threads", "1", "--split-frames", size=size)
    down = float(SUMMARY.search(jobs.log)[1]) * 1e3
    return {"light_s": median("shade"), "other_s": median("decode", "rebuild", "resolve", "write"), "down": down,
            "up": points * 3 * (2 if half else 4) * 1.03}  # packets are not quite full; headers


def links(jobs):
    size, worst = jobs.options.link_size, 0.0
    c = constants(jobs, size, half=False)
    print(f"Model, {size}: light {1e3 * c['light_s']:.1f} ms, rank 0's other work {1e3 * c['other_s']:.1f} ms, {1e-3 * c['down']:.1f} KB "
          f"to each rank, {1e-6 * c['up']:.2f} MB of floats for all points.\n")
    print("| ranks | Mbit/s | delay, ms | measured, ms a picture | model | | what limits |\n|---|---|---|---|---|---|---|")
    for rate in (100, 1000):
        for delay in map(float, jobs.options.delays.split(",")):
            for ranks in map(int, jobs.options.ranks.split(",")):
                with net.Links(ranks, rate, delay) as joined:
                    took = jobs.frame_s(joined.command([]), "--method", "cached", "--threads", "1", "--split-frames", size=size)
                want, limit = predict(c, ranks, rate, delay, CPUS)
                off = want / took - 1
                worst = max(worst, abs(off))
                print(f"| {ranks} | {rate} | {delay} | {1e3 * took:.1f} | {1e3 * want:.1f} | {100 * off:+.0f} % | {limit} |", flush=True)
    return [("model against measurement at these rates and delays: worst", f"{100 * worst:.0f} %", "15 %")]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin")
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--cache-dir")
    parser.add_argument("--link-size", default="640x360")
    parser.add_argument("--delays", default="0.1,1,5", help="ms, one way")
    parser.add_argument("--ranks", default="2,3,4")
    parser.add_argument("--only", default="speed,memory,bits,links")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        jobs = Jobs(options, Path(folder))
        for part in options.only.split(","):
            rows = {"speed": speed, "memory": memory, "bits": bits, "links": links}[part](jobs)
            print("\n| what | measured | target |\n|---|---|---|")
            for what, measured, target in rows:
                print(f"| {what} | {measured} | {target} |", flush=True)


if __name__ == "__main__":
    main()
