#!/usr/bin/python3
"""figures.py RESULTS.json...: writes the suites' results into the last column of docs/internals/reliability.md."""

import json
import re
import sys
from pathlib import Path

page = Path(__file__).resolve().parents[2] / "docs/internals/reliability.md"
results = {}
for name in sys.argv[1:]:
    results.update(json.loads(Path(name).read_text(encoding="utf-8")))
lines = page.read_text(encoding="utf-8").split("\n")
for i, line in enumerate(lines):
    found = re.search(r"\| `faults\.(\w+)` \|", line)
    if found and results.get(found[1], {}).get("state") == "passed":
        figure = results[found[1]]["figure"].replace("|", "/").replace("\n", " ")
        lines[i] = line[:found.end()] + f" {figure} |"
page.write_text("\n".join(lines), encoding="utf-8")
