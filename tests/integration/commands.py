#!/usr/bin/python3
"""Every command in the tables of docs/inputs-and-outputs.md is run as it stands there. Only names of hosts and folders are replaced by
this machine's, and flags are added that make it small."""

import asyncio
import json
import re
import shlex
import shutil
import socket
import struct
import subprocess
from pathlib import Path

from live import clip, ffmpeg, free_port
from peer import BIN, WAIT_S, check, main
from still import Daemon

DOCUMENT = Path(__file__).parents[2] / "docs" / "inputs-and-outputs.md"
SMALL = ["--size", "96x64", "--samples", "1", "--paths", "direct", "--edge-rays", "1"]
FEW = ["--frames", "0-1"]


def commands(title):
    """Rows of the table under that heading, as (name, list of commands)."""
    section = re.search(rf"^## {title}$(.*?)^## |^## {title}$(.*)", DOCUMENT.read_text() + "\n## ", re.M | re.S)
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", section[1] or section[2], re.M)
    return [(name, [c.replace(r"\|", "|") for c in re.findall(r"`([^`]+)`", cell)]) for name, cell in rows
            if name not in ("input", "output", "transfer function") and re.search(r"`(relight|curl|ffplay)", cell)]


def local(command, folder, ports):
    """The command for this machine."""
    for old, new in (("https://example.org", f"http://127.0.0.1:{ports[0]}"), ("camera:9000", f"127.0.0.1:{ports[1]}"),
                     ("0.0.0.0:9000", f"127.0.0.1:{ports[1]}"), ("HOST:9000", f"127.0.0.1:{ports[1]}"), ("@camera/", f"@127.0.0.1:{ports[0]}/"),
                     ("rtsp://camera/", f"rtsp://127.0.0.1:{ports[0]}/"), ("//server/", f"//127.0.0.1:{ports[0]}/"),
                     ("HOST/APP", f"127.0.0.1:{ports[0]}/APP"), ("HOST:8554", f"127.0.0.1:{ports[0]}"), ("/captures", f"{folder}/captures"),
                     ("/run/relightd/hls", f"{folder}/hls"), ("/srv/films", f"{folder}/films")):
        command = command.replace(old, new)
    return command


