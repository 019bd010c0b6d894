#!/usr/bin/python3
"""relight.v1 as a state model: which message may be sent by whom and when, which values its fields have, and which answers a server
may give. model.py plays against it; `protocol.py PROTOCOL.md` checks the document's tables and limits against it (checks.protocol),
with --write it renews the table of section 4 there.

A client's state is its role after `welcome`, or NEW before. `judge` maps a message in a state to the set of answers that are
allowed: at most one of them arrives."""

import json
import math
import struct
import sys
from dataclasses import dataclass, field

NUMBER_MAX = (1 << 53) - 1  # 1.5
SIDE_MAX = 16384
TEXT_MAX = 16384  # 3.3
FRAGMENTS_MAX = 4096
CREDIT = 2  # 5.2
CREDIT_H264 = 16  # 5.11

# ---- States ----

NEW = "before hello"
VIEWER, RECORDER, CONTROLLER, PRODUCER = "viewer", "recorder", "controller", "producer"
ROLES = (VIEWER, RECORDER, CONTROLLER, PRODUCER)

# ---- Errors (section 8): code -> close code, None: the connection stays ----

ERRORS = {
    "bad_utf8": 1007, "too_big": 1009, "bad_json": 4001, "bad_field": 4002, "bad_order": 4003, "wrong_role": 4004,
    "bad_version": 4005, "bad_token": 4006, "full": 4007, "no_hello": 4008, "stalled": 4009, "too_fast": 4010,
    "superseded": 4011, "busy": 4012, "too_slow": 4013, "no_credit": 4014, "unknown_op": None, "not_offered": None,
    "bad_frame": None,
}
IN_FRAME_ONLY = {"bad_frame"}
NOT_FATAL_IN = {"control": {"bad_field", "busy"}, "probe": {"bad_field", "busy", "not_offered"}}  # 4.13, 4.15


# ---- Values of fields ----

@dataclass
class Whole:
    least: int
    most: int
    usual: tuple = None  # a range that costs the server little

    def has(self, value):
        return isinstance(value, int) and not isinstance(value, bool) and self.least <= value <= self.most


@dataclass
class Real:
    least: float
    most: float
    above: bool = False  # `least` itself is excluded
    usual: tuple = None
    words: tuple = ()  # that are taken too

    def has(self, value):
        if isinstance(value, str):
            return value in self.words
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return False
        return (self.least < value if self.above else self.least <= value) and value <= self.most


@dataclass
class Flag:
    def has(self, value):
        return isinstance(value, bool)


@dataclass
class Word:
    words: tuple

    def has(self, value):
        return isinstance(value, str) and value in self.words


@dataclass
class Offered:
    """A name that the server offers: `welcome.controls` or `status.offers` lists them."""
    of: str

    def has(self, value):
        return isinstance(value, str)  # the server says whether it is one of them


@dataclass
class Name:
    most: int = 64

    def has(self, value):
        letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-"
        return isinstance(value, str) and 1 <= len(value) <= self.most and all(c in letters for c in value)


@dataclass
class Text:
    most: int

    def has(self, value):
        return isinstance(value, str) and len(value.encode(errors="replace")) <= self.most


@dataclass
class Version:
    def has(self, value):
        sixteen = Whole(0, 65535)
        return isinstance(value, dict) and sixteen.has(value.get("major")) and sixteen.has(value.get("minor", 0))


@dataclass
class Field:
    clause: str
    value: object
    required: bool = False
    null: bool = False  # JSON null is a value, too

    def has(self, value):
        return (value is None and self.null) or self.value.has(value)


# ---- Messages to the server ----

@dataclass
class Message:
    clause: str
    roles: tuple  # that may send it; NEW: the first message
    fields: dict
    answers: tuple = ()  # ops of the server; the first is the direct one
    role_clause: str = "4.1.1"  # of wrong_role
    stays: set = field(default_factory=set)  # codes that are not fatal here


VIEWERS = (VIEWER, RECORDER, CONTROLLER)
FORMATS = ("jpeg", "exr_half", "exr_float", "h264", "changes")

