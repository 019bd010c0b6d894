#!/usr/bin/python3
"""Prints the table of figures of docs/clusters.md: relight-render and relightd as MPI jobs on this machine.

usage: ranks.py BIN [--size WxH] [--frames N] [--rounds N] [--cache-dir DIR] [--only PART,...]

BIN is the folder of the programs. PARTS: speed, memory, bits, many (64 ranks by the model), kills, links; all by default, some 25
minutes on two processors. Times are by the clock, so nothing else may run; runs alternate, and medians of rounds count. many and
links need root: network namespaces (links.py). links can run in pieces, by --rates, --delays and --ranks, with --results."""

import argparse
import ctypes
import json
import os
import re
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import links as net
from kills import kills

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

    def beside_s(self, *flags):
        """As frame_s of one process on the first processor, while another works on the second: what processors leave each other."""
        other = self.work / "other"
        other.mkdir(exist_ok=True)
        with open(self.work / "other.log", "w") as log:
            partner = subprocess.Popen(["taskset", "-c", "1", str(self.bin / "relight-render"), *self.flags(), "--frames", "0-9999", "--out",
                                        str(other / "%04d.jpg"), *flags], stderr=log)
        try:
            while partner.poll() is None and not any(other.iterdir()):
                time.sleep(0.05)
            return self.frame_s(started(1), *flags)
        finally:
            partner.kill()
            partner.wait()
            for path in other.iterdir():
                path.unlink()

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
        self.summary = SUMMARY.search(self.log) or getattr(self, "summary", None)
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
                     lambda: jobs.live_s([], "--threads", "2"), lambda: jobs.live_s(started(2), "--threads", "1"),
                     lambda: jobs.beside_s(*one)], jobs.options.rounds)
    f1, f2t, f2, f2s, l1, l2t, l2, beside = taken
    print(f"Court at noon, {jobs.options.size}, cached, JPEG, medians of {jobs.options.rounds} rounds of {jobs.options.frames} "
          f"pictures; load {os.getloadavg()[0]:.1f}. ms a picture, each rank on a processor of its own: one rank of one thread "
          f"{1e3 * f1:.1f}, one process of two threads {1e3 * f2t:.1f}, two ranks {1e3 * f2:.1f} by frames and {1e3 * f2s:.1f} by parts; "
          f"live {1e3 * l1:.1f}, {1e3 * l2t:.1f}, {1e3 * l2:.1f}.\n")
    return [("time of 2 ranks x 1 thread / 1 process x 2 threads: frames; live", f"{f2 / f2t:.2f}; {l2 / l2t:.2f}", "1.05"),
            ("speed-up of 2 ranks over 1: by frames; by parts; live", f"{f1 / f2:.2f}; {f1 / f2s:.2f}; {l1 / l2:.2f}", "1.85"),
            ("of two processes that share nothing, side by side", f"{2 * f1 / beside:.2f}", "a bound"),
            (f"bytes per live picture, 2 ranks of one {jobs.options.size}: to each rank; from the others", "{} KB; {} MB".format(*jobs.summary.groups()),
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


def memory_limit(ranks):
    """The largest share of a rank, as server/job/team/shares.c limits it."""
    handed = max(0.02, 0.45 / (ranks - 1) ** 3)
    return (1 + handed + max(1 / 128, handed / 3)) / ranks


def period(c, ranks, own, rate, delay, processors):
    """Seconds from picture to picture when rank 0 lights `own` of the points: the chain of orders, parts and answers, followed until it
    repeats. Rank 0 sends each order once its own part of the picture before is lit, then waits for the answers to that picture."""
    part, share = (1 - own) / (ranks - 1), max(1.0, (ranks - 1) / max(processors - 1, 1))
    carried = c["carry_s"] * (1 - own) * c["up"] / 2  # of processor time, at either end
    hops, hop = (ranks - 1).bit_length(), delay + c["down"] / rate  # of a broadcast
    work = c["light_s"] * part + carried / (ranks - 1)
    sent = lit = free = begin = 0.0
    answer, times = 0.0, []
    for _ in range(60):
        # Others: the answer to this picture, whose order was sent at `sent`. Ranks that share a processor keep it busy from the first
        # order's arrival on; none is ready sooner than its own work after the last one's.
        lit = max(max(lit, sent + hop) + work * share, sent + hops * hop + work)
        free = max(free, lit + 2 * delay) + (1 - own) * c["up"] / rate  # a long message is announced, and then asked for
        answer = free + delay
        # Rank 0: its own part, the next order, this picture's answers, and what only it does.
        sent = begin + c["light_s"] * own + c["ahead_s"]
        begin = max(sent, answer) + carried + c["after_s"] + c["lost_s"]
        times.append(begin)
    return (times[-1] - times[-21]) / 20


def predict(c, ranks, rate_mbit, delay_ms, processors, highest=None):
    """Seconds from picture to picture, and what limits them. c: of a picture on one thread, seconds of light, of work on the next one and on
    this one that only rank 0 has, and of processor time per byte carried; bytes down to each rank, and up if all points were sent. highest: the
    share of the points that rank 0 lights at most; without, that of memory."""
    other = c["ahead_s"] + c["after_s"]
    if ranks == 1:
        return c["light_s"] + other, "light"
    rate, delay = rate_mbit * 1e6 / 8, delay_ms * 1e-3
    least, highest = max(0.0, 1 - (ranks - 1) * memory_limit(ranks)), highest or memory_limit(ranks)
    owns = [least + (highest - least) * k / 100 for k in range(101)]
    took, own = min((max(period(c, ranks, own, rate, delay, min(ranks, processors)),
                         (c["light_s"] + other + c["carry_s"] * (1 - own) * c["up"]) / min(ranks, processors)), own) for own in owns)
    part = (1 - own) / (ranks - 1)
    return took, max(((c["light_s"] + other + c["carry_s"] * (1 - own) * c["up"]) / min(ranks, processors), "processors"),
                     (other + own * c["light_s"] + c["carry_s"] * (1 - own) * c["up"] / 2, "rank 0"), (part * c["light_s"], "other ranks"),
                     ((1 - own) * c["up"] / rate, "rank 0's link"), (0.9 * took, "delay"))[1]


def adopt(whether):
    """Whether this process becomes the parent of what mpirun leaves behind: the daemons of other hosts, whose ranks' time busy_s counts."""
    ctypes.CDLL(None).prctl(36, int(whether), 0, 0, 0)  # PR_SET_CHILD_SUBREAPER


def busy_s():
    """Processor time of this process, which carries packets, and of its children, once all have ended."""
    try:
        while True:
            os.waitpid(-1, 0)
    except ChildProcessError:
        return sum(usage.ru_utime + usage.ru_stime for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))


def sample(jobs, size, half=False):
    """One measurement of what `constants` needs. Stages: of two ranks that share out frames, so that both processors are busy. Spent: processor
    time per picture of a job by parts over a link without limits. Free: its time from picture to picture."""
    stats = jobs.work / "stats.json"
    jobs.render(started(2), 40, "--method", "cached", "--threads", "1", "--stats", str(stats), size=size)
    entries = json.loads(stats.read_text())
    median = lambda *names: 1e-3 * statistics.median(sum(entry["ms"][name] for name in names) for entry in entries[6:])
    spent = []
    adopt(True)
    with net.Links(2, 100000, 0.0) as joined:
        for frames in (SETTLED, SETTLED + 40):
            start = busy_s()
            times = jobs.render(joined.command([]), frames, "--method", "cached", "--threads", "1", "--split-frames", size=size)
            spent.append(busy_s() - start)
    adopt(False)
    down, back = map(float, SUMMARY.search(jobs.log).groups())
    return {"light_s": median("shade"), "ahead_s": median("decode", "rebuild"), "after_s": median("resolve", "write"), "down": down * 1e3,
            "up": entries[0]["gbuffer"]["shade_points"] * 3 * (2 if half else 4) * 1.03,  # packets are not quite full; headers
            "spent_s": (spent[1] - spent[0]) / 40, "back": back * 1e6, "free_s": (times[-1] - times[SETTLED - 1]) / 40}


def constants(samples, stages=None):
    """Of the model. Carrying: what a picture by parts takes of processor time beyond the stages. Lost: what it takes from picture to picture
    beyond the model, by uneven shares and by waiting for looks into MPI. Both are medians: what a start takes varies by as much as they do.
    stages: the sample of these; medians by default."""
    middle = lambda of: statistics.median(map(of, samples))
    c = {name: stages[name] if stages else middle(lambda s: s[name]) for name in ("light_s", "ahead_s", "after_s", "down", "up")}
    c["carry_s"] = max(0.0, middle(lambda s: (s["spent_s"] - s["light_s"] - s["ahead_s"] - s["after_s"]) / s["back"]))
    c["lost_s"] = max(0.0, middle(lambda s: s["free_s"] - predict(dict(s, carry_s=c["carry_s"], lost_s=0.0), 2, 100000, 0.0, CPUS)[0]))
    return c


def most_points(jobs, ranks, size, up):
    """The share of the points that rank 0 takes if the link is slow: what the limit of memory allows, which counts bytes."""
    with net.Links(ranks, 50, 0.0) as joined:
        jobs.render(joined.command([]), SETTLED + 8, "--method", "cached", "--threads", "1", "--split-frames", size=size)
    return 1 - float(SUMMARY.search(jobs.log)[2]) * 1e6 / up


def measure_links(jobs, seen):
    """Adds a round to the measurements: a sample of the constants beside the cases of each link, since a machine's speed changes."""
    options, size = jobs.options, jobs.options.link_size
    for rate in map(int, options.rates.split(",")):
        for delay in map(float, options.delays.split(",")):
            seen.append({"sample": sample(jobs, size), "cases": []})
            for ranks in map(int, options.ranks.split(",")):
                with net.Links(ranks, rate, delay) as joined:
                    took = jobs.frame_s(joined.command([]), "--method", "cached", "--threads", "1", "--split-frames", size=size)
                seen[-1]["cases"].append([rate, delay, ranks, took])
            print(f"{rate} Mbit/s, {delay} ms: measured", file=sys.stderr, flush=True)
            if options.results:
                Path(options.results).write_text(json.dumps(seen))


def links(jobs):
    size, results, offs = jobs.options.link_size, jobs.options.results, []
    seen = json.loads(Path(results).read_text()) if results and Path(results).exists() else []
    jobs.compute_cache(size)
    for _ in range(jobs.options.rounds):
        measure_links(jobs, seen)
    samples = [group["sample"] for group in seen]
    cases = sorted({tuple(case[:3]) for group in seen for case in group["cases"]})
    most = {ranks: most_points(jobs, ranks, size, samples[0]["up"]) for ranks in sorted({case[2] for case in cases})}
    c = constants(samples)
    print(f"Model, {size}: light {1e3 * c['light_s']:.1f} ms, rank 0 alone {1e3 * c['ahead_s']:.1f} ms ahead and {1e3 * c['after_s']:.1f} ms "
          f"afterwards, {1e9 * c['carry_s']:.2f} ns a byte for carrying, {1e3 * c['lost_s']:.1f} ms lost, {1e-3 * c['down']:.1f} KB to each rank, {1e-6 * c['up']:.2f} MB of floats "
          f"for all points; rank 0 lights at most {', '.join(f'{most[n]:.2f} of {n}' for n in most)} ranks. Medians of {len(samples)} samples.\n")
    print("| ranks | Mbit/s | delay, ms | runs | measured, ms a picture | model | | what limits |\n|---|---|---|---|---|---|---|---|")
    for rate, delay, ranks in cases:
        runs = [(case[3], *predict(constants(samples, group["sample"]), ranks, rate, delay, CPUS, most[ranks]))
                for group in seen for case in group["cases"] if tuple(case[:3]) == (rate, delay, ranks)]
        took, want = (statistics.median(run[k] for run in runs) for k in (0, 1))
        offs.append(want / took - 1)
        print(f"| {ranks} | {rate} | {delay} | {len(runs)} | {1e3 * took:.1f} | {1e3 * want:.1f} | {100 * offs[-1]:+.0f} % | {runs[-1][2]} |", flush=True)
    within = sum(abs(off) <= 0.15 for off in offs)
    return [(f"model against measurement at these rates and delays: range; within 15 %",
             f"{100 * min(offs):+.0f} to {100 * max(offs):+.0f} %; {within} of {len(offs)}", "15 %")]


def many(jobs):
    """64 ranks at 3840x2160 by the model: what grows with the points is measured at a smaller size, and scaled."""
    width, height = map(int, jobs.options.size.split("x"))
    jobs.compute_cache(jobs.options.size)
    scale, c = 3840 * 2160 / (width * height), constants([sample(jobs, jobs.options.size, half=True) for _ in range(5)])
    large = dict(c, light_s=c["light_s"] * scale, after_s=c["after_s"] * scale, up=c["up"] * scale)
    print(f"64 ranks of one thread, 3840x2160, half floats: light {large['light_s']:.2f} s, {1e3 * large['after_s']:.0f} ms of resolving and JPEG on "
          f"rank 0, {1e3 * large['carry_s'] * large['up']:.0f} ms of carrying, {1e-6 * large['up']:.0f} MB from all. One rank: "
          f"{predict(large, 1, 0, 0, 64)[0]:.2f} s a picture.")
    rows = []
    for gbit in (1, 10, 100):
        took, limit = predict(large, 64, 1000 * gbit, 0.05, 64)
        rows.append((f"64 ranks, 3840x2160, {gbit} Gbit/s, by the model", f"{took:.2f} s a picture; {limit}", "stated"))
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin")
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--cache-dir")
    parser.add_argument("--link-size", default="640x360")
    parser.add_argument("--delays", default="0.1,1,5", help="ms, one way")
    parser.add_argument("--ranks", default="2,3,4")
    parser.add_argument("--rates", default="100,1000", help="Mbit/s")
    parser.add_argument("--results", metavar="FILE", help="add the rounds of links to those of FILE, of the same programs and machine, and print the table of all")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--only", default="speed,memory,bits,kills,many,links")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that networks and jobs are removed
    model = re.search("model name.*: (.*)", Path("/proc/cpuinfo").read_text())
    commit = subprocess.run(["git", "-C", Path(__file__).parent, "describe", "--always", "--dirty"], capture_output=True, text=True).stdout.strip()
    print(f"{time.strftime('%Y-%m-%d')}, commit {commit}, {CPUS} processors, {model[1] if model else 'unknown'}\n", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        jobs = Jobs(options, Path(folder))
        for part in options.only.split(","):
            rows = {"speed": speed, "memory": memory, "bits": bits, "links": links, "many": many, "kills": kills}[part](jobs)
            print("\n| what | measured | target |\n|---|---|---|")
            for what, measured, target in rows:
                print(f"| {what} | {measured} | {target} |", flush=True)


if __name__ == "__main__":
    main()
