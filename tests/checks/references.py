#!/usr/bin/python3
"""references.py ROOT: every work that is cited as [Author 1999], [LPG13] or [Archimedes], with or without what follows a comma, stands in
docs/REFERENCES.md. Every finding is one line, file: citation; exit 1 when there is any."""

import re
import sys
from pathlib import Path

ROOT = Path(sys.argv[1])
LIST = ROOT / "docs" / "REFERENCES.md"
BRACKET = re.compile(r"\[([A-Z][^][()]*)\](?!\()")  # [text](address) is a link
WORK = (re.compile(r"([A-Z][A-Za-z',. -]* (?:18|19|20)[0-9]{2})(?:[ ,].*)?"), re.compile(r"([A-Z]+[0-9]{2})(?:,.*)?"),
        re.compile(r"([A-Z][a-z]{3,}[0-9A-Z]*)"), re.compile(r"((?:CIE|IEC|ITU-R|RFC|SMPTE) [^,]*)(?:,.*)?"))


def citations(text):
    """Those of a pair apart; comments that go over a line's end are joined."""
    joined = " ".join(re.sub(r"^ *\*+ ?", "", line) for line in text.split("\n"))
    for part in (p.lstrip(" ") for bracket in BRACKET.findall(joined) for p in bracket.split(";")):
        yield from (found[1] for found in (pattern.fullmatch(part) for pattern in WORK) if found)


listed = LIST.read_text(encoding="utf-8")
missing = count = 0
for path in sorted(p for folder in ("server", "clients", "protocol", "docs") for p in (ROOT / folder).rglob("*")
                   if p.suffix in (".c", ".h", ".md", ".js") and "node_modules" not in p.parts and p.is_file() and p != LIST):
    for work in sorted(set(citations(path.read_text(encoding="utf-8")))):
        count += 1
        if f"- [{work}" not in listed:
            print(f"{path.relative_to(ROOT)}: [{work}] is not in docs/REFERENCES.md")
            missing += 1
print(f"{count} citations, {missing} missing")
sys.exit(missing > 0 or not count)
