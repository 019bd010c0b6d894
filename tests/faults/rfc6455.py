#!/usr/bin/python3
"""RFC 6455 case by case: an independent client library (python3-websockets) for what is allowed, raw bytes for what that library refuses
to send. A case is the bytes sent after the handshake and the expected answer: to a protocol ping (so a message arrived completely), a
WebSocket pong, or one of some close codes (None: the connection ends without)."""

import asyncio
import itertools
import json
import random
import struct

from faults import BINARY, CLOSE, MORE, PING, PONG, TEXT, Raw, Relightd, check, connect, frame, hello
from peer import Failed, main

ASK = json.dumps({"op": "ping", "id": 7}).encode()


def cut(data, *sizes):
    """A text in fragments of these sizes, the last one the rest."""
    parts, at = [], 0
    for size in sizes:
        parts.append(data[at:at + size])
        at += size
    parts.append(data[at:])
    return b"".join(frame(TEXT if i == 0 else MORE, part, fin=i + 1 == len(parts)) for i, part in enumerate(parts))


def ask(text):
    """A protocol ping containing that text."""
    return b'{"op":"ping","id":7,"x":"' + text + b'"}'


async def case(server, name, data, wanted, pieces=None):
    raw = await Raw.open(server.port)
    try:
        check(await raw.upgrade() == 101, "no handshake")
        raw.send(hello())
        await raw.until("welcome")
        if pieces:  # as TCP may split it
            for i in range(0, len(data), pieces):
                raw.send(data[i:i + pieces])
                await raw.flush()
                await asyncio.sleep(0)
        else:
            raw.send(data)
        if wanted == "answer":
            await raw.until("pong")
        elif isinstance(wanted, bytes):
            while True:
                kind, payload = await raw.receive()
                check(kind is not None and kind != CLOSE, "closed before its pong")
                if kind == PONG:
                    check(payload == wanted, f"a pong of {payload[:40]}")
                    break
        else:
            code = await raw.closed()
            check(code in wanted, f"closed with {code} instead of {wanted}")
        return None
    except Failed as fault:
        return f"{name}: {fault}"
    finally:
        raw.reset()


async def all_of(cases):
    """Each on its own connection, eight at a time; reports all failures."""
    async with Relightd("--max-connections", "200", source="sky:size=128x64,speed=60") as server:
        gate = asyncio.Semaphore(8)

        async def one(*what):
            async with gate:
                return await case(server, *what)

        faults = [f for f in await asyncio.gather(*(one(*c) for c in cases)) if f]
        check(not faults, "; ".join(faults))
        print(f"{len(cases)} cases")


