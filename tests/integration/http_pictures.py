#!/usr/bin/python3
"""Pictures by plain HTTP from the whole program: formats, widths, a stream, the token, metrics. Readers are curl, and ffmpeg
where it is installed; sizes are read from the files' own headers."""

import asyncio
import shutil
import struct
import subprocess
import tempfile
import urllib.error
import urllib.request
from pathlib import Path

from peer import WAIT_S, check, main
from still import Daemon

SKY = ("--source", "sky:speed=1,size=128x64", "--samples", "1", "--paths", "direct", "--edge-rays", "1", "--token-viewer", "a-secret")
SIZE = (96, 54)


def jpeg_size(data):
    check(data[:2] == b"\xff\xd8" and data[-2:] == b"\xff\xd9", "no whole JPEG")
    at = 2
    while data[at + 1] not in (0xC0, 0xC1, 0xC2):
        at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    height, width = struct.unpack_from(">HH", data, at + 5)
    return width, height


def png_size(data):
    check(data[:8] == b"\x89PNG\r\n\x1a\n" and data[-8:-4] == b"IEND", "no whole PNG")
    return struct.unpack_from(">II", data, 16)


def exr_size(data):
    check(data[:4] == b"\x76\x2f\x31\x01", "no EXR")
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    left, top, right, bottom = struct.unpack_from("<4i", data, at)
    return right - left + 1, bottom - top + 1


def get(base, path, token="a-secret"):
    """Status, headers and body."""
    request = urllib.request.Request(base + path, headers={"Authorization": f"Bearer {token}"} if token else {})
    try:
        with urllib.request.urlopen(request, timeout=WAIT_S) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def base_of(daemon):
    return daemon.url.replace("ws://", "http://").removesuffix("/ws")


async def first(daemon):
    """Waits for the first picture."""
    base = base_of(daemon)
    while (await asyncio.to_thread(get, base, "/snapshot.jpg"))[0] == 503:
        await asyncio.sleep(0.05)
    return base


async def snapshots_have_their_format_and_width(folder):
    async with Daemon(*SKY) as daemon:
        base = await first(daemon)
        for path, kind, size in (("jpg", "image/jpeg", jpeg_size), ("png", "image/png", png_size), ("exr", "image/x-exr", exr_size)):
            for width, height in (SIZE, (40, 23), (16, 9), (5000, None)):
                query = "" if (width, height) == SIZE else f"?width={width}"
                status, headers, body = await asyncio.to_thread(get, base, f"/snapshot.{path}{query}")
                check(status == 200 and headers["Content-Type"] == kind, f"{path}{query}: {status} {body[:100]}")
                check(headers["Cache-Control"] == "no-store", "it may be stored")
                check(size(body) == ((width, height) if height else SIZE), f"{path}{query}: {size(body)}")
        status, headers, body = await asyncio.to_thread(get, base, "/snapshot.jpg", None)
        check(status == 401 and b"Bearer TOKEN" in body, f"without a token: {status} {body}")


async def streams_are_read_by_other_programs(folder):
    async with Daemon(*SKY) as daemon:
        base = await first(daemon)
        address = base.replace("http://", "http://viewer:a-secret@") + "/stream.mjpeg?width=48"
        got = Path(folder, "stream.mjpeg")
        with open(got, "wb") as out, subprocess.Popen(["curl", "-s", "-N", address], stdout=out) as curl:
            while got.read_bytes().count(b"--relightd\r\nContent-Type") < 5:
                check(curl.poll() is None, f"curl ended: {curl.returncode}")
                await asyncio.sleep(0.05)
            status, _, metrics = await asyncio.to_thread(get, base, "/metrics")
            curl.terminate()
        check(status == 200 and b'relightd_http_watchers{kind="stream"} 1\n' in metrics, "the stream is not counted")
        parts = got.read_bytes().split(b"--relightd\r\n")[1:5]
        for part in parts:
            head, _, body = part.partition(b"\r\n\r\n")
            check(b"Content-Length: %d" % (len(body) - 2) in head, "a part of another length")
            check(jpeg_size(body[:-2]) == (48, 27), "a part of another size")
        if shutil.which("ffmpeg"):
            subprocess.run(["ffmpeg", "-v", "error", "-i", address, "-frames:v", "3", str(Path(folder, "%d.png"))], check=True,
                           timeout=WAIT_S)
            check(png_size(Path(folder, "3.png").read_bytes()) == (48, 27), "ffmpeg saw another size")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f) and name != "first"})
