"""relightd as a user starts it, observed from outside: its output, its processes in /proc, and one viewer of relight.v1
(protocol/PROTOCOL.md) on loopback. Standard library only."""

import collections
import ctypes
import json
import os
import re
import secrets
import select
import signal
import socket
import struct
import subprocess
import threading
import time
import urllib.request

PICTURE = struct.Struct("<4sHBBQQqqIIIIIIfIII")
REPEAT, FINER, KEY = 2, 32, 64  # flags of a picture
TICKS = os.sysconf("SC_CLK_TCK")
PR_SET_PDEATHSIG = 1
END_S = 20.0  # to end after SIGTERM

EXR_FLOAT, H264 = 3, 4  # forms of pictures

Picture = collections.namedtuple("Picture", "received_s latency_us captured form flags frame gain samples payload")


class Failure(Exception):
    """What cannot be measured, and why, for the user."""


STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
RUNNING = []  # processes that spawn has started


def prepare_child():
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)  # even if this process is killed


def spawn(command, **how):
    """Starts a process that end_all can end: no signal comes between its start and its entry in RUNNING."""
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        RUNNING[:] = [p for p in RUNNING if p.poll() is None]
        RUNNING.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=prepare_child, **how))
        return RUNNING[-1]
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def end(process):
    if process.poll() is None:
        process.terminate()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def end_all():
    for process in RUNNING:
        end(process)


# ---- Processes ----

def children():
    """The process ids of all children, by parent."""
    out = collections.defaultdict(list)
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open(f"/proc/{name}/stat", encoding="latin-1") as file:
                    out[int(file.read().rsplit(")", 1)[1].split()[1])].append(int(name))
            except OSError:
                pass  # it has ended meanwhile
    return out


def family(pid):
    """The process and all that descend from it."""
    by_parent, out = children(), [pid]
    for one in out:
        out += by_parent[one]
    return out


def processor_s(pid):
    """Processor time of a process, its threads and the children that it has waited for."""
    try:
        with open(f"/proc/{pid}/stat", encoding="latin-1") as file:
            return sum(map(int, file.read().rsplit(")", 1)[1].split()[11:15])) / TICKS
    except OSError:
        return 0.0


def peak_bytes(pid):
    try:
        with open(f"/proc/{pid}/status", encoding="latin-1") as file:
            found = re.search(r"^VmHWM:\s+(\d+) kB", file.read(), re.M)
    except OSError:
        return 0
    return 1024 * int(found[1]) if found else 0


class Daemon:
    """A running relightd. `begun_s` is the time (time.monotonic) just before exec."""

    def __init__(self, programs, *arguments, port=0):
        command = [os.path.join(programs, "relightd"), "--port", str(port), "--log-level", "info", *arguments]
        self.lines = []  # (seconds since begun_s, line)
        self.address = None
        self.begun_s = time.monotonic()
        self.process = spawn(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self.known = threading.Event()  # it listens, or has ended
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self):
        for line in self.process.stderr:
            line = line.decode(errors="replace").strip()
            self.lines.append((time.monotonic() - self.begun_s, line))
            if found := re.search(r"listening on http://([0-9.]+):(\d+)/", line):
                self.address = (found[1], int(found[2]))
                self.known.set()
        self.known.set()

    def fault(self):
        """What it said last, for a message."""
        said = [line for _, line in self.lines if "error" in line] or [line for _, line in self.lines]
        return said[-1] if said else f"relightd ended with {self.process.poll()}"

    def wait_listening(self, patience_s=120.0):
        if not self.known.wait(patience_s) or not self.address:
            self.stop()
            raise Failure(self.fault())

    def alive(self):
        return self.process.poll() is None

    def warnings(self):
        return [line.split("warning: ", 1)[1] for _, line in self.lines if "warning: " in line]

    def processor_s(self):
        return sum(map(processor_s, family(self.process.pid)))

    def peak_bytes(self):
        return sum(map(peak_bytes, family(self.process.pid)))

    def cache_share(self):
        """Of the transport cache, 0 to 1."""
        url = f"http://{self.address[0]}:{self.address[1]}/metrics"
        try:
            with urllib.request.urlopen(url, timeout=10) as answer:
                found = re.search(rb"^relightd_cache_computed_ratio (\S+)", answer.read(), re.M)
        except OSError:
            return 0.0
        return float(found[1]) if found else 0.0

    def stop(self):
        end(self.process)
        self.reader.join(END_S)
        self.process.stderr.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()


# ---- The viewer ----