def prepare(folder):
    """The files that the commands name."""
    texels = bytes([128, 128, 128, 130]) * 32
    for number in range(3):
        (folder / "sky.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + texels)
        subprocess.run(("oiiotool", folder / "sky.hdr", "-o", folder / f"sky.{number:04}.exr")
                       if shutil.which("oiiotool") else ("cp", folder / "sky.hdr", folder / f"sky.{number:04}.exr"), check=True)
    clip(folder, "sky.mp4")
    subprocess.run(ffmpeg("-i", folder / "sky.mp4", "-frames:v", "1", folder / "sky.jpg"), check=True)
    (folder / "city.mtx").write_text("#?RADIANCE\nNROWS=146\nNCOLS=1\nNCOMP=3\nFORMAT=ascii\n\n" + "1 1 1\n" * 146)
    with open(folder / "city.epw", "w", encoding="ascii") as out:
        subprocess.run((DOCUMENT.parent / "examples" / "weather.py",), stdout=out, check=True)
    (folder / "captures").mkdir()
    (folder / "live").mkdir()


async def rendered(command, folder):
    """Runs relight-render, small, and returns what it made."""
    before = set(folder.iterdir())
    program, _, reader = command.partition(" | ")
    words = shlex.split(program)
    words = [BIN / words[0], *words[1:], *SMALL, *(FEW if "--frames" in words else [])]
    process = await asyncio.create_subprocess_exec(*map(str, words), cwd=folder, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    out, err = await asyncio.wait_for(process.communicate(), WAIT_S)
    check(process.returncode == 0, f"{command}: {err.decode()}")
    if reader: # ffplay needs a screen; ffmpeg reads the same
        done = subprocess.run(ffmpeg("-i", "-", "-f", "null", "-"), input=out, capture_output=True, check=False)
        check(reader == "ffplay -" and out and not done.returncode, f"{command}: {done.stderr}")
    made = set(folder.iterdir()) - before
    check(reader or made, f"{command} made nothing: {err.decode()}")
    for path in made:
        path.unlink()


async def served(command, folder, wanted, feeder=None, makes=None):
    """relightd listens, logs what is wanted and makes that folder; a second command may feed it."""
    words = shlex.split(command)
    check(words[0] == "relightd", command)
    process = await asyncio.create_subprocess_exec(str(BIN / "relightd"), *words[1:], "--port", "0", *SMALL, cwd=folder,
                                                   stderr=asyncio.subprocess.PIPE)
    feeding, log = None, ""
    try:
        async def read():
            nonlocal log, feeding
            while not (re.search(wanted, log) and "listening on" in log):
                line = await process.stderr.readline()
                check(line, f"{command} ended: {log}")
                log += line.decode()
                if feeder and not feeding and "listening on" in log:
                    to = re.search(r"listening on http(\S+)/", log)[1]
                    first, *rest = shlex.split(feeder)
                    feeding = await asyncio.create_subprocess_exec(str(BIN / first), "--to", "ws" + to, *rest, cwd=folder,
                                                                   stderr=asyncio.subprocess.DEVNULL)
                    check(await asyncio.wait_for(feeding.wait(), WAIT_S) == 0, f"{feeder} failed")
        async def until_made():
            while makes and not makes.exists():
                await asyncio.sleep(0.05)
        try:
            await asyncio.wait_for(read(), WAIT_S)
            await asyncio.wait_for(until_made(), WAIT_S)
        except asyncio.TimeoutError:
            check(False, f"{command} does not log '{wanted}', or make {makes}: {log}")
    finally:
        for child in (feeding, process):
            if child and child.returncode is None:
                child.terminate()
                await child.wait()


async def every_input_of_the_docs_works_as_typed(folder):
    """Streams and cameras that are not there are waited for by name; live.py has them with real senders."""
    prepare(folder)
    ports = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    rows = commands("Inputs")
    check(len(rows) >= 14, f"{len(rows)} rows")
    for _, given in rows:
        command = local(given[0], folder, ports)
        if command.startswith("relight-render"):
            await rendered(command, folder)
        elif command.startswith("relight-feed"):
            words = shlex.split(command.replace("ws://server:8080", f"ws://127.0.0.1:{ports[0]}"))
            process = await asyncio.create_subprocess_exec(str(BIN / words[0]), *words[1:], stderr=asyncio.subprocess.PIPE)
            line = (await asyncio.wait_for(process.stderr.readline(), WAIT_S)).decode()
            check(process.returncode is None and str(ports[0]) in line, f"{command}: {line}")
            process.terminate()
            await process.wait()
        elif "push:" in command:
            await served(command, folder, "listening", feeder=given[1])
        else:
            waits = "://" in command and "mode=listener" not in command or "v4l2:" in command
            await served(command, folder, "trying again|libavdevice" if waits else "listening on")
        print("ok:", given[0])


async def every_output_of_the_docs_works_as_typed(folder):
    prepare(folder)
    ports = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    rows = commands("Outputs")
    check(len(rows) >= 14, f"{len(rows)} rows")
    for name, given in rows:
        command = local(next(c for c in reversed(given) if c.startswith(("relight", "curl"))), folder, ports)
        if command.startswith("relight-render"):
            await rendered(command, folder)
        elif command.startswith("relightd"):
            refused = "rtmp://" in command or "rtsp://" in command
            await served(command, folder, "connecting: Connection refused" if refused else "listening on",
                         makes=folder / "hls" if "hls:" in command else folder / "films" if "record:" in command else None)
        else: # of a server that runs
            async with Daemon("--source", "sky:size=64x32", *SMALL) as daemon:
                host = daemon.url.split("//")[1].split("/")[0]
                words = shlex.split(command.replace("HOST:8080", host))
                if words[0].startswith("relight"):
                    words = [BIN / words[0], *words[1:], "--frames", "1"]
                else:
                    words[1:1] = ["-s", "--fail", "--retry", "9", "--retry-delay", "1"] # until there is a picture
                process = await asyncio.create_subprocess_exec(*map(str, words), cwd=folder)
                check(await asyncio.wait_for(process.wait(), WAIT_S) == 0, f"{command}: {process.returncode}")
        print("ok:", name, command)
    data = (folder / "snapshot.png").read_bytes()
    check(struct.unpack_from(">II", data, 16) == (96, 64), "no snapshot")
    check(list((folder / "live").glob("*.jpg")), "nothing recorded")


if __name__ == "__main__":
    main(globals())
