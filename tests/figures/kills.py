"""What a job of ranks loses when one of them is killed at a random moment: part `kills` of ranks.py."""

import os
import random
import re
import signal
import socket
import subprocess
import time

import links as net

RANKS = 3
MODES = ((), ("--split-frames",), ("--collect",))


def children(pid):
    with open(f"/proc/{pid}/task/{pid}/children", encoding="ascii") as f:
        return list(map(int, f.read().split()))


def kill_one(launcher, chance):
    """Kills a random rank; returns it and how long the job took to end."""
    ranks = children(launcher.pid)
    victim = chance.choice(ranks) if ranks else 0
    if victim:
        os.kill(victim, signal.SIGKILL)
    start = time.monotonic()
    status = launcher.wait(60)
    return ranks.index(victim) if victim else None, time.monotonic() - start, status


def frames(jobs, kills, chance):
    """Jobs that write pictures, killed at any moment, also before the first; then resumed. Returns how many lost nothing."""
    work, count = jobs.work / "killed", 24
    work.mkdir()
    flags = ["--source", "sky:size=64x32,time=09:00,speed=5", "--size", "128x72", "--samples", "16", "--frames", f"0-{count - 1}"]
    render = str(jobs.bin / "relight-render")
    run = lambda *words: subprocess.run(words, env=net.environment(), capture_output=True, text=True, check=True)
    start = time.monotonic()
    run(render, *flags, "--out", str(work / "one.%02d.exr"))
    usual = time.monotonic() - start
    want = [(work / f"one.{k:02}.exr").read_bytes() for k in range(count)]
    good = 0
    for k in range(kills):
        for path in work.glob("many.*"):
            path.unlink()
        mode = MODES[k % len(MODES)]
        command = ["mpirun", "--oversubscribe", "-n", str(RANKS), render, *flags, *mode, "--out", str(work / "many.%02d.exr")]
        launcher = subprocess.Popen(command, env=net.environment(), stderr=subprocess.DEVNULL)
        time.sleep(chance.uniform(0.3, 0.5 + 1.2 * usual))
        _, _, status = kill_one(launcher, chance)
        kept = {path.name: path.read_bytes() for path in work.glob("many.*.exr")}
        whole = all(want[int(name[5:7])] == data for name, data in kept.items())
        log = run(*command, "--resume", "--stats", str(work / "stats.json")).stderr
        again = (work / "stats.json").read_text().count('"frame"') if len(kept) < count else 0
        said = re.search(r"(\d+) existing images are kept, (\d+) are new", log)
        complete = [(work / f"many.{n:02}.exr").read_bytes() for n in range(count)] == want
        fine = whole and complete and (not kept or said and (int(said[1]), int(said[2])) == (len(kept), count - len(kept))) \
            and again == count - len(kept) and (status != 0 or len(kept) == count)
        good += bool(fine)
        if not fine:
            print(f"kill {k}: {mode}, status {status}, {len(kept)} kept, whole {whole}, complete {complete}, {again} made again")
    return good


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def live(jobs, kills, chance):
    """Live jobs. Returns the longest times from a kill to the job's end, and from a restart to a viewer's first picture."""
    size, port, ended, back = jobs.options.link_size, free_port(), [], []
    jobs.compute_cache(size)
    command = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(RANKS), str(jobs.bin / "relightd"), *jobs.flags(size), "--port", str(port)]
    log = jobs.work / "killed.log"
    for k in range(kills + 1):
        start = time.monotonic()
        with open(log, "w", encoding="utf-8") as err:
            launcher = subprocess.Popen(command, env=net.environment(), stderr=err)
        while subprocess.run([str(jobs.bin / "relight-record"), "--from", f"ws://127.0.0.1:{port}", "--once", "--quiet", "--out",
                              str(jobs.work / "back.jpg")], stderr=subprocess.DEVNULL).returncode:
            if launcher.poll() is not None or time.monotonic() > start + 60:
                raise SystemExit(log.read_text())
            time.sleep(0.05)
        back.append(time.monotonic() - start)
        if k == kills:
            launcher.terminate()
            launcher.wait()
            break
        time.sleep(chance.uniform(0.0, 1.0))
        rank, took, status = kill_one(launcher, chance)
        ended.append(took)
        if status == 0 or f"rank {rank} with PID" not in log.read_text() or "exited on signal 9" not in log.read_text():
            raise SystemExit(f"killed rank {rank}, status {status}:\n{log.read_text()}")
    return max(ended), max(back)


def kills(jobs):
    chance, count = random.Random(25), jobs.options.kills
    good = frames(jobs, count, chance)
    ended, back = live(jobs, max(1, count // 4), chance)
    return [(f"random kills of a rank of {RANKS} after which nothing is lost or made twice", f"{good} of {count}", "20 of 20"),
            (f"live, {max(1, count // 4)} kills: from a kill to the job's end; from a restart to a viewer's image", f"at most {ended:.1f} s; {back:.1f} s",
             "2 s; 5 s")]
