#!/usr/bin/python3
"""callers.py ROOT: public functions of server/ and clients/ that nothing there calls. What only tests call is code that no user
runs: it belongs to them, or goes. A call counts wherever the name stands outside of comments and strings, other than at the
beginning of a declaration or definition; a macro that pastes names together would hide calls, so the list below excepts them."""

import re
import sys
from pathlib import Path

ROOT = Path(sys.argv[1])
EXCEPT = {
    "direct_samples",  # the kernel's own samples, from which a test computes Eq. 4 again
}
NOISE = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|' + r"'(?:\\.|[^'\\\n])+'", re.S)
PROTOTYPE = re.compile(r"^(?!static|typedef|#|extern \"C\")[a-z_][\w *]*?\b(\w+)\(", re.M)

declared, used = {}, set()
for folder in ("server", "clients", "protocol"):
    for path in sorted((ROOT / folder).rglob("*.[ch]*")):
        if path.suffix not in (".c", ".h", ".cpp") or "node_modules" in path.parts:
            continue
        text = NOISE.sub(" ", path.read_text(encoding="utf-8"))
        heads = {match.start(1): match[1] for match in PROTOTYPE.finditer(text)}
        if path.suffix == ".h" and folder != "protocol":
            for name in heads.values():
                declared.setdefault(name, path)
        used.update(match[0] for match in re.finditer(r"\b[a-z]\w*\b", text) if match.start() not in heads)
found = sorted(name for name in declared if name not in used and name not in EXCEPT)
for name in found:
    print(f"{declared[name].relative_to(ROOT)}: {name}: nothing but tests calls it")
print(f"{len(declared)} public functions, {len(found)} without a caller")
sys.exit(bool(found) or not declared)
