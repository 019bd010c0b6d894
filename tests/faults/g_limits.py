#!/usr/bin/python3
"""Rows 120 on: what a setting, a number, a file or the machine's limits can do to relightd."""

import asyncio
import os
import resource
import time

from faults import (BIN, CLOSE, PING, PONG, SANITIZED, Deadline, Failed, Raw, Relightd, Viewer, check, frame, hello,
                    main, preloaded, row, say, skip)
from peer import PICTURE, run

MOST = (1 << 53) - 1  # PROTOCOL.md 1.5
TEXEL = b"\x80\x80\x80\x81"


def sky(path, brightness=1):
    """A Radiance file of 8x4 grey texels."""
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + (TEXEL[:3] + bytes([128 + brightness])) * 32)
    return path


class Controller:
    """Changes settings, and watches as an exacting viewer: every number must obey PROTOCOL.md 1.5."""

    @classmethod
    async def come(cls, server):
        self = cls()
        self.raw = await Raw.open(server.port)
        check(await self.raw.upgrade() == 101, "no handshake")
        self.raw.send(hello("controller") + say(op="subscribe", format="jpeg"))
        await self.raw.until("control")
        self.requests, self.unseen = 0, None
        return self

    async def hear(self):
        """Receives one message. A picture is acknowledged and kept until it is asked for: no other may follow it."""
        kind, payload = await self.raw.receive()
        check(kind not in (None, CLOSE), f"the connection ended: {payload[:120]}")
        if kind == PING:  # no picture for ten seconds: the machine is busy
            self.raw.send(frame(PONG, payload))
        if kind == 2:
            self.unseen = PICTURE.unpack_from(payload)
            check(all(-MOST <= n <= MOST for n in self.unseen[4:8]), f"numbers beyond 2^53: {self.unseen}")
            self.raw.send(say(op="ack", sequence=self.unseen[4]))

    async def ask(self, **wish):
        """The error that answers, or None."""
        self.requests += 1
        self.raw.send(say(op="control", request=self.requests, **wish))
        while True:
            await self.hear()
            said = self.raw.said[-1] if self.raw.said else {}
            if said.get("op") in ("control", "error") and said.get("request") == self.requests:
                return said if said["op"] == "error" else None

    async def picture(self):
        """The header of the next one."""
        while not self.unseen:
            await self.hear()
        fields, self.unseen = self.unseen, None
        return fields


@row(alone=True)
async def G120_numbers_beyond_the_protocols(folder):
    """Of frames, by seek, step, file name and --frames; of capture times, by a file's modification time."""
    async with Relightd("--rate", "50", source="sky:size=128x64,speed=1") as server:
        controller = await Controller.come(server)
        check(await controller.ask(seek=MOST) is None, "no seek")
        while (await controller.picture())[5] < MOST:
            pass
        for _ in range(5):
            check((await controller.picture())[5] == MOST, "another number")
        check(await controller.ask(paused=True) is None and await controller.ask(seek=MOST, step=1000) is None, "no step")
        check((await controller.picture())[5] == MOST, "another number")
        controller.raw.shut()
    big = sky(folder / f"sky.{MOST + 1}.hdr")
    for flags in (["--source", folder / "sky.%d.hdr"], ["--source", "sky:", "--frames", f"1-{MOST + 1}"]):
        program = await run("relightd", "--port", "0", "--size", "16x9", *flags)
        check(program.code == 2 and str(MOST) in program.err, f"{flags}: ended with {program.code}: {program.err}")
    watched = folder / "watched"
    watched.mkdir()
    os.rename(big, watched / "a.hdr")
    os.utime(watched / "a.hdr", (9e9, 12e9))  # in the year 2350
    async with Relightd(source=f"watch:{watched}") as server:
        controller = await Controller.come(server)
        check((await controller.picture())[6] == 0, "a capture time that no message can hold")
        check(any("unknown" in line for line in server.lines), "nothing is said of it")
        controller.raw.shut()
    return "sent as they may be, or refused at the start"


