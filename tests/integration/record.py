#!/usr/bin/python3
"""relight-record against a scripted server: what it requests, what it stores, and when it acknowledges."""

import asyncio
import base64
import functools
import hashlib
import json
import os
import random
import re
import resource
import signal

from peer import WAIT_S, Program, Server, check, expect, main, picture, run

LAST, REPEAT, LOCKSTEP = 1, 2, 4


async def record(server, *arguments):
    return await run("relight-record", "--from", server.url, "--json", *arguments)


@functools.lru_cache
def payload(frame, size=5000):
    return random.Random(frame).randbytes(size)


async def subscribed(link, recorder=None, stored_after=None, form="exr_float", **more):
    """Plays the handshake up to the subscription, which it returns."""
    named = {"recorder": {"stored_after": stored_after}} if recorder else {}
    hello = await link.welcome("recorder" if recorder else "viewer", **named)
    check(hello.get("recorder") == recorder, f"{hello}")
    subscribe = await link.read()
    check(subscribe["op"] == "subscribe" and subscribe["format"] == form, f"{subscribe}")
    await link.say(op="subscribed", format=form, paused=False)
    return subscribe


async def acked(link, sequence):
    ack = await link.read()
    check(ack["op"] == "ack" and ack["sequence"] == sequence, f"not the ack of {sequence}: {ack}")
    return ack


def names(folder):
    return sorted(os.listdir(folder))


# ---- Live ----

async def pictures_are_named_by_their_frame(folder):
    async def script(link):
        subscribe = await subscribed(link)
        check("quality" not in subscribe and "max_rate" not in subscribe, f"{subscribe}")
        for sequence, frame in enumerate((7, 9, 12345), 1):
            await link.socket.send(picture(sequence, frame, payload(frame)))
            ack = await acked(link, sequence)
            check("stored" not in ack, f"{ack}")
            check((folder / f"p.{frame:04d}.exr").read_bytes() == payload(frame), "acknowledged before it was stored")
        check(await link.parted() == 1000, "no clean close")

    async with Server(script) as server:
        program = await record(server, "--out", folder / "p.%04d.exr", "--frames", 3)
        expect(program, 0)
    check(names(folder) == ["p.0007.exr", "p.0009.exr", "p.12345.exr"], f"{names(folder)}")
    summary = program.summary()
    check(summary["stored"] == 3 and summary["first_frame"] == 7 and summary["last_frame"] == 12345, f"{summary}")
    check(summary["end"] == "done" and summary["bytes"] == 15000 and summary["recorder"] is None, f"{summary}")


async def format_quality_and_rate_are_asked_for(folder):
    wishes = []

    async def script(link):
        form = wanted.pop(0)
        wishes.append(await subscribed(link, form=form))
        await link.socket.send(picture(1, 1, b"x", form=["", "jpeg", "exr_half", "exr_float"].index(form)))
        await link.parted()

    wanted = ["jpeg", "exr_half", "exr_float", "jpeg"]
    async with Server(script) as server:
        expect(await record(server, "--once", "--out", folder / "a.jpg", "--quality", 77), 0)
        expect(await record(server, "--once", "--out", folder / "a.exr", "--format", "exr-half", "--max-rate", 2.5), 0)
        expect(await record(server, "--once", "--out", folder / "b.exr"), 0)
        expect(await record(server, "--once", "--out", folder / "raw", "--format", "jpeg"), 0)
    check(wishes[0]["quality"] == 77 and "quality" not in wishes[1] and wishes[1]["max_rate"] == 2.5, f"{wishes}")


async def a_picture_in_many_fragments_is_whole(folder):
    async def script(link):
        await subscribed(link)
        whole = picture(1, 1, payload(1, 300001))

        async def pieces():
            at = 0
            while at < len(whole):
                count = random.Random(at).choice((1, 2, 79, 1000, 70000))
                yield whole[at:at + count]
                at += count

        await link.socket.send(pieces())
        await link.parted()

    async with Server(script) as server:
        expect(await record(server, "--once", "--out", folder / "a.exr"), 0)
    check((folder / "a.exr").read_bytes() == payload(1, 300001), "another content")


