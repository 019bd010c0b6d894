#!/usr/bin/python3
"""relightd's configuration: the file that mirrors its flags, token files, and SIGHUP."""

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "integration"))
import websockets  # noqa: E402

from peer import BIN, WAIT_S, check, main  # noqa: E402

SMALL = {"port": 0, "size": "64x36", "samples": 4}
BAD_TOKEN = 4006


def write(path, text, mode=0o600):
    path.write_text(text if isinstance(text, str) else json.dumps(text, indent=1))
    path.chmod(mode)
    return path


def run(*arguments, **environment):
    """Exit code, standard output, lines of standard error."""
    done = subprocess.run([str(BIN / "relightd"), *map(str, arguments)], capture_output=True, text=True, timeout=WAIT_S,
                          env=dict(os.environ, **environment))
    return done.returncode, done.stdout, done.stderr.splitlines()


class Daemon:
    """relightd with a configuration file, and its log."""

    def __init__(self, file, *arguments, **environment):
        self.command = [str(BIN / "relightd"), "--config", str(file), *arguments]
        self.environment = dict(os.environ, XDG_CACHE_HOME=str(file.parent), **environment)

    async def __aenter__(self):
        self.file = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(self.command, stderr=self.file, env=self.environment)
        await self.says("listening on ")
        self.url = re.search(r"listening on http(.*)", self.log()).group(1)
        return self

    async def __aexit__(self, *_):
        self.process.terminate()
        self.process.wait()
        self.file.close()

    def log(self):
        # the program writes at the same file offset, which a seek here would move
        return os.pread(self.file.fileno(), os.fstat(self.file.fileno()).st_size, 0).decode()

    async def says(self, what, count=1):
        for _ in range(WAIT_S * 20):
            if self.log().count(what) >= count:
                return
            check(self.process.poll() is None, f"it ended: {self.log()}")
            await asyncio.sleep(0.05)
        check(False, f"no '{what}': {self.log()}")

    async def reload(self, count=1):
        self.process.send_signal(signal.SIGHUP)
        await self.says("reload: done", count)

    async def close_code(self, role, token):
        """The close code for a hello with that token; None: welcome."""
        async with websockets.connect("ws" + self.url + "ws", subprotocols=["relight.v1"], compression=None) as link:
            hello = {"op": "hello", "role": role, "version": {"major": 1, "minor": 1}}
            await link.send(json.dumps(hello | ({"token": token} if token else {})))
            try:
                while True:
                    if json.loads(await asyncio.wait_for(link.recv(), WAIT_S))["op"] == "welcome":
                        return None
            except websockets.ConnectionClosed as closed:
                return closed.code


def flags():
    """Names of all flags, and whether they take a value."""
    text = run("--help", "all")[1]
    return {name: bool(value) for name, value in re.findall(r"^  --([a-z0-9-]+)( [^ ]+)?", text, re.M)}


async def every_flag_may_stand_in_the_file(folder):
    """For each flag, a value of no flag is reported with that name and line, and nothing else is."""
    names = {name: value for name, value in flags().items()
             if name not in ("help", "version", "config", "check-config", "show-link")}
    check(len(names) > 50, f"too few flags: {names}")
    file = write(folder / "all.json", {name: {} for name in names})
    code, _, errors = run("--config", file)
    check(code == 2, f"exit code {code}")
    for line, (name, value) in enumerate(names.items(), start=2):
        wrong = "expected a string or a" if value else "is a switch; expected true or false"
        check(any(f"{file}:{line}: {name}: {wrong}" in error for error in errors), f"nothing of {name}: {errors}")
    check(len(errors) == len(names) + 1 and f"{len(names)} faults" in errors[-1], f"{errors[-1]}")


async def every_fault_is_told_with_file_line_and_key(folder):
    file = write(folder / "f.json", '{\n "port": 65536,\n "tone": "bright",\n "sky": 1,\n "fps": "30",\n "once": "no"}\n')
    code, _, errors = run("--check-config", "--config", file)
    check(code == 2, f"exit code {code}")
    check([e.removeprefix(f"relightd: error: {file}:") for e in errors[:-1]] == [
        "2: port: '65536' is not a whole number from 0 to 65535",
        next(e for e in errors if ":3: tone: " in e).removeprefix(f"relightd: error: {file}:"),
        "4: sky: relightd has no such flag",
        "6: once: is a switch; expected true or false"], f"{errors}")
    file = write(folder / "one.json", '{\n "port": -1 }')
    code, _, errors = run("--config", file)
    check(code == 2 and errors == [f"relightd: error: {file}:2: port: '-1' is not a whole number from 0 to 65535"],
          f"{code} {errors}")
    code, _, errors = run("--config", folder / "nowhere.json")
    check(code == 2 and len(errors) == 1 and "nowhere.json: cannot read the file" in errors[0], f"{code} {errors}")


