#!/usr/bin/python3
"""clients/python/relightd.py against the vectors of protocol/ and the real programs."""

import asyncio
import json
import os
import re
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

from peer import WAIT_S, Server, check, main, radiance, skip
from still import Daemon
from tls import certificate

try:
    import numpy
except ImportError:
    print("skipped: python3-numpy is not installed")
    sys.exit(77)

SOURCE = Path(__file__).parents[2]
sys.path.insert(0, str(SOURCE / "clients/python"))

import relightd  # noqa: E402

SMALL = ("--samples", "4", "--method", "mis", "--paths", "direct")
NAMES = {"captureUs": "capture_us", "publishedUs": "published_us", "queuedUs": "queued_us", "decodedUs": "decoded_us",
         "shadedUs": "shaded_us", "encodedUs": "encoded_us"}


def failure(kind, what):
    """The text of the exception that it must raise."""
    try:
        what()
    except kind as fault:
        return str(fault)
    check(False, f"no {kind.__name__}")


async def failure_of(kind, work):
    try:
        await work
    except kind as fault:
        return str(fault)
    check(False, f"no {kind.__name__}")


def vectors(kind):
    for path in sorted((SOURCE / "protocol/vectors").glob(f"{kind}_*.json")):
        yield json.loads(path.read_text(encoding="utf-8")), path.with_suffix(".bin").read_bytes()


async def vectors_of_pictures_are_read(folder):
    del folder
    count = 0
    for said, data in vectors("picture"):
        count += 1
        if "fails" in said:
            clause = said["fails"]
            check(f"clause {clause}" in failure(relightd.Malformed, lambda: relightd.decode_picture(data)), said["about"])
            continue
        picture = relightd.decode_picture(data)
        for name, value in said["header"].items():
            got = len(picture.payload) if name == "payload" else getattr(picture, NAMES.get(name, name))
            check(got == value, f"{said['about']}: {name} is {got}, not {value}")
        check(picture.payload.hex() == said["payload_hex"], said["about"])
        for size in range(len(data)):
            check(re.search("6.[13]", failure(relightd.Malformed, lambda: relightd.decode_picture(data[:size]))), f"cut at {size}")
    check(count >= 15, f"{count} vectors")


async def vectors_of_skies_are_written(folder):
    del folder
    count = 0
    for said, data in vectors("environment"):
        if "fails" in said or said.get("unknown") or said["bytes"] - said["header"]["payload"] != 48:
            continue
        head, payload = said["header"], bytes.fromhex(said["payload_hex"])
        if head["encoding"].startswith("raw"):
            kind = "<f2" if head["encoding"] == "raw_half" else "<f4"
            sky = numpy.frombuffer(payload, kind).reshape(head["height"], head["width"], head["channels"])
        elif payload[:2] != b"#?" and payload[:4] != b"v/1\x01":
            continue  # stands for a file
        else:
            sky = payload
        got = relightd.encode_sky(sky, head["frame"], layout=head["layout"], capture_us=head["captureUs"],
                                  bottom_first=bool(head["flags"] & 1))
        check(got == data, said["about"])
        count += 1
    check(count >= 2, f"{count} vectors")


async def what_cannot_be_sent_is_said(folder):
    del folder
    grey = numpy.ones((2, 4, 3), numpy.float32)
    for sky, how, words in ((grey.astype("u1"), {}, "type uint8"), (grey[..., 0], {}, "shape (2, 4)"), (b"II*\0abc", {}, "EXR or Radiance"),
                            (grey, {"layout": "cuboid"}, "expected one of auto, latlong"), (grey, {"number": -1}, "number -1"),
                            (numpy.ones((1, 20000, 3), "f2"), {}, "20000x1 texels")):
        said = failure(ValueError, lambda: relightd.encode_sky(sky, how.pop("number", 0), **how))
        check(words in said, f"{said} for {words}")
    for data, words in ((b"", "cannot be read"), (b"v/1\x01\x02\0\0\0\0", "compression"), (b"v/1\x01\x02\x10\0\0", "several parts")):
        check(words in failure(relightd.Malformed, lambda: relightd.read_exr(data)), words)


