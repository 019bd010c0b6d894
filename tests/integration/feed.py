#!/usr/bin/python3
"""relight-feed against a scripted server: what it sends, when, and how it handles each answer."""

import asyncio
import random
import signal
import struct
import subprocess
from pathlib import Path

from live import box, ffmpeg, spherical
from peer import WAIT_S, Failed, Frame, Program, Server, check, expect, main, radiance, run, sky_files, until


async def feed(server, *arguments):
    return await run("relight-feed", "--to", server.url, "--json", *arguments)


async def obliging(link, frames=None, credit=2, after=None):
    """A server that uses every frame and collects the frames in the list."""
    await link.welcome_producer(after=after, credit=credit)
    while True:
        message = await link.read()
        if isinstance(message, dict):
            check(message["op"] == "end", f"not end: {message}")
            break
        frame = Frame(message)
        if frames is not None:
            frames.append(frame)
        await link.fate(frame.number)
        await link.credit()
    check(await link.parted() == 1000, "no clean close")


# ---- Files ----

async def written_frames_light_as_the_source_does(folder):
    sky = "sky:time=10:00,speed=60,size=64x32"
    expect(await run("relight-feed", "--frames", "2-3", "--out", folder / "sky.%04d.exr", sky), 0, "2 frames written")
    for number, source in enumerate([sky, folder / "sky.%04d.exr"]):
        expect(await run("relight-render", "--source", source, "--frames", "3", "--size", "32x18", "--samples", "1",
                         "--out", folder / f"{number}.exr"), 0)
    check((folder / "0.exr").read_bytes() == (folder / "1.exr").read_bytes(), "the pictures differ")


async def what_cannot_be_written_is_refused(folder):
    out = folder / "x.exr"
    expect(await run("relight-feed", "--out", out, "sky:"), 2, "never ends: select frames, such as --frames 0-9")
    expect(await run("relight-feed", "--out", folder / "x.png", "--frames", "0", "sky:"), 2, "a file name that ends in .exr")
    expect(await run("relight-feed", "--out", out, "--frames", "0-2", "sky:"), 2, "add %04d")
    expect(await run("relight-feed", "--out", out, "--lockstep", "--frames", "0", "sky:"), 2, "give one of them")
    expect(await run("relight-feed", "--out", folder / "none" / "x.exr", "--frames", "0", "sky:size=64x32"), 1,
           "none/x.exr")
    (folder / "bad.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\nshort")
    expect(await run("relight-feed", "--out", out, folder / "bad.hdr"), 1, "could not be read: 1")
    check(not out.exists(), "a file was left")


# ---- Frames ----

async def files_arrive_as_they_are(folder):
    frames = []
    pattern = sky_files(folder, 5, pad=200000)

    async def script(link):
        await obliging(link, frames)

    async with Server(script) as server:
        program = await feed(server, pattern)
        expect(program, 0)
    check([f.number for f in frames] == [0, 1, 2, 3, 4], "not the frames 0 to 4 in order")
    for f in frames:
        path = folder / f"sky.{f.number:04d}.hdr"
        check(f.payload == path.read_bytes(), "not the file's bytes")
        check(f.encoding == 2 and f.layout == 0 and f.flags == 0, "not a Radiance file of unstated layout")
        check((f.width, f.height, f.channels) == (0, 0, 0), "a file states its own size")
        check(f.capture_us == 0, "the age of a file says nothing of its light")
    summary = program.summary()
    check(summary["sent"] == summary["used"] == 5 and summary["connections"] == 1, f"{summary}")
    check(summary["refused"] == summary["lost"] == summary["superseded"] == 0, f"{summary}")
    check(summary["end"] == "done" and summary["last_frame"] == 4, f"{summary}")
    check(abs(summary["clock"]["server_ahead_us"]) <= summary["clock"]["uncertain_us"] + 1000, f"{summary}")


