"""Shared by the fault suites: one relightd with a well-behaved viewer and producer, clients that misbehave byte by byte, and the
checks after each fault. A row of docs/internals/reliability.md is one function NUMBER_name(stage) that plays one fault and returns its
result; the stage checks that
  - the server is alive, and the well-behaved viewer stays connected and gets further pictures,
  - no descriptor has leaked once the fault is over, and memory has not grown by more than the row allows,
  - it ends (WAIT_S),
  - /metrics has counted what the row names.
Rows that wait for server timeouts (@patient) begin first and run beside the others."""

import asyncio
import base64
import contextlib
import ctypes
import json
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "integration"))

import websockets  # noqa: E402

from peer import BIN, PICTURE, WAIT_S, Failed, Skipped, check, skip, until  # noqa: E402, F401

SANITIZED = "RELIGHT_SANITIZED" in os.environ
KEPT = 16 if SANITIZED else 1  # factor on allowed memory: sanitizers keep freed memory
# Pictures a second: on each commit as many as show that they go on, since each takes processor time from other tests.
RATE = 30 if SANITIZED or "RELIGHT_LONG" in os.environ or "--all" in sys.argv else 10

TEXT, BINARY, CLOSE, PING, PONG, MORE = 1, 2, 8, 9, 10, 0

PRELOAD = os.environ.get("RELIGHT_PRELOAD")


def preloaded(**what):
    """The environment in which a call fails (preload.c)."""
    if not PRELOAD:
        skip("RELIGHT_PRELOAD names no library")
    if "asan" in (subprocess.run(["ldd", BIN / "relightd"], capture_output=True, text=True, check=True).stdout):
        skip("the sanitizer's library must be the first one")
    return {"LD_PRELOAD": PRELOAD, **{f"RELIGHT_{k}": str(v) for k, v in what.items()}}


# ---- The server, seen from outside ----

