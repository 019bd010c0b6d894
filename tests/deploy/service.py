#!/usr/bin/python3
"""relightd under a fake service manager, a datagram socket: the messages of sd_notify(3), and their times."""

import asyncio
import ctypes
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "integration"))
from peer import BIN, WAIT_S, check, main, skip  # noqa: E402


class Manager:
    """Starts relightd as systemd does; .words are the received messages, (name, value), in order."""

    def __init__(self, folder, *arguments, abstract=False, watchdog_us=None):
        self.arguments = arguments
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        name = f"\0relightd-test-{os.getpid()}" if abstract else str(folder / "notify")
        self.socket.bind(name)
        self.environment = dict(os.environ, NOTIFY_SOCKET=name.replace("\0", "@"), XDG_CACHE_HOME=str(folder))
        if watchdog_us:
            self.environment["WATCHDOG_USEC"] = str(watchdog_us)
        self.words = []

    async def __aenter__(self):
        # Not asyncio's: its child watcher would be notified of stopped threads.
        self.file = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            [str(BIN / "relightd"), "--port", "0", "--size", "64x36", "--samples", "4", *self.arguments],
            env=self.environment, stderr=self.file)
        return self

    async def __aexit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.file.close()
        self.socket.close()

    def log(self):
        # the program writes at the same file offset, which a seek here would move
        return os.pread(self.file.fileno(), os.fstat(self.file.fileno()).st_size, 0).decode()

    async def ended(self):
        """The exit code."""
        for _ in range(WAIT_S * 20):
            if self.process.poll() is not None:
                return self.process.returncode
            await asyncio.sleep(0.05)
        check(False, f"it does not end: {self.log()}")

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
            check(self.process.poll() is None, f"it ended: {self.log()}")
            await asyncio.sleep(0.05)
        check(False, f"it does not come: {self.words} {self.log()}")

    async def stop(self):
        self.process.terminate()
        code = await self.ended()
        self.listen()
        return code



async def ready_comes_once_with_the_first_picture(folder):
    async with Manager(folder) as m:
        await m.until(lambda: m.count("READY"))
        check("listening on " in m.log(), "ready before it listens")
        names = [name for name, _ in m.words]
        check("EXTEND_TIMEOUT_USEC" in names[:names.index("READY")], f"the start is not extended: {m.words}")
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
        check(await m.ended() == 1, "exit code")
        m.listen()
        check(not m.count("READY"), f"{m.words}")


async def sentences_come_now_and_then_only(folder):
    async with Manager(folder, "--source", "sky:speed=1440") as m:
        begun = time.monotonic()  # of which none has come before
        await m.until(lambda: m.count("STATUS") >= 5)
        check(time.monotonic() - begun > 3, "the third to fifth sentence came within three seconds")
        for name, value in m.words:
            check(name != "STATUS" or re.fullmatch(r"[A-Z].*\.", value), f"no sentence: {value}")


class Frozen:
    """Stops one thread with ptrace(2), which only needs to be its parent: the others keep running."""

    SEIZE, INTERRUPT, DETACH = 0x4206, 0x4207, 17

    def __init__(self, thread):
        self.thread = thread
        self.libc = ctypes.CDLL(None, use_errno=True)
        self.libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]

    def ask(self, request):
        return self.libc.ptrace(request, self.thread, None, None)

    def __enter__(self):
        if self.ask(self.SEIZE) != 0:
            skip("threads cannot be traced here")
        check(self.ask(self.INTERRUPT) == 0, "a thread cannot be held")
        os.waitpid(self.thread, 0x40000000)  # __WALL
        return self

    def __exit__(self, *_):
        self.ask(self.DETACH)


def network_thread(pid):
    """The thread waiting in poll(2); None: not found."""
    polling = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        if (task / "wchan").read_text().startswith(("do_sys_poll", "poll_schedule", "do_poll")) or \
                (task / "syscall").read_text().split()[0] in ("7", "271"):
            polling.append(int(task.name))
    return polling[0] if len(polling) == 1 else None


async def silent_while_frozen(m, thread):
    """WATCHDOG=1 stops at most SERVER_BEAT_MS and one check after the thread stops, and resumes with it."""
    with Frozen(thread):
        for _ in range(10):  # the thread that says it may be late on a busy machine, but not each time
            await asyncio.sleep(3.5)
            m.listen()
            before = m.count("WATCHDOG")
            await asyncio.sleep(3)
            m.listen()
            if m.count("WATCHDOG") == before:
                break
        check(m.count("WATCHDOG") == before, f"it is said to live while it hangs: {m.words[-5:]}")
    await m.until(lambda: m.count("WATCHDOG") >= before + 3)


async def the_watchdog_hears_of_a_server_that_lives(folder):
    async with Manager(folder, watchdog_us=2000000) as m:
        await m.until(lambda: m.count("WATCHDOG") >= 8 and m.count("READY"))
        check(await m.stop() == 0, "exit code")


async def a_server_nobody_watches_says_no_watchdog(folder):
    async with Manager(folder) as m:
        await m.until(lambda: m.count("READY"))
        await asyncio.sleep(2)
        m.listen()
        check(m.count("WATCHDOG") == 0, f"{m.words}")


async def a_hanging_shader_is_not_said_to_live(folder):
    async with Manager(folder, watchdog_us=2000000) as m:
        await m.until(lambda: m.count("WATCHDOG") >= 2 and m.count("READY"))
        await silent_while_frozen(m, m.process.pid)


async def a_hanging_network_is_not_said_to_live(folder):
    async with Manager(folder, watchdog_us=2000000) as m:
        await m.until(lambda: m.count("WATCHDOG") >= 2 and m.count("READY"))
        await asyncio.sleep(0.5)
        thread = network_thread(m.process.pid)
        if thread is None:
            skip("its network thread cannot be told from the others here")
        await silent_while_frozen(m, thread)


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
