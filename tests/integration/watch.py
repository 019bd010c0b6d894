#!/usr/bin/python3
"""relightd for its operator: /metrics, /healthz, /readyz, its log, its shutdown, and restored state."""

import asyncio
import json
import math
import os
import pty
import re
import signal
import time
import urllib.request

import websockets

from control import Party
from peer import BIN, FRAME, WAIT_S, check, main, radiance, run, skip, until
from still import Daemon, connect

try:
    from prometheus_client.parser import text_string_to_metric_families
except ImportError:  # the parser below suffices
    text_string_to_metric_families = None

NAME = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
LABEL = re.compile(r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\["\\n])*)"')
TYPES = {"counter", "gauge", "histogram"}
FEW = ("--samples", "4", "--paths", "direct", "--edge-rays", "1")


def samples_of(line, number):
    """One sample line: name, labels, value."""
    name = NAME.match(line)
    check(name, f"line {number}: no name: {line}")
    rest, labels = line[name.end():], {}
    if rest.startswith("{"):
        rest = rest[1:]
        while not rest.startswith("}"):
            label = LABEL.match(rest)
            check(label and label[1] not in labels, f"line {number}: not a label: {rest}")
            labels[label[1]] = label[2]
            rest = rest[label.end():]
            check(rest[:1] in (",", "}"), f"line {number}: after a label: {rest}")
            rest = rest[1:] if rest.startswith(",") else rest
        rest = rest[1:]
    check(rest.startswith(" ") and len(rest.split()) == 1, f"line {number}: not one value: {rest}")
    return name[0], labels, float(rest)


def parse(text):
    """A strict parser of Prometheus' text format 0.0.4: {(name, labels): value}, {name: type}."""
    check(text.endswith("\n"), "the last line has no end")
    values, types, helped, family = {}, {}, set(), None
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("# HELP "):
            _, _, family, words = line.split(" ", 3)
            check(family not in helped and words, f"line {number}: HELP of {family} again, or without words")
            helped.add(family)
        elif line.startswith("# TYPE "):
            _, _, name, kind = line.split(" ")
            check(name == family and name not in types and kind in TYPES, f"line {number}: {line}")
            types[name] = kind
        else:
            check(line and not line.startswith("#"), f"line {number}: {line}")
            name, labels, value = samples_of(line, number)
            base = re.sub(r"_(bucket|sum|count)$", "", name) if types.get(family) == "histogram" else name
            check(base == family and family in types, f"line {number}: {name} stands under {family}")
            key = (name, tuple(sorted(labels.items())))
            check(key not in values, f"line {number}: {key} again")
            check((types[family] == "counter") == name.endswith("_total"), f"{name} is a {types[family]}")
            check(types[family] == "gauge" or value >= 0, f"{name} is {value}")
            values[key] = value
    check_histograms(values, types)
    return values, types


def check_histograms(values, types):
    series = {}
    for (name, labels), value in values.items():
        base = name.removesuffix("_bucket")
        if types.get(base) == "histogram" and base != name:
            labels = dict(labels)
            series.setdefault((base, tuple(sorted(l for l in labels.items() if l[0] != "le"))), []).append(
                (float(labels["le"]), value))
    check(series, "there is no histogram")
    for (base, labels), buckets in series.items():
        bounds, counts = zip(*buckets)
        check(list(bounds) == sorted(set(bounds)) and math.isinf(bounds[-1]), f"{base}{labels}: bounds {bounds}")
        check(list(counts) == sorted(counts), f"{base}{labels}: buckets fall: {counts}")
        check(values[(base + "_count", labels)] == counts[-1], f"{base}{labels}: its count is another")
        total = values[(base + "_sum", labels)]
        check(counts[-1] > 0 or total == 0, f"{base}{labels}: a sum of nothing")


def fetch(daemon, path):
    """Status and body."""
    try:
        with urllib.request.urlopen(daemon.url.replace("ws://", "http://").removesuffix("/ws") + path, timeout=WAIT_S) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as answer:
        return answer.code, answer.read().decode()


async def ask(daemon, path):
    return await asyncio.to_thread(fetch, daemon, path)


async def metrics(daemon):
    status, text = await ask(daemon, "/metrics")
    check(status == 200, f"/metrics says {status}")
    return parse(text)[0]


def value(values, name, **labels):
    key = (name, tuple(sorted(labels.items())))
    check(key in values, f"no {key}")
    return values[key]


async def until_value(daemon, wanted, name, exactly=True, **labels):
    async def reached():
        is_now = value(await metrics(daemon), name, **labels)
        check(is_now <= wanted or not exactly, f"{name}{labels} is {is_now}, not {wanted}")
        return is_now >= wanted
    await until(reached)


async def until_ready(daemon):
    async def ready():
        status, text = await ask(daemon, "/readyz")
        check(status in (200, 503), f"/readyz says {status}: {text}")
        return status == 200
    await until(ready)


async def until_kept(path, **wanted):
    """Waits until the settings are on the disk; returns the whole."""
    def kept():
        said = json.loads(path.read_text()) if path.exists() else {}
        return said.items() >= wanted.items() and said
    return await until(kept)


async def metrics_read_as_prometheus_reads_them(folder):
    async with Daemon("--source", "sky:size=128x64,speed=60", *FEW) as daemon:
        await until_ready(daemon)
        status, text = await ask(daemon, "/metrics")
        before, types = parse(text)
        check(status == 200 and types["relightd_stage_seconds"] == "histogram", types)
        if text_string_to_metric_families:
            read = {(s.name, tuple(sorted(s.labels.items()))): s.value
                    for family in text_string_to_metric_families(text) for s in family.samples}
            check(read == before, f"read in two ways: {set(read.items()) ^ set(before.items())}")
        shaded = {"name": "relightd_frames_total", "fate": "shaded", "reason": ""}
        async def more():
            return value(await metrics(daemon), **shaded) > value(before, **shaded)
        await until(more)
        after = await metrics(daemon)
        gone = set(before) - set(after)
        # An image states its error, or an upper bound, or neither.
        check(gone <= {("relightd_picture_error_ratio", ()), ("relightd_picture_error_at_most_ratio", ())}, f"gone: {gone}")
        for key in before:
            if key[0].endswith(("_total", "_bucket", "_count", "_sum")):
                check(after[key] >= before[key], f"{key} has fallen from {before[key]} to {after[key]}")
        check(value(after, "relightd_rays_total", part="direct") > 0, "no ray was counted")
        check((await ask(daemon, "/healthz"))[0] == 200, "it is not healthy")


async def frames_are_counted_by_their_fate(folder):
    for i in range(6):
        (folder / f"sky.{i}.hdr").write_bytes(b"broken" if i == 3 else radiance(64 + i))
    async with Daemon("--source", str(folder / "sky.%d.hdr"), "--once", *FEW, "--rate", "5") as daemon:
        await until_value(daemon, 6, "relightd_frames_received_total")
        await until_value(daemon, 1, "relightd_frames_total", fate="refused", reason="unreadable")
        async def all_have_one():
            now = await metrics(daemon)
            shaded = value(now, "relightd_frames_total", fate="shaded", reason="")
            dropped = value(now, "relightd_frames_total", fate="dropped", reason="superseded")
            check(shaded + dropped <= 5, f"{shaded} shaded and {dropped} dropped of 5")
            return shaded + dropped == 5 and (now, shaded)
        now, shaded = await until(all_have_one)
        check(value(now, "relightd_stage_seconds_count", stage="decode") == shaded, "times of other frames")


# ---- What comes back ----

async def killed(daemon):
    daemon.process.kill()
    await daemon.process.wait()


def in_force(party):
    said = dict(party.last["control"])
    return {key: said[key] for key in ("method", "camera", "rotate_degrees", "scale_stops", "exposure_stops",
                                       "bias_stops", "tone", "fps", "paths", "error")}


async def settings_come_back_after_kill_9(folder):
    state, arguments = folder / "state", (*FEW, "--log-level", "info")
    wish = {"method": "faces", "samples": 8, "rotate_degrees": 40, "scale_stops": 1.5, "exposure_stops": 2.5,
            "bias_stops": 0.25, "tone": "reinhard", "fps": 12.5, "paused": True}
    async with Daemon("--state", str(state), *arguments) as daemon:
        one = await Party.come(daemon.url, "controller")
        check(await one.ask(**wish) is None, "it was not done")
        await one.until(lambda: one.last["control"]["tone"] == "reinhard")
        before = in_force(one)
        await until_kept(state / "state.json", tone="reinhard")
        await killed(daemon)
    check([name.name for name in state.iterdir()] == ["state.json"], "more than the file is there")
    kept = json.loads((state / "state.json").read_text())
    check(kept["tone"] == "reinhard" and kept["said"]["tone"] == "filmic", kept)
    async with Daemon("--state", str(state), *arguments) as daemon:
        one = await Party.come(daemon.url, "viewer")
        check(in_force(one) == before, f"{in_force(one)} instead of {before}")
        check(one.last["control"]["samples"] == 8 and not one.last["control"]["paused"], one.last["control"])
    async with Daemon("--state", str(state), "--samples", "5") as daemon:  # a changed command line takes precedence
        one = await Party.come(daemon.url, "viewer")
        check(one.last["control"]["method"] == "auto" and one.last["control"]["samples"] == 5, one.last["control"])


async def a_state_that_is_none_is_refused(folder):
    """Broken state, state of another version or out of range changes nothing, and is reported."""
    good = {"op": "control", "state": 1, "said": {}, "tone": "linear"}
    async with Daemon("--state", str(folder), *FEW) as daemon:
        one = await Party.come(daemon.url, "controller")
        await one.ask(tone="linear")
        good = await until_kept(folder / "state.json", tone="linear")
    text = json.dumps(good)
    for broken in (text[:-20].encode(), text.replace('"state": 1', '"state": 7').encode(),
                   json.dumps({**good, "camera": "nowhere"}).encode(), b"[" * 100000):
        (folder / "state.json").write_bytes(broken)
        async with Daemon("--state", str(folder), *FEW) as daemon:
            one = await Party.come(daemon.url, "viewer")
            check(one.last["control"]["tone"] == "filmic", f"{broken[:40]} was taken")
            check("state.json" in daemon.before and "the command line's settings" in daemon.before,
                  f"{broken[:40]} is not named: {daemon.before}")


async def a_state_that_cannot_be_kept_is_only_a_warning(folder):
    (folder / "file").write_text("in the way")
    async with Daemon("--state", str(folder / "file"), *FEW) as daemon:
        check("cannot be written to" in daemon.before, daemon.before)
        one = await Party.come(daemon.url, "controller")
        check(await one.ask(tone="linear") is None, "it does not obey any more")


# ---- The log ----

async def the_log_is_made_of_lines_for_machines(folder):
    token = "t0ken-that-nobody-sees"
    arguments = [part for role in ("viewer", "controller", "producer", "metrics")
                 for part in (f"--token-{role}", f"{token}-{role}")]
    (folder / 'sky "1".hdr').write_bytes(b"broken")
    source = ["--source", str(folder / 'sky "%d".hdr'), *FEW]
    for form in ("json", "text"):
        async with Daemon(*arguments, *source, "--log", form, "--log-level", "debug") as daemon:
            for wrong in (token + "-viewe", token + "-viewer-and-more"):
                link = await connect(daemon.url)
                await link.send(json.dumps({"op": "hello", "role": "viewer", "token": wrong,
                                            "version": {"major": 1, "minor": 0}}))
                try:
                    await asyncio.wait_for(link.wait_closed(), WAIT_S)
                finally:
                    await link.close()
            await ask(daemon, "/metrics")
            daemon.process.terminate()
            said = daemon.before + (await daemon.process.stderr.read()).decode()
        check(token not in said, f"a token is in the log: {said}")
        check("bad_token" in said and "hdr" in said, f"what was wrong is not: {said}")
        for line in said.splitlines():
            if form == "json":
                entry = json.loads(line)
                check(set(entry) == {"time", "level", "program", "message"}, line)
                check(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", entry["time"]), line)
            else:
                check(re.fullmatch(r'time=\S+ level=\w+ program=relightd message="([^"\\]|\\.)*"', line), line)


async def many_lines_of_a_kind_are_summed_up(folder):
    async with Daemon("--source", "push:", *FEW) as daemon:
        link = await connect(daemon.url)
        await link.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 0}}))
        credit, fates, number = 0, 0, 0
        while fates < 40:  # refused ones; superseded ones do not count
            message = json.loads(await asyncio.wait_for(link.recv(), WAIT_S))
            if message["op"] == "welcome":
                credit = message["producer"]["credit"]
            credit += message["frames"] if message["op"] == "credit" else 0
            fates += message["op"] == "frame" and message["fate"] == "refused"
            while credit > 0:
                payload = b"#?RADIANCE\nbroken"
                await link.send(FRAME.pack(b"RLE1", 48, 2, 0, 0, 0, 0, 0, 0, len(payload), number, 0, 0) + payload)
                credit, number = credit - 1, number + 1
        values = await metrics(daemon)
        refused = value(values, "relightd_frames_total", fate="refused", reason="unreadable")
        await link.close()
        daemon.process.terminate()
        lines = (await daemon.process.stderr.read()).decode().splitlines()
    warnings = [line for line in lines if "warning: " in line and "more like this" not in line]
    summaries = [int(m[1]) for line in lines if (m := re.search(r"warning: (\d+) more like this", line))]
    check(refused > 25 and len(warnings) <= 21 and summaries, f"{refused} refusals: {lines}")
    check(len(warnings) + sum(summaries) >= refused, f"{len(warnings)} and {summaries} of {refused}")


