"""Every relative link in the Markdown files leads to a file that is there, and every #anchor to a heading of it. Prints each
finding as file:line; exit 1 if there is any.
usage: links.py ROOT"""
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(sys.argv[1]).resolve()
LINK = re.compile(r"\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)|\b(?:src|href)=\"([^\"]+)\"")


def pages():
    """The Markdown files that git tracks; outside a checkout, all."""
    got = subprocess.run(["git", "-C", ROOT, "ls-files", "--cached", "--others", "--exclude-standard", "*.md"], capture_output=True, text=True)
    names = got.stdout.split("\n") if got.returncode == 0 else [str(p.relative_to(ROOT)) for p in ROOT.rglob("*.md")]
    return [ROOT / n for n in names if n and (ROOT / n).exists()]


def prose(text):
    """The lines outside fenced and indented code, numbered from 1, without code spans."""
    fenced = False
    for number, line in enumerate(text.split("\n"), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced and not line.startswith("    "):
            yield number, re.sub(r"`([^`]*)`", r"\1" if line.startswith("#") else "", line)


def slug(heading):
    """The anchor that GitHub gives a heading."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", text).replace(" ", "-")


def anchors(page):
    """All anchors of a page; the second of two equal headings ends in -1."""
    found = set()
    for _, line in prose(page.read_text()):
        heading = re.match(r"#{1,6} +(.*)", line)
        for name in re.findall(r"<a (?:id|name)=\"([^\"]+)\"", line):
            found.add(name)
        if heading:
            name = base = slug(heading[1])
            again = 0
            while name in found:
                again += 1
                name = f"{base}-{again}"
            found.add(name)
    return found


def main():
    count, findings, known = 0, [], {}
    for page in pages():
        for number, line in prose(page.read_text()):
            for match in LINK.finditer(line):
                link = match[1] or match[2]
                if re.match(r"[a-z][a-z0-9+.-]*:", link):
                    continue
                count += 1
                path, _, anchor = link.partition("#")
                target = (page.parent / path).resolve() if path else page
                where = f"{page.relative_to(ROOT)}:{number}"
                if not target.exists():
                    findings.append(f"{where}: {link}: there is no {path}")
                elif anchor and target.suffix == ".md":
                    if target not in known:
                        known[target] = anchors(target)
                    if anchor not in known[target]:
                        findings.append(f"{where}: {link}: {path or 'this page'} has no heading #{anchor}")
    print("\n".join(findings + [f"{count} links, {len(findings)} findings"]))
    sys.exit(bool(findings) or count < 100)


main()