class Relightd:
    """A server of 64x36 pictures; by default its frames come from producers."""

    def __init__(self, *arguments, before=(), env=None, source="push:"):
        self.arguments = [*before, str(BIN / "relightd"), "--port", "0", "--size", "64x36", "--samples", "1", "--paths", "direct",
                          "--edge-rays", "1", "--fps", str(RATE), "--source", source, *arguments]
        self.env = {**os.environ, "OMP_WAIT_POLICY": "passive", **(env or {})}
        self.lines = []

    async def __aenter__(self):
        await self.start()
        return self

    async def start(self):
        def die_with_the_test():
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG

        self.process = await asyncio.create_subprocess_exec(
            *self.arguments, stderr=asyncio.subprocess.PIPE, env=self.env, preexec_fn=die_with_the_test)
        self.pid = self.process.pid
        self.port = None
        while not self.port:
            line = (await asyncio.wait_for(self.process.stderr.readline(), WAIT_S)).decode()
            check(line, f"relightd ended before it listened: {' '.join(self.lines)}")
            self.lines.append(line)
            found = re.search(r"listening on https?://\S*:(\d+)/", line)
            self.port = int(found[1]) if found else None
        self.url = f"ws://127.0.0.1:{self.port}/ws"
        self.reading = asyncio.ensure_future(self.read())

    async def read(self):
        while line := await self.process.stderr.readline():
            self.lines.append(line.decode(errors="replace"))
            del self.lines[:-400]

    def alive(self):
        return self.process.returncode is None

    async def stop(self, number=signal.SIGTERM):
        """The exit code."""
        if self.alive():
            self.process.send_signal(number)
        try:
            await asyncio.wait_for(self.process.wait(), WAIT_S)
        except asyncio.TimeoutError:
            self.process.kill()
            raise Failed(f"it did not end after signal {number}") from None
        await asyncio.wait([self.reading], timeout=WAIT_S)
        return self.process.returncode

    async def __aexit__(self, kind, *_):
        code = await self.stop()
        if kind is None:
            check(code == 0, f"relightd ended with {code}: {''.join(self.lines[-20:])}")

    def descriptors(self):
        return len(os.listdir(f"/proc/{self.pid}/fd"))

    def open_files(self):
        """What each descriptor refers to."""
        names = []
        for number in os.listdir(f"/proc/{self.pid}/fd"):
            with contextlib.suppress(OSError):
                names.append(os.readlink(f"/proc/{self.pid}/fd/{number}"))
        return sorted(names)

    def memory_kib(self):
        status = Path(f"/proc/{self.pid}/status").read_text(encoding="ascii")
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1])

    def processor_s(self):
        fields = Path(f"/proc/{self.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    async def get(self, path):
        """Status and body of one request."""
        raw = await Raw.open(self.port)
        try:
            raw.send(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\nConnection: close\r\n\r\n".encode())
            answer = await raw.rest()
        finally:
            raw.shut()
        head, _, body = answer.partition(b"\r\n\r\n")
        return int(head.split()[1]) if head.startswith(b"HTTP/") else 0, body

    async def counters(self):
        """The values of /metrics: {'name{labels}': value}; {} if unavailable."""
        status, body = await self.get("/metrics")
        if status != 200:
            return {}
        found = re.findall(r"^([a-z_:0-9]+(?:\{[^}\n]*\})?) (\S+)", body.decode(), re.M | re.I)
        return {name: float(value) for name, value in found}


# ---- Clients that misbehave ----

def masked(payload, key):
    long = (key * (len(payload) // 4 + 1))[:len(payload)]
    return (int.from_bytes(payload, "big") ^ int.from_bytes(long, "big")).to_bytes(len(payload), "big")


def frame(op, payload=b"", *, fin=True, mask=True, reserved=0, length=None, wide=0):
    """One WebSocket frame. length: declared instead of actual; wide: encode it in 2 or 8 bytes, whatever it is."""
    size = len(payload) if length is None else length
    first = (0x80 if fin else 0) | reserved << 4 | op
    bit = 0x80 if mask else 0
    if wide == 8 or (not wide and size > 65535):
        head = struct.pack(">BBQ", first, bit | 127, size)
    elif wide == 2 or size > 125:
        head = struct.pack(">BBH", first, bit | 126, size)
    else:
        head = struct.pack(">BB", first, bit | size)
    if not mask:
        return head + payload
    if len(payload) > 65536: # to mask so many takes longer than all that a server does with them
        return head + bytes(4) + payload
    key = b"\x5a\x17\xc3\x88"
    return head + key + masked(payload, key)


def say(**fields):
    return frame(TEXT, json.dumps(fields).encode())


def hello(role="viewer", **more):
    return say(op="hello", role=role, version={"major": 1, "minor": 1}, **more)


class Raw:
    """A TCP connection on which the test controls every byte."""

    @classmethod
    async def open(cls, port, host="127.0.0.1", buffer=None, source=None, tls=None):
        """source: the local address; tls: an ssl.SSLContext that trusts localhost's certificate."""
        self = cls()
        if buffer:
            import socket
            plain = socket.socket()
            plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
            plain.setblocking(False)
            await asyncio.get_running_loop().sock_connect(plain, (host, port))
            self.reader, self.writer = await asyncio.open_connection(sock=plain, limit=buffer)
        else:
            self.reader, self.writer = await asyncio.wait_for(asyncio.open_connection(
                host, port, limit=1 << 22, local_addr=(source, 0) if source else None, ssl=tls,
                server_hostname="localhost" if tls else None), WAIT_S)
        self.port = port
        self.started = time.monotonic()
        self.said = []  # received texts
        self.binary = 0
        return self

    def send(self, data):
        if not self.writer.transport.is_closing():
            self.writer.write(data)

    async def flush(self, most_s=WAIT_S):
        """Waits until the kernel has sent all but 64 KiB; returns whether it did. The server may have closed
        meanwhile."""
        try:
            await asyncio.wait_for(self.writer.drain(), most_s)
            return True
        except (ConnectionError, asyncio.TimeoutError):
            return False

    def shut(self):
        self.writer.close()

    def reset(self):
        """Closes the connection with RST."""
        import socket
        plain = self.writer.get_extra_info("socket")
        with contextlib.suppress(OSError):  # the server may have closed first
            plain.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.writer.transport.abort()

    async def rest(self):
        """Everything received until the end."""
        parts = []
        try:
            async with Deadline():
                while part := await self.reader.read(65536):
                    parts.append(part)
        except ConnectionError:
            pass
        return b"".join(parts)

    async def rest_until(self, frames):
        """The next frames, up to this number."""
        for _ in range(frames):
            if (await self.receive())[0] is None:
                return

    async def ends(self):
        """Waits until the server closes, whatever arrives before; returns the connection's age in seconds."""
        await self.rest()
        return time.monotonic() - self.started

    async def answer(self):
        """Status and head of an HTTP response; 0 for none."""
        try:
            async with Deadline():
                head = await self.reader.readuntil(b"\r\n\r\n")
        except (asyncio.IncompleteReadError, ConnectionError):
            return 0, b""
        return int(head.split()[1]), head

    def handshake(self, **other):
        """The request text; header names with _ for -, None omits one, path and method likewise."""
        lines = {"Host": f"127.0.0.1:{self.port}", "Upgrade": "websocket", "Connection": "Upgrade",
                 "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": base64.b64encode(b"sixteen bytes !!").decode(),
                 "Sec-WebSocket-Protocol": "relight.v1"}
        first = f"{other.pop('method', 'GET')} {other.pop('path', '/ws')} {other.pop('http', 'HTTP/1.1')}\r\n"
        lines.update({name.replace("_", "-"): value for name, value in other.items()})
        return (first + "".join(f"{n}: {v}\r\n" for n, v in lines.items() if v is not None) + "\r\n").encode("latin-1")

    async def upgrade(self, **other):
        self.send(self.handshake(**other))
        return (await self.answer())[0]

    async def receive(self):
        """(opcode, payload) of the next frame; (None, b"") at the end of the stream."""
        try:
            async with Deadline():
                first, second = await self.reader.readexactly(2)
                size = second & 127
                if size == 126:
                    size, = struct.unpack(">H", await self.reader.readexactly(2))
                elif size == 127:
                    size, = struct.unpack(">Q", await self.reader.readexactly(8))
                payload = await self.reader.readexactly(size)
        except (asyncio.IncompleteReadError, ConnectionError):
            return None, b""
        check(second < 128, "the server masked a frame")
        self.final = first >= 128
        if first & 15 == TEXT:
            self.said.append(json.loads(payload))
        elif first & 15 == BINARY:
            self.binary += 1
        return first & 15, payload

    async def until(self, op):
        """The next text with that op."""
        while True:
            kind, payload = await self.receive()
            check(kind is not None and kind != CLOSE, f"closed while '{op}' was waited for: {payload[:120]}")
            if kind == TEXT and self.said[-1]["op"] == op:
                return self.said[-1]

    async def closed(self):
        """The received close code; None if the connection ended without one."""
        code = None
        while True:
            kind, payload = await self.receive()
            if kind is None:
                return code
            if kind == CLOSE and code is None:
                code = struct.unpack(">H", payload[:2])[0] if len(payload) >= 2 else 1005
                self.reason = payload[2:].decode(errors="replace")
                self.send(frame(CLOSE, payload[:2]))

    async def stays(self):
        """Like closed(), but answers pings: a client that is silent for 25 s would be dropped."""
        while True:
            kind, payload = await self.receive()
            if kind == PING:
                self.send(frame(PONG, payload))
            elif kind in (None, CLOSE):
                return struct.unpack(">H", payload[:2])[0] if len(payload) >= 2 else None

    async def pong(self, number=7):
        """Checks that a message is answered by a text."""
        self.send(say(op="ping", id=number))
        while (await self.until("pong"))["id"] != number:
            pass


class Deadline:
    """Failed after WAIT_S: what is waited for within never comes."""

    async def __aenter__(self):
        self.inner = asyncio.timeout(WAIT_S)
        await self.inner.__aenter__()

    async def __aexit__(self, *of):
        try:
            await self.inner.__aexit__(*of)
        except TimeoutError:
            raise Failed(f"nothing within {WAIT_S} s") from None


# ---- Honest clients, of a library by other people ----

def connect(url, **more):
    return websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, max_queue=None, ping_interval=None, **more)


class Honest:
    """Runs its own live() beside the faults, from `async with` to its end."""

    async def __aenter__(self):
        self.task = asyncio.ensure_future(self.live())
        return self

    async def __aexit__(self, *_):
        while not self.task.done():  # once is not enough: asyncio.wait_for() loses it if what it waits for has just come
            self.task.cancel()
            await asyncio.wait([self.task], timeout=1)
        with contextlib.suppress(asyncio.CancelledError, Failed):
            self.task.result()
        if self.link:
            await self.link.close()


class Viewer(Honest):
    """Watches, acknowledges each picture, and reconnects when told to; `parted` collects its close codes."""

    def __init__(self, server, format="jpeg", token=None):
        self.server = server
        self.format = format
        self.token = {"token": token} if token else {}
        self.pictures = 0
        self.frames = []  # the newest, by number
        self.parted = []
        self.gap_s = 0.0  # the longest wait for a picture
        self.last_s = None
        self.status = {}
        self.link = None

    async def live(self):
        while True:
            try:
                async with connect(self.server.url) as self.link:
                    await self.watch(self.link)
            except (websockets.WebSocketException, OSError, EOFError):
                if self.link:
                    self.parted.append(self.link.close_code)
            await asyncio.sleep(0.2)

    async def watch(self, link):
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}, **self.token}))
        await link.send(json.dumps({"op": "subscribe", "format": self.format}))
        async for message in link:
            if isinstance(message, bytes):
                fields = PICTURE.unpack_from(message)
                await link.send(json.dumps({"op": "ack", "sequence": fields[4]}))
                now = time.monotonic()
                if self.last_s:
                    self.gap_s = max(self.gap_s, now - self.last_s)
                self.last_s = now
                self.pictures += 1
                self.frames = [*self.frames[-99:], fields[5]]
            elif (said := json.loads(message))["op"] == "status":
                self.status = said

    async def sees(self, count=2):
        """Waits for so many further pictures."""
        want = self.pictures + count
        async with Deadline():
            while self.pictures < want:
                check(not self.task.done(), f"the honest viewer's own end: {self.task}")
                await asyncio.sleep(0.01)


