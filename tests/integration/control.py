#!/usr/bin/python3
"""A controller of the real program, and a second connection that observes its effects: PROTOCOL.md 4.13 and 4.8.10
on."""

import asyncio
import json

import websockets

from lockstep import SKY, Relightd, compare, feed, record, rendered
from peer import FRAME, PICTURE, WAIT_S, check, expect, main
from still import Daemon, connect

FEW = ("--samples", "4", "--paths", "direct", "--edge-rays", "1")


class Party:
    """A connection that remembers the last status and control, and each picture's frame, gain and light."""

    def __init__(self, link):
        self.link = link
        self.last = {}
        self.gains = []
        self.captures = []
        self.views = []  # of each status: the camera, and the one whose view is being prepared
        self.requests = 0

    @classmethod
    async def come(cls, url, role):
        party = cls(await connect(url))
        await party.say(op="hello", role=role, version={"major": 1, "minor": 1})
        await party.say(op="subscribe", format="jpeg")
        await party.until(lambda: "status" in party.last and "control" in party.last)
        return party

    async def say(self, **message):
        await self.link.send(json.dumps(message))

    async def until(self, what):
        async def hear():
            while not what():
                message = await self.link.recv()
                if isinstance(message, bytes):
                    fields = PICTURE.unpack_from(message)
                    await self.say(op="ack", sequence=fields[4])
                    self.gains.append(fields[14])
                    self.captures.append(fields[6])
                else:
                    said = json.loads(message)
                    self.last[said["op"]] = said
                    if said["op"] == "status":
                        self.views.append((said["camera"], (said["preparing"] or {}).get("camera")))
        await asyncio.wait_for(hear(), WAIT_S)

    async def ask(self, **wish):
        """Waits for the answer; returns the error, if any."""
        self.requests += 1
        self.last.pop("error", None)
        await self.say(op="control", request=self.requests, **wish)
        await self.until(lambda: self.last.get("error", {}).get("request") == self.requests
                         or self.last["control"]["request"] == self.requests)
        return self.last.get("error")

    def place(self):
        return self.last["status"]["source"]["position"]

    async def until_place(self, place):
        await self.until(lambda: self.place() == place)


def skies(folder, count):
    """Grey Radiance files, each twice as bright as the previous one."""
    for i in range(count):
        texel = bytes([128, 128, 128, 129 + i])
        (folder / f"sky.{10 * i + 5}.hdr").write_bytes(
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + texel * 32)
    return ["--source", str(folder / "sky.%d.hdr")]


async def a_paused_source_steps_and_goes_to_any_place(folder):
    async with Daemon(*skies(folder, 5), *FEW, "--rate", "50") as daemon:
        one, two = await Party.come(daemon.url, "controller"), await Party.come(daemon.url, "viewer")
        check(one.last["status"]["source"]["kind"] == "files", one.last["status"])
        check(one.last["status"]["source"]["length"] == 5, one.last["status"])
        error = await one.ask(step=1)
        check(error and error["clause"] == "4.13.16", f"a step while it runs: {error}")
        check(await one.ask(paused=True) is None, "not paused")
        await two.until(lambda: two.last["control"]["paused"] and two.last["status"]["source"]["state"] == "paused")
        check(await one.ask(seek=1) is None, "no seek")
        await two.until_place(1)
        check(two.last["status"]["frame"] == 15, two.last["status"])
        for step, place in ((1, 2), (1, 3), (-1, 2), (2, 4), (1, 0), (-1, 4)):  # wraps around, like the source
            check(await one.ask(step=step) is None, f"no step from {place - step}")
            await two.until_place(place)
        check(two.last["status"]["source"]["state"] == "paused", two.last["status"])
        error = await one.ask(seek=5)
        check(error and error["clause"] == "4.13.17" and "5" in error["message"], f"beyond the end: {error}")
        error = await one.ask(hour=3)
        check(error and error["clause"] == "4.13.18", f"files have no hours: {error}")
        check(await one.ask(paused=False) is None, "not running")
        await two.until(lambda: two.place() != 4)
        going = two.place()
        await two.until(lambda: two.place() != going)


