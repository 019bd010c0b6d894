"""Waits for the first picture of the relightd at that address, and for its page. Exit code 0: both arrived."""

import asyncio
import json
import sys
import urllib.request

import websockets

WAIT_S = 600  # ends a hang


async def main(url):
    with urllib.request.urlopen(url, timeout=WAIT_S) as page:
        assert b"<canvas" in page.read()
    async with websockets.connect(url.replace("http", "ws") + "ws", subprotocols=["relight.v1"], compression=None,
                                  max_size=None, ping_interval=None, max_queue=None) as link:
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}))
        await link.send(json.dumps({"op": "subscribe", "format": "jpeg"}))
        while not isinstance(message := await link.recv(), bytes):
            pass
        assert b"\xff\xd8\xff" in message  # start of a JPEG file


asyncio.run(asyncio.wait_for(main(sys.argv[1]), WAIT_S))
