"""A client that sends what a script says, right or wrong, and holds every answer to the state model of protocol.py."""

import asyncio
import json
import socket
import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "faults"))

from faults import BINARY, CLOSE, MORE, PING, PONG, TEXT, frame  # noqa: E402
from protocol import (CONTROLLER, CREDIT, CREDIT_H264, ERRORS, FORMAT_NUMBERS, FRAGMENTS_MAX, NEW, PRODUCER, RECORDER, VIEWER, Allowed,  # noqa: E402
                      frame_faults, is_kind, judge, later_clauses, probe_asks, refusal, role_of, wrong_answer, wrong_picture)

SYNC_FROM = 1 << 40  # ids of our own pings
AT_ONCE = 150  # messages after which a server may find that too many answers wait unread (2.5)
IN_ALL = 180  # and that too many came at once
UNREAD = 5  # after so many a ping may go unanswered (4.7.2)
HANDSHAKE = ("GET {path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
             "Sec-WebSocket-Key: c2l4dGVlbiBieXRlcyAhIQ==\r\nSec-WebSocket-Protocol: relight.v1\r\n\r\n")
# What may end any connection at any time, whatever it sent.
ALWAYS = {refusal("no_hello", "4.1"), refusal("busy", "4.1.6"), refusal("superseded", "4.1.7"), refusal("stalled", "2.6"),
          refusal("full", "2.4")}


class Finding(Exception):
    """The server does what the model does not allow. kind: the same for the same fault, with other numbers."""

    def __init__(self, kind, detail=""):
        super().__init__(f"{kind}: {detail}" if detail else kind)
        self.kind = kind


class Entry:
    """A sent message whose direct answer has not come yet."""

    def __init__(self, label, allowed, silent, number):
        self.label, self.allowed, self.silent, self.number = label, allowed, silent, number
        self.twin = None  # the probe that may have been answered in its place


class Control:
    """A well-formed control message that is answered later."""

    def __init__(self, request, fields, sent):
        self.request, self.fields, self.sent = request, fields, sent
        self.must = True  # its answer must come
        self.twin = None  # the entry that may have been answered in its place


