#!/usr/bin/python3
"""Cost of a viewer: crowd.py [VIEWERS=200] [SECONDS=10]. relightd sends 30 pictures per second to so many viewers on this machine,
then to one: the difference in CPU time of its network thread is their cost, since a picture is made and encoded once for all. Then nginx
serves a file of that size equally often to as many. One line of JSON each; nothing is asserted, times depend on the machine. RELIGHT_NGINX
names an nginx that is not on the path."""

import asyncio
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from faults import BIN, Relightd, Viewer, check

RATE = 30


def processor_s(pid):
    """Of each thread of a process."""
    times = {}
    for stat in Path(f"/proc/{pid}/task").glob("[0-9]*/stat"):
        fields = stat.read_text(encoding="ascii", errors="replace").rsplit(")", 1)[1].split()
        times[stat.parent.name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return times


async def crowd(pid, port, viewers, seconds, *path):
    """What came, and the server's processor time per second, by threads."""
    begun = processor_s(pid)
    process = await asyncio.create_subprocess_exec(str(BIN / "crowd"), str(port), str(viewers), str(RATE), str(seconds), *path,
                                                   stdout=asyncio.subprocess.PIPE)
    out, _ = await process.communicate()
    check(process.returncode == 0, "the crowd failed")
    came = json.loads(out)
    return came, {thread: (s - begun.get(thread, 0.0)) / came["seconds"] for thread, s in processor_s(pid).items()}


async def relightd(viewers, seconds):
    async with Relightd("--size", "320x180", "--method", "mis", "--samples", "1", "--fps", str(RATE), "--converge", "off",
                        "--no-h264", "--max-connections", str(viewers + 16), source="sky:size=64x32") as server:
        async with Viewer(server) as viewer:
            await viewer.sees(RATE, 30)
        few, alone = await crowd(server.pid, server.port, 1, seconds)
        many, full = await crowd(server.pid, server.port, viewers, seconds)
    size = many["bytes"] // max(1, many["messages"])
    network = max(full, key=lambda thread: full[thread] - alone.get(thread, 0.0))  # the thread that viewers cost
    report("relightd", viewers, many, (full[network] - alone.get(network, 0.0)) / (viewers - 1), size)
    return size


def report(name, viewers, came, cost, size):
    print(json.dumps({"server": name, "viewers": viewers, "messages_per_viewer_per_second":
                      round(came["messages"] / viewers / came["seconds"], 1), "bytes_per_message": size,
                      "processor_percent_per_viewer": round(100 * cost, 3), "microseconds_per_message":
                      round(1e6 * cost * viewers * came["seconds"] / max(1, came["messages"]), 1)}), flush=True)


async def nginx(viewers, seconds, size):
    program = os.environ.get("RELIGHT_NGINX") or shutil.which("nginx")
    if not program:
        print("nginx is not installed")
        return
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        Path(folder, "picture").write_bytes(os.urandom(size))
        Path(folder, "conf").write_text(f"""
            daemon off; master_process off; pid {folder}/pid; error_log {folder}/log;
            events {{ worker_connections 1024; }}
            http {{ access_log off; keepalive_requests 1000000; sendfile on; tcp_nodelay on; open_file_cache max=10;
                    client_body_temp_path {folder}; proxy_temp_path {folder}; fastcgi_temp_path {folder};
                    uwsgi_temp_path {folder}; scgi_temp_path {folder};
                    server {{ listen 127.0.0.1:18231; root {folder}; }} }}""", encoding="ascii")
        process = subprocess.Popen([program, "-e", f"{folder}/log", "-c", f"{folder}/conf"])
        try:
            await asyncio.sleep(1)
            await crowd(process.pid, 18231, viewers, 2, "/picture")
            came, cost = await crowd(process.pid, 18231, viewers, seconds, "/picture")
        finally:
            process.terminate()
            process.wait()
    report("nginx", viewers, came, sum(cost.values()) / viewers, came["bytes"] // max(1, came["messages"]))


async def both(viewers, seconds):
    await nginx(viewers, seconds, await relightd(viewers, seconds))


if __name__ == "__main__":
    asyncio.run(both(int(sys.argv[1]) if len(sys.argv) > 1 else 200, int(sys.argv[2]) if len(sys.argv) > 2 else 10))
