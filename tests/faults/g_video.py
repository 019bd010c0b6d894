#!/usr/bin/python3
"""Faults of video sources (group G): processes that die, and streams with damage. Rows on lost connections, playlists that point at
files, changes in mid-stream and absurd claims are tests of tests/integration/live.py and tests/unit/sky/source/test_video.c."""

import asyncio
import os
import random
import shutil
import signal
import subprocess
from pathlib import Path

from faults import Deadline, Relightd, Viewer, check, main, row, skip


def clip(path, seconds=4, more=()):
    """A keyframe every ten frames."""
    if not shutil.which("ffmpeg"):
        skip("ffmpeg is not installed")
    subprocess.run(["ffmpeg", "-v", "error", "-y", "-f", "lavfi", "-i", f"testsrc2=s=128x64:r=25:d={seconds}", "-c:v", "libx264",
                    "-pix_fmt", "yuv420p", "-g", "10", *more, path], check=True)
    return path


def helper(server, name):
    """The id of the server's process of that name, or None."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text(encoding="ascii").rsplit(")", 1)
            except OSError:
                continue
            if fields[0].split("(", 1)[1] == name[:15] and int(fields[1].split()[1]) == server.pid and fields[1].split()[0] != "Z":
                return int(entry.name)
    return None


async def renewed(server, name, old):
    async with Deadline():
        while helper(server, name) in (None, old):
            await asyncio.sleep(0.05)


@row(alone=True)
async def G171_video_processes_are_killed(folder):
    path = clip(folder / "clip.mp4")
    async with Relightd(source=str(path)) as server, Viewer(server) as viewer:
        await viewer.sees(3)
        for name in ("relight-video", "relight-demux"):
            for number in (signal.SIGKILL, signal.SIGSEGV):
                old = helper(server, name)
                check(old, f"no process {name}")
                os.kill(old, number)
                await renewed(server, name, old)
                await viewer.sees(5)
        left = [name for name in ("relight-demux", "relight-video") if not helper(server, name)]
        check(not left, f"not started again: {left}")
    return "relight-video and relight-demux killed twice each: the video goes on"


@row(alone=True)
async def G172_video_with_damage_everywhere(folder):
    """Every 700th byte or so is another; played again and again."""
    path = clip(folder / "clip.ts")
    dice = random.Random(5)
    data = bytearray(path.read_bytes())
    for at in range(2000, len(data), 700):
        data[at + dice.randrange(600)] = dice.randrange(256) if at + 600 < len(data) else 0
    path.write_bytes(data)
    async with Relightd(source=str(path)) as server, Viewer(server) as viewer:
        await viewer.sees(60)
        before = server.memory_kib()
        await viewer.sees(200)
        grown = server.memory_kib() - before
        check(grown < 8192, f"memory grows by {grown} KiB")
    return f"{len(data) // 700} damaged places: pictures go on; +{max(grown, 0)} KiB"


if __name__ == "__main__":
    main()
