"""A client of relightd in one file: feed skies, receive images, change settings. Speaks relight.v1 (protocol/PROTOCOL.md).

Needs python3-numpy and python3-websockets; Picture.pixels() also needs python3-pil. docs/client-libraries.md has examples.

    import relightd
    with relightd.connect("ws://localhost:8080", role="controller") as server:
        server.control(tone="filmic", rotate_degrees=90)
        open("now.jpg", "wb").write(server.picture().payload)

Client has the same functions for asyncio. All lengths of time are seconds unless a name says otherwise."""

import asyncio
import collections
import dataclasses
import difflib
import io
import json
import math
import ssl
import struct
import threading
import urllib.parse
import zlib

import numpy
import websockets

VERSION = {"major": 1, "minor": 2}
NUMBER_MAX = 2**53 - 1  # integers on the wire
SIDE_MAX = 16384
HEADER_MAX = 1024
UNREADABLE_MOST = 10  # pictures in a row

PICTURE = struct.Struct("<4sHBBQQqqIIIIIIfIII")
FRAME = struct.Struct("<4sHBBBBHIIIQqQ")

FORMATS = {1: "jpeg", 2: "exr_half", 3: "exr_float", 4: "h264", 5: "changes"}
LAYOUTS = {"auto": 0, "latlong": 1, "cube": 2, "hcross": 3, "vcross": 4, "ball": 5, "fisheye": 6, "cube-3x2": 7, "cube-6x1": 8}

LAST, REPEAT, LOCKSTEP, HALF, QUARTER, FINER, KEY = (1 << i for i in range(7))  # Picture.flags


class Error(Exception):
    """Base class of the errors that a server causes."""


class Malformed(Error):
    """A binary message or an EXR file that cannot be read; `clause` is that of PROTOCOL.md, "" for a file."""

    def __init__(self, clause, text, sequence=0):
        super().__init__(f"{text} (clause {clause})" if clause else text)
        self.clause = clause
        self.sequence = sequence  # by which a picture can be acknowledged and skipped; 0 if unknown


class Refused(Error):
    """The server refused a request. The connection stays open."""

    def __init__(self, message):
        super().__init__(f"{message.get('message') or message.get('code')} ({message.get('code')}, clause {message.get('clause')})")
        self.code = message.get("code")
        self.clause = message.get("clause")


class Closed(Error):
    """The connection could not be opened or has ended. `code` is the close code of PROTOCOL.md section 8, 1006 without one."""

    def __init__(self, code, text):
        super().__init__(f"{text} ({code})")
        self.code = code


# ---- Binary messages (PROTOCOL.md sections 6 and 7) ----

@dataclasses.dataclass
class Picture:
    """An image from the server. Times are microseconds since 1970 by the server's clock, durations microseconds."""
    format: str  # "jpeg", "exr_half", "exr_float", "h264" or "changes"
    flags: int
    sequence: int
    frame: int  # the number of the sky
    capture_us: int  # of the sky, by its producer's clock; 0: unknown
    published_us: int
    queued_us: int
    decoded_us: int
    shaded_us: int
    encoded_us: int
    width: int
    height: int
    gain: float  # from radiance to the tone curve
    samples: int
    payload: bytes  # the encoded file; of H.264 one access unit (Annex B)

    def radiance(self):
        """float32[height, width, 3]: linear Rec.709 before exposure. Of EXR pictures."""
        if not self.format.startswith("exr"):
            raise ValueError(f'a picture of format {self.format} has no radiance: subscribe to "exr_half" or "exr_float"')
        return read_exr(self.payload)

    def pixels(self):
        """uint8[height, width, 3]: sRGB, of JPEG pictures; of changes 255 where a pixel changed, its light was computed, and rays
        were traced (6.8), else 0."""
        if self.format not in ("jpeg", "changes"):
            raise ValueError(f'a picture of format {self.format} has no pixels here: subscribe to "jpeg"')
        try:
            from PIL import Image
        except ImportError as fault:
            raise ImportError("pixels() needs Pillow (Debian: python3-pil); payload is the JPEG or PNG file") from fault
        return numpy.asarray(Image.open(io.BytesIO(self.payload)).convert("RGB"))


