#!/usr/bin/python3
"""Plays random clients against a server of relight.v1 and holds every answer to the state model of protocol.py, with an honest viewer
beside them. usage:
    model.py [--seconds N] [--seed N] [--jobs N]     relightd of RELIGHT_BIN, with a computed sky and with frames of producers
    model.py --url ws://HOST:PORT/ws ...             any server; its pictures must come by themselves
    model.py --replay FILE [--url ...] [--producers] a printed script
A finding is replayed alone, shortened and printed as a script. After each batch of runs two addresses lay siege to what all share
(siege.py), and others get theirs all the same; then the honest viewer gets pictures, descriptors and memory have returned, and the
server lives. Sieges by slow viewers need large pictures, so they have a server of their own from ten minutes on. Exit code 1: a finding."""

import argparse
import asyncio
import contextlib
import json
import os
import random
import struct
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "faults"), str(HERE.parent / "integration")]

if "--url" in sys.argv:
    os.environ.setdefault("RELIGHT_BIN", "/nonexistent")  # peer.py asks for it

from websockets import WebSocketException  # noqa: E402

from faults import SANITIZED, Failed, Producer, Relightd, Viewer, connect  # noqa: E402
from peer import WAIT_S, until  # noqa: E402
from peer import radiance, sky_files  # noqa: E402
from client import Client, Finding  # noqa: E402
from protocol import ENVIRONMENT, ENVIRONMENT_NAMES, ENVIRONMENT_STRUCT  # noqa: E402
from script import write, write_siege  # noqa: E402
from siege import Sluggard, Watcher, Weather, bounds, cut_of, others, texels  # noqa: E402

AGAIN_S = 5  # for an answer that has been missed before
SHORT_S = 0.2  # for what may not come
BATCH = 48  # runs between two looks at the server
SLOW_S = 600  # sieges by slow viewers need so long a search
SLOW_SIZE, SLOW_VIEWERS = "1920x1080", 40  # pictures of some 6 MB: 21 viewers reach what they may hold together
KIB_MOST = (256 if SANITIZED else 64) << 10  # memory that views, caches and skies of random settings may take after the first batches


# ---- One run ----

