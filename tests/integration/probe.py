#!/usr/bin/python3
"""Pixel probes of the whole program (PROTOCOL.md 4.15 to 4.17), with an independent WebSocket library."""

import asyncio
import base64
import hashlib
import json

from peer import BIN, PICTURE, WAIT_S, check, main, radiance
from still import Daemon, connect, frame

SKY = ["--source", "sky:size=256x128,hour=9,speed=60", "--frames", "3-3", "--once"]
WAY = ["--method", "mis", "--samples", "40", "--paths", "direct", "--size", "96x54"]


class Asking:
    """A viewer that sends probes and keeps pictures and followed values in order of arrival."""

    def __init__(self, link):
        self.link = link
        self.request = 0
        self.pictures = {}
        self.followed = []

    async def greet(self, form):
        await self.say(op="hello", role="viewer", version={"major": 1, "minor": 1})
        await self.say(op="subscribe", format=form)

    async def say(self, **message):
        await self.link.send(json.dumps(message))

    async def take(self):
        """One message: its JSON, or None for a picture."""
        message = await asyncio.wait_for(self.link.recv(), WAIT_S)
        if isinstance(message, bytes):
            fields = PICTURE.unpack_from(message)
            await self.say(op="ack", sequence=fields[4])
            self.pictures[fields[5]] = hashlib.sha256(message[80:]).hexdigest()
            return None
        said = json.loads(message)
        if said["op"] == "radiance":
            self.followed.append(said)
        return said

    async def until(self, what):
        while not what():
            await self.take()

    async def ask(self, **question):
        self.request += 1
        await self.say(op="probe", request=self.request, **question)
        while True:
            said = await self.take()
            if said and said["op"] in ("probed", "error"):
                check(said.get("request") == self.request, f"another request: {said.get('request')}")
                return said


async def rendered(*arguments):
    """The lines that relight-render prints."""
    process = await asyncio.create_subprocess_exec(str(BIN / "relight-render"), *arguments,
                                                   stdout=asyncio.subprocess.PIPE)
    out, _ = await process.communicate()
    check(process.returncode == 0, f"relight-render ended with {process.returncode}")
    return [json.loads(line) for line in out.splitlines()]


async def answers_are_those_of_relight_render(folder):
    """Compares every field, for a surface, the sky and the preset."""
    async with Daemon(*SKY, *WAY, "--converge", "off") as daemon, connect(daemon.url) as link:
        asking = Asking(link)
        await asking.greet("jpeg")
        await asking.until(lambda: asking.pictures)
        for x, y, extra, flags in ((40, 40, {}, []), (10, 2, {}, []), (70, 45, {"preset": "fig1"}, ["--probe-preset", "fig1"]),
                                   (30, 20, {"samples": 200}, ["--probe-samples", "200"])):
            live = await asking.ask(x=x, y=y, sky=True, **extra)
            check(live["op"] == "probed", f"refused: {live}")
            [want] = await rendered(*SKY[:4], *WAY, "--probe", f"{x},{y}", *flags)
            del live["op"], live["request"]
            differs = [key for key in want if want[key] != live.get(key)]
            check(not differs and want.keys() == live.keys(), f"pixel {x}, {y}: {differs} differ")
            check(base64.b64decode(live["sky"]["jpeg"])[:2] == b"\xff\xd8", "the sky is no JPEG")
            arrives = [sum(s[c] for s in want["light"] + want["lobes"] if len(s) == 9 and s[3] == 2) for c in (6, 7, 8)]
            point = want["point"]["radiance"] if want["point"] else [0, 0, 0]
            check(all(abs(a - b) < 1e-5 * (abs(b) + 1e-6) for a, b in zip(arrives, point)), f"{arrives} is not {point}")


async def a_largest_answer_fits(folder):
    """The maximum number of samples with a separate sun: the answer stays below the size of clause 4.16, including
    the sky."""
    async with Daemon(*SKY, "--method", "auto", "--samples", "256", "--size", "96x54") as daemon, connect(daemon.url) as link:
        asking = Asking(link)
        await asking.greet("jpeg")
        await asking.until(lambda: asking.pictures)
        live = await asking.ask(x=40, y=40, sky=True, samples=256)
        size = len(json.dumps(live, separators=(",", ":")))
        check(size < 61440 and live["sky"], f"{size} bytes, sky: {bool(live['sky'])}")
        check(len(live["light"]) >= 768 and len(live["lobes"]) == 128, f"{len(live['light'])} light samples")


async def push(producer, number):
    """Sends the next sky; none follows before its picture has come, so that none is superseded."""
    if number == 1:
        await producer.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 0}}))
    await producer.send(frame(number, radiance(100 + number, size=(64, 32))))


async def pictures(folder, asks):
    """The pictures of twelve frames with independent noise, by number; asks: a probe is sent with each."""
    async with Daemon("--source", "push:", *WAY, "--edge-rays", "1", "--reseed", "--converge", "off", "--between", "off") as daemon, \
            connect(daemon.url) as link, connect(daemon.url) as producer:  # on a busy machine the skies come slowly
        asking = Asking(link)
        await asking.greet("exr_float")
        for k in range(1, 13):
            await push(producer, k)
            if asks and k > 1:
                while (said := await asking.ask(x=5 * k + 2, y=3 * k + 2, sky=True, follow=True))["op"] != "probed":
                    check(said["code"] == "busy", f"refused: {said}")  # four a second are answered
                    await asyncio.sleep(0.1)
            await asking.until(lambda: k in asking.pictures)
        return asking.pictures


async def no_picture_is_changed_by_a_question(folder):
    """Bit for bit, by frame number; also checks that frames differ from each other."""
    plain, asked = await pictures(folder, False), await pictures(folder, True)
    check(plain == asked, f"frames {[n for n in plain if plain[n] != asked.get(n)]} differ")
    check(len(set(plain.values())) == len(plain), "frames do not differ")


async def a_followed_pixel_comes_with_each_picture(folder):
    """One value per picture, of that picture's frame: the last equals `picture` in `probed`."""
    async with Daemon("--source", "push:", *WAY, "--converge", "off") as daemon, connect(daemon.url) as link, connect(daemon.url) as producer:
        asking = Asking(link)
        await asking.greet("jpeg")
        await push(producer, 1)
        await asking.until(lambda: asking.pictures)
        await asking.ask(x=40, y=40, follow=True)
        for number in range(2, 8):
            await push(producer, number)
            await asking.until(lambda: number in asking.pictures and asking.followed and asking.followed[-1]["frame"] == number)
        frames = [f["frame"] for f in asking.followed]
        check([n for n in frames if n > 1] == [2, 3, 4, 5, 6, 7], f"frames {frames}")
        last = await asking.ask(x=40, y=40, follow=False)
        check(last["frame"] == 7, f"frame {last['frame']}")
        check(all(abs(a - b) <= 1e-6 * abs(b) for a, b in zip(asking.followed[-1]["radiance"], last["picture"])),
              f"{asking.followed[-1]} is not {last['picture']}")


if __name__ == "__main__":
    main(globals())
