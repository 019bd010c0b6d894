#!/usr/bin/python3
"""The systemd unit's restrictions against relightd's behaviour: its system calls, socket families and memory
mappings, as observed by strace(1), are all allowed."""

import asyncio
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "integration"))
from peer import BIN, WAIT_S, check, main, radiance, skip  # noqa: E402

UNIT = (Path(__file__).parent.parent.parent / "deploy" / "relightd.service").read_text()


def settings(name):
    return [line.split("=", 1)[1] for line in UNIT.splitlines() if line.startswith(name + "=")]


def groups():
    """systemd's named sets of system calls, with nested sets resolved."""
    if not shutil.which("systemd-analyze"):
        skip("no systemd-analyze here")
    sets, name = {}, None
    for line in subprocess.run(["systemd-analyze", "syscall-filter"], capture_output=True, text=True).stdout.splitlines():
        if line.startswith("@"):
            name = line.split()[0]
            sets[name] = set()
        elif name and re.match("    [@a-z]", line):
            sets[name].add(line.strip())
    def calls(of):
        return set().union(*(calls(x) if x.startswith("@") else {x} for x in sets[of]))
    return {name: calls(name) for name in sets}


async def trace(folder, until, *arguments):
    """The lines of strace over a start, `until` (a function of its address, or a text in its log), and a shutdown."""
    if not shutil.which("strace"):
        skip("no strace here")
    # As under the unit, without any capability, also where root runs this.
    without = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    process = await asyncio.create_subprocess_exec(
        *without, "strace", "-f", "-qq", "-o", str(folder / "calls"), str(BIN / "relightd"), "--port", "0", "--size", "64x36",
        "--samples", "4", "--state", str(folder), *arguments, stderr=asyncio.subprocess.PIPE,
        env={"XDG_CACHE_HOME": str(folder), "NOTIFY_SOCKET": "@nobody", "WATCHDOG_USEC": "1000000"})
    text = ""
    while (until if isinstance(until, str) else "listening on ") not in text:
        line = (await asyncio.wait_for(process.stderr.readline(), WAIT_S)).decode()
        check(line, f"it ended: {text}")
        text += line
    if not isinstance(until, str):
        await until(re.search(r"listening on http(\S+)", text).group(1))
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    check(len(children) == 1, f"{children}")
    subprocess.run(["kill", children[0]], check=True)
    await asyncio.wait_for(process.communicate(), WAIT_S)
    lines = (folder / "calls").read_text().splitlines()
    if len(lines) < 100:
        skip("nothing can be traced here")
    return lines


def hold(lines):
    """Checks that the unit allows them."""
    sets = groups()
    filters = settings("SystemCallFilter")
    check(filters == ["@system-service seccomp", "~@privileged"], f"another filter than is known here: {filters}")
    allowed = (sets["@system-service"] | sets["@default"] | {"seccomp"}) - sets["@privileged"]
    made = {m.group(1) for line in lines if (m := re.match(r"\d+ +([a-z_0-9]+)\(", line))}
    check({"socket", "listen", "futex"} <= made, f"what was traced? {made}")
    check(made <= allowed, f"forbidden, and made: {made - allowed}")
    families = set(re.findall(r" (?:socket|socketpair)\((AF_[A-Z0-9]+)", "\n".join(lines)))
    check(families and families <= set(settings("RestrictAddressFamilies")[0].split()), f"kinds of sockets: {families}")
    both = [line for line in lines if re.search(r"PROT_WRITE\|PROT_EXEC", line)]
    check(settings("MemoryDenyWriteExecute") == ["yes"] and not both, f"memory that is written and run: {both[:3]}")
    return made


async def all_that_it_does_is_allowed_by_the_unit(folder):
    hold(await trace(folder, "kept in", "--method", "cached"))


async def what_the_decoder_does_is_allowed_as_well(folder):
    (folder / "sky.hdr").write_bytes(radiance(100))
    async def feed(url):
        process = await asyncio.create_subprocess_exec(str(BIN / "relight-feed"), "--to", "ws" + url, "--quiet",
                                                       str(folder / "sky.hdr"))
        check(await asyncio.wait_for(process.wait(), WAIT_S) == 0, "the frame is not taken")
    lines = await trace(folder, feed, "--source", "push:")
    hold(lines)
    check(any("execve(" in line and "relight-decoder" in line for line in lines), "no decoder was started")
    check(any("SECCOMP" in line for line in lines), "it is not confined")


async def what_the_reader_does_is_allowed_as_well(folder):
    scene = Path(__file__).parent.parent.parent / "docs" / "examples" / "ring.json"
    lines = await trace(folder, "listening on ", "--scene", str(scene))
    hold(lines)
    check(any("execve(" in line and "relight-reader" in line for line in lines), "no reader was started")
    check(any("SECCOMP" in line for line in lines), "it is not confined")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f) and name != "trace"})
