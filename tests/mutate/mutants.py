"""Small faults in C sources: which there are in a file, found by its tokens. Comments, strings, lines of the preprocessor,
assertions, and declarations of types are left alone."""

import re
from typing import NamedTuple

TOKEN = re.compile(r"""(?P<skip>//[^\n]*|/\*.*?\*/|\s+|^[ \t]*\#(?:[^\n\\]|\\.|\\\n)*)
    |(?P<str>"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')
    |(?P<num>0[xX][0-9a-fA-F.]+(?:[pP][-+]?\d+)?[uUlLfF]*|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?[uUlLfF]*)
    |(?P<id>[A-Za-z_]\w*)
    |(?P<op><<=|>>=|->|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|.)""", re.X | re.S | re.M)

OPERATORS = {"<": ["<="], "<=": ["<"], ">": [">="], ">=": [">"], "==": ["!="], "!=": ["=="], "+": ["-"], "-": ["+"],
             "*": ["/"], "/": ["*"], "%": ["/"], "&&": ["||"], "||": ["&&"], "<<": [">>"], ">>": ["<<"], "&": ["|"],
             "|": ["&"], "^": ["|"], "+=": ["-="], "-=": ["+="], "*=": ["/="], "/=": ["*="], "|=": ["&="], "&=": ["|="]}
NAMES = {a + s: b + s for s in ("", "f") for x, y in (("fmin", "fmax"), ("sin", "cos"), ("floor", "ceil")) for a, b in ((x, y), (y, x))}
SILENT = re.compile(r"assert|_Static_assert|__attribute__|_Alignas|sizeof|offsetof")  # what is within is no computation
UNSEEN = re.compile(r".*(destroy|finish|free|close|unlock|lock|log_\w+)$")  # dropping the call leaks or is silent
EITHER_WAY = re.compile(r"f?(min|max)f?|fminf?|fmaxf?|hypotf?|memcmp|strn?(case)?cmp|log_debug|mem_alloc\w*|_mm\d*_(add|mul|min|max|and|or|cmpeq)\w*")  # of arguments, or is for developers alone
WORDS = set("if for while switch return sizeof else do case goto break continue".split())
CAST = re.compile(r"\((?:u?int\w*|size_t|double|float|unsigned|const \w+)\)")
ENDS = {",", ";", ")", "]", "}", "?", ":", "&&", "||", "<", ">", "<=", ">=", "==", "!=", "=", "<<", ">>", "&", "|", "^"}


class Token(NamedTuple):
    kind: str
    text: str
    start: int
    end: int


class Mutant(NamedTuple):
    start: int
    end: int
    text: str  # in place of what stands there
    what: str


def tokens_of(source):
    found = (Token(m.lastgroup, m.group(), m.start(), m.end()) for m in TOKEN.finditer(source))
    return [t for t in found if t.kind != "skip"]


def matching(tokens, at):
    """The index of the bracket that closes the one at `at`."""
    depth = 0
    for i in range(at, len(tokens)):
        if tokens[i].kind == "op":
            depth += (tokens[i].text in "([{") - (tokens[i].text in ")]}")
            if depth == 0:
                return i
    return len(tokens) - 1


def within_loop_heads(tokens):
    """Indices of the tokens between the brackets of `for`, where a statement dropped is an endless loop, which any test notices."""
    out = set()
    for i, t in enumerate(tokens[:-1]):
        if t.text == "for" and tokens[i + 1].text == "(":
            out.update(range(i + 1, matching(tokens, i + 1)))
    return out


def declares(tokens, at):
    """Whether the name at `at`, behind a comma, is one more of a declaration of variables."""
    i, depth = at, 0
    while depth > 0 or tokens[i].text not in (";", "{", "}", "("):
        depth += (tokens[i].text in ")]}") - (tokens[i].text in "([{")
        i -= 1
    first, second = tokens[i + 1], tokens[i + 2]
    return (tokens[i].text != "(" and tokens[i - 1].text != "=" and first.kind == "id" and first.text not in WORDS
            and (second.kind == "id" or second.text == "*"))