@row(alone=True)
async def G121_the_clock_leaps_by_centuries(folder):
    """Far beyond what a message can hold, into the future and the past."""
    step = folder / "ahead"
    step.write_text("0", encoding="ascii")
    async with Relightd("--rate", "50", source="sky:size=128x64,speed=1", env=preloaded(CLOCK_FILE=step)) as server:
        controller = await Controller.come(server)
        for ahead in (3_000_000_000, 6_000_000_000, 8_000_000_000, 40_000_000_000, -40_000_000_000, 1 << 61, -(1 << 61), 0):
            step.write_text(str(ahead), encoding="ascii")
            for _ in range(10):
                last = await controller.picture()
            controller.raw.send(say(op="ping", id=7))
            told = (await controller.raw.until("pong"))["server_us"]
            check(-MOST <= told <= MOST, f"a time of {told}")
            check(ahead == 0 or abs(ahead) < 8e9 or abs(last[7]) == MOST, f"{ahead} s ahead: published at {last[7]}")
        controller.raw.shut()
    return "times stay within 2^53 microseconds"


@row(alone=True)
async def G122_unreadable_files_before_a_good_one(folder):
    for i in range(20):
        (folder / f"bad{i:02}.hdr").write_bytes(b"#?RADIANCE\nnothing")
    async with Relightd(source=f"watch:{folder}") as server, Viewer(server) as viewer:
        while not any("bad19" in line for line in server.lines):
            await asyncio.sleep(0.01)
        for i in range(20, 40):
            (folder / f"bad{i:02}.hdr").write_bytes(b"#?RADIANCE\nnothing")
        begun = time.monotonic()
        sky(folder / "good.part").rename(folder / "good.hdr")
        await viewer.sees(1)
        took = time.monotonic() - begun
    return f"20 are reported, and the good file is shown after {took:.1f} s"


LONGEST = 1 << 20  # samples: minutes, even for 64x36 pixels


@row(alone=True)
async def G125_a_setting_that_takes_minutes(folder):
    """Refused with the estimate; pictures continue. What became of it earlier: no picture for minutes."""
    async with Relightd("--rate", "50", source="sky:size=128x64,speed=1") as server, Viewer(server) as viewer:
        controller = await Controller.come(server)
        await viewer.sees(2)
        said = []
        for clause, wish in (("4.13.5", {"samples": LONGEST}), ("4.13.5", {"samples": LONGEST, "method": "mis"}),
                             ("4.13.5", {"samples": LONGEST, "method": "cached", "paths": "all"})):
            refusal = await controller.ask(**wish)
            check(refusal and refusal["clause"] == clause and "limit of 10 s" in refusal["message"], f"{wish}: {refusal}")
            said.append(refusal["message"])
            await viewer.sees(2)
        check(await controller.ask(samples=8) is None, "a harmless setting is refused")
        check(await controller.ask(fps=0.01, samples=None, method="auto") is None, "auto keeps to the limit by itself")
        check(await controller.ask(fps=50) is None, "not corrected")
        await viewer.sees(2)
        controller.raw.shut()
        return f"refused: {said[0]}"


@row(alone=True)
async def G126_a_setting_is_corrected_meanwhile(folder):
    """A picture of minutes is cancelled by the next setting, and pictures come although new
    settings never end."""
    large = ("--rate", "50", "--size", "320x180")
    async with Relightd(*large, "--max-picture-seconds", "86400", source="sky:size=128x64,speed=1") as server:
        controller = await Controller.come(server)
        await controller.picture()
        waits = []
        for i in range(3):
            check(await controller.ask(samples=8000) is None, "refused")
            await asyncio.sleep(1)
            begun = time.monotonic()
            controller.raw.send(say(op="control", request=100 + i, samples=5 + i))
            while (samples := (await controller.picture())[15]) != 5 + i:
                check(samples != 8000, "the picture of minutes was finished")
            waits.append(time.monotonic() - begun)
        controller.raw.shut()
    async with Relightd(*large, "--max-picture-seconds", "600", source="sky:size=128x64,speed=1") as server, Viewer(server) as viewer:
        controller = await Controller.come(server)
        check(await controller.ask(samples=64) is None, "refused")
        seen, begun = viewer.pictures, time.monotonic()
        while viewer.pictures < seen + 3:
            await controller.ask(rotate_degrees=time.monotonic() % 360)
        took = time.monotonic() - begun
        controller.raw.shut()
    return f"a correction is seen after {max(waits):.2f} s at most; 3 pictures in {took:.1f} s of endless changes"


@row(alone=True)
async def G127_a_picture_beyond_the_limit(folder):
    """By the command line, which is not limited: logged, counted and shown."""
    async with Relightd("--max-picture-seconds", "0.5", "--samples", "100000", source="sky:size=128x64,speed=1") as server:
        async with Viewer(server) as viewer:
            while not (viewer.status.get("late") or {}).get("seconds"):
                await asyncio.sleep(0.02)
            check(viewer.status["late"]["pictures"] >= 1, f"{viewer.status['late']}")
            check((await server.counters())["relightd_late_pictures_total"] >= 1, "not counted")
            check(any("max-picture-seconds" in line for line in server.lines), "not logged")
            late = viewer.status["late"]["seconds"]
    return f"reported after {late:.1f} s"


