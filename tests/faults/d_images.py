#!/usr/bin/python3
"""Faults of frames (group D): damaged or hostile content from an accepted producer. Each frame has one fate, the
connection stays, and the next good frame is used."""

import asyncio
import os
import random
import struct
import time
import zlib
from pathlib import Path

from faults import HERE, KEPT, WAIT_S, check, main, row

NONE, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB = range(10)
UINT, HALF, FLOAT = range(3)


def attribute(name, kind, value):
    return name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value


def channel(name, pixel=FLOAT, x=1, y=1):
    return name + b"\0" + struct.pack("<IBBBBii", pixel, 0, 0, 0, 0, x, y)


def header(channels, window, compression=NONE, version=2, display=None, more=b""):
    box = struct.pack("<4i", *window)
    return (struct.pack("<II", 20000630, version) + attribute(b"channels", b"chlist", b"".join(channels) + b"\0")
            + attribute(b"compression", b"compression", bytes([compression])) + attribute(b"dataWindow", b"box2i", box)
            + attribute(b"displayWindow", b"box2i", struct.pack("<4i", *(display or window)))
            + attribute(b"lineOrder", b"lineOrder", b"\0")
            + attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
            + attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0))
            + attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + more + b"\0")


def deflated(raw):
    """A block as in ZIP and ZIPS: bytes reordered, differences, deflate."""
    half = (len(raw) + 1) // 2
    apart = bytearray(len(raw))
    apart[:half], apart[half:] = raw[0::2], raw[1::2]
    changed = bytes([apart[0]]) + bytes((apart[i] - apart[i - 1] + 384) & 255 for i in range(1, len(apart)))
    packed = zlib.compress(changed, 9)
    return packed if len(packed) < len(raw) else raw


def exr(width=8, height=4, *, names=(b"B", b"G", b"R"), value=0.5, at=(0, 0), compression=NONE, display=None, **how):
    """A complete scanline file of floats."""
    window = (*at, at[0] + width - 1, at[1] + height - 1)
    head = header([channel(n) for n in names], window, compression, display=display, **how)
    lines = 16 if compression == ZIP else 1
    chunks = []
    for y in range(0, height, lines):
        n = min(lines, height - y)
        raw = struct.pack("<f", value) * (width * len(names) * n)
        if compression in (ZIP, ZIPS):
            raw = deflated(raw)
        chunks.append(struct.pack("<ii", y + at[1], len(raw)) + raw)
    offset = len(head) + 8 * len(chunks)
    table = b""
    for c in chunks:
        table += struct.pack("<Q", offset)
        offset += len(c)
    return head + table + b"".join(chunks)


async def fate(stage, payload, wanted, encoding=1, **how):
    """The fate of the frame; then sends a good one."""
    got = await stage.producer.fate(payload, encoding=encoding, **how)
    check(got["fate"] in wanted, f"{got} instead of {wanted}")
    if got["fate"] == "refused":
        check(got["code"] == "bad_frame" and got["message"], f"no reason: {got}")
    return got


async def fates(stage, payloads, wanted=("refused",), encoding=1, **how):
    """Counts of fates for many frames, all over one connection."""
    parted, count = len(stage.producer.parted), {}
    for payload in payloads:
        got = await fate(stage, payload, wanted, encoding, **how)
        count[got["fate"]] = count.get(got["fate"], 0) + 1
    check(len(stage.producer.parted) == parted, f"the producer was closed with {stage.producer.parted[parted:]}")
    await fate(stage, exr(), ("used",))
    return ", ".join(f"{n} {what}" for what, n in sorted(count.items()))


@row(counts="refused", memory_kib=65536)  # some are sound enough to be decoded, up to a few MB
async def D52_damaged_exr_files(stage):
    files = sorted((HERE.parent / "fuzz/corpus/exr").iterdir())
    data = os.environ.get("RELIGHT_TEST_DATA")
    if data:
        files += sorted(Path(data, "bad_exr/damaged").iterdir())
    said = await fates(stage, [f.read_bytes() for f in files if f.stat().st_size], ("refused", "used"))
    return f"{len(files)} files: {said}"


@row(counts="refused", memory_kib=16384)
async def D53_a_file_cut_at_any_byte(stage):
    whole = exr(4, 2)
    return f"{len(whole) - 1} lengths: {await fates(stage, [whole[:n] for n in range(1, len(whole))])}"


@row()
async def D54_turned_bits(stage):
    draw = random.Random(54)
    damaged = []
    for whole in (exr(8, 4), exr(8, 4, compression=ZIP)):
        for at in range(draw.randrange(4), len(whole), 4):
            bad = bytearray(whole)
            bad[at] ^= 1 << draw.randrange(8)
            damaged.append(bytes(bad))
    return f"{len(damaged)} files: {await fates(stage, damaged, ('refused', 'used'))}"


