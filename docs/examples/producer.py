#!/usr/bin/python3
"""A relight.v1 producer: a lamp that moves once around the horizon under a blue sky, sent as raw float texels.
usage: producer.py ws://127.0.0.1:8080 [FRAMES]        needs websockets (Debian: apt install python3-websockets)"""
import asyncio, json, struct, sys, time
import websockets

WIDTH, HEIGHT = 64, 32


def frame(number, count):
    """A binary message: PROTOCOL.md, section 7. Lat-long, top row first, linear Rec.709 radiance."""
    texels = []
    for y in range(HEIGHT):
        for x in range(WIDTH):
            lamp = y in (10, 11) and (x - number * WIDTH // count) % WIDTH < 2
            texels += (400, 320, 200) if lamp else (0.2, 0.4, 0.8) if y < HEIGHT // 2 else (0.1, 0.1, 0.1)
    payload = struct.pack(f"<{len(texels)}f", *texels)
    return struct.pack("<4sHBBBBHIIIQqQ", b"RLE1", 48, 4, 1, 0, 3, 0, WIDTH, HEIGHT, len(payload), number,
                       time.time_ns() // 1000, 0) + payload


async def produce(url, count):
    async with websockets.connect(url + "/ws", subprotocols=["relight.v1"], compression=None) as server:
        await server.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 2}}))
        credit = sent = settled = 0
        while settled < count:
            message = json.loads(await server.recv())
            if message["op"] == "welcome":
                credit = message["producer"]["credit"]
            elif message["op"] == "credit":
                credit += message["frames"]
            elif message["op"] == "frame":
                settled += 1
                print("frame", message["number"], message["fate"], message.get("message", ""))
            while credit and sent < count:
                await server.send(frame(sent, count))
                sent, credit = sent + 1, credit - 1
        await server.send(json.dumps({"op": "end"}))

asyncio.run(produce(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 48))
