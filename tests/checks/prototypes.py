"""Every prototype in a header of server/ has a comment beside it, or directly above it or above its group (the prototypes
that follow each other without an empty line), and every header with prototypes says which threads may call them.
Prints one line per finding, file:line: name; the exit code is 1 if there are any.
usage: prototypes.py ROOT"""
import pathlib
import re
import sys

root = pathlib.Path(sys.argv[1])
headers = sorted((root / "server").rglob("*.h"))

PROTOTYPE = re.compile(r"(?!(?:typedef|static|extern|struct \w+ \{|union|enum \w+ \{|#|/\*| \*))[A-Za-z_][\w \*]*?\**(\w+)\(")


def prototypes(lines):
    """(index of the first line, index of the last, name, whether a comment is above its group) of each prototype."""
    in_comment = covered = False
    first = None
    for i, line in enumerate(lines):
        if in_comment:
            in_comment = "*/" not in line
            continue
        if first is None and line.startswith("/*"):
            covered = True
            in_comment = "*/" not in line
            continue
        if first is None:
            match = PROTOTYPE.match(line)
            if not match:
                covered = covered and line != "" and line[0] not in "}#"
                continue
            first, name = i, match.group(1)
        code = re.sub(r"/\*.*?(\*/|$)", "", line).rstrip()
        if code == "" or code.endswith("{"):
            first = None
        elif code.endswith(";"):
            yield first, i, name, covered
            first = None


findings, count = [], 0
for path in headers:
    text = path.read_text()
    lines = text.split("\n")
    found = list(prototypes(lines))
    count += len(found)
    shown = path.relative_to(root)
    for first, last, name, covered in found:
        if not covered and "/*" not in lines[last]:
            findings.append(f"{shown}:{first + 1}: {name} has no comment")
    if found and "hread" not in text:
        findings.append(f"{shown}:1: does not say which threads may call it")
print("\n".join(findings + [f"{count} prototypes in {len(headers)} headers, {len(findings)} findings"]))
sys.exit(1 if findings else 0)