@row(alone=True)
async def G128_a_state_without_a_picture(folder):
    flags = ("--rate", "50", "--state", str(folder))
    kept = folder / "state.json"
    async with Relightd(*flags, "--max-picture-seconds", "86400", source="sky:size=128x64,speed=1") as server:
        controller = await Controller.come(server)
        check(await controller.ask(samples=7) is None, "refused")
        while not kept.exists() or '"samples": 7' not in kept.read_text(encoding="utf-8"):
            await controller.picture()
        check(await controller.ask(samples=LONGEST) is None, "refused")
        await asyncio.sleep(1)
        controller.raw.shut()
    good = kept.read_text(encoding="utf-8")
    check(str(LONGEST) not in good, "kept although no picture was finished")
    kept.write_text(good.replace('"samples": 7', f'"samples": {LONGEST}'), encoding="utf-8")
    async with Relightd(*flags, source="sky:size=128x64,speed=1") as server:
        controller = await Controller.come(server)
        check((await controller.picture())[15] == 1, "another number of samples")
        check(any("limit of 10 s" in line for line in server.lines), f"{server.lines}")
        controller.raw.shut()
    return "neither written nor restored"


STEPS = range(0, 40, 1 if os.environ.get("RELIGHT_LONG") else 3)
STRANGER = 40000  # uids of nobody in particular: the number of threads is limited per uid, and root has no limit


async def limited(kind, value, source, uid):
    """The exit code under that limit, and what was said; a server that listens is ended after a moment."""
    def limit():
        resource.setrlimit(kind, (value, value))
        if uid is not None:
            os.setgid(65534)
            os.setuid(uid)

    env = {name: v for name, v in os.environ.items() if name not in ("OMP_WAIT_POLICY", "OPENBLAS_NUM_THREADS", "GLIBC_TUNABLES")}
    process = await asyncio.create_subprocess_exec(
        str(BIN / "relightd"), "--port", "0", "--size", "64x36", "--samples", "2", "--paths", "all", "--source", str(source),
        "--cache-file", "off", stderr=asyncio.subprocess.PIPE, preexec_fn=limit, env={**env, "HOME": "/nonexistent"})
    said = b""
    try:
        async with Deadline():
            while line := await process.stderr.readline():
                said += line
                if b"listening on" in line:
                    await asyncio.sleep(0.5)
                    if process.returncode is None:
                        process.terminate()
            return await process.wait(), said.decode(errors="replace")
    except Failed:
        process.kill()
        raise Failed(f"with {value} it neither serves nor ends: {said.decode(errors='replace')}") from None


@row(alone=True)
async def G129_no_threads_memory_or_descriptors(folder):
    """Fourteen values of each limit, forty with RELIGHT_LONG: the program serves and ends with 0, or ends with a code and a reason. The dynamic
    linker's own failures are such ends, too."""
    if SANITIZED:
        skip("sanitizers need more memory than any limit here")
    root = os.geteuid() == 0
    folder.chmod(0o755)
    source = sky(folder / "sky.hdr")
    ranges = {resource.RLIMIT_AS: [int((60 << 20) * 24 ** (i / 39)) for i in STEPS],
              resource.RLIMIT_NOFILE: [3 + i for i in STEPS]}
    if root:
        ranges[resource.RLIMIT_NPROC] = [1 + i for i in STEPS]
    try:
        await limited(resource.RLIMIT_CORE, 0, source, STRANGER if root else None)
    except PermissionError:
        skip("the programs are where no other user may go")
    gate, ends = asyncio.Semaphore(3), {}

    async def one(kind, value):
        async with gate:
            code, said = await limited(kind, value, source, STRANGER + value % 10007 if root else None)
        check(code in (0, 1, 127) and said.strip(), f"with {value} of limit {kind} it ended with {code}: {said}")
        check(code != 0 or "listening on" in said, f"with {value} of limit {kind} it never served: {said}")
        ends[code == 0] = ends.get(code == 0, 0) + 1

    await asyncio.gather(*(one(kind, value) for kind, values in ranges.items() for value in values))
    return f"{ends.get(True, 0)} times it serves, {ends.get(False, 0)} times it ends with a reason"


if __name__ == "__main__":
    main()
