#!/usr/bin/python3
"""A computed sky with its own rate without viewers: one frame per second, while its time goes on, and a new viewer
sees the present at once. Counters come from /metrics, so that the measurement does not count as a viewer."""

import asyncio
import json
import re
import time
import urllib.request

from peer import PICTURE, WAIT_S, check, main, until
from still import Daemon, connect

RATE = 20
SKY = ("--source", "sky:speed=1,size=128x64", "--rate", str(RATE), "--samples", "1", "--method", "mis", "--paths", "direct", "--edge-rays", "1")


def counted(daemon, name):
    url = daemon.url.replace("ws://", "http://").removesuffix("ws") + "metrics"
    text = urllib.request.urlopen(url, timeout=WAIT_S).read().decode()
    return float(re.search(rf"^{re.escape(name)} (\S+)$", text, re.M)[1])


def received(daemon):
    return counted(daemon, "relightd_frames_received_total")


async def made(daemon, more):
    """Waits until there are so many more; returns their number."""
    want = received(daemon) + more
    await until(lambda: received(daemon) >= want, "no frame is made")
    return received(daemon)


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


async def steps(daemon, count):
    """Frames, as numbers, that the sky goes on for each of so many that are made."""
    await made(daemon, 2)  # it runs at the slower pace
    first, before = counted(daemon, "relightd_frame_number"), received(daemon)
    await made(daemon, count)
    most = received(daemon) - before
    return (counted(daemon, "relightd_frame_number") - first) / most


async def a_sky_that_nobody_sees_is_made_once_a_second(folder):
    """The numbers of frames tell the time between them: RATE a second."""
    async with Daemon(*SKY) as daemon:
        step = await steps(daemon, 4)
        check(step > 0.6 * RATE, f"a frame each {step / RATE:.2f} s without anybody")
        async with connect(daemon.url) as link:
            await come(link)
            last = await picture(link)
            while (number := await picture(link)) - last not in range(1, RATE // 2):  # no more until then on a busy machine
                last = number
            await link.send(json.dumps({"op": "subscribe", "format": "jpeg", "request": 2, "paused": True}))
            await made(daemon, 2)  # which it had begun
            step = await steps(daemon, 3)
            check(step > 0.6 * RATE, f"who does not look has it made each {step / RATE:.2f} s all the same")


async def its_time_goes_on_meanwhile(folder):
    """At the given rate, though few frames are made."""
    async with Daemon(*SKY) as daemon:
        await made(daemon, 2)
        begun, first, before = time.monotonic(), counted(daemon, "relightd_frame_number"), received(daemon)
        await until(lambda: counted(daemon, "relightd_frame_number") >= first + 6 * RATE)
        went, count, most = counted(daemon, "relightd_frame_number") - first, received(daemon) - before, RATE * (time.monotonic() - begun)
        check(went <= most + 1.5 * RATE, f"{went} frames on in a time of {most:.0f}")
        check(count <= went / (0.6 * RATE) + 2, f"{count} frames were made for {went}")


async def whoever_comes_sees_the_present_at_once(folder):
    """A viewer comes after a frame was made, when the next would be a second later: one is made before. On a busy machine that
    second may pass before its connection is there: then the next one tries."""
    async with Daemon(*SKY) as daemon:
        for tries in range(1, 1000):
            await made(daemon, 2)  # it has noticed that there is no viewer
            last = counted(daemon, "relightd_frame_number")
            async with connect(daemon.url) as link:
                await come(link)
                while (number := await picture(link)) <= last:
                    pass
            if number <= last + RATE // 2:
                print(f"{number - last} frames later at try {tries}")
                return
        check(False, "never sooner than without it")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
