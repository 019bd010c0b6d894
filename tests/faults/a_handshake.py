#!/usr/bin/python3
"""Faults of the handshake and of HTTP (group A): before a connection becomes a client."""

import asyncio

from faults import TEXT, Raw, Relightd, Viewer, check, hello, main, row


async def answers(stage, data):
    """The whole response to these bytes, until the server closes."""
    raw = await stage.raw()
    raw.send(data)
    try:
        return await raw.rest()
    finally:
        raw.shut()


def request(stage, line, *lines):
    head = [line, f"Host: 127.0.0.1:{stage.server.port}", "Connection: close", *lines]
    return ("\r\n".join(head) + "\r\n\r\n").encode("latin-1")


def status(answer):
    return int(answer.split()[1]) if answer.startswith(b"HTTP/1.") else 0


async def refused(stage, wanted, **other):
    """A handshake with these headers gets that status (0: none) and loses its connection."""
    raw = await stage.raw()
    got = await raw.upgrade(**other)
    check(got == wanted, f"{other}: answered {got} instead of {wanted}")
    await raw.rest()
    raw.shut()


@row(patient=True)
async def A01_silent_connect(stage):
    raw = await stage.raw()
    took = await raw.ends()
    return f"cut after {took:.1f} s"


@row(patient=True)
async def A02_slow_headers(stage):
    raw = await stage.raw()
    text = raw.handshake()
    ended = asyncio.ensure_future(raw.ends())
    sent = 0
    while not ended.done() and sent < len(text) - 1:
        raw.send(text[sent:sent + 1])
        sent += 1
        await asyncio.sleep(0.25)
    return f"cut after {await ended:.1f} s and {sent} of {len(text)} bytes"


@row(counts=None)
async def A03_long_uri(stage):
    for size in (1000, 8000, 100000):
        got = status(await answers(stage, request(stage, "GET /" + "a" * size + " HTTP/1.1")))
        check(got in (0, 400, 404, 414), f"{size} bytes: answered {got}")
    return "no answer or 4xx"


@row()
async def A04_large_header(stage):
    for size in (20000, 1000000):
        got = status(await answers(stage, request(stage, "GET /healthz HTTP/1.1", "X-Long: " + "a" * size)))
        check(got in (0, 200, 400, 431), f"{size} bytes: answered {got}")
    return "cut or passed over"


@row()
async def A05_many_headers(stage):
    lines = [f"X-Header-{i}: {i}" for i in range(200)]
    got = status(await answers(stage, request(stage, "GET /healthz HTTP/1.1", *lines)))
    check(got in (0, 200, 400, 431), f"answered {got}")
    flood = [f"X-{i}: " + "b" * 100 for i in range(20000)]
    await answers(stage, request(stage, "GET /healthz HTTP/1.1", *flood))
    return f"200 headers: {got}; 2 MB of them: cut"


@row(counts="refused")
async def A06_wrong_websocket_version(stage):
    for version in ("7", "8", "12", "14", "-1", "x", "13, 8", "1313131313131313"):
        await refused(stage, 400, Sec_WebSocket_Version=version)
    return "400"


@row(counts="refused")
async def A07_bad_websocket_key(stage):
    for key in (None, "", "c2hvcnQ=", "!" * 24, "a" * 200):
        await refused(stage, 400, Sec_WebSocket_Key=key)
    return "400"


@row(counts="refused")
async def A08_subprotocols(stage):
    await refused(stage, 400, Sec_WebSocket_Protocol=None)
    for wrong in ("relight.v2", "RELIGHT.V1", "chat, superchat", "relight.v1x", ","):
        raw = await stage.raw()
        got = await raw.upgrade(Sec_WebSocket_Protocol=wrong)
        check(got in (0, 400), f"'{wrong}': answered {got}")
        raw.shut()
    raw = await stage.raw()
    got = await raw.upgrade(Sec_WebSocket_Protocol="chat, " + ", ".join(f"p{i}" for i in range(20)) + ", relight.v1")
    check(got == 101, f"ours behind others: {got}")
    raw.shut()
    return "400 or no answer; ours among others is found"


