#!/usr/bin/python3
"""What HLS viewers cost relightd: hls_crowd.py [CLIENTS=500] [SECONDS=20] [ROUNDS=3]. relightd publishes to a folder, nginx serves it with
deploy/nginx-hls.conf without TLS. Rounds with one client and with many alternate; each client reads the playlist every second and
every new segment. One line of JSON for each round: relightd's and nginx's processor time. Nothing is asserted: times depend on the
machine. RELIGHT_BIN names the programs."""

import asyncio
import json
import os
import random
import re
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from hls import Site
from proxy import substituted
from peer import BIN, SKIPPED, WAIT_S, Skipped, check, skip


class Plain(Site):
    """Without TLS, which would cost the clients more than all else."""

    def site(self):
        return substituted(super().site(), (r"ssl http2;", ";", 1))


def processor_s(pid):
    """Of a process and its children."""
    children = [int(stat.parent.name) for stat in Path("/proc").glob("[0-9]*/stat") if parent(stat) == pid]
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK") + sum(map(processor_s, children))


def parent(stat):
    try:
        return int(stat.read_text(encoding="ascii", errors="replace").rsplit(")", 1)[1].split()[1])
    except OSError:
        return 0


class Client:
    def __init__(self, port):
        self.port = port
        self.segments = self.bytes = 0

    async def get(self, path):
        self.writer.write(f"GET /hls/{path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        head = await self.reader.readuntil(b"\r\n\r\n")
        check(head.startswith(b"HTTP/1.1 200"), head.decode())
        body = await self.reader.readexactly(int(re.search(rb"Content-Length: (\d+)", head)[1]))
        self.bytes += len(body)
        return body

    async def watch(self, until):
        await asyncio.sleep(random.random())  # they do not come at once
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", self.port, limit=1 << 20)
        seen = None
        while time.monotonic() < until:
            names = re.findall(r"(?m)^[^#\s]+$", (await self.get("live.m3u8")).decode())
            for name in names[-2:] if seen not in names else names[names.index(seen) + 1:]:
                await self.get(name)
                self.segments += 1
                seen = name
            await asyncio.sleep(1)
        self.writer.close()


def pictures(url):
    with urllib.request.urlopen(url + "metrics", timeout=WAIT_S) as answer:
        return float(re.search(r'relightd_frames_total\{fate="shaded"[^}]*\} (\S+)', answer.read().decode())[1])


async def measure(count, seconds, site, relightd, url):
    clients = [Client(site.port) for _ in range(count)]
    nginx = site.processes[0].pid
    begun = time.monotonic(), processor_s(relightd), processor_s(nginx), pictures(url)
    await asyncio.gather(*(client.watch(begun[0] + seconds) for client in clients))
    took = time.monotonic() - begun[0]
    made = pictures(url) - begun[3]
    spent = processor_s(relightd) - begun[1]
    print(json.dumps({"clients": count, "seconds": round(took, 1), "pictures": int(made), "relightd_processor_s": round(spent, 2),
                      "relightd_ms_per_picture": round(1000 * spent / max(1, made), 2),
                      "nginx_processor_s": round(processor_s(nginx) - begun[2], 2), "segments": sum(c.segments for c in clients),
                      "megabytes": round(sum(c.bytes for c in clients) / 1e6, 1)}), flush=True)


async def crowd(clients, seconds, rounds):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with Plain(folder) as site:
            relightd = site.start(str(BIN / "relightd"), "--port", "0", "--size", "320x180", "--method", "mis", "--samples", "1", "--paths", "direct", "--fps", "5",
                                  "--converge", "off", "--source", "sky:size=64x32,speed=10", "--publish", f"hls:{site.hls}")
            for _ in range(WAIT_S * 10):
                if (address := re.search(r"listening on (http://\S+)", site.log("relightd"))) and (site.hls / "live.m3u8").exists():
                    break
                if relightd.poll() is not None:
                    skip(site.log("relightd"))
                await asyncio.sleep(0.1)
            await asyncio.sleep(5)
            for _ in range(rounds):
                for count in (1, clients):
                    await measure(count, seconds, site, relightd.pid, address[1])


if __name__ == "__main__":
    try:
        asyncio.run(crowd(*(int(given) if given else standard for given, standard in zip(sys.argv[1:] + 3 * [""], (500, 20, 3)))))
    except Skipped as why:
        print("skipped:", why)
        sys.exit(SKIPPED)
