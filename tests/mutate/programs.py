"""Test programs with a fault in them, made without touching the build folder: the changed file is compiled on its own, and its
objects are linked in front of the libraries that hold the ones without the fault. So any number of workers share one build."""

import hashlib
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
from pathlib import Path

AT_LEAST = 20.0  # seconds of processor time that a test may take before it counts as one that never ends; more where it usually takes more
WALL = 6.0  # times as many by the clock, since others may use the processors


def run(command, **options):
    return subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **options)


class Claim:
    """One ctest of a unit test's program."""

    def __init__(self, test):
        properties = {p["name"]: p["value"] for p in test["properties"]}
        self.name, self.command = test["name"], test["command"]
        self.program = "bin/" + Path(self.command[0]).name
        self.room, self.file, _ = self.name.split(".", 2)
        self.cost, self.folder = float(properties.get("COST", 0.1)), properties["WORKING_DIRECTORY"]
        self.environment = dict(v.split("=", 1) for v in properties.get("ENVIRONMENT", []) if "=" in v)
        self.noticed = {}  # of which files it has noticed how many faults

    def passes(self, folder):
        """Whether the program of that name in `folder` passes it."""
        limit = int(max(AT_LEAST, 10.0 * self.cost))
        most = resource.getrlimit(resource.RLIMIT_CPU)[1]  # as it is: confined programs set limits of their own
        environment = {**os.environ, **self.environment}
        environment.pop("RELIGHT_LONG", None)  # few seeds notice as much
        try:
            done = subprocess.run([str(folder / self.program), *self.command[1:]], cwd=self.folder, env=environment, check=False,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
                                  preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit, most)),
                                  timeout=WALL * limit).returncode
        except subprocess.TimeoutExpired:
            done = -1
        return done in (0, 77)


class Programs:
    """How the build folder's programs are made."""

    def __init__(self, tree, build):
        self.tree, self.build = tree, build
        self.compilers = {}  # object -> its source and command
        for c in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
            words = shlex.split(c["command"])
            self.compilers[words[words.index("-o") + 1]] = (c["file"], words)
        self.links, self.made_of = {}, {}
        for line in run(["ninja", "-C", build, "-t", "deps"]).stdout.split("\n"):
            if line and not line.startswith(" "):
                name = line.split(": #deps")[0]
            elif line.startswith("    "):
                path = os.path.normpath(build / line.strip())  # which ccache makes relative
                self.made_of.setdefault(path, set()).add(name)

    def ninja(self, *arguments):
        return run(["ninja", "-C", self.build, *arguments]).stdout.split("\n")

    def add(self, *programs):
        """Learns how programs that have been built are linked; what they start is learnt too."""
        new = [p for p in programs if p not in self.links]
        if not new:
            return
        lines = {}  # what makes a program or a library
        for line in self.ninja("-t", "commands", *new):
            for made in re.findall(r" -o (bin/\S+) | qc (\S+\.a) ", line):
                lines[made[0] or made[1]] = shlex.split(line.removeprefix(": && ").removesuffix(" && :"))
        for program in new:
            words = lines[program]
            objects = {w for w in words if w.endswith(".o")}
            for archive in (w for w in words if w in lines and w.endswith(".a")):
                objects |= {w for w in lines[archive] if w.endswith(".o")}
            starts = [p for p in self.ninja("-t", "inputs", program) if p.startswith("bin/")]
            self.links[program] = (words, objects, starts)
            self.add(*starts)

    def objects_of(self, path):
        """What is compiled from a file, in any program."""
        return self.made_of.get(str(self.tree / path), set())

    def holds(self, program, path):
        """Whether the file is in the program, or in one that it starts."""
        _, objects, starts = self.links[program]
        return bool(objects & self.objects_of(path)) or any(self.holds(p, path) for p in starts)

    def fault(self, path, text, folder, needed):
        """`path` with `text` instead, compiled for the programs `needed`; None if it does not compile."""
        wanted = set().union(*(self.links[q][1] for p in needed for q in (p, *self.links[p][2]))) & self.objects_of(path)
        if not wanted:
            raise ValueError(f"{path} is in none of {sorted(needed)}")
        f = Fault(self, path, folder)
        (folder / path).parent.mkdir(parents=True)
        (folder / path).write_text(text, encoding="utf-8")
        for o in sorted(wanted):
            if not f.compile(o):
                return None
        return f


class Fault:
    """Programs in a folder of their own; none differs until something is compiled."""

    def __init__(self, programs, path, folder):
        self.programs, self.path, self.folder, self.objects = programs, path, folder, {}
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "bin").mkdir(parents=True)
        (folder / "share").symlink_to(programs.build / "share")  # the page, which programs find beside their folder

    def compile(self, o):
        source, words = self.programs.compilers[o]
        to = self.folder / o.replace("/", "+")
        changed = str(self.folder / self.path) if Path(source) == self.programs.tree / self.path else source
        words = [changed if w == source else str(to) if w == o else w for w in words]
        before = [f"-I{self.folder}/server", f"-I{self.folder}", "-iquote", str(Path(source).parent), f"-fmacro-prefix-map={self.folder}/="]
        made = run([words[0], *before, *words[1:]], cwd=self.programs.build)
        self.objects[o] = to
        return made.returncode == 0

    def code(self):
        """A hash of all objects."""
        out = hashlib.sha1()
        for o in sorted(self.objects):
            out.update(self.objects[o].read_bytes())
        return out.hexdigest()

    def link(self, program):
        """Makes the program, and those that it starts, in the folder's bin."""
        words, objects, starts = self.programs.links[program]
        for p in starts:
            if not (self.folder / p).exists() and not self.link(p):
                return False
        for p in (self.programs.build / "bin").iterdir():  # what else it may start
            if not p.name.startswith("test") and not (self.folder / "bin" / p.name).exists() and f"bin/{p.name}" != program:
                os.link(p, self.folder / "bin" / p.name)
        changed = {o: str(to) for o, to in self.objects.items() if o in objects}
        if not changed:
            os.link(self.programs.build / program, self.folder / program)  # it finds what it starts beside it
            return True
        own = [changed.get(w, str(self.folder / program) if w == program else w) for w in words]
        at = own.index("-o")
        inside = [to for o, to in sorted(changed.items()) if o not in words]
        return run([*own[:at], *inside, *own[at:]], cwd=self.programs.build).returncode == 0