class Run:
    def __init__(self, stage, wait_s=WAIT_S):
        self.wait_s = wait_s
        self.host, self.path, self.offered = stage.host, stage.path, stage.offered
        self.stage = stage
        self.sent = self.received = self.pictures = self.pings = 0
        self.known_fates = {}
        self.clients, self.beside = {}, {}

    async def play(self, steps):
        """Raises the first finding."""
        async with contextlib.AsyncExitStack() as stack:
            if self.stage.producing and any(step["do"] == "others" for step in steps):
                await stack.enter_async_context(Weather(self.stage))
            await self.play_steps(steps)

    async def play_steps(self, steps):
        try:
            for step in steps:
                client = self.clients.get(step["c"])
                if step["do"] == "open":
                    await self.open(step["c"], step.get("source"))
                elif step["do"] in ("watch", "slow"):
                    await self.open_beside(step)
                elif step["do"] == "others":
                    await self.look_at_others()
                elif step["do"] == "leave" and step["c"] in self.beside:
                    self.beside.pop(step["c"]).leave()
                elif client:
                    await self.step(client, step)
                for each in self.clients.values():
                    if each.finding:
                        raise each.finding
            for client in self.clients.values():
                await client.settle(self.wait_s)
            self.judge_beside()
        finally:
            for client in [*self.clients.values(), *self.beside.values()]:
                client.leave()

    async def open_beside(self, step):
        if step["c"] in self.beside:
            self.beside[step["c"]].leave()
        client = Watcher(self.stage, step["path"]) if step["do"] == "watch" else Sluggard(self.stage, step["format"])
        self.beside[step["c"]] = client
        try:
            await client.open(step["source"])
            if step["do"] == "slow":  # the next one begins another picture
                await self.stage.viewer.sees(1)
        except (OSError, asyncio.TimeoutError, Failed) as fault:
            raise Finding("no connection beside", f"{step}: {fault}") from None

    def judge_beside(self):
        for client in self.beside.values():
            if isinstance(client, Watcher) and client.wrong:
                raise Finding("a wrong answer over HTTP", client.wrong)

    async def look_at_others(self):
        self.judge_beside()
        held = sum(c.begun for c in self.beside.values() if isinstance(c, Sluggard))
        try:
            wrong = await others(self.stage) or await bounds(self.stage, held)
        except (OSError, asyncio.TimeoutError, WebSocketException, Failed) as fault:
            wrong = "others get nothing", f"{fault}"
        if wrong:
            raise Finding(*wrong)

    async def open(self, name, source=None):
        if name in self.clients:
            self.clients[name].leave()
        host, _, port = self.host.rpartition(":")
        client = Client(self, f"client {name}")
        try:
            await asyncio.wait_for(client.open(host.strip("[]"), int(port), source), WAIT_S)
        except OSError as fault:
            raise Finding("no connection", str(fault)) from None
        self.clients[name] = client
        if not await client.until(lambda: client.upgraded, WAIT_S):
            raise Finding("no handshake", "no answer")

    async def step(self, client, step):
        do = step["do"]
        if not client.speaks():
            return
        if do == "text":
            client.send_text(self.filled(client, step), step.get("pieces"))
        elif do == "frame":
            data, number, good = environment(client, step)
            client.send_frame(data, number, good, step.get("pieces", 1))
        elif do == "raw":
            client.send_raw(bytes.fromhex(step["hex"]))
        elif do == "sync":
            await client.sync(self.wait_s)
        elif do == "credit" and client.state == "producer":
            await client.until(lambda: client.credit > 0, SHORT_S)
        elif do == "picture" and client.wish and not client.wish.get("paused"):
            seen = client.pictures
            await client.until(lambda: client.pictures > seen, SHORT_S)
        elif do == "leave":
            client.leave(step.get("code"))

    @staticmethod
    def filled(client, step):
        if "hex" in step:
            return bytes.fromhex(step["hex"])
        text = step["text"]
        if "$" in text:
            for name, value in (("$LAST-1", client.last - 1), ("$SEEN+1", client.seen + 1), ("$LAST", client.last), ("$SEEN", client.seen)):
                text = text.replace(f'"{name}"', str(max(1, value)))
        return text.encode()


def environment(client, step):
    """(message, number, whether it can be used)."""
    number = max(0, client.number + step["number"])
    client.number = max(client.number, number)
    encoding, (width, height), channels = step.get("encoding", 4), step.get("size", (8, 4)), step.get("channels", 3)
    good = True
    if encoding in (1, 2):
        payload = {"junk": b"junk" * 20, "head": b"#?RADIANCE\n" if encoding == 2 else b"\x76\x2f\x31\x01", "empty": b""}[step["file"]]
        width = height = channels = 0
        good = False
    else:
        payload = texels(step.get("sky", "grey"), width * height, channels, "e" if encoding == 3 else "f")
        good = "layout" not in step
    fields = {"magic": b"RLE1", "header": 48, "encoding": encoding, "layout": step.get("layout", 0), "flags": step.get("flags", 0),
              "channels": channels, "zero": 0, "width": width, "height": height, "payload": len(payload), "number": number,
              "capture_us": 0, "zeros": b"\0" * 8}
    data = bytearray(ENVIRONMENT_STRUCT.pack(*(fields[n] for n in ENVIRONMENT_NAMES)) + payload)
    for name, value in step.get("bend", {}).items():
        at, kind = next((o, k) for o, k, n in ENVIRONMENT if n == name)
        size = {"u8": 1, "u16": 2, "u32": 4}.get(kind, 4 if kind == "4 bytes" else 8)
        data[at:at + size] = (value & ((1 << 8 * size) - 1)).to_bytes(size, "little")
        good = False
    cut = step.get("cut", 0)
    data = bytes(data) + b"y" if cut < 0 else bytes(data[:len(data) - cut])
    number, = struct.unpack_from("<Q", data.ljust(32, b"\0"), 24)
    return data, number, good and not cut


# ---- A server ----

