#!/usr/bin/python3
"""A viewer while the server computes the light-transport cache (PROTOCOL.md 4.8.8), with an independent WebSocket
library."""

import asyncio
import json
import struct

import websockets

from peer import BIN, WAIT_S, check, main


async def shares_and_pictures(url):
    """The reported shares until the last one, and the number of images in between."""
    shares, pictures = [], 0

    async with websockets.connect(url, subprotocols=["relight.v1"], compression=None, max_size=None, ping_interval=None, max_queue=None) as link:
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 0}}))
        await link.send(json.dumps({"op": "subscribe", "format": "jpeg", "request": 1}))
        while True:
            message = await asyncio.wait_for(link.recv(), WAIT_S)
            if isinstance(message, bytes):
                await link.send(json.dumps({"op": "ack", "sequence": struct.unpack_from("<Q", message, 8)[0]}))
                pictures += bool(shares)
                continue
            said = json.loads(message)
            check(said["op"] != "error", message)
            if said["op"] != "status":
                continue
            share = said["light"]["computed"]
            if share is not None:
                shares.append(share)
            elif shares:
                return shares, pictures


async def a_viewer_is_told_how_much_is_computed(folder):
    server = await asyncio.create_subprocess_exec(
        str(BIN / "relightd"), "--port", "0", "--size", "64x36", "--rate", "5", "--method", "cached", "--paths", "direct",
        "--cache-file", "off",
        stderr=asyncio.subprocess.PIPE)
    try:
        line = ""
        while "listening on " not in line:
            line = (await asyncio.wait_for(server.stderr.readline(), WAIT_S)).decode()
            check(line, "relightd ended")
        shares, pictures = await shares_and_pictures(line.split("listening on ")[1].strip().replace("http", "ws") + "ws")
    finally:
        server.terminate()
        await server.wait()
    check(all(0 <= a <= b < 1 for a, b in zip(shares, shares[1:])), str(shares))
    check(len(shares) > 1 and pictures > 0, f"while it was computed came {pictures} pictures and the shares {shares}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
