"""mutate.py [ROOM...] [--seed N] [--count N] [--seconds N] [--least PERCENT] [--workers N] [--resume] [--for SECONDS] [--planted] [--list]

Makes COUNT small faults (mutants.py) in the C sources of each room, one at a time, and runs the unit tests of that room which
link what was changed, the cheapest first, until one fails. Prints the faults that none noticed, with file, line and
difference, and a table of all rooms. A fault that does not compile does not count; one that leaves the object code as it is
changes nothing, and so does one that equivalent.txt explains. Builds these tests alone, in build/mutate, a copy of the tree,
which is kept for the next run. Appends what it finds to build/mutate/results.txt.

ROOM        a room of server/ by its last name (tables for sky/tables), or `protocol` or `decoders`; without: all of ROOMS below
--seed N    which faults are drawn (1), or `week`: year and number of this week, so that faults that nobody has seen are drawn; the
            same seed draws the same faults of lines that have not changed
--count N   how many a room (28)
--seconds N of tests for each fault, by their usual times (20, more in rooms whose tests take long)
--least P   exit 1 if fewer than P percent of all rooms' faults together are noticed (60)
--workers N faults at a time (as many as processors)
--resume    takes from build/mutate/results.txt what is known of faults in files that have not changed: of those noticed, while
            the test's function has not changed either; of survivors, while no test of the room has, and with as many seconds
--for N     begins no fault after so many seconds; exit 3 if any is left, for --resume
--planted   instead: the faults of planted.txt, each of which the unit tests of its own room must notice
--list      prints the faults that would be made
Exit: 0 as many as --least were noticed, 1 fewer, 2 bad arguments or a tree that does not build, 3 not finished."""

import argparse
import collections
import concurrent.futures
import datetime
import hashlib
import json
import os
import re
import resource
import shutil
import sys
import threading
import time
from pathlib import Path

import mutants
from programs import Claim, Fault, Programs, run

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "build/mutate"
RESULTS = WORK / "results.txt"
TREE = WORK / "tree"
BUILD = TREE / "build"  # as in any clone, so that ccache knows the objects
FOLDERS = {f.rpartition("/")[2]: f for f in (line.split("|")[0].strip() for line in (ROOT / "server/rooms.txt").read_text().split("\n")) if f and f[0] != "#"}
ROOMS = ["tables", "surface", "film", "estimators", "protocol", "decoders", "cache_direct", "cache_indirect", "frame", "access", "stream"]
SOURCES = {"protocol": ["protocol/*.c", "server/net/message/message_*.c", "server/net/stream/assembly.c", "server/net/stream/texels.c"],
           "decoders": ["server/image/codec/**/*.[ch]", "server/import/decoder/*.[ch]"],
           "frame": ["server/light/frame/*.[ch]", "server/light/resolve/*.[ch]"]}
TESTS = {"protocol": ["message", "stream"], "decoders": ["codec", "decoder"], "frame": ["frame", "resolve"]}
SECONDS = {"estimators": 60.0, "cache_direct": 60.0, "frame": 60.0, "cache_indirect": 60.0, "stream": 60.0}  # of tests for each fault, where they take long; else 20


def copy_tree():
    """Copies what git knows, and what it would, where it differs, so that ninja builds only that again. -> whether any did"""
    differ = False
    names = run(["git", "-C", ROOT, "ls-files", "-co", "--exclude-standard"]).stdout.split("\n")
    for name in filter(None, names):
        source, to = ROOT / name, TREE / name
        if source.is_file() and not (to.exists() and to.read_bytes() == source.read_bytes()):
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, to)
            differ = True
    for stale in (TREE / "server").rglob("*.[ch]"):
        if not (ROOT / stale.relative_to(TREE)).exists():
            stale.unlink()
            differ = True
    return differ


