"""Checks PROTOCOL.md against the state model of protocol.py: its tables, limits and clauses. Called by protocol.py."""

import re
from pathlib import Path

import protocol as p

BEGIN, END = "<!-- who may send what -->\n", "<!-- end -->\n"


def clauses_of(text):
    """{number: text} of all numbered clauses; a heading of section 4 counts with the text below it, up to its clauses."""
    found = {}
    for match in re.finditer(r"^- (\d+(?:\.\d+)+) (.*?)(?=^- \d+\.|^#|\n\n)", text, re.M | re.S):
        found[match[1]] = match[2]
    for match in re.finditer(r"^### (4\.\d+) (.*?)(?=^#|\Z)", text, re.M | re.S):
        found[match[1]] = match[2]
    return found


def rows_of(text, heading):
    """The first table after a heading, as lists of cells."""
    part = text.split(f"\n## {heading}", 1)[1]
    table = re.search(r"^\|.*?(?=\n\n)", part, re.M | re.S)[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()][2:]


def who_may_send():
    """The generated table of section 4."""
    lines = ["| op | " + " | ".join((p.NEW, *p.ROLES)) + " | answers |", "|---" * (len(p.ROLES) + 3) + "|"]
    for op, message in p.MESSAGES.items():
        cells = []
        for state in (p.NEW, *p.ROLES):
            wrong = "`bad_order`" if op == "hello" or state == p.NEW else "`wrong_role`"
            cells.append("yes" if state in message.roles else wrong)
        answers = ", ".join(f"`{a}`" for a in message.answers) or "none"
        stays = ", ".join(f"`{c}`" for c in sorted(message.stays))
        lines.append(f"| `{op}` | " + " | ".join(cells) + f" | {answers}" + (f"; stays open after {stays}" if stays else "") + " |")
    cells = " | ".join("yes" if s == p.PRODUCER else "`wrong_role`" for s in (p.NEW, *p.ROLES))
    lines.append(f"| binary | {cells} | `frame` |")
    lines.append("| any other | `bad_order` | " + " | ".join(["`unknown_op`"] * len(p.ROLES)) + " | stays open after `unknown_op` |")
    return "\n".join(lines) + "\n"


def spelled(number):
    """The ways in which a limit may be written."""
    if abs(number) == p.NUMBER_MAX:
        return ("number", "`sequence`", "integer", "position", "time")  # 1.5
    if isinstance(number, float) and number == int(number):
        number = int(number)
    return (f"{number:g}" if isinstance(number, float) else str(number), "1e-9" if number == 1e-9 else str(number))


def limits_wrong(clauses):
    for op, message in p.MESSAGES.items():
        for name, field in message.fields.items():
            text = clauses.get(field.clause)
            if text is None:
                yield f"{op}.{name}: there is no clause {field.clause}"
                continue
            if f"`{name}`" not in text:
                yield f"{op}.{name}: clause {field.clause} does not name it"
            if isinstance(field.value, (p.Whole, p.Real)):
                most = field.value.most + (1 if name in ("x", "y") else 0)
                if name not in ("x", "y", "seek") and not any(s in text for s in spelled(most)):
                    yield f"{op}.{name}: clause {field.clause} does not give its limit {most}"
            if isinstance(field.value, p.Word):
                for word in field.value.words:
                    if f"`{word}`" not in text:
                        yield f"{op}.{name}: clause {field.clause} does not name {word}"


def wrong(text):
    """What is wrong, one line each."""
    clauses = clauses_of(text)
    yield from limits_wrong(clauses)
    ops = {op: where for cells in rows_of(text, "4. The messages") for op, where in [(o, cells[1]) for o in re.findall(r"`(\w+)`", cells[0])]}
    for op in {*ops} ^ {*p.MESSAGES, *p.ANSWERS}:
        yield f"section 4: {op} is not in both, its table and the model"
    for op, where in ops.items():
        if op in p.MESSAGES and op not in p.ANSWERS and not re.search(r"to server|from a producer", where):
            yield f"section 4: {op} goes to the server, not '{where}'"
    codes = {}
    for cells in rows_of(text, "8. Errors and close codes"):
        if cells[0]:
            codes[cells[0].strip("`")] = None if cells[1] == "stays open" else int(cells[1])
    if codes != p.ERRORS:
        yield f"section 8 and the model differ: {set(codes.items()) ^ set(p.ERRORS.items())}"
    for heading, table in (("6. Image", p.PICTURE), ("7. Environment frame", p.ENVIRONMENT)):
        rows = [(int(c[0]), c[1]) for c in rows_of(text, heading)][:-1]
        if rows != [(offset, kind) for offset, kind, _ in table]:
            yield f"section {heading}: its table and the model differ: {set(rows) ^ {t[:2] for t in table}}"
    source = (Path(__file__).parent / "protocol.py").read_text() + (Path(__file__).parent / "client.py").read_text()
    for clause in sorted(set(re.findall(r'"(\d+\.\d+(?:\.\d+)?)"', source))):
        if clause not in clauses:
            yield f"the model cites clause {clause}, which is not there"
    if BEGIN + who_may_send() + END not in text:
        yield "section 4: who may send what is not as protocol.py --write makes it"


def main(arguments):
    path = Path(next(a for a in arguments if not a.startswith("--")))
    text = path.read_text(encoding="utf-8")
    if "--write" in arguments:
        head, rest = text.split(BEGIN, 1)
        text = head + BEGIN + who_may_send() + END + rest.split(END, 1)[1]
        path.write_text(text, encoding="utf-8")
    faults = list(wrong(text))
    for fault in faults:
        print(fault)
    raise SystemExit(1 if faults else 0)