async def a_terminal_has_a_line_of_status_and_a_pipe_has_none(folder):
    ours, theirs = pty.openpty()
    process = await asyncio.create_subprocess_exec(str(BIN / "relightd"), "--port", "0", "--size", "96x54", "--samples",
                                                   "4", stderr=theirs)
    os.close(theirs)
    os.set_blocking(ours, False)
    said, end = b"", time.monotonic() + WAIT_S
    while not re.search(rb"\r\x1b\[K[\d.]+ images/s, 0 viewers", said) and time.monotonic() < end:
        try:
            said += os.read(ours, 65536)
        except BlockingIOError:
            await asyncio.sleep(0.1)
    process.terminate()
    await process.wait()
    os.close(ours)
    check(b"images/s, 0 viewers" in said, f"no status: {said}")
    async with Daemon(*FEW) as daemon:
        await until_value(daemon, 3, "relightd_frames_received_total", exactly=False)
        daemon.process.terminate()
        said = (await daemon.process.stderr.read()).decode()
        check("images/s" not in said and "\x1b" not in said, f"a pipe has a status: {said}")


# ---- The end ----

async def watch_until_parted(url, stuck):
    """A viewer's close code. A stuck one never reads until the server has exited: -1."""
    link = await websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, max_queue=1 if stuck else None,
                                    ping_interval=None, close_timeout=1)
    await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 0}}))
    await link.send(json.dumps({"op": "subscribe", "format": "exr_float" if stuck else "jpeg"}))
    if stuck:
        link.transport.pause_reading()
        return link
    try:
        while True:
            message = await asyncio.wait_for(link.recv(), WAIT_S)
            if isinstance(message, bytes):
                await link.send(json.dumps({"op": "ack", "sequence": int.from_bytes(message[8:16], "little")}))
    except websockets.ConnectionClosed:
        return link.close_code