@row(counts="refused")
async def D55_sizes_that_no_file_holds(stage):
    rgb = [channel(n) for n in (b"B", b"G", b"R")]
    most = (1 << 31) - 1
    heads = [header(rgb, w) + b"\0" * 64 for w in ((0, 0, most, most), (0, 0, most - 1, 0), (-most - 1, -most - 1, most, most),
                                                   (0, 0, -1, -1), (5, 5, 0, 0), (0, 0, 65535, 32767), (0, 0, 20000, 9999))]
    return await fates(stage, heads)


@row(counts="refused")
async def D56_offsets_that_lie(stage):
    whole = exr(8, 4)
    table = len(whole) - 4 * (8 + 96) - 4 * 8
    bad = []
    for offset in (0, 1, table, len(whole), len(whole) - 1, 1 << 31, (1 << 63) - 1, 1 << 63, (1 << 64) - 1):
        bad.append(whole[:table + 8] + struct.pack("<Q", offset) + whole[table + 16:])
    bad.append(whole[:table] + whole[table + 8:table + 16] * 4 + whole[table + 32:])  # all lines identical
    return await fates(stage, bad, ("refused", "used"))


@row(counts="refused")
async def D57_odd_lists_of_channels(stage):
    window = (0, 0, 7, 3)
    lists = [[channel(b"c%04d" % i) for i in range(1023)], [channel(b"x" * 255) for _ in range(3)],
             [channel(b"R"), channel(b"R"), channel(b"G")], [channel(b"Z")], [], [channel(b"B"), channel(b"R")],
             [channel(n) for n in (b"R\xff", b"G\xff", b"B\xff")], [channel(b"x" * 5000)]]
    return await fates(stage, [header(c, window) + b"\0" * 4096 for c in lists])


@row()
async def D58_odd_kinds_of_channels(stage):
    window = (0, 0, 7, 3)
    lists = [[channel(n, UINT) for n in (b"B", b"G", b"R")], [channel(n, FLOAT, 2, 2) for n in (b"B", b"G", b"R")],
             [channel(b"B", 7), channel(b"G"), channel(b"R")], [channel(b"B", FLOAT, 0, 0), channel(b"G"), channel(b"R")],
             [channel(b"B", FLOAT, -1, 1), channel(b"G"), channel(b"R")]]
    return await fates(stage, [header(c, window) + b"\0" * 4096 for c in lists], ("refused", "used"))


@row(counts="refused")
async def D59_kinds_that_are_not_taken(stage):
    whole = exr(8, 4)
    kinds = [whole[:4] + struct.pack("<I", 2 | flag) + whole[8:] for flag in (0x200, 0x800, 0x1000, 0x1a00, 0x80000000)]
    kinds += [exr(8, 4).replace(b"compression\0compression\0\1\0\0\0\0", b"compression\0compression\0\1\0\0\0" + bytes([c]))
              for c in (PIZ, PXR24, B44, B44A, DWAA, DWAB, 10, 255)]
    kinds += [exr(8, 4, more=attribute(b"type", b"string", kind)) for kind in (b"tiledimage", b"deepscanline", b"nonsense")]
    kinds += [b"\x89PNG\r\n\x1a\n" + b"\0" * 99, b"#?RADIANCE\n", b"\0" * 2000, b"x"]
    return await fates(stage, kinds)


@row()
async def D60_windows_anywhere(stage):
    places = [(exr(8, 4, at=at, display=display)) for at in ((-4, -2), (1000, 2000), (-2000000, 5), (1 << 30, 1 << 30))
              for display in (None, (0, 0, 7, 3), (-9, -9, 99, 99))]
    return await fates(stage, places, ("used", "refused"))


@row()
async def D61_values_that_are_no_light(stage):
    nan, infinity = float("nan"), float("inf")
    odd = (nan, infinity, -infinity, -1.0, -0.0, 1e-45, 65504.0, 65505.0, 1e38, 3.4e38)
    raw = [struct.pack("<f", v) * 96 for v in odd] + [struct.pack("<10f", *odd) * 9 + b"\0" * 24]
    said = await fates(stage, raw, ("used", "refused"), encoding=4)
    await stage.viewer.sees(2)
    repaired = stage.viewer.status.get("frames", {}).get("repaired", 0)
    check(repaired > 0, f"nothing was repaired: {stage.viewer.status.get('frames')}")
    files = await fates(stage, [exr(8, 4, value=v) for v in (nan, infinity, -1.0, 1e38)], ("used", "refused"))
    return f"raw: {said}; EXR: {files}; {repaired} texels repaired"


