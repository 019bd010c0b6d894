#!/usr/bin/python3
"""The producer of docs/recipes.md: its length, and runs against a scripted server and relightd."""

import asyncio
import struct
from pathlib import Path

from peer import BIN, WAIT_S, Frame, Server, check, main, skip

PRODUCER = Path(__file__).parents[2] / "docs" / "examples" / "producer.py"


async def produce(url, count):
    process = await asyncio.create_subprocess_exec("/usr/bin/python3", str(PRODUCER), url, str(count),
                                                   stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    out, err = await asyncio.wait_for(process.communicate(), WAIT_S)
    return process.returncode, out.decode(), err.decode()


async def the_producer_has_at_most_40_lines(folder):
    count = len(PRODUCER.read_text().splitlines())
    check(count <= 40, f"{count} lines")


async def the_producer_keeps_to_the_protocol(folder):
    frames = []

    async def script(link):
        await link.welcome_producer(credit=2)
        frames.append(await link.frame())
        frames.append(await link.frame())
        await link.nothing()
        for number in range(5):
            await link.fate(number, "superseded" if number == 1 else "used")
            await link.credit()
            if number < 3:
                frames.append(await link.frame())
        check((await link.read())["op"] == "end", "no end")
        check(await link.parted() == 1000, "no clean close")

    async with Server(script) as server:
        code, out, err = await produce(server.url, 5)
    check(code == 0 and "frame 1 superseded" in out and "frame 4 used" in out, out + err)
    check([f.number for f in frames] == [0, 1, 2, 3, 4], "not five frames in order")
    for f in frames:
        check((f.encoding, f.layout, f.channels, f.width, f.height) == (4, 1, 3, 64, 32), "not 64x32 of raw float RGB")
        check(f.capture_us > 0 and max(struct.unpack("<6144f", f.payload)) == 400, "no time of capture, or no lamp")


async def generated_examples_are_small_and_render_without_warnings(folder):
    examples = PRODUCER.parent
    for name, flags in (("product", ("--scene", "product.json", "--source", "studio.hdr")), ("house", ("--scene", "house.glb"))):
        process = await asyncio.create_subprocess_exec("/usr/bin/python3", "-B", str(examples / f"{name}.py"), str(folder))
        check(await asyncio.wait_for(process.wait(), WAIT_S) == 0, name)
        size = sum(path.stat().st_size for path in folder.iterdir())
        check(0 < size < 2_000_000, f"{name}: {size} bytes")
        process = await asyncio.create_subprocess_exec(
            str(BIN / "relight-render"), *flags, "--size", "32x18", "--samples", "1", "--eye-paths", "1", "--particles", "1000", "--out",
            "x.png", cwd=folder, stderr=asyncio.subprocess.PIPE)
        _, err = await asyncio.wait_for(process.communicate(), WAIT_S)
        check(process.returncode == 0 and b"warning" not in err and b"error" not in err, err.decode())
        for path in folder.iterdir():
            path.unlink()


async def relightd_takes_what_the_producer_sends(folder):
    server = await asyncio.create_subprocess_exec(
        str(BIN / "relightd"), "--source", "push:", "--port", "0", "--size", "64x36", "--samples", "4",
        stderr=asyncio.subprocess.PIPE)
    said = ""
    try:
        while "listening on " not in said:
            line = await asyncio.wait_for(server.stderr.readline(), WAIT_S)
            said += line.decode()
            if not line:
                skip("this relightd takes no frames: " + said.strip())
        url = said.split("listening on http")[1].split()[0].rstrip("/")
        code, out, err = await produce("ws" + url, 12)
    finally:
        if server.returncode is None:
            server.terminate()
        await server.communicate()
    check(code == 0, out + err)
    fates = [line.split()[2] for line in out.splitlines()]
    check(len(fates) == 12 and set(fates) <= {"used", "superseded"} and fates[-1] == "used", out)
    check(server.returncode == 0, f"relightd ended with {server.returncode}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