async def everybody_is_told_when_it_ends(folder):
    """Forty viewers, one stuck in the middle of a large picture, for whom it does not wait for ever, while it renders."""
    async with Daemon("--size", "640x360", *FEW, "--method", "mis", "--fps", "4", "--source", "sky:size=128x64,speed=60") as daemon:
        await until_ready(daemon)
        stuck = await watch_until_parted(daemon.url, True)
        viewers = [asyncio.ensure_future(watch_until_parted(daemon.url, False)) for _ in range(39)]
        await until_value(daemon, 40, "relightd_connections", role="viewer")
        begun = time.monotonic()
        daemon.process.send_signal(signal.SIGTERM)
        codes = await asyncio.wait_for(asyncio.gather(*viewers), WAIT_S)
        code = await asyncio.wait_for(daemon.process.wait(), WAIT_S)
        took = time.monotonic() - begun
        stuck.transport.abort()
    print(f"gone {took:.2f} s after SIGTERM")
    check(code == 0 and set(codes) == {1001}, f"exit code {code}, close codes {codes}")


async def a_signal_while_a_scene_is_prepared_is_obeyed(folder):
    """Work that cannot be interrupted is abandoned."""
    process = await asyncio.create_subprocess_exec(str(BIN / "relightd"), "--port", "0", "--size", "4096x4096",
                                                   "--edge-rays", "16", stderr=asyncio.subprocess.PIPE)
    handled = 1 << (signal.SIGTERM - 1)
    with open(f"/proc/{process.pid}/status", encoding="ascii") as file:
        await until(lambda: file.seek(0) or int(re.search(r"SigCgt:\s+(\w+)", file.read())[1], 16) & handled)
    process.send_signal(signal.SIGTERM)
    said = (await asyncio.wait_for(process.stderr.read(), WAIT_S)).decode()
    check(await process.wait() == 0 and "stopped" in said, f"{process.returncode}: {said}")