MESSAGES = {
    "hello": Message("4.1", (NEW,), {
        "role": Field("4.1.1", Word((VIEWER, CONTROLLER, PRODUCER, RECORDER)), required=True),
        "version": Field("4.1.2", Version(), required=True),
        "token": Field("4.1.3", Text(255)),
        "pace": Field("4.1.4", Word(("live", "lockstep"))),
        "sequence": Field("4.1.5", Name()),
        "recorder": Field("4.1.6", Name()),
    }, ("welcome",)),
    "subscribe": Message("4.3", VIEWERS, {
        "request": Field("4.3.5", Whole(0, NUMBER_MAX)),
        "format": Field("4.3.1", Word(FORMATS), required=True),
        "quality": Field("4.3.2", Whole(1, 100)),
        "max_rate": Field("4.3.3", Real(0, 1000, above=True)),
        "max_width": Field("4.3.7", Whole(1, SIDE_MAX)),
        "max_height": Field("4.3.7", Whole(1, SIDE_MAX)),
        "paused": Field("4.3.4", Flag()),
    }, ("subscribed",), stays={"not_offered"}),
    "ack": Message("4.5", VIEWERS, {
        "sequence": Field("4.5.1", Whole(1, NUMBER_MAX), required=True),
        "displayed_us": Field("4.5.2", Whole(-NUMBER_MAX, NUMBER_MAX)),
        "stored": Field("4.5.3", Flag()),
    }),
    "ping": Message("4.6", ROLES, {"id": Field("4.6.1", Whole(0, NUMBER_MAX), required=True)}, ("pong",)),
    "end": Message("4.12", (PRODUCER,), {}, role_clause="4.12"),
    "control": Message("4.13", (CONTROLLER,), {
        "request": Field("4.13.1", Whole(0, NUMBER_MAX)),
        "rotate_degrees": Field("4.13.2", Real(-3600, 3600)),
        "scale_stops": Field("4.13.3", Real(-60, 60, usual=(-4, 4))),
        "method": Field("4.13.4", Offered("methods")),
        "samples": Field("4.13.5", Whole(1, 1048576, usual=(1, 16)), null=True),
        "tone": Field("4.13.6", Offered("tones")),
        "paused": Field("4.13.7", Flag()),
        "exposure_stops": Field("4.13.10", Real(-60, 60, words=("auto", "follow")), null=True),
        "bias_stops": Field("4.13.11", Real(-20, 20)),
        "error": Field("4.13.12", Real(1e-9, 10, usual=(0.05, 10)), null=True),
        "fps": Field("4.13.13", Real(0.01, 1000, usual=(5, 1000))),
        "paths": Field("4.13.14", Offered("paths")),
        "camera": Field("4.13.15", Offered("cameras")),
        "step": Field("4.13.16", Whole(-1000, 1000)),
        "seek": Field("4.13.17", Whole(0, NUMBER_MAX)),
        "hour": Field("4.13.18", Real(0, 24)),
        "lamps": Field("4.13.21", Real(0, 1000000, usual=(0, 4))),
    }, ("control",), role_clause="4.13", stays=NOT_FATAL_IN["control"]),
    "probe": Message("4.15", VIEWERS, {
        "request": Field("4.15.1", Whole(0, NUMBER_MAX)),
        "x": Field("4.15.2", Whole(0, SIDE_MAX - 1)),
        "y": Field("4.15.2", Whole(0, SIDE_MAX - 1)),
        "samples": Field("4.15.3", Whole(1, 256)),
        "preset": Field("4.15.3", Word(("fig1",)), null=True),
        "sky": Field("4.15.4", Flag()),
        "follow": Field("4.15.5", Flag()),
    }, ("probed", "radiance"), stays=NOT_FATAL_IN["probe"]),
}
# Clauses that refuse what each field alone allows: together, or for this server, source or picture.
CONTROL_REFUSED = {"4.13", "4.13.5", "4.13.12", "4.13.16", "4.13.17", "4.13.18", "4.13.19", "4.13.20"}