class Viewer:
    """A connection in the role of a controller, which may do all that a viewer may. `on_picture` gets each picture. One thread."""

    def __init__(self, daemon):
        self.daemon = daemon
        self.status, self.last = {}, {}  # the newest status; the newest message by op
        self.on_picture = None
        self.frame = -1  # of the newest picture
        self.requests = 0
        self.socket = socket.create_connection(daemon.address, timeout=120)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._upgrade()
        self.say(op="hello", role="controller", version={"major": 1, "minor": 2})
        self.run(lambda: "welcome" in self.last, 60.0)

    def _upgrade(self):
        host = "%s:%d" % self.daemon.address
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: relight.v1\r\n"
                             "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n").encode())
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += self._exactly(1)
        if b" 101 " not in head.split(b"\r\n")[0]:
            raise Failure("the server refused the viewer: " + head.split(b"\r\n")[0].decode(errors="replace"))

    def _exactly(self, count):
        data = bytearray(count)
        view, at = memoryview(data), 0
        while at < count:
            got = self.socket.recv_into(view[at:])
            if got == 0:
                raise Failure("the server closed the connection: " + self.daemon.fault())
            at += got
        return data

    def _send(self, kind, data):
        mask = secrets.token_bytes(4)
        size = struct.pack("!B", 128 | len(data)) if len(data) < 126 else struct.pack("!BH", 128 | 126, len(data))
        self.socket.sendall(bytes([128 | kind]) + size + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

    def say(self, **message):
        self._send(1, json.dumps(message).encode())

    def _message(self):
        """(kind, data) of the next message; answers pings."""
        kind, data = 0, bytearray()
        while True:
            head = self._exactly(2)
            size = head[1] & 127
            if size >= 126:
                size = int.from_bytes(self._exactly(2 if size == 126 else 8), "big")
            part = self._exactly(size)
            if head[0] & 15 == 9:
                self._send(10, part)
            elif head[0] & 15 == 8:
                raise Failure("the server closed the connection: " + bytes(part[2:]).decode(errors="replace"))
            elif head[0] & 15 in (0, 1, 2):
                kind = head[0] & 15 or kind
                data += part
                if head[0] & 128:
                    return kind, data

    def run(self, done, most_s, tick=None):
        """Receives until done() or for most_s seconds; tick() is called twice a second. Returns done()."""
        end_s = time.monotonic() + most_s
        tick_s = 0.0
        while not done():
            now_s = time.monotonic()
            if tick and now_s >= tick_s:
                tick()
                tick_s = now_s + 0.5
            if now_s >= end_s:
                return False
            if not select.select([self.socket], [], [], min(0.25, end_s - now_s))[0]:
                if not self.daemon.alive():
                    raise Failure("relightd ended: " + self.daemon.fault())
                continue
            self._hear()
        return True

    def _hear(self):
        kind, data = self._message()
        if kind == 1:
            said = json.loads(data.decode())
            self.last[said["op"]] = said
            if said["op"] == "status":
                self.status = said
            if said["op"] == "error" and said.get("fatal", True):
                raise Failure(said["message"])
            return
        received_s, received_us = time.monotonic(), time.time_ns() // 1000
        (_, header, form, flags, sequence, frame, capture, published, queued, decoded, shaded, encoded, _, _, gain, samples,
         _, _) = PICTURE.unpack_from(data)
        self.say(op="ack", sequence=sequence)
        # Files have no time of capture: then the time since reading began.
        latency = received_us - (capture or published - queued - decoded - shaded - encoded)
        self.frame = frame
        if self.on_picture:
            self.on_picture(Picture(received_s, latency, capture != 0, form, flags, frame, gain, samples, bytes(data[header:])))

    def subscribe(self, form, **more):
        self.requests += 1
        self.last.pop("subscribed", None)
        self.say(op="subscribe", format=form, request=self.requests, **more)
        self.run(lambda: "subscribed" in self.last or "error" in self.last, 60.0)
        if "subscribed" not in self.last:
            raise Failure(self.last["error"]["message"])

    def control(self, **wish):
        """Sends a control message and waits for its answer."""
        self.requests += 1
        self.say(op="control", request=self.requests, **wish)
        mine = self.last["welcome"]["id"]
        answered = lambda: (self.last.get("error", {}).get("request") == self.requests or  # noqa: E731
                            (self.last.get("control", {}).get("request"), self.last.get("control", {}).get("by")) == (self.requests, mine))
        if not self.run(answered, 120.0) or self.last.get("error", {}).get("request") == self.requests:
            raise Failure(self.last.get("error", {}).get("message", "no answer to a control message"))

    def close(self):
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