def rgb_of(png, width, height):
    """uint8[height, width, 3] of a PNG of 8 bits without interlacing."""
    at, packed = 8, b""
    while at < len(png):
        size = int.from_bytes(png[at:at + 4], "big")
        packed += png[at + 8:at + 8 + size] if png[at + 4:at + 8] == b"IDAT" else b""
        at += 12 + size
    data, rows = zlib.decompress(packed), [bytearray(3 * width)]
    for y in range(height):
        kind, *line = data[y * (3 * width + 1):(y + 1) * (3 * width + 1)]
        row = bytearray(3 * width)
        for i, value in enumerate(line):
            a, b, c = (row[i - 3], rows[-1][i], rows[-1][i - 3]) if i >= 3 else (0, rows[-1][i], 0)
            paeth = min((a, b, c), key=lambda v: abs(a + b - c - v))
            row[i] = (value + (0, a, b, (a + b) // 2, paeth)[kind]) % 256
        rows.append(row)
    return numpy.array(rows[1:], numpy.uint8).reshape(height, width, 3)


async def changed_pixels_are_those_with_other_numbers(folder):
    """A quarter of the sky gets brighter: the map has exactly the pixels whose floats differ."""
    del folder
    async with Daemon("--source", "push:", *SMALL) as daemon:
        async with (await relightd.Client.open(daemon.url) as viewer, await relightd.Client.open(daemon.url) as maps,
                    await relightd.Client.open(daemon.url, "producer") as producer):
            await viewer.subscribe("exr_float")
            await maps.subscribe("changes")
            sky = numpy.ones((16, 32, 3), numpy.float32)
            before = None
            for number in range(3):
                if number == 2:
                    sky[:6, :16] *= 2
                await producer.feed(sky, layout="latlong")
                while (picture := await viewer.picture()).frame != number or picture.flags & relightd.FINER:
                    pass
                while (told := await maps.picture()).frame != number:
                    pass
                image, told = picture.radiance(), rgb_of(told.payload, told.width, told.height)
                wanted = numpy.ones(image.shape[:2], bool) if before is None else (image != before).any(axis=2)
                check(((told[..., 0] == 255) == wanted).all() and set(told.ravel()) <= {0, 255}, f"frame {number}")
                check((told[..., 1] == 255).any() and not told[..., 2].any(), "what was computed")
                before = image
            check(0 < wanted.sum() < wanted.size, f"{wanted.sum()} pixels of {wanted.size} changed")


async def skies_from_numpy_light_pictures(folder):
    """Light is linear in the sky: twice the sky is twice the radiance, bit for bit, as halves of 1 and 2 are."""
    async with Daemon("--source", "push:", *SMALL) as daemon:
        async with await relightd.Client.open(daemon.url) as viewer, await relightd.Client.open(daemon.url, "producer") as producer:
            await viewer.subscribe("exr_float")
            dim = numpy.ones((16, 32, 3), numpy.float32) * numpy.array([1, 0.5, 0.25], numpy.float32)
            images = []
            for sky in (dim, (2 * dim).astype("f2"), radiance(size=(32, 16))):
                fate = await producer.feed(sky, layout="latlong")
                check(fate["fate"] == "used", str(fate))
                while True:
                    picture = await viewer.picture()
                    if picture.frame == len(images) and not picture.flags & relightd.FINER:
                        break
                images.append(picture.radiance())
            check(images[0].shape == (54, 96, 3) and images[0].max() > 0, f"{images[0].shape}, up to {images[0].max()}")
            check((images[1] == 2 * images[0]).all(), "not twice as bright")
            check(images[2].max() > 0, "a Radiance file gives black")
            said = await failure_of(relightd.Refused, producer.feed(numpy.ones((3, 7, 3), "f4")))
            check("bad_frame" in said, said)
            check((await producer.feed(dim, layout="latlong"))["fate"] == "used", "it does not go on")
            check("role" in await failure_of(relightd.Error, viewer.feed(dim)), "a viewer fed")
            await producer.end()


async def exr_is_read_like_oiiotool_does(folder):
    if not shutil.which("oiiotool"):
        skip("oiiotool is missing (openimageio-tools)")
    async with Daemon("--once", "--frames", "0-0", *SMALL) as daemon, await relightd.Client.open(daemon.url) as client:
        for form in ("exr_half", "exr_float"):
            await client.subscribe(form, max_width=64)
            picture = await client.picture()
            (folder / "x.exr").write_bytes(picture.payload)
            said = subprocess.run(["oiiotool", "--dumpdata", folder / "x.exr"], capture_output=True, text=True, check=True).stdout
            rows = re.findall(r"Pixel \((\d+), (\d+)\): ([-+.e\d]+) ([-+.e\d]+) ([-+.e\d]+)", said)
            check(len(rows) == picture.width * picture.height, f"{len(rows)} pixels")
            got = picture.radiance()
            for x, y, *rgb in rows:
                check(numpy.allclose(got[int(y), int(x)], [float(v) for v in rgb], rtol=1e-5, atol=1e-6), f"{form}: {x}, {y}")


async def settings_are_changed_and_refused(folder):
    del folder
    async with Daemon("--source", "sky:size=64x32", *SMALL) as daemon:
        async with await relightd.Client.open(daemon.url, "controller") as one:
            settings = await one.control(tone="linear", rotate_degrees=90)
            check(settings["tone"] == "linear" and settings["rotate_degrees"] == 90, str(settings))
            check("did you mean 'rotate_degrees'" in await failure_of(ValueError, one.control(rotate_degree=1)), "a wrong name")
            check("bad_field" in await failure_of(relightd.Refused, one.control(tone="loud")), "a wrong value")
            answers = await asyncio.gather(*(one.control(bias_stops=i) for i in range(5)))
            check(answers[-1]["bias_stops"] == 4, "requests in a row")
            picture = await one.picture()
            light = await one.probe(48, 40, samples=8)
            check(light["samples"] == 8 and light["width"] == 96, str(light)[:200])
            check(picture.format == "jpeg" and picture.payload[:2] == b"\xff\xd8", "no JPEG")
            check("exr" in failure(ValueError, picture.radiance), "radiance of a JPEG")
            check("exr_double" in await failure_of(ValueError, one.subscribe("exr_double")), "another format")
        async with await relightd.Client.open(daemon.url) as viewer:
            said = await failure_of(relightd.Closed, viewer.control(tone="filmic"))
            check("wrong_role" in said and "4004" in said, said)
            said = await failure_of(relightd.Closed, viewer.picture())
            check("4004" in said, said)


async def programs_without_asyncio_do_the_same(folder):
    """With TLS, a token from a link, and H.264 if the server has it."""
    cert, key = certificate(folder, "own")
    async with Daemon("--source", "sky:size=64x32", "--tls-cert", str(cert), "--tls-key", str(key), "--token-viewer", "v&1",
                      *SMALL) as daemon:
        def run():
            link = daemon.url.replace("wss", "https", 1).removesuffix("ws") + "#role=viewer&token=v%261"
            with relightd.connect(link, ca=cert) as server:
                check(server.picture().width == 96, "another picture")
                check(server.status["width"] == 96 and server.welcome["session"], "no status")
                if "h264" in server.welcome["formats"]:
                    server.subscribe("h264")
                    chain = [server.picture() for _ in range(2)]
                    check(chain[0].flags & relightd.KEY and chain[0].payload[:3] in (b"\0\0\1", b"\0\0\0"), "no keyframe")
                    check(chain[1].sequence == chain[0].sequence + 1 or chain[1].flags & relightd.KEY, "a broken chain")
                server.timeout = 0.0
                failure(TimeoutError, server.picture)
                server.timeout = 60
            check("4006" in failure(relightd.Closed, lambda: relightd.connect(link, ca=cert, token="wrong")), "a wrong token")
            check("certificate verify failed" in failure(relightd.Closed, lambda: relightd.connect(link)), "an unknown certificate")
        await asyncio.to_thread(run)
    check("1006" in await failure_of(relightd.Closed, relightd.Client.open(daemon.url)), "nobody is there")
    check("expected ws://" in await failure_of(ValueError, relightd.Client.open("localhost:8080")), "no address")


def snippets(page):
    return re.findall(r"^```python\n(.*?)^```$", (SOURCE / page).read_text(encoding="utf-8"), re.M | re.S)


async def examples_of_the_documentation_run(folder):
    def run(*arguments):
        done = subprocess.run(["/usr/bin/python3", "-B", *arguments], cwd=folder, capture_output=True, text=True, timeout=WAIT_S,
                              env={**os.environ, "PYTHONPATH": str(SOURCE / "clients/python")}, check=False)
        check(done.returncode == 0, f"{arguments}: {done.stderr}")
        return done.stdout

    codes = snippets("docs/client-libraries.md")
    check(len(codes) == 2, f"{len(codes)} snippets")
    async with Daemon("--source", "sky:size=64x32", *SMALL) as daemon:
        for code in codes:
            said = await asyncio.to_thread(run, "-c", code.replace("ws://localhost:8080", daemon.url))
            check("(54, 96, 3)" in said or said.count(" 96 54 ") == 3, said)
        check((folder / "now.jpg").read_bytes()[:2] == b"\xff\xd8", "no JPEG")
    async with Daemon("--source", "push:", *SMALL) as daemon:
        said = await asyncio.to_thread(run, str(SOURCE / "clients/python/example.py"), daemon.url, "2")
        check(said.count("mean ") == 2 and numpy.load(folder / "radiance.1.npy").shape == (54, 96, 3), said)


async def nonsense_of_a_server_ends_in_an_exception(folder):
    del folder

    async def garbles(link):
        await link.welcome("viewer")
        await link.read()
        await link.say(op="subscribed", request=1, format="jpeg", paused=False)
        for _ in range(20):
            await link.socket.send(b"RLP1" + bytes(200))

    async def no_json(link):
        await link.read()
        await link.socket.send("{")

    async with Server(garbles, no_json) as server:
        async with await relightd.Client.open(server.url) as client:
            check("6.2" in await failure_of(relightd.Malformed, client.picture()), "unreadable pictures")
        check("cannot be read" in await failure_of(relightd.Malformed, relightd.Client.open(server.url)), "no JSON")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
