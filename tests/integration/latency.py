#!/usr/bin/python3
"""How late pictures are on each way in and out: latency.py [SECONDS=14] [PATH...]. Prints a table in milliseconds.

The sky steps through twelve brightnesses, one a second by the system's clock, so each picture shows when its sky was sent. Ways
in are measured from the moment when a frame is handed to the sender (ffmpeg, GStreamer, a file that appears) until its picture
has arrived by WebSocket; ways out from the moment when the sky's file appears until a receiver has decoded the picture. Nothing
is asserted about times, which depend on the machine. RELIGHT_BIN names the programs."""

import asyncio
import contextlib
import json
import math
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import websockets

from live import Web, ffmpeg, free_port
from peer import BIN, PICTURE, SKIPPED, Skipped, check, main, skip
from still import Daemon, connect

LEVELS, FPS = 12, 25
SETTLE_S = 4
SIZE = (96, 54)
SKY = (32, 16)
LIGHT = ("--size", f"{SIZE[0]}x{SIZE[1]}", "--method", "mis", "--samples", "1", "--paths", "direct", "--converge", "off",
         "--tone", "linear", "--quality", "95")
VIDEO_EXPOSURE, FILE_EXPOSURE = "-9", "-1"  # the brightest level is just not clipped
QUICK = ("-fflags", "nobuffer", "-flags", "low_delay", "-threads", "1", "-probesize", "32768", "-analyzeduration", "0")
GREY = ("-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "gray", "-")


def level(now):
    return int(now) % LEVELS


def light(now):
    """Relative radiance: half a stop a level."""
    return 2.0 ** ((level(now) - LEVELS + 1) / 2)


async def ticks(rate=FPS):
    """The times of frames, which include every full second."""
    number = math.ceil(time.time() * rate)
    while True:
        await asyncio.sleep(max(0.0, number / rate - time.time()))
        yield number / rate + 1e-6
        number = max(number + 1, math.ceil((time.time() - 0.5) * rate))


# ---- Ways in ----

def texels(now):
    """An 8-bit picture that BT.1886 makes light of."""
    return bytes([round(255 * light(now) ** (1 / 2.4))]) * (SKY[0] * SKY[1])


async def write_frames(stream):
    with contextlib.suppress(ConnectionError):
        async for now in ticks():
            stream.write(texels(now))
            await stream.drain()


def hdr(now):
    mantissa, exponent = math.frexp(light(now))
    return (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([int(256 * mantissa)] * 3 + [128 + exponent]) * 32)


async def write_files(folder):
    """Fewer than a busy machine can light, since a folder's files are all shown, one after the other."""
    number = 0
    async for now in ticks(10):
        number += 1
        (folder / "new").write_bytes(hdr(now))
        (folder / "new").rename(folder / f"sky.{number:06}.hdr")
        (folder / f"sky.{number - 100:06}.hdr").unlink(missing_ok=True)


@contextlib.asynccontextmanager
async def task(work):
    doing = asyncio.create_task(work)
    try:
        yield
    finally:
        doing.cancel()
        with contextlib.suppress(asyncio.CancelledError, asyncio.IncompleteReadError, websockets.ConnectionClosed):
            await doing


@contextlib.asynccontextmanager
async def program(*arguments, feed=False):
    """Runs it until the block ends, with the frames as its input."""
    process = await asyncio.create_subprocess_exec(*map(str, arguments), stdin=asyncio.subprocess.PIPE if feed else None,
                                                   stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL)
    try:
        async with task(write_frames(process.stdin)) if feed else contextlib.nullcontext():
            yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


def encoder(*output):
    return ffmpeg("-f", "rawvideo", "-pix_fmt", "gray", "-s", f"{SKY[0]}x{SKY[1]}", "-r", FPS, *QUICK, "-i", "-", "-c:v", "libx264",
                  "-preset", "ultrafast", "-tune", "zerolatency", "-g", FPS, "-pix_fmt", "yuv420p", "-qp", "10", "-flush_packets", "1", *output)


@contextlib.asynccontextmanager
async def by_rtmp(folder):
    url = f"rtmp://127.0.0.1:{free_port(socket.SOCK_STREAM)}/live/sky"
    async with program(*encoder("-f", "flv", "-listen", "1", url), feed=True):
        yield ("--source", url)


@contextlib.asynccontextmanager
async def by_srt(folder):
    url = f"srt://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    async with program(*encoder("-f", "mpegts", url + "?mode=listener"), feed=True):
        yield ("--source", url)


@contextlib.asynccontextmanager
async def by_rtsp(folder):
    try:
        import gi
        gi.require_version("GstRtspServer", "1.0")
    except (ImportError, ValueError):
        skip("gir1.2-gst-rtsp-server-1.0 is not installed")
    async with program(sys.executable, Path(__file__).with_name("rtsp_server.py"), *SKY, FPS, feed=True) as server:
        yield ("--source", f"rtsp://127.0.0.1:{int(await server.stdout.readline())}/sky")


@contextlib.asynccontextmanager
async def by_hls(folder):
    async with program(*encoder("-f", "hls", "-hls_time", "1", "-hls_list_size", "4", folder / "live.m3u8"), feed=True):
        while not (folder / "live.m3u8").exists():
            await asyncio.sleep(0.1)
        with Web(folder) as web:
            yield ("--source", web.url + "/live.m3u8")


@contextlib.asynccontextmanager
async def by_files(folder):
    async with task(write_files(folder)):
        yield ("--source", f"watch:{folder}")


@contextlib.asynccontextmanager
async def by_feed(folder):
    yield ("--source", "push:")


INPUTS = {"files": (by_files, "files in a watched folder"), "feed": (by_feed, "relight-feed of that folder"), "rtsp": (by_rtsp, "RTSP (GStreamer, VP8)"),
          "rtmp": (by_rtmp, "RTMP (ffmpeg, H.264)"), "srt": (by_srt, "SRT (ffmpeg, H.264)"), "hls": (by_hls, "HLS, segments of 1 s (ffmpeg)")}


# ---- Ways out: lists of (time of arrival, picture) ----

async def watch(daemon, seen):
    async with connect(daemon.url) as link:
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}))
        await link.send(json.dumps({"op": "subscribe", "format": "jpeg"}))
        async for message in link:
            if isinstance(message, bytes):
                await link.send(json.dumps({"op": "ack", "sequence": PICTURE.unpack_from(message)[4]}))
                seen.append((time.time(), message[PICTURE.size:]))


