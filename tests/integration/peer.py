"""The other end of relight.v1 for tests of the command-line clients: a scripted server on Debian's
python3-websockets, an independent library. Messages follow protocol/PROTOCOL.md."""

import asyncio
import atexit
import json
import os
import shutil
import signal
import struct
import sys
import tempfile
import time
from pathlib import Path

try:
    import websockets
except ImportError:
    print("skipped: python3-websockets is not installed")
    sys.exit(77)

SKIPPED = 77

BIN = Path(os.environ["RELIGHT_BIN"])

# No test takes a cache that another one has kept.
os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp()
atexit.register(shutil.rmtree, os.environ["XDG_CACHE_HOME"], ignore_errors=True)

WAIT_S = 600  # ends a test that waits for what never comes; no test passes or fails by how long something takes


class Failed(Exception):
    pass


class Skipped(Exception):
    pass


def skip(why):
    raise Skipped(why)


def check(what, message):
    if not what:
        raise Failed(message)


async def until(holds, message="it never came"):
    """Waits until holds(), which may be a coroutine; returns its value."""
    async def ask():
        while True:
            got = holds()
            if asyncio.iscoroutine(got):
                got = await got
            if got:
                return got
            await asyncio.sleep(0.02)
    try:
        return await asyncio.wait_for(ask(), WAIT_S)
    except asyncio.TimeoutError:
        raise Failed(message) from None


# ---- Messages ----

FRAME = struct.Struct("<4sHBBBBHIIIQqQ")
PICTURE = struct.Struct("<4sHBBQQqqIIIIIIfIII")


class Frame:
    """A received environment frame (clause 7)."""

    def __init__(self, message):
        (magic, header, self.encoding, self.layout, self.flags, self.channels, zero, self.width, self.height, payload,
         self.number, self.capture_us, zeros) = FRAME.unpack_from(message)
        check(magic == b"RLE1" and header == 48 and zero == 0 and zeros == 0, "a malformed frame header")
        self.payload = message[header:]
        check(len(self.payload) == payload, "header and payload do not add up")


def picture(sequence, frame, payload, *, capture_us=0, flags=0, form=3, size=(16, 9)):
    """A picture to send (clause 6)."""
    return PICTURE.pack(b"RLP1", 80, form, flags, sequence, frame, capture_us, 0, 0, 0, 0, 0, *size, 1.0, 4,
                        len(payload), 0) + payload


class Link:
    """One connection of a client under test."""

    def __init__(self, socket, server):
        self.socket = socket
        self.server = server

    async def read(self, most_s=WAIT_S):
        """The next message other than pings, which it answers."""
        end = time.monotonic() + most_s
        while True:
            message = await asyncio.wait_for(self.socket.recv(), end - time.monotonic())
            if isinstance(message, bytes):
                return message
            message = json.loads(message)
            if message["op"] != "ping":
                return message
            await self.say(op="pong", id=message["id"], server_us=self.server.clock_us())

    async def say(self, **fields):
        await self.socket.send(json.dumps(fields))

    async def welcome(self, role, **more):
        """Receives hello with that role, and answers."""
        hello = await self.read()
        check(hello["op"] == "hello" and hello["role"] == role, f"not a {role}'s hello: {hello}")
        check(hello["version"] == {"major": 1, "minor": 2}, f"another version: {hello}")
        await self.say(op="welcome", version={"major": 1, "minor": 0}, server="a test", session=self.server.session,
                       roles=["viewer", "producer"], formats=["jpeg", "exr_half", "exr_float"],
                       limits={"text_bytes": 16384, "credit": 2, "connections": 9}, something_new=[1, 2], **more)
        return hello

    async def welcome_producer(self, after=None, credit=2, frame_bytes=1 << 28):
        return await self.welcome("producer", producer={"resume_after": after, "credit": credit,
                                                        "frame_bytes": frame_bytes, "raw": True})

    async def frame(self):
        message = await self.read()
        check(isinstance(message, bytes), f"not a frame: {message}")
        return Frame(message)

    async def fate(self, number, fate="used", **more):
        await self.say(op="frame", number=number, fate=fate, **more)

    async def credit(self, frames=1):
        await self.say(op="credit", frames=frames)

    async def nothing(self, seconds=0.4):
        """Checks that only pings arrive."""
        try:
            message = await self.read(seconds)
        except asyncio.TimeoutError:
            return
        raise Failed(f"came unexpectedly: {message[:80]}")

    async def parted(self):
        """The client's close code; skips earlier texts."""
        try:
            while True:
                await self.read()
        except websockets.ConnectionClosed:
            return self.socket.close_code

    def cut(self):
        """Breaks the connection without a close frame."""
        self.socket.transport.abort()