@row(counts="refused")
async def A09_foreign_origin(stage):
    port = stage.server.port
    for origin in ("null", "http://evil.example", f"http://127.0.0.1:{port + 1}", f"http://127.0.0.1:{port}.evil.example",
                   "http://evil.example:127.0.0.1", "//", f"http://evil@127.0.0.1:{port}"):
        await refused(stage, 403, Origin=origin)
    await refused(stage, 403, Host="evil.example", Origin="http://evil.example")
    for origin in (None, f"http://127.0.0.1:{port}"):
        raw = await stage.raw()
        check(await raw.upgrade(Origin=origin) == 101, f"Origin {origin} is turned away")
        raw.shut()
    return "403; none and our own are let in"


@row(alone=True)
async def A10_wrong_tokens(folder):
    words = {"viewer": "alpha-token", "controller": "beta-token", "producer": "gamma-token"}
    flags = [x for role, word in words.items() for x in (f"--token-{role}", word)]
    async with Relightd(*flags, source="sky:size=128x64,speed=60") as server, Viewer(server, token="alpha-token") as viewer:
        await viewer.sees(2)
        for token in (None, "", "alpha-toke", "alpha-token ", "ALPHA-TOKEN", "beta-token", "a" * 255):
            raw = await Raw.open(server.port)
            check(await raw.upgrade(path="/ws", Authorization="Bearer alpha-token") == 101, "no handshake")
            raw.send(hello(**({} if token is None else {"token": token})))
            got = await raw.closed()
            check(got == 4006, f"token {token!r}: closed with {got}")
            raw.shut()
        raw = await Raw.open(server.port)
        got = await raw.upgrade(path="/ws?token=alpha-token")  # not the place for a token: it would appear in logs
        if got == 101:
            raw.send(hello())
            got = await raw.closed()
        check(got in (4006, 404, 403), f"a token in the address: {got}")
        raw.shut()
        before = server.memory_kib()
        ended = {}
        for i in range(1000):
            raw = await Raw.open(server.port)
            if await raw.upgrade() == 101:
                raw.send(hello(token=f"guess {i}"))
                code = await raw.closed()
            else:
                code = "turned away"
            ended[code] = ended.get(code, 0) + 1
            raw.shut()
        check(set(ended) <= {4006, 4007, 4010, None, "turned away"}, f"closed with {ended}")
        await viewer.sees(2)
        check(not viewer.parted, f"the honest viewer was closed with {viewer.parted}")
        check("alpha-token" not in "".join(server.lines), "a token stands in the log")
        return f"1000 guesses: {ended}; {server.memory_kib() - before:+d} KiB"


@row()
async def A11_old_http(stage):
    got = status(await answers(stage, request(stage, "GET /healthz HTTP/1.0")))
    check(got in (200, 400, 505), f"HTTP/1.0: {got}")
    for line in (b"GET /healthz\r\n\r\n", b"GET /healthz HTTP/0.9\r\n\r\n", b"\r\n\r\n", b"GET\r\n\r\n"):
        rest = await answers(stage, line)
        check(b"200 OK" not in rest, f"{line}: {rest[:40]}")  # no Host, no answer
    for version in ("HTTP/1.0", "HTTP/0.9", "HTTP/2.0", "HTTP/x"):
        await refused(stage, 400, http=version)
    return f"HTTP/1.0: {got}; without Host: refused; no upgrade but from 1.1"