async def framing_5_2_of_every_length(folder):
    """Payloads around each encoding of lengths, sent whole and split by TCP."""
    cases = []
    for size in (len(ASK), 124, 125, 126, 127, 128, 129, 254, 255, 256, 1000, 4095, 4096, 8192, 16383, 16384):
        data = frame(TEXT, ASK.ljust(size))
        cases += [(f"{size} bytes", data, "answer")]
        cases += [(f"{size} bytes by {n}", data, "answer", n) for n in (1, 7, 997) if len(data) // n < 3000]
    cases += [("two in one", frame(TEXT, ASK) * 2, "answer")]
    await all_of(cases)


async def control_frames_5_5_between_all(folder):
    cases = [(f"ping of {n}", frame(PING, bytes(range(n))), bytes(range(n))) for n in (0, 1, 64, 124, 125)]
    cases += [("ping by single bytes", frame(PING, b"x" * 125), b"x" * 125, 1)]
    cases += [("pong nobody asked for", frame(PONG, b"hello") + frame(TEXT, ASK), "answer")]
    cases += [("ten pings", b"".join(frame(PING, b"%d" % i) for i in range(10)), b"0")]
    cases += [("ping between fragments", frame(TEXT, ASK[:9], fin=False) + frame(PING, b"in") + frame(MORE, ASK[9:]), b"in")]
    cases += [("a message with a ping in it", frame(TEXT, ASK[:9], fin=False) + frame(PING, b"in") + frame(MORE, ASK[9:]),
               "answer")]
    cases += [(f"{op} of 126", frame(op, b"x" * 126), (1002, None)) for op in (PING, PONG, CLOSE)]
    cases += [(f"{op} in fragments", frame(op, b"x", fin=False), (1002, None)) for op in (PING, PONG, CLOSE)]
    await all_of(cases)


async def fragments_5_4_of_every_cut(folder):
    cases = [(f"cut at {i}", cut(ASK, i), "answer") for i in range(len(ASK) + 1)]
    cases += [("single bytes", cut(ASK, *[1] * (len(ASK) - 1)), "answer"), ("empty ones between", cut(ASK, 3, 0, 0, 4, 0), "answer"),
              ("empty first", cut(ASK, 0), "answer"), ("by single bytes of TCP", cut(ASK, 5, 5), "answer", 1)]
    cases += [("continuation of nothing", frame(MORE, ASK), (1002, None)),
              ("continuation of nothing, more to come", frame(MORE, ASK, fin=False), (1002, None)),
              ("continuation after the end", frame(TEXT, ASK) + frame(MORE, ASK), (1002, None)),
              ("text within a text", frame(TEXT, ASK[:4], fin=False) + frame(TEXT, ASK), (1002, None)),
              ("binary within a text", frame(TEXT, ASK[:4], fin=False) + frame(BINARY, ASK), (1002, None))]
    await all_of(cases)


async def reserved_5_2_bits_and_opcodes(folder):
    cases = [(f"opcode {op}", frame(op, payload), (1002, None)) for op in (3, 4, 5, 6, 7, 11, 12, 13, 14, 15)
             for payload in (b"", ASK)]
    cases += [(f"bits {bits} of opcode {op}", frame(op, ASK, reserved=bits), (1002, None)) for bits in range(1, 8)
              for op in (TEXT, PING)]
    await all_of(cases)


async def text_8_1_is_utf_8(folder):
    good = ["\u03ba\u1f79\u03c3\u03bc\u03b5", "\u0080", "\u07ff", "\u0800", "\ufffd", "\U00010000", "\U0010ffff", "\ufdd0", "\ufffe", "\U0001fffe",
            "\ud7ff", "\ue000", "\ufeff", "\u2028"]
    bad = [b"\x80", b"\xbf", b"\xc0\x80", b"\xc1\xbf", b"\xc2", b"\xe0\x80\x80", b"\xe0\x9f\xbf", b"\xe1\x80", b"\xed\xa0\x80",
           b"\xed\xbf\xbf", b"\xf0\x80\x80\x80", b"\xf0\x8f\xbf\xbf", b"\xf4\x90\x80\x80", b"\xf5\x80\x80\x80", b"\xf8\x88\x80\x80\x80",
           b"\xfc\x84\x80\x80\x80\x80", b"\xfe", b"\xff", b"\xce\xba\xe1\xbd\xb9\xcf\x83\xce\xbc\xce\xb5\xed\xa0\x80"]
    cases = [(f"U+{ord(t[0]):04X}", frame(TEXT, ask(t.encode())), "answer") for t in good]
    cases += [(f"U+{ord(t[0]):04X} cut", cut(ask(t.encode()), 26), "answer") for t in good]
    cases += [(b.hex(), frame(TEXT, ask(b)), (1007,)) for b in bad]
    cases += [(b.hex() + " cut", cut(ask(b), 26), (1007,)) for b in bad]
    await all_of(cases)


async def closing_7_4_with_every_code(folder):
    cases = [("without a code", frame(CLOSE), (1005, 1000, None))]
    cases += [(f"{code}", frame(CLOSE, struct.pack(">H", code)), (code,)) for code in (1000, 1001, 1002, 1003, 1007, 1008, 1009,
                                                                                     1010, 1011, 3000, 3999, 4000, 4999)]
    cases += [("with a reason", frame(CLOSE, struct.pack(">H", 1000) + b"r" * 123), (1000,))]
    cases += [(f"{code}", frame(CLOSE, struct.pack(">H", code)), (1002, None)) for code in (0, 999, 1004, 1005, 1006, 1015, 1016)]
    cases += [("then a text", frame(CLOSE, struct.pack(">H", 1000)) + frame(TEXT, ASK), (1000,)),
              ("then a close", frame(CLOSE, struct.pack(">H", 1000)) * 2, (1000,)),
              ("within a message", frame(TEXT, ASK[:4], fin=False) + frame(CLOSE, struct.pack(">H", 1000)), (1000,))]
    await all_of(cases)


async def a_library_by_others_finds_nothing_amiss(folder):
    """Messages of random sizes, fragmented or not, with pings in between, until six hundred are answered; then
    closes."""
    draw = random.Random(6455)
    async with Relightd(source="sky:size=128x64,speed=60") as server, connect(server.url) as link:
        check(link.subprotocol == "relight.v1" and not link.extensions, "another subprotocol, or an extension")
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1}}))
        answered, numbers = 0, itertools.count(1)

        async def hear(want):
            nonlocal answered
            async for message in link:
                said = json.loads(message)
                check(said["op"] != "error", message)
                answered += said["op"] == "pong"
                if answered >= want:
                    return

        for turn in range(100):
            asked = hear(6 * (turn + 1))
            for _ in range(6):  # eight may be unanswered (4.7.2)
                text = json.dumps({"op": "ping", "id": next(numbers)}).ljust(draw.randrange(20, 16384))
                if draw.random() < 0.5:
                    at = sorted(draw.randrange(len(text)) for _ in range(draw.randrange(1, 6)))
                    await link.send([text[a:b] for a, b in zip([0, *at], [*at, len(text)]) if b > a])
                else:
                    await link.send(text)
            await (await link.ping())
            await asked
            await asyncio.sleep(0.04)  # 300 a second are allowed
        await link.close(code=1000, reason="done")
        check(link.close_code == 1000, f"closed with {link.close_code}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