async def a_paused_source_stays_paused_whatever_its_last_frame_was(folder):
    """A frame that cannot be read is not tried again when settings change: producers saw a source that had failed, and
    waited for it to take their frames."""
    async with Daemon("--source", "push:", *FEW) as daemon:
        one = await Party.come(daemon.url, "controller")
        producer = await connect(daemon.url)
        await producer.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 1}}))
        cut = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n"
        await producer.send(FRAME.pack(b"RLE1", 48, 2, 0, 0, 0, 0, 0, 0, len(cut), 1, 0, 0) + cut)
        await one.until(lambda: one.last["status"]["source"]["state"] == "failed")
        refused = one.last["status"]["frames"]["refused"]
        await one.ask(paused=True)
        await one.until(lambda: one.last["status"]["source"]["state"] == "paused")
        for turn in (30, 60):
            await one.ask(rotate_degrees=turn)
            since = one.last["status"]["server_us"]
            await one.until(lambda: one.last["status"]["server_us"] >= since + 500000)
            check(one.last["status"]["source"]["state"] == "paused", one.last["status"])
        check(one.last["status"]["frames"]["refused"] == refused, one.last["status"])
        await producer.close()


async def an_ended_sequence_can_be_gone_back_to(folder):
    async with Daemon(*skies(folder, 3), *FEW, "--once") as daemon:
        one = await Party.come(daemon.url, "controller")
        await one.until(lambda: one.last["status"]["source"]["state"] == "ended")
        check(one.place() == 2, one.last["status"])
        await one.ask(paused=True)
        await one.ask(seek=0)
        await one.until_place(0)
        check(one.last["status"]["frame"] == 5, one.last["status"])
        await one.ask(paused=False)
        await one.until(lambda: one.place() == 2 and one.last["status"]["source"]["state"] == "ended")


async def a_computed_sky_has_hours(folder):
    async with Daemon("--source", "sky:size=128x64,speed=10,time=06:00", *FEW, "--rate", "50") as daemon:
        one = await Party.come(daemon.url, "controller")
        check(one.last["status"]["source"]["kind"] == "sky" and one.last["status"]["source"]["length"] is None,
              one.last["status"])
        await one.ask(paused=True, hour=12.25)
        await one.until(lambda: one.last["status"]["source"]["hour"] == 12.25)
        check(one.last["status"]["light"]["time"] == "12:15", one.last["status"]["light"])
        check(one.last["status"]["light"]["sun"]["elevation"] > 50, one.last["status"]["light"])
        await one.ask(step=-1)
        await one.until(lambda: abs(one.last["status"]["source"]["hour"] - 12.25 + 1 / 6) < 1e-6)


async def cameras_change_while_the_old_picture_stays(folder):
    """With --converge off and a paused source every new picture results from the change."""
    async with Daemon("--source", "sky:size=128x64,time=12:00", *FEW, "--converge", "off") as daemon:
        one, two = await Party.come(daemon.url, "controller"), await Party.come(daemon.url, "viewer")
        check(one.last["status"]["offers"]["cameras"] == ["main", "sundial", "gallery"], one.last["status"]["offers"])
        await one.ask(paused=True)
        await two.until(lambda: two.last["status"]["source"]["state"] == "paused")
        for camera in ("gallery", "sundial", "main", "gallery"):  # main is the initial camera
            before = len(two.gains)
            check(await one.ask(camera=camera) is None, camera)
            await two.until(lambda: two.last["control"]["camera"] == camera and two.last["status"]["camera"] == camera
                            and two.last["status"]["preparing"] is None and len(two.gains) > before)
        error = await one.ask(camera="nobody", method="mis")
        check(error and error["clause"] == "4.13.15" and "nobody" in error["message"], f"{error}")
        refused = one.requests
        check(await one.ask() is None and one.last["control"]["request"] == refused + 1, "no answer but the error has its number")
        check(one.last["control"]["method"] == "auto", "half of what could not be done was done")
        for _ in range(3):  # faster than views are computed: the last change wins
            for camera in ("main", "sundial", "gallery", "sundial"):
                await one.say(op="control", camera=camera)
        await two.until(lambda: two.last["status"]["camera"] == "sundial" and two.last["status"]["preparing"] is None
                        and two.last["control"]["camera"] == "sundial")


