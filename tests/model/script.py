"""Random scripts: what one run's clients do, step by step, as JSON that can be printed, shortened and replayed.

A step is {"c": client, "do": ..., ...}: open; text (text, or hex for bytes that are no UTF-8; pieces: sizes of fragments); frame
(number, size, encoding, channels, layout, flags, sky, bend: header fields that lie, cut: bytes left out, pieces); raw (hex); sync;
credit and picture (wait shortly for one); leave (code, or none: reset); watch (path: a request over plain HTTP); slow (format: a
viewer that stops reading within an image); others (everyone else gets what is theirs). open, watch and slow come from an address.
In texts "$LAST" stands for the last received picture's sequence, "$SEEN" for the largest; a frame's number is relative to the
client's last one."""

import json
import random

from protocol import (CONTROLLER, ENVIRONMENT_NAMES, FORMATS, MESSAGES, NEW, NUMBER_MAX, PRODUCER, RECORDER, ROLES, SIDE_MAX, TEXT_MAX,
                      VIEWER, Flag, Name, Offered, Real, Text, Version, Whole, Word)
from siege import GREEDY, MAGIC, SKIES, STREAM

NAMES = tuple(f"model-{i}" for i in range(6))  # of lockstep sequences
STRANGE = (None, True, False, 0, -1, 1, 1.5, 1.0, "", "1", "x" * 300, [], {}, [1], NUMBER_MAX, NUMBER_MAX + 1, -NUMBER_MAX - 1, 1 << 63,
           1 << 70, 1e300, -1e300, "\u0000", "\u00e9\u4e16", {"major": 1}, [[[[]]]])
BAD_TEXTS = (b"", b"{", b"[]", b"null", b'"op"', b"{}", b'{"op":7}', b'{"op":"ping","op":"ping","id":1}', b'{"op":"ping","id":1,"id":1}',
             b'{"op":"ping","id":NaN}', b'{"op":"ping","id":1e999}', b'{"op":"ping","id":01}', b'{"op":"ping","id":1}\0',
             b'{"op":"ping","id":1}{}', b"\xef\xbb\xbf{}", b'{"op":"pi\xffng"}', b'{"op":"\\ud800"}', b"[" * 3000, b'{"a":' * 2500,
             b"{'op':'ping'}", b'{"op":"ping","id":1,}', b'{"op":"ping","x":"\xed\xa0\x80","id":1}', b'{"op":"p\\u0069ng","id":3}')
RAW = ("83805a17c388", "8b805a17c388", "89fe00805a17c388" + "00" * 128, "80805a17c388", "09805a17c388", "8882000000000003", "88810000000001",
       "c1805a17c388", "82ff80000000000000005a17c388", "81fe")


