#!/usr/bin/python3
"""relightd behind nginx for tests in other languages: prints the address, and stops both at the end of input."""

import asyncio
import sys
import tempfile
from pathlib import Path

from proxy import Proxy
from peer import Skipped


async def run(folder):
    async with Proxy(folder, *sys.argv[1:]) as proxy:
        print(f"https://localhost:{proxy.port}/", flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)


with tempfile.TemporaryDirectory() as name:
    try:
        asyncio.run(run(Path(name)))
    except Skipped as why:
        print("skipped:", why, flush=True)