async def watch_mjpeg(daemon, seen):
    host, port = daemon.url.split("/")[2].split(":")
    head = b" 503 "
    while b" 503 " in head: # there is no picture yet
        reader, writer = await asyncio.open_connection(host, port)
        writer.write(f"GET /stream.mjpeg HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        head = await reader.readuntil(b"\r\n\r\n")
    while True:
        head = await reader.readuntil(b"\r\n\r\n")
        if b"Content-Length: " in head:
            seen.append((0, await reader.readexactly(int(head.split(b"Content-Length: ")[1].split(b"\r")[0]))))
            seen[-1] = (time.time(), seen[-1][1])


async def watch_decoded(process, seen):
    while True:
        grey = await process.stdout.readexactly(SIZE[0] * SIZE[1])
        seen.append((time.time(), grey))


async def watch_hls(folder, seen):
    while not (folder / "live.m3u8").exists():
        await asyncio.sleep(0.1)
    with Web(folder) as web: # at the pace of a player, from the newest segment on
        async with program(*ffmpeg("-threads", "1", "-re", "-live_start_index", "-1", "-i", web.url + "/live.m3u8", *GREY)) as process:
            await watch_decoded(process, seen)


# ---- Delays ----

def greys(pictures):
    """JPEG pictures, or grey texels as they are."""
    if pictures[0][:2] != b"\xff\xd8":
        return pictures
    done = subprocess.run(ffmpeg("-f", "image2pipe", "-c:v", "mjpeg", "-i", "-", *GREY), input=b"".join(pictures), capture_output=True, check=True)
    size = SIZE[0] * SIZE[1]
    check(len(done.stdout) == size * len(pictures), f"{len(done.stdout) / size} of {len(pictures)} pictures can be decoded")
    return [done.stdout[i:i + size] for i in range(0, len(done.stdout), size)]


LINEAR = [(c / 255 / 12.92 if c < 10 else ((c / 255 + 0.055) / 1.055) ** 2.4) for c in range(256)]


def delays(seen):
    """Milliseconds from each change of level until it was seen."""
    check(seen, "no picture arrives")
    means = [sum(LINEAR[c] for c in grey) for grey in greys([picture for _, picture in seen])]
    wraps = [before for before, after in zip(means, means[1:]) if after < before / 16]
    check(wraps, "the brightest level is not followed by the darkest")
    brightest = wraps[0]
    levels = [round(LEVELS - 1 + 2 * math.log2(max(m, 1e-9) / brightest)) for m in means]
    late = []
    for (_, before), (now, k) in zip(zip(seen, levels), zip((t for t, _ in seen[1:]), levels[1:])):
        if k == (before + 1) % LEVELS:
            late.append(1000 * ((now - k) % LEVELS))
    check(len(set(levels)) > LEVELS / 2, f"only these levels were seen: {sorted(set(levels))}")
    return sorted(late)


def tell(name, seen):
    late = delays(seen)
    check(late, f"{name}: no change of level was seen")
    print(f"{name:<44}{late[len(late) // 2]:9.0f}{late[int(0.95 * (len(late) - 1))]:9.0f}{len(late):9}", flush=True)
    return len(late)


async def measure_input(name, seconds):
    enter, title = INPUTS[name]
    with tempfile.TemporaryDirectory() as folder:
        folder, seen = Path(folder), []
        (folder / "skies").mkdir()
        async with enter(folder) as source:
            exposure = FILE_EXPOSURE if name in ("files", "feed") else VIDEO_EXPOSURE
            async with Daemon(*source, *LIGHT, "--exposure", exposure) as daemon, contextlib.AsyncExitStack() as stack:
                if name == "feed":
                    await stack.enter_async_context(task(write_files(folder / "skies")))
                    await stack.enter_async_context(program(BIN / "relight-feed", "--to", daemon.url.removesuffix("/ws"), f"watch:{folder}/skies"))
                async with task(watch(daemon, seen)):
                    await asyncio.sleep(SETTLE_S)
                    seen.clear()
                    await asyncio.sleep(max(seconds, LEVELS + 1))
        return tell(title, seen)


async def measure_outputs(wanted, seconds):
    ports = {name: free_port(socket.SOCK_DGRAM if name == "srt" else socket.SOCK_STREAM) for name in ("rtmp", "rtsp", "srt")}
    urls = {"rtmp": f"rtmp://127.0.0.1:{ports['rtmp']}/live/stream", "rtsp": f"rtsp://127.0.0.1:{ports['rtsp']}/stream",
            "srt": f"srt://127.0.0.1:{ports['srt']}"}
    listen = {"rtmp": ("-listen", "1", "-i", urls["rtmp"]), "rtsp": ("-rtsp_flags", "listen", "-i", urls["rtsp"]),
              "srt": ("-i", urls["srt"] + "?mode=listener")}
    titles = {"websocket": "WebSocket, JPEG", "mjpeg": "/stream.mjpeg", "rtmp": "--publish rtmp:", "rtsp": "--publish rtsp:",
              "srt": "--publish srt:", "publish-hls": "--publish hls:, segments of 2 s, by ffmpeg"}
    seen = {name: [] for name in titles if not wanted or name in wanted}
    with tempfile.TemporaryDirectory() as folder:
        skies, hls = Path(folder, "skies"), Path(folder, "hls")
        skies.mkdir()
        async with contextlib.AsyncExitStack() as stack:
            for name in ports.keys() & seen.keys():
                process = await stack.enter_async_context(program(*ffmpeg(*QUICK, *listen[name], *GREY)))
                await stack.enter_async_context(task(watch_decoded(process, seen[name])))
            publish = [urls[name] for name in ports.keys() & seen.keys()] + [f"hls:{hls}"] * ("publish-hls" in seen)
            daemon = await stack.enter_async_context(Daemon("--source", f"watch:{skies}", *LIGHT, "--exposure", FILE_EXPOSURE,
                                                            *(word for url in publish for word in ("--publish", url))))
            await stack.enter_async_context(task(write_files(skies)))
            for name, work in (("websocket", watch), ("mjpeg", watch_mjpeg)):
                if name in seen:
                    await stack.enter_async_context(task(work(daemon, seen[name])))
            if "publish-hls" in seen:
                await stack.enter_async_context(task(watch_hls(hls, seen["publish-hls"])))
            await asyncio.sleep(2 * SETTLE_S)
            for name in seen:
                seen[name].clear()
            await asyncio.sleep(max(seconds, LEVELS + 1))
        for name in seen:
            tell(titles[name], seen[name])


async def changes_of_a_sky_by_srt_are_seen(folder):
    """The levels are told apart; nothing about times."""
    changes = await measure_input("srt", LEVELS + 1)
    check(changes >= 4, f"{changes} of {LEVELS} changes were seen")


async def measure(seconds, wanted):
    if not shutil.which("ffmpeg"):
        skip("ffmpeg is not installed")
    print(f"{'source, to an image by WebSocket':<44}{'median':>9}{'95 %':>9}{'changes':>9}   ms")
    for name in INPUTS:
        if not wanted or name in wanted:
            await measure_input(name, seconds)
    outputs = [name.removeprefix("to-") for name in wanted if name.startswith("to-")]
    if not wanted or outputs:
        print(f"\n{'a file that appears, to an image by':<44}{'median':>9}{'95 %':>9}{'changes':>9}   ms")
        await measure_outputs(outputs, seconds)


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1] in globals():
        main(globals())
        sys.exit()
    try:
        asyncio.run(measure(float((sys.argv[1:] or ["14"])[0]), sys.argv[2:]))
    except Skipped as why:
        print("skipped:", why)
        sys.exit(SKIPPED)
