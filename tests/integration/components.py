#!/usr/bin/python3
"""--method components in the whole program: the live picture is the sum that relight-render writes, and wrong parts end the start."""

import asyncio
import struct
import subprocess
from pathlib import Path

from http_pictures import first, get
from peer import BIN, WAIT_S, check, main
from still import Daemon

WIDTH, HEIGHT, PATCHES = 96, 54, 146


def view_matrix(path, columns=PATCHES):
    """As rcontrib -ff writes it: a row for each pixel, a column for each patch. The left half sees the ground, the right one
    every third patch of the sky."""
    left = struct.pack("<3f", 0.5, 0.25, 0.125) + bytes(12 * (columns - 1))
    right = b"".join(struct.pack("<3f", *[0.0 if k % 3 or not k else 1.0 / k] * 3) for k in range(columns))
    row = left * (WIDTH // 2) + right * (WIDTH // 2)
    path.write_bytes(b"#?RADIANCE\nrcontrib\nNCOMP=3\nNCOLS=%d\nBigEndian=0\nFORMAT=float\n\n" % columns + row * HEIGHT)


async def a_live_picture_is_the_sum_of_its_components(folder):
    folder = Path(folder)
    view_matrix(folder / "view.mtx")
    how = ["--method", "components", "--parts", str(folder / "view.mtx"), "--source", "cie:12,lux=17900,size=256x128"]
    subprocess.run([str(BIN / "relight-render"), *how, "--size", f"{WIDTH}x{HEIGHT}", "--out", str(folder / "file.exr")], check=True)
    async with Daemon(*how, "--token-viewer", "a-secret") as daemon:
        base = await first(daemon)
        status, _, body = await asyncio.to_thread(get, base, "/snapshot.exr")
        check(status == 200, f"no snapshot: {status} {body[:100]}")
        (folder / "live.exr").write_bytes(body)
    done = subprocess.run([str(BIN / "relight-diff"), str(folder / "live.exr"), str(folder / "file.exr"), "--max-mean", "1e-3",
                           "--max-relmse", "1e-5"], capture_output=True, text=True, check=False)
    check(done.returncode == 0, f"the live picture is another: {done.stdout}{done.stderr}")


async def a_server_without_its_components_does_not_start(folder):
    folder = Path(folder)
    view_matrix(folder / "view.mtx", 145)
    for arguments, words, code in ((["--parts", str(folder / "view.mtx")], "view.mtx: has 145 columns; a sky has 146, 578 or 2306", 1),
                                   (["--parts", str(folder / "%03d.hdr")], "000.hdr is missing or not readable", 1),
                                   ([], "--method components needs --parts, such as --parts 'parts/%03d.hdr'", 2)):
        done = subprocess.run([str(BIN / "relightd"), "--port", "0", "--size", f"{WIDTH}x{HEIGHT}", "--method", "components", *arguments],
                              capture_output=True, text=True, timeout=WAIT_S, check=False)
        check(done.returncode == code and words in done.stderr, f"{done.returncode}: {done.stderr}")


if __name__ == "__main__":
    main({f.__name__: f for f in (a_live_picture_is_the_sum_of_its_components, a_server_without_its_components_does_not_start)})
