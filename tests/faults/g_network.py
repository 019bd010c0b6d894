#!/usr/bin/python3
"""Attacks from the network (group G): clients that try to lock others out, or to take what is not theirs. Attackers and newcomers
come from different addresses of 127.0.0.0/8, which are all this machine's."""

import asyncio
import contextlib
import resource
import socket
import ssl
import time
import warnings

from faults import BINARY, KEPT, MORE, PING, PONG, TEXT, WAIT_S, Deadline, Raw, Relightd, Viewer, check, frame, hello, main, row, say

SKY = "sky:size=128x64,speed=60"


class Crowd:
    """Keeps so many connections open from these addresses, opening each again when it is closed. `first` is sent on each; by
    default they are silent."""

    def __init__(self, port, count, addresses, first=b""):
        self.port, self.count, self.addresses, self.first = port, count, addresses, first
        self.opened = self.up = 0

    async def __aenter__(self):
        least = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(least[1], 65536), least[1]))
        self.tasks = [asyncio.ensure_future(self.keep(self.addresses[i % len(self.addresses)])) for i in range(self.count)]
        async with Deadline():
            while self.opened < self.count:
                await asyncio.sleep(0.05)
        return self

    async def keep(self, address):
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", self.port, local_addr=(address, 0))
                self.opened += 1
                self.up += 1
                try:
                    writer.write(self.first)
                    while await reader.read(65536):
                        pass
                finally:
                    self.up -= 1
                    writer.close()
            await asyncio.sleep(1)

    async def __aexit__(self, *_):
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)