async def layout_and_range_are_stated(folder):
    frames = []
    pattern = sky_files(folder, 5)

    async def script(link):
        await obliging(link, frames)

    async with Server(script) as server:
        expect(await feed(server, "--layout", "latlong-bottom", "--frames", "2-3", pattern), 0)
        expect(await feed(server, "--layout", "fisheye", "--frames", "4", pattern), 0)
    check([(f.number, f.layout, f.flags) for f in frames] == [(2, 1, 1), (3, 1, 1), (4, 6, 0)], "not as asked for")


async def videos_state_the_layout_asked_for_or_their_own(folder):
    still = ("-f", "lavfi", "-i", "testsrc2=s=192x128:r=25:d=0.04", "-c:v", "libx264", "-qp", "0", "-pix_fmt", "yuv420p")
    subprocess.run(ffmpeg(*still, folder / "plain.mp4"), check=True)
    spherical(folder / "plain.mp4", folder / "cube.mp4", box(b"cbmp", bytes(12)))
    subprocess.run(ffmpeg(*still[:3], "testsrc2=s=192x32:r=25:d=0.04", *still[4:], folder / "row.mp4"), check=True)
    seen = []

    async def script(link):
        frames = []
        await obliging(link, frames)
        seen.extend(f.layout for f in frames)

    asked = (("plain.mp4",), ("plain.mp4", "--layout", "cube-3x2"), ("cube.mp4",), ("cube.mp4", "--layout", "ball"),
             ("row.mp4", "--layout", "cube-6x1"), ("plain.mp4", "--layout", "fisheye"))
    async with Server(script) as server:
        for name, *options in asked:
            expect(await feed(server, "--frames", "0", *options, folder / name), 0)
    check(seen == [0, 7, 7, 5, 8, 6], f"not as asked for: {seen}")


async def computed_skies_travel_as_texels(folder):
    frames = []

    async def script(link):
        await obliging(link, frames)

    async with Server(script) as server:
        expect(await feed(server, "--frames", "7-8", "sky:size=64x32"), 0)
        expect(await feed(server, "--frames", "7-8", "--raw", "half", "sky:size=64x32"), 0)
    check([f.number for f in frames] == [7, 8, 7, 8], "not the frames asked for")
    check([f.encoding for f in frames] == [4, 4, 3, 3], "not float, then half")
    for f in frames:
        check((f.width, f.height, f.channels, f.layout) == (64, 32, 3, 1), "not 64x32 of RGB, lat-long")
    full = struct.unpack("<%df" % (64 * 32 * 3), frames[0].payload)
    half = struct.unpack("<%de" % (64 * 32 * 3), frames[2].payload)
    check(any(v > 0 for v in full), "a dark sky")
    for a, b in zip(full, half):
        check(abs(min(a, 65504) - b) <= max(abs(b) * 2 ** -11, 2 ** -25), f"{a} became {b}")


async def files_become_texels_when_asked(folder):
    frames = []
    (folder / "a.hdr").write_bytes(radiance(128, size=(4, 2)))

    async def script(link):
        await obliging(link, frames)

    async with Server(script) as server:
        expect(await feed(server, "--raw", "float", folder / "a.hdr"), 0)
    check(struct.unpack("<24f", frames[0].payload) == (1.0,) * 24, "not texels of radiance 1")


