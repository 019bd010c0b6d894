#!/usr/bin/python3
"""clang.py BUILD CLANG: clang checks every file as the build compiles it, warnings being errors, and writes nothing."""

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


entries = json.loads((Path(sys.argv[1]) / "compile_commands.json").read_text(encoding="utf-8"))
found = [text for text in map(read, entries) if text]
print("".join(found) + f"{len(entries)} files read, {len(found)} with findings")
sys.exit(bool(found) or not entries)
