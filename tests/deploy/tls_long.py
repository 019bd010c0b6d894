#!/usr/bin/python3
"""The stream through nginx and TLS: what passes, what is refused, and that a slow viewer never sees old images."""

import asyncio
import json
import re
import socket

import websockets

from proxy import NAME, SITE, Proxy
from peer import PICTURE, WAIT_S, Program, check, expect, main, radiance, run
from still import frame

ARGUMENTS = ("--size", "320x180", "--samples", "1", "--quality", "95", "--method", "light", "--reseed", "--fps", "20",
             "--rate", "20")
CREDIT = 2  # unacknowledged pictures per viewer


def skies(folder):
    """Two skies that read quickly, alternating for ever."""
    for number in range(2):
        (folder / f"sky.{number}.hdr").write_bytes(radiance(100 + number))
    return "--source", str(folder / "sky.%d.hdr")


async def connect(proxy, receive=None, origin=None):
    """A viewer's connection; `receive`: size of its kernel buffer."""
    s = socket.socket()
    if receive:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive)
    s.connect(("127.0.0.1", proxy.port))
    return await websockets.connect(
        f"wss://{NAME}:{proxy.port}/ws", sock=s, ssl=proxy.trust(), server_hostname=NAME, subprotocols=["relight.v1"],
        origin=origin or f"https://{NAME}:{proxy.port}", compression=None, max_size=None, ping_interval=None, max_queue=1, read_limit=4096)


class Viewer:
    def __init__(self, link):
        self.link = link
        self.pictures = []  # time of publication of each (wall clock, microseconds), and its size

    @classmethod
    async def come(cls, proxy, token=None, **how):
        link = await connect(proxy, **how)
        hello = {"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}
        await link.send(json.dumps(hello | ({"token": token} if token else {})))
        await link.send(json.dumps({"op": "subscribe", "format": "jpeg"}))
        return cls(link)

    async def take(self, until):
        while not until():
            message = await asyncio.wait_for(self.link.recv(), WAIT_S)
            if isinstance(message, bytes):
                fields = PICTURE.unpack_from(message)
                self.pictures.append((fields[7], len(message)))
                await self.link.send(json.dumps({"op": "ack", "sequence": fields[4]}))


async def the_page_and_its_pictures_come_through_tls(folder):
    async with Proxy(folder, *ARGUMENTS, *skies(folder), "--token-viewer", "secret") as proxy:
        status, page = proxy.request("/")
        check(status == 200 and b"<canvas" in page and b"content-security-policy" in page.lower(), page[:600])
        for script in re.findall(rb'(?:src|href)="([a-z_]+\.(?:js|css))"', page):
            check(proxy.request("/" + script.decode())[0] == 200, f"no {script}")
        check(proxy.request("/metrics")[0] == 404, "the world sees the metrics")
        check(proxy.request("/", name="evil.example")[0] == 403, "any name is answered to")
        status, answer = proxy.request("/x?y", plain=True)
        check(status == 301 and f"https://{NAME}".encode() in answer, answer)
        viewer = await Viewer.come(proxy, token="secret")
        await viewer.take(lambda: len(viewer.pictures) >= 10)
        viewer.link.transport.abort()
        try:
            await connect(proxy, origin="https://evil.example")
            check(False, "a page of others is let in")
        except websockets.InvalidStatusCode as refused:
            check(refused.status_code == 403, f"{refused}")
        check("warn" not in proxy.log("nginx") and "error" not in proxy.log("nginx"), proxy.log("nginx"))


async def a_viewer_that_stalls_is_shown_the_present_again(folder):
    """While it reads nothing forty pictures pass; it may get only those already under way. Another viewer continues
    meanwhile."""
    async with Proxy(folder, *ARGUMENTS, *skies(folder)) as proxy:
        slow = await Viewer.come(proxy, receive=16384)
        quick = await Viewer.come(proxy)
        await slow.take(lambda: len(slow.pictures) >= 3)
        before = len(quick.pictures)
        await quick.take(lambda: len(quick.pictures) >= before + 40)
        late, seen = quick.pictures[-5][0], len(slow.pictures)
        await slow.take(lambda: slow.pictures[-1][0] >= late)
        old = sum(published < late for published, _ in slow.pictures[seen:])
        print(f"40 pictures of {quick.pictures[-1][1]} bytes passed, {old} old ones came")
        check(old <= CREDIT + 1, f"{old} pictures of the past")


async def a_producer_sends_through_tls(folder):
    """A frame larger than any buffer on the way."""
    async with Proxy(folder, "--size", "64x36", "--samples", "1", "--source", "push:", "--token-producer", "p") as proxy:
        viewer = await Viewer.come(proxy)
        link = await connect(proxy)
        await link.send(json.dumps({"op": "hello", "role": "producer", "version": {"major": 1, "minor": 0}, "token": "p"}))
        payload = radiance(100, size=(512, 256))
        check(len(payload) > 1 << 18, f"{len(payload)} bytes")
        await link.send(frame(1, payload))
        await viewer.take(lambda: viewer.pictures)
        link.transport.abort()  # a clean close would have to read everything received since


async def feeder_and_recorder_work_through_nginx(folder):
    """And each says what is wrong where it speaks TLS to a plain port, or the other way round."""
    async with Proxy(folder, "--size", "64x36", "--samples", "1", "--method", "mis", "--source", "push:") as proxy:
        to = (f"wss://localhost:{proxy.port}", "--ca", folder / "fullchain.pem")
        sky = ("--frames", "1-3", "sky:size=64x32")
        record = await Program("relight-record", "--recorder", "day", "--json", "--out", folder / "%d.exr", "--from", *to).start()
        expect(await run("relight-feed", "--lockstep", "--sequence", "day", "--to", *to, *sky), 0)
        expect(await record.end(), 0)
        check(record.summary()["stored"] == 3, record.out)
        # nginx answers 400 by plain HTTP on its TLS port, and with plain HTTP to a TLS handshake
        expect(await run("relight-feed", "--retry", "0", "--to", f"ws://localhost:{proxy.port}", *sky), 3,
               f"if this server uses TLS, connect to wss://localhost:{proxy.port}")
        expect(await run("relight-feed", "--retry", "0", "--to", f"wss://localhost:{proxy.plain}", *to[1:], *sky), 1,
               f"if this server does not use TLS, connect to ws://localhost:{proxy.plain}")


async def the_site_bounds_what_it_holds_back(folder):
    text = SITE.read_text()
    for setting in ("sndbuf=", "proxy_buffering off;", "proxy_request_buffering off;", "proxy_buffer_size 16k;",
                    "tcp_nodelay on;", "proxy_http_version 1.1;"):
        check(setting in text, f"no {setting}")
    check("http2" not in re.sub("#.*", "", text), "HTTP/2 is offered")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