async def files_barred_from_the_network_are_decoded_here(folder):
    """Single-part scanline files with no, RLE, ZIPS or ZIP compression are sent as they are; others as texels, with
    one message. Damaged files are sent too, so that the server counts them."""
    frames = []
    corpus = Path(__file__).parent.parent / "fuzz" / "corpus" / "exr"

    async def script(link):
        await obliging(link, frames)

    names = [f"lines{i}" for i in range(4)] + ["piz", "tiles3", "mip", "parts", "bad_scanline_n_error_reading_from_stream"]
    for i, name in enumerate(names):
        (folder / f"sky.{i}.exr").write_bytes((corpus / name).read_bytes())
    async with Server(script) as server:
        program = await feed(server, folder / "sky.%d.exr")
        expect(program, 0, "decoded here")
    check(program.err.count("decoded here") == 1, program.err)
    check([f.encoding for f in frames] == [1, 1, 1, 1, 4, 4, 4, 4, 1], f"{[f.encoding for f in frames]}")
    check([(f.width, f.height) for f in frames[4:6]] == [(10, 10), (10, 10)], "not the sizes of their display windows")
    for i in (0, 1, 2, 3, 8):
        check(frames[i].payload == (corpus / names[i]).read_bytes(), f"{names[i]} did not go out as it is")


# ---- Credit and pace ----

async def credit_is_never_exceeded(folder):
    pattern = sky_files(folder, 4)

    async def script(link):
        await link.welcome_producer(credit=0)
        await link.nothing()
        await link.credit(2)
        check((await link.frame()).number == 0, "not frame 0")
        check((await link.frame()).number == 1, "not frame 1")
        await link.fate(0)
        await link.fate(1, "superseded", sequence=1)
        await link.nothing()
        await link.credit(1)
        check((await link.frame()).number == 2, "not frame 2")
        await link.nothing()
        await link.credit(1)
        check((await link.frame()).number == 3, "not frame 3")
        await link.nothing()  # no end before all fates are known
        await link.fate(2, "superseded")
        await link.fate(3)
        check((await link.read())["op"] == "end", "no end")
        check(await link.parted() == 1000, "no clean close")

    async with Server(script) as server:
        program = await feed(server, pattern)
        expect(program, 0)
    check(program.summary()["superseded"] == 2 and program.summary()["used"] == 2, program.out)


async def a_frame_goes_up_over_a_slow_line(folder):
    """Behind what the line holds an answer to a ping takes longer than a server may be silent (25 s)."""
    pattern = sky_files(folder, 2, pad=6 << 20)

    async with Server(obliging) as server:
        async def line(reader, writer):
            near, far = await asyncio.open_connection("127.0.0.1", server.port)

            async def down():
                while data := await near.read(65536):
                    writer.write(data)
                writer.close()

            answers, slow = asyncio.create_task(down()), 140
            while data := await reader.read(16384):
                far.write(data)
                await far.drain()
                slow -= 1
                if 0 < slow < 130:
                    await asyncio.sleep(0.25)
            far.close()
            await answers

        async with await asyncio.start_server(line, "127.0.0.1", 0, limit=16384) as relay:
            port = relay.sockets[0].getsockname()[1]
            expect(await run("relight-feed", "--to", f"ws://127.0.0.1:{port}", "--retry", "0", pattern), 0, "2 frames used")
    check(server.connections == 1, "the connection was given up")


async def a_rate_spaces_the_frames(folder):
    times = []
    pattern = sky_files(folder, 11)

    async def script(link):
        times.append(asyncio.get_event_loop().time())
        await link.welcome_producer()
        for i in range(11):
            await link.frame()
            times.append(asyncio.get_event_loop().time())
            await link.fate(i)
            await link.credit()
        await link.parted()

    async with Server(script) as server:
        expect(await feed(server, "--rate", "20", pattern), 0)
    # frames may be late on a busy machine, but eleven can never come in less than ten intervals after the welcome
    check(times[-1] - times[0] > 0.45, f"eleven frames at 20/s took {times[-1] - times[0]:.3f} s")


# ---- Refusals ----

async def a_refused_frame_is_named(folder):
    pattern = sky_files(folder, 3)
    (folder / "sky.0003.hdr").write_bytes(b"no picture")

    async def script(link):
        await link.welcome_producer()
        for i in range(3):
            await link.frame()
            if i == 1:
                await link.fate(1, "refused", code="bad_frame", message="odd \x1b[31mtexels")
            else:
                await link.fate(i)
            await link.credit()
        await link.parted()

    async with Server(script) as server:
        program = await feed(server, pattern)
        expect(program, 1, "sky.0001.hdr: frame 1 refused as bad_frame: odd ?[31mtexels")
        check("sky.0003.hdr: neither an OpenEXR nor a Radiance file" in program.err, program.err)
    check(program.summary()["refused"] == 2 and program.summary()["used"] == 2, program.out)