def configure():
    os.environ.update(CCACHE_BASEDIR=str(TREE), CCACHE_NOHASHDIR="1")
    launcher = ["-DCMAKE_C_COMPILER_LAUNCHER=ccache"] if shutil.which("ccache") else []
    must(run(["cmake", "-S", TREE, "-B", BUILD, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-Wno-dev", *launcher]))


def must(done):
    if done.returncode:
        print(f"{done.stdout}\nthe tree does not build in {BUILD}")
        sys.exit(2)


def program_of(test):
    """room.test_file.claim -> the program's path."""
    room, file, _ = test["name"].split(".", 2)
    return f"bin/test_{room}_{file}"


def claims_of(rooms):
    """room -> the unit tests of each of these rooms, whose programs are built: ctest knows the commands of those that are there."""
    def listed():
        tests = json.loads(run(["ctest", "--test-dir", BUILD, "--show-only=json-v1"]).stdout)["tests"]
        return [t for t in tests if t["name"].split(".")[0] in every and t["name"].count(".") == 2 and ".test_" in t["name"]]
    every = {name for room in rooms for name in TESTS.get(room, [room])}
    must(build(*sorted({program_of(t) for t in listed()})))
    claims = [Claim(t) for t in listed()]
    return {room: [c for c in claims if c.room in TESTS.get(room, [room])] for room in rooms}


def build(*targets):
    return run(["ninja", "-C", BUILD, *targets])


class Suite:
    """The unit tests of a room."""

    def __init__(self, room, programs, claims):
        self.room, self.programs, self.claims = room, programs, claims
        self.sound, self.plain, self.lock = {}, {}, threading.Lock()
        programs.add(*sorted({c.program for c in self.claims}))

    def order(self, path, seconds):
        """The claims that could notice a fault in `path`, within the seconds: those that have noticed one in it, then those of
        its own name, then the cheapest."""
        linked = [c for c in self.claims if self.programs.holds(c.program, path)]
        total = {}
        for c in linked:
            total[c.program] = total.get(c.program, 0.0) + c.cost
        out = []
        for c in sorted(linked, key=lambda c: (not self.is_named(c, path), c.cost > 1.0, total[c.program], c.program, c.cost, c.name)):
            if c.cost <= seconds:
                out.append(c)
                seconds -= c.cost
        return sorted(out, key=lambda c: -c.noticed.get(path, 0) / max(c.cost, 0.1))

    @staticmethod
    def is_named(claim, path):
        """Whether the test, test_pilot, is that of pilot.c or pilot_choose.c."""
        name = claim.file.removeprefix("test_")
        return path.stem == name or path.stem.startswith(name + "_") or name.startswith(path.stem + "_")

    def usable(self, claim):
        """Whether it passes on the sources as they are, in a folder like those of faults."""
        with self.lock:
            if claim.name not in self.sound:
                same = Fault(self.programs, None, WORK / f"worker{os.getpid()}.same")
                self.sound[claim.name] = same.link(claim.program) and claim.passes(same.folder)
                shutil.rmtree(same.folder, ignore_errors=True)
                if not self.sound[claim.name]:
                    print(f"not used, since it fails without a fault: {claim.name}", flush=True)
            return self.sound[claim.name]

    def code_without(self, path, folder, needed):
        """What Fault.code() is without a fault."""
        with self.lock:
            if path not in self.plain:
                same = self.programs.fault(path, (TREE / path).read_text(encoding="utf-8"), folder, needed)
                self.plain[path] = same.code() if same else ""
            return self.plain[path]

    def judge(self, path, mutant, claims, folder):
        """"invalid", "same" if the code does not change, the first claim that fails with the fault only, or "survived"."""
        needed = {c.program for c in self.claims if self.programs.holds(c.program, path)}
        if not needed:
            return "survived"
        without = self.code_without(path, folder, needed)
        fault = self.programs.fault(path, mutants.applied((TREE / path).read_text(encoding="utf-8"), mutant), folder, needed)
        if not fault:
            return "invalid"
        if fault.code() == without:
            return "same"
        linked = {}
        for c in claims:
            if c.program not in linked:
                linked[c.program] = fault.link(c.program)
            # Others compute beside this, for whom a test may have to wait too long once.
            if linked[c.program] and not c.passes(folder) and self.usable(c) and not c.passes(folder):
                return c.name
        return "survived"


def sources_of(room):
    patterns = SOURCES.get(room, [f"server/{FOLDERS[room]}/**/*.[ch]"])
    return sorted(p.relative_to(TREE) for pattern in patterns for p in TREE.glob(pattern))


def explained():
    """(path, line before, line after) of faults that change nothing, by equivalent.txt."""
    lines = (Path(__file__).with_name("equivalent.txt")).read_text(encoding="utf-8").split("\n")
    blocks = [lines[i:i + 4] for i, line in enumerate(lines) if line.startswith("server/") or line.startswith("protocol/")]
    return {(b[0].strip(), b[1][1:].strip(), b[2][1:].strip()) for b in blocks}


def lacking():
    """Macros of the instruction sets that this processor does not have: no test here runs what is compiled for them."""
    flags = set(re.search(r"^flags\s*:(.*)", Path("/proc/cpuinfo").read_text(encoding="ascii"), re.M)[1].split())
    return [macro for macro, flag in (("__AVX512F__", "avx512f"), ("__AVX2__", "avx2")) if flag not in flags]


def room_of(path):
    return next(room for room, folder in FOLDERS.items() if str(path).startswith(f"server/{folder}/"))


def draw(room, seed, count):
    """Faults of a room, in a random order: by a hash of each, so that a change elsewhere neither adds nor removes others.
    With each, a key that is the same for all seeds."""
    every, lacks = [], lacking()
    for path in sources_of(room):
        source, seen = (TREE / path).read_text(encoding="utf-8"), {}
        for m in mutants.mutants_of(source, lacks):
            _, before, after = mutants.line_of(source, m)
            seen[before, after] = seen.get((before, after), 0) + 1  # a file may have the same line twice
            name = f"{seed} {path} {before} {after} {seen[before, after]}"
            every.append((hashlib.sha1(name.encode()).digest(), path, m, hashlib.sha1(name.split(" ", 1)[1].encode()).hexdigest()))
    every = [(path, m, key) for _, path, m, key in sorted(every)]
    return every if count == 0 else every[:8 * count]  # some do not compile


def text_of(claim):
    """The test's function."""
    text = (TREE / f"tests/unit/{FOLDERS.get(claim.room, claim.room)}/{claim.file}.c").read_text(encoding="utf-8")
    return re.search(rf"^static void {claim.name.split('.')[2]}\(.*?^}}", text, re.M | re.S)[0]


class Memory:
    """What build/mutate/results.txt says, one JSON object a line."""

    def __init__(self, suite, resume, commit, seconds):
        self.suite, self.commit, self.seconds, self.known = suite, commit, seconds, {}
        self.judged, self.used = 0, []  # how many anew, and the commits of what is known
        self.tests = {c.name: hashlib.sha1(text_of(c).encode()).hexdigest() for c in suite.claims}
        self.every = self.hash_of(sorted({p for c in suite.claims for p in (TREE / f"tests/unit/{FOLDERS.get(c.room, c.room)}").iterdir()}))
        lines = RESULTS.read_text(encoding="utf-8").split("\n") if resume and RESULTS.exists() else []
        by_name = {c.name: c for c in suite.claims}
        for r in map(json.loads, filter(None, lines)):
            if r["room"] == suite.room and r["source"] == self.hash_of([TREE / r["path"]]):
                claim = by_name.get(r["by"])
                if claim:
                    claim.noticed[Path(r["path"])] = claim.noticed.get(Path(r["path"]), 0) + 1
                if r["by"] == "survived" and r.get("seconds", 0.0) < seconds:
                    continue
                if r["by"] == "invalid" or r["by"] == "same" or r["tests"] == (self.tests[claim.name] if claim else self.every):
                    self.known[r["path"], r["key"]] = (r["by"], r["commit"])

    @staticmethod
    def hash_of(paths):
        return hashlib.sha1(b"".join(p.read_bytes() for p in paths if p.is_file())).hexdigest()

    def write(self, path, key, text, by):
        claim = next((c for c in self.suite.claims if c.name == by), None)
        if claim:
            claim.noticed[path] = claim.noticed.get(path, 0) + 1
        r = {"room": self.suite.room, "path": str(path), "key": key, "by": by, "source": self.hash_of([TREE / path]),
             "tests": self.tests[claim.name] if claim else self.every, "commit": self.commit, "seconds": self.seconds,
             "date": datetime.date.today().isoformat(), "fault": text}
        with RESULTS.open("a", encoding="utf-8") as f:
            f.write(json.dumps(r) + "\n")


def clear_workers():
    """Removes what killed runs have left."""
    for folder in WORK.glob("worker*"):
        if not Path("/proc", folder.name.removeprefix("worker").split(".")[0]).exists():
            shutil.rmtree(folder, ignore_errors=True)


def judged(suite, a, until, known, memory):
    """Yields (path, its source, mutant, verdict) in the order drawn, `workers` at a time; None where time is up."""
    folders = [WORK / f"worker{os.getpid()}.{i}" for i in range(a.workers)]

    def one(path, source, mutant, key):
        _, before, after = mutants.line_of(source, mutant)
        if (str(path), before, after) in known:
            return "explained"
        if (str(path), key) in memory.known:
            by, commit = memory.known[str(path), key]
            memory.used.append(commit)
            return by
        if time.monotonic() > until:
            return None
        folder = folders.pop()
        by = suite.judge(path, mutant, suite.order(path, memory.seconds), folder)
        folders.append(folder)
        memory.write(path, key, f"{before}\n{after}", by)
        memory.judged += 1
        memory.used.append(memory.commit)
        return by

    with concurrent.futures.ThreadPoolExecutor(a.workers) as pool:
        waiting, rest = collections.deque(), iter(draw(suite.room, a.seed, a.count))
        try:
            while True:
                while len(waiting) < 2 * a.workers and (nxt := next(rest, None)):
                    source = (TREE / nxt[0]).read_text(encoding="utf-8")
                    waiting.append((nxt[0], source, nxt[1], pool.submit(one, nxt[0], source, nxt[1], nxt[2])))
                if not waiting:
                    return
                path, source, mutant, future = waiting.popleft()
                yield path, source, mutant, future.result()
        finally:
            pool.shutdown(cancel_futures=True)
            for folder in folders:
                shutil.rmtree(folder, ignore_errors=True)


def run_room(suite, a, until, memory):
    """Prints the room's survivors. -> how many of each kind"""
    tally = {"killed": 0, "survived": 0, "explained": 0, "same": 0, "invalid": 0, "left": 0}
    for path, source, mutant, by in judged(suite, a, until, explained(), memory):
        kind = "left" if by is None else by if by in tally else "killed"
        tally[kind] += 1
        number, before, after = mutants.line_of(source, mutant)
        if kind == "survived":
            print(f"{path}:{number}: {mutant.what} was not noticed\n    - {before}\n    + {after}", flush=True)
        elif a.verbose and kind != "invalid":
            print(f"{path}:{number}: {mutant.what}, {by}", flush=True)
        if kind == "left" or sum(tally[k] for k in ("killed", "survived", "explained", "same")) >= a.count > 0:
            break
    return tally


def list_faults(rooms, a):
    for room in rooms:
        for path, mutant, _ in draw(room, a.seed, a.count)[:a.count or None]:
            number, before, after = mutants.line_of((TREE / path).read_text(encoding="utf-8"), mutant)
            print(f"{path}:{number}: {mutant.what}\n    - {before}\n    + {after}")


def planted():
    """Faults by name: `name`, `path`, `- part of the source`, `+ what is in its place`; -> how many were not noticed."""
    lines = (Path(__file__).with_name("planted.txt")).read_text(encoding="utf-8").split("\n")
    faults = [(line, Path(lines[i + 1]), lines[i + 2][2:], lines[i + 3][2:]) for i, line in enumerate(lines[:-3])
              if lines[i + 1].startswith(("server/", "protocol/"))]
    claims = claims_of(sorted({room_of(path) for _, path, _, _ in faults}))
    programs, folder, missed = Programs(TREE, BUILD), WORK / f"worker{os.getpid()}", 0
    suites = {room: Suite(room, programs, claims[room]) for room in claims}
    for line, path, old, new in faults:
        source, suite = (TREE / path).read_text(encoding="utf-8"), suites[room_of(path)]
        if source.count(old) != 1:
            print(f"{line}: {path} has {source.count(old)} times: {old}")
            missed += 1
            continue
        at = source.index(old)
        quick = [c for c in suite.order(path, 1e9) if c.cost < 5.0]
        by = suite.judge(path, mutants.Mutant(at, at + len(old), new, line), quick, folder)
        found = by not in ("invalid", "same", "survived")
        print(f"{line}: {'noticed by ' if found else 'NOT NOTICED: '}{by}", flush=True)
        missed += not found
    shutil.rmtree(folder, ignore_errors=True)
    return missed


def arguments():
    p = argparse.ArgumentParser(usage=__doc__, add_help=True)
    p.add_argument("rooms", nargs="*")
    p.add_argument("--seed", type=lambda s: int("".join(f"{k:02}" for k in datetime.date.today().isocalendar()[:2])) if s == "week" else int(s),
                   default=1)
    p.add_argument("--count", type=int, default=28)
    p.add_argument("--seconds", type=float)
    p.add_argument("--least", type=float, default=60.0)
    p.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    p.add_argument("--for", type=float, dest="most", default=1e9)
    for flag in ("--planted", "--list", "--verbose", "--resume"):
        p.add_argument(flag, action="store_true")
    a = p.parse_args()
    a.rooms = a.rooms or ROOMS
    for room in a.rooms:
        if room not in SOURCES and room not in FOLDERS:
            p.error(f"there is no room {room}; rooms are the last names in server/rooms.txt, protocol, and decoders")
    return a


def processor():
    return re.search(r"^model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text(encoding="ascii"), re.M)[1]


def main():
    a = arguments()
    until = time.monotonic() + a.most
    clear_workers()
    differ = copy_tree()
    if a.list:
        sys.exit(list_faults(a.rooms, a))
    if differ or not (BUILD / "CTestTestfile.cmake").exists():  # the tests of a changed file are other ones
        configure()
    if a.planted:
        sys.exit(1 if planted() else 0)
    commit = run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"]).stdout.strip()
    print(f"seed {a.seed}; again with --seed {a.seed}", flush=True)
    rows, noticed, counted, left, judged_now = [], 0, 0, False, 0
    claims = claims_of(a.rooms)
    programs = Programs(TREE, BUILD)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for room in a.rooms:
        memory = Memory(Suite(room, programs, claims[room]), a.resume, commit, a.seconds or SECONDS.get(room, 20.0))
        t = run_room(memory.suite, a, until, memory)
        made = t["killed"] + t["survived"]
        rate = 100.0 * t["killed"] / made if made else 100.0
        noticed, counted, left = noticed + t["killed"], counted + made, left or t["left"] > 0
        judged_now += memory.judged
        rows.append(f"| `{room}` | {commits(memory.used)} | {made + t['explained'] + t['same']} | {t['killed']} |"
                    f" {t['explained'] + t['same']} | {t['survived']} | {rate:.0f} % |{' not finished' if t['left'] else ''}")
        if a.verbose:
            print(rows[-1], flush=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{datetime.date.today()}, {processor()}, {len(os.sched_getaffinity(0))} processors, seed {a.seed};"
          f" {judged_now} faults judged now, those that do not compile among them, in {seconds:.0f} s of processor time",
          "| room | commits | faults | noticed | change nothing | not noticed | rate |\n|---|---|---|---|---|---|---|", *rows, sep="\n")
    sys.exit(3 if left else 1 if 100.0 * noticed < a.least * counted else 0)


def commits(used):
    """The first and the last of them in the order of history."""
    known = run(["git", "-C", ROOT, "rev-list", "--abbrev-commit", "HEAD"]).stdout.split()
    at = sorted(known.index(c) for c in set(used) if c in known)
    return "" if not at else known[at[0]] if len(at) == 1 else f"{known[at[-1]]} to {known[at[0]]}"


if __name__ == "__main__":
    main()