# ---- Messages from the server: who gets them, and the fields that each has ----

COUNT, REAL, TEXT, LIST, OBJECT, FLAG = "count", "real", "text", "list", "object", "flag"
ANSWERS = {
    "welcome": (ROLES, {"version": OBJECT, "server": TEXT, "session": TEXT, "id": TEXT, "roles": LIST, "formats": LIST,
                        "limits": OBJECT}),
    "subscribed": (VIEWERS, {"request": COUNT, "format": TEXT, "paused": FLAG}),
    "pong": (ROLES, {"id": COUNT, "server_us": COUNT}),
    "status": (ROLES, {"server_us": COUNT, "viewers": COUNT, "sent": COUNT, "skipped": COUNT, "source": OBJECT, "fps": REAL,
                       "stages_ms": OBJECT, "frames": OBJECT, "light": OBJECT, "width": COUNT, "height": COUNT}),
    "error": ((NEW, *ROLES), {"code": TEXT, "clause": TEXT, "message": TEXT, "fatal": FLAG}),
    "credit": ((PRODUCER,), {"frames": COUNT}),
    "frame": ((PRODUCER,), {"number": COUNT, "fate": TEXT}),
    "control": (VIEWERS, {"by": TEXT, "request": COUNT}),
    "sequence": ((RECORDER,), {"name": TEXT, "state": TEXT, "stored": COUNT}),
    "probed": (VIEWERS, {"request": COUNT}),
    "radiance": (VIEWERS, {"x": COUNT, "y": COUNT, "frame": COUNT, "capture_us": COUNT, "finer": FLAG, "radiance": LIST}),
}
FATES = ("used", "superseded", "refused")


def is_kind(value, kind):
    if kind in (COUNT, REAL):
        return isinstance(value, (int, float) if kind == REAL else int) and not isinstance(value, bool) and (kind == REAL or abs(value) <= NUMBER_MAX)
    return isinstance(value, {TEXT: str, LIST: list, OBJECT: dict, FLAG: bool}[kind])


def numbers_of(value):
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [n for part in value for n in numbers_of(part)]
    return [value] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def wrong_answer(state, message):
    """What is wrong with a text of the server to a client in that state, as far as it alone shows; or None."""
    if not isinstance(message, dict) or not isinstance(message.get("op"), str):
        return "not an object with an op"
    op = message["op"]
    if op not in ANSWERS:
        return None  # a later minor version; clients ignore it
    to, fields = ANSWERS[op]
    if state == NEW and op == "welcome":
        to = (NEW,)
    if state not in to:
        return f"{op} to a client in state {state}"
    for name, kind in fields.items():
        if not is_kind(message.get(name), kind):
            return f"{op}.{name} is {message.get(name)!r}"
    if any(not math.isfinite(n) or isinstance(n, int) and abs(n) > NUMBER_MAX for n in numbers_of(message)):
        return f"{op} has a number beyond clause 1.5"
    if op == "error":
        if message["code"] not in ERRORS or message["code"] in IN_FRAME_ONLY:
            return f"an error of code {message['code']!r}"
        if not message["clause"]:
            return "an error without a clause"
    if op == "frame":
        if message["fate"] not in FATES:
            return f"the fate {message['fate']!r}"
        if message["fate"] == "used" and not is_kind(message.get("sequence"), COUNT):
            return "used without sequence (4.11.1)"
        if message["fate"] == "refused" and (message.get("code") not in ERRORS or not message.get("clause")):
            return "refused without code and clause (4.11.1)"
    return None


# ---- The allowed answers to a text ----

@dataclass(frozen=True)
class Allowed:
    """One answer. request: that the error must repeat, None: any."""
    op: str
    code: str = ""
    clause: str = ""
    fatal: bool = True
    match: tuple = ()  # further fields, as (name, value)

    def fits(self, message):
        if message["op"] != self.op:
            return False
        if self.op == "error" and (message["code"], message["clause"], message["fatal"]) != (self.code, self.clause, self.fatal):
            return False
        return all(message.get(name) == value and isinstance(message.get(name), bool) == isinstance(value, bool)
                   for name, value in self.match)


