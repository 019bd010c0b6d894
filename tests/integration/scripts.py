#!/usr/bin/python3
"""What the scripts make of measured figures (server/measure/scripts), on figures that are known."""

import sys
from pathlib import Path

from peer import check, main

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "server/measure/scripts"))
import bench  # noqa: E402


async def a_verdict_is_that_of_the_ratio(folder):
    del folder
    row = {"ratio": 2.0, "skipped": "", "at_most": 2.0}
    check(bench.verdict(row) == "holds", row)
    check(bench.verdict({**row, "at_most": 1.9}) == "does not hold", row)
    check(bench.verdict({"ratio": 2.0, "skipped": "", "at_least": 1.9}) == "holds", row)
    check(bench.verdict({**row, "ratio": None}) == "does not hold", "no number")
    check(bench.verdict({**row, "skipped": "no reason"}) == "not measured", row)
    check(bench.verdict({"ratio": 2.0, "skipped": ""}) == "stated", "no target")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if name.count("_") >= 2 and callable(f)})
