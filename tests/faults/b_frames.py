#!/usr/bin/python3
"""Faults of WebSocket frames (group B): a client past the handshake that violates RFC 6455 or abuses it."""

import asyncio
import json
import struct
import time

from faults import BINARY, CLOSE, MORE, PING, PONG, TEXT, check, environment, frame, hello, main, row

ASK = json.dumps({"op": "ping", "id": 7}).encode()


async def cut(stage, data, codes=(1002, None), role="viewer"):
    """The connection closes with one of these codes (None: without one); returns it."""
    raw = await stage.client(role)
    raw.send(data)
    got = await raw.closed()
    check(got in codes, f"{data[:24].hex()}: closed with {got} instead of one of {codes}")
    raw.shut()
    return got


@row()
async def B21_unmasked_frames(stage):
    """RFC 6455 5.1 requires closing the connection; lws 4.1.6 accepts them without reporting the bit. So the test
    requires only that nothing else happens."""
    raw = await stage.client()
    raw.send(frame(TEXT, ASK, mask=False))
    await raw.pong(9)
    raw.shut()
    return "taken (libwebsockets 4.1.6)"


@row(patient=True)
async def B22_reserved_bits(stage):
    """lws 4.1.6 stops reading, and closes the connection five seconds later, without a code."""
    begun = time.monotonic()
    codes = await asyncio.gather(*(cut(stage, frame(op, ASK, reserved=bits))
                                   for bits in (1, 2, 4, 7) for op in (TEXT, PING)))
    return f"closed with {set(codes)} after {time.monotonic() - begun:.1f} s"


@row()
async def B23_reserved_opcodes(stage):
    codes = {await cut(stage, frame(op, ASK)) for op in (3, 4, 5, 6, 7, 11, 12, 13, 14, 15)}
    return f"closed with {codes}"


@row()
async def B24_fragments_out_of_order(stage):
    await cut(stage, frame(MORE, ASK))
    await cut(stage, frame(MORE, ASK, fin=False))
    await cut(stage, frame(TEXT, ASK, fin=False) + frame(TEXT, ASK))
    await cut(stage, frame(TEXT, ASK, fin=False) + frame(BINARY, ASK), codes=(1002, None))
    return "closed with 1002"


@row()
async def B25_bad_control_frames(stage):
    for op in (PING, PONG, CLOSE):
        await cut(stage, frame(op, b"x" * 10, fin=False))
        await cut(stage, frame(op, b"x" * 126))
        await cut(stage, frame(op, b"x" * 125, length=125, wide=8)[:14] + b"x" * 70000)
    return "closed with 1002, or cut"


@row()
async def B26_lengths_that_lie(stage):
    before = stage.server.memory_kib()
    for length in (1 << 31, 1 << 32, 1 << 62, (1 << 63) - 1, 1 << 63, (1 << 64) - 1):
        await cut(stage, frame(TEXT, b"{", length=length, wide=8), codes=(1009, 1002, None))
        await cut(stage, frame(BINARY, b"RLE1", length=length, wide=8), codes=(1009, 1002, 4004, None))
    async with stage.without_producer():
        for length in (1 << 31, 1 << 62, (1 << 63) - 1):
            head = environment(1, b"x" * 100, encoding=4, size=(16384, 16384), length=1 << 31)[:60]
            await cut(stage, frame(BINARY, head, length=length, wide=8), codes=(1009, 4002, 1002, None), role="producer")
    return f"1009, 4002 or cut; {stage.server.memory_kib() - before:+d} KiB"


@row()
async def B27_lengths_longer_than_need_be(stage):
    """RFC 6455 5.2: the minimal number of bytes must be used. lws accepts others."""
    raw = await stage.client()
    raw.send(frame(TEXT, ASK, wide=2))
    raw.send(frame(TEXT, ASK, wide=8))
    await raw.until("pong")
    await raw.until("pong")
    raw.shut()
    return "taken (libwebsockets 4.1.6)"


@row()
async def B28_endless_empty_fragments(stage):
    data = frame(TEXT, b"", fin=False) + frame(MORE, b"", fin=False) * 100000
    return f"closed with {await cut(stage, data, codes=(1009, None))}"


@row(memory_kib=8192)  # the first of its kind fills lws' buffers; further ones add nothing
async def B29_a_message_of_one_byte_fragments(stage):
    text = frame(TEXT, b"{", fin=False) + frame(MORE, b" ", fin=False) * (1 << 20)
    first = await cut(stage, text, codes=(1009, None))
    async with stage.without_producer():
        message = environment(1, b"x" * (1 << 20), encoding=2)
        flood = frame(BINARY, message[:1], fin=False) + b"".join(frame(MORE, message[i:i + 1], fin=False)
                                                                  for i in range(1, 70000))
        second = await cut(stage, flood, codes=(1009, 4002, None), role="producer")
    return f"text closed with {first}, a frame with {second}"


