"""What attackers do beside relight.v1: requests for images over plain HTTP in many widths, and viewers that stop reading within an
image. And what all others must get meanwhile, within which bounds of the server."""

import asyncio
import json
import random
import socket
import struct

from faults import Failed, Producer, Raw, connect, hello, say
from peer import WAIT_S

GREEDY = ("127.0.0.66", "127.0.0.67")  # addresses of attackers
OTHER = "127.0.0.30"  # and of everyone else
OTHERS_WIDTH = 16  # of an image that no attacker asks for
STREAM = "/stream.mjpeg"
MAGIC = {"/snapshot.jpg": b"\xff\xd8\xff", "/snapshot.png": b"\x89PNG", "/snapshot.exr": b"\x76\x2f\x31\x01", STREAM: b"--relightd"}
HELD_MOST = 128 << 20  # bytes that slow clients may keep from being freed (2.6); four images of the largest size are less
BOUNDS = {'relightd_queue_length{queue="probes"}': 32, 'relightd_queue_length{queue="control"}': 16, "relightd_connections_arriving": 128,
          'relightd_queue_length{queue="received"}': 4, 'relightd_queue_length{queue="decoded"}': 4, 'relightd_queue_length{queue="shaded"}': 4}
SKIES = ("grey", "black", "sun", "faint", "glaring")


def texels(sky, count, channels, letter="f"):
    """Of a sky that an estimator may find nothing in, or all in one direction."""
    value = {"grey": 0.5, "black": 0, "sun": 1, "faint": 1e-38 if letter == "f" else 6e-8, "glaring": 3e38 if letter == "f" else 65504}[sky]
    texel = struct.pack("<" + letter, value)
    first = struct.pack("<" + letter, 5e4) * channels if sky == "sun" else texel * channels
    return first + texel * (channels * (count - 1))


class Weather(Producer):
    """A producer whose sky is another one in each frame."""

    draw = random.Random(48)

    async def push(self, link, payload=None, **how):
        return await super().push(link, payload or texels(self.draw.choice(SKIES), 32, 3), encoding=4, **how)


def width_of(path):
    """The width that it asks for; None: it must be refused."""
    word = path.partition("?width=")[2]
    if "?" not in path:
        return 0
    return int(word) if word.isascii() and word.isdigit() and 16 <= int(word) <= 16384 else None


class Watcher:
    """A request for images, read to its end or until it leaves."""

    def __init__(self, stage, path):
        self.stage, self.path = stage, path
        self.status, self.wrong, self.body, self.raw, self.task = None, None, b"", None, None

    async def open(self, source=None):
        host, _, port = self.stage.host.rpartition(":")
        self.raw = await Raw.open(int(port), host.strip("[]"), source=source if host.startswith("127.") else None)
        self.raw.send(f"GET {self.path} HTTP/1.1\r\nHost: {self.stage.host}\r\nConnection: close\r\n\r\n".encode())
        self.task = asyncio.ensure_future(self.read())

    async def read(self):
        try:
            self.status, _ = await self.raw.answer()
            while len(self.body) < 64 and (part := await self.raw.reader.read(65536)):
                self.body += part
            self.wrong = self.judge(self.body)
            while await self.raw.reader.read(1 << 20):
                pass
        except (ConnectionError, Failed):
            pass
        finally:
            self.raw.shut()

    def judge(self, body):
        """What is wrong with the answer; None: nothing. Who must give way is closed without one."""
        width, kind = width_of(self.path), self.path.partition("?")[0]
        if self.status not in ((0, 200, 503) if width is not None else (0, 400, 503)):
            return f"{self.path} is answered by {self.status}"
        if self.status in (400, 503) and not (body.endswith(b"\n") and body.count(b"\n") == 1):
            return f"{self.path} is refused by {body!r}"
        if self.status == 200 and body and not body.startswith(MAGIC[kind]):
            return f"{self.path} begins with {body[:16]!r}"
        if self.status == 200 and kind.endswith(".png") and len(body) >= 24:
            got, want = int.from_bytes(body[16:20], "big"), min(width or self.stage.width, self.stage.width)
            return None if got == want else f"{self.path} is {got} wide, not {want}"
        return None

    async def end(self):
        """Its answer, read whole."""
        await asyncio.wait_for(self.task, WAIT_S)
        return self.status, self.wrong

    def leave(self):
        if self.task:
            self.task.cancel()
            self.raw.shut()


