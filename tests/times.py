#!/usr/bin/python3
"""times.py TIMES.xml [COUNT=20]: the slowest tests of a run (`./test` writes build/times.xml) and their sum, as a table.
times.py TIMES.xml --costs: writes tests/costs.txt, by which the longest tests start first."""

import sys
import xml.etree.ElementTree
from pathlib import Path

cases = [(float(case.get("time")), case.get("name")) for case in xml.etree.ElementTree.parse(sys.argv[1]).iter("testcase")]
cases.sort(key=lambda case: (-case[0], case[1]))
if sys.argv[2:] == ["--costs"]:
    lines = [f"{seconds:.0f} {name}" for seconds, name in cases if seconds >= 0.95]
    Path(__file__).with_name("costs.txt").write_text(
        "\n".join(["# Seconds and test, one second and more; tests/times.py build/times.xml --costs", *lines, ""]), encoding="ascii")
else:
    print("| seconds | test |\n|---|---|")
    for seconds, name in cases[:int(sys.argv[2]) if len(sys.argv) > 2 else 20]:
        print(f"| {seconds:.1f} | `{name}` |")
    print(f"| {sum(seconds for seconds, _ in cases):.0f} | all {len(cases)} |")
