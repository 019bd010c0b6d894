#!/usr/bin/python3
"""Row 66: the decoder process crashes, hangs, exhausts memory, makes forbidden system calls. The frame is refused
with its reason and counted, and the next one is used, live and in lockstep."""

import asyncio
import json
import re
import struct

import websockets

from faults import SANITIZED, Relightd, check, skip
from peer import BIN, WAIT_S, main, radiance

MISBEHAVING = BIN / "misbehaving_decoder"
HEADER = struct.Struct("<4sHBBBBHIIIQqQ")
DEEDS = (("crash", r"signal 11"), ("hang", r"timed out after 5 s"), ("eat", r"."), ("ask open", r"forbidden system call"),
         ("answer wide", r"invalid answer"), ("exit", r"exit code 3"))  # and what the producer is told of each


class Party:
    """A connection's fates of frames, and the frames of its pictures."""

    def __init__(self, link):
        self.link = link
        self.said, self.fates, self.pictures, self.credit = {}, [], [], 0

    @classmethod
    async def come(cls, url, **hello):
        party = cls(await websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, ping_interval=None, max_queue=None))
        await party.say(op="hello", version={"major": 1, "minor": 1}, **hello)
        await party.until(lambda: "welcome" in party.said)
        return party

    async def say(self, **fields):
        await self.link.send(json.dumps(fields))

    async def until(self, what):
        async def hear():
            while not what():
                message = await self.link.recv()
                if isinstance(message, bytes):
                    sequence, frame = struct.unpack_from("<QQ", message, 8)
                    self.pictures.append(frame)
                    await self.say(op="ack", sequence=sequence, stored=True)
                    continue
                said = json.loads(message)
                self.said[said["op"]] = said
                if said["op"] == "frame":
                    self.fates.append(said)
                elif said["op"] == "credit":
                    self.credit += said["frames"]
                elif said["op"] == "welcome":
                    self.credit += said.get("producer", {}).get("credit", 0)
        await asyncio.wait_for(hear(), WAIT_S)

    async def send(self, number, payload):
        """The frame's fate, which precedes that of any later frame."""
        await self.until(lambda: self.credit > 0)
        self.credit -= 1
        count = len(self.fates)
        await self.link.send(HEADER.pack(b"RLE1", 48, 2, 0, 0, 0, 0, 0, 0, len(payload), number, 0, 0) + payload)
        await self.until(lambda: len(self.fates) > count)
        check(self.fates[-1]["number"] == number, f"another frame's fate: {self.fates}")
        return self.fates[-1]


async def play(producer):
    """Sends each bad frame between two good ones; returns the numbers of the good ones."""
    if SANITIZED:
        skip("a sanitizer's words about a crash are more than the decoder may ask of the system")
    good = []
    for i, (deed, reason) in enumerate((*DEEDS, (None, None))):
        fate = await producer.send(2 * i + 1, radiance(100 + i))
        check(fate["fate"] == "used", f"the good frame before '{deed}': {fate}")
        good.append(2 * i + 1)
        if deed:
            fate = await producer.send(2 * i + 2, b"#?" + deed.encode())
            check(fate["fate"] == "refused" and re.search(reason, fate["message"]), f"'{deed}': {fate}")
    return good


async def counted(server):
    counters = await server.counters()
    if counters.get("relightd_decoder_confined") != 1:
        skip("this kernel grants no seccomp")
    failures = {k: v for k, v in counters.items() if k.startswith("relightd_decoder_failures_total")}
    # when memory runs out the decoder refuses or dies
    check(len(DEEDS) - 1 <= sum(failures.values()) <= len(DEEDS), f"not counted: {failures}")
    check(counters["relightd_decoder_starts_total"] == 1 + sum(failures.values()), "not started anew once for each")
    check(counters['relightd_frames_total{fate="refused",reason="unreadable"}'] == len(DEEDS), f"{counters}")
    return failures


async def decoder_faults_cost_their_frames_live(folder):
    async with Relightd("--decoder", str(MISBEHAVING), "--decode-seconds", "5") as server:
        watcher = await Party.come(server.url, role="viewer")
        await watcher.say(op="subscribe", format="jpeg")
        producer = await Party.come(server.url, role="producer")
        before = server.memory_kib()
        good = await play(producer)
        await watcher.until(lambda: watcher.pictures and watcher.pictures[-1] == good[-1])
        check(set(watcher.pictures) <= set(good), f"pictures of {watcher.pictures}")
        await counted(server)
        check(server.memory_kib() - before < 64 << 10, f"the server itself grew by {server.memory_kib() - before} KiB")
        check(server.alive(), "it died")
        await producer.link.close()
        await watcher.link.close()


async def decoder_faults_keep_lockstep_and_order(folder):
    async with Relightd("--decoder", str(MISBEHAVING), "--decode-seconds", "5") as server:
        recorder = await Party.come(server.url, role="viewer", recorder="row66")
        await recorder.say(op="subscribe", format="exr_half")
        producer = await Party.come(server.url, role="producer", pace="lockstep", sequence="row66")
        listening = asyncio.ensure_future(recorder.until(lambda: "sequence" in recorder.said))
        good = await play(producer)
        await producer.say(op="end")
        await asyncio.wait_for(listening, WAIT_S)
        check(recorder.pictures == good, f"not one picture of each good frame, in order: {recorder.pictures}")
        await counted(server)
        await producer.link.close()
        await recorder.link.close()


async def without_a_sandbox_it_warns_and_works(folder):
    async with Relightd("--no-sandbox") as server:
        producer = await Party.come(server.url, role="producer")
        check((await producer.send(1, radiance(100)))["fate"] == "used", "not used")
        check((await producer.send(2, b"#?nonsense"))["fate"] == "refused", "not refused")
        check((await server.counters())["relightd_decoder_separate"] == 0, "a process of its own")
        check(any("--no-sandbox" in line and "warning" in line for line in server.lines), f"{server.lines}")
        await producer.link.close()


async def a_decoder_that_is_missing_is_said(folder):
    program = await asyncio.create_subprocess_exec(str(BIN / "relightd"), "--port", "0", "--source", "push:", "--decoder",
                                                   str(folder / "nowhere"), stderr=asyncio.subprocess.PIPE)
    said = (await asyncio.wait_for(program.communicate(), WAIT_S))[1].decode()
    check(program.returncode == 1 and "nowhere" in said, f"{program.returncode}: {said}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