# ---- The producer goes; the disk is full ----

async def the_last_sky_of_a_producer_stays_and_since_when_is_said(folder):
    async with Daemon("--source", "push:", *FEW) as daemon:
        viewer = await Party.come(daemon.url, "viewer")
        check((await ask(daemon, "/readyz"))[0] == 200, "it does not wait for a producer")
        producer = await connect(daemon.url)
        await producer.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 0}}))
        payload = radiance(100)
        await producer.send(FRAME.pack(b"RLE1", 48, 2, 0, 0, 0, 0, 0, 0, len(payload), 7, 0, 0) + payload)
        await viewer.until(lambda: viewer.last["status"]["source"]["state"] == "live"
                           and viewer.last["status"]["frame"] == 7)
        left_us = time.time_ns() // 1000
        producer.transport.abort()
        await viewer.until(lambda: viewer.last["status"]["source"]["state"] == "waiting")
        source = viewer.last["status"]["source"]
        check(re.fullmatch(r"the producer disconnected at \d\d:\d\d:\d\d UTC; its last sky stays", source["detail"]), source)
        check(-1e6 < source["since_us"] - left_us < WAIT_S * 1e6, f"{source} after {left_us}")
        late = await Party.come(daemon.url, "viewer")  # a late viewer gets the last picture
        await late.until(lambda: late.gains)
        values = await metrics(daemon)
        check(value(values, "relightd_source_state", state="waiting") == 1, "another state in the metrics")
        check(value(values, "relightd_connections", role="producer") == 0, "the producer is still counted")


