#!/usr/bin/python3
"""relight-feed and relight-record over TLS: which certificates they trust, what they report of others, and that
frames of any size, pictures and reconnections work as without TLS."""

import asyncio
import os
import re
import signal
import ssl

from peer import WAIT_S, Frame, Program, Server, check, expect, main, picture, run, skip, sky_files
from still import Daemon
from tls import certificate, expired, port_of

LOCKSTEP = ("--source", "push:", "--size", "64x36", "--samples", "1", "--method", "mis", "--paths", "direct", "--edge-rays", "1")


def served(cert, key):
    """The options of a server with this certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(cert, key)
    return context


def relightd(cert, key):
    return Daemon(*LOCKSTEP, "--tls-cert", str(cert), "--tls-key", str(key))


async def feed(url, *arguments):
    return await run("relight-feed", "--to", url, "--retry", "0", *arguments, "--frames", "1-3", "sky:size=64x32")


async def uses_all(link):
    await link.welcome_producer()
    while isinstance(message := await link.read(), bytes):
        await link.fate(Frame(message).number)
        await link.credit()
    check(await link.parted() == 1000, "no clean close")


async def a_sequence_goes_up_and_its_pictures_come_down(folder):
    cert, key = certificate(folder, "good")
    async with relightd(cert, key) as daemon:
        to = ("wss://localhost:%d" % port_of(daemon.url), "--ca", cert)
        record = await Program("relight-record", "--lockstep", "--json", "--out", folder / "%d.exr", "--from", *to).start()
        expect(await feed(*to, "--lockstep"), 0)
        expect(await record.end(), 0)
        check(record.summary()["stored"] == 3, record.out)
    check(all((folder / f"{i}.exr").read_bytes()[:4] == b"\x76\x2f\x31\x01" for i in (1, 2, 3)), "not the pictures")


async def the_systems_authorities_are_trusted_unless_others_are_named(folder):
    """OpenSSL's variable replaces the folder that only root can write."""
    (cert, key), (other, _) = certificate(folder, "good"), certificate(folder, "other")
    async with relightd(cert, key) as daemon:
        os.environ["SSL_CERT_FILE"] = str(cert)
        to = f"https://127.0.0.1:{port_of(daemon.url)}"
        expect(await feed(to), 0)
        expect(await feed(to, "--ca", other), 1, "no authority in --ca signed it")
        os.environ["SSL_CERT_FILE"] = str(other)
        expect(await feed(to), 1, "its certificate is not trusted")


async def what_is_wrong_with_a_certificate_is_said(folder):
    good, (_, key) = certificate(folder, "good"), certificate(folder, "other")
    elsewhere, old = certificate(folder, "elsewhere", names="DNS:elsewhere.example"), expired(folder)
    for (cert, key), host, ca, words in (
            (good, "localhost", (), "is not trusted (self-signed certificate): use --ca FILE"),
            (elsewhere, "localhost", ("--ca", elsewhere[0]), "(hostname mismatch): connect with a name that it covers"),
            (elsewhere, "127.0.0.1", ("--ca", elsewhere[0]), "(IP address mismatch): connect with a name"),
            (old, "localhost", ("--ca", old[0]), "(certificate has expired): renew it there, or set the clock here")):
        async with Server(uses_all, tls=served(cert, key)) as server:
            to = f"wss://{host}:{server.port}"
            for program in ("relight-feed", "--to", to, "sky:"), ("relight-record", "--from", to, "--out", folder / "%d.jpg"):
                said = await run(*program, *ca)  # which would retry for ever if the fault were not permanent
                expect(said, 1, words)
                check(said.err.count("\n") == 2, f"more than an error and a sum: {said.err}")
            check(server.connections == 0, "it was spoken to")


async def an_ipv6_address_is_held_to_the_certificate(folder):
    if not os.path.exists("/proc/net/if_inet6"):
        skip("this machine has no IPv6")
    for name, names, code in ("good", "IP:::1", 0), ("bad", "IP:::2,DNS:localhost", 1):
        cert, key = certificate(folder, name, names=names)
        async with Daemon(*LOCKSTEP, "--bind", "::1", "--tls-cert", str(cert), "--tls-key", str(key)) as daemon:
            for host in "::1", "::1%1", "0:0:0:0:0:0:0:1":
                said = await feed(f"wss://[{host}]:{port_of(daemon.url)}", "--ca", cert)
                expect(said, code, "IP address mismatch" if code else "")


async def ca_files_that_will_not_do_are_named(folder):
    (folder / "text.pem").write_text("no certificate\n")
    for to, ca, code, words in (("wss://127.0.0.1", "none.pem", 1, "none.pem: cannot be read: No such file"),
                                ("wss://127.0.0.1", "text.pem", 1, "text.pem: has no certificate in PEM form"),
                                ("ws://127.0.0.1", "none.pem", 2, "--ca is for TLS")):
        expect(await feed(to, "--ca", folder / ca), code, words)