class Sluggard:
    """A viewer that reads the first bytes of an image, and no more."""

    def __init__(self, stage, format):
        self.stage, self.format = stage, format
        self.begun = 0  # bytes of the image that the server keeps for it
        self.socket = socket.socket(socket.AF_INET6 if "[" in stage.host else socket.AF_INET)

    async def open(self, source):
        host, _, port = self.stage.host.rpartition(":")
        host, loop = host.strip("[]"), asyncio.get_running_loop()
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        if host.startswith("127."):
            self.socket.bind((source, 0))
        await loop.sock_connect(self.socket, (host, int(port)))
        raw = Raw()
        raw.port = int(port)
        await loop.sock_sendall(self.socket, raw.handshake(Host=self.stage.host) + hello() + say(op="subscribe", format=self.format))
        await asyncio.wait_for(self.begin(loop), WAIT_S)

    async def begin(self, loop):
        seen = b""
        while (at := seen.find(b"RLP1")) < 0 or len(seen) < at + 80:
            try:
                part = await loop.sock_recv(self.socket, 1024)
            except ConnectionError:
                return
            if not part:
                return
            seen = seen[-200:] + part
        self.begun = int.from_bytes(seen[at + 72:at + 76], "little")

    def leave(self):
        self.socket.close()


# ---- What holds meanwhile ----

async def asked(stage):
    """The answer to a question about a pixel from another address."""
    local = {"local_addr": (OTHER, 0)} if stage.host.startswith("127.") else {}
    async with connect(stage.url, **local) as link:
        await link.send('{"op":"hello","role":"viewer","version":{"major":1,"minor":1}}')
        question = '{"op":"probe","request":7,"x":1,"y":1,"samples":4,"sky":true}'
        await link.send(question)
        async with asyncio.timeout(WAIT_S):
            while True:
                said = await link.recv()
                said = json.loads(said) if isinstance(said, str) else {}
                if said.get("clause") == "4.15.7":  # the last image was of a sequence, by another camera
                    await stage.viewer.sees(1)
                    await link.send(question)
                elif said.get("request") == 7 and said["op"] in ("probed", "error"):
                    return said


async def image(stage, path):
    """What is wrong with an image over HTTP from another address; or None."""
    async with asyncio.timeout(WAIT_S):
        while True:
            watcher = Watcher(stage, path)
            await watcher.open(OTHER)
            status, wrong = await watcher.end()
            if not watcher.body.startswith(b"No image could be made in time"):  # on a busy machine
                return wrong or (None if status == 200 else f"{path}: {status} {watcher.body!r}")


async def others(stage):
    """What is wrong for everyone else: (kind, detail); or None."""
    said, _, *wrong = await asyncio.gather(asked(stage), stage.viewer.sees(1), image(stage, "/snapshot.jpg"),
                                           image(stage, f"/snapshot.png?width={OTHERS_WIDTH}"))
    if said["op"] != "probed":
        return "others get no answer about a pixel", f"{said}"
    return next((("others get no image over HTTP", w) for w in wrong if w), None)


def cut_of(counters):
    """Slow viewers that were cut: for what they held together or, on a busy machine, for standing still before that."""
    return counters.get('relightd_limits_reached_total{limit="memory"}', 0) + counters.get("relightd_connections_stalled_total", 0)


async def bounds(stage, held):
    """Which bound is exceeded: (kind, detail); or None. held: bytes of images that slow viewers have begun."""
    now = await stage.server.counters() if stage.server else {}
    for name, most in BOUNDS.items():
        if now.get(name, 0) > most:
            return "more than the bound", f"{name} is {now[name]}, not at most {most}"
    kib, most = (stage.server.memory_kib(), stage.kib_before + stage.kib_most + (HELD_MOST >> 10)) if stage.server else (0, 0)
    if kib > most:
        return "slow viewers take memory", f"{kib} KiB, at most {most} are allowed"
    if held > HELD_MOST * 3 // 2 and now and cut_of(now) <= stage.cut_before:
        return "no slow viewer was cut", f"they have begun {held} bytes"
    return None