def silent(tokens):
    """Indices of the tokens that are outside functions and tables, in a type's declaration, or in an assertion."""
    out, i, depth = set(), 0, 0
    while i < len(tokens):
        text, end = tokens[i].text, i
        if tokens[i].kind == "id" and SILENT.match(text) and i + 1 < len(tokens) and tokens[i + 1].text == "(":
            end = matching(tokens, i + 1)
        elif text in ("enum", "struct", "union"):
            brace = i + 1 + (tokens[i + 1].kind == "id")
            end = matching(tokens, brace) if tokens[brace].text == "{" else i
        elif text == "[" and i > 1 and (tokens[i - 1].kind == "id" and (tokens[i - 2].kind == "id" or tokens[i - 2].text == "*")
                                        and tokens[i - 2].text not in WORDS or tokens[i - 2].text + tokens[i - 1].text == "*)"
                                        or tokens[i - 2].text == "," and tokens[i - 1].kind == "id" and declares(tokens, i - 1)):
            end = matching(tokens, i)  # how many elements a declaration or a cast has
            while end + 1 < len(tokens) and tokens[end + 1].text == "[":
                end = matching(tokens, end + 1)
        depth += (text == "{" and end == i) - (text == "}" and end == i)
        if end > i or depth == 0:
            out.update(range(i, end + 1))
        i = end + 1
    return out


def unreachable(source, lacks):
    """The ranges of the source that only processors compile, or run, with one of these macros, as far as #if says so itself."""
    out, open_at = [], []
    for m in re.finditer(r"^[ \t]*#[ \t]*(if|ifdef|elif|else|endif)\b([^\n]*)", source, re.M):
        if m[1] != "if" and m[1] != "ifdef" and open_at:
            begun, without = open_at.pop()
            out += [(begun, m.start())] if without else []
        if m[1] != "endif":
            open_at.append((m.end(), any(macro in m[2] for macro in lacks)))
    return out


def other_number(text):
    """One more, or 5 % more of a real number; 1 for 0.0."""
    body, suffix = re.fullmatch(r"(0[xX][0-9a-fA-F]+(?![.pP])|.*?)([uUlLfF]*)", text).groups()
    if re.fullmatch(r"0[xX][0-9a-fA-F]+|0[0-7]*|[1-9]\d*", body):
        return f"{int(body, 8 if re.fullmatch('0[0-7]+', body) else 0) + 1}{suffix}"
    value = float.fromhex(body) if body.lower().startswith("0x") else float(body)
    return "1.0" + suffix if value == 0 else f"(1.05f * {text})" if "f" in suffix.lower() else f"(1.05 * {text})"


def term_end(tokens, at, factor):
    """The index behind the operand that follows the operator at `at`."""
    i = at + 1
    while i < len(tokens):
        text = tokens[i].text
        if tokens[i].kind == "op":
            if text in "([{":
                i = matching(tokens, i)
            elif text in ENDS or (i > at + 1 and text in ("+", "-")) or (factor and i > at + 1 and text in ("*", "/", "%")):
                return i
        i += 1
    return i


def picks_either(source, t):
    """Whether it is a comparison in a < b ? a : b or the like, in which equality makes no difference."""
    found = re.match(r"\s*([^?;]+?)\s*\?\s*([^?:;]+?)\s*:\s*([^?:;]+?)\s*[;,)]", source[t.end:])
    if not found or t.text not in ("<", "<=", ">", ">="):
        return False
    b, x, y = (CAST.sub("", part) for part in found.groups())
    left = CAST.sub("", source[:t.start].rstrip())
    return (x == b and left.endswith(y)) or (y == b and left.endswith(x))