async def newcomer(port, address, tls=None):
    """Seconds until someone from that address has the page, and a picture: at once, or they count as locked out."""
    page, late_s = b"", 5.0
    while not page and late_s >= 5.0: # the time in which a request must come: one who is sent away to make room is so at once
        begun = time.monotonic()
        raw = await Raw.open(port, source=address, tls=tls)
        raw.send(f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\nConnection: close\r\n\r\n".encode())
        page = await raw.rest()
        raw.shut()
        late_s = time.monotonic() - begun
    check(b" 200 OK" in page[:20] and b"</html>" in page, f"no page within {time.monotonic() - begun:.1f} s: {page[:60]}")
    page_s = time.monotonic() - begun
    raw = await Raw.open(port, source=address, tls=tls)
    got = await raw.upgrade()
    check(got == 101, f"no handshake within {time.monotonic() - begun:.1f} s: {got}")
    raw.send(hello() + say(op="subscribe", format="jpeg"))
    async with Deadline():
        while (await raw.receive())[0] != BINARY:
            check(not raw.said or raw.said[-1]["op"] != "error", f"refused: {raw.said[-1:]}")
    raw.shut()
    return page_s, time.monotonic() - begun


async def locked_out(folder, *flags, tls=None):
    addresses = [f"127.0.1.{i}" for i in range(1, 21)]
    begun = time.monotonic()
    async with Relightd("--rate", "10", *flags, source=SKY) as server:
        await newcomer(server.port, "127.0.2.1", tls)
        before = server.memory_kib()
        async with Crowd(server.port, 1000, addresses) as crowd:
            times = [await newcomer(server.port, f"127.0.2.{i}", tls) for i in range(1, 6)]
            grown = server.memory_kib() - before
            held = crowd.up
            async with Deadline():
                while not any("to make room for newcomers" in line for line in server.lines):
                    await asyncio.sleep(0.1)
        told, minutes = sum("to make room for newcomers" in line for line in server.lines), (time.monotonic() - begun) / 60
        check(told <= 2 + minutes, f"told {told} times within {minutes:.1f} minutes")
        # With TLS the 128 places, and those being closed, hold the buffers of a handshake: 24 to 44 MB were seen.
        check(grown < (65536 if tls else 32768) * KEPT, f"{grown} KiB more memory")
        if not tls:
            count = (await server.counters())['relightd_limits_reached_total{limit="arrivals"}']
            check(count > 500, f"counted {count}")
    return (f"{crowd.opened} connections, {held} open: the page after {max(t[0] for t in times):.2f} s, a picture after "
            f"{max(t[1] for t in times):.2f} s; {grown:+d} KiB")


@row(alone=True)
async def G101_a_thousand_silent_connections(folder):
    return await locked_out(folder)


@row(alone=True)
async def G102_a_thousand_silent_connections_to_tls(folder):
    from tls import certificate
    cert, key = certificate(folder, "own")
    trust = ssl.create_default_context(cafile=str(cert))
    return await locked_out(folder, "--tls-cert", str(cert), "--tls-key", str(key), tls=trust)


async def greeted(port, address, code=None):
    """A client from that address: the connection, or its close code."""
    raw = await Raw.open(port, source=address)
    check(await raw.upgrade() == 101, "no handshake")
    raw.send(hello())
    kind, _ = await raw.receive()
    if kind == TEXT and raw.said[-1]["op"] == "welcome":
        return raw
    got = await raw.closed()
    raw.shut()
    return got


@row(alone=True)
async def G103_all_places_of_clients_taken_by_few(folder):
    """Four addresses hold all places: a newcomer from another one takes the newest of the address with most."""
    async with Relightd("--rate", "5", source=SKY) as server:
        held = {}
        for i in range(128):
            address = f"127.0.1.{1 + i % 4}"
            raw = await greeted(server.port, address)
            check(isinstance(raw, Raw), f"connection {i}: {raw}")
            held.setdefault(address, []).append((raw, asyncio.ensure_future(raw.stays())))
        check(await greeted(server.port, "127.0.1.1") == 4007, "a crowded address got one more")
        new = await greeted(server.port, "127.0.2.1")
        check(isinstance(new, Raw), f"the newcomer was closed with {new}")
        newest, staying = [clients[-1][1] for clients in held.values()], [task for clients in held.values() for _, task in clients]
        done, _ = await asyncio.wait(staying, timeout=WAIT_S, return_when=asyncio.FIRST_COMPLETED)
        check([task.result() for task in done] == [4007] and done < set(newest), f"gave way: {done}")
        for raw in [new, *(raw for clients in held.values() for raw, _ in clients)]:
            raw.reset()
        await asyncio.gather(*staying)
    return "the newest of an address with 32 gave way, 4007"


async def joined(port, address="127.0.0.1", **fields):
    """A client with this hello: the connection, or its close code."""
    raw = await Raw.open(port, source=address)
    check(await raw.upgrade() == 101, "no handshake")
    raw.send(say(op="hello", version={"major": 1, "minor": 2}, **fields))
    kind, _ = await raw.receive()
    if kind == TEXT and raw.said[-1]["op"] == "welcome":
        return raw
    got = await raw.closed()
    raw.shut()
    return got


def recorder(port, name, address="127.0.0.1", role="recorder", **more):
    return joined(port, address, role=role, recorder=name, **more)


@row(alone=True)
async def G104_a_viewer_as_recorder(folder):
    """Its token is not enough; without tokens on loopback none is needed; a name stays with its holder."""
    tokens = {"viewer": "eyes", "controller": "hand", "producer": "rig", "recorder": "film"}
    flags = [x for role, token in tokens.items() for x in (f"--token-{role}", token)]
    async with Relightd(*flags[:-2]) as server:
        for role in ("viewer", "recorder"):
            got = await recorder(server.port, "day", role=role, token="eyes")
            check(got == 4004, f"no token for recorders is set: {got}")
    async with Relightd(*flags) as server:
        for role in ("viewer", "recorder"):
            got = await recorder(server.port, "day", role=role, token="eyes")
            check(got == 4006, f"role {role} with the viewers' token: {got}")
        holder = await recorder(server.port, "day", token="film")
        check(isinstance(holder, Raw) and "recorder" in holder.said[-1]["roles"], f"the right token: {holder}")
        got = await recorder(server.port, "day", token="film")
        check(got == 4012, f"a second recorder: {got}")
        await holder.pong()
        holder.reset()
        got = await recorder(server.port, "day", "127.0.2.1", token="film")
        check(got == 4012, f"another address takes the name at once: {got}")
        back = await recorder(server.port, "day", token="film")
        check(isinstance(back, Raw), f"the holder does not get its name back: {back}")
        back.shut()
        async with Deadline():
            while not isinstance(got := await recorder(server.port, "day", "127.0.2.1", token="film"), Raw):
                await asyncio.sleep(1)
        got.shut()
    async with Relightd() as server:
        for role in ("viewer", "recorder"):
            raw = await recorder(server.port, f"day-{role}", role=role)
            check(isinstance(raw, Raw), f"without tokens: {raw}")
            raw.shut()
    return "4006; a second recorder 4012; the name is free for others after 10 s"


@row(alone=True)
async def G105_all_names_of_sequences_taken(folder):
    async with Relightd() as server:
        held = [await recorder(server.port, f"x{i}", "127.0.1.1", role="viewer") for i in range(16)]
        check(all(isinstance(raw, Raw) for raw in held), f"{held}")
        got = await recorder(server.port, "one-more", "127.0.1.1", role="viewer")
        check(got == 4012, f"the same address gets another: {got}")
        new = await recorder(server.port, "honest", "127.0.2.1", role="viewer")
        check(isinstance(new, Raw), f"another address gets none: {new}")
        made = await joined(server.port, "127.0.2.2", role="producer", pace="lockstep", sequence="honest-too")
        check(isinstance(made, Raw), f"a producer gets none: {made}")
        lost = 0
        for raw in held:
            raw.send(say(op="ping", id=1))
            while (await raw.receive())[0] == TEXT and raw.said[-1]["op"] not in ("pong", "error"):
                pass
            lost += raw.said[-1].get("code") == "busy"
        check(lost == 2, f"{lost} of 16 lost their name")
        count = (await server.counters())['relightd_limits_reached_total{limit="names"}']
        check(count == 3, f"counted {count}")
        for raw in [*held, new, made]:
            raw.reset()
    return "a newcomer gets a name that waits for its first frame, from the address with most"


@row(alone=True)
async def G106_foreign_names(folder):
    """A page whose name resolves to this machine is refused, whatever tokens there are and wherever the server listens."""
    flags = [x for role in ("viewer", "controller", "producer") for x in (f"--token-{role}", "secret")]
    for bind in ((), ("--bind", "0.0.0.0")):
        async with Relightd(*flags, "--public-name", "relight.example", *bind, source=SKY) as server:
            for host, origin, wanted in (("evil.example", None, 403), ("evil.example", "http://evil.example", 403),
                                         ("127.0.0.1.evil.example", None, 403), ("192.0.2.1", None, 403),
                                         (None, "http://evil.example", 403), (None, None, 101),
                                         ("relight.example", "https://relight.example", 101),
                                         ("127.0.0.1", "http://127.0.0.1", 101)):
                head = {"Host": host or f"localhost:{server.port}", "Origin": origin}
                raw = await Raw.open(server.port)
                got = await raw.upgrade(**head)
                check(got == wanted, f"{bind} upgrade with {head}: {got}")
                raw.shut()
                raw = await Raw.open(server.port)
                raw.send((f"GET /metrics HTTP/1.1\r\nHost: {head['Host']}\r\nAuthorization: Bearer secret\r\n" +
                          (f"Origin: {origin}\r\n" if origin else "") + "Connection: close\r\n\r\n").encode())
                got = (await raw.answer())[0]
                check(got == (403 if wanted == 403 else 200), f"{bind} /metrics with {head}: {got}")
                raw.shut()
    return "403 on every path; localhost, its addresses and --public-name are served"


async def guess(port, address, named, token):
    raw = await Raw.open(port, source=address)
    check(await raw.upgrade(X_Forwarded_For=named) == 101, "no handshake")
    raw.send(hello(token=token))
    kind, _ = await raw.receive()
    got = "right" if kind == TEXT and raw.said[-1]["op"] == "welcome" else await raw.closed()
    raw.reset()
    return got


@row(alone=True)
async def G107_invented_addresses(folder):
    """Guesses under invented names, from the proxy's address and from another local one."""
    async with Relightd("--token-viewer", "secret", "--behind-proxy") as server:
        check(await guess(server.port, "127.0.0.1", "203.0.113.9", "secret") == "right", "the right token")
        begun = time.monotonic()
        codes = [await guess(server.port, "127.0.0.1", f"10.0.{i >> 8}.{i & 255}", f"guess {i}") for i in range(300)]
        took = time.monotonic() - begun
        seen = codes.count(4006)
        check(set(codes) == {4006, 4010} and seen <= 60 + 20 + 1.5 * took + 1, f"{seen} of 300 guesses checked in {took:.1f} s")
        got = await guess(server.port, "127.0.0.1", "203.0.113.9", "secret")
        check(got == "right", f"an address with the right token before: {got}")
        begun = time.monotonic()
        codes = [await guess(server.port, "127.0.0.80", f"10.9.0.{i}", f"guess {i}") for i in range(40)]
        took = time.monotonic() - begun + 1
        check(codes.count(4006) <= 10 + took, f"{codes.count(4006)} of 40 guesses checked that came past the proxy")
    return f"{seen} of 300 guesses were checked; a known address is served"


@row(alone=True)
async def G108_floods_beside_messages(folder):
    """Pings and pongs without end, before hello and after: 4010, each time counted."""
    async with Relightd("--rate", "5", source=SKY) as server, Viewer(server) as viewer:
        await viewer.sees(2)
        for words in (b"", hello()):
            for piece in (frame(PING, b"p" * 125), frame(PONG, b"p" * 125), frame(PING)):
                raw = await Raw.open(server.port)
                check(await raw.upgrade() == 101, "no handshake")
                raw.send(words)
                sent = 0

                async def flood():
                    nonlocal sent
                    while sent < 64 << 20 and not raw.writer.transport.is_closing():
                        raw.send(piece * 1000)
                        sent += 1000 * len(piece)
                        await raw.flush()

                task = asyncio.ensure_future(flood())
                got = await raw.closed()
                task.cancel()
                with contextlib.suppress(OSError):
                    raw.reset()
                check(got in (4010, None), f"{piece[:4]}: closed with {got} after {sent} bytes")  # None: still sending
        check((await server.counters())["relightd_connections_too_fast_total"] == 6, "not counted")
        for size in (0, 125):  # a client that pings ten times a second stays
            raw = await Raw.open(server.port)
            await raw.upgrade()
            raw.send(hello())
            for _ in range(20):
                raw.send(frame(PING, b"p" * size))
                await asyncio.sleep(0.02)
            await raw.pong()
            raw.shut()
        await viewer.sees(2)
        check(not viewer.parted, "the honest viewer was closed")
    return "4010"


@row()
async def G109_unknown_words_in_a_burst(stage):
    """Each of 190 is answered; 3000 at once are 4010, or a broken connection if they are still being sent; more than 4096
    fragments are told so."""
    raw = await stage.client()
    raw.send(b"".join(say(op=f"unknown-{i}") for i in range(190)))
    for count in range(190):
        said = await raw.until("error")
        check(said["code"] == "unknown_op", f"answer {count}: {said}")
    raw.shut()
    raw = await stage.client()
    raw.send(b"".join(say(op="unknown") for _ in range(1000)))
    got = await raw.closed()
    check(got == 4010, f"1000 at once: {got}")
    raw.shut()
    raw = await stage.client()
    raw.send(frame(TEXT, b"{", fin=False) + frame(MORE, b" ", fin=False) * 4200)
    got = await raw.closed()
    check(got == 1009 and "fragments" in raw.said[-1]["message"], f"{got}: {raw.said[-1:]}")
    raw.shut()
    return "190 of 190 answered; 1000 are 4010; 4096 fragments"


@row(alone=True)
async def G110_weak_tls(folder):
    """TLS 1.2 with forward secrecy and authenticated encryption, and TLS 1.3; nothing else."""
    from tls import CURVE, certificate
    weak = ["AES128-SHA", "AES256-SHA256", "AES128-GCM-SHA256", "ECDHE-ECDSA-AES128-SHA", "ECDHE-RSA-AES128-SHA",
            "ECDHE-RSA-AES256-SHA384", "DHE-RSA-AES128-GCM-SHA256", "PSK-AES128-GCM-SHA256"]
    good = {CURVE: ["ECDHE-ECDSA-AES128-GCM-SHA256", "ECDHE-ECDSA-CHACHA20-POLY1305"],
            ("rsa:2048",): ["ECDHE-RSA-AES256-GCM-SHA384", "ECDHE-RSA-CHACHA20-POLY1305"]}

    def shake(port, version, ciphers):
        """The cipher that was agreed on; None: refused."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        context.set_ciphers(f"{ciphers}:@SECLEVEL=0")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            context.minimum_version = context.maximum_version = version
        try:
            with socket.create_connection(("127.0.0.1", port), 30) as plain, context.wrap_socket(plain) as link:
                return link.cipher()[0]
        except (ssl.SSLError, ConnectionError):
            return None

    tried = 0
    for kind, ciphers in good.items():
        cert, key = certificate(folder, kind[0].replace(":", ""), kind)
        async with Relightd("--tls-cert", str(cert), "--tls-key", str(key), source=SKY) as server:
            async def agreed(*how):
                return await asyncio.to_thread(shake, server.port, *how)
            for cipher in weak:
                got = await agreed(ssl.TLSVersion.TLSv1_2, cipher)
                check(got is None, f"{got} is agreed on")
                tried += 1
            for version in (ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1):
                check(await agreed(version, "ALL") is None, f"{version} is spoken")
                tried += 1
            for cipher in ciphers:
                check(await agreed(ssl.TLSVersion.TLSv1_2, cipher) == cipher, f"{cipher} is refused")
            check(await agreed(ssl.TLSVersion.TLSv1_3, "ALL"), "TLS 1.3 is refused")
    return f"{tried} weak offers refused"


if __name__ == "__main__":
    main()
