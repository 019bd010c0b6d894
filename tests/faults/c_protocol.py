#!/usr/bin/python3
"""Faults of the protocol (group C): well-formed WebSocket messages that PROTOCOL.md forbids."""

import json
import struct

from faults import (BINARY, KEPT, TEXT, Raw, Relightd, Viewer, check, environment, frame, hello, main, row, say)


async def stays(stage, message, code, role="viewer"):
    """Expects an error with that code, after which the connection continues."""
    raw = await stage.client(role)
    raw.send(message if isinstance(message, bytes) else say(**message))
    error = await raw.until("error")
    check(error["code"] == code and not error["fatal"], f"{error} instead of {code}")
    await raw.pong()
    raw.shut()
    return error


@row(counts="error")
async def C40_messages_before_hello(stage):
    for first in (say(op="ping", id=1), say(op="subscribe", format="jpeg"), say(op="control", paused=True), say(op="end"),
                  say(op="ack", sequence=1), say(op="probe", x=1, y=1)):
        await stage.offends(first, 4003, "bad_order", role=None)
    await stage.offends(frame(BINARY, environment(1)), 4004, "wrong_role", role=None)
    return "4003 bad_order; frames 4004 wrong_role"


@row(counts="error")
async def C41_hello_twice(stage):
    for role in ("viewer", "controller"):
        await stage.offends(hello(role), 4003, "bad_order", role=role)
    await stage.offends(hello("controller"), 4003, "bad_order", role="viewer")  # a role cannot be raised later
    return "4003 bad_order"


@row(counts="error")
async def C42_unknown_op_and_version(stage):
    await stays(stage, {"op": "fly"}, "unknown_op")
    await stays(stage, {"op": "x" * 5000}, "unknown_op")
    for version in ({"major": 2}, {"major": 0, "minor": 9}, {"major": 65535}):
        await stage.offends(say(op="hello", role="viewer", version=version), 4005, "bad_version", role=None)
    for version in ({"minor": 1}, {"major": 4294967295}, {"major": "1"}, [1, 0]):
        await stage.offends(say(op="hello", role="viewer", version=version), 4002, "bad_field", role=None)
    return "unknown_op stays; 4005 bad_version"


@row(counts="error")
async def C43_environment_headers_that_lie(stage):
    good = environment(1, b"x" * 96, encoding=4)
    fields = {"magic": (0, 4), "header": (4, 2), "encoding": (6, 1), "layout": (7, 1), "channels": (9, 1), "width": (12, 4),
              "height": (16, 4), "payload": (20, 4), "number": (24, 8)}
    count = 0
    async with stage.without_producer():
        for name, (at, size) in fields.items():
            for value in (b"\xff" * size, b"\0" * size, b"\x7f" + b"\xff" * (size - 1)):
                bad = good[:at] + value + good[at + size:]
                if bad == good or (name, value) in (("layout", b"\0"), ("number", b"\0" * 8)):
                    continue
                raw = await stage.client("producer")
                raw.send(frame(BINARY, bad))
                got = await raw.closed()
                check(got in (4002, 1009), f"{name} = {value.hex()}: closed with {got}; {raw.said[-1:]}")
                count += 1
                raw.shut()
        for end in (0, 1, 47, 48, len(good) - 1):  # too short, and one too long
            await stage.offends(frame(BINARY, good[:end]), (4002, 1009), role="producer")
        await stage.offends(frame(BINARY, good + b"y"), (4002, 1009), role="producer")
    return f"{count + 6} headers: 4002 or 1009"


@row(counts="error")
async def C44_hostile_json(stage):
    deep = b"[" * 8000 + b"]" * 8000
    for bad, codes in ((deep, (4001,)), (b'{"a":' * 2500 + b"1" + b"}" * 2500, (4001,)),
                       (b'{"op":"ping","op":"end","id":1}', (4001,)), (b'{"op":"ping","id":1,"id":2}', (4001,)),
                       (b'{"op":"ping","id":1e999}', (4001, 4002)), (b'{"op":"ping","id":-1e999}', (4001, 4002)),
                       (b'{"op":"ping","id":99999999999999999999}', (4001, 4002)),
                       (b'{"op":"ping","id":9007199254740992}', (4002,)), (b'{"op":"ping","id":1.5}', (4002,)),
                       (b'{"op":"ping","id":"\\ud800"}', (4001,)), (b'{"op":"p\\u0000ing","id":1}', (4001, 4002)),
                       (b'{"op":"ping","id":1}\0', (4001,)), (b'{"op":"ping","id":1} x', (4001,)), (b"", (4001,)),
                       (b"null", (4001,)), (b'"op"', (4001,)), (b"{", (4001,)), (b'{"op":7}', (4002,)), (b"{}", (4002,)),
                       (b"{'op':'ping'}", (4001,)), (b'{"op":"ping","id":NaN}', (4001,)), (b"\xef\xbb\xbf{}", (4001, 4002)),
                       (b'{"op":"ping","id":01}', (4001,)), (b'{"op":"' + b"a" * (1 << 20) + b'"}', (1009,))):
        await stage.offends(frame(TEXT, bad), codes)
    return "4001 bad_json, 4002 bad_field, 1009 too_big"


