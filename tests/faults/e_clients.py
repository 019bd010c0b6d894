#!/usr/bin/python3
"""Faults of clients and connections (group E): slow readers, sleepers, storms, clients that vanish and return.
Pictures are larger here than in the other suites, so that a client that does not read matters."""

import asyncio
import contextlib
import os
import resource
import signal
import struct
import time
from pathlib import Path

from faults import BINARY, TEXT, Deadline, Failed, Raw, Relightd, Viewer, check, hello, main, row, say, skip, until

KEY = 64  # flag of a picture


async def watching(stage, format="jpeg", buffer=None, **wish):
    raw = await stage.raw(buffer=buffer)
    check(await raw.upgrade() == 101, "no handshake")
    raw.send(hello() + say(op="subscribe", format=format, **wish))
    return raw


async def picture(raw):
    """Sequence and flags of the next picture; acknowledges it."""
    while True:
        kind, payload = await raw.receive()
        check(kind is not None, "the connection ended")
        if kind == BINARY:
            sequence, = struct.unpack_from("<Q", payload, 8)
            raw.send(say(op="ack", sequence=sequence))
            while not raw.final:
                await raw.receive()
            return sequence, payload[7]


async def end_of(stage, raw):
    """How long the server keeps a connection that reads nothing. Unread data hides its FIN from this end, so the
    kernel is asked about the other one: a socket without owner has no inode."""
    raw.writer.transport.pause_reading()
    ends = f":{stage.server.port:04X}", f":{raw.writer.get_extra_info('sockname')[1]:04X}"
    begun = time.monotonic()

    def ended():
        lines = [line.split() for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()]
        return not any(l[1].endswith(ends[0]) and l[2].endswith(ends[1]) and l[9] != "0" for l in lines[1:])

    await until(ended, "still connected")
    return time.monotonic() - begun


@row(patient=True, memory_kib=65536)
async def E68_a_viewer_that_stops_reading(stage):
    raw = await watching(stage, "exr_float", buffer=4096)
    took = await end_of(stage, raw)
    raw.shut()
    return f"cut after {took:.0f} s"


@row(patient=True, memory_kib=65536)
async def E69_a_viewer_at_10_kilobytes_a_second(stage):
    """A client must read 64 KiB in ten seconds: one near the limit is kept."""
    raw = await watching(stage, "jpeg", buffer=4096)
    raw.writer.transport.pause_reading()
    plain, got = raw.writer.get_extra_info("socket"), 0
    begun = time.monotonic()
    copy = os.dup(plain.fileno())
    try:
        for _ in range(120):
            await asyncio.sleep(0.1)
            try:
                data = os.read(copy, 1024)
            except BlockingIOError:
                continue
            if not data:
                break
            got += len(data)
    finally:
        os.close(copy)
    took = time.monotonic() - begun
    raw.reset()
    return f"{got / took / 1024:.1f} KiB/s for {took:.0f} s"


@row(memory_kib=8192)  # other rows run beside it, and pictures of all light take memory of their own
async def E70_a_hidden_tab_comes_back(stage):
    raw = await watching(stage)
    await picture(raw)
    raw.send(say(op="subscribe", format="jpeg", paused=True))
    await raw.until("subscribed")
    while raw.said[-1].get("paused") is not True:
        await raw.until("subscribed")
    before = raw.binary
    await raw.until("status")
    await raw.until("status")
    check(raw.binary - before <= 2, f"{raw.binary - before} pictures to a hidden tab")
    begun = time.monotonic()
    raw.send(say(op="subscribe", format="jpeg"))
    await picture(raw)
    took = time.monotonic() - begun
    raw.shut()
    return f"picture {took * 1e3:.0f} ms after it was seen again"


@row(patient=True, memory_kib=65536)
async def E71_a_laptop_that_sleeps(stage):
    """Reads nothing and closes nothing; pings stay unanswered."""
    raw = await stage.client()
    raw.writer.transport.pause_reading()
    took = await end_of(stage, raw)
    raw.shut()
    return f"cut after {took:.0f} s"


