#!/usr/bin/python3
"""figures.py ROOT | --self-test: figures of the documentation are those that docs/reproduce.sh measured.

A bold figure, such as **0.24** or **13.8 ms**, stands in a section that links to measured/CLAIM.txt of docs/internals, a claim
of docs/reproduce.sh that was measured. Each claim has that file, with the commit (without changes of its own), the machine and
the date, or "not measured yet"; the page that the claim names links to it. CLAIM-MACHINE.txt is the same on another machine.

A figure that is the text of a link to such a file, [17.8 images/s](measured/live.txt "court 640x360"), stands in it: each number
of the text is one of the file's, rounded to the digits of the text, all of them on one line that has all words of the title,
if there is one, else on one of the file's lines. 1,200 and 1200 are equal; units are not looked at. Exit: 0 nothing found, 1 else."""

import re
import sys
import tempfile
from pathlib import Path

BOLD = re.compile(r"\*\*[-+~<>≤≥]?\s*\d[^*]*\*\*")
LINK = re.compile(r"measured/([a-z0-9]+(?:-[a-z0-9]+)*)\.txt")
QUOTED = re.compile(r"\[([^\[\]]*)\]\([^()\s]*" + LINK.pattern + r"(?:\s+\"([^\"]*)\")?\)")
NUMBER = re.compile(r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?", re.I)
STAMP = re.compile(r"^commit [0-9a-f]{7,40}; .+, \d+ processors; \d{4}-\d\d-\d\d$", re.M)
HEAD = re.compile(r"(== |commit )")  # the lines of a claim's file that say what it is
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


def agrees(shown, measured):
    """Whether a number is another one rounded to the first one's digits."""
    digits, _, power = shown.replace(",", "").lower().partition("e")
    unit = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
    return abs(float(digits + "e" + (power or "0")) - float(measured.replace(",", ""))) <= 0.5000001 * unit


def misquoted(part, text):
    """What links of a part of a page quote that their files do not say."""
    for shown, name, title in QUOTED.findall(part):
        numbers = NUMBER.findall(shown)
        lines = [x for x in text.get(name, "").split("\n") if not HEAD.match(x) and all(word in x for word in title.split())]
        if numbers and not STAMP.search(text.get(name, "")):
            yield f"{shown} is quoted from measured/{name}.txt, which was not measured"
        elif not any(all(any(agrees(n, m) for m in NUMBER.findall(x)) for n in numbers) for x in lines):
            yield f"{shown} is in no line{title and f' with {title!r}'} of measured/{name}.txt"


def faults(root):
    claims = claims_of((root / "docs/reproduce.sh").read_text(encoding="utf-8"))
    pages = [*sorted((root / "docs").rglob("*.md")), *root.glob("*.md"), *root.glob("protocol/*.md"), *root.glob("server/**/README.md")]
    text = {p.stem: p.read_text(encoding="utf-8") for p in (root / "docs/internals/measured").glob("*.txt") if p.stem.split("-")[0] in claims}
    stamped = {n for n in text if STAMP.search(text[n])}
    linked, out = {}, []
    for page in pages:
        for part in sections(page.read_text(encoding="utf-8")):
            names = [n for n in LINK.findall(part) if n in claims or n in text]
            linked.setdefault(page.name, set()).update(names)
            if not stamped.intersection(names):
                out += [f"{page.relative_to(root)}: {figure} is bold, and no claim of docs/reproduce.sh measures it" for figure in BOLD.findall(part)]
            out += [f"{page.relative_to(root)}: {fault}" for fault in misquoted(part, text)]
    for name, page in claims.items():
        if name not in text:
            out.append(f"{name} has no file: docs/reproduce.sh --write {name}")
        elif name not in stamped and text[name].strip() != UNKNOWN:
            out.append(f"measured/{name}.txt: no line with a commit, without changes, machine and date")
        if name not in linked.get(page, ()):
            out.append(f"{page} does not link to measured/{name}.txt")
    return out


ROWS = "court 640x360: 17.84 images/s, 88.2 ms, 1234 rays\nring 640x360: 2.05 images/s, relMSE 7.13e-3\n"
QUOTES = [("17.8", "gains.txt", 0), ("17.8 images/s, 88 ms", 'gains.txt "court"', 0), ("1,234", "gains.txt", 0), ("7.1e-3", "gains.txt", 0),
          ("last run", "gains.txt", 0), ("17.9", "gains.txt", 1), ("17.80", "gains.txt", 1), ("17.8", 'gains.txt "ring"', 1),
          ("17.8 and 2.1", "gains.txt", 1), ("7.2e-3", "gains.txt", 1), ("17.8", "gains-avx2.txt", 1), ("2", "gains.txt", 0), ("2026", "gains.txt", 1)]


def self_test():
    """A tree without a fault, and each fault planted in it."""
    script = "cat <<'END'\ngains | page.md 6 | what\nEND\n"
    page, stamp = "# A\n**0.5** [here](measured/gains.txt)\n", "commit 1234567; A machine, 2 processors; 2026-01-02\n"
    plain = page.replace("**", "")
    cases = [(page, stamp, 0), (page + "# B\n**Words 3** and 0.5\n```\n**2**\n```\n", stamp, 0), (page + "# B\n**2.5 ms**\n", stamp, 1),
             (page.replace("gains.txt", "other.txt"), stamp, 2), (plain, stamp.replace(";", ", with changes;", 1), 1),
             *((plain + f"[{shown}](measured/{file})\n", stamp + ROWS, want) for shown, file, want in QUOTES),
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