async def too_large_a_frame_is_not_tried(folder):
    pattern = sky_files(folder, 2)
    (folder / "sky.0001.hdr").write_bytes(radiance(1, pad=5000))

    async def script(link):
        await link.welcome_producer(frame_bytes=1000)
        check((await link.frame()).number == 0, "not frame 0")
        await link.fate(0)
        await link.credit()
        check((await link.read())["op"] == "end", "no end")
        await link.parted()

    async with Server(script) as server:
        expect(await feed(server, pattern), 1, "the server's limit is 1000")


async def fatal_close_codes_end_it_at_once(folder):
    pattern = sky_files(folder, 2)
    for close, code in ((4004, 3), (4005, 3), (4006, 3), (4011, 3), (1009, 1), (4001, 1), (4002, 1), (4003, 1),
                        (4014, 1), (1007, 1)):

        async def script(link):
            await link.read()
            await link.say(op="error", code="some_code", clause="4.1.3", message=f"because {close}", fatal=True)
            await link.socket.close(close, "because")

        async with Server(script) as server:
            program = await feed(server, pattern)
            expect(program, code, f"some_code: because {close}")
            check(server.connections == 1, f"came back after {close}")


async def a_server_without_producers_is_told(folder):
    async def script(link):
        await link.welcome("producer")
        check(await link.parted() == 1000, "no clean close")

    async with Server(script) as server:
        expect(await feed(server, sky_files(folder, 1)), 3, "does not accept frames")


async def another_version_is_refused(folder):
    async def script(link):
        await link.read()
        await link.say(op="welcome", version={"major": 2, "minor": 0})
        await link.parted()

    async with Server(script) as server:
        expect(await feed(server, sky_files(folder, 1)), 3, "another version")


async def the_token_is_said(folder):
    async def script(link):
        hello = await link.welcome_producer()
        check(hello["token"] == "open sesame", f"{hello}")
        check(hello["pace"] == "live" and "sequence" not in hello, f"{hello}")
        await link.frame()
        await link.fate(0)
        await link.parted()

    async with Server(script) as server:
        expect(await feed(server, "--token", "open sesame", sky_files(folder, 1)), 0)


async def nonsense_from_a_server_ends_it(folder):
    pattern = sky_files(folder, 1)
    for nonsense in ("no json", "[1]", '{"op":5}', '{"op":"a","op":"b"}', "x" * 300000,
                     '{"op":"x","a":' + "[" * 5000):

        async def script(link):
            await link.read()
            await link.socket.send(nonsense)
            await link.parted()

        async with Server(script) as server:
            expect(await feed(server, pattern), 1, "127.0.0.1")

    async def script(link):
        await link.welcome_producer(credit=0)
        await link.say(op="credit", frames=-1)
        await link.say(op="credit", frames=1e99)
        await link.say(op="frame", number="zero", fate="used")
        await link.say(op="frame", number=12345, fate="used")
        await link.say(op="frame")
        await link.say(op="something_new", of=["a", {"later": "version"}])
        await link.nothing()
        await link.credit(1)
        await link.frame()
        await link.fate(0)
        await link.parted()

    async with Server(script) as server:
        expect(await feed(server, pattern), 0)


# ---- Losing the server ----

async def nobody_there_is_tried_again_as_asked(folder):
    pattern = sky_files(folder, 1)
    async with Server(obliging) as server:
        url = server.url
    program = await run("relight-feed", "--to", url, "--retry", "2", pattern)
    expect(program, 1, "cannot be reached")
    check(program.err.count("cannot be reached") == 2, f"said once and at the end: {program.err}")
    expect(await run("relight-feed", "--to", url, "--give-up-after", "0.5", "--quiet", pattern), 1, "reached")


