#!/usr/bin/python3
"""clang.py BUILD CLANG: clang checks every file of the programs once, as the build compiles it, warnings being errors, and
writes nothing. `./test --long` builds the tests with clang too."""

import json
import shlex
import subprocess
import sys
from pathlib import Path


def read(entry):
    """Clang's complaints about one file, or an empty text."""
    words = shlex.split(entry["command"])
    words = words[next(i for i, word in enumerate(words) if word.startswith("-")):]  # past the compiler
    for flag in ("-o", "-c"):
        del words[words.index(flag):words.index(flag) + 2]
    command = [sys.argv[2], *words, "-Wno-unknown-warning-option", "-fsyntax-only", entry["file"]]
    told = subprocess.run(command, cwd=entry["directory"], stderr=subprocess.PIPE, check=False)
    return told.stderr.decode(errors="replace") or ("" if told.returncode == 0 else f"{entry['file']}: clang failed\n")


def once(entries):
    """One entry a file and set of machine flags: kernels are compiled for several processors."""
    kept = {}
    for entry in entries:
        if "/tests/" not in entry["file"]:
            machine = [word for word in shlex.split(entry["command"]) if word.startswith("-m")]
            kept.setdefault((entry["file"], *machine), entry)
    return list(kept.values())


entries = once(json.loads((Path(sys.argv[1]) / "compile_commands.json").read_text(encoding="utf-8")))
found = [text for text in map(read, entries) if text]
print("".join(found) + f"{len(entries)} files read, {len(found)} with findings")
sys.exit(bool(found) or not entries)