def arguments(tokens, at):
    """The ranges of the arguments of the call whose bracket opens at `at`."""
    last, out, begin, i = matching(tokens, at), [], at + 1, at + 1
    while i <= last:
        if tokens[i].text in ("(", "[", "{") and i < last:
            i = matching(tokens, i)
        elif tokens[i].text == "," or i == last:
            if i > begin:
                out.append((tokens[begin].start, tokens[i - 1].end))
            begin = i + 1
        i += 1
    return out


def statement(source, tokens, i):
    """A call or an assignment that begins at token i, as the mutant without it."""
    if tokens[i].kind != "id" or tokens[i].text in WORDS or UNSEEN.match(tokens[i].text) or tokens[i - 1].text not in (";", "{", "}"):
        return None
    if tokens[i + 1].kind == "id" or tokens[i + 1].text == "*" or tokens[i + 1].text == ":":
        return None
    end = i
    while end < len(tokens) and tokens[end].text != ";":
        if tokens[end].text == "{":
            return None
        end = matching(tokens, end) + 1 if tokens[end].text in ("(", "[") else end + 1
    if end >= len(tokens) or tokens[end - 1].text == "NULL" or (tokens[i + 1].text == "(" and source[tokens[i].start:tokens[end].start].count("(") == 0):
        return None
    return Mutant(tokens[i].start, tokens[end].start, "", "statement dropped")


def mutants_of(source, lacks=()):
    """All mutants of a file, in its order; none in code for processors with one of the macros in `lacks`."""
    tokens = tokens_of(source)
    out, skip, heads, elsewhere = [], silent(tokens), within_loop_heads(tokens), unreachable(source, lacks)
    for i, t in enumerate(tokens[:-1]):
        if i in skip or i == 0 or any(a <= t.start < b for a, b in elsewhere):
            continue
        before, binary = tokens[i - 1], tokens[i - 1].kind in ("id", "num") and tokens[i - 1].text not in WORDS or tokens[i - 1].text in (")", "]")
        if t.kind == "num":
            out.append(Mutant(t.start, t.end, other_number(t.text), "constant"))
        elif t.kind == "op" and t.text in OPERATORS and binary:
            if t.text == "*" and (tokens[i + 1].text in (")", ",", "*", "const", "restrict") or before.text in ("float", "double", "char", "void")):
                continue
            out += [Mutant(t.start, t.end, o, "operator") for o in OPERATORS[t.text] if not picks_either(source, t)]
            if t.text in ("+", "-", "*", "/"):
                end = term_end(tokens, i, t.text in ("*", "/"))
                out.append(Mutant(t.start, tokens[end - 1].end, "", "term dropped"))
        elif t.text == "!":
            out.append(Mutant(t.start, t.end, "", "operator"))
        elif t.text in NAMES and tokens[i + 1].text == "(":
            out.append(Mutant(t.start, t.end, NAMES[t.text], "function"))
        if t.kind == "id" and t.text not in WORDS and tokens[i + 1].text == "(" and not EITHER_WAY.fullmatch(t.text):
            a = arguments(tokens, i + 1)
            for (b0, e0), (b1, e1) in zip(a, a[1:]):
                if source[b0:e0] != source[b1:e1]:
                    out.append(Mutant(b0, e1, source[b1:e1] + source[e0:b1] + source[b0:e0], "arguments swapped"))
        dropped = None if i in heads else statement(source, tokens, i)
        if dropped:
            out.append(dropped)
    return out


def applied(source, mutant):
    return source[:mutant.start] + mutant.text + source[mutant.end:]


def line_of(source, mutant):
    """Its line number and that line before and after."""
    first, last = source.rfind("\n", 0, mutant.start) + 1, source.find("\n", mutant.end)
    whole = applied(source, mutant)
    return (source.count("\n", 0, mutant.start) + 1, " ".join(source[first:last].split()),
            " ".join(whole[first:last + len(whole) - len(source)].split()))
