#!/usr/bin/python3
"""Faults of the host (group F): threads, encoders, devices, signals, clocks, locales, ports."""

import asyncio
import json
import os
import random
import signal
import subprocess
import time

from faults import BIN, BINARY, KEPT, TEXT, WAIT_S, Failed, Raw, Relightd, Viewer, check, environment, frame, hello, main, row, say
from faults import preloaded, skip, until
from peer import run

SKY = "sky:size=128x64,speed=60"


@row(alone=True)
async def F82_no_thread_can_be_had(folder):
    """Each of the first threads fails in turn: the server reports it and exits with 1, or continues without. The first
    ten or so are those by which it finds out whether all can be had. Embree's TBB aborts if one of its own fails after
    that, which no limit of the system causes."""
    said = {}
    for n in range(1, 25):
        server = Relightd(source=SKY, env=preloaded(FAIL_THREAD=n, CLOCK_FILE="/nonexistent"))
        try:
            await server.start()
        except Failed as fault:
            code = await asyncio.wait_for(server.process.wait(), WAIT_S)
            check(code == 1 or (code == -6 and ("Embree" in str(fault) or "tbb" in str(fault))), f"thread {n}: ended with {code}: {fault}")
            said["ends with a reason"] = said.get("ends with a reason", 0) + 1
            continue
        try:
            async with Viewer(server) as viewer:
                await until(lambda: viewer.pictures >= 2 or not server.alive(),
                            f"thread {n}: neither pictures nor an end: {''.join(server.lines)}")
                what = "serves" if server.alive() else "ends with a reason"
                said[what] = said.get(what, 0) + 1
        finally:
            ended = await server.stop()
        check(ended in (0, 1), f"thread {n}: ended with {ended}: {''.join(server.lines)}")
    return f"of 24: {said}"


@row(alone=True)
async def F84_folders_that_cannot_be_written(folder):
    (folder / "file").write_text("x", encoding="ascii")
    async with Relightd(source=SKY) as server:
        program = await run("relight-record", "--from", f"ws://127.0.0.1:{server.port}", "--out",
                            folder / "file" / "p.%04d.jpg", "--frames", "1")
        check(program.code in (1, 2, 3), f"ended with {program.code}: {program.err}")
    async with Relightd("--method", "cached", source=SKY, env={"XDG_CACHE_HOME": str(folder / "file")}) as server:
        async with Viewer(server) as viewer:
            await viewer.sees(5)
    return f"relight-record ends with {program.code}; relightd goes on without its cache's file"


@row(alone=True)
async def F85_no_video_encoder(folder):
    async with Relightd(source=SKY, env=preloaded(FAIL_CODEC=1)) as server, Viewer(server) as viewer:
        await viewer.sees(2)
        raw = await Raw.open(server.port)
        await raw.upgrade()
        raw.send(hello())
        formats = (await raw.until("welcome"))["formats"]
        raw.send(say(op="subscribe", format="h264"))
        for _ in range(6):  # statuses: until then there would be a picture
            await raw.until("status")
        await raw.pong()
        raw.send(say(op="subscribe", format="jpeg"))
        while raw.binary < 2:
            await raw.receive()
        raw.shut()
        await viewer.sees(2)
        check(len(server.lines) < 50, f"{len(server.lines)} lines in the log")
        return f"offered: {', '.join(formats)}; {len(server.lines)} lines in the log; JPEG goes on for all"


@row(alone=True)
async def F86_no_embree_device(folder):
    server = Relightd(source=SKY, env=preloaded(FAIL_EMBREE=1))
    try:
        await server.start()
    except Failed as fault:
        code = await server.process.wait()
        check(code == 1 and "error" in str(fault), f"ended with {code}: {fault}")
        return f"ends with 1: {str(fault).split('error: ')[-1].strip()}"
    await server.stop()
    raise Failed("it serves without a device")


@row(alone=True)
async def F88_signals_at_random_times(folder):
    draw, ends = random.Random(88), []
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGTERM, signal.SIGINT):
        server = Relightd(source=SKY)
        await server.start()
        await asyncio.sleep(draw.random())
        begun = time.monotonic()
        code = await server.stop(number)
        ends.append(time.monotonic() - begun)
        check(code == 0, f"{number}: ended with {code}: {''.join(server.lines)}")
    async with Relightd(source=SKY) as server, Viewer(server) as viewer:
        await viewer.sees(2)
        for _ in range(20):
            for number in (signal.SIGPIPE, signal.SIGWINCH, signal.SIGCONT, signal.SIGCHLD):
                server.process.send_signal(number)
            await asyncio.sleep(draw.random() * 0.05)
        await viewer.sees(2)
        server.process.send_signal(signal.SIGSTOP)
        await asyncio.sleep(1)
        server.process.send_signal(signal.SIGCONT)
        await viewer.sees(5)
        check(not viewer.parted, f"closed with {viewer.parted}")
        server.process.send_signal(signal.SIGTERM)
        await until(lambda: viewer.parted)
        check(viewer.parted[:1] == [1001], f"told {viewer.parted}")
        await asyncio.wait_for(server.process.wait(), WAIT_S)  # a second signal would end it at once
    return f"TERM and INT end it with 0 after {max(ends):.1f} s at most, viewers are told 1001; PIPE and a STOP of 1 s cost nothing"