async def the_last_picture_is_not_stored_twice(folder):
    """A reconnecting viewer gets the last picture again; in another session its number is new."""
    async def first(link):
        await subscribed(link)
        await link.socket.send(picture(1, 10, payload(10)))
        await acked(link, 1)
        link.cut()

    async def second(link):
        await subscribed(link)
        await link.socket.send(picture(1, 10, payload(99), flags=REPEAT))
        await acked(link, 1)
        link.server.session = "two"
        link.cut()

    async def third(link):
        await subscribed(link)
        await link.socket.send(picture(1, 11, payload(11), flags=REPEAT))
        await acked(link, 1)
        await link.parted()

    async with Server(first, second, third) as server:
        program = await record(server, "--frames", 2, "--out", folder / "%d.exr")
        expect(program, 0)
    check((folder / "10.exr").read_bytes() == payload(10), "stored again")
    check(program.summary()["again"] == 1 and program.summary()["connections"] == 3, program.out)


async def latency_is_measured_on_the_servers_clock(folder):
    ahead = 3_600_000_000  # an hour

    async def script(link):
        link.server.ahead_us = ahead
        await subscribed(link)
        await asyncio.sleep(0.3)
        for i in (1, 2):  # captured a second ago
            await link.socket.send(picture(i, i, b"x", capture_us=link.server.clock_us() - 1_000_000))
            await acked(link, i)
        await link.socket.send(picture(3, 3, b"x"))  # unknown capture time
        await acked(link, 3)
        await link.parted()

    async with Server(script) as server:
        program = await record(server, "--frames", 3, "--out", folder / "%d.exr", "--index", folder / "index")
        expect(program, 0)
    summary = program.summary()
    uncertain = summary["clock"]["uncertain_us"]
    check(abs(summary["clock"]["server_ahead_us"] - ahead) <= uncertain + 1000, f"{summary}")
    check(1000 - summary["latency_ms"]["uncertain"] - 1 <= summary["latency_ms"]["least"], f"{summary}")
    check(summary["latency_ms"]["most"] < 60000, f"{summary}")
    lines = [json.loads(line) for line in (folder / "index").read_text().splitlines()]
    check([line["frame"] for line in lines] == [1, 2, 3], f"{lines}")
    check(lines[2]["latency_us"] is None and lines[0]["latency_us"] >= 1_000_000 - uncertain - 1000, f"{lines}")
    check(lines[0]["file"] == str(folder / "1.exr"), f"{lines}")


async def half_a_line_of_the_index_is_cut_off(folder):
    async def script(link):
        await subscribed(link)
        await link.socket.send(picture(8, 8, b"x"))
        await acked(link, 8)
        await link.parted()

    whole = b'{"frame":7,"session":"one","sequence":7}\n'
    for old in (b"", whole, whole + b'{"frame":8,"ses', b'{"fr', b"\n\n"):
        (folder / "index").write_bytes(old)
        async with Server(script) as server:
            expect(await record(server, "--once", "--out", folder / "a.exr", "--index", folder / "index"), 0)
        text = (folder / "index").read_bytes()
        kept = old[:old.rfind(b"\n") + 1]
        check(text.startswith(kept) and json.loads(text[len(kept):])["frame"] == 8, f"{old} became {text}")
    (folder / "index").write_bytes(b"x" * 100000)
    expect(await run("relight-record", "--out", folder / "%d.exr", "--index", folder / "index"), 1, "is not an index")


# ---- Faults ----

async def a_full_disk_is_told_and_nothing_half_is_left(folder):
    async def script(link):
        await subscribed(link)
        await link.socket.send(picture(1, 1, payload(1, 900)))
        await acked(link, 1)
        await link.socket.send(picture(2, 2, payload(2, 5000)))
        check(await link.parted() == 1000, "acknowledged, or no clean close")

    async with Server(script) as server:
        program = Program("relight-record", "--from", server.url, "--out", folder / "%d.exr", "--json")
        before = resource.getrlimit(resource.RLIMIT_FSIZE)  # a file size limit simulates a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
        try:
            await program.start()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        expect(await program.end(), 1, "2.exr: cannot write the file: File too large")
    check(names(folder) == ["1.exr"], f"{names(folder)}")
    check(program.summary()["end"] == "failed" and program.summary()["stored"] == 1, program.out)


