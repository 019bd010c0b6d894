#!/usr/bin/python3
"""times.py TIMES.xml [COUNT=20]: the slowest tests of a run (`./test` writes build/times.xml) and their sum, as a table.
times.py TIMES.xml --costs: writes tests/costs.txt, by which the longest tests start first.
times.py --processor FILE [COUNT=20]: likewise by processor time, from build/processor.txt of a build with
-DRELIGHT_PROCESSOR_TIMES=ON; a test that ran twice counts once, with its last run."""

import sys
import xml.etree.ElementTree
from pathlib import Path


def table(cases, count):
    cases.sort(key=lambda case: (-case[0], case[1]))
    print("| seconds | test |\n|---|---|")
    for seconds, name in cases[:count]:
        print(f"| {seconds:.1f} | `{name}` |")
    print(f"| {sum(seconds for seconds, _ in cases):.0f} | all {len(cases)} |")


def elapsed(file):
    return [(float(case.get("time")), case.get("name")) for case in xml.etree.ElementTree.parse(file).iter("testcase")]


def processor(file):
    last = {}
    for line in Path(file).read_text(encoding="ascii").splitlines():
        user, system, _, name = line.split(" ", 3)
        last[name] = float(user) + float(system)
    return [(seconds, name) for name, seconds in last.items()]


def write_costs(cases):
    lines = [f"{seconds:.0f} {name}" for seconds, name in sorted(cases, key=lambda case: (-case[0], case[1])) if seconds >= 0.95]
    Path(__file__).with_name("costs.txt").write_text(
        "\n".join(["# Seconds and test, one second and more; tests/times.py build/times.xml --costs", *lines, ""]), encoding="ascii")


words = sys.argv[1:]
if not words or words[0] in ("-h", "--help"):
    print(__doc__)
    sys.exit(0 if words else 2)
if words[1:] == ["--costs"]:
    write_costs(elapsed(words[0]))
elif words[0] == "--processor":
    table(processor(words[1]), int(words[2]) if len(words) > 2 else 20)
else:
    table(elapsed(words[0]), int(words[1]) if len(words) > 1 else 20)
