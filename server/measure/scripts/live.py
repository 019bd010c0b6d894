#!/usr/bin/python3
"""relight-bench --live and --first-minute: what a viewer of relightd gets while the sky moves. relight-bench starts this
script; docs/internals/performance.md says how to read what it prints."""

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile

import first_minute
import truth
import viewer
from relightd import STOPPING, Failure, end_all
from serve import processor

SCENES = {"court": None, "house": "house.py:house.glb", "ring": "ring.json", "product": "product.py:product.json", "room": "room.py:room.*"}
SOURCES = {**{str(hour): f"sky:hour={hour},speed=0.25" for hour in (9, 12, 17)}, "clouds": "proof.py"}
CLOUDS = "48"  # images of the sequence, which starts again after the last
FIRST_SOURCES = {"minute": "sky:hour=10,speed=1", "calm": "sky:hour=10,speed=0.25"}


def programs_folder():
    """Of relight-render and the others: beside this folder, or the package's."""
    here = os.path.dirname(os.path.abspath(sys.argv[0]))
    for folder in (os.path.dirname(here), os.path.join(here, "../../../bin")):
        if os.access(os.path.join(folder, "relight-render"), os.X_OK):
            return os.path.normpath(folder)
    raise Failure(f"relight-render was not found beside {here}")


def examples_folder():
    here = os.path.dirname(os.path.realpath(__file__))
    for folder in ("../../../docs/examples", "../../../share/doc/relightd/examples/examples", "../../../share/doc/relightd/examples"):
        if os.path.exists(os.path.join(here, folder, "house.py")):
            return os.path.normpath(os.path.join(here, folder))
    return ""


def say(text):
    print("relight-bench: " + text, file=sys.stderr, flush=True)