async def pictures_that_lie_are_skipped(folder):
    """One is skipped, and acknowledged if its number can be read; many in a row end the program."""
    good = picture(9, 7, b"x")
    numbered = [picture(3, 1 << 53, b"x"), picture(4, 1, b"x", capture_us=1 << 53)]
    bads = [good[:79], good[:-1], good + b"x", b"JUNK" + good[4:], picture(0, 1, b"x"), picture(1, 1, b"x", form=1),
            picture(1, 1, b""), b""]

    async def script(link):
        async def acknowledged(message):
            await link.socket.send(message)
            while (said := await link.read())["op"] != "ack":
                pass
            return said["sequence"]

        await subscribed(link)
        for number, bad in zip((3, 4), numbered):
            check(await acknowledged(bad) == number, "another number")
        for bad in bads:
            await link.socket.send(bad)
        while await acknowledged(good) != 9:
            pass
        await link.parted()

    async with Server(script) as server:
        expect(await record(server, "--once", "--out", folder / "a.exr"), 0, "is skipped")
    check(names(folder) == ["a.exr"] and (folder / "a.exr").read_bytes() == b"x", f"{names(folder)}")

    async def flood(link):
        await subscribed(link)
        for _ in range(11):
            await link.socket.send(bads[0])
        check(await link.parted() == 1000, "it stayed")

    async with Server(flood) as server:
        expect(await record(server, "--once", "--out", folder / "b.exr"), 1, "cannot be stored")
    check(names(folder) == ["a.exr"], f"{names(folder)}")


async def a_size_beyond_all_bounds_is_not_waited_for(folder):
    """A WebSocket frame that announces a tebibyte, as binary and as text: rejected after the first 64 KiB."""
    for opcode, kind in ((0x82, "binary"), (0x81, "text")):

        async def serve(reader, writer):
            request = (await reader.readuntil(b"\r\n\r\n")).decode()
            key = re.search("Sec-WebSocket-Key: (.*)\r", request)[1]
            accept = hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest()
            writer.write(b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                         b"Sec-WebSocket-Protocol: relight.v1\r\nSec-WebSocket-Accept: "
                         + base64.b64encode(accept) + b"\r\n\r\n"
                         + bytes([opcode, 127]) + (1 << 40).to_bytes(8, "big") + b"RLP1" * 50000)
            await reader.read(10000)

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        url = "ws://127.0.0.1:%d" % server.sockets[0].getsockname()[1]
        program = await run("relight-record", "--from", url, "--once", "--out", folder / "a.exr")
        expect(program, 1, f"sent a {kind} message of more than")
        server.close()


async def a_server_that_does_not_want_us_is_told(folder):
    for close, code in ((4006, 3), (4011, 3), (4002, 1)):

        async def script(link):
            await link.read()
            await link.say(op="error", code="name", clause="4.1.3", message="a reason", fatal=True)
            await link.socket.close(close, "a reason")

        async with Server(script) as server:
            expect(await record(server, "--once", "--out", folder / "a.jpg"), code, "name: a reason")

    async def no_lockstep(link):
        await link.welcome("recorder")
        await link.parted()

    async with Server(no_lockstep) as server:
        expect(await record(server, "--lockstep", "--out", folder / "%d.exr"), 3, "does not offer lockstep")

    async def busy(link):
        await link.read()
        await link.say(op="error", code="busy", clause="4.1", message="there is another", fatal=True)
        await link.socket.close(4012, "busy")

    async with Server(busy) as server:  # "later" means not before ten seconds, which is longer than we wait
        expect(await record(server, "--give-up-after", "5", "--lockstep", "--out", folder / "%d.exr"), 3, "another")
        check(server.connections == 1, "came back too soon")


# ---- Lockstep ----