def refusal(code, clause, message=None, fields=None):
    stays = ERRORS[code] is None or (message is not None and code in message.stays)
    match = ()
    if message is not None and message.stays & {"bad_field"}:  # 4.9.2
        request = (fields or {}).get("request", 0)
        match = (("request", request),) if message.fields["request"].has(request) and stays else ()
    return Allowed("error", code, clause, not stays, match)


class Twice(ValueError):
    pass


def parse(data):
    """The JSON object, or the refusals of section 3."""
    def once(pairs):
        if len({key for key, _ in pairs}) < len(pairs):
            raise Twice
        return dict(pairs)

    def no_constant(name):
        raise ValueError(name)

    try:
        text = data.decode()
    except UnicodeDecodeError:
        return None, {refusal("bad_utf8", "3.1"), refusal("bad_json", "3.1")}  # which of two faults is found first is open
    try:
        value = json.loads(text, object_pairs_hook=once, parse_constant=no_constant)
    except (ValueError, RecursionError):
        return None, {refusal("bad_json", "3.1")}
    if not isinstance(value, dict):
        return None, {refusal("bad_json", "3.1")}
    if any(not math.isfinite(n) or isinstance(n, int) and abs(n) > (1 << 63) - 1 for n in numbers_of(value)) or "\\u0000" in text or "\\ud" in text.lower():
        return value, {refusal("bad_json", "3.1")}  # a reader may find no room for it
    return value, set()


def field_faults(message, fields, role=None):
    """The refusals of single fields."""
    faults = set()
    for name, known in message.fields.items():
        if name not in fields and known.required or name in fields and not known.has(fields[name]):
            faults.add(refusal("bad_field", known.clause, message, fields))
    return faults


def role_of(fields):
    """A viewer that names a recorder is one, as before minor version 2 (9.1.1)."""
    return RECORDER if fields.get("role") == VIEWER and "recorder" in fields else fields.get("role")


def hello_faults(fields, offered):
    version, role = fields["version"], role_of(fields)
    faults = set()
    if role == PRODUCER and fields.get("pace") == "lockstep" and "sequence" not in fields:
        faults.add(refusal("bad_field", "4.1.5"))
    if version["major"] != 1:
        faults.add(refusal("bad_version", "4.1.2"))
    if role not in offered:
        faults.add(refusal("wrong_role", "4.1.1"))
    if role == RECORDER and "recorder" not in fields:
        faults.add(refusal("bad_field", "4.1.6"))
    if "recorder" in fields and role != RECORDER:
        faults.add(refusal("wrong_role", "4.1.6"))
    return faults


def probe_faults(message, fields):
    somewhere = "x" in fields or "y" in fields or fields.get("follow") is True
    asks = somewhere or fields.get("sky") is True or "follow" not in fields
    if asks and (somewhere or fields.get("sky") is not True) and not ("x" in fields and "y" in fields):
        return {refusal("bad_field", "4.15.2", message, fields)}
    return set()


def control_faults(message, fields):
    faults = set()
    if fields.get("error") is not None and "error" in fields and fields.get("samples") is not None:
        faults.add(refusal("bad_field", "4.13.12", message, fields))
    if "seek" in fields and "hour" in fields:
        faults.add(refusal("bad_field", "4.13.18", message, fields))
    return faults


@dataclass
class Judgement:
    op: str  # "": none or unknown
    fields: dict
    direct: set  # of Allowed; at most one of them comes, in the order of the messages
    silent: bool  # none may come instead
    later: str = ""  # control or probe: it is answered later, in any order