class Server:
    """Runs one script per connection: the n-th connection gets the n-th, the last one serves all further ones."""

    def __init__(self, *scripts, tls=None, port=0):
        self.scripts = scripts
        self.tls, self.port = tls, port  # an ssl.SSLContext
        self.session = "one"
        self.connections = 0
        self.faults = []
        self.ahead_us = 0
        self.running = set()

    def clock_us(self):
        return time.time_ns() // 1000 + self.ahead_us

    async def __aenter__(self):
        self.server = await websockets.serve(self.serve, "127.0.0.1", self.port, ssl=self.tls, subprotocols=["relight.v1"], max_size=None,
                                             ping_interval=None, compression=None)
        self.port = self.server.sockets[0].getsockname()[1]
        self.url = f"{'wss' if self.tls else 'ws'}://127.0.0.1:{self.port}"
        return self

    async def __aexit__(self, kind, *_):
        self.server.close()
        await self.server.wait_closed()
        if self.faults and kind in (None, Failed):
            raise self.faults[0]

    async def serve(self, socket):
        script = self.scripts[min(self.connections, len(self.scripts) - 1)]
        self.connections += 1
        try:
            if self.faults:
                raise self.faults[0]
            check(socket.subprotocol == "relight.v1", "the client did not offer relight.v1")
            check("Origin" not in socket.request_headers, "a client that is no browser sends no Origin")
            await script(Link(socket, self))
        except websockets.ConnectionClosed:
            pass
        except Exception as fault:  # reported by the test; 4003 is never retried, so the test need not wait
            self.faults.append(fault if isinstance(fault, Failed) else Failed(repr(fault)))
            await socket.close(4003)


# ---- The programs ----

class Program:
    """A program under test; after end() it has code, out and err."""

    started = []

    def __init__(self, name, *arguments):
        self.arguments = [str(BIN / name), *map(str, arguments)]

    async def start(self):
        self.process = await asyncio.create_subprocess_exec(*self.arguments, stdout=asyncio.subprocess.PIPE,
                                                            stderr=asyncio.subprocess.PIPE)
        Program.started.append(self.process)
        return self

    async def end(self, most_s=WAIT_S):
        out, err = await asyncio.wait_for(self.process.communicate(), most_s)
        self.out, self.err = out.decode(), err.decode()
        self.code = self.process.returncode
        return self

    async def kill(self, number=signal.SIGKILL):
        if self.process.returncode is None:
            self.process.send_signal(number)
        return await self.end()

    def summary(self):
        return json.loads(self.out)


async def run(name, *arguments):
    return await (await Program(name, *arguments).start()).end()


def expect(program, code, text=""):
    check(program.code == code, f"exit code {program.code} instead of {code}: {program.err}")
    check(text in program.err, f"no '{text}' on standard error: {program.err}")


# ---- Frames to send ----

def radiance(value=128, size=(2, 1), pad=0):
    """A flat Radiance file with this mantissa in every texel, and `pad` bytes of comment to make it large."""
    head = b"#?RADIANCE\n" + (b"# " + b"x" * pad + b"\n" if pad else b"") + b"FORMAT=32-bit_rle_rgbe\n\n"
    return head + b"-Y %d +X %d\n" % (size[1], size[0]) + bytes([value, value, value, 129]) * (size[0] * size[1])


def sky_files(folder, count, pad=0):
    """Writes folder/sky.%04d.hdr with different brightnesses; returns the pattern."""
    for i in range(count):
        (Path(folder) / f"sky.{i:04d}.hdr").write_bytes(radiance(64 + i, pad=pad))
    return str(Path(folder) / "sky.%04d.hdr")


def main(claims):
    """Runs the test named on the command line."""
    claim = claims[sys.argv[1]]
    async def claimed(folder):
        try:
            await claim(Path(folder))
        finally:
            for process in Program.started:  # clients reconnect for ever, even after their test has ended
                if process.returncode is None:
                    process.kill()

    try:
        with tempfile.TemporaryDirectory() as folder:
            asyncio.run(claimed(folder))
    except Failed as fault:
        print("FAILED:", fault)
        sys.exit(1)
    except Skipped as why:
        print("skipped:", why)
        sys.exit(SKIPPED)