@row(alone=True)
async def F89_the_clock_steps(folder):
    """An hour forward and back while a viewer watches: pictures and texts continue, no connection is closed."""
    step = folder / "ahead"
    step.write_text("0", encoding="ascii")
    async with Relightd(source=SKY, env=preloaded(CLOCK_FILE=step)) as server, Viewer(server) as viewer:
        await viewer.sees(5)
        raw = await Raw.open(server.port)
        await raw.upgrade()
        raw.send(hello() + say(op="subscribe", format="jpeg", max_rate=50))
        gaps = []
        for ahead in (3600, 0, -3600, 0):
            step.write_text(str(ahead), encoding="ascii")
            viewer.gap_s = 0.0
            await viewer.sees(20)
            await raw.pong()
            gaps.append(viewer.gap_s)
        await asyncio.sleep(0.6)
        check(not viewer.parted, f"closed with {viewer.parted}")
        raw.shut()
        return f"longest wait for a picture {max(gaps) * 1e3:.0f} ms"


@row(alone=True)
async def F90_a_locale_of_decimal_commas(folder):
    made = subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / "de_DE.UTF-8")], capture_output=True,
                          check=False)
    if not (folder / "de_DE.UTF-8").exists():
        skip(f"no locale can be made: {made.stderr.decode()[:80]}")
    env = {"LOCPATH": str(folder), "LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"}
    async with Relightd("--scale", "-0.5", "--rotate", "12.5", source=SKY, env=env) as server, Viewer(server) as viewer:
        await viewer.sees(5)
        raw = await Raw.open(server.port)
        await raw.upgrade()
        raw.send(hello("controller"))
        told = await raw.until("control")
        check(told["rotate_degrees"] == 12.5 and told["scale_stops"] == -0.5, f"{told}")
        raw.send(frame(TEXT, b'{"op":"control","request":1,"rotate_degrees":1.5}'))
        while (told := await raw.until("control"))["request"] != 1:
            pass
        check(told["rotate_degrees"] == 1.5, f"{told}")
        raw.shut()
        metrics = (await server.get("/metrics"))[1]
        check(b"," not in b"".join(line.rsplit(b" ", 1)[-1] for line in metrics.splitlines() if line[:1] != b"#"),
              "a comma in a number")
    return "numbers stay as they were"