@row()
async def A12_pipelined_requests(stage):
    raw = await stage.raw()
    one = f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{raw.port}\r\n\r\n".encode()
    raw.send(one * 3 + raw.handshake() + hello())
    codes = []
    for _ in range(4):
        got, head = await raw.answer()
        codes.append(got)
        size = [int(line.split(b":")[1]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length")]
        if size:
            await raw.reader.readexactly(size[0])
        if got != 200:
            break
    check(codes[:1] == [200] and codes[-1] in (200, 101, 0), f"answered {codes}")
    if codes[-1] == 101:
        check((await raw.receive())[0] == TEXT, "no welcome")
    raw.shut()
    return f"answered {codes}"


@row(counts="refused")
async def A13_requests_with_a_body(stage):
    for lines in (["Content-Length: 5"], ["Content-Length: -1"], ["Content-Length: 99999999999999999999"],
                  ["Content-Length: 5", "Content-Length: 6"], ["Transfer-Encoding: chunked"], ["Content-Length: x"]):
        got = status(await answers(stage, request(stage, "GET /healthz HTTP/1.1", *lines) + b"5\r\nhello\r\n0\r\n\r\n"))
        check(got in (0, 400, 413), f"{lines}: answered {got}")
    await answers(stage, request(stage, "GET /healthz HTTP/1.1", "Host: evil.example"))
    return "413 or cut"


@row(counts="refused")
async def A14_post_to_the_page(stage):
    for method in ("POST", "PUT", "PATCH"):
        for path in ("/", "/healthz", "/ws"):
            got = status(await answers(stage, request(stage, f"{method} {path} HTTP/1.1", "Content-Length: 100000")
                                       + b"x" * 100000))
            check(got in (0, 400, 403, 404, 405, 413), f"{method} {path}: answered {got}")
    return "4xx or cut"


@row()
async def A15_paths_outside_of_the_page(stage):
    for path in ("/../../etc/passwd", "/..%2f..%2fetc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/app.js%00.png",
                 "/./../server.h", "/..\\..\\etc", "/%c0%ae%c0%ae/etc/passwd", "/app.js/..", "/" + "../" * 200 + "etc/passwd"):
        rest = await answers(stage, request(stage, f"GET {path} HTTP/1.1"))
        check(b"root:" not in rest and b"#include" not in rest, f"{path}: {rest[:60]}")
        check(status(rest) in (0, 400, 403, 404) or path.startswith("/app.js"), f"{path}: answered {status(rest)}")
    return "404, or no answer"


@row(counts="refused")
async def A16_other_methods(stage):
    rest = await answers(stage, request(stage, "HEAD /healthz HTTP/1.1"))
    check(status(rest) == 200 and rest.endswith(b"\r\n\r\n"), f"HEAD: {rest[-60:]}")
    for method in ("OPTIONS", "TRACE", "DELETE", "CONNECT", "BREW", "get", "G" * 500):
        got = status(await answers(stage, request(stage, f"{method} /healthz HTTP/1.1")))
        check(got in (0, 400, 403, 404, 405, 501) or method == "get", f"{method}: answered {got}")
    return "HEAD without body; the rest 4xx or cut"


@row()
async def A17_http2_preface(stage):
    settings = b"\0\0\0\4\0\0\0\0\0"
    rest = await answers(stage, b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + settings * 100)
    check(b"\0\0" not in rest, f"HTTP/2 is spoken: {rest[:40]}")
    rest = await answers(stage, request(stage, "GET / HTTP/1.1", "Upgrade: h2c", "HTTP2-Settings: AAMAAABkAARAAAAA")
                         .replace(b"Connection: close", b"Connection: Upgrade, HTTP2-Settings"))
    check(status(rest) != 101, "h2c is agreed to")
    return "not spoken"


@row()
async def A18_tls_to_the_plain_port(stage):
    greeting = bytes.fromhex("16030100c8010000c40303") + bytes(range(189)) + b"\0" * 200
    for data in (greeting, b"\x80\x2e\x01\0\x02" + b"\0" * 50, bytes(range(256)) * 40):
        rest = await answers(stage, data)
        check(b"101 " not in rest[:20], f"{rest[:40]}")
    return "cut"


if __name__ == "__main__":
    main()