class Stage:
    """A server with an honest viewer."""

    def __init__(self, name, producing, url=None, slow=0):
        """slow: large pictures, and sieges by so many viewers that do not read them; nothing else."""
        self.name, self.producing, self.url, self.slow = name, producing, url, slow
        self.arguments = ("--size", SLOW_SIZE, "--max-picture-seconds", "600") if slow else ()
        self.kib_most = 4 * KIB_MOST if slow else KIB_MOST
        self.server = self.viewer = None
        self.batches = self.turn = 0
        self.kib = None

    async def __aenter__(self):
        if not self.url:
            self.folder = tempfile.TemporaryDirectory()
            source = "push:" if self.producing else sky_files(self.folder.name, 20)
            for number, (value, exponent) in {3: (0, 0), 4: (0, 0), 8: (128, 255), 12: (128, 1)}.items() if not self.producing else ():
                sky = radiance(value)[:-8] + bytes([value, value, value, exponent]) * 2
                Path(source % number).write_bytes(sky)  # black, glaring, faint
            self.server = await Relightd("--fps", "60", "--max-picture-seconds", "1", "--rate", "30", "--method", "mis", *self.arguments, source=source,
                                         env={"ASAN_OPTIONS": "detect_leaks=0:quarantine_size_mb=4"}).__aenter__()
            self.url = self.server.url
        at = urlsplit(self.url)
        self.host, self.path = f"{at.hostname}:{at.port}", at.path or "/ws"
        await self.meet()
        self.viewer = await Viewer(self).__aenter__()  # it needs nothing of a server but its url
        await self.look(first=True)
        return self

    async def meet(self):
        """What the server offers."""
        async with connect(self.url) as link:
            await link.send('{"op":"hello","role":"viewer","version":{"major":1}}')
            welcome = json.loads(await link.recv())
            status = {}
            while status.get("op") != "status":
                said = await link.recv()
                status = json.loads(said) if isinstance(said, str) else {}
        self.offered, self.offers, self.width = welcome["roles"], status.get("offers", {}), status.get("width", 0)
        cheap = [m for m in self.offers.get("methods", []) if m in ("auto", "mis", "brdf", "light", "faces", "uniform", "cached")]
        self.offers = {**self.offers, "methods": cheap or self.offers.get("methods", [])}

    async def __aexit__(self, *of):
        if self.viewer:
            await self.viewer.__aexit__(*of)
        if self.server:
            if self.server.alive():
                await self.server.__aexit__(*of)

    def ended(self):
        """Why the server is gone, or has complained; or None."""
        if not self.server:
            return None
        words = "".join(self.server.lines)
        for sign in ("ERROR: AddressSanitizer", "runtime error:", "Assertion"):
            if sign in words:
                return sign + words.split(sign, 1)[1][:3000]
        return None if self.server.alive() else f"relightd ended with {self.server.process.returncode}: {words[-1500:]}"

    async def reset(self):
        """Settings under which pictures come."""
        if "controller" not in self.offered:
            return
        async with connect(self.url) as link:
            await link.send('{"op":"hello","role":"controller","version":{"major":1,"minor":1}}')
            request = '{"op":"control","request":1,"paused":false,"method":"mis","samples":4,"fps":60,"scale_stops":0,"paths":"all"}'
            await link.send(request)
            end = asyncio.get_running_loop().time() + WAIT_S
            while True:
                said = await asyncio.wait_for(link.recv(), WAIT_S)
                said = json.loads(said) if isinstance(said, str) else {}
                if said.get("op") == "control" and said["request"] == 1:
                    return
                busy = said.get("code") == "busy" and asyncio.get_running_loop().time() < end
                if busy:  # what a script has asked for still waits (4.13.8)
                    await asyncio.sleep(0.1)
                    await link.send(request)
                elif said.get("op") == "error":
                    raise Finding("the settings could not be restored", f"{said}")

    async def measure(self):
        """Before a siege."""
        if self.server:
            self.kib_before = self.server.memory_kib()
            self.cut_before = cut_of(await self.server.counters())

    async def look(self, first=False):
        """After a batch: the server lives, the honest viewer gets pictures, memory and descriptors have returned."""
        self.batches += 1
        try:
            await self.reset()
            if self.producing:
                async with Producer(self):
                    await self.viewer.sees(1)
            else:
                await self.viewer.sees(1)
        except Failed as fault:
            raise Finding("the honest viewer gets no picture", f"{fault}; {self.ended()}") from None
        except OSError as fault:
            raise Finding("the server is gone", f"{fault}; {self.ended()}") from None
        if self.viewer.parted:
            raise Finding("the honest viewer was closed", f"{self.viewer.parted}")
        if self.ended():
            raise Finding("the server ended", self.ended())
        if not self.server:
            return
        if first:
            await asyncio.sleep(0.3)
            self.descriptors, self.files = self.server.descriptors(), self.server.open_files()
        try:
            await until(lambda: self.server.descriptors() <= self.descriptors)
        except Failed:
            left = self.server.descriptors()
            raise Finding("descriptors do not return", f"{left}, at the start {self.descriptors}: {self.server.open_files()}, {self.files}") from None
        kib = self.server.memory_kib()
        if self.batches == 12:
            self.kib = kib
        if self.kib and kib > self.kib + self.kib_most:
            raise Finding("memory does not return", f"{kib} KiB, after the first batches {self.kib}")