class Sequence:
    """The server's side of a lockstep sequence: sends each picture until it is acknowledged as stored."""

    def __init__(self, folder, count, size=5000):
        self.folder = folder
        self.count = count
        self.size = size
        self.stored = []
        self.sent = 0
        self.parted = 0

    def path(self, frame):
        return self.folder / f"p.{frame:04d}.exr"

    def send(self, link, frame):
        self.sent += 1
        return link.socket.send(picture(frame + 1, frame, payload(frame, self.size), flags=LOCKSTEP))

    def heard(self, ack):
        frame = ack["sequence"] - 1
        check(ack["op"] == "ack" and ack.get("stored") is True, f"{ack}")
        check(frame == len(self.stored), f"ack of {frame} after {self.stored}")
        check(self.path(frame).read_bytes() == payload(frame, self.size), "acknowledged and not whole on disk")
        self.stored.append(frame)

    async def script(self, link):
        await subscribed(link, recorder="day-1", stored_after=self.stored[-1] if self.stored else None)
        while len(self.stored) < self.count:
            await self.send(link, len(self.stored))
            self.heard(await link.read())
        await link.say(op="sequence", name="day-1", state="ended", stored=self.count)
        self.parted = await link.parted()

    def check_all(self):
        check(self.parted == 1000, "no clean close")
        check(self.stored == list(range(self.count)), f"{self.stored}")
        for frame in range(self.count):
            check(self.path(frame).read_bytes() == payload(frame, self.size), f"{frame} is damaged")


async def lockstep_stores_before_it_acknowledges(folder):
    state = Sequence(folder, 8)
    async with Server(state.script) as server:
        program = await record(server, "--recorder", "day-1", "--out", folder / "p.%04d.exr")
        expect(program, 0)
    state.check_all()
    check(program.summary()["recorder"] == "day-1" and program.summary()["stored"] == 8, program.out)


async def only_the_own_sequence_is_stored(folder):
    async def script(link):
        await subscribed(link, recorder="default")
        await link.socket.send(picture(2, 2, payload(2), flags=LOCKSTEP))
        check((await acked(link, 2))["stored"] is True, "not stored")
        await link.say(op="sequence", name="another", state="ended", stored=1)
        await link.nothing()
        await link.say(op="sequence", name="default", state="ended", stored=1)
        await link.parted()

    async def of_none(link):
        await subscribed(link, recorder="default")
        await link.socket.send(picture(1, 1, payload(1)))
        check(await link.parted() == 1000, "it was acknowledged")

    async with Server(script) as server:
        expect(await record(server, "--lockstep", "--out", folder / "%d.exr"), 0)
    async with Server(of_none) as server:
        expect(await record(server, "--lockstep", "--out", folder / "%d.exr"), 1, "belong to a sequence")
    check(names(folder) == ["2.exr"], f"{names(folder)}")


async def another_format_under_way_is_told(folder):
    async def script(link):
        await subscribed(link, recorder="default")
        await link.say(op="error", code="not_offered", clause="4.3.6", message="another format", fatal=False)
        check(await link.parted() == 1000, "no clean close")

    async with Server(script) as server:
        expect(await record(server, "--lockstep", "--out", folder / "%d.exr"), 3, "another format")


async def a_picture_sent_again_is_acknowledged_again(folder):
    """The acknowledgement is lost with the connection: the file exists and is not written again."""
    state = Sequence(folder, 2)

    async def first(link):
        await subscribed(link, recorder="day-1")
        await state.send(link, 0)
        await link.read()
        state.path(0).write_bytes(b"mark")
        link.cut()

    async def second(link):
        await subscribed(link, recorder="day-1")
        await state.send(link, 0)
        check((await acked(link, 1))["stored"] is True, "not acknowledged as stored")
        check(state.path(0).read_bytes() == b"mark", "written anew")
        await state.send(link, 1)
        await acked(link, 2)
        await link.say(op="sequence", name="day-1", state="ended", stored=2)
        await link.parted()

    async with Server(first, second) as server:
        program = await record(server, "--recorder", "day-1", "--out", folder / "p.%04d.exr", "--index",
                               folder / "index")
        expect(program, 0)
    check(program.summary()["stored"] == 2 and program.summary()["again"] == 1, program.out)
    check(len((folder / "index").read_text().splitlines()) == 2, "the index has a line too many")