class Client:
    def __init__(self, run, name):
        self.run, self.name = run, name
        self.buffer = bytearray()
        self.upgraded = self.gone = self.left = self.malformed = False
        self.state, self.id = NEW, None
        self.queue = []
        self.sent = self.since_sync = self.synced = self.received = 0
        self.fatal = None  # the error after which only a close may come
        self.close_code = None
        self.finding = None
        self.parts = None  # fragments of a message of the server
        self.event = asyncio.Event()
        # a viewer
        self.wishes = []  # subscribe messages without answer
        self.wish = None  # the one in force
        self.unacked = self.pictures = 0
        self.newest = {}  # sequence by format; its maximum over all formats is `seen`
        self.seen = self.last = 0
        self.followed = False
        self.controls, self.refused = [], set()
        self.probes = []
        # a producer
        self.sequence, self.credit, self.credit_most, self.frame_bytes = None, 0, 0, 0
        self.resume_after = None
        self.number = 0
        self.paused = False
        self.numbers = set()
        self.fates = {}  # number -> frames without fate; (good, known fate)

    # ---- The socket ----

    async def open(self, host, port, source=None):
        """Not a transport of asyncio: after a reset by the server that would lose what had arrived before."""
        self.loop = asyncio.get_running_loop()
        self.socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        self.socket.setblocking(False)
        if source and host.startswith("127."):
            self.socket.bind((source, 0))
        self.unsent = b""
        await self.loop.sock_connect(self.socket, (host, port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.loop.add_reader(self.socket, self.readable)
        self.write(HANDSHAKE.format(path=self.run.path, host=self.run.host).encode())

    def readable(self):
        try:
            data = self.socket.recv(1 << 18)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.data_received(data)
        else:
            self.connection_lost()

    def write(self, data):
        if self.gone:
            return
        waits = bool(self.unsent)
        self.unsent += data
        if not waits:
            self.flush()

    def flush(self):
        try:
            self.unsent = self.unsent[self.socket.send(self.unsent):]
        except BlockingIOError:
            pass
        except OSError:
            self.unsent = b""  # what has arrived is still to be read
        if self.unsent:
            self.loop.add_writer(self.socket, self.flush)
        else:
            self.loop.remove_writer(self.socket)

    def abort(self):
        if not self.gone:
            self.gone = True
            self.loop.remove_reader(self.socket)
            self.loop.remove_writer(self.socket)
            self.socket.close()
        self.event.set()

    def connection_lost(self):
        self.abort()
        # Who goes on sending after a fatal error may not get to read it: TCP breaks the connection (section 8).
        late = self.since_sync > AT_ONCE or self.sent > IN_ALL or any(a.op == "error" and a.fatal for e in self.queue[:-1] for a in e.allowed)
        if not (self.left or self.malformed or self.close_code or self.finding or late):
            self.found("cut without a close frame", f"after {self.sent} messages, {self.received} frames received; fatal was {self.fatal}")
        self.event.set()

    def data_received(self, data):
        self.buffer += data
        try:
            if not self.upgraded and not self.upgrade():
                return
            while self.take_frame():
                pass
        except Finding as finding:
            self.fail(finding)
        self.event.set()

    def fail(self, finding):
        self.finding = self.finding or finding
        self.event.set()

    def found(self, kind, detail=""):
        self.fail(Finding(kind, f"{self.name} ({self.state}): {detail}"))

    def upgrade(self):
        end = self.buffer.find(b"\r\n\r\n")
        if end < 0:
            return False
        if not self.buffer.startswith(b"HTTP/1.1 101 "):
            raise Finding("no handshake", bytes(self.buffer[:60]).decode(errors="replace"))
        del self.buffer[:end + 4]
        self.upgraded = True
        return True

    def take_frame(self):
        b = self.buffer
        if len(b) < 2:
            return False
        size, at = b[1] & 127, 2
        if size == 126:
            size, at = int.from_bytes(b[2:4], "big"), 4
        elif size == 127:
            size, at = int.from_bytes(b[2:10], "big"), 10
        if len(b) < at or len(b) < at + size:
            return False
        if b[1] & 128:
            raise Finding("a masked frame of the server")
        op, final, payload = b[0] & 15, b[0] & 128, bytes(b[at:at + size])
        del b[:at + size]
        self.run.received += 1
        self.received += 1
        if op == PING:
            self.write(frame(PONG, payload))
        elif op == CLOSE:
            self.on_close(payload)
        elif op in (TEXT, BINARY, MORE):
            if op != MORE:
                self.parts = [op]
            self.parts.append(payload)
            if final:
                kind, *parts = self.parts
                self.parts = None
                (self.on_text if kind == TEXT else self.on_picture)(b"".join(parts))
        return True

    async def until(self, done, most_s):
        """Whether done() became true; ends early when the connection does. Raises what was found."""
        end = asyncio.get_running_loop().time() + most_s
        while not done():
            if self.finding:
                raise self.finding
            left = end - asyncio.get_running_loop().time()
            if self.gone or left <= 0:
                return done()
            self.event.clear()
            try:
                await asyncio.wait_for(self.event.wait(), left)
            except asyncio.TimeoutError:
                pass
        if self.finding:
            raise self.finding
        return True

    # ---- Sending ----

    def speaks(self):
        return self.upgraded and not (self.gone or self.left or self.fatal or self.malformed)

    def expect(self, label, allowed, silent):
        self.queue.append(Entry(label, allowed, silent, self.sent))
        self.sent += 1
        self.since_sync += 1
        self.run.sent += 1

    def send_text(self, data, pieces=None, label=None):
        """Judges the text in the state in which the server will read it, if all before it was right."""
        state = self.state if not self.hello_sent() else self.state_after_hello
        verdict = judge(state, data, self.run.offered)
        allowed, silent = set(verdict.direct), verdict.silent
        clean = not any(a.op == "error" and a.code == "bad_json" for a in allowed)
        if verdict.op == "ack" and silent and clean:
            allowed, silent = self.judge_ack(verdict.fields, allowed)
        elif verdict.op == "ack" and silent:
            self.waiting = []  # whether it counts is open
        if verdict.op == "ping" and self.since_sync + len(self.controls) + len(self.probes) + 2 * len(self.fates) >= UNREAD:
            silent = True
        if pieces and len(pieces) > FRAGMENTS_MAX:
            allowed, silent = {refusal("too_big", "3.3")}, False
        if clean and silent and verdict.later == "control":
            self.controls.append(Control(verdict.fields.get("request", 0), verdict.fields, self.sent))
        elif clean and silent and verdict.later == "probe" and probe_asks(verdict.fields):
            self.probes.append({**verdict.fields, "sent": self.sent, "twin": None})
        if verdict.op == "probe" and verdict.fields.get("follow") is True:
            self.followed = True
        if verdict.op == "hello" and any(a.op == "welcome" for a in allowed):
            fields = verdict.fields
            self.state_after_hello = role_of(fields)
            self.hello_queued = True
            if fields["role"] == PRODUCER:
                self.sequence = fields["sequence"] if fields.get("pace") == "lockstep" else None
        if verdict.op == "subscribe" and any(a.op == "subscribed" for a in allowed):
            self.wishes.append(verdict.fields)
        self.expect(label or data[:200], allowed, silent)
        if pieces:
            at, parts = 0, []
            for i, size in enumerate(pieces):
                last = i + 1 == len(pieces)
                parts.append(frame(TEXT if i == 0 else MORE, data[at:] if last else data[at:at + size], fin=last))
                at += size
                if i == 0 and not last:
                    parts.append(frame(PING, b"between"))
            self.write(b"".join(parts))
        else:
            self.write(frame(TEXT, data))

    hello_queued = False
    state_after_hello = NEW

    def hello_sent(self):
        return self.hello_queued and self.state == NEW

    def judge_ack(self, fields, allowed):
        """4.5.1: what was received may be acknowledged, now and later; what cannot have been sent may not."""
        bad_order = refusal("bad_order", "4.5.1")
        if fields["sequence"] <= self.seen:
            allowed = allowed - {bad_order}
            self.unacked = sum(n > fields["sequence"] for n in self.waiting) if self.waiting else 0
            self.waiting = [n for n in self.waiting if n > fields["sequence"]]
            # It also counts for the same picture of another kind, which may be on its way.
            self.ahead = max(self.ahead, fields["sequence"])
        elif fields["sequence"] >= 1 << 40:
            return {bad_order}, False
        else:  # it counts if that picture is on its way
            self.ahead, self.waiting = max(self.ahead, fields["sequence"]), []
        return allowed, True

    waiting = ()
    ahead = 0  # acknowledged before it was received

    def send_frame(self, data, number, good, pieces=1):
        """A binary message; good: a frame that can be used."""
        state = self.state_after_hello if self.hello_sent() else self.state
        if state != PRODUCER:
            self.expect(b"a binary message", {refusal("wrong_role", "3.5")}, False)
        else:
            faults = frame_faults(data, self.frame_bytes or 1 << 28)
            if self.credit <= 0:
                faults = faults | {refusal("no_credit", "5.7")}
            if not faults or self.credit <= 0:
                if number in self.numbers:  # of two frames of one number nobody can tell which fate is whose
                    good, self.fates[number] = False, [(False, known) for _, known in self.fates.get(number, [])]
                self.fates.setdefault(number, []).append((good, self.run.known_fates.get((self.sequence, number))))
                self.numbers.add(number)
            self.credit -= 1
            self.expect(b"a frame", faults, self.credit < 0 or not faults)
        step = max(1, -(-len(data) // pieces))
        cuts = [data[i:i + step] for i in range(0, len(data), step)] or [b""]
        self.write(b"".join(frame(BINARY if i == 0 else MORE, part, fin=i + 1 == len(cuts)) for i, part in enumerate(cuts)))

    def send_raw(self, data):
        """Bytes that break RFC 6455: the connection ends, with 1002 or without a code (section 8)."""
        self.malformed = True
        self.run.sent += 1
        self.write(data)

    def leave(self, code=None):
        """With a close frame, or by a reset."""
        if self.gone:
            return
        self.left = True
        if code:
            self.write(frame(CLOSE, struct.pack(">H", code)))
            return
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.abort()

    # ---- Waiting ----

    async def sync(self, most_s):
        """Waits until the server has read everything: then every direct answer has come."""
        while self.speaks():
            self.run.pings += 1
            number = SYNC_FROM + self.run.pings
            self.expect(b"our ping", {Allowed("pong", match=(("id", number),))} if self.state != NEW or self.hello_sent()
                        else {refusal("bad_order", "4.1")}, True)
            self.write(frame(TEXT, b'{"op":"ping","id":%d}' % number))
            wait_s = min(2.0, most_s)
            if await self.until(lambda n=number: self.synced >= n or self.fatal or self.malformed, wait_s) and self.synced >= number:
                self.since_sync = 0
                return
            most_s -= wait_s
            if most_s <= 0 and self.speaks():
                raise Finding("no answer to a ping", self.name)
        if self.fatal and not self.left and not await self.until(lambda: self.close_code or self.gone, most_s):
            raise Finding("not closed after a fatal error", f"{self.name}: {self.fatal}")
        if self.finding:
            raise self.finding

    async def settle(self, most_s):
        """At the end: everything that is answered later has been answered."""
        await self.sync(most_s)

        def settled():
            frames = self.fates and not self.paused  # a paused source takes none
            return not self.speaks() or not (any(c.must for c in self.controls) or self.probes or frames)

        if not await self.until(settled, most_s) and self.speaks():
            raise Finding("never answered", f"{self.name}: controls {[c.request for c in self.controls if c.must]}, probes {self.probes}, frames {list(self.fates)}")

    # ---- Receiving ----

    def on_close(self, payload):
        code = struct.unpack(">H", payload[:2])[0] if len(payload) >= 2 else 1005
        if self.close_code is None and not self.left:
            wanted = {ERRORS[self.fatal["code"]]} if self.fatal else {1001}
            if self.malformed:
                wanted |= {1002, 1005, 1007}
            if not self.fatal and any(a.code == "bad_utf8" for e in self.queue for a in e.allowed):
                wanted.add(1007)
            if self.parts and not self.fatal:  # within a picture no text can be sent, so the close frame comes alone
                wanted |= {ERRORS[a.code] for e in self.queue for a in e.allowed if a.op == "error" and a.fatal}
                wanted |= {ERRORS[a.code] for a in ALWAYS} | ({4010} if self.since_sync > AT_ONCE or self.sent > IN_ALL else set())
            if code not in wanted:
                raise Finding(f"closed with {code}", f"{self.name}: {payload[2:]!r}; fatal was {self.fatal}")
            if self.fatal and code == ERRORS[self.fatal["code"]] and f"clause {self.fatal['clause']}".encode() not in payload[2:]:
                raise Finding("a close reason without its clause", repr(payload[2:]))
        self.close_code = code
        self.write(frame(CLOSE, payload[:2]))

    def on_text(self, data):
        try:
            message = json.loads(data)
        except ValueError:
            raise Finding("a text that is no JSON", repr(data[:80])) from None
        if self.left:
            return
        state = self.state
        wrong = wrong_answer(state, message)
        if wrong:
            raise Finding(wrong, repr(data[:300]))
        if self.fatal:
            raise Finding(f"{message['op']} after a fatal error", f"{message} after {self.fatal}")
        handler = getattr(self, f"on_{message['op']}", None)
        if handler:
            handler(message)

    def answered_entry(self, message):
        """The index of the sent message that this answers; those before it may have no answer. None: there is none."""
        for i, entry in enumerate(self.queue):
            if any(a.fits(message) for a in entry.allowed):
                return i
            if not entry.silent:
                return None
        return None

    def direct(self, message):
        """Takes the sent message that this answers, and those before it, from the queue. None: there is none."""
        i = self.answered_entry(message)
        if i is None:
            return None
        entry = self.queue[i]
        del self.queue[:i + 1]
        if entry.twin in self.probes:
            self.probes.remove(entry.twin)
        elif entry.twin in self.controls:
            self.answered(self.controls.index(entry.twin))
        return entry

    def either_of_two(self, message):
        """Whether this refuses a message of the queue or an older one of the same number that is answered later: nobody
        can tell which, so both stay, as twins. The next answer to one of them settles both."""
        i = self.answered_entry(message)
        if i is None or message["clause"] == "4.15.5":
            return False
        entry, said = self.queue[i], (message["code"], message["clause"])
        for probe in self.probes:
            if probe.get("request", 0) == message.get("request") and probe["sent"] < entry.number and not (entry.twin or probe["twin"]) and (
                    said in later_clauses("probe", probe)):
                entry.twin, probe["twin"], entry.silent = probe, entry, True
                return True
        for control in self.controls:
            if control.request == message.get("request") and control.must and control.sent < entry.number and not (
                    entry.twin or control.twin) and said in later_clauses("control", control.fields):
                entry.twin, control.twin, entry.silent = control, entry, True
                return True
        return False

    def probe_answered(self, probe):
        self.probes.remove(probe)
        if probe["twin"] in self.queue:
            self.queue.remove(probe["twin"])

    def unexpected(self, message):
        first = next((e for e in self.queue if not e.silent), self.queue[0] if self.queue else None)
        what = f"{message['code']} ({message['clause']})" if message["op"] == "error" else message["op"]
        allowed = sorted({f"{a.code or a.op} ({a.clause})" for a in first.allowed}) if first else []
        label = first.label if first else b"nothing"
        op = (json.loads(label).get("op") if label[:1] == b"{" and label[-1:] == b"}" and b"\\" not in label else "") if first else ""
        raise Finding(f"unexpected {what} to {state_word(self.state)}", f"{self.name}: {message} came after {label!r} {op or ''}, "
                      f"allowed: {allowed}")

    def on_welcome(self, message):
        if not self.direct(message):
            self.unexpected(message)
        self.state, self.id = self.state_after_hello, message["id"]
        self.waiting = []
        if self.state == PRODUCER:
            producer = message.get("producer")
            if not isinstance(producer, dict) or not is_kind(producer.get("credit"), "count"):
                raise Finding("welcome without producer (4.2.4)")
            self.credit += producer["credit"]
            self.credit_most = 1 if self.sequence else CREDIT
            self.frame_bytes, self.resume_after = producer["frame_bytes"], producer["resume_after"]
            self.number = max(self.number, (self.resume_after or 0))
            if not self.sequence and self.resume_after is not None:
                raise Finding("a live producer is told resume_after (4.2.4)")
        elif self.state == RECORDER and "recorder" not in message:
            raise Finding("welcome without recorder (4.2.5)")

    def on_subscribed(self, message):
        if not self.direct(message):
            self.unexpected(message)
        while self.wishes:
            wish = self.wishes.pop(0)
            if (wish.get("request", 0), wish["format"], wish.get("paused", False)) == (message["request"], message["format"],
                                                                                      message["paused"]):
                break
        kind = {n: wish.get(n) for n in ("format", "max_rate", "max_width", "max_height")}
        if self.wish is None or kind != {n: self.wish.get(n) for n in kind}:
            self.waiting = []
        self.newest.clear()
        self.wish = wish

    def on_pong(self, message):
        if not self.direct(message):
            self.unexpected(message)
        if SYNC_FROM < message["id"] <= SYNC_FROM + self.run.pings:  # a script may send a ping of any id
            self.synced = message["id"]

    def on_error(self, message):
        fatal = ERRORS[message["code"]] is not None and message["fatal"]
        if ERRORS[message["code"]] is None and message["fatal"]:
            raise Finding(f"{message['code']} is fatal")
        loose = refusal("too_fast", "2.5")
        if not any(takes(message) for takes in (self.either_of_two, self.direct, self.later_error)) and not any(
                a.fits(message) for a in ALWAYS) and not (loose.fits(message) and (self.since_sync > AT_ONCE or self.sent > IN_ALL)):
            self.unexpected(message)
        if fatal:
            self.fatal = message

    def later_error(self, message):
        """A well-formed control or probe is refused."""
        if message["fatal"] or not is_kind(message.get("request"), "count"):
            return False
        request, said = message["request"], (message["code"], message["clause"])
        # Of several without a number, one whose answer must come.
        for i in sorted(range(len(self.controls)), key=lambda n: not self.controls[n].must):
            if self.controls[i].request == request and any(said in later_clauses("control", c.fields) for c in self.controls[:i + 1]):
                self.answered(i)
                self.refused.add(request)
                return True
        for probe in self.probes:
            if probe.get("request", 0) == request and said in later_clauses("probe", probe):
                self.probe_answered(probe)
                return True
        return message["clause"] == "4.15.5"  # the answer to the question comes nevertheless

    def on_control(self, message):
        if message["by"] != self.id:
            return
        request = message["request"]
        if request in self.refused and request != 0:
            raise Finding("a control has the number of a refused request (4.13.8)", f"{message}")
        for i in reversed(range(len(self.controls))):
            if self.controls[i].request == request:
                self.answered(i)
                break

    def answered(self, i):
        """Those before it in a row may have been taken as one with it, or are still to be answered. Of several without
        a number it may have been the last."""
        control = self.controls[i]
        last = max(k for k, other in enumerate(self.controls) if other.request == control.request)
        for other in self.controls[:last + 1]:
            other.must = False
        del self.controls[i]
        if control.twin in self.queue:
            self.queue.remove(control.twin)

    def on_probed(self, message):
        for probe in self.probes:
            if probe.get("request", 0) == message["request"]:
                self.probe_answered(probe)
                return
        raise Finding("probed without a probe", f"{message['request']}")

    def on_status(self, message):
        self.paused = message["source"].get("state") == "paused"

    def on_radiance(self, _):
        if not self.followed:
            raise Finding("radiance to one who follows no pixel")

    def on_credit(self, message):
        self.credit += message["frames"]
        if message["frames"] < 1 or self.credit > self.credit_most:
            raise Finding("too much credit (5.7, 5.8)", f"{self.name}: {message['frames']} more make {self.credit}")

    def on_frame(self, message):
        number, fate = message["number"], message["fate"]
        if self.sequence and fate == "superseded":
            raise Finding("superseded in lockstep (4.11.2)")
        waiting = self.fates.get(number)
        if not waiting:
            if not self.sequence or number > (-1 if self.resume_after is None else self.resume_after):
                raise Finding("the fate of a frame that was not sent", f"{self.name}: {message}")
            return
        good, known = waiting.pop(0)
        if not waiting:
            del self.fates[number]
        if self.sequence:
            late = self.resume_after is not None and number <= self.resume_after
            if known and known != fate:
                raise Finding("a repeated frame is told another fate (5.8)", f"{message}; before: {known}")
            if not known and not late and not message.get("clause") == "5.8":
                self.run.known_fates[self.sequence, number] = fate
        else:
            late = False
        if good and fate == "refused" and not known and not late and message.get("clause") != "5.8":
            raise Finding("a good frame is refused", f"{message}")

    def on_sequence(self, message):
        if message["state"] != "ended":
            raise Finding("sequence that has not ended (4.14)")

    def on_picture(self, data):
        p, clause = wrong_picture(data)
        if clause:
            raise Finding(f"a picture that violates {clause}")
        if self.left:
            return
        if self.fatal:
            raise Finding("a picture after a fatal error")
        form = FORMAT_NUMBERS[p["format"]]
        wished = {w["format"] for w in [*self.wishes, *([self.wish] if self.wish else [])]}
        if self.state not in (VIEWER, RECORDER, CONTROLLER) or form not in wished:
            raise Finding("a picture that was not subscribed to", f"{self.name}: {form}")
        if self.wish and self.wish.get("paused") and not self.wishes:
            raise Finding("a picture while paused (4.3.4)")
        if self.state == RECORDER and not p["flags"] & 4:
            raise Finding("a recorder's picture without flag lockstep (5.9)")
        self.last = p["sequence"]
        self.seen = max(self.seen, p["sequence"])
        self.pictures += 1
        self.run.pictures += 1
        kind = p["format"], p["flags"] & 24
        if not self.wishes and form != "h264" and self.state != RECORDER:
            if p["sequence"] <= self.newest.get(kind, 0):
                raise Finding("sequence numbers do not rise (5.5)", f"{p['sequence']} after {self.newest[kind]}")
            self.newest[kind] = p["sequence"]
        self.waiting = [*self.waiting, p["sequence"]] if p["sequence"] > self.ahead else []
        most = CREDIT_H264 if form == "h264" else CREDIT
        if not self.wishes and form == self.wish["format"] and len(self.waiting) > most:
            raise Finding("more pictures than credit (5.2)", f"{self.name}: {len(self.waiting)} of {form}")


def state_word(state):
    return state if state == NEW else f"a {state}"