@row(counts="error")
async def C45_numbers_out_of_their_range(stage):
    """Cameras are chosen by name; these are the numbers that a controller sends."""
    bad = [{"rotate_degrees": v} for v in (3601, -3601, "1", None)] + [{"scale_stops": 61}, {"samples": 0}, {"samples": 1.5},
           {"samples": 1 << 40}, {"exposure_stops": 61}, {"bias_stops": -21}, {"fps": 0}, {"fps": -1}, {"fps": 1001},
           {"error": 0}, {"error": 11}, {"hour": 25}, {"hour": -1}, {"seek": -1}, {"step": 1001}, {"camera": ""},
           {"camera": "x" * 300}, {"camera": "nobody"}, {"method": "path"}, {"tone": "x"}, {"paths": 7}, {"paused": 1}]
    for wish in bad:
        raw = await stage.client("controller")
        raw.send(say(op="control", request=5, **wish))
        error = await raw.until("error")
        check(error["code"] == "bad_field" and not error["fatal"] and error["request"] == 5, f"{wish}: {error}")
        await raw.pong()
        raw.shut()
    for number in (b"NaN", b"Infinity", b"-Infinity", b"1e999"):
        raw = await stage.client("controller")
        raw.send(frame(TEXT, b'{"op":"control","rotate_degrees":' + number + b"}"))
        check(await raw.closed() == 4001, f"{number} is taken")
        raw.shut()
    return f"{len(bad)} values: bad_field, the connection stays; 4 are no JSON: 4001"


@row(alone=True)
async def C46_sizes_at_their_limits(folder):
    from peer import run
    for size in ("0x0", "0x36", "16385x16", "64", "-1x4", "99999999999x1", "1e3x1"):
        program = await run("relightd", "--port", "0", "--size", size)
        check(program.code == 2 and size in program.err, f"{size}: {program.code} {program.err}")
    for size in ("1x1", "63x35", "1x200"):
        async with Relightd("--size", size, "--scene", box(folder), source="sky:size=128x64,speed=60") as server:
            for format in ("jpeg", "h264", "exr_half"):
                async with Viewer(server, format) as viewer:
                    await viewer.sees(2)
            raw = await Raw.open(server.port)
            check(await raw.upgrade() == 101, "no handshake")
            raw.send(hello())
            for wish in ({"max_width": 0}, {"max_width": 16385}, {"max_height": -1}, {"quality": 0}, {"quality": 101},
                         {"max_rate": 0}, {"max_rate": 1001}, {"format": "png"}):
                other = await Raw.open(server.port)
                await other.upgrade()
                other.send(hello() + say(**{"op": "subscribe", "format": "jpeg", **wish}))
                check(await other.closed() == 4002, f"{wish} is taken")
                other.shut()
            raw.send(say(op="subscribe", format="jpeg", max_width=1, max_height=1))
            await raw.until("subscribed")
            raw.shut()
    return "1x1, 63x35 and 1x200 in JPEG, H.264 and EXR; others refused, 4002"


def box(folder):
    (folder / "box.obj").write_text("v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5\nf 1 2 3 4\n", encoding="ascii")
    (folder / "box.json").write_text(json.dumps({
        "camera": {"position": [4, 3, 6], "look_at": [0, 0, 0], "up": [0, 1, 0], "fov_y_degrees": 40},
        "models": [{"file": "box.obj", "material": "floor"}],
        "materials": {"floor": {"type": "lambert", "albedo": [0.5, 0.5, 0.5]}}}), encoding="ascii")
    return str(folder / "box.json")


@row(counts="error")
async def C47_acks_that_lie(stage):
    for sequence in (1 << 40, (1 << 53) - 1):
        await stage.offends(say(op="ack", sequence=sequence), 4003, "bad_order")
    for sequence in (0, -1, 1.5, "1", None):
        await stage.offends(say(op="ack", sequence=sequence), 4002, "bad_field")
    raw = await stage.client()
    raw.send(say(op="subscribe", format="jpeg"))
    first = None
    while first is None:
        kind, payload = await raw.receive()
        if kind == BINARY:
            first, = struct.unpack_from("<Q", payload, 8)
    for sequence in (first, first, max(1, first - 1), 1, first):  # repeated, and backwards
        raw.send(say(op="ack", sequence=sequence))
    await raw.pong()
    raw.shut()
    never = await stage.client()  # never acknowledges: gets two pictures, then only texts
    never.send(say(op="subscribe", format="jpeg"))
    for _ in range(3):
        await never.until("status")
    check(never.binary == 2, f"{never.binary} pictures to who acknowledges none")
    never.shut()
    return "ahead is 4003; repeated and backwards are passed over; without acks 2 pictures"


FLOODS = 5


