#!/usr/bin/python3
"""A sequence through relight-feed, relightd and relight-record equals relight-render's output bit for bit, even if
any of them is killed meanwhile."""

import asyncio
import os
import random
import re
import signal
import urllib.request
from pathlib import Path

from peer import WAIT_S, Program, check, expect, main, run, skip, until

RENDER = ("--size", "64x36", "--samples", "4", "--method", "mis", "--seed", "5", "--paths", "all")
SKY = "sky:size=128x64,speed=40,hour=5"


class Relightd:
    """A server that accepts frames; restart() uses the same port."""

    def __init__(self, *arguments):
        self.arguments = arguments
        self.port = 0

    async def __aenter__(self):
        await self.start()
        return self

    async def start(self):
        self.program = await Program("relightd", "--source", "push:", "--port", self.port, *RENDER,
                                     *self.arguments).start()
        said = ""
        while not (found := re.search(r"listening on http://127.0.0.1:(\d+)/", said)):
            line = await asyncio.wait_for(self.program.process.stderr.readline(), WAIT_S)
            said += line.decode()
            if not line:
                skip("this relightd takes no frames: " + said.strip())
        self.port = int(found[1])
        self.url = f"ws://127.0.0.1:{self.port}"
        self.drain = asyncio.ensure_future(self.program.end(None))

    async def stop(self, number=signal.SIGTERM):
        if self.program.process.returncode is None:
            self.program.process.send_signal(number)
        await asyncio.wait_for(self.drain, WAIT_S)

    async def restart(self):
        await self.stop(signal.SIGKILL)
        await self.start()

    async def __aexit__(self, kind, *_):
        await self.stop()
        if kind is None:
            check(self.program.code == 0, f"relightd ended with {self.program.code}: {self.program.err}")


def feed(server, *source):
    return Program("relight-feed", "--to", server.url, "--lockstep", "--sequence", "day", "--json", *source)


def record(server, folder, *more):
    return Program("relight-record", "--from", server.url, "--recorder", "day", "--json", "--out",
                   folder / "p.%04d.exr", *more)


async def rendered(folder, count, *source):
    """Renders the sequence with relight-render; returns the file names."""
    folder.mkdir()
    program = await run("relight-render", *RENDER, "--out", folder / "p.%04d.exr", *source)
    expect(program, 0)
    names = sorted(os.listdir(folder))
    check(len(names) == count, f"{len(names)} pictures instead of {count}")
    check(len({(folder / name).read_bytes() for name in names}) == count, "two frames give the same picture")
    return names


def compare(want, got, names):
    left = [name for name in sorted(os.listdir(got)) if not name.endswith(".part")]
    check(left == names, f"not the pictures of relight-render: {left}")
    for name in names:
        check((want / name).read_bytes() == (got / name).read_bytes(), f"{name} differs")


def varied_skies(folder, count):
    """Radiance files of 32x16 texels: noise, and a moving bright texel."""
    dice = random.Random(11)
    for i in range(count):
        texels = bytearray(b"".join(bytes([dice.randrange(20, 250), dice.randrange(20, 250), dice.randrange(20, 250),
                                           126]) for _ in range(512)))
        texels[4 * (150 + i):4 * (151 + i)] = bytes([250, 240, 200, 136])
        head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n"
        (folder / f"sky.{i:04d}.hdr").write_bytes(head + texels)
    return str(folder / "sky.%04d.hdr")


def a_day(folder, count):
    """Frames of a day, from the external data if available, else generated; returns pattern and count."""
    if data := os.environ.get("RELIGHT_TEST_DATA"):
        return str(Path(data) / "sky" / "sky.%04d.exr"), 67
    (folder / "sky").mkdir()
    return varied_skies(folder / "sky", count), count


async def pictures_are_those_of_relight_render(folder):
    (folder / "got").mkdir()
    source, count = a_day(folder, 20)
    async with Relightd() as server:
        recorder = await record(server, folder / "got", "--index", folder / "index").start()
        feeder = await (await feed(server, source).start()).end()
        expect(feeder, 0)
        expect(await recorder.end(), 0)
    names = await rendered(folder / "want", count, "--source", source)
    compare(folder / "want", folder / "got", names)
    check(feeder.summary()["used"] == count and feeder.summary()["superseded"] == 0, feeder.out)
    check(recorder.summary()["stored"] == count and recorder.summary()["again"] == 0, recorder.out)
    check(len((folder / "index").read_text().splitlines()) == count, "the index has other lines")


async def computed_skies_travel_without_a_bit_lost(folder):
    """Raw texels; the recorder comes late, and the feeder waits for it."""
    (folder / "got").mkdir()
    async with Relightd() as server:
        feeder = await feed(server, "--frames", "3-8", SKY).start()
        await asyncio.sleep(0.5)
        expect(await (await record(server, folder / "got").start()).end(), 0)
        expect(await feeder.end(), 0)
    names = await rendered(folder / "want", 6, "--source", SKY, "--frames", "3-8")
    compare(folder / "want", folder / "got", names)


