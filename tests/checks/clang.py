#!/usr/bin/python3
"""clang.py BUILD CLANG: clang checks every file of the programs once, as the build compiles it, warnings being errors, and
writes no objects. It is asked through its library, because a start of the program takes as long as reading a file. A file that had no finding is not read again while it, its headers and clang are the same, in this clone
or another (~/.cache/relightd-clang). `./test --long` builds the tests with clang too."""

import ctypes
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path


KEPT = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "relightd-clang"
VERSION = subprocess.run([sys.argv[2], "--version"], stdout=subprocess.PIPE, check=True).stdout


def headers_of(build):
    """The headers of each object, as the compiler listed them: {object: [path]}; nothing where the build is not ninja's."""
    told = subprocess.run(["ninja", "-C", build, "-t", "deps"], stdout=subprocess.PIPE, check=False, text=True)
    found, name = {}, None
    for line in told.stdout.splitlines():
        if line.startswith(" "):
            found[name].append(line.strip())
        elif line:
            name = line.split(":")[0]
            found[name] = []
    return found


DIGESTS = {}


def digest(path):
    if path not in DIGESTS:
        DIGESTS[path] = hashlib.sha256(path.read_bytes()).digest()
    return DIGESTS[path]


def mark_of(entry, words, headers):
    """The file that says that this one had no finding; none if its headers are not known."""
    if not headers:
        return None
    folder = Path(entry["directory"])
    told = hashlib.sha256(VERSION + " ".join(words).replace(str(folder.parent), "").encode())
    for path in [entry["file"], *headers]:
        told.update(digest(folder / path))
    return KEPT / told.hexdigest()


class String(ctypes.Structure):
    _fields_ = [("data", ctypes.c_void_p), ("flags", ctypes.c_uint)]


class Clang:
    """libclang: complaints about one file."""

    def __init__(self, program):
        folder = Path(shutil.which(program)).resolve().parents[1] / "lib"
        self.library = ctypes.CDLL(str(folder / "libclang.so.1"))
        for name in ("clang_createIndex", "clang_getDiagnostic"):
            getattr(self.library, name).restype = ctypes.c_void_p
        self.library.clang_formatDiagnostic.restype = String
        self.library.clang_getCString.restype = ctypes.c_char_p
        self.index = ctypes.c_void_p(self.library.clang_createIndex(0, 0))

    def complaints(self, words, file):
        words = [word.encode() for word in words]
        unit = ctypes.c_void_p()
        failed = self.library.clang_parseTranslationUnit2(self.index, file.encode(), (ctypes.c_char_p * len(words))(*words),
                                                          len(words), None, 0, 0, ctypes.byref(unit))
        if failed:
            return f"{file}: clang failed\n"
        text = ""
        for i in range(self.library.clang_getNumDiagnostics(unit)):
            one = ctypes.c_void_p(self.library.clang_getDiagnostic(unit, i))
            string = self.library.clang_formatDiagnostic(one, self.library.clang_defaultDiagnosticDisplayOptions())
            text += self.library.clang_getCString(string).decode(errors="replace") + "\n"
            self.library.clang_disposeString(string)
            self.library.clang_disposeDiagnostic(one)
        self.library.clang_disposeTranslationUnit(unit)
        return text


def read(entry):
    """Clang's complaints about one file, or an empty text."""
    words = shlex.split(entry["command"])
    words = words[next(i for i, word in enumerate(words) if word.startswith("-")):]  # past the compiler
    output = words[words.index("-o") + 1]
    for flag in ("-o", "-c"):
        del words[words.index(flag):words.index(flag) + 2]
    mark = mark_of(entry, words, HEADERS.get(output))
    if mark and mark.exists():
        return ""
    os.chdir(entry["directory"])
    text = CLANG.complaints([*words, "-Wno-unknown-warning-option"], entry["file"])
    if mark and not text:
        mark.touch()
    return text


def once(entries):
    """One entry a file and set of machine flags: kernels are compiled for several processors."""
    kept = {}
    for entry in entries:
        if "/tests/" not in entry["file"]:
            machine = [word for word in shlex.split(entry["command"]) if word.startswith("-m")]
            kept.setdefault((entry["file"], *machine), entry)
    return list(kept.values())


KEPT.mkdir(parents=True, exist_ok=True)
CLANG = Clang(sys.argv[2])
HEADERS = headers_of(sys.argv[1])
entries = once(json.loads((Path(sys.argv[1]) / "compile_commands.json").read_text(encoding="utf-8")))
found = [text for text in map(read, entries) if text]
print("".join(found) + f"{len(entries)} files read, {len(found)} with findings")
sys.exit(bool(found) or not entries)
