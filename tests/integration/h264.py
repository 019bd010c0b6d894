#!/usr/bin/python3
"""H.264 from relightd to viewers (PROTOCOL.md 4.3.1 and 5.11), with an independent WebSocket library."""

import asyncio
import json
import struct
import time

import websockets

from peer import BIN, PICTURE, WAIT_S, check, main

KEY, REPEAT = 64, 2
STILL = ["--source", "sky:size=256x128,hour=9", "--frames", "3-3", "--once", "--converge", "off"]


class Viewer:
    def __init__(self, link):
        self.link = link

    async def read(self):
        return await asyncio.wait_for(self.link.recv(), WAIT_S)

    async def hear(self, op):
        while True:
            message = await self.read()
            if isinstance(message, str) and json.loads(message)["op"] == op:
                return json.loads(message)

    async def subscribe(self, format, answer="subscribed", **more):
        await self.link.send(json.dumps({"op": "subscribe", "format": format, **more}))
        return await self.hear(answer)

    async def picture(self):
        """Format, flags, sequence, frame and payload of the next picture; acknowledges it."""
        return (await self.whole())[:5]

    async def whole(self):
        """The same, and its width, height and time of publication in seconds."""
        while True:
            message = await self.read()
            if isinstance(message, bytes):
                fields = PICTURE.unpack_from(message)
                await self.link.send(json.dumps({"op": "ack", "sequence": fields[4]}))
                return message[6], message[7], fields[4], fields[5], message[80:], fields[12], fields[13], 1e-6 * fields[7]

    async def has_none(self, seconds):
        """Skips text messages in between."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            try:
                check(isinstance(await asyncio.wait_for(self.link.recv(), left), str), "a picture came")
            except asyncio.TimeoutError:
                return


async def viewers(url, count, body):
    """Runs body with so many welcomed viewers."""
    links = [await websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, ping_interval=None, max_queue=None)
             for _ in range(count)]
    try:
        all_of_them = [Viewer(link) for link in links]
        for v in all_of_them:
            await v.link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}))
            v.welcome = await v.hear("welcome")
        await body(*all_of_them)
    finally:
        for link in links:
            await link.close()


async def with_server(flags, count, body):
    server = await asyncio.create_subprocess_exec(
        str(BIN / "relightd"), "--port", "0", "--size", "160x90", "--samples", "2", "--paths", "direct", "--edge-rays", "1", *flags,
        stderr=asyncio.subprocess.PIPE)
    try:
        line = ""
        while "listening on " not in line:
            line = (await asyncio.wait_for(server.stderr.readline(), WAIT_S)).decode()
            check(line, "relightd ended")
        await viewers(line.split("listening on ")[1].strip().replace("http", "ws") + "ws", count, body)
    finally:
        server.terminate()
        await server.wait()


async def video_is_offered_unless_it_is_forbidden(folder):
    async def offered(v):
        check("h264" in v.welcome["formats"], str(v.welcome))

    async def forbidden(v):
        check("h264" not in v.welcome["formats"], str(v.welcome))
        error = await v.subscribe("h264", "error")
        check(error["code"] == "not_offered" and not error["fatal"], str(error))
        await v.subscribe("jpeg")
        check((await v.picture())[0] == 1, "no JPEG")

    await with_server(STILL, 1, offered)
    await with_server([*STILL, "--no-h264"], 1, forbidden)


async def a_chain_of_pictures_begins_with_a_key(folder):
    async def body(v):
        await v.subscribe("h264")
        pictures = [await v.picture() for _ in range(20)]
        check(all(p[0] == 4 for p in pictures), "another format")
        check([p[2] for p in pictures] == list(range(1, 21)), "not a chain from the first that anybody wanted")
        check(pictures[0][1] & KEY and pictures[0][4][:5] == b"\0\0\0\1\x67", "it begins with no key picture")
        check(not any(p[1] & KEY for p in pictures[1:]), "key pictures that nobody needs")

    await with_server(["--source", "sky:size=256x128,speed=0.1"], 1, body)


async def a_picture_that_stands_still_is_made_again_for_whoever_comes(folder):
    async def body(first, second, third):
        await first.subscribe("jpeg")
        frame = (await first.picture())[3]
        await second.subscribe("h264")
        format, flags, sequence, of, _ = await second.picture()
        check((format, sequence, of) == (4, 1, frame) and flags & KEY and flags & REPEAT, f"{format} {flags} {sequence} {of}")
        await third.subscribe("h264")
        check((await third.picture())[2] == 1, "a key picture that is kept was made again")
        await second.subscribe("h264")
        format, flags, sequence, of, _ = await second.picture()
        check((sequence, of) == (2, frame) and flags & KEY and flags & REPEAT, f"{flags} {sequence} {of}")
        await first.has_none(0.5)
        await second.has_none(0.5)

    await with_server(STILL, 3, body)


async def jpeg_rests_while_all_watch_video_and_is_there_when_wanted(folder):
    async def body(first, second):
        await first.subscribe("h264")
        for _ in range(30):
            await first.picture()
        await second.subscribe("jpeg")
        sequence = (await second.picture())[2]
        check(sequence < 15, f"{sequence} JPEGs were made for nobody")
        check((await second.picture())[2] == sequence + 1, "JPEG does not go on")

    await with_server(["--source", "sky:size=256x128,speed=0.1"], 2, body)


async def key_pictures_are_not_made_at_anybodys_will(folder):
    async def body(greedy):
        keys = []  # when they were published, by the server's clock
        await greedy.subscribe("h264")
        while len(keys) < 9:
            await greedy.link.send(json.dumps({"op": "subscribe", "format": "h264"}))
            picture = await greedy.whole()
            keys += [picture[7]] if picture[1] & KEY else []
        check(keys[-1] - keys[0] > 0.2 * 8, f"key pictures at {keys}")

    await with_server(["--source", "sky:size=256x128,speed=0.1", "--fps", "60"], 1, body)


async def gather(v, count):
    """Flags, sequence, width, height, bytes and time of publication of so many pictures."""
    got = [await v.whole() for _ in range(count)]
    return [(p[1], p[2], p[5], p[6], len(p[4]), p[7]) for p in got]


async def video_comes_at_the_rate_and_size_that_was_asked_for(folder):
    """By the times at which the server published its pictures. A busy one may be late with the first, and sends nobody more than
    was asked for."""
    async def body(whole, slow, small):
        await whole.subscribe("h264")
        await slow.subscribe("h264", max_rate=2)
        await small.subscribe("h264", max_rate=4, max_width=60)
        got = await asyncio.gather(gather(whole, 33), gather(slow, 9), gather(small, 17))
        for pictures, rate, half, size in zip(got, (8, 2, 4), (0, 0, 16), ((160, 90), (160, 90), (40, 22))):
            first, *pictures = pictures
            seconds = pictures[-1][5] - first[5]
            check(len(pictures) <= (seconds + 1) * rate, f"{len(pictures)} pictures in {seconds} s at {rate} a second")
            check([p[1] for p in pictures] == list(range(pictures[0][1], pictures[0][1] + len(pictures))), f"a broken chain: {pictures}")
            check(all(p[0] & 24 == half and p[2:4] == size for p in pictures), f"not of {size}: {pictures}")
            check(not any(p[0] & KEY for p in pictures), f"key pictures that nobody needs: {pictures}")

    await with_server(["--source", "sky:size=256x128,speed=0.1", "--fps", "8"], 3, body)


async def until_frame(v, number):
    while (await v.picture())[3] != number:
        pass


async def the_last_picture_comes_to_the_slow_and_the_small_too(folder):
    async def body(first, slow, small, jpeg):
        await slow.subscribe("h264", max_rate=1)
        await asyncio.wait_for(until_frame(slow, 12), WAIT_S)  # the last of them, at its own rate
        await slow.has_none(1.5)
        await first.subscribe("jpeg")
        check((await first.picture())[3] == 12, "not the last one")
        await small.subscribe("h264", max_width=80)
        format, flags, sequence, frame, _ = await small.picture()
        check((format, sequence, frame) == (4, 1, 12) and flags & KEY and flags & 8, f"{format} {flags} {sequence} {frame}")
        await jpeg.subscribe("jpeg", max_width=80)
        format, flags, _, frame, _ = await jpeg.picture()
        check((format, frame) == (1, 12) and flags & 8, f"{format} {flags} {frame}")

    await with_server(["--source", "sky:size=256x128,hour=9,speed=0.1", "--frames", "0-12", "--once", "--rate", "20", "--converge", "off"], 4, body)


async def bits_a_second_stay_below_the_cap(folder):
    async def body(v):
        await v.subscribe("h264", quality=95)
        await gather(v, 30)
        pictures = await gather(v, 90)
        bits, seconds = 8 * sum(p[4] for p in pictures[1:]), pictures[-1][5] - pictures[0][5]
        check(bits <= 1.1 * 0.2e6 * (seconds + 1), f"{bits} bits in {seconds} s of {len(pictures)} pictures")

    await with_server(["--source", "sky:size=256x128,speed=1", "--reseed", "--method", "uniform", "--h264-mbit", "0.2"], 1, body)


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