async def a_sequence_waits_for_light_transport(folder):
    """Features that live images lack at first are in a sequence's images from the start."""
    (folder / "got").mkdir()
    cached = ("--method", "cached", "--cache-file", "off", "--paths", "direct")
    async with Relightd(*cached) as server:
        recorder = await record(server, folder / "got").start()
        feeder = await (await feed(server, "--frames", "20-24", SKY).start()).end()
        expect(feeder, 0)
        expect(await recorder.end(), 0)
    check("in the background" in server.program.err, server.program.err)
    names = await rendered(folder / "want", 5, "--source", SKY, "--frames", "20-24", *cached)
    compare(folder / "want", folder / "got", names)


class Kept:
    """A program that is killed and restarted until it ends by itself."""

    def __init__(self, make):
        self.make = make
        self.lives = self.kills = 0

    async def run(self):
        while True:
            self.program = await self.make().start()
            self.lives += 1
            await self.program.end()
            if self.program.code != -signal.SIGKILL:
                return self.program

    async def kill(self, task):
        while self.lives == self.kills:  # between two runs
            check(not task.done(), "it was over before all were killed")
            await asyncio.sleep(0.001)
        if self.program.process.returncode is None:
            self.program.process.kill()
        self.kills += 1


async def killed_at_random_it_is_still_the_same(folder):
    """Kills feeder and recorder ten times each, spread over the first two thirds of the sequence."""
    (folder / "got").mkdir()
    source, count = a_day(folder, 60)
    dice = random.Random(int(os.environ.get("RELIGHT_TEST_SEED", "7")))
    names = await rendered(folder / "want", count, "--source", source)
    async with Relightd() as server:
        ends = [Kept(lambda: feed(server, source)), Kept(lambda: record(server, folder / "got", "--index",
                                                                        folder / "index"))]
        tasks = [asyncio.ensure_future(end.run()) for end in ends]
        victims = [0, 1] * 10
        dice.shuffle(victims)
        for i, victim in enumerate(victims):
            began = asyncio.get_event_loop().time()
            while (len(os.listdir(folder / "got")) * len(victims) < i * count * 2 // 3
                   and asyncio.get_event_loop().time() - began < WAIT_S):
                await asyncio.sleep(0.002)
            await asyncio.sleep(dice.uniform(0, 0.03))
            await ends[victim].kill(tasks[victim])
        feeder, recorder = await asyncio.wait_for(asyncio.gather(*tasks), WAIT_S)
    expect(feeder, 0)
    expect(recorder, 0)
    check([end.lives for end in ends] == [11, 11], f"{[end.lives for end in ends]} lives")
    compare(folder / "want", folder / "got", names)
    check(sorted(os.listdir(folder / "got")) == names, "something half-written is left")


async def a_restarted_server_gets_all_again(folder):
    """The restarted server has lost the sequence: the feeder starts again, and the images are the same."""
    (folder / "got").mkdir()
    (folder / "sky").mkdir()
    source = varied_skies(folder / "sky", 30)
    names = await rendered(folder / "want", 30, "--source", source)
    async with Relightd() as server:
        recorder = await record(server, folder / "got").start()
        feeder = await feed(server, source).start()
        while len(os.listdir(folder / "got")) < 10:
            await asyncio.sleep(0.005)
        await server.restart()
        expect(await feeder.end(), 0, "has lost frames")
        expect(await recorder.end(), 0)
    compare(folder / "want", folder / "got", names)


async def live_frames_give_pictures_with_their_numbers(folder):
    """The last frame is rendered, whatever is superseded before it; the recorder gets the capture times."""
    (folder / "sky").mkdir()
    source = varied_skies(folder / "sky", 8)
    async with Relightd("--fps", "100") as server:
        recorder = await Program("relight-record", "--from", server.url, "--json", "--out", folder / "%d.jpg").start()
        await until(lambda: b'relightd_connections{role="viewer"} 1\n' in urllib.request.urlopen(
            server.url.replace("ws", "http", 1) + "/metrics", timeout=WAIT_S).read())
        feeder = await run("relight-feed", "--to", server.url, "--rate", "4", "--json", source)
        expect(feeder, 0)
        await until((folder / "7.jpg").exists)
        await recorder.kill(signal.SIGINT)
        expect(recorder, 0)
    check(feeder.summary()["used"] + feeder.summary()["superseded"] == 8, feeder.out)
    check((folder / "7.jpg").read_bytes()[:2] == b"\xff\xd8", "the last frame's picture is no JPEG")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
