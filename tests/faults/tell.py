#!/usr/bin/python3
"""tell.py RESULTS ROW: exits as ctest expects for the result of one row (faults.py --all)."""

import json
import sys

try:
    with open(sys.argv[1], encoding="utf-8") as file:
        results = json.load(file)
except FileNotFoundError:
    sys.exit("the suite was not played to its end")
result = results.get(sys.argv[2], {"state": "failed", "figure": "was not played"})
print(f"{sys.argv[2]}: {result['state']}: {result['figure']}")
sys.exit({"passed": 0, "skipped": 77}.get(result["state"], 1))
