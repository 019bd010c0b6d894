#!/usr/bin/python3
"""A computed sky with its own rate without viewers: one frame per second, while its time goes on, and a new viewer
sees the present at once. Counters come from /metrics, so that the measurement does not count as a viewer."""

import asyncio
import json
import re
import time
import urllib.request

from peer import PICTURE, WAIT_S, check, main
from still import Daemon, connect

RATE = 20
SKY = ("--source", "sky:speed=1,size=128x64", "--rate", str(RATE), "--samples", "1", "--method", "mis", "--paths", "direct", "--edge-rays", "1")


def counted(daemon, name):
    url = daemon.url.replace("ws://", "http://").removesuffix("ws") + "metrics"
    text = urllib.request.urlopen(url, timeout=WAIT_S).read().decode()
    return float(re.search(rf"^{name} (\S+)$", text, re.M)[1])


def received(daemon):
    return counted(daemon, "relightd_frames_received_total")


async def made(daemon, more):
    """Waits until there are so many more; returns their number."""
    want, end = received(daemon) + more, time.monotonic() + WAIT_S
    while (count := received(daemon)) < want:
        check(time.monotonic() < end, "no frame is made")
        await asyncio.sleep(0.02)
    return count


async def come(link):
    await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}))
    await link.send(json.dumps({"op": "subscribe", "format": "jpeg", "request": 1}))


async def picture(link):
    """The frame number of the next picture."""
    while True:
        message = await asyncio.wait_for(link.recv(), WAIT_S)
        if isinstance(message, bytes):
            fields = PICTURE.unpack_from(message)
            await link.send(json.dumps({"op": "ack", "sequence": fields[4]}))
            return fields[5]


async def unwatched(daemon):
    """Waits until it runs at the slower pace."""
    await made(daemon, 2)
    return received(daemon), time.monotonic()


async def a_sky_that_nobody_sees_is_made_once_a_second(folder):
    async with Daemon(*SKY) as daemon:
        before, begun = await unwatched(daemon)
        await asyncio.sleep(4)
        count, passed = received(daemon) - before, time.monotonic() - begun
        check(2 <= count <= passed + 2, f"{count} frames in {passed:.1f} s without anybody")
        async with connect(daemon.url) as link:
            await come(link)
            first, begun = await picture(link), time.monotonic()
            while await picture(link) < first + 2 * RATE:
                pass
            check(received(daemon) - before - count > 10, "no more are made when somebody is there")
            passed = time.monotonic() - begun
            await link.send(json.dumps({"op": "subscribe", "format": "jpeg", "request": 2, "paused": True}))
            await asyncio.sleep(0.5)
            before, begun = await unwatched(daemon)
            await asyncio.sleep(2)
            check(received(daemon) - before <= time.monotonic() - begun + 2, "who does not look has it made all the same")


async def its_time_goes_on_meanwhile(folder):
    """At the given rate, except for the second between two checks."""
    async with Daemon(*SKY) as daemon:
        await unwatched(daemon)
        first, begun = counted(daemon, "relightd_frame_number"), time.monotonic()
        await asyncio.sleep(6)
        went = counted(daemon, "relightd_frame_number") - first
        due = RATE * (time.monotonic() - begun)
        check(due - 2.5 * RATE <= went <= due + 1.5 * RATE, f"{went} frames on, and not {due:.0f}")


async def whoever_comes_sees_the_present_at_once(folder):
    """A viewer comes just after a frame was made, when the next would be a second later."""
    async with Daemon(*SKY) as daemon:
        waits = []
        for _ in range(5):
            await asyncio.sleep(1.5)  # it has noticed that there is no viewer
            await made(daemon, 1)
            async with connect(daemon.url) as link:
                begun = time.monotonic()
                await come(link)
                frames = set()  # up to three: the last encoded one, the current one, and the next
                while len(frames) < 4:
                    frames.add(await picture(link))
                waits.append(time.monotonic() - begun)
        print(f"a new frame after {', '.join(f'{w * 1e3:.0f}' for w in waits)} ms")
        check(sorted(waits)[2] < 0.7, f"a new frame after {waits} s")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
