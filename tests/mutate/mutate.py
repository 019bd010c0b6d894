"""mutate.py [ROOM...] [--seed N] [--count N] [--seconds N] [--least PERCENT] [--planted] [--list]

Makes COUNT small faults (mutants.py) in the C sources of each room, one at a time, and runs the unit tests of that room which
link what was changed, the cheapest first, until one fails. Prints the faults that none noticed, with file, line and
difference, and a table of all rooms. A fault that does not compile does not count; nor does one that equivalent.txt explains.
Builds these tests alone, in build/mutate, a copy of the tree, which is kept for the next run.

ROOM        a folder of server/, or `protocol` or `decoders`; without: all of the table below
--seed N    which faults are drawn (1); the same seed draws the same faults of lines that have not changed
--count N   how many a room (20)
--seconds N of tests for each fault, by their usual times (20, more in rooms whose tests take long)
--least P   exit 1 where fewer than P percent of a room's faults are noticed (without: the targets in the table below)
--planted   instead: the faults of planted.txt, each of which the unit tests of its own room must notice
--list      prints the faults that would be made
Exit: 0 all rooms meet their target, 1 one does not, 2 bad arguments or a tree that does not build."""

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import mutants

ROOT = Path(__file__).resolve().parents[2]
TREE = ROOT / "build/mutate/tree"
BUILD = TREE / "build"  # as in any clone, so that ccache knows the objects
TARGETS = {"env": 95, "brdf": 95, "film": 95, "estimators": 95, "protocol": 95, "decoders": 90, "transport": 90, "bounce": 90,
           "light": 95, "net": 90, "stream": 90}
SOURCES = {"protocol": ["protocol/*.c", "server/message/message_*.c", "server/stream/assembly.c", "server/stream/texels.c"],
           "decoders": ["server/codec/**/*.[ch]", "server/decoder/*.[ch]"]}
TESTS = {"protocol": ["message", "stream"], "decoders": ["codec", "decoder"]}
SECONDS = {"estimators": 90.0, "transport": 60.0, "light": 60.0, "bounce": 60.0}  # of tests for each fault, where they take long; else 20
AT_LEAST = 20.0  # seconds that a test may take before it counts as one that never ends; more where it usually takes more


def run(command, **options):
    return subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **options)


def copy_tree():
    """Copies what git knows, and what it would, where it differs, so that ninja builds only that again."""
    names = run(["git", "-C", ROOT, "ls-files", "-co", "--exclude-standard"]).stdout.split("\n")
    for name in filter(None, names):
        source, to = ROOT / name, TREE / name
        if source.is_file() and not (to.exists() and to.read_bytes() == source.read_bytes()):
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, to)
    for stale in (TREE / "server").rglob("*.[ch]"):
        if not (ROOT / stale.relative_to(TREE)).exists():
            stale.unlink()