@row()
async def B30_ping_and_pong_floods(stage):
    raw = await stage.client()
    begun = time.monotonic()
    heard = asyncio.ensure_future(raw.rest())
    for _ in range(20):
        raw.send(frame(PING, b"y" * 100) * 1000 + frame(PONG, b"z" * 100) * 1000)
        if not await raw.flush():
            break
    raw.send(frame(CLOSE, struct.pack(">H", 1000)))
    await heard
    raw.shut()
    deaf = await stage.client()  # a client that never reads the answers to its pings
    for _ in range(40):
        deaf.send(frame(PING, b"y" * 125) * 1000)
        if not await deaf.flush(2):
            break
    deaf.reset()
    return f"40000 frames in {time.monotonic() - begun:.1f} s"


@row(counts="error")
async def B31_text_that_is_not_utf8(stage):
    for bad in (b"\xff", b"\xc3\x28", b"\xed\xa0\x80", b"\xf4\x90\x80\x80", b"\xc0\xaf", b"\xe2\x82"):
        await stage.offends(frame(TEXT, b'{"op":"' + bad + b'"}'), 1007)
    raw = await stage.client()  # a fragment border inside a character is valid
    text = '{"op":"ping","id":7,"ü":"€𝄞"}'.encode()
    for i, byte in enumerate(text):
        raw.send(frame(TEXT if i == 0 else MORE, bytes([byte]), fin=i + 1 == len(text)))
    await raw.until("pong")
    raw.shut()
    return "closed with 1007"


@row()
async def B32_bad_close_frames(stage):
    got = {}
    for payload in (b"", b"\x03", b"\0\0", struct.pack(">H", 999), struct.pack(">H", 1005), struct.pack(">H", 1006),
                    struct.pack(">H", 1016), struct.pack(">H", 5000), struct.pack(">H", 65535),
                    struct.pack(">H", 1000) + b"r" * 123, struct.pack(">H", 1000) + b"\xff\xfe"):
        raw = await stage.client()
        raw.send(frame(CLOSE, payload))
        got[payload[:2].hex()] = await raw.closed()
        raw.shut()
    return f"answered {got}"


@row()
async def B33_data_after_close(stage):
    raw = await stage.client()
    raw.send(frame(CLOSE, struct.pack(">H", 1000)) + frame(TEXT, ASK) * 50 + b"\xff" * 5000)
    await raw.closed()
    check(not any(m["op"] == "pong" for m in raw.said), "answered after the close")
    raw.shut()
    return "not answered"


@row()
async def B34_half_closed_within_a_frame(stage):
    for part in (frame(TEXT, ASK)[:1], frame(TEXT, ASK)[:5], frame(TEXT, ASK)[:-1], frame(TEXT, ASK, fin=False)):
        raw = await stage.client()
        raw.send(part)
        raw.writer.write_eof()
        await raw.rest()
        raw.shut()
    return "cut"


@row()
async def B35_reset_within_a_frame(stage):
    for part in (b"", frame(TEXT, ASK)[:5], frame(TEXT, ASK, fin=False), frame(TEXT, ASK) * 20):
        for _ in range(25):
            raw = await stage.client()
            raw.send(part)
            await asyncio.sleep(0)
            raw.reset()
    return "100 resets"


@row(patient=True)
async def B36_a_message_that_stops(stage):
    raw = await stage.client()
    raw.send(frame(TEXT, ASK)[:9])
    return f"cut after {await raw.ends():.1f} s"


@row(counts="error")
async def B37_text_for_binary_and_reverse(stage):
    await stage.offends(frame(BINARY, ASK), 4004, "wrong_role")
    await stage.offends(frame(BINARY, environment(1)), 4004, "wrong_role", role="controller")
    async with stage.without_producer():
        await stage.offends(frame(TEXT, environment(1)), (4001, 1007), role="producer")
    return "4004; 1007 or 4001"


@row()
async def B38_compression_offered(stage):
    raw = await stage.raw()
    raw.send(raw.handshake(Sec_WebSocket_Extensions="permessage-deflate; client_max_window_bits, x-webkit-deflate-frame"))
    status, head = await raw.answer()
    check(status == 101, f"answered {status}")
    check(b"extensions" not in head.lower(), "an extension is agreed to")
    raw.send(hello())
    await raw.until("welcome")
    raw.send(frame(TEXT, b"\xaa\x56\x2a", reserved=4))  # compressed nevertheless
    check(await raw.closed() in (1002, None), "a compressed frame is taken")
    raw.shut()
    return "not taken; a compressed frame is 1002"


@row(counts="error")
async def B39_messages_at_their_limit(stage):
    raw = await stage.client()
    for size in (16383, 16384):
        raw.send(frame(TEXT, ASK.ljust(size)))
        await raw.until("pong")
    raw.shut()
    await stage.offends(frame(TEXT, ASK.ljust(16385)), 1009, "too_big")
    half = ASK.ljust(8192)
    await stage.offends(frame(TEXT, half, fin=False) + frame(MORE, b" " * 8193), 1009, "too_big")
    return "16384 bytes taken, 16385 are 1009"


if __name__ == "__main__":
    main()