async def what_is_no_relight_server_is_told(folder):
    async def page(reader, writer):
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(page, "127.0.0.1", 0)
    url = "ws://127.0.0.1:%d" % server.sockets[0].getsockname()[1]
    expect(await run("relight-feed", "--to", url, sky_files(folder, 1)), 3, "HTTP status 404")
    server.close()


async def live_goes_on_with_the_next_frame(folder):
    """The connection breaks during a large frame: a partly sent frame is sent again, one whose fate was lost is
    counted as lost, and no other is missing or duplicated."""
    pattern = sky_files(folder, 6, pad=3000000)
    got = []

    async def first(link):
        await link.welcome_producer(credit=2)
        got.append((await link.frame()).number)
        await link.fate(0)
        await link.credit()
        got.append((await link.frame()).number)
        link.cut()

    async def second(link):
        await link.welcome_producer(credit=2)
        while True:
            message = await link.read()
            if isinstance(message, dict):
                break
            got.append(struct.unpack_from("<Q", message, 24)[0])
            await link.fate(got[-1])
            await link.credit()
        await link.parted()

    async with Server(first, second) as server:
        program = await feed(server, pattern)
    summary = program.summary()
    check(got == sorted(got) and {0, 1, 4, 5} <= set(got) and len(set(got)) == len(got), f"{got}")
    check(6 - len(got) <= summary["lost"] <= 2, f"{got}, {program.out}")
    check(summary["connections"] == 2 and summary["used"] + summary["lost"] == 6, program.out)
    expect(program, 1 if summary["lost"] else 0, "trying again")


# ---- Lockstep ----

class Lockstep:
    """The server's state of one lockstep sequence, across connections and feeders."""

    def __init__(self, last, misfortune=lambda number, step: False):
        self.accepted = []
        self.last = last
        self.misfortune = misfortune  # whether to disconnect at this frame, at step 0..4
        self.ended = 0

    def after(self):
        return self.accepted[-1] if self.accepted else None

    async def script(self, link):
        hello = await link.welcome_producer(after=self.after(), credit=1)
        check(hello["pace"] == "lockstep" and hello["sequence"] == "day-1", f"{hello}")
        while True:
            message = await link.read()
            if isinstance(message, dict):
                check(message["op"] == "end", f"not end: {message}")
                check(self.after() == self.last, f"end after {self.after()}")
                self.ended += 1
                break
            number = struct.unpack_from("<Q", message, 24)[0]
            if self.misfortune(number, 0):  # not accepted
                return link.cut()
            if self.after() is None or number > self.after():
                self.accepted.append(number)
            else:
                raise Failed(f"frame {number} after {self.after()} was named by welcome")
            if self.misfortune(number, 1):  # accepted, no fate
                return link.cut()
            await link.fate(number)
            if self.misfortune(number, 2):  # fate, not stored
                return link.cut()
            await asyncio.sleep(0.002)
            await link.credit()
            if self.misfortune(number, 3):
                return link.cut()
        if self.misfortune(self.last, 4):
            return link.cut()
        await link.parted()


async def lockstep_loses_and_doubles_nothing(folder):
    """The connection breaks at each step in turn: before a frame is accepted, and at each later step."""
    pattern = sky_files(folder, 6, pad=300000)
    pending = {(number, 0) for number in range(6)} | {(number, 1 + number % 3) for number in range(6)} | {(5, 4)}

    def misfortune(number, step):
        if (number, step) in pending:
            pending.remove((number, step))
            return True
        return False

    state = Lockstep(5, misfortune)
    async with Server(state.script) as server:
        program = await feed(server, "--lockstep", "--sequence", "day-1", pattern)
        expect(program, 0)
    check(not pending, f"not all misfortunes came: {pending}")
    check(state.accepted == [0, 1, 2, 3, 4, 5] and state.ended >= 2, f"{state.accepted}")
    summary = program.summary()
    check(summary["used"] == 6 and summary["lost"] == 0, program.out)


