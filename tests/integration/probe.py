#!/usr/bin/python3
"""Pixel probes of the whole program (PROTOCOL.md 4.15 to 4.17), with an independent WebSocket library."""

import asyncio
import base64
import hashlib
import json

from peer import BIN, PICTURE, WAIT_S, check, main
from still import Daemon, connect

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


async def pictures(folder, questions):
    """The pictures of ten frames with independent noise, by number, while so many probes are sent."""
    async with Daemon("--source", "sky:size=256x128,hour=9,speed=60", "--rate", "3", *WAY, "--edge-rays", "1", "--reseed") as daemon, connect(daemon.url) as link:
        asking = Asking(link)
        await asking.greet("exr_float")
        await asking.until(lambda: asking.pictures)
        answered = 0
        for k in range(questions):
            said = await asking.ask(x=5 * k + 2, y=3 * k + 2, sky=True, follow=True)
            answered += said["op"] == "probed"
        await asking.until(lambda: len(asking.pictures) >= 12)
        check(answered >= min(questions, 8), f"{answered} of {questions} answered")
        return asking.pictures


async def no_picture_is_changed_by_a_question(folder):
    """Bit for bit, by frame number; also checks that frames differ from each other."""
    plain, asked = await pictures(folder, 0), await pictures(folder, 12)
    both = plain.keys() & asked.keys()
    check(len(both) >= 5, f"only frames {sorted(both)} are in both")
    check(all(plain[n] == asked[n] for n in both), f"frames {[n for n in both if plain[n] != asked[n]]} differ")
    check(len(set(plain.values())) == len(plain), "frames do not differ")


async def a_followed_pixel_comes_with_each_picture(folder):
    """One value per picture, of that picture's frame: the last equals `picture` in `probed`."""
    async with Daemon("--source", "sky:size=256x128,hour=9,speed=60", "--rate", "8", "--frames", "0-19", "--once", *WAY,
                      "--converge", "off") as daemon, connect(daemon.url) as link:
        asking = Asking(link)
        await asking.greet("jpeg")
        await asking.until(lambda: asking.pictures)
        await asking.ask(x=40, y=40, follow=True)
        await asking.until(lambda: asking.followed and asking.followed[-1]["frame"] == 19)
        frames = [f["frame"] for f in asking.followed]
        check(frames == sorted(set(frames)) and len(frames) >= 4, f"frames {frames}")
        last = await asking.ask(x=40, y=40, follow=False)
        check(last["frame"] == 19, f"frame {last['frame']}")
        check(all(abs(a - b) <= 1e-6 * abs(b) for a, b in zip(asking.followed[-1]["radiance"], last["picture"])),
              f"{asking.followed[-1]} is not {last['picture']}")


if __name__ == "__main__":
    main(globals())