class Producer(Honest):
    """Sends small frames of raw floats, RATE a second while there is credit."""

    def __init__(self, server, token=None, pause_s=0.9 / RATE):
        self.server = server
        self.token = {"token": token} if token else {}
        self.pause_s = pause_s
        self.number = 0
        self.fates = {}
        self.parted = []
        self.link = None
        self.credit = 0
        self.held = self.away = self.welcomed = False
        self.errors = []

    async def live(self):
        while True:
            try:
                async with connect(self.server.url) as self.link:
                    await self.link.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1},
                                                     **self.token}))
                    await asyncio.gather(self.hear(self.link), self.feed(self.link))
            except (websockets.WebSocketException, OSError, EOFError):
                if self.link:
                    self.parted.append(self.link.close_code)
            self.credit, self.welcomed = 0, False
            await asyncio.sleep(0.2)
            while self.away:
                await asyncio.sleep(0.02)

    async def hear(self, link):
        async for message in link:
            said = json.loads(message)
            if said["op"] == "welcome":
                self.credit = said["producer"]["credit"]
                self.welcomed = True
            elif said["op"] == "credit":
                self.credit += said["frames"]
            elif said["op"] == "frame":
                self.fates[said["number"]] = said
                for old in sorted(self.fates)[:-200]:
                    del self.fates[old]
            elif said["op"] == "error":
                self.errors.append(said)
        raise EOFError

    async def feed(self, link):
        while not link.closed:
            if self.credit > 0 and not self.held:
                await self.push(link)
            await asyncio.sleep(self.pause_s)

    async def push(self, link, payload=None, **how):
        self.credit -= 1
        self.number += 1
        await link.send(environment(self.number, payload, **how))
        return self.number

    async def back(self):
        """Waits for welcome."""
        async with Deadline():
            while not self.welcomed:
                await asyncio.sleep(0.01)

    async def fate(self, payload, **how):
        """Sends one frame between the others and returns its fate. Repeats if a newer one superseded it."""
        self.held = True
        try:
            async with Deadline():
                while True:
                    while self.credit < 2:  # all earlier ones have their fate
                        await asyncio.sleep(0.005)
                    number = await self.push(self.link, payload, **how)
                    while number not in self.fates:
                        await asyncio.sleep(0.005)
                    if self.fates[number]["fate"] != "superseded":
                        return self.fates[number]
        finally:
            self.held = False