async def a_killed_feeder_goes_on_where_it_was(folder):
    pattern = sky_files(folder, 40, pad=100000)
    state = Lockstep(39)
    dice = random.Random(3)
    async with Server(state.script) as server:
        arguments = ("--to", server.url, "--lockstep", "--sequence", "day-1", "--json", pattern)
        for life in range(10):  # killed as it starts, and as it sends
            program = await Program("relight-feed", *arguments).start()
            before = len(state.accepted)
            if life % 2:
                await until(lambda: len(state.accepted) > before)
            await asyncio.sleep(dice.uniform(0, 0.01))
            await program.kill()
        program = await run("relight-feed", *arguments)
        expect(program, 0)
        check(state.accepted == list(range(40)), f"{state.accepted}")
        check(program.summary()["resumed_after"] is not None, "the killed ones did nothing: " + program.out)
        program = await run("relight-feed", *arguments)
        expect(program, 0, "use another --sequence")
    check(state.accepted == list(range(40)), f"{state.accepted}")


async def a_fate_that_comes_late_is_heard(folder):
    """The frame was accepted, the connection broke, and then it was refused: the current producer gets the fate."""
    pattern = sky_files(folder, 3)

    async def first(link):
        await link.welcome_producer(credit=1)
        await link.frame()
        link.cut()

    async def second(link):
        await link.welcome_producer(after=0, credit=0)
        await link.fate(0, "refused", code="bad_frame", message="of no use")
        for number in (1, 2):
            await link.credit()
            check((await link.frame()).number == number, f"not frame {number}")
            await link.fate(number)
        await link.credit()
        await link.parted()

    for scripts in ((first, second), (second,)):  # the same feeder, and a restarted one
        async with Server(*scripts) as server:
            program = await feed(server, "--lockstep", pattern)
            expect(program, 1, "frame 0 refused as bad_frame: of no use")
        check(program.summary()["used"] == 2 and program.summary()["refused"] == 1, program.out)


async def a_server_that_forgot_gets_all_again(folder):
    pattern = sky_files(folder, 5)
    got = []

    async def first(link):
        await link.welcome_producer(credit=1)
        for _ in range(3):
            got.append((await link.frame()).number)
            await link.fate(got[-1])
            await link.credit()
        link.cut()

    async def second(link):
        await link.welcome_producer(credit=1)
        while len(got) < 8:
            got.append((await link.frame()).number)
            await link.fate(got[-1])
            await link.credit()
        check((await link.read())["op"] == "end", "no end")
        await link.parted()

    async with Server(first, second) as server:
        expect(await feed(server, "--lockstep", pattern), 0, "has lost frames")
    check(got == [0, 1, 2, 0, 1, 2, 3, 4], f"{got}")


async def lost_pictures_of_a_watched_folder_are_an_error(folder):
    """They cannot be sent again, and the exit code says so."""
    sky_files(folder, 1)
    again = asyncio.Event()

    async def first(link):
        await link.welcome_producer(credit=1)
        await link.fate((await link.frame()).number)
        await link.credit()
        link.cut()

    async def second(link):
        await link.welcome_producer(credit=1)
        again.set()
        await link.parted()

    async with Server(first, second) as server:
        program = await Program("relight-feed", "--to", server.url, "--lockstep", f"watch:{folder}").start()
        await asyncio.wait_for(again.wait(), WAIT_S)
        said = b""
        while b"images may be missing" not in said:
            said += await asyncio.wait_for(program.process.stderr.readline(), WAIT_S)
        await program.kill(signal.SIGINT)
        expect(program, 1)