# ---- Many runs ----

class Totals:
    def __init__(self):
        self.runs = self.sent = self.received = self.pictures = self.found = 0

    def add(self, run):
        self.runs += 1
        self.sent += run.sent
        self.received += run.received
        self.pictures += run.pictures


async def finding_of(stage, steps, totals, wait_s=WAIT_S):
    """What one run finds, or None."""
    run = Run(stage, wait_s)
    try:
        await run.play(steps)
    except Finding as finding:
        await asyncio.sleep(0.2)  # a server that has ended is the cause, not the connection that it broke
        return Finding("the server ended", stage.ended()) if stage.ended() else finding
    finally:
        totals.add(run)
    return Finding("the server ended", stage.ended()) if stage.ended() else None


async def batch(stage, scripts, totals, jobs):
    """Plays them, `jobs` at a time, those with producers one after another. Returns [(script, finding)]."""
    found = []
    waiting = list(enumerate(scripts))
    gate = asyncio.Lock()

    async def work():
        while waiting and not found:
            index, steps = waiting.pop(0)
            finding = None
            if any('"producer"' in step.get("text", "") or '"recorder"' in step.get("text", "") for step in steps):
                async with gate:
                    finding = await finding_of(stage, steps, totals)
            else:
                finding = await finding_of(stage, steps, totals)
            if finding:
                found.append((index, finding))

    await asyncio.gather(*(work() for _ in range(jobs)))
    return found


async def revived(stage):
    """The stage, or another one like it if its server is gone."""
    if stage.server and (not stage.server.alive() or stage.ended()):
        await stage.viewer.__aexit__(None, None, None)
        await stage.server.stop(9)
        fresh = Stage(stage.name, stage.producing, slow=stage.slow)
        return await fresh.__aenter__()
    return stage