@row(alone=True)
async def F92_connections_that_come_and_go(folder):
    """2000 of every kind here, 10^5 in the long run (RELIGHT_CYCLES)."""
    count = int(os.environ.get("RELIGHT_CYCLES", "2000"))
    async with Relightd("--rate", "10", source=SKY) as server, Viewer(server) as viewer:
        await viewer.sees(2)

        async def cycle(i):
            try:
                raw = await Raw.open(server.port)
            except OSError:
                return
            if i % 5:
                raw.send(raw.handshake())
            if i % 5 > 1:
                raw.send(hello("viewer" if i % 2 else "controller"))
            if i % 5 > 2:
                raw.send(say(op="subscribe", format="jpeg"))
            if i % 5 > 3 and (await raw.answer())[0] == 101:
                await raw.rest_until(3)
            if i % 3:
                raw.reset()
            else:
                raw.shut()

        async def some(n):
            for i in range(0, n, 20):
                await asyncio.gather(*(cycle(i + k) for k in range(20)))

        await some(count // 4)  # buffers for reuse are allocated
        await asyncio.sleep(0.5)
        for _ in range(3):  # a leak grows each time; the memory of further skies (5 MB each) and of a cache does not
            descriptors, memory, begun = server.descriptors(), server.memory_kib(), time.monotonic()
            await some(count)
            took = time.monotonic() - begun
            await until(lambda: server.descriptors() <= descriptors, f"{server.descriptors()} descriptors, {descriptors} before")
            grown = server.memory_kib() - memory
            if grown < KEPT * (8192 + count // 10):
                break
        check(grown < KEPT * (8192 + count // 10), f"{grown} KiB more memory")
        await viewer.sees(2)
        check(not viewer.parted, f"closed with {viewer.parted}")
        return f"{count} connections, {count / took:.0f} a second: {grown:+d} KiB, no descriptor more"


@row(alone=True)
async def F95_what_cannot_be_begun_with(folder):
    """One line, an exit code, and no picture."""
    (folder / "bad.json").write_text("{", encoding="ascii")
    (folder / "empty.json").write_text("{}", encoding="ascii")
    (folder / "odd.json").write_text(json.dumps({"models": [{"file": "nowhere.obj"}]}), encoding="ascii")
    (folder / "deep.json").write_text("[" * 100000, encoding="ascii")
    cases = [(["--scene", folder / n], 1) for n in ("bad.json", "empty.json", "odd.json", "deep.json", "none.json", "")]
    cases += [(["--port", "65536"], 2), (["--port", "x"], 2), (["--bind", "300.1.1.1"], 2), (["--bind", "0.0.0.0"], 2),
              (["--source", folder / "no.%d.exr"], 1), (["--web", folder], 1), (["--port", "1", "--bind", "203.0.113.7"], 2),
              (["--camera", "nobody"], 1), (["--samples", "0"], 2), (["--config", folder / "none.json"], (1, 2))]
    for flags, code in cases:
        program = await run("relightd", "--size", "16x9", "--port", "0", *flags)
        codes = code if isinstance(code, tuple) else (code, 3 - code)
        check(program.code in codes and program.err.strip(), f"{flags}: ended with {program.code}: {program.err}")
    return f"{len(cases)} cases: exit code 1 or 2 and a reason"


@row(alone=True)
async def F96_two_servers_on_one_port(folder):
    async with Relightd(source=SKY) as server, Viewer(server) as viewer:
        await viewer.sees(2)
        program = await run("relightd", "--size", "16x9", "--port", server.port)
        check(program.code == 1 and "in use" in program.err, f"{program.code}: {program.err}")
        await viewer.sees(2)
        check(not viewer.parted, "the first one suffered")
    return "the second ends with 1, the first goes on"


@row(alone=True)
async def F98_starved_of_processors(folder):
    """On one processor shared with three busy programs: pictures arrive, and texts are answered meanwhile."""
    core = str(min(os.sched_getaffinity(0)))
    burners = [subprocess.Popen(["taskset", "-c", core, "sh", "-c", "while :; do :; done"]) for _ in range(3)]
    try:
        async with Relightd("--size", "320x180", "--method", "auto", before=("taskset", "-c", core), source=SKY) as server:
            async with Viewer(server) as viewer:
                await viewer.sees(3)
                raw = await Raw.open(server.port)
                await raw.upgrade()
                raw.send(hello())
                await raw.until("welcome")
                waits = []
                for i in range(30):
                    begun = time.monotonic()
                    await raw.pong(i + 1)
                    waits.append(time.monotonic() - begun)
                    await asyncio.sleep(0.03)
                raw.shut()
                await viewer.sees(2)
                check(not viewer.parted, f"closed with {viewer.parted}")
                waits.sort()
                return f"a word is answered after {waits[15] * 1e3:.0f} ms (median), {waits[-1] * 1e3:.0f} ms at most"
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


@row(alone=True)
async def F100_other_minor_versions(folder):
    """An older client omits fields that it does not know; a newer one sends fields that we do not know."""
    async with Relightd(source="push:") as server, Viewer(server) as viewer:
        for role in ("viewer", "controller", "producer"):
            for version in ({"major": 1}, {"major": 1, "minor": 0}, {"major": 1, "minor": 99, "patch": 3}):
                raw = await Raw.open(server.port)
                await raw.upgrade()
                raw.send(say(op="hello", role=role, version=version, shiny=True, list=[1, {"a": None}]))
                await raw.until("welcome")
                raw.send(say(op="ping", id=3, colour="green"))
                await raw.until("pong")
                raw.send(say(op="of-1.99", x=1))
                check((await raw.until("error"))["code"] == "unknown_op", "another error")
                await raw.pong()
                raw.shut()
                await asyncio.sleep(0.1)
        raw = await Raw.open(server.port)
        await raw.upgrade()
        raw.send(hello("producer"))
        await raw.until("welcome")
        longer = environment(1, header=1024)
        raw.send(frame(BINARY, longer[:48] + b"\1" * 976 + longer[48:]))
        check((await raw.until("frame"))["fate"] == "used", "a longer header is not passed over")
        raw.shut()
        await viewer.sees(1)
    return "served alike; longer headers are passed over"


if __name__ == "__main__":
    main()