async def end_waits_for_the_last_picture_to_be_stored(folder):
    async def script(link):
        await link.welcome_producer(credit=1)
        await link.frame()
        await link.fate(0)
        await link.nothing(1.0)
        await link.credit()
        check((await link.read())["op"] == "end", "no end")
        await link.parted()

    async with Server(script) as server:
        expect(await feed(server, "--lockstep", sky_files(folder, 1)), 0)


# ---- Being asked to stop ----

async def an_interrupt_is_a_clean_end(folder):
    heard = []

    async def script(link):
        await link.welcome_producer()
        heard.append((await link.frame()).number)
        link.server.first.set()
        await asyncio.sleep(0.2)
        await link.fate(heard[0])
        heard.append((await link.read())["op"])
        heard.append(await link.parted())

    for number in (signal.SIGINT, signal.SIGTERM):
        (folder / "a.hdr").write_bytes(radiance())
        heard.clear()
        async with Server(script) as server:
            server.first = asyncio.Event()
            program = await Program("relight-feed", "--to", server.url, "--json", f"watch:{folder}").start()
            await asyncio.wait_for(server.first.wait(), WAIT_S)
            await program.kill(number)
            expect(program, 0)
            check(program.summary()["end"] == "interrupted", program.out)
        check(heard == [0, "end", 1000], f"{heard}")


async def an_interrupted_lockstep_is_not_complete(folder):
    heard = []

    async def script(link):
        await link.welcome_producer(credit=1)
        await link.frame()
        link.server.first.set()
        await asyncio.sleep(0.2)
        await link.fate(0)
        heard.append(await link.parted())

    async with Server(script) as server:
        server.first = asyncio.Event()
        program = await Program("relight-feed", "--to", server.url, "--lockstep", sky_files(folder, 3)).start()
        await asyncio.wait_for(server.first.wait(), WAIT_S)
        await program.kill(signal.SIGINT)
        expect(program, 1)
    check(heard == [1000], f"{heard}")


async def a_watched_folder_is_played_as_it_fills(folder):
    got = []

    async def script(link):
        await link.welcome_producer()
        while len(got) < 3:
            got.append((await link.frame()).payload)
            await link.fate(len(got) - 1)
            await link.credit()
            link.server.came.release()
        await link.parted()

    async with Server(script) as server:
        server.came = asyncio.Semaphore(0)
        program = await Program("relight-feed", "--to", server.url, f"watch:{folder}").start()
        for i in range(3):
            await asyncio.sleep(0.1)
            (folder / ".new").write_bytes(radiance(i + 1))
            (folder / ".new").rename(folder / f"{i}.hdr")
            await asyncio.wait_for(server.came.acquire(), WAIT_S)
        await program.kill(signal.SIGINT)
        expect(program, 0)
    check(got == [radiance(1), radiance(2), radiance(3)], "not the files in the order they came")


async def wrong_usage_ends_with_2(folder):
    pattern = sky_files(folder, 1)
    for arguments, text in (
            ((), "SOURCE is missing"), (("--to", "host", pattern), "ws://HOST:PORT"),
            (("--to", "wss:host", pattern), "wss://HOST:PORT"), (("--ca", "some.pem", pattern), "--ca is for TLS"),
            (("--lockstep", "--loop", pattern), "exclude"),
            (("--lockstep", "--rate", "5", pattern), "exclude"), (("--sequence", "a/b", pattern), "--sequence 'a/b'"),
            (("--layout", "flat", pattern), "--layout 'flat'"), (("--raw", "double", pattern), "--raw 'double'"),
            (("--rate", "-1", pattern), "--rate"), (("--frames", "5-3", pattern), "--frames"),
            (("push:",), "push:"), ((pattern, pattern), "unexpected argument")):
        expect(await run("relight-feed", *arguments), 2, text)
    expect(await run("relight-feed", folder / "nowhere.hdr"), 1, "nowhere.hdr")
    program = await run("relight-feed", "--help")
    check(program.code == 0 and "Exit code" in program.out, program.out)


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