async def exposure_is_fixed_or_follows_and_bias_goes_on_top(folder):
    """With --converge off and a paused source pictures come only on request."""
    async with Daemon("--source", "sky:size=128x64,time=12:00", *FEW, "--converge", "off") as daemon:
        one = await Party.come(daemon.url, "controller")
        check(one.last["control"]["exposure_stops"] is None, one.last["control"])
        await one.ask(paused=True)
        await one.until(lambda: one.last["status"]["source"]["state"] == "paused" and one.gains)
        await one.ask(exposure_stops=-3)
        await one.until(lambda: one.gains[-1] == 0.125)
        check(one.last["control"]["exposure_stops"] == -3, one.last["control"])
        await one.ask(exposure_stops=None)
        await one.until(lambda: one.gains[-1] != 0.125)
        follows = one.gains[-1]
        await one.ask(bias_stops=2)
        await one.until(lambda: abs(one.gains[-1] / follows - 4) < 1e-3)
        check("auto" in one.last["status"]["offers"]["exposures"], one.last["status"]["offers"])
        await one.ask(exposure_stops="auto", bias_stops=0)
        await one.until(lambda: one.last["control"]["exposure_stops"] == "auto" and one.gains[-1] < 2 * follows)
        error = await one.ask(exposure_stops="bright")
        check(error and error["clause"] == "4.13.10" and "auto" in error["message"], f"{error}")
        count = len(one.gains)
        await one.ask(tone="linear")
        await one.until(lambda: len(one.gains) > count)
        check(one.last["control"]["tone"] == "linear", one.last["control"])


async def samples_and_error_are_two_wishes_for_one_thing(folder):
    async with Daemon("--source", "sky:size=128x64", "--rate", "5") as daemon:
        one, two = await Party.come(daemon.url, "controller"), await Party.come(daemon.url, "viewer")
        told = one.last["control"]
        check(told["counted"] is False and told["error"] is None and told["fps"] == 30 and told["paths"] == "all",
              told)
        await one.ask(error=0.25)
        await two.until(lambda: two.last["control"]["error"] == 0.25 and not two.last["control"]["counted"])
        await one.ask(samples=9)
        await two.until(lambda: two.last["control"]["samples"] == 9 and two.last["control"]["counted"]
                        and two.last["control"]["error"] is None and two.last["status"]["samples"] == 9)
        await one.ask(error=0.25)
        error = await one.ask(method="faces", error=0.1)
        check(error and error["clause"] == "4.13.12", f"{error}")
        await one.ask(method="faces")
        await two.until(lambda: two.last["control"]["error"] is None and two.last["control"]["counted"]
                        and two.last["status"]["method"] == "faces")
        error = await one.ask(samples=None)
        check(error and error["clause"] == "4.13.5", f"{error}")
        await one.ask(fps=7, paths="all")
        await two.until(lambda: two.last["control"]["fps"] == 7 and two.last["control"]["paths"] == "all"
                        and "indirect light" in two.last["status"]["light"]["paths"])


async def methods_that_cannot_light_a_sky_are_not_offered(folder):
    for face in ("px", "nx", "py", "ny", "pz", "nz"):
        (folder / f"{face}.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n" + bytes([128, 128, 128, 129]))
    for source, panorama in ((f"{folder}/{{face}}.hdr", False), ("sky:size=64x32", True)):
        async with Daemon("--source", source, "--samples", "1", "--paths", "direct", "--method", "mis") as daemon:
            one = await Party.come(daemon.url, "viewer")
            await one.until(lambda: one.last["status"]["frame"] is not None and one.gains)
            await one.until(lambda: ("latlong" in one.last["status"]["offers"]["methods"]) == panorama)
            methods = one.last["status"]["offers"]["methods"]
            check(("latlong-rows" in methods) == panorama and {"mis", "auto", "cached"} <= set(methods), methods)


async def a_sequence_is_made_as_was_said_whatever_controllers_say(folder):
    (folder / "got").mkdir()
    async with Relightd() as server:
        one = await Party.come(server.url + "/ws", "controller")
        check(await one.ask(camera="gallery", method="faces", samples=2, rotate_degrees=90, scale_stops=1, paths="direct",
                            exposure_stops=3, fps=5) is None, "not set")
        await one.until(lambda: one.last["status"]["camera"] == "gallery")
        recorder = await record(server, folder / "got").start()
        expect(await (await feed(server, "--frames", "3-6", SKY).start()).end(), 0)
        expect(await recorder.end(), 0)
        check(one.last["control"]["camera"] == "gallery", one.last["control"])
    names = await rendered(folder / "want", 4, "--source", SKY, "--frames", "3-6")
    compare(folder / "want", folder / "got", names)


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