def environment(number, payload=None, *, encoding=None, size=(8, 4), channels=3, layout=0, flags=0, header=48, length=None,
                magic=b"RLE1", reserved=0, capture_us=0):
    """An environment message; without payload a grey of raw floats of varying brightness."""
    if payload is None:
        encoding = 4
        payload = struct.pack("<f", 0.5 + number % 32 / 32) * (size[0] * size[1] * channels)
    if encoding in (1, 2):
        size, channels = (0, 0), 0
    return struct.pack("<4sHBBBBHIIIQqQ", magic, header, encoding, layout, flags, channels, reserved, *size,
                       len(payload) if length is None else length, number, capture_us, 0) + payload


# ---- Rows ----

ROWS = {}


def row(memory_kib=4096, patient=False, counts=None, alone=False):
    """Declares the limits of a row. counts: part of the name of a metric that must increase; alone: the row starts
    its own server."""
    def declare(function):
        function.limits = {"memory_kib": memory_kib, "patient": patient, "counts": counts, "alone": alone}
        ROWS[function.__name__] = function
        return function
    return declare


class Stage:
    """One server, one honest viewer, one honest producer."""

    def __init__(self, *arguments):
        self.arguments = arguments

    async def __aenter__(self):
        self.folder = tempfile.TemporaryDirectory()
        self.server = await Relightd(*self.arguments).__aenter__()
        self.viewer = await Viewer(self.server).__aenter__()
        self.producer = await Producer(self.server).__aenter__()
        await self.viewer.sees(30)
        self.producer.held = True  # a sky that stands still is refined, for which each slot takes memory once
        await self.viewer.sees(4)
        self.producer.held = False
        before = self.server.descriptors()
        for _ in range(20):  # warms up every code path of a connection, so that memory is stable
            raw = await self.client()
            raw.send(b"".join(frame(TEXT, b" " * 16000 + b'{"op":"ping","id":1}') for _ in range(2)))
            await raw.pong()
            raw.shut()
        await self.settled(before)
        return self

    async def __aexit__(self, *of):
        await self.producer.__aexit__()
        await self.viewer.__aexit__()
        self.folder.cleanup()
        await self.server.__aexit__(*of)

    @contextlib.asynccontextmanager
    async def without_producer(self):
        """Disconnects the well-behaved producer, to free its place."""
        self.producer.away = True
        await self.producer.back()
        await self.producer.link.close()
        while self.producer.welcomed:
            await asyncio.sleep(0.01)
        try:
            yield
        finally:
            self.producer.away = False
        await self.producer.back()

    async def settled(self, descriptors):
        await until(lambda: self.server.descriptors() <= descriptors, f"more than {descriptors} descriptors stay open")

    async def raw(self, **how):
        return await Raw.open(self.server.port, **how)

    async def client(self, role="viewer", **more):
        """A welcomed connection; role None: before hello."""
        raw = await self.raw()
        check(await raw.upgrade() == 101, "no handshake")
        if role:
            raw.send(hello(role, **more))
            await raw.until("welcome")
        return raw

    async def offends(self, data, code, error=None, role="viewer"):
        """A client that sends this gets that error and is closed with that code."""
        raw = await self.client(role)
        raw.send(data)
        got = await raw.closed()
        codes = code if isinstance(code, tuple) else (code,)
        check(got in codes, f"closed with {got} instead of {code}; said: {raw.said[-1:]}")
        if error:
            said = [m for m in raw.said if m["op"] == "error"]
            check(said and said[-1]["code"] == error, f"error {said[-1:]} instead of {error}")
        raw.shut()
        return got

    async def holds(self, function):
        """Plays the fault and checks all limits; returns the result."""
        limits, server, viewer = function.limits, self.server, self.viewer
        counters = await server.counters()
        for _ in range(3):  # a leak grows each time; buffers that are taken once and kept do not
            descriptors, memory = server.descriptors(), server.memory_kib()
            parted, viewer.gap_s = len(viewer.parted), 0.0
            begun = time.monotonic()
            seen = viewer.pictures
            figure = await function(self)
            took = time.monotonic() - begun
            check(server.alive(), f"relightd ended with {server.process.returncode}: {''.join(server.lines[-20:])}")
            await viewer.sees(2)
            check(len(viewer.parted) == parted, f"the honest viewer was closed with {viewer.parted[parted:]}")
            rate = (viewer.pictures - seen) / max(0.001, time.monotonic() - begun)
            if not limits["patient"]:  # others run beside these
                await self.settled(descriptors)
            grown = server.memory_kib() - memory
            most = limits["memory_kib"] + (8192 if limits["patient"] else 0)  # concurrent rows need their share
            if grown <= most * KEPT:
                break
        check(grown <= most * KEPT, f"{grown} KiB more memory, each time it was played")
        if limits["counts"] and counters:
            after = await server.counters()
            risen = [n for n in after if limits["counts"] in n and after[n] > counters.get(n, 0)]
            check(risen, f"not counted as {limits['counts']}")
        words = [figure] if figure else []
        words.append(f"{took:.1f} s; viewer {rate:.0f}/s, longest gap {viewer.gap_s * 1e3:.0f} ms; {grown:+d} KiB")
        return "; ".join(words)