def judge(state, data, offered):
    """A text message to a server that offers these roles."""
    if len(data) > TEXT_MAX:
        return Judgement("", {}, {refusal("too_big", "3.3")}, False)
    fields, faults = parse(data)
    if fields is None:
        return Judgement("", {}, faults, False)
    op = fields.get("op")
    if not isinstance(op, str):
        return Judgement("", fields, faults | {refusal("bad_field", "3.2")}, False)
    if state == NEW and op != "hello":
        return Judgement(op, fields, faults | {refusal("bad_order", "4.1")}, False)
    message = MESSAGES.get(op)
    if message is not None and state not in message.roles:  # whatever its fields
        return Judgement(op, fields, faults | {refusal("bad_order", "4.1") if op == "hello" else refusal("wrong_role", message.role_clause)},
                         False)
    if message is None:
        return Judgement("", fields, faults | {refusal("unknown_op", "3.4")}, False)
    single = field_faults(message, fields)
    doubtful = bool(faults)
    faults |= single
    if not single or op in NOT_FATAL_IN:
        more = {"hello": lambda: hello_faults(fields, offered), "probe": lambda: probe_faults(message, fields),
                "control": lambda: control_faults(message, fields)}.get(op, set)
        faults |= more()
    if doubtful and len(faults) == 1:  # in the eyes of some readers it is no JSON; in those of others it is
        return Judgement(op, fields, faults | good_answers(op, fields, state), True, op if op in NOT_FATAL_IN else "")
    if faults:  # names that the server does not offer are faults, too
        unknown = {refusal("bad_field", f.clause, message, fields) for n, f in message.fields.items() if n in fields and isinstance(f.value, Offered)}
        return Judgement(op, fields, faults | unknown, False)
    return Judgement(op, fields, good_answers(op, fields, state), op in ("ack", "end", "control", "probe"),
                     op if op in NOT_FATAL_IN else "")


def good_answers(op, fields, state):
    if op == "hello":
        answers = {Allowed("welcome")}
        if role_of(fields) == PRODUCER:
            answers |= {refusal("busy", "4.1.7"), refusal("busy", "4.1.5")}
        elif role_of(fields) == RECORDER:
            answers.add(refusal("busy", "4.1.6"))
        return answers
    if op == "subscribe":
        answer = Allowed("subscribed", match=(("request", fields.get("request", 0)), ("format", fields.get("format")),
                                              ("paused", fields.get("paused", False))))
        unchanged = {refusal("not_offered", "4.3.6")} if state == RECORDER else set()
        return {answer, *unchanged, *({refusal("not_offered", "4.3.1")} if fields.get("format") == "h264" else set())}
    if op == "ping":
        return {Allowed("pong", match=(("id", fields.get("id")),))}
    if op == "ack":
        return {refusal("bad_order", "4.5.1"), *({refusal("bad_field", "4.5.3")} if state == RECORDER else set())}
    return set()


def later_clauses(op, fields):
    """Codes and clauses by which a well-formed control or probe may still be refused."""
    if op == "probe":
        return {("busy", "4.15.5"), ("busy", "4.15.6"), ("not_offered", "4.15.7"), ("bad_field", "4.15.2")}
    clauses = {MESSAGES["control"].fields[name].clause for name in fields if name in MESSAGES["control"].fields}
    return {("busy", "4.13.8"), *(("bad_field", clause) for clause in clauses | CONTROL_REFUSED)}


def probe_asks(fields):
    """Whether a well-formed probe gets an answer."""
    return not ("follow" in fields and not fields["follow"] and not fields.get("sky") and "x" not in fields and "y" not in fields)


# ---- Binary messages (sections 6 and 7): offset, type, field ----

PICTURE = ((0, "4 bytes", "magic"), (4, "u16", "header"), (6, "u8", "format"), (7, "u8", "flags"), (8, "u64", "sequence"),
           (16, "u64", "frame"), (24, "i64", "capture_us"), (32, "i64", "published_us"), (40, "u32", "queued_us"),
           (44, "u32", "decoded_us"), (48, "u32", "shaded_us"), (52, "u32", "encoded_us"), (56, "u32", "width"),
           (60, "u32", "height"), (64, "f32", "gain"), (68, "u32", "samples"), (72, "u32", "payload"), (76, "u32", "zero"))