async def shorten(stage, steps, finding, totals, look):
    """A minimal script with the same finding. look: it shows only afterwards."""
    async def shows(candidate):
        nonlocal stage
        for _ in range(2):
            stage = await revived(stage)
            await stage.reset()
            await stage.measure()
            if look and stage.server:  # what has not returned before is no sign
                stage.descriptors, stage.kib = stage.server.descriptors(), None
            got = await finding_of(stage, candidate, totals, AGAIN_S)
            if not got and look:
                try:
                    await stage.look()
                except Finding as late:
                    got = late
            if got and got.kind == finding.kind:
                return True
        return False

    if not await shows(steps):
        return steps, False
    size = max(1, len(steps) // 2)
    while size:
        at, shorter = 0, False
        while at < len(steps):
            candidate = steps[:at] + steps[at + size:]
            if candidate and await shows(candidate):
                steps, shorter = candidate, True
            else:
                at += size
        size = size if shorter and size == 1 else size // 2
    for i, step in enumerate(steps):  # then the fields of each message
        if step["do"] == "text" and "text" in step:
            try:
                fields = json.loads(step["text"])
            except ValueError:
                continue
            for name in [n for n in fields if n != "op"] if isinstance(fields, dict) else []:
                less = {n: v for n, v in fields.items() if n != name}
                candidate = [*steps[:i], {**step, "text": json.dumps(less)}, *steps[i + 1:]]
                if await shows(candidate):
                    steps, fields = candidate, less
        for name in [n for n in step if n not in ("c", "do", "text", "hex", "number", "encoding", "file", "path", "format", "source")]:
            candidate = [*steps[:i], {n: v for n, v in steps[i].items() if n != name}, *steps[i + 1:]]
            if await shows(candidate):
                steps = candidate
    return steps, True


def tell(stage, finding, steps, alone, seed):
    print(f"FINDING ({stage.name}, seed {seed}): {finding}")
    print("script, for --replay" + (" --producers" if stage.producing else " --slow" if stage.slow else "") +
          (":" if alone else " (not seen when it was played alone):"))
    print("[" + ",\n ".join(json.dumps(step) for step in steps) + "]", flush=True)


async def search(stage, options, totals, end):
    """Batches of runs until `end` or a finding here or elsewhere. Whether there was one here."""
    seeds = random.Random(options.seed * 2 + stage.producing)
    while time.monotonic() < end and not totals.found:
        chosen = [seeds.getrandbits(48) for _ in range(0 if stage.slow else BATCH)]
        scripts = [write(seed, stage.offered, stage.offers, stage.producing) for seed in chosen]
        found = await batch(stage, scripts, totals, options.jobs)
        late = None
        if not found:
            chosen = [*chosen, seeds.getrandbits(48)]
            scripts = [*scripts, write_siege(chosen[-1], stage.offered, stage.slow)]
            await stage.reset()
            await stage.measure()
            found = [(len(scripts) - 1, finding) for _, finding in await batch(stage, scripts[-1:], totals, 1)]
        if not found:
            try:
                await stage.look()
            except Finding as finding:
                late = finding
        if found or late:
            totals.found += 1
            await show(stage, scripts, chosen, found, late, totals)


async def show(stage, scripts, seeds, found, late, totals):
    index, finding = found[0] if found else (0, late)
    print(f"found, to be shortened: {finding}", flush=True)
    alone = False
    for i in [index] if found else range(len(scripts)):  # what shows only afterwards may be due to any of them
        steps, alone = await shorten(stage, scripts[i], finding, totals, look=late is not None)
        if alone or found:
            break
    tell(stage, finding, steps if alone or found else [s for script in scripts for s in script], alone, seeds[i])


def report(totals, begun, findings):
    took = time.monotonic() - begun
    print(f"{totals.runs} runs, {totals.sent} messages sent and {totals.received} received ({totals.pictures} pictures) in {took:.0f} s, "
          f"{(totals.sent + totals.received) / max(took, 0.1):.0f} messages a second; findings: {findings}")
    return findings


async def play(options):
    async with contextlib.AsyncExitStack() as stack:
        if options.url:
            stages = [await stack.enter_async_context(Stage("the server", options.producers, options.url))]
        else:
            kinds = (True,) if options.producers else (False, True) if not options.replay else (False,)
            stages = [await stack.enter_async_context(Stage("producers" if p else "files", p)) for p in kinds]
            if options.slow or not options.replay and options.seconds >= SLOW_S:
                stages.insert(0, await stack.enter_async_context(Stage("large pictures", False, slow=SLOW_VIEWERS)))
        if options.replay:
            steps = json.loads(Path(options.replay).read_text(encoding="utf-8"))
            await stages[0].measure()
            finding = await finding_of(stages[0], steps, Totals())
            if not finding:
                await stages[0].look()
            print(finding or "nothing found")
            return 1 if finding else 0
        totals, begun = Totals(), time.monotonic()
        await asyncio.gather(*(search(stage, options, totals, begun + options.seconds) for stage in stages))
        return report(totals, begun, totals.found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--jobs", type=int, default=8, help="runs at the same time")
    parser.add_argument("--url")
    parser.add_argument("--producers", action="store_true", help="the server takes frames")
    parser.add_argument("--slow", action="store_true", help="also besiege a server of large pictures by slow viewers")
    parser.add_argument("--replay")
    options = parser.parse_args()
    print(f"seed {options.seed}", flush=True)
    try:
        sys.exit(asyncio.run(play(options)))
    except Finding as finding:
        print(f"FINDING: {finding}")
        sys.exit(1)


if __name__ == "__main__":
    main()
