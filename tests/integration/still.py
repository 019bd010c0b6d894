#!/usr/bin/python3
"""A viewer of a still sky (PROTOCOL.md 4.8.9 and flag 32 of 6), with an independent WebSocket library."""

import asyncio
import contextlib
import json
import os
import struct
import time

import websockets

from peer import BIN, PICTURE, WAIT_S, check, main, radiance

FINER = 32
SAMPLES = 8
# Passes use the remaining CPU time: beside two programs of a higher priority one run took three minutes instead of
# ten seconds, with the same result.
START_S = 3 * WAIT_S


class Watch:
    """What a viewer has received: frame, flags and samples of each picture; light of each status."""

    def __init__(self, link):
        self.link = link
        self.pictures = []
        self.lights = []

    async def take(self, most_s=WAIT_S):
        """Takes the next message."""
        message = await asyncio.wait_for(self.link.recv(), most_s)
        if isinstance(message, bytes):
            fields = PICTURE.unpack_from(message)
            await self.link.send(json.dumps({"op": "ack", "sequence": fields[4]}))
            self.pictures.append((fields[5], fields[3], fields[15]))
            return
        said = json.loads(message)
        check(said["op"] != "error", message)
        if said["op"] == "status":
            self.lights.append(said["light"])

    async def until(self, what):
        while not what():
            await self.take()

    def light(self):
        return self.lights[-1] if self.lights else {}

    async def silence(self, seconds):
        """The number of pictures within that time. It cancels no until(), which would go on for ever where a message
        has just come: asyncio.wait_for() then loses that."""
        before = len(self.pictures)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            with contextlib.suppress(asyncio.TimeoutError):
                await self.take(left)
        return len(self.pictures) - before


class Daemon:
    def __init__(self, *arguments):
        self.arguments = arguments

    async def __aenter__(self):
        self.process = await asyncio.create_subprocess_exec(
            str(BIN / "relightd"), "--port", "0", "--size", "96x54", *self.arguments, stderr=asyncio.subprocess.PIPE)
        line = self.before = ""  # its output until it listens
        while "listening on " not in line:
            line = (await asyncio.wait_for(self.process.stderr.readline(), START_S)).decode()
            check(line, "relightd ended: " + self.before)
            self.before += line
        self.url = line.split("listening on ")[1].split("\"")[0].strip().replace("http", "ws") + "ws"
        return self

    async def __aexit__(self, *_):
        if self.process.returncode is None:
            self.process.terminate()
        await self.process.wait()

    def cpu_s(self):
        with open(f"/proc/{self.process.pid}/stat", encoding="ascii") as file:
            fields = file.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def watching(link):
    await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 0}}))
    await link.send(json.dumps({"op": "subscribe", "format": "jpeg", "request": 1}))
    return Watch(link)


def connect(url):
    return websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, ping_interval=None, max_queue=None)


async def converges(daemon, error):
    """Waits for convergence; then nothing more is rendered or computed."""
    async with connect(daemon.url) as link:
        watch = await watching(link)
        await watch.until(lambda: watch.light().get("converged"))
        # The status precedes its picture, which must be encoded first; by how much depends on the machine.
        await watch.until(lambda: watch.pictures[-1][1] & FINER
                          and watch.pictures[-1][2] >= watch.light()["passes"] * SAMPLES)
        finer = [p for p in watch.pictures if p[1] & FINER]
        check(finer and finer[-1][0] == watch.pictures[0][0], f"not of the frame that stands still: {watch.pictures}")
        check(all(a[2] < b[2] for a, b in zip(finer, finer[1:])), f"no better than before: {finer}")
        told = [light for light in watch.lights if light["passes"]]
        check(all(a["passes"] <= b["passes"] for a, b in zip(told, told[1:])), f"passes are lost: {told}")
        check(0 < watch.light()["error"] <= error, f"another error than asked for: {watch.light()}")
        check(len(finer) < 40, f"{len(finer)} pictures")
        before = daemon.cpu_s()
        check(await watch.silence(2.0) == 0, "a picture came when nothing was to be made better")
        check(daemon.cpu_s() - before < 1.0, f"{daemon.cpu_s() - before} s of processor for a picture that is there")
        check(watch.light()["converged"], f"it is forgotten: {watch.light()}")


class Talking:
    """A connection whose next message has always just come."""

    messages = 0

    async def recv(self):
        self.messages += 1
        check(self.messages < 1000, "the silence does not end")
        time.sleep(0.001)
        return json.dumps({"op": "status", "light": {}})


async def a_silence_ends_though_messages_come_at_its_end(folder):
    watch = Watch(Talking())
    check(await watch.silence(0.1) == 0 and watch.lights, "messages are not taken")


async def a_picture_that_stands_still_converges(folder):
    async with Daemon("--size", "32x18", "--source", "sky:size=256x128", "--once", "--frames", "0-0", "--samples", str(SAMPLES), "--converge", "2e-3") as daemon:
        await converges(daemon, 2e-3)


async def a_cached_picture_converges_as_well(folder):
    async with Daemon("--size", "32x18", "--source", "sky:size=256x128", "--once", "--frames", "0-0", "--samples", str(SAMPLES), "--converge", "3e-4", "--method", "cached", "--paths", "direct",
                      "--cache-file", "off", "--cache-wait") as daemon:
        await converges(daemon, 3e-4)


async def one_that_is_to_stay_stays(folder):
    async with Daemon("--once", "--frames", "0-0", "--samples", "8", "--converge", "off") as daemon:
        async with connect(daemon.url) as link:
            watch = await watching(link)
            await watch.until(lambda: watch.pictures)
            check(await watch.silence(2.0) == 0, "another picture came")
            check(watch.light()["passes"] is None and watch.light()["converged"] is None, str(watch.light()))


def frame(number, payload):
    return struct.pack("<4sHBBBBHIIIQqQ", b"RLE1", 48, 2, 0, 0, 0, 0, 0, 0, len(payload), number, 0, 0) + payload


async def a_new_frame_ends_the_passes_of_the_old(folder):
    async with Daemon("--source", "push:", "--size", "48x27", "--samples", "64") as daemon, connect(daemon.url) as link, \
            connect(daemon.url) as producer:
        watch = await watching(link)
        await producer.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 0}}))
        for number in range(1, 4):
            await producer.send(frame(number, radiance(100 + number, size=(64, 32))))
            await watch.until(lambda: watch.pictures and watch.pictures[-1][0] == number
                              and watch.pictures[-1][1] & FINER)
        frames = [p[0] for p in watch.pictures]
        check(frames == sorted(frames), f"the old one comes after the new: {watch.pictures}")
        firsts = [p for p in watch.pictures if not p[1] & FINER]
        check([p[0] for p in firsts] == [1, 2, 3], f"not one first picture of each: {watch.pictures}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