@row()
async def D62_black_frames_and_hot_texels(stage):
    hot = struct.pack("<f", 1.0) * 45 + struct.pack("<3f", 1e6, 1e6, 1e6) + struct.pack("<f", 1.0) * 48
    raw = [b"\0" * 96 * 4, hot, b"\0" * 96 * 4, b"\0" * 380 + struct.pack("<f", 1e30), hot]
    return await fates(stage, raw, ("used",), encoding=4)


@row(memory_kib=131072)  # tables for each recent layout and size
async def D63_another_size_each_time(stage):
    said = []
    for size in ((8, 4), (512, 256), (2, 1), (6, 36), (1024, 512), (4, 3), (3, 4), (8, 4)):  # lat-long, cube, crosses
        payload = struct.pack("<f", 0.5) * (size[0] * size[1] * 3)
        got = await fate(stage, payload, ("used", "refused"), encoding=4, size=size)
        said.append(f"{size[0]}x{size[1]} {got['fate']}")
    check(said[0].endswith("used") and said[-1].endswith("used"), f"{said}")
    return ", ".join(said)


@row(memory_kib=8192)  # tables for each of the sizes
async def D64_the_smallest_frames(stage):
    said = []
    for size in ((1, 1), (2, 2), (2, 1), (1, 2), (4, 2), (1, 6)):
        got = await fate(stage, struct.pack("<f", 0.5) * (size[0] * size[1] * 3), ("used", "refused"), encoding=4, size=size)
        said.append(f"{size[0]}x{size[1]} {got['fate']}")
    check("2x1 used" in said, f"{said}")
    await fate(stage, exr(), ("used",))
    return ", ".join(said)


FRAMES = 30  # all together more than memory may grow by


@row(memory_kib=131072)
async def D65_frames_faster_than_they_are_decoded(stage):
    """As many as credit allows; the newest wins, and memory stays at a few frames."""
    producer = stage.producer
    payload = struct.pack("<f", 0.25) * (1024 * 512 * 3)
    pause_s, producer.pause_s = producer.pause_s, 0.0
    before, peak = stage.server.memory_kib(), 0
    producer.held = True
    try:
        sent = []
        while len(sent) < FRAMES:
            if producer.credit > 0:
                sent.append(await producer.push(producer.link, payload, encoding=4, size=(1024, 512)))
            else:
                await asyncio.sleep(0.001)
            peak = max(peak, stage.server.memory_kib() - before)
    finally:
        producer.pause_s, producer.held = pause_s, False
    await fate(stage, exr(), ("used",))
    got = [producer.fates[n]["fate"] for n in sent if n in producer.fates]
    check(len(got) == len(sent), f"{len(sent) - len(got)} frames have no fate")
    return f"{FRAMES} frames of 6 MB: {got.count('used')} used, {got.count('superseded')} superseded; at most {peak / 1024:+.0f} MiB"


@row(memory_kib=96 << 10)
async def D67_a_bomb_of_zeros(stage):
    """ZIP reduces 400 MB of zeros to a few hundred KB: an environment map that large is allowed, and its memory is
    released after some smaller ones; 64 MB shared with the decoder are kept."""
    before, peak = stage.server.memory_kib(), [0]
    rgb = [channel(n) for n in (b"B", b"G", b"R")]
    width, height = 8192, 4096

    def zeros(width, height):
        head = header(rgb, (0, 0, width - 1, height - 1), ZIP)
        block = zlib.compress(b"\0" * (width * 12 * 16), 9)
        count = height // 16
        start = len(head) + 8 * count
        table = b"".join(struct.pack("<Q", start + i * (8 + len(block))) for i in range(count))
        return head + table + b"".join(struct.pack("<ii", 16 * i, len(block)) + block for i in range(count))

    bomb = zeros(width, height)

    async def watch():
        while True:
            peak[0] = max(peak[0], stage.server.memory_kib() - before)
            await asyncio.sleep(0.01)

    watching = asyncio.ensure_future(watch())
    try:
        got = await stage.producer.fate(bomb, encoding=1)
    finally:
        watching.cancel()
    peak[0] = max(peak[0], stage.server.memory_kib() - before)
    check(peak[0] > 400 << 10 or got["fate"] != "used", f"at most {peak[0]} KiB more: its picture was not held")
    larger = await stage.producer.fate(zeros(2 * width, 2 * height), encoding=1)
    check(larger["fate"] == "refused" and "the limit is 8192 per side" in larger["message"], f"{larger}")
    begun = time.monotonic()
    while stage.server.memory_kib() - before > KEPT * 96 << 10:
        grown = stage.server.memory_kib() - before
        check(time.monotonic() - begun < WAIT_S, f"{grown} KiB more memory stay")
        await fate(stage, exr(), ("used",))
    return f"{len(bomb) >> 10} KiB for {width}x{height}: {got['fate']} ({got.get('message', '')}); at most {peak[0] / 1024:+.0f} MiB"


if __name__ == "__main__":
    main()
