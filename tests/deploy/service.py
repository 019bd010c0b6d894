#!/usr/bin/python3
"""relightd under a service manager, played by a datagram socket: sd_notify(3)'s words, and when they come."""

import asyncio
import os
import re
import signal
import socket
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "integration"))
from peer import BIN, WAIT_S, check, main  # noqa: E402


class Manager:
    """Starts relightd as systemd does; .words are the words that came, (name, value), in order."""

    def __init__(self, folder, *arguments, abstract=False, watchdog_us=None):
        self.arguments = arguments
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        name = f"\0relightd-test-{os.getpid()}" if abstract else str(folder / "notify")
        self.socket.bind(name)
        self.environment = dict(os.environ, NOTIFY_SOCKET=name.replace("\0", "@"), XDG_CACHE_HOME=str(folder))
        if watchdog_us:
            self.environment["WATCHDOG_USEC"] = str(watchdog_us)
        self.words = []
        self.url = None

    async def __aenter__(self):
        self.process = await asyncio.create_subprocess_exec(
            str(BIN / "relightd"), "--port", "0", "--size", "64x36", "--samples", "4", *self.arguments,
            env=self.environment, stderr=asyncio.subprocess.PIPE)
        self.log = []
        self.reader = asyncio.create_task(self.read())
        return self

    async def __aexit__(self, *_):
        if self.process.returncode is None:
            self.process.kill()
        await self.process.wait()
        await self.reader
        self.socket.close()

    async def read(self):
        while line := (await self.process.stderr.readline()).decode():
            self.log.append(line)
            if "listening on " in line:
                self.url = line.split("listening on ")[1].strip()

    def listen(self):
        while True:
            try:
                text = self.socket.recv(4096).decode()
            except BlockingIOError:
                return
            for line in text.split("\n"):
                name, equals, value = line.partition("=")
                check(equals and re.fullmatch("[A-Z_]+", name), f"no word of sd_notify: {text!r}")
                self.words.append((name, value))

    def count(self, name):
        return sum(word[0] == name for word in self.words)

    async def until(self, what, seconds=WAIT_S):
        for _ in range(int(seconds * 20)):
            self.listen()
            if what():
                return
            check(self.process.returncode is None, f"it ended: {self.log}")
            await asyncio.sleep(0.05)
        check(False, f"it does not come: {self.words} {self.log}")

    async def stop(self):
        self.process.terminate()
        code = await asyncio.wait_for(self.process.wait(), WAIT_S)
        self.listen()
        return code



async def ready_comes_once_with_the_first_picture(folder):
    async with Manager(folder) as m:
        await m.until(lambda: m.count("READY"))
        check(m.url, "ready before it listens")
        names = [name for name, _ in m.words]
        check(names[0] == "EXTEND_TIMEOUT_USEC", f"the start is not extended: {m.words}")
        await m.until(lambda: any("Showing frame" in value for name, value in m.words if name == "STATUS"))
        check(await m.stop() == 0, "exit code")
        check(m.count("READY") == 1, f"not ready once: {m.words}")
        check(m.words[-2:] == [("STOPPING", "1"), ("STATUS", "Stopping.")], f"it does not say that it stops: {m.words}")


async def a_server_that_waits_for_a_producer_is_ready(folder):
    async with Manager(folder, "--source", "push:", abstract=True) as m:
        await m.until(lambda: m.count("READY"))
        await m.until(lambda: ("STATUS", "Waiting: no producer has sent a frame yet.") in m.words)
        check(await m.stop() == 0, "exit code")


async def a_failed_start_is_never_ready(folder):
    async with Manager(folder, "--source", str(folder / "nowhere.exr")) as m:
        check(await asyncio.wait_for(m.process.wait(), WAIT_S) == 1, "exit code")
        m.listen()
        check(not m.count("READY"), f"{m.words}")


async def sentences_come_now_and_then_only(folder):
    async with Manager(folder, "--source", "sky:speed=1440") as m:
        await m.until(lambda: m.count("STATUS") >= 2)
        before = m.count("STATUS")
        await asyncio.sleep(5)
        m.listen()
        check(1 <= m.count("STATUS") - before <= 3, f"{m.count('STATUS') - before} sentences in 5 s")
        for name, value in m.words:
            check(name != "STATUS" or re.fullmatch(r"[A-Z].*\.", value), f"no sentence: {value}")
        m.process.send_signal(signal.SIGTERM)


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