async def a_good_file_is_ok_and_starts_nothing(folder):
    file = write(folder / "f.json", SMALL)
    code, out, errors = run("--check-config", "--config", file)
    check((code, out, errors) == (0, f"relightd: {file}: ok\n", []), f"{code} {out} {errors}")
    code, out, errors = run("--check-config", "--port", "0")
    check((code, out, errors) == (0, "relightd: the command line: ok\n", []), f"{code} {out} {errors}")
    file = write(folder / "g.json", SMALL | {"scene": "/nonexistent.json", "source": "/nonexistent/%d.exr",
                                             "bind": "0.0.0.0"})
    code, out, errors = run("--check-config", "--config", file)
    check(code == 2 and out == "" and len(errors) == 4, f"{code} {out} {errors}")
    for word in ("scene: /nonexistent.json", "source: ", "--bind 0.0.0.0", "3 faults"):
        check(any(word in error for error in errors), f"no '{word}': {errors}")


async def the_command_line_goes_before_the_file(folder):
    file = write(folder / "f.json", SMALL | {"bind": "127.0.0.9", "tone": "linear"})
    async with Daemon(file) as daemon:
        check("//127.0.0.9:" in daemon.url, daemon.url)
    async with Daemon(file, "--bind", "127.0.0.8") as daemon:
        check("//127.0.0.8:" in daemon.url, daemon.url)
    code, _, errors = run("--config", file, "--port", "x")
    check(code == 2 and errors == ["relightd: error: --port 'x' is not a whole number from 0 to 65535"], f"{errors}")
    file = write(folder / "g.json", SMALL | {"error": 0.1})
    code, _, errors = run("--config", file)
    check(code == 2 and errors == [f"relightd: error: {file}: --error needs --method auto without --samples"],
          f"{errors}")


async def tokens_come_from_files_of_their_own(folder):
    viewer = write(folder / "viewer", "from-a-file\n")
    loose = write(folder / "loose", "from-a-loose-file", 0o644)
    credentials = folder / "credentials"
    credentials.mkdir()
    write(credentials / "token-producer", "from-the-manager\n", 0o440)
    file = write(folder / "f.json", SMALL | {"source": "push:", "token-viewer-file": str(viewer),
                                             "token-controller-file": str(loose)}, 0o644)
    async with Daemon(file, CREDENTIALS_DIRECTORY=str(credentials)) as daemon:
        for role, token in (("viewer", "from-a-file"), ("controller", "from-a-loose-file"),
                            ("producer", "from-the-manager")):
            check(await daemon.close_code(role, token) is None, f"{role} is not let in")
            check(await daemon.close_code(role, "wrong") == BAD_TOKEN, f"{role} is let in with a wrong token")
        log = daemon.log()
        check(f"{loose} holds a token that other users can access (mode 644)" in log, log)
        check(log.count("holds a token") == 1 and "holds tokens" not in log, log)
        check("from-" not in log, f"a token is in the log: {log}")
    file = write(folder / "g.json", SMALL | {"token-viewer": "in-the-file"}, 0o640)
    async with Daemon(file) as daemon:
        check(f"{file} holds tokens or stream keys, and other users may read it" in daemon.log(), daemon.log())
    for bad, says in (("", "not a token of 1 to"), ("\n", "not a token of 1 to"), ("x" * 400, "not a token of 1 to"),
                      ("a\0b", "a byte that tokens cannot have")):
        write(viewer, bad)
        code, _, errors = run("--port", "0", "--token-viewer-file", viewer)
        check(code == 2 and len(errors) == 1 and says in errors[0], f"{code} {errors}")
    code, _, errors = run("--port", "0", "--token-viewer-file", viewer, "--token-viewer", "x")
    check(code == 2 and "exclude each other" in errors[0], f"{errors}")