@row(counts="error", memory_kib=49152)
async def C48_control_messages_in_a_flood(stage):
    # Rotations allocate sky tables, one for each slot that has another, and their memory stays. How many there are at once
    # is chance: soon a flood takes no more.
    for flood in range(FLOODS):
        memory = stage.server.memory_kib()
        raw = await stage.client("controller")
        raw.send(b"".join(say(op="control", request=i, rotate_degrees=i % 360) for i in range(10000)))
        got = await raw.closed()
        check(got in (4010, None), f"closed with {got}")
        raw.shut()
        await stage.viewer.sees(6)
        grown = stage.server.memory_kib() - memory
        check(grown <= (4096 if flood == FLOODS - 1 else 49152) * KEPT, f"{grown} KiB more memory in flood {flood}")
        if flood > 0 and grown <= 4096 * KEPT:
            break
    again = await stage.client("controller")
    again.send(say(op="control", rotate_degrees=0, method="auto"))
    await again.pong()
    again.shut()
    await stage.viewer.sees(6)  # by then all slots have the tables of the old rotation again
    return f"10000 at once: {got} too_fast"


@row(counts="error")
async def C49_the_wrong_role(stage):
    await stage.offends(frame(BINARY, environment(1)), 4004, "wrong_role")
    await stage.offends(say(op="end"), 4004, "wrong_role")
    await stage.offends(say(op="end"), 4004, "wrong_role", role="controller")
    raw = await stage.client()
    raw.send(say(op="control", paused=True))
    got = await raw.closed()
    check(got == 4004, f"a viewer that controls: {got}")
    raw.shut()
    async with stage.without_producer():
        for message in (say(op="subscribe", format="jpeg"), say(op="ack", sequence=1), say(op="control", paused=True),
                        say(op="probe", x=1, y=1)):
            await stage.offends(message, 4004, "wrong_role", role="producer")
    for role in ("king", "", 7, None):
        await stage.offends(say(op="hello", role=role, version={"major": 1}), (4002, 4004), role=None)
    return "4004 wrong_role"


@row(counts="error")
async def C50_a_second_producer(stage):
    for more in ({}, {"pace": "lockstep", "sequence": "other"}):
        raw = await stage.raw()
        await raw.upgrade()
        raw.send(hello("producer", **more))
        got = await raw.closed()
        check(got == 4012, f"closed with {got}")
        raw.shut()
    check(not stage.producer.parted or stage.producer.parted[-1] != 4011, "the first one lost its place")
    return "4012 busy; the first one stays"


@row()
async def C51_what_another_session_knew(stage):
    """A recorder of a sequence without producer, names of another session, more names than are remembered."""
    raw = await stage.client(recorder="of-another-session")
    welcome = raw.said[0] if raw.said[0]["op"] == "welcome" else [m for m in raw.said if m["op"] == "welcome"][0]
    check(welcome["recorder"]["stored_after"] is None, f"{welcome}")
    raw.send(say(op="subscribe", format="exr_half"))
    await raw.until("subscribed")
    raw.send(say(op="ack", sequence=77, stored=True))
    got = await raw.closed()
    check(got == 4003, f"an ack of another session: {got}")
    raw.shut()
    for i in range(64):
        raw = await stage.client(recorder=f"name-{i}")
        raw.shut()
    return "nothing is stored; its acks are 4003; names are forgotten"


@row(counts="frames")
async def C140_late_lockstep_frames(stage):
    """A refused frame sent again after a later one, and a lower number that was never sent."""
    recorder = await stage.client(recorder="late")
    recorder.send(say(op="subscribe", format="jpeg"))
    await recorder.until("subscribed")
    fates = []
    async with stage.without_producer():
        raw = await stage.client("producer", pace="lockstep", sequence="late")
        granted = 1 - raw.said[-1]["producer"]["credit"]
        if granted:
            await raw.until("credit")
        for number, payload in ((5, b"junk"), (6, None), (5, b"junk"), (4, None), (6, None)):
            raw.send(frame(BINARY, environment(number, payload, encoding=2 if payload else None)))
            fate = await raw.until("frame")
            check(fate["number"] == number, f"{fate}")
            fates.append(fate)
            if len(fates) == 2:
                picture = b""
                while not picture:
                    kind, payload = await recorder.receive()
                    check(kind is not None, "the recorder was closed")
                    picture = payload if kind == BINARY else b""
                recorder.send(say(op="ack", sequence=struct.unpack_from("<Q", picture, 8)[0], stored=True))
            while sum(m["op"] == "credit" for m in raw.said) < granted + len(fates):  # before or after its fate
                await raw.receive()
        raw.shut()
    recorder.shut()
    got = [(f["number"], f["fate"], f.get("clause")) for f in fates]
    want = [(5, "refused", "7.10"), (6, "used", None), (5, "refused", "7.10"), (4, "refused", "5.8"), (6, "used", None)]
    check(got == want, f"{got} instead of {want}")
    check(fates[1]["sequence"] == fates[4]["sequence"], f"{fates[4]} names another picture than {fates[1]}")
    return "each is told its own fate; 4, never sent, is refused by clause 5.8"


if __name__ == "__main__":
    main()