def decode_picture(message):
    """The Picture in a binary message of the server; Malformed if it breaks a clause."""
    if len(message) >= 4 and bytes(message[:4]) != b"RLP1":
        raise Malformed("6.1", "the message does not begin with RLP1")
    if len(message) < PICTURE.size:
        raise Malformed("6.1", "the message ends inside its header")
    (_, header, form, flags, sequence, frame, capture, published, queued, decoded, shaded, encoded, width, height, gain, samples,
     payload, _) = PICTURE.unpack_from(message)
    known = sequence if sequence <= NUMBER_MAX else 0
    if not PICTURE.size <= header <= HEADER_MAX or header % 4:
        raise Malformed("6.2", f"a header of {header} bytes", known)
    if len(message) - header != payload or payload == 0:
        raise Malformed("6.3", "header and payload do not add up to the message", known)
    if form not in FORMATS:
        raise Malformed("6.4", f"unknown format {form}", known)
    if not (1 <= width <= SIDE_MAX and 1 <= height <= SIDE_MAX):
        raise Malformed("6.5", f"a picture of {width}x{height} pixels", known)
    if max(sequence, frame, abs(capture), abs(published)) > NUMBER_MAX or sequence == 0 or not (math.isfinite(gain) and gain >= 0):
        raise Malformed("6.6", "a number out of range", known)
    return Picture(FORMATS[form], flags, sequence, frame, capture, published, queued, decoded, shaded, encoded, width, height, gain,
                   samples, bytes(message[header:]))


def encode_sky(sky, number, *, layout="auto", capture_us=0, bottom_first=False):
    """The binary message of an environment frame. sky: an array of floats, shape (height, width, 3 or 4), top row first, linear
    Rec.709 radiance (float16 is sent as such, others as float32), or the bytes of an EXR or Radiance file. ValueError says what
    cannot be sent."""
    if layout not in LAYOUTS:
        raise ValueError(f"layout {layout!r}: expected one of {', '.join(LAYOUTS)}")
    for name, value, least in (("number", number, 0), ("capture_us", capture_us, -NUMBER_MAX)):
        if not isinstance(value, (int, numpy.integer)) or not least <= value <= NUMBER_MAX:
            raise ValueError(f"{name} {value!r}: expected an integer from {least} to {NUMBER_MAX}")
    width = height = channels = 0
    if isinstance(sky, (bytes, bytearray, memoryview)):
        payload = bytes(sky)
        if payload[:4] != b"v/1\x01" and payload[:2] != b"#?":
            raise ValueError(f"a sky that begins with {payload[:4]!r}: expected an EXR or Radiance file, or an array")
        encoding = 1 if payload[:4] == b"v/1\x01" else 2
    else:
        sky = numpy.asarray(sky)
        if sky.dtype.kind != "f":
            raise ValueError(f"a sky of type {sky.dtype}: expected floats, linear radiance")
        if sky.ndim != 3 or sky.shape[2] not in (3, 4):
            raise ValueError(f"a sky of shape {sky.shape}: expected (height, width, 3) or (height, width, 4)")
        height, width, channels = sky.shape
        if not (1 <= width <= SIDE_MAX and 1 <= height <= SIDE_MAX):
            raise ValueError(f"a sky of {width}x{height} texels: expected 1 to {SIDE_MAX} each")
        encoding = 3 if sky.dtype == numpy.float16 else 4
        payload = numpy.ascontiguousarray(sky, "<f2" if encoding == 3 else "<f4").tobytes()
    return FRAME.pack(b"RLE1", FRAME.size, encoding, LAYOUTS[layout], int(bottom_first), channels, 0, width, height, len(payload),
                      number, capture_us, 0) + payload


# ---- EXR as relightd writes it: one part, scan lines, no compression, ZIPS or ZIP, channels R, G and B ----

def read_exr(data):
    """float32[height, width, 3] of an EXR file such as relightd's pictures; Malformed if it is damaged or of another kind."""
    try:
        return _read_exr(data)
    except (struct.error, zlib.error, ValueError, KeyError, IndexError) as fault:
        raise Malformed("", f"an EXR file that cannot be read: {fault}") from None


