#!/usr/bin/python3
"""Hundreds of thousands of frames: soak.py [FRAMES]. A producer of 2x1 texels and a viewer of 32x18 pictures run as fast as relightd
allows; memory and descriptors are sampled regularly. The limit is on the slope over the second half: the first fills reused buffers."""

import asyncio
import json
import struct
import sys
import time

from faults import BINARY, TEXT, Raw, Relightd, check, environment, frame, hello, say
from peer import Failed

KIB_PER_10000 = 1.0
LOOKS = 40


def slope(points):
    """KiB per 10^4 frames, by least squares."""
    n = len(points)
    x, y = sum(p[0] for p in points) / n, sum(p[1] for p in points) / n
    return 1e4 * sum((a - x) * (b - y) for a, b in points) / sum((a - x) ** 2 for a, _ in points)


async def watch(raw, seen):
    while True:
        kind, payload = await raw.receive()
        check(kind is not None, f"the viewer's connection ended: {raw.said[-1:]}")
        del raw.said[:-1]
        if kind == BINARY and payload[:4] == b"RLP1":
            raw.send(say(op="ack", sequence=struct.unpack_from("<Q", payload, 8)[0]))
            seen[0] += 1


async def feed(raw, frames, done):
    credit, number = (await raw.until("welcome"))["producer"]["credit"], 0
    messages = [frame(BINARY, environment(i, size=(2, 1))) for i in range(32)]
    key = b"\x5a\x17\xc3\x88"  # the number is at byte 24 of the message, masked like the rest
    while done[0] < frames:
        while credit > 0 and number < frames + 16:
            number += 1
            credit -= 1
            data = bytearray(messages[number % 32])
            at = data.index(bytes(a ^ b for a, b in zip(b"RLE1", key))) + 24
            data[at:at + 8] = bytes(a ^ b for a, b in zip(struct.pack("<Q", number), key * 2))
            raw.send(bytes(data))
        kind, payload = await raw.receive()
        check(kind == TEXT, "the producer's connection ended")
        said = raw.said.pop()
        credit += said.get("frames", 0) if said["op"] == "credit" else 0
        if said["op"] == "frame":
            check(said["fate"] != "refused", f"{said}")
            done[0] += 1


async def soak(frames):
    async with Relightd("--size", "32x18", "--fps", "1000", "--samples", "1", "--method", "mis", "--converge", "off") as server:
        viewer, producer = await Raw.open(server.port), await Raw.open(server.port)
        for raw, said in ((viewer, hello() + say(op="subscribe", format="jpeg")), (producer, hello("producer"))):
            check(await raw.upgrade() == 101, "no handshake")
            raw.send(said)
        seen, done, looks = [0], [0], []
        begun = time.monotonic()
        tasks = [asyncio.ensure_future(watch(viewer, seen)), asyncio.ensure_future(feed(producer, frames, done))]
        descriptors = None
        while done[0] < frames:
            await asyncio.sleep(0.05)
            for task in tasks:
                if task.done() and task.exception():
                    raise task.exception()
            if done[0] >= frames // LOOKS * (len(looks) + 1):
                looks.append((done[0], server.memory_kib()))
                descriptors = descriptors or server.descriptors()
                check(server.descriptors() <= descriptors, f"{server.descriptors()} descriptors, {descriptors} before")
        took = time.monotonic() - begun
        tasks[0].cancel()
        half = looks[len(looks) // 2:]
        rises = slope(half)
        print(json.dumps({"frames": done[0], "pictures": seen[0], "seconds": round(took, 1), "kib_per_10000": round(rises, 2),
                          "memory_kib": [looks[0][1], half[0][1], looks[-1][1]], "descriptors": server.descriptors()}))
        check(rises < KIB_PER_10000 or looks[-1][1] - half[0][1] <= 8, f"{rises:.1f} KiB more per 10^4 frames")
        viewer.shut()
        producer.shut()


try:
    asyncio.run(soak(int(sys.argv[1]) if len(sys.argv) > 1 else 1000000))
except Failed as fault:
    sys.exit(f"FAILED: {fault}")