ENVIRONMENT = ((0, "4 bytes", "magic"), (4, "u16", "header"), (6, "u8", "encoding"), (7, "u8", "layout"), (8, "u8", "flags"),
               (9, "u8", "channels"), (10, "u16", "zero"), (12, "u32", "width"), (16, "u32", "height"), (20, "u32", "payload"),
               (24, "u64", "number"), (32, "i64", "capture_us"), (40, "8 bytes", "zeros"))
LETTERS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i64": "q", "f32": "f", "4 bytes": "4s", "8 bytes": "8s"}


def layout_of(table):
    return struct.Struct("<" + "".join(LETTERS[kind] for _, kind, _ in table)), [name for _, _, name in table]


PICTURE_STRUCT, PICTURE_NAMES = layout_of(PICTURE)
ENVIRONMENT_STRUCT, ENVIRONMENT_NAMES = layout_of(ENVIRONMENT)
FORMAT_NUMBERS = {1: "jpeg", 2: "exr_half", 3: "exr_float", 4: "h264", 5: "changes"}


def wrong_picture(data):
    """(its fields, the violated clause of section 6 or None)."""
    if len(data) < PICTURE_STRUCT.size or data[:4] != b"RLP1":
        return {}, "6.1"
    p = dict(zip(PICTURE_NAMES, PICTURE_STRUCT.unpack_from(data)))
    if p["header"] % 4 or not PICTURE_STRUCT.size <= p["header"] <= 1024:
        return p, "6.2"
    if p["header"] + p["payload"] != len(data) or not p["payload"]:
        return p, "6.3"
    if p["format"] not in FORMAT_NUMBERS:
        return p, "6.4"
    if not (1 <= p["width"] <= SIDE_MAX and 1 <= p["height"] <= SIDE_MAX):
        return p, "6.5"
    if not 1 <= p["sequence"] <= NUMBER_MAX or p["frame"] > NUMBER_MAX or max(abs(p["capture_us"]), abs(p["published_us"])) > NUMBER_MAX \
            or not math.isfinite(p["gain"]) or p["gain"] < 0:
        return p, "6.6"
    return p, None


def frame_faults(data, frame_bytes):
    """The refusals of a binary message to the server that close its producer's connection; empty: it has a fate."""
    if len(data) < 4 or data[:4] != b"RLE1" or len(data) < ENVIRONMENT_STRUCT.size:
        return {refusal("bad_field", "7.1"), *({refusal("too_big", "7.7")} if len(data) > frame_bytes else set())}
    e = dict(zip(ENVIRONMENT_NAMES, ENVIRONMENT_STRUCT.unpack_from(data)))
    faults = set()
    if e["header"] % 4 or not ENVIRONMENT_STRUCT.size <= e["header"] <= 1024:
        faults.add(refusal("bad_field", "7.2"))
    if e["header"] + e["payload"] != len(data) or not e["payload"]:
        faults.add(refusal("bad_field", "7.3"))
    if not 1 <= e["encoding"] <= 4 or e["layout"] > 8:
        faults.add(refusal("bad_field", "7.4"))
    if e["encoding"] in (1, 2):
        if e["width"] or e["height"] or e["channels"]:
            faults.add(refusal("bad_field", "7.5"))
    elif not (1 <= e["width"] <= SIDE_MAX and 1 <= e["height"] <= SIDE_MAX and 3 <= e["channels"] <= 4) or \
            e["width"] * e["height"] * e["channels"] * (2 if e["encoding"] == 3 else 4) != e["payload"]:
        faults.add(refusal("bad_field", "7.5"))
    if e["number"] > NUMBER_MAX or abs(e["capture_us"]) > NUMBER_MAX:
        faults.add(refusal("bad_field", "7.6"))
    if len(data) > frame_bytes or e["header"] + e["payload"] > frame_bytes:
        faults.add(refusal("too_big", "7.7"))
    return faults


if __name__ == "__main__":
    from document import main
    main(sys.argv[1:])