async def a_killed_recorder_loses_nothing(folder):
    """Killed at random moments, also while writing a file: named files are complete, acknowledged ones exist, others
    are sent again."""
    (folder / "out").mkdir()
    state = Sequence(folder / "out", 30, size=3000000)
    dice = random.Random(5)
    kills = 0
    async with Server(state.script) as server:
        arguments = ("--from", server.url, "--recorder", "day-1", "--out", folder / "out" / "p.%04d.exr", "--json",
                     "--index", folder / "index")
        while len(state.stored) < state.count:
            program = await Program("relight-record", *arguments).start()
            before = len(state.stored)
            while len(state.stored) == before and program.process.returncode is None:
                await asyncio.sleep(0.001)
            await asyncio.sleep(dice.uniform(0, 0.03))
            await program.kill()
            kills += program.code == -signal.SIGKILL
            for name in names(folder / "out"):
                if not name.endswith(".part"):
                    frame = int(name[2:6])
                    check(state.path(frame).read_bytes() == payload(frame, state.size), f"{name} is not whole")
        if program.code != 0:
            program = await run("relight-record", *arguments)
        expect(program, 0)
    state.check_all()
    check(kills >= 3, f"only {kills} kills")
    check(len(names(folder / "out")) == 30, f"something is left behind: {names(folder / 'out')}")
    frames = [json.loads(line)["frame"] for line in (folder / "index").read_text().splitlines()]
    check(frames == list(range(30)), f"the index: {frames}")
    print(f"{kills} kills, {state.sent} pictures sent for 30")


async def an_ended_sequence_is_told_apart(folder):
    async def script(link):
        await subscribed(link, recorder="default", stored_after=66)
        await link.say(op="sequence", name="default", state="ended", stored=67)
        await link.parted()

    async with Server(script) as server:
        expect(await record(server, "--lockstep", "--out", folder / "%d.exr"), 0, "already ended")


# ---- Being asked to stop, and usage ----

async def an_interrupt_is_a_clean_end(folder):
    for number, arguments, code in ((signal.SIGINT, (), 0), (signal.SIGTERM, (), 0),
                                    (signal.SIGINT, ("--frames", "5"), 1), (signal.SIGINT, ("--lockstep",), 1)):
        lockstep = "--lockstep" in arguments

        async def script(link):
            await subscribed(link, recorder="default" if lockstep else None)
            await link.socket.send(picture(1, 1, b"x", flags=LOCKSTEP if lockstep else 0))
            await acked(link, 1)
            link.server.first.set()
            check(await link.parted() == 1000, "no clean close")

        async with Server(script) as server:
            server.first = asyncio.Event()
            program = await Program("relight-record", "--from", server.url, "--out", folder / "%d.exr", "--json",
                                    *arguments).start()
            await asyncio.wait_for(server.first.wait(), WAIT_S)
            await program.kill(number)
            expect(program, code)
        check(program.summary()["end"] == "interrupted" and program.summary()["stored"] == 1, program.out)


async def wrong_usage_ends_with_2(folder):
    jpg = folder / "%d.jpg"
    for arguments, text in (
            ((), "--out is missing"), (("--out", folder / "a.jpg"), "names one file"),
            (("--out", folder / "%d.png"), "add --format"), (("--out", folder / "%s.jpg"), "other '%'"),
            (("--out", jpg, "--format", "exr-half"), "does not match"),
            (("--out", jpg, "--format", "png"), "--format 'png' is unknown"), (("--out", jpg, "--quality", "0"), "--quality"),
            (("--out", folder / "%d.exr", "--quality", "50"), "only to JPEG"),
            (("--out", jpg, "--lockstep", "--once"), "--once"), (("--out", jpg, "--recorder", "a b"), "'a b'"),
            (("--out", jpg, "--lockstep", "--max-rate", "3"), "--max-rate"),
            (("--out", jpg, "--frames", "0"), "--frames"),
            (("--out", jpg, "--from", "here"), "ws://HOST:PORT"), (("--out", jpg, "more"), "unexpected argument")):
        expect(await run("relight-record", *arguments), 2, text)
    expect(await run("relight-record", "--out", folder / "nowhere" / "%d.jpg"), 1, "No such file")
    program = await run("relight-record", "--help")
    check(program.code == 0 and "Exit code" in program.out, program.out)


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
