#!/usr/bin/python3
"""relightd that publishes to nginx, for tests in other languages: hls_run.py hls|rtmp ARGUMENTS... Prints the address; `kill` on standard
input kills relightd and starts it again; the end of input ends all."""

import asyncio
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from hls import Site
from peer import BIN, Skipped, skip


async def run(folder):
    by_rtmp = sys.argv[1] == "rtmp"
    if "--publish" not in subprocess.run([BIN / "relightd", "--help"], capture_output=True, text=True, check=True).stdout:
        skip("this relightd cannot publish")
    async with Site(folder, rtmp=by_rtmp) as site:
        target = f"rtmp://127.0.0.1:{site.rtmp}/live/live" if by_rtmp else f"hls:{site.hls}"
        relightd = (str(BIN / "relightd"), "--port", "0", "--publish", target, *sys.argv[2:])
        process = site.start(*relightd)
        print(f"https://localhost:{site.port}/", flush=True)
        while await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline):
            process.send_signal(signal.SIGKILL)
            process.wait()
            process = site.start(*relightd)


with tempfile.TemporaryDirectory() as name:
    try:
        asyncio.run(run(Path(name)))
    except Skipped as why:
        print("skipped:", why, flush=True)