async def judged(work):
    """What came of a row."""
    try:
        return {"state": "passed", "figure": await work or ""}
    except Skipped as why:
        return {"state": "skipped", "figure": str(why)}
    except (Failed, Exception) as fault:  # a test that raises has failed
        return {"state": "failed", "figure": str(fault) if isinstance(fault, Failed) else repr(fault)}


async def by_itself(function):
    """A row that starts its own server."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        figure = await function(Path(folder))
    return f"{figure}; {time.monotonic() - begun:.1f} s".lstrip("; ")


async def play(names, arguments):
    """Runs the named rows; returns each one's result. Rows with their own server run while patient ones wait."""
    results = {}
    alone = [n for n in names if ROWS[n].limits["alone"]]
    shared = [n for n in names if n not in alone]

    async def play_alone():
        while alone:
            results[alone[0]] = await judged(by_itself(ROWS[alone[0]]))
            del alone[0]

    if shared:
        try:
            async with Stage(*arguments) as stage:
                baseline = stage.server.descriptors()
                waiting = {n: asyncio.ensure_future(judged(stage.holds(ROWS[n])))
                           for n in shared if ROWS[n].limits["patient"]}
                await asyncio.sleep(0.5 if waiting else 0)
                for n in shared:
                    if n not in waiting:
                        results[n] = await judged(stage.holds(ROWS[n]))
                if waiting:
                    await play_alone()
                for n, task in waiting.items():
                    results[n] = await task
                await stage.settled(baseline)
        except Failed as fault:  # a failure of the stage itself makes all of its rows doubtful
            for n in shared:
                if results.get(n, {}).get("state") != "failed":
                    results[n] = {"state": "failed", "figure": f"the stage: {fault}"}
    await play_alone()
    return results


def main(*arguments):
    """SUITE.py --all RESULTS runs all rows and writes their results, for figures.py; SUITE.py --stage RESULTS runs
    those that share a server, for tell.py; SUITE.py ROW... runs those rows. `arguments` are relightd's."""
    given = sys.argv[1:]
    if given[:1] in (["--all"], ["--stage"]):
        Path(given[1]).unlink(missing_ok=True)
        names = [n for n in ROWS if given[0] == "--all" or not ROWS[n].limits["alone"]]
        results = asyncio.run(play(names, arguments))
        Path(given[1]).write_text(json.dumps(results, indent=1), encoding="utf-8")
        for name, result in results.items():
            print(f"{name}: {result['state']}: {result['figure']}")
        return  # the rows report failures
    results = asyncio.run(play(given or list(ROWS), arguments))
    for name, result in results.items():
        print(f"{name}: {result['state']}: {result['figure']}")
    states = {result["state"] for result in results.values()}
    sys.exit(1 if "failed" in states else 77 if states == {"skipped"} else 0)