class Writer:
    def __init__(self, seed, offered, offers, producing):
        self.draw = random.Random(seed)
        self.offered, self.offers, self.producing = offered, offers, producing
        self.steps = []
        self.requests = 0

    def chance(self, share):
        return self.draw.random() < share

    def add(self, client, do, **more):
        self.steps.append({"c": client, "do": do, **more})

    # ---- Values ----

    def good(self, value):
        d = self.draw
        if isinstance(value, Whole):
            least, most = value.usual if value.usual and not self.chance(0.05) else (value.least, value.most)
            return d.choice((least, most, d.randint(least, most), d.randint(least, min(most, least + 100))))
        if isinstance(value, Real):
            least, most = value.usual if value.usual and not self.chance(0.05) else (value.least, value.most)
            return d.choice((most, least + (most - least) * (0.001 + 0.999 * d.random()), max(1, round(least))))
        if isinstance(value, Flag):
            return self.chance(0.5)
        if isinstance(value, Word):
            return d.choice(value.words)
        if isinstance(value, Offered):
            return d.choice(self.offers.get(value.of) or ["auto"])
        if isinstance(value, Name):
            return d.choice(NAMES)
        if isinstance(value, Text):
            return "x" * d.choice((0, 1, 20, value.most))
        return {"major": 1, "minor": d.choice((0, 1, 2, 9, 65535))} if isinstance(value, Version) else None

    def bad(self, value):
        d = self.draw
        near = []
        if isinstance(value, (Whole, Real)):
            near = [value.least - 1, value.most + 1, value.most * 2 + 1, str(value.least)]
        elif isinstance(value, (Word, Offered, Name)):
            near = ["nobody", "JPEG", "a b", "\u00fc", "x" * 65, "../x"]
        elif isinstance(value, Text):
            near = ["x" * (value.most + 1)]
        elif isinstance(value, Version):
            near = [{"major": 2}, {"major": 0}, {"major": 65536}, {"minor": 1}, {"major": 1, "minor": -1}, {"major": "1"}, 1, [1, 0]]
        return d.choice(near) if near and self.chance(0.6) else d.choice(STRANGE)

    def message(self, op, **fixed):
        """Mostly a right message; sometimes with a wrong, missing or unknown field."""
        fields, known = {"op": op}, MESSAGES[op].fields
        for name, f in known.items():
            if name in fixed:
                fields[name] = fixed[name]
            elif name == "request":
                self.requests += 1
                if self.chance(0.9):
                    fields[name] = self.requests
            elif f.required or self.chance(0.25 if op != "control" else 0.12):
                fields[name] = None if f.null and self.chance(0.3) else self.good(f.value)
        fields = {name: value for name, value in fields.items() if value is not ...}
        if known and self.chance(0.12):
            name = self.draw.choice(list(known))
            if self.chance(0.25):
                fields.pop(name, None)
            elif op != "hello" or name not in ("role", "recorder", "sequence", "pace") or self.producing or self.chance(0.5):
                fields[name] = self.bad(known[name].value)
        if self.chance(0.05):
            fields[self.draw.choice(("new", "colour", "", "Op"))] = self.draw.choice(STRANGE)
        return fields

    def text(self, client, fields, pieces=None):
        text = json.dumps(fields, ensure_ascii=self.chance(0.5))
        if self.chance(0.01):
            text = text.ljust(self.draw.choice((TEXT_MAX - 1, TEXT_MAX, TEXT_MAX + 1, 2 * TEXT_MAX)))
        if pieces is None and self.chance(0.04):
            pieces = sorted(self.draw.randrange(1, 40) for _ in range(self.draw.randint(1, 6))) + [0]
        self.add(client, "text", text=text, **({"pieces": pieces} if pieces else {}))

    # ---- What clients do ----

    def hello(self, client, role):
        fixed = {"role": role, "token": ..., "pace": ..., "sequence": ..., "recorder": ...}
        if role == PRODUCER and self.chance(0.5):
            fixed.update(pace="lockstep", sequence=self.draw.choice(NAMES[:2]))
        if role == RECORDER:
            fixed.update(role=self.draw.choice((VIEWER, RECORDER)), recorder=self.draw.choice(NAMES[:2]))
        if self.chance(0.1):
            del fixed["token"]
        self.text(client, self.message("hello", **fixed))

    def subscribe(self, client):
        fixed = {"format": "jpeg"} if self.chance(0.5) else {}
        self.text(client, self.message("subscribe", **fixed))

    def ack(self, client, role):
        sequence = self.draw.choice(("$LAST", "$LAST", "$LAST", "$SEEN", "$LAST-1", "$SEEN+1", 1, 1 << 40, NUMBER_MAX))
        stored = {"stored": True} if role == RECORDER and self.chance(0.9) else {"stored": ...}
        self.text(client, self.message("ack", sequence=sequence, **stored))

    def frame(self, client):
        d = self.draw
        how = {"number": d.choice((1, 1, 1, 1, 2, 0, -1, -5, 1000))}
        if self.chance(0.3):
            how["size"] = d.choice(((8, 4), (2, 1), (16, 8), (1, 6), (4, 3), (3, 3), (64, 32)))
            how["channels"] = d.choice((3, 4))
            how["encoding"] = d.choice((3, 4))
            how["layout"] = d.randint(0, 8)
            how["flags"] = d.choice((0, 1, 254, 255))
        elif self.chance(0.3):
            how["encoding"] = d.choice((1, 2))
            how["file"] = d.choice(("junk", "head", "empty"))
        if how.get("encoding", 4) > 2 and self.chance(0.5):
            how["sky"] = d.choice(SKIES)
        if self.chance(0.15):
            name = d.choice(ENVIRONMENT_NAMES)
            how["bend"] = {name: d.choice((0, 1, 2, 255, 65535, 1 << 31, (1 << 32) - 1, (1 << 53), (1 << 64) - 1, d.getrandbits(16)))}
        if self.chance(0.05):
            how["cut"] = d.choice((1, 4, 40, 48, 60, -1))
        if self.chance(0.2):
            how["pieces"] = d.choice((2, 3, 10))
        self.add(client, "frame", **how)

    def pixel(self, client):
        self.text(client, self.message("probe", x=self.draw.randrange(66), y=self.draw.randrange(38)))

    def watch(self, client, path=None, source=None):
        path = path or self.draw.choice((*MAGIC, STREAM)) + self.draw.choice(("", f"?width={self.draw.randint(16, 70)}", "?width=" + self.draw.choice(
            ("0", "15", "16384", "16385", "-1", "+17", "64x", "1e3", "", "99999999999999999999"))))
        self.add(client, "watch", path=path, source=source or self.draw.choice(GREEDY))

    def act(self, client, role):
        """One step of a client in that role, or of any other role."""
        chance = self.draw.random()
        if chance < 0.03:
            role = self.draw.choice([r for r in ROLES if r in self.offered])
        if chance > 0.985:
            self.hello(client, VIEWER)
        elif chance > 0.97:
            self.add(client, "text", hex=self.draw.choice(BAD_TEXTS).hex())
        elif chance > 0.95:
            self.text(client, {"op": self.draw.choice(("dance", "welcome", "pong", "Ping", "ping ", "", "\u00e9" * 30, "x" * 5000))})
        elif chance > 0.93:
            self.text(client, self.message("ping"))
        elif role == PRODUCER:
            kind = self.draw.random()
            if kind < 0.6:
                self.add(client, "credit")
                self.frame(client)
            elif kind < 0.7:
                self.frame(client)
            else:
                self.text(client, self.message("ping" if kind < 0.85 else "end"))
        else:
            ops = {VIEWER: ("subscribe", "ack", "ack", "ack", "ping", "probe"), RECORDER: ("subscribe", "ack", "ack", "ack", "ping"),
                   CONTROLLER: ("control", "control", "control", "subscribe", "ack", "ack", "ping", "probe")}[role]
            op = self.draw.choice(ops)
            if op == "subscribe":
                self.subscribe(client)
            elif op == "ack":
                if self.chance(0.3):
                    self.add(client, "picture")
                self.ack(client, role)
            else:
                if op == "probe" and self.chance(0.8):
                    for _ in range(self.draw.choice((1, 1, 3))):  # of one image and, mostly, of one under another sky
                        self.pixel(client)
                        self.add(client, "picture")
                else:
                    self.text(client, self.message(op))

    def flood(self, client):
        op = self.draw.choice(("dance", "ping", "subscribe"))
        for i in range(self.draw.choice((30, 40, 60, 230))):
            self.add(client, "text", text=json.dumps({"op": op, "id": i, "format": "jpeg"}))

    def script(self):
        roles = [r for r in (VIEWER, VIEWER, CONTROLLER) if r == VIEWER or r in self.offered]
        if self.producing:
            roles += [PRODUCER, PRODUCER, *([RECORDER, RECORDER] if RECORDER in self.offered else [])]
        clients = [self.draw.choice(roles) for _ in range(self.draw.choice((1, 1, 2, 3)))]
        if self.producing and RECORDER in self.offered and self.chance(0.3):
            clients = [RECORDER, PRODUCER]
        for client, role in enumerate(clients):
            self.add(client, "open")
            if self.chance(0.04):
                self.act(client, role)
            elif self.chance(0.97):
                self.hello(client, role)
                if role != PRODUCER and self.chance(0.7):
                    self.subscribe(client)
        for _ in range(self.draw.choice((4, 10, 25, 50))):
            client = self.draw.randrange(len(clients))
            self.act(client, clients[client])
            if self.chance(0.15):
                self.add(client, "sync")
        for k in range(self.draw.choice((1, 3, 9)) if self.chance(0.15) else 0):
            self.steps.insert(self.draw.randrange(len(self.steps) + 1), None)
        for at in [i for i, step in enumerate(self.steps) if step is None]:
            self.watch(f"http {at}")
            self.steps[at] = self.steps.pop()
        client = self.draw.randrange(len(clients))
        if self.chance(0.02):
            self.flood(client)
        if self.chance(0.02):
            self.add(client, "raw", hex=self.draw.choice(RAW))
        for client in range(len(clients)):
            if self.chance(0.3):
                self.add(client, "leave", **({"code": 1000} if self.chance(0.5) else {}))
        return self.steps

    def siege(self, slow):
        """Two addresses take what all share, by streams of many widths, questions and viewers that do not read. slow: only by these."""
        d, parties = self.draw, []

        def party(write, *arguments):
            self.steps = []
            write(f"greedy {len(parties)}", *arguments)
            parties.append(self.steps)

        def ask(client):
            self.add(client, "open", source=d.choice(GREEDY))
            self.text(client, {"op": "hello", "role": VIEWER, "version": {"major": 1, "minor": 1}})
            for _ in range(d.randint(1, 5)):
                self.pixel(client)

        def sleep(client):
            self.add(client, "slow", format=d.choice(FORMATS[:3]) if not slow else "exr_float", source=GREEDY[0] if slow else d.choice(GREEDY))

        for k in range(0 if slow else d.randint(6, 16)):  # each width is that of one address
            party(self.watch, f"{d.choice((*MAGIC, STREAM, STREAM))}?width={18 + 2 * d.randrange(20) + k % 2}", GREEDY[k % 2])
        for _ in range(0 if slow else 70 if self.chance(0.1) else d.choice((2, 4, 8))):
            party(ask)
        for _ in range(slow or d.choice((0, 2, 6))):
            party(sleep)
        if slow == 0 and CONTROLLER in self.offered:
            self.steps = []
            self.add("dark", "open", source=d.choice(GREEDY))
            self.text("dark", {"op": "hello", "role": CONTROLLER, "version": {"major": 1, "minor": 1}})
            for k in range(d.randint(1, 4)):
                self.text("dark", {"op": "control", "request": k + 1, "scale_stops": d.choice((-60, -4, 0, 4)), "rotate_degrees": d.randint(0, 360)})
            parties.append(self.steps)
        d.shuffle(parties)
        self.steps = []
        for k, steps in enumerate(parties):
            self.steps += steps
            if k + 1 == len(parties) or self.chance(1 / len(parties)):
                self.add("all", "others")
        return self.steps


def write_siege(seed, offered, slow):
    return Writer(seed, offered, {}, False).siege(slow)


def write(seed, offered, offers, producing):
    return Writer(seed, offered, offers, producing).script()