async def status_of(daemon, token, what):
    """Waits for a status for which `what` holds."""
    async with websockets.connect("ws" + daemon.url + "ws", subprotocols=["relight.v1"], compression=None,
                                  max_size=None, ping_interval=None, max_queue=None) as link:
        await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1},
                                    "token": token}))
        async def hear():
            while True:
                message = await link.recv()
                if isinstance(message, str) and what(json.loads(message)):
                    return
        try:
            await asyncio.wait_for(hear(), WAIT_S)
        except asyncio.TimeoutError:
            check(False, f"it does not happen: {daemon.log()}")


async def sighup_changes_what_can_change_and_names_the_rest(folder):
    first = SMALL | {"token-viewer": "old-secret", "tone": "filmic"}
    file = write(folder / "f.json", first)
    async with Daemon(file) as daemon:
        check(await daemon.close_code("viewer", "old-secret") is None, "not let in")
        write(file, first | {"token-viewer": "new-secret", "tone": "linear", "samples": 3, "method": "faces",
                             "rotate": 90, "fps": 7, "quality": 50, "size": "32x18", "max-connections": 9})
        await daemon.reload()
        check(await daemon.close_code("viewer", "old-secret") == BAD_TOKEN, "the old token still opens")
        check(await daemon.close_code("viewer", "new-secret") is None, "the new token does not open")
        await status_of(daemon, "new-secret", lambda m: m["op"] == "control" and m["tone"] == "linear"
                        and m["samples"] == 3 and m["method"] == "faces" and m["rotate_degrees"] == 90 and m["fps"] == 7)
        log = daemon.log()
        check("reload: size stays 64x36 until the next start (now 32x18)" in log, log)
        check("reload: max-connections stays 128 until the next start (now 9)" in log, log)
        check("reload: tone is linear (was filmic)" in log and "reload: token-viewer has changed" in log, log)
        check("secret" not in log, f"a token is in the log: {log}")
        await daemon.reload(2)
        check(daemon.log().count("reload: tone") == 1, f"told twice: {daemon.log()}")


async def a_bad_file_on_reload_changes_nothing(folder):
    first = SMALL | {"token-viewer": "old-secret"}
    file = write(folder / "f.json", first)
    async with Daemon(file) as daemon:
        bad = ('{"port": ', json.dumps(first | {"token-viewer": "new-secret", "fps": 0, "tone": "linear"}),
               json.dumps(first | {"token-viewer": "new-secret", "error": 0.1}),  # not together with samples
               json.dumps(first | {"token-viewer": ""}), json.dumps(first | {"token-viewer-file": "/nonexistent"}))
        for count, text in enumerate(bad, start=1):
            write(file, text)
            daemon.process.send_signal(signal.SIGHUP)
            await daemon.says("nothing has changed", count)
            check(await daemon.close_code("viewer", "new-secret") == BAD_TOKEN, f"taken: {text}")
            check(await daemon.close_code("viewer", "old-secret") is None, f"lost by: {text}")
        file.unlink()
        daemon.process.send_signal(signal.SIGHUP)
        await daemon.says("nothing has changed", len(bad) + 1)
        await status_of(daemon, "old-secret", lambda m: m["op"] == "control" and m["tone"] == "filmic")
        write(file, first | {"token-viewer": "new-secret"})
        await daemon.reload()
        check(await daemon.close_code("viewer", "new-secret") is None, "a good one is not taken after bad ones")


async def reloads_leave_no_memory_behind(folder):
    """One-time allocations are allowed: after those, eighteen reloads take less than a page each. A sanitizer keeps
    freed memory and reports leaks itself."""
    sanitized = "RELIGHT_SANITIZED" in os.environ
    file = write(folder / "f.json", SMALL)
    async with Daemon(file) as daemon:
        def pages():
            return int(Path(f"/proc/{daemon.process.pid}/statm").read_text().split()[1])
        grown = []
        while len(grown) < (1 if sanitized else 8) and (not grown or grown[-1] >= 16):
            if grown:
                await asyncio.sleep(11)  # the log shows twenty lines of a kind in ten seconds
            before = pages()
            for count in range(18 * len(grown) + 1, 18 * len(grown) + 19):
                write(file, SMALL | {"fps": 10 + count % 2, "token-viewer": f"token {count}" * 20})
                await daemon.reload(count)
            grown.append(pages() - before)
        check(sanitized or grown[-1] < 16, f"pages taken by each eighteen reloads: {grown}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