async def a_disk_that_is_full_leaves_nothing_half(folder):
    """relight-record and --state on a file system of 64 KiB."""
    disk = folder / "disk"
    disk.mkdir()
    mount = await asyncio.create_subprocess_exec("mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk),
                                                 stderr=asyncio.subprocess.DEVNULL)
    if await mount.wait() != 0:
        skip("no file system can be mounted here")
    try:
        async with Daemon("--source", "sky:size=128x64,speed=60", *FEW, "--state", str(disk / "state")) as daemon:
            recorder = await run("relight-record", "--from", daemon.url.removesuffix("/ws"), "--format", "exr-float",
                                 "--out", disk / "p.%04d.exr")
            check(recorder.code == 1 and "No space left on device" in recorder.err, recorder.err)
            check(not list(disk.glob("*.part")), f"half a file is left: {list(disk.iterdir())}")
            stored = sorted(disk.glob("*.exr"))
            for name in stored:
                check(name.read_bytes()[:4] == b"\x76\x2f\x31\x01", f"{name} is no EXR")
            free = os.statvfs(disk).f_bavail * os.statvfs(disk).f_frsize
            (disk / "filler").write_bytes(b"x" * free)
            one = await Party.come(daemon.url, "controller")
            check(await one.ask(tone="linear") is None, "it does not obey")
            said = ""
            while "state.json" not in said:
                said += (await asyncio.wait_for(daemon.process.stderr.readline(), WAIT_S)).decode()
            check((await ask(daemon, "/healthz"))[0] == 200, "it is not healthy")
            daemon.process.terminate()
            said += (await daemon.process.stderr.read()).decode()
            check( "No space left on device" in said, f"the full disk is not named: {said}")
            check(not list((disk / "state").iterdir()), f"half a state: {list((disk / 'state').iterdir())}")
    finally:
        unmount = await asyncio.create_subprocess_exec("umount", str(disk))
        await unmount.wait()


if __name__ == "__main__":
    main(globals())