async def tls_on_one_side_only_is_told(folder):
    """relightd and another server, and one that hangs up."""
    cert, key = certificate(folder, "good")

    async def hang_up(_, writer):
        writer.close()

    silent = await asyncio.start_server(hang_up, "127.0.0.1", 0)
    async with relightd(cert, key) as daemon, Server(uses_all, tls=served(cert, key)) as server:
        for port in port_of(daemon.url), server.port, silent.sockets[0].getsockname()[1]:
            name = f"127.0.0.1:{port}"
            expect(await feed(f"ws://{name}"), 1, f"no HTTP answer; if this server uses TLS, connect to wss://{name}")
    async with Daemon(*LOCKSTEP) as daemon, Server(uses_all) as server:
        for port in port_of(daemon.url), server.port, silent.sockets[0].getsockname()[1]:
            name = f"127.0.0.1:{port}"
            expect(await feed(f"wss://{name}", "--ca", cert), 1,
                   f"{name}: the TLS handshake failed; if this server does not use TLS, connect to ws://{name}")
    silent.close()


async def a_name_that_dns_does_not_know_is_told(folder):
    for scheme in "ws", "wss":
        expect(await feed(f"{scheme}://no-such-host.invalid"), 1, "'no-such-host.invalid' cannot be resolved")


async def a_large_frame_goes_up_whole_to_a_slow_reader(folder):
    cert, key = certificate(folder, "good")
    pattern = sky_files(folder, 2, pad=16 << 20)
    got = []

    async def slow(link):
        await link.welcome_producer()
        for _ in range(2):
            link.socket.transport.pause_reading()
            await asyncio.sleep(1)
            link.socket.transport.resume_reading()
            got.append(await link.frame())
            await link.fate(got[-1].number)
            await link.credit()
        await link.parted()

    async with Server(slow, tls=served(cert, key)) as server:
        expect(await run("relight-feed", "--to", server.url, "--ca", cert, pattern), 0)
    check([f.payload for f in got] == [(folder / f"sky.000{i}.hdr").read_bytes() for i in (0, 1)], "other bytes")


async def a_large_picture_comes_down_whole_in_fragments(folder):
    """With pings in between, which are answered."""
    cert, key = certificate(folder, "good")
    payload = os.urandom(32 << 20)

    async def script(link):
        await link.welcome("viewer")
        check((await link.read())["op"] == "subscribe", "it does not subscribe")
        whole = picture(1, 7, payload)
        parts = [whole[i:i + 100000] for i in range(0, len(whole), 100000)]

        async def pinged():
            for i, part in enumerate(parts):
                yield part
                if i % 50 == 0:
                    await asyncio.wait_for(await link.socket.ping(), WAIT_S)

        await link.socket.send(pinged())
        check((await link.read())["op"] == "ack", "it is not acknowledged")
        check(await link.parted() == 1000, "no clean close")

    async with Server(script, tls=served(cert, key)) as server:
        expect(await run("relight-record", "--from", server.url, "--ca", cert, "--once", "--out", folder / "a.exr"), 0)
    check((folder / "a.exr").read_bytes() == payload, "other bytes")


async def it_comes_back_when_a_trusted_server_is_put_right(folder):
    """After a first connection an untrusted certificate is no reason to give up."""
    (cert, key), (bad, bad_key) = certificate(folder, "good"), certificate(folder, "bad")
    pattern = sky_files(folder, 3)
    broken = asyncio.Event()

    async def cut(link):
        await link.welcome_producer()
        await link.frame()
        link.cut()
        broken.set()

    async with Server(cut, tls=served(cert, key)) as server:
        program = await Program("relight-feed", "--to", server.url, "--ca", cert, "--lockstep", pattern).start()
        await asyncio.wait_for(broken.wait(), WAIT_S)
    async with Server(uses_all, tls=served(bad, bad_key), port=server.port):
        said = ""
        while not re.search(r"is not trusted.*; trying again in ten seconds", said):
            line = (await asyncio.wait_for(program.process.stderr.readline(), WAIT_S)).decode()
            check(line, f"it ended: {said}")
            said += line
    async with Server(uses_all, tls=served(cert, key), port=server.port):
        expect(await program.end(), 0)


async def an_interrupt_closes_cleanly(folder):
    cert, key = certificate(folder, "good")
    codes, welcomed = [], asyncio.Event()

    async def script(link):
        await link.welcome("viewer")
        check((await link.read())["op"] == "subscribe", "it does not subscribe")
        welcomed.set()
        codes.append(await link.parted())

    async with Server(script, tls=served(cert, key)) as server:
        program = await Program("relight-record", "--from", server.url, "--ca", cert, "--out", folder / "%d.jpg").start()
        await asyncio.wait_for(welcomed.wait(), WAIT_S)
        expect(await program.kill(signal.SIGINT), 0)
    check(codes == [1000], f"closed with {codes}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
