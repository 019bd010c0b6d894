#!/usr/bin/python3
"""figures.py ROOT | --self-test: every figure that the documentation puts in bold was measured by docs/reproduce.sh.

A bold figure, such as **0.24** or **13.8 ms**, stands in a section that links to measured/CLAIM.txt of docs/internals, a claim
of docs/reproduce.sh that was measured. Each claim has that file, with the commit (without changes of its own), the machine and
the date, or "not measured yet"; the page that the claim names links to it. Exit: 0 nothing found, 1 else."""

import re
import sys
import tempfile
from pathlib import Path

BOLD = re.compile(r"\*\*[-+~<>≤≥]?\s*\d[^*]*\*\*")
LINK = re.compile(r"measured/([a-z0-9]+)\.txt")
STAMP = re.compile(r"^commit [0-9a-f]{7,40}; .+, \d+ processors; \d{4}-\d\d-\d\d$", re.M)
UNKNOWN = "not measured yet"
HEADING = re.compile(r"^#+ ", re.M)


def sections(text):
    """Its parts between headings, without code."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    return HEADING.split(text)


def claims_of(script):
    """name -> page."""
    rows = re.search(r"cat <<'END'\n(.*?)\nEND\n", script, re.S).group(1)
    return {name: where.split()[0] for name, where, _ in (map(str.strip, row.split("|", 2)) for row in rows.split("\n"))}


def faults(root):
    claims = claims_of((root / "docs/reproduce.sh").read_text(encoding="utf-8"))
    pages = [*sorted((root / "docs").rglob("*.md")), *root.glob("*.md"), *root.glob("protocol/*.md"), *root.glob("server/*/README.md")]
    text = {n: p.read_text(encoding="utf-8") for n in claims if (p := root / f"docs/internals/measured/{n}.txt").exists()}
    stamped = {n for n in text if STAMP.search(text[n])}
    linked, out = {}, []
    for page in pages:
        for part in sections(page.read_text(encoding="utf-8")):
            names = [n for n in LINK.findall(part) if n in claims]
            linked.setdefault(page.name, set()).update(names)
            if not stamped.intersection(names):
                out += [f"{page.relative_to(root)}: {figure} is bold, and no claim of docs/reproduce.sh measures it" for figure in BOLD.findall(part)]
    for name, page in claims.items():
        if name not in text:
            out.append(f"{name} has no file: docs/reproduce.sh --write {name}")
        elif name not in stamped and text[name].strip() != UNKNOWN:
            out.append(f"measured/{name}.txt: no line with a commit, without changes, machine and date")
        if name not in linked.get(page, ()):
            out.append(f"{page} does not link to measured/{name}.txt")
    return out


def self_test():
    """A tree without a fault, and each fault planted in it."""
    script = "cat <<'END'\ngains | page.md 6 | what\nEND\n"
    page, stamp = "# A\n**0.5** [here](measured/gains.txt)\n", "commit 1234567; A machine, 2 processors; 2026-01-02\n"
    plain = page.replace("**", "")
    cases = [(page, stamp, 0), (page + "# B\n**Words 3** and 0.5\n```\n**2**\n```\n", stamp, 0), (page + "# B\n**2.5 ms**\n", stamp, 1),
             (page.replace("gains.txt", "other.txt"), stamp, 2), (plain, stamp.replace(";", ", with changes;", 1), 1),
             (plain, None, 1), (plain, "commit 1234567; A machine, 2 processors\n", 1), (plain, UNKNOWN, 0), (page, UNKNOWN, 1)]
    for text, measured, want in cases:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            (root / "docs/internals/measured").mkdir(parents=True)
            (root / "docs/reproduce.sh").write_text(script, encoding="utf-8")
            (root / "docs/internals/page.md").write_text(text, encoding="utf-8")
            if measured:
                (root / "docs/internals/measured/gains.txt").write_text(measured, encoding="utf-8")
            found = faults(root)
            assert len(found) == want, (text, measured, want, found)


if __name__ == "__main__":
    if sys.argv[1:] == ["--self-test"]:
        self_test()
        sys.exit(0)
    found = faults(Path(sys.argv[1]))
    print(*found, sep="\n", end="\n" if found else "")
    sys.exit(1 if found else 0)