class Inputs:
    """Scenes and sources by their titles. Those that a script of the examples writes are kept in `folder`."""

    def __init__(self, folder, first_minute):
        self.folder, self.examples = folder, examples_folder()
        self.first_minute = first_minute

    def made(self, script, *arguments):
        """The folder of what an example's script writes; None: there is no such script."""
        path = os.path.join(self.examples, script)
        if not self.examples or not os.path.exists(path):
            return None
        with open(path, "rb") as file:
            key = hashlib.sha256(file.read() + " ".join(arguments).encode()).hexdigest()[:12]
        folder = os.path.join(self.folder, f"{os.path.splitext(script)[0]}-{key}")
        if not os.path.isdir(folder):
            os.makedirs(self.folder, exist_ok=True)
            say(f"{script} writes its files")
            with tempfile.TemporaryDirectory(dir=self.folder) as part:
                whole = os.path.join(part, "whole")
                os.mkdir(whole)
                done = subprocess.run([sys.executable, path, whole, *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                      stderr=subprocess.PIPE, text=True, check=False)
                if done.returncode:
                    raise Failure(f"{script}: {done.stderr.strip()[-200:]}")
                os.rename(whole, folder)
        return folder

    def scene(self, title, name):
        """A path, or None for the built-in scene; raises LookupError where this installation lacks it."""
        known = SCENES.get(name, name)
        if known is None or name == "builtin":
            return None
        script, _, wanted = known.partition(":")
        if name in SCENES and script.endswith(".py"):
            folder = self.made(script)
            found = [f for f in sorted(os.listdir(folder)) if re.fullmatch(wanted.replace(".", r"\.").replace("*", "(glb|json)"), f)] \
                if folder else []
            if not found:
                raise LookupError(f"{title} is left out: there is no {script} in this installation")
            return os.path.join(folder, found[0])
        return os.path.join(self.examples, known) if name in SCENES else name

    def source(self, title, name):
        known = (FIRST_SOURCES if self.first_minute else SOURCES).get(name, name)
        if known != "proof.py":
            return known
        path = os.path.join(self.examples, known)
        if self.examples and os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                if "--clouds" in file.read():
                    return os.path.join(self.made(known, "--clouds", CLOUDS), "clouds.%04d.exr")
        raise LookupError(f"{title} is left out: there is no proof.py with --clouds in this installation")


def titled(text):
    """"A=x;B" as [("A", "x"), ("B", "B")]; names of files get their last part as title."""
    out = []
    for item in filter(None, text.split(";")):
        title, equals, name = item.partition("=")
        if not equals or ":" in title or "/" in title:
            title, name = os.path.splitext(os.path.basename(item))[0] if "/" in item else item, item
        out.append((title, name))
    return out


def read_arguments(arguments):
    moving = "--first-minute" in arguments
    p = argparse.ArgumentParser(prog="relight-bench --first-minute" if moving else "relight-bench --live", allow_abbrev=False,
                                description="How the error of live images falls while the cache is computed, under a moving sky."
                                if moving else "What a viewer of relightd gets, under a moving sky.")
    p.add_argument("--first-minute" if moving else "--live", action="store_true", help="this")
    p.add_argument("--scenes", default="court;house;ring;product;room", metavar="LIST",
                   help="court, house, ring, product, room, scene files or builtin, separated by ;  TITLE=FILE gives one a title")
    p.add_argument("--sources", default="minute;calm" if moving else "9;12;17;clouds", metavar="LIST",
                   help="minute, calm (a minute, 15 s of sky per image)" if moving else
                   "9, 12, 17 (a computed sky, 15 s per image, from that hour on), clouds, or sources, separated by ;  TITLE=SOURCE")
    p.add_argument("--size", metavar="WxH", help="of the images [640x360" + ("]" if moving else "; the court under 12 also 1280x720]"))
    p.add_argument("--seconds", type=float, default=60.0 if moving else 20.0, help="of measuring, per row [%(default)s]")
    p.add_argument("--patience", type=float, default=300.0, metavar="S", help="for a cache to be complete, seconds [%(default)s]")
    p.add_argument("--references", metavar="DIR", help="folder that keeps converged images [~/.cache/relightd/references]")
    p.add_argument("--reference-samples", type=int, default=32, metavar="N", help="paths per pixel of each of two halves [%(default)s]")
    p.add_argument("--quick", action="store_true", help="one scene and source at 320x180, in about a minute")
    p.add_argument("--json", nargs="?", const="-", metavar="FILE", help="write JSON: to a file, or to standard output instead of the table")
    p.add_argument("--port", type=int, default=0, help="of relightd; 0: any free one [0]")
    p.add_argument("--cpu", metavar="LEVEL", help="instruction set of relightd: v3, v4 or baseline")
    p.add_argument("--threads", metavar="N", help="threads of relightd")
    p.add_argument("--cache-memory", metavar="MB", help="maximum memory of its cache")
    out = p.parse_args(arguments)
    out.first_minute = moving
    if out.size and not re.fullmatch(r"[1-9][0-9]*x[1-9][0-9]*", out.size):
        p.error(f"--size {out.size}: expected WIDTHxHEIGHT")
    if out.seconds <= 0 or out.patience < 0 or out.reference_samples < 1:
        p.error("--seconds, --patience and --reference-samples: expected positive numbers")
    out.sizes = [out.size] if out.size else ["320x180"] if out.quick else ["640x360", "1280x720"]
    if out.quick:
        out.scenes, out.sources = out.scenes.split(";")[0], out.sources.split(";")[0] if moving or "--sources" in arguments else "12"
        out.seconds = min(out.seconds, 15.0)
    return out


def pass_on(arguments):
    """Flags for relightd."""
    out = []
    for flag, value in (("--cpu", arguments.cpu), ("--threads", arguments.threads), ("--cache-memory", arguments.cache_memory)):
        out += [flag, value] if value else []
    return out


def machine():
    return {"cpu": processor(), "processors": len(os.sched_getaffinity(0)), "load": os.getloadavg()[0]}


def check_port(port):
    """Before any scene is made: relightd would say the same."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as fault:
            raise Failure(f"port {port} of 127.0.0.1: {fault.strerror}; --port 0 takes any free one") from None


def stop(number, _):
    raise SystemExit(128 + number)


def main():
    arguments = read_arguments(sys.argv[1:])
    for number in STOPPING:
        signal.signal(number, stop)
    folder = tempfile.mkdtemp(prefix="relight-bench-")
    try:
        check_port(arguments.port)
        references = arguments.references or os.path.expanduser(os.path.join(
            os.environ.get("XDG_CACHE_HOME") or "~/.cache", "relightd/references"))
        bench = argparse.Namespace(
            programs=truth.Programs(programs_folder()), folder=folder, references=references, arguments=arguments,
            inputs=Inputs(os.path.join(references, "examples"), arguments.first_minute), flags=pass_on(arguments), say=say,
            scenes=titled(arguments.scenes), sources=titled(arguments.sources))
        module = first_minute if arguments.first_minute else viewer
        report = {"machine": machine(), "version": bench.programs.run("relight-render", "--version").strip(), "rows": []}
        for row in module.rows(bench):
            report["rows"].append(row)
            if arguments.json != "-":
                module.print_row(row)
        if arguments.json == "-":
            json.dump(report, sys.stdout, indent=1)
            print()
        elif arguments.json:
            with open(arguments.json, "w", encoding="utf-8") as file:
                json.dump(report, file, indent=1)
        if arguments.json != "-":
            module.print_end(report)
        if not report["rows"]:
            raise Failure("nothing was measured")
        return 1 if any(row.get("fault") for row in report["rows"]) else 0
    except (Failure, OSError) as fault:
        say("error: " + str(fault))
        return 1
    finally:
        for number in STOPPING:
            signal.signal(number, signal.SIG_IGN)  # once is enough
        end_all()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