@row(memory_kib=32768)  # the encoder's
async def E72_a_viewer_joins_in_mid_chain(stage):
    raw = await stage.client()
    if "h264" not in raw.said[0].get("formats", ["h264"]):
        skip("this relightd makes no H.264")
    raw.send(say(op="subscribe", format="h264"))
    for _ in range(5):
        await picture(raw)
    other = await watching(stage, "h264")
    sequence, flags = await picture(other)
    check(flags & KEY, "its first picture needs another")
    following, flags = await picture(other)
    check(following == sequence + 1 or flags & KEY, f"{following} follows {sequence}")
    raw.shut()
    other.shut()
    return "begins at a key picture"


@row(memory_kib=65536)
async def E73_a_storm_of_connections(stage):
    """1000 in total, as fast as possible."""
    begun = time.monotonic()
    ended = {}

    async def one():
        try:
            raw = await stage.raw()
            status = await raw.upgrade()
            if status == 101:
                raw.send(hello())
                kind, payload = await raw.receive()
                ended[101 if kind == TEXT else "closed"] = ended.get(101 if kind == TEXT else "closed", 0) + 1
            else:
                ended[status] = ended.get(status, 0) + 1
            raw.reset()
        except (OSError, Failed) as fault:
            ended[type(fault).__name__] = ended.get(type(fault).__name__, 0) + 1

    for _ in range(20):
        await asyncio.gather(*(one() for _ in range(50)))
    took = time.monotonic() - begun
    return f"{1000 / took:.0f} a second; answered {ended}"


@row(alone=True)
async def E74_no_descriptors_left(folder):
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, before[1]))  # inherited; restored for ourselves
    try:
        server = Relightd("--rate", "5", source="sky:size=128x64,speed=60")
        await server.start()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    try:
        async with Viewer(server) as viewer:
            await viewer.sees(2)
            idle = server.processor_s()
            await viewer.sees(8)
            idle, crowd = server.processor_s() - idle, []
            for _ in range(100):
                with contextlib.suppress(OSError, Failed):
                    raw = await Raw.open(server.port)
                    raw.send(raw.handshake())
                    crowd.append(raw)
            await viewer.sees(4)
            check(server.alive(), "it died")
            held = server.descriptors()
            processor = server.processor_s()
            await viewer.sees(8)
            busy = server.processor_s() - processor
            check(busy < 2 * idle + 0.4, f"{busy} s of processor time for 8 pictures beside connections that cannot be accepted, {idle} before")
            check(not viewer.parted, f"the honest viewer was closed with {viewer.parted}")
            for raw in crowd:
                with contextlib.suppress(OSError):  # most had to make room
                    raw.reset()
            begun = time.monotonic()
            async with Deadline():
                while True:
                    with contextlib.suppress(OSError, Failed):
                        raw = await Raw.open(server.port)
                        if await raw.upgrade() == 101:
                            break
                        raw.shut()
                    await asyncio.sleep(0.1)
            raw.shut()
            return f"{held} descriptors; {busy:.2f} s of a processor for 8 pictures meanwhile, {idle:.2f} s before; back {time.monotonic() - begun:.1f} s later"
    finally:
        check(await server.stop() == 0, "exit code")


@row(alone=True)
async def E75_all_connections_taken(folder):
    async with Relightd("--max-connections", "64", source="sky:size=128x64,speed=60") as server, Viewer(server) as viewer:
        await viewer.sees(2)
        crowd, staying, full = [], [], None
        for i in range(80):
            raw = await Raw.open(server.port)
            if await raw.upgrade() != 101:
                full = "turned away"
                break
            raw.send(hello())
            kind, payload = await raw.receive()
            if kind != TEXT or raw.said[-1]["op"] == "error":
                full = await raw.closed()
                check(full == 4007, f"closed with {full}")
                break
            crowd.append(raw)
            staying.append(asyncio.ensure_future(raw.stays()))
        check(full, "no limit is there")
        await viewer.sees(2)
        check(not viewer.parted, "the honest viewer was closed")
        held = len(crowd)
        for raw in crowd:
            raw.reset()
        await asyncio.gather(*staying)
        async with Deadline():
            while True:
                raw = await Raw.open(server.port)
                if await raw.upgrade() == 101:
                    raw.send(hello())
                    kind, _ = await raw.receive()
                    if kind == TEXT and raw.said[-1]["op"] == "welcome":
                        break
                raw.shut()
                await asyncio.sleep(0.05)
        raw.shut()
        return f"connection {held + 2} was told {full}; room again when they had gone"


