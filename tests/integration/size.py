#!/usr/bin/python3
"""A viewer that limits the picture size (PROTOCOL.md 4.3.7), with an independent WebSocket library."""

import asyncio
import json
import struct

import websockets

from peer import BIN, WAIT_S, check, main


async def picture_sizes(url, wishes):
    """Width, height and flags of the first picture of each subscription, and the JPEG's own size."""
    found = []

    async with websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, ping_interval=None, max_queue=None) as link:
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 0}}))
        for request, wish in enumerate(wishes, 1):
            await link.send(json.dumps({"op": "subscribe", "format": "jpeg", "request": request, **wish}))
            answered = False
            while True:
                message = await asyncio.wait_for(link.recv(), WAIT_S)
                if isinstance(message, str):
                    said = json.loads(message)
                    answered = answered or (said["op"] == "subscribed" and said["request"] == request)
                    check(said["op"] != "error", message)
                    continue
                sequence = struct.unpack_from("<Q", message, 8)[0]
                width, height = struct.unpack_from("<II", message, 56)
                await link.send(json.dumps({"op": "ack", "sequence": sequence}))
                if answered:
                    frame = message.index(b"\xff\xc0", 80)  # baseline start of frame: precision, height, width
                    found.append((width, height, message[7] & 24, *struct.unpack_from(">HH", message, frame + 5)[::-1]))
                    break
    return found


async def a_viewer_gets_no_larger_picture_than_it_takes(folder):
    server = await asyncio.create_subprocess_exec(
        str(BIN / "relightd"), "--port", "0", "--size", "200x120", "--samples", "2", "--paths", "direct", "--edge-rays", "1",
        stderr=asyncio.subprocess.PIPE)
    try:
        line = ""
        while "listening on " not in line:
            line = (await asyncio.wait_for(server.stderr.readline(), WAIT_S)).decode()
            check(line, "relightd ended")
        url = line.split("listening on ")[1].strip().replace("http", "ws") + "ws"
        found = await picture_sizes(url, [{}, {"max_width": 199}, {"max_height": 30}, {"max_width": 100}, {"max_width": 1},
                                          {"max_width": 200, "max_height": 120}])
    finally:
        server.terminate()
        await server.wait()
    whole, half, quarter = (200, 120, 0, 200, 120), (100, 60, 8, 100, 60), (50, 30, 16, 50, 30)
    check(found == [whole, half, quarter, half, quarter, whole], str(found))


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