def configure():
    os.environ.update(CCACHE_BASEDIR=str(TREE), CCACHE_NOHASHDIR="1")
    launcher = ["-DCMAKE_C_COMPILER_LAUNCHER=ccache"] if shutil.which("ccache") else []
    must(run(["cmake", "-S", TREE, "-B", BUILD, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-Wno-dev", *launcher]))


def must(done):
    if done.returncode:
        print(f"{done.stdout}\nthe tree does not build in {BUILD}")
        sys.exit(2)


class Claim:
    """One ctest of a unit test's program."""

    def __init__(self, test):
        properties = {p["name"]: p["value"] for p in test["properties"]}
        self.name, self.command = test["name"], test["command"]
        self.program = "bin/" + Path(self.command[0]).name
        self.room = self.name.split(".")[0]
        self.cost, self.folder = float(properties.get("COST", 0.1)), properties["WORKING_DIRECTORY"]
        self.environment = dict(v.split("=", 1) for v in properties.get("ENVIRONMENT", []) if "=" in v)
        self.usable = None  # whether it passes without a fault; None: not known yet
        self.noticed = {}  # of which files it has noticed how many faults

    def passes(self):
        try:
            done = subprocess.run(self.command, cwd=self.folder, env={**os.environ, **self.environment}, check=False,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
                                  timeout=max(AT_LEAST, 10.0 * self.cost)).returncode
        except subprocess.TimeoutExpired:
            done = -1
        return done in (0, 77)


def program_of(test):
    """room.test_file.claim -> the program's path."""
    room, file, _ = test["name"].split(".", 2)
    return f"bin/test_{room}_{file}"


def claims_of(rooms):
    """The unit tests of these rooms, whose programs are built: ctest knows the commands of those that are there."""
    def listed():
        tests = json.loads(run(["ctest", "--test-dir", BUILD, "--show-only=json-v1"]).stdout)["tests"]
        return [t for t in tests if t["name"].split(".")[0] in rooms and t["name"].count(".") == 2 and ".test_" in t["name"]]
    must(build(*sorted({program_of(t) for t in listed()})))
    return [Claim(t) for t in listed()]


def build(*targets):
    return run(["ninja", "-C", BUILD, *targets])


def inputs_of(claims):
    """Which files each program is made of."""
    return {p: {Path(line).resolve() if line.startswith("/") else line for line in run(["ninja", "-C", BUILD, "-t", "inputs", p]).stdout.split("\n")}
            for p in sorted({c.program for c in claims})}


class Suite:
    """The unit tests of a room."""

    def __init__(self, room):
        self.claims = claims_of(TESTS.get(room, [room]))
        self.inputs = inputs_of(self.claims)

    def order(self, path, seconds):
        """The claims that could notice a fault in `path`, within the seconds; first those that have noticed one in it."""
        source = (TREE / path).resolve()
        linked = [c for c in self.claims if c.usable is not False and (path.suffix == ".h" or source in self.inputs[c.program])]
        total = {}
        for c in linked:
            total[c.program] = total.get(c.program, 0.0) + c.cost
        out = []
        other = {c.program: f"_test_{path.stem}" not in c.program for c in linked}  # than of the file's own name
        for c in sorted(linked, key=lambda c: (c.cost > 1.0, other[c.program], total[c.program], c.program, c.cost, c.name)):
            if c.cost <= seconds:
                out.append(c)
                seconds -= c.cost
        return sorted(out, key=lambda c: -c.noticed.get(path, 0) / max(c.cost, 0.1))

    def usable(self, claim):
        """Whether it passes on the sources as they are."""
        if claim.usable is None:
            made = build(claim.program)
            if made.returncode:
                print(f"{made.stdout}\n{claim.program} does not build without a fault")
                sys.exit(2)
            claim.usable = claim.passes()
            if not claim.usable:
                print(f"not used, since it fails without a fault: {claim.name}")
        return claim.usable

    def noticed(self, path, mutant, claims):
        """The first claim that fails with the fault and passes without it, "" if there is none, None if it does not compile."""
        source, at = (TREE / path).read_text(encoding="utf-8"), 0
        while at < len(claims):
            failed, first, rest = None, claims[at].program, False
            (TREE / path).write_text(mutants.applied(source, mutant), encoding="utf-8")
            try:
                if build(first).returncode:
                    return None
                while at < len(claims) and failed is None:
                    c, at = claims[at], at + 1
                    if c.program != first and not rest:  # all at once, once the first has not noticed it
                        if build(*sorted({k.program for k in claims[at - 1:]})).returncode:
                            return None
                        rest = True
                    failed = None if c.usable is False or c.passes() else c
            finally:
                (TREE / path).write_text(source, encoding="utf-8")
            if failed and self.usable(failed):
                failed.noticed[path] = failed.noticed.get(path, 0) + 1
                return failed.name
        return ""


def sources_of(room):
    patterns = SOURCES.get(room, [f"server/{room}/**/*.[ch]"])
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


def draw(room, seed, count):
    """Faults of a room, in a random order: by a hash of each, so that a change elsewhere neither adds nor removes others."""
    every, lacks = [], lacking()
    for path in sources_of(room):
        source, seen = (TREE / path).read_text(encoding="utf-8"), {}
        for m in mutants.mutants_of(source, lacks):
            _, before, after = mutants.line_of(source, m)
            seen[before, after] = seen.get((before, after), 0) + 1  # a file may have the same line twice
            name = f"{seed} {path} {before} {after} {seen[before, after]}"
            every.append((hashlib.sha1(name.encode()).digest(), path, m))
    every = [(path, m) for _, path, m in sorted(every)]
    return every if count == 0 else every[:8 * count]  # some do not compile


def run_room(suite, room, a):
    """Prints the room's survivors. -> (killed, survived, explained, did not compile)"""
    known, tally = explained(), {"killed": 0, "survived": 0, "explained": 0, "invalid": 0}
    for path, mutant in draw(room, a.seed, a.count):
        if tally["killed"] + tally["survived"] + tally["explained"] >= a.count:
            break
        number, before, after = mutants.line_of((TREE / path).read_text(encoding="utf-8"), mutant)
        if a.list:
            print(f"{path}:{number}: {mutant.what}\n    - {before}\n    + {after}")
            tally["explained"] += 1
            continue
        if (str(path), before, after) in known:
            tally["explained"] += 1
            continue
        by = suite.noticed(path, mutant, suite.order(path, a.seconds or SECONDS.get(room, 20.0)))
        tally["invalid" if by is None else "killed" if by else "survived"] += 1
        if by == "":
            print(f"{path}:{number}: {mutant.what} was not noticed\n    - {before}\n    + {after}", flush=True)
        elif a.verbose and by:
            print(f"{path}:{number}: {mutant.what}, by {by}", flush=True)
    return tally


def planted():
    """Faults by name: `name`, `path`, `- part of the source`, `+ what is in its place`; -> how many were not noticed."""
    lines = (Path(__file__).with_name("planted.txt")).read_text(encoding="utf-8").split("\n")
    missed, suites = 0, {}
    for i, line in enumerate(lines[:-3]):
        if not lines[i + 1].startswith(("server/", "protocol/")):
            continue
        path, old, new = Path(lines[i + 1]), lines[i + 2][2:], lines[i + 3][2:]
        source = (TREE / path).read_text(encoding="utf-8")
        if source.count(old) != 1:
            print(f"{line}: {path} has {source.count(old)} times: {old}")
            missed += 1
            continue
        at, room = source.index(old), path.parts[1]
        suite = suites[room] = suites.get(room) or Suite(room)
        claims = [c for c in suite.order(path, 1e9) if c.cost < 5.0]
        by = suite.noticed(path, mutants.Mutant(at, at + len(old), new, line), claims)
        print(f"{line}: {'does not compile' if by is None else 'noticed by ' + by if by else 'NOT NOTICED'}", flush=True)
        missed += not by
    return missed


def arguments():
    p = argparse.ArgumentParser(usage=__doc__, add_help=True)
    p.add_argument("rooms", nargs="*")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--count", type=int, default=20)
    p.add_argument("--seconds", type=float)
    p.add_argument("--least", type=float)
    for flag in ("--planted", "--list", "--verbose"):
        p.add_argument(flag, action="store_true")
    a = p.parse_args()
    a.rooms = a.rooms or list(TARGETS)
    for room in a.rooms:
        if room not in SOURCES and not (ROOT / "server" / room).is_dir():
            p.error(f"there is no room {room}; rooms are the folders of server/, protocol, and decoders")
    return a


def main():
    a = arguments()
    copy_tree()
    if not a.list:
        configure()
    if a.planted:
        sys.exit(1 if planted() else 0)
    rows, low = [], False
    for room in a.rooms:
        t = run_room(None if a.list else Suite(room), room, a)
        made = t["killed"] + t["survived"]
        rate = 100.0 * t["killed"] / made if made else 100.0
        low = low or rate < (TARGETS.get(room, 90) if a.least is None else a.least)
        rows.append(f"| `{room}` | {made + t['explained']} | {t['killed']} | {t['explained']} | {t['survived']} | {rate:.0f} % |")
        if a.verbose:
            print(rows[-1], flush=True)
    if not a.list:
        print("| room | faults | noticed | change nothing | not noticed | rate |\n|---|---|---|---|---|---|", *rows, sep="\n")
    sys.exit(1 if low and not a.list else 0)


if __name__ == "__main__":
    main()