def _attributes(data):
    """The header's attributes by name, and where it ends."""
    def text(at):
        end = data.index(b"\0", at)
        return data[at:end].decode("latin-1"), end + 1

    at, found = 8, {}
    while data[at] != 0:
        name, at = text(at)
        _, at = text(at)
        size, = struct.unpack_from("<I", data, at)
        found[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    return found, at + 1


def _read_exr(data):
    if data[:4] != b"v/1\x01" or data[5] & 0x1a:
        raise ValueError("not EXR, or of tiles, deep data or several parts")
    head, at = _attributes(data)
    rows = {0: 1, 2: 1, 3: 16}.get(head["compression"][0])
    left, top, right, bottom = struct.unpack("<4i", head["dataWindow"])
    width, height, names = right - left + 1, bottom - top + 1, head["channels"]
    if not rows or names[:1] in (b"", b"\0") or not (1 <= width <= SIDE_MAX and 1 <= height <= SIDE_MAX):
        raise ValueError(f"compression {head['compression'][0]}, {width}x{height} pixels")
    channels = []
    while names and names[0] != 0:
        name, names = names.split(b"\0", 1)
        channels.append((name.decode("latin-1"), {1: "<f2", 2: "<f4"}[struct.unpack_from("<i", names)[0]]))
        names = names[16:]
    line = sum(width * numpy.dtype(kind).itemsize for _, kind in channels)
    out = numpy.zeros((height, width, 3), numpy.float32)
    for chunk in struct.unpack_from(f"<{-(-height // rows)}Q", data, at):
        y, size = struct.unpack_from("<iI", data, chunk)
        count = min(rows, bottom + 1 - y)
        if y < top or count < 1:
            raise ValueError(f"rows from {y}")
        raw = _unpacked(data[chunk + 8:chunk + 8 + size], count * line, head["compression"][0])
        offset = 0
        for row in range(y - top, y - top + count):
            for name, kind in channels:
                values = numpy.frombuffer(raw, kind, width, offset)
                offset += values.nbytes
                if name in ("R", "G", "B"):
                    out[row, :, "RGB".index(name)] = values
    return out


def _unpacked(data, size, compression):
    """ZIP codes the differences of bytes, first all even ones, then all odd ones; a chunk that would grow stays as it was."""
    if compression == 0 or len(data) == size:
        raw = data
    else:
        coded = numpy.frombuffer(zlib.decompressobj().decompress(data, size), numpy.uint8)
        halves = numpy.cumsum(coded - numpy.uint8(128), dtype=numpy.uint8) + numpy.uint8(128)
        raw = numpy.empty_like(halves)
        middle = (len(halves) + 1) // 2
        raw[0::2], raw[1::2] = halves[:middle], halves[middle:]
        raw = raw.tobytes()
    if len(raw) != size:
        raise ValueError(f"{len(raw)} instead of {size} bytes in a chunk")
    return raw


# ---- The connection ----

def _address(url, token):
    """ws://HOST:PORT/ws and the token of http://, https://, ws:// and wss:// addresses, also of `relightd --show-link`."""
    parts = urllib.parse.urlsplit(url)
    schemes = {"ws": "ws", "http": "ws", "wss": "wss", "https": "wss"}
    if parts.scheme not in schemes or not parts.hostname:
        raise ValueError(f"{url!r}: expected ws://HOST:PORT or wss://HOST:PORT")
    said = urllib.parse.parse_qs(parts.fragment).get("token", [None])[0]
    page = parts.path or "/"
    path = page + "ws" if page.endswith("/") else page
    return f"{schemes[parts.scheme]}://{parts.netloc}{path}", token if token is not None else said


class Client:
    """A connection, for asyncio: `async with await Client.open(...) as client`. All functions belong to its event loop.

    welcome, status, settings: the newest such messages of the server (4.2, 4.8, 4.13.8), as dictionaries; {} before the first."""

    @classmethod
    async def open(cls, url, role="viewer", *, token=None, ca=None, **hello):
        """Connects. role: "viewer", "controller" or "producer". ca: a file with certificates to trust, as `--tls-self-signed`
        makes; by default those of the system. hello: further fields of 4.1, such as pace="lockstep", sequence="monday". Closed:
        there is no server, or it refuses."""
        if role not in ("viewer", "controller", "producer"):
            raise ValueError(f'role {role!r}: expected "viewer", "controller" or "producer"')
        url, token = _address(url, token)
        self = cls()
        self.welcome, self.status, self.settings = {}, {}, {}
        self._pictures = collections.deque()
        self._format = None
        self._waiting = {}  # futures by op and number
        self._request = self._number = self._credit = self._unreadable = 0
        self._fault = None
        self._changed = asyncio.Event()
        context = ssl.create_default_context(cafile=ca) if url.startswith("wss") else None
        try:
            self._socket = await websockets.connect(url, subprotocols=["relight.v1"], ssl=context, compression=None, max_size=None,
                                                    ping_interval=None)
        except (OSError, websockets.WebSocketException, asyncio.TimeoutError) as fault:
            raise Closed(1006, f"{url}: {fault or 'no answer'}") from fault
        self._reader = asyncio.ensure_future(self._read())
        try:
            await self._say(op="hello", role=role, version=VERSION, **({"token": token} if token is not None else {}), **hello)
            await self._until(lambda: self.welcome)
        except BaseException:
            await self.close()
            raise
        producer = self.welcome.get("producer") or {}
        self._credit += producer.get("credit", 0)
        self._frame_bytes = producer.get("frame_bytes", 0)
        last = producer.get("resume_after")
        self._number = 0 if last is None else last + 1
        return self

    async def close(self):
        self._fault = self._fault or Closed(1000, "the connection was closed here")
        await self._socket.close()
        await asyncio.gather(self._reader, return_exceptions=True)

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        await self.close()

    # -- pictures

    async def subscribe(self, format="jpeg", **limits):
        """Selects the format of images: "jpeg", "exr_half", "exr_float", "h264" or "changes" (a PNG); limits: quality, max_rate, max_width, max_height (4.3).
        Refused: the server does not offer it."""
        if format not in FORMATS.values():
            raise ValueError(f"format {format!r}: expected one of {', '.join(FORMATS.values())}")
        if format not in self.welcome["formats"]:
            raise Refused({"code": "not_offered", "clause": "4.3.1", "message": f"this server does not offer {format}"})
        _known(limits, ("quality", "max_rate", "max_width", "max_height"), "limit")
        self._format = format
        self._limits = limits
        self._pictures.clear()
        await self._ask("subscribe", format=format, **limits)

    async def picture(self):
        """The newest image not yet returned (H.264: the next). Waits for one. Subscribes to JPEG if there is no subscription."""
        if self._format is None:
            await self.subscribe()
        await self._until(lambda: self._pictures)
        if self._format != "h264":
            while len(self._pictures) > 1:
                self._pictures.popleft()
        picture = self._pictures.popleft()
        await self._say(op="ack", sequence=picture.sequence)
        return picture

    async def pictures(self):
        """All further images: `async for picture in client.pictures()`. Ends after one with flag LAST."""
        while True:
            picture = await self.picture()
            yield picture
            if picture.flags & LAST:
                return

    # -- settings

    async def control(self, **settings):
        """Changes settings by the names of 4.13, such as tone="filmic", camera="roof", step=1. Returns all settings.
        ValueError: the server has no such setting. Refused: a value is not accepted, or the role is not controller."""
        known = set(self.welcome.get("controls", {})) | set(self.settings) - {"op", "by", "request", "counted"}
        _known(settings, known | {"camera", "paused", "step", "seek", "hour", "save_view", "forget_view"}, "setting")
        return await self._ask("control", **settings)

    async def probe(self, x, y, **more):
        """Where the light of a pixel comes from (4.15), as a dictionary."""
        _known(more, ("samples", "preset", "sky"), "field")
        return await self._ask("probe", x=x, y=y, **more)

    # -- skies

    async def feed(self, sky, number=None, **how):
        """Sends a sky as encode_sky() takes it, numbered from 0 or after the last one, and waits for its fate: {"fate": "used",
        "sequence": ...} or "superseded". Refused: it cannot be used."""
        if "producer" not in self.welcome:
            raise Error('only a producer may feed skies: connect with role="producer"')
        number = self._number if number is None else number
        message = encode_sky(sky, number, **how)
        if len(message) > self._frame_bytes:
            raise ValueError(f"a sky of {len(message)} bytes: this server takes at most {self._frame_bytes}")
        await self._until(lambda: self._credit > 0)
        self._credit -= 1
        self._number = number + 1
        fate = self._waiting["frame", number] = asyncio.get_running_loop().create_future()
        await self._send(message)
        return await self._answer(("frame", number), fate)

    async def end(self):
        """Tells the server that no more skies follow for now."""
        await self._say(op="end")

    # -- inside

    async def _send(self, data):
        try:
            await self._socket.send(data)
        except websockets.ConnectionClosed:
            await asyncio.gather(self._reader, return_exceptions=True)  # it knows why
            raise self._fault from None

    async def _say(self, **message):
        await self._send(json.dumps(message))

    async def _until(self, what):
        while not what():
            if self._fault:
                raise self._fault
            self._changed.clear()
            await self._changed.wait()

    async def _ask(self, op, **fields):
        self._request += 1
        key = op, self._request
        answer = self._waiting[key] = asyncio.get_running_loop().create_future()
        await self._say(op=op, request=self._request, **fields)
        return await self._answer(key, answer)

    async def _answer(self, key, future):
        try:
            if self._fault:
                raise self._fault
            message = await future
        finally:
            self._waiting.pop(key, None)
        if message["op"] == "error" or message.get("fate") == "refused":
            raise Refused(message)
        return {name: value for name, value in message.items() if name not in ("op", "request", "by")}

    async def _read(self):
        """Reads all messages until the connection ends; then every waiting call gets the reason."""
        fatal = ""
        try:
            async for message in self._socket:
                if isinstance(message, bytes):
                    await self._take_picture(message)
                else:
                    message = json.loads(message)
                    if message["op"] == "error" and message.get("fatal"):
                        fatal = f"{message.get('message')} ({message.get('code')}, clause {message.get('clause')})"
                    self._take(message)
                self._changed.set()
        except websockets.ConnectionClosed:
            pass
        except (Error, ValueError, KeyError, TypeError, AttributeError) as fault:
            self._fault = fault if isinstance(fault, Error) else Malformed("3.1", f"a message that cannot be read: {fault!r}")
            await self._socket.close()
        finally:
            text = fatal or self._socket.close_reason or "the connection ended"
            self._fault = self._fault or Closed(self._socket.close_code or 1006, text)
            for future in self._waiting.values():
                if not future.done():
                    future.set_exception(self._fault)
            self._changed.set()

    async def _take_picture(self, message):
        try:
            picture = decode_picture(message)
        except Malformed as fault:
            self._unreadable += 1
            if self._unreadable > UNREADABLE_MOST:
                raise
            if self._format == "h264":  # the chain is broken: it continues at a keyframe
                await self._say(op="subscribe", format="h264", **self._limits)
            elif fault.sequence:
                await self._say(op="ack", sequence=fault.sequence)
            return
        self._unreadable = 0
        if picture.format == self._format:  # else of the subscription before
            self._pictures.append(picture)

    def _take(self, message):
        op = message["op"]
        if op == "welcome":
            self.welcome = message
        elif op == "status":
            self.status = message
        elif op == "credit":
            self._credit += message["frames"]
        elif op == "control":
            self.settings = message
            if message.get("by") != self.welcome.get("id"):  # of another controller: its number means nothing here
                return
        elif op == "subscribed":
            self._pictures.clear()  # of the subscription before
        number = message.get("number" if op == "frame" else "request")
        for asked, future in self._waiting.items():
            if not future.done() and _answers(op, number, *asked):
                future.set_result(message)


def _answers(op, number, asked, asked_number):
    """Whether a message of the server answers a request. A control also answers earlier requests that were applied with it."""
    if op == "control":
        return asked == "control" and asked_number <= number
    if op == "error":
        return asked != "frame" and asked_number == number
    return {"subscribed": "subscribe", "probed": "probe"}.get(op, op) == asked and asked_number == number


def _known(given, known, what):
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            raise ValueError(f"no {what} {name!r}" + (f"; did you mean {near[0]!r}?" if near else f": there are {', '.join(sorted(known))}"))


# ---- Without asyncio ----

class Connection:
    """The same for programs without asyncio: each function waits, at most `timeout` seconds (None: without limit), else
    TimeoutError. Any thread."""

    def __init__(self, url, role="viewer", *, timeout=60, **more):
        self.timeout = timeout
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        try:
            self._client = self._wait(Client.open(url, role, **more))
        except BaseException:
            self._end()
            raise

    def _wait(self, work):
        async def limited():
            try:
                return await asyncio.wait_for(work, self.timeout)
            except asyncio.TimeoutError:
                raise TimeoutError(f"no answer within {self.timeout} s") from None
        return asyncio.run_coroutine_threadsafe(limited(), self._loop).result()

    def _end(self):
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def close(self):
        if not self._loop.is_closed():
            self._wait(self._client.close())
            self._end()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    welcome = property(lambda self: self._client.welcome)
    status = property(lambda self: self._client.status)
    settings = property(lambda self: self._client.settings)

    def subscribe(self, format="jpeg", **limits):
        self._wait(self._client.subscribe(format, **limits))

    def picture(self):
        return self._wait(self._client.picture())

    def pictures(self):
        while True:
            picture = self.picture()
            yield picture
            if picture.flags & LAST:
                return

    def control(self, **settings):
        return self._wait(self._client.control(**settings))

    def probe(self, x, y, **more):
        return self._wait(self._client.probe(x, y, **more))

    def feed(self, sky, number=None, **how):
        return self._wait(self._client.feed(sky, number, **how))

    def end(self):
        self._wait(self._client.end())


connect = Connection