@row(alone=True)
async def E76_all_viewers_leave_and_come_back(folder):
    async with Relightd("--rate", "30", "--size", "320x180", source="sky:size=128x64,speed=60") as server:
        async with Viewer(server) as viewer:
            await viewer.sees(20)
            begun = server.processor_s()
            await asyncio.sleep(2)
            watched = (server.processor_s() - begun) / 2
        await asyncio.sleep(0.5)
        begun = server.processor_s()
        await asyncio.sleep(2)
        alone = (server.processor_s() - begun) / 2
        async with Viewer(server) as viewer:
            begun = time.monotonic()
            await viewer.sees(1)
            back = time.monotonic() - begun
            await viewer.sees(5)
        return f"{watched * 100:.0f} % of a processor watched, {alone * 100:.0f} % alone; a picture after {back * 1e3:.0f} ms"


@row(memory_kib=16384)
async def E77_the_producer_vanishes_and_returns(stage):
    async with Deadline():
        for _ in range(5):
            await stage.producer.back()
            stage.producer.link.transport.abort()
            while stage.producer.welcomed:
                await asyncio.sleep(0.01)
    await stage.producer.back()
    last = stage.viewer.frames[-1]
    begun = time.monotonic()
    async with Deadline():
        while not stage.viewer.frames or stage.viewer.frames[-1] <= last:
            await asyncio.sleep(0.01)
    took = time.monotonic() - begun
    return f"the next picture {took * 1e3:.0f} ms after it was welcomed"


@row(alone=True)
async def E78_all_come_back_after_a_restart(folder):
    server = Relightd(source="sky:size=128x64,speed=60")
    await server.start()
    port = server.port
    try:
        async with contextlib.AsyncExitStack() as stack:
            viewers = [await stack.enter_async_context(Viewer(server)) for _ in range(20)]
            await asyncio.gather(*(v.sees(2) for v in viewers))
            await server.stop(signal.SIGKILL)
            server.arguments[server.arguments.index("--port") + 1] = str(port)
            begun = time.monotonic()
            await server.start()
            started = time.monotonic() - begun
            await asyncio.gather(*(v.sees(1) for v in viewers))
            took = time.monotonic() - begun
    finally:
        await server.stop()
    return f"20 viewers: listening after {started:.1f} s, all have pictures after {took:.1f} s"


@row(memory_kib=16384)
async def E79_a_relay_between(stage):
    """Bytes in pieces of seven and in bursts, as a relay may forward them; then it breaks midway."""
    async def pass_on(reader, writer, piece):
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(4096):
                for i in range(0, len(data), piece):
                    writer.write(data[i:i + piece])
                    await writer.drain()
        writer.close()

    async def serve(reader, writer):
        there, back = await asyncio.open_connection("127.0.0.1", stage.server.port)
        await asyncio.gather(pass_on(reader, back, 7), pass_on(there, writer, 4096))

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as relay:
        port = relay.sockets[0].getsockname()[1]

        class Through:
            url = f"ws://127.0.0.1:{port}/ws"

        async with Viewer(Through) as viewer:
            await viewer.sees(10)
            viewer.link.transport.abort()
            await viewer.sees(10)
    return "pictures come, also after it broke"


@row(alone=True)
async def E80_ipv6(folder):
    if not os.path.exists("/proc/net/if_inet6"):
        skip("this machine has no IPv6")
    async with Relightd("--bind", "::1", source="sky:size=128x64,speed=60") as server:
        server.url = f"ws://[::1]:{server.port}/ws"
        async with Viewer(server) as viewer:
            await viewer.sees(3)
        raw = await Raw.open(server.port, host="::1")
        check(await raw.upgrade(Host=f"[::1]:{server.port}") == 101, "no handshake")
        raw.shut()
        raw = await Raw.open(server.port, host="::1")
        check(await raw.upgrade(Host="evil.example") == 403, "a foreign Host")
        raw.shut()
    return "[::1] is served alike"


if __name__ == "__main__":
    main("--size", "320x180")
