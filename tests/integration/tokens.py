#!/usr/bin/python3
"""Tokens: nothing that a program writes, sends or answers contains a token, right or wrong."""

import asyncio
import json

import websockets

from peer import WAIT_S, Program, check, main, run, sky_files

TOKENS = {"viewer": "Vq7-secret-viewer-token", "controller": "Cx4-secret-controller-token",
          "producer": "Pz9-secret-producer-token"}
WRONG = "Ww1-secret-but-wrong"
MARKS = [*TOKENS.values(), WRONG, "secret"]
FLAGS = [word for role, token in TOKENS.items() for word in (f"--token-{role}", token)]


class Served:
    """relightd while it listens; its whole log afterwards."""

    def __init__(self, *arguments):
        self.program = Program("relightd", "--port", "0", *arguments)
        self.log = ""

    async def __aenter__(self):
        await self.program.start()
        while "listening on " not in self.log:
            line = await asyncio.wait_for(self.program.process.stderr.readline(), WAIT_S)
            check(line, f"relightd ended: {self.log}")
            self.log += line.decode()
        self.url = self.log.split("listening on ")[1].split()[0]
        return self

    async def __aexit__(self, *_):
        self.program.process.terminate()
        await self.program.end()
        self.log += self.program.err


def holds_none(text, what):
    if isinstance(text, bytes):
        text = text.decode("latin-1")
    for mark in MARKS:
        check(mark not in text, f"{what} holds a token: {text[:2000]}")


async def hello(url, heard, **fields):
    """The server's answers to this hello, up to its second status, go into `heard`; returns the close code, or None if it gets
    that far."""
    link = await websockets.connect(url.replace("http", "ws", 1) + "ws", subprotocols=["relight.v1"], max_size=None, ping_interval=None, max_queue=None)
    await link.send(json.dumps({"op": "hello", "version": {"major": 1, "minor": 1}, **fields}))

    try:
        statuses = 0
        while statuses < 2:
            message = await asyncio.wait_for(link.recv(), WAIT_S)
            heard.append(message if isinstance(message, str) else message.decode("latin-1"))
            statuses += isinstance(message, str) and json.loads(message)["op"] == "status"
    except websockets.ConnectionClosed as end:
        heard.append(str(end.reason))
        return link.close_code
    await link.close()
    return None


async def request(url, text):
    reader, writer = await asyncio.open_connection("127.0.0.1", int(url.rstrip("/").rsplit(":", 1)[1]))
    writer.write(text.encode())
    try:
        return await asyncio.wait_for(reader.read(), WAIT_S)
    finally:
        writer.close()


async def no_token_is_ever_said(folder):
    heard = []
    async with Served(*FLAGS, "--source", "push:", "--size", "32x18", "--samples", "2") as served:
        url = served.url
        for role, token in TOKENS.items():
            check(await hello(url, heard, role=role, token=token) is None, f"the {role} was not let in: {heard}")
            check(await hello(url, heard, role=role) == 4006, "none is asked for")
            check(await hello(url, heard, role=role, token=WRONG) == 4006, "a wrong one does")
            check(await hello(url, heard, role=role, token=[token]) == 4002, "a list is no token")
            check(await hello(url, heard, role=role, token=token * 20) == 4002, "a long one is taken")
            check(await hello(url, heard, role=token) == 4002, "a token is a role")
        for path in ("/", "/healthz", "/readyz", "/metrics", f"/?token={WRONG}", f"/{WRONG}"):
            heard.append((await request(url, f"GET {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {WRONG}\r\n"
                                             "Connection: close\r\n\r\n")).decode("latin-1"))
        sky = sky_files(folder, 3)
        for token in (TOKENS["producer"], WRONG):
            program = await run("relight-feed", "--to", url.replace("http", "ws", 1), "--token", token, "--json", sky)
            check(program.code == (0 if token != WRONG else 3), f"relight-feed ended with {program.code}: {program.err}")
            holds_none(program.out + program.err, "relight-feed")
        program = await run("relight-record", "--from", url.replace("http", "ws", 1), "--token", WRONG,
                            "--out", folder / "no.%d.jpg")
        check(program.code == 3, f"relight-record ended with {program.code}")
        holds_none(program.out + program.err, "relight-record")
    holds_none("".join(heard), "what the server said")
    holds_none(served.log, "the server's log")
    check(len(served.log) > 20, "the server has no log")


async def what_is_wrong_with_a_token_is_said_without_it(folder):
    for arguments, code in ((["--bind", "0.0.0.0", "--token-viewer", TOKENS["viewer"]], 2),
                            ([*FLAGS, "--port", "70000"], 2),
                            ([*FLAGS, "--token-viewer", "secret" * 50], 2),
                            ([*FLAGS, "--bind", "256.0.0.1"], 2),
                            (["--token-producer", ""], 2),
                            ([*FLAGS, "--source", str(folder / "nowhere.exr")], 1),
                            ([*FLAGS, "--help"], 0)):
        program = await run("relightd", "--port", "0", *arguments)
        check(program.code == code, f"{arguments}: {program.code}: {program.err}")
        holds_none(program.out + program.err, "relightd")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
