#!/usr/bin/python3
"""relightd's own TLS: the page and the stream by HTTPS and WSS, certificates that will not do, and those who speak
plainly or slowly to it. The other ends are Python's ssl and python3-websockets; certificates are made by openssl."""

import asyncio
import json
import shutil
import signal
import socket
import ssl
import subprocess
import time

import websockets

from peer import BIN, PICTURE, WAIT_S, check, main, skip
from still import Daemon

SKY = ("--source", "sky:", "--size", "64x36", "--samples", "1", "--method", "mis")


AUTHORITY = """[ca]
default_ca = one
[one]
database = {0}/index
serial = {0}/serial
new_certs_dir = {0}
default_md = sha256
policy = names
[names]
commonName = supplied
"""
KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj", "/CN=localhost")


def openssl(*arguments):
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True)


def certificate(folder, name):
    if not shutil.which("openssl"):
        skip("openssl is not installed")
    cert, key = folder / f"{name}.pem", folder / f"{name}.key"
    openssl("req", "-x509", *KEY, "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1", "-keyout", key, "-out", cert)
    return cert, key


def expired(folder):
    """Of 2020, which only an authority may write."""
    cert, key, request, rules = (folder / f"old.{end}" for end in ("pem", "key", "csr", "conf"))
    rules.write_text(AUTHORITY.format(folder))
    (folder / "index").touch()
    (folder / "serial").write_text("01\n")
    openssl("req", "-new", *KEY, "-keyout", key, "-out", request)
    openssl("ca", "-batch", "-config", rules, "-selfsign", "-keyfile", key, "-in", request, "-out", cert, "-notext",
            "-startdate", "20200101000000Z", "-enddate", "20200201000000Z")
    return cert, key


def trust(cert):
    return ssl.create_default_context(cafile=str(cert))


def port_of(url):
    return int(url.rsplit(":", 1)[1].split("/")[0])


async def get(port, context, path):
    reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context, server_hostname="localhost")
    writer.write(f"GET {path} HTTP/1.1\r\nHost: localhost:{port}\r\nConnection: close\r\n\r\n".encode())
    answer = await asyncio.wait_for(reader.read(), WAIT_S)
    writer.close()
    return answer


async def the_page_and_the_stream_come_by_tls(folder):
    cert, key = certificate(folder, "good")
    async with Daemon(*SKY, "--tls-cert", str(cert), "--tls-key", str(key)) as daemon:
        check(daemon.url.startswith("wss://"), f"it calls itself {daemon.url}")
        port, context = port_of(daemon.url), trust(cert)
        page = await get(port, context, "/")
        whole = page.startswith(b"HTTP/1.1 200") and page.rstrip().endswith(b"</html>")
        check(whole, f"no page: {page[:80]} {page[-80:]}")
        large = await get(port, context, "/app.js")
        size = int(large.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
        check(len(large.split(b"\r\n\r\n", 1)[1]) == size, "a file came in part")
        async with websockets.connect(f"wss://localhost:{port}/ws", ssl=context, origin=f"https://localhost:{port}",
                                      subprotocols=["relight.v1"], compression=None, max_size=None) as link:
            await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}))
            await link.send(json.dumps({"op": "subscribe", "format": "exr_float"}))
            pictures = 0
            while pictures < 20:
                message = await asyncio.wait_for(link.recv(), WAIT_S)
                if isinstance(message, bytes):
                    check(message[80:84] == b"\x76\x2f\x31\x01", "not an EXR file")
                    await link.send(json.dumps({"op": "ack", "sequence": PICTURE.unpack_from(message)[4]}))
                    pictures += 1
        context.set_alpn_protocols(["h2", "http/1.1"])
        _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context, server_hostname="localhost")
        check(writer.get_extra_info("ssl_object").selected_alpn_protocol() != "h2", "HTTP/2 is offered")
        writer.close()


async def certificates_that_will_not_do_are_named(folder):
    (cert, key), (_, other) = certificate(folder, "good"), certificate(folder, "other")
    old, old_key = expired(folder)
    text = folder / "text.pem"
    text.write_text("no certificate\n")
    for arguments, words in ((("--tls-cert", cert), "need each other"),
                             (("--tls-cert", folder / "none.pem", "--tls-key", key), "none.pem: cannot be read"),
                             (("--tls-cert", cert, "--tls-key", folder / "none.key"), "none.key: cannot be read"),
                             (("--tls-cert", text, "--tls-key", key), "text.pem: is no certificate"),
                             (("--tls-cert", cert, "--tls-key", text), "text.pem: is no private key"),
                             (("--tls-cert", cert, "--tls-key", other), "other.key: is not the key of that"),
                             (("--tls-cert", old, "--tls-key", old_key), "old.pem: has expired")):
        process = await asyncio.create_subprocess_exec(str(BIN / "relightd"), "--port", "0", *map(str, arguments),
                                                       stderr=asyncio.subprocess.PIPE)
        _, said = await asyncio.wait_for(process.communicate(), WAIT_S)
        check(process.returncode == 2 and words in said.decode(), f"{arguments}: {process.returncode}, {said.decode()}")


async def a_bad_certificate_on_reload_changes_nothing(folder):
    cert, key = certificate(folder, "good")
    (folder / "config.json").write_text(json.dumps({"tls-cert": str(cert), "tls-key": str(key)}))
    async with Daemon(*SKY, "--config", str(folder / "config.json")) as daemon:
        context = trust(cert)
        cert.write_text("no certificate\n")
        daemon.process.send_signal(signal.SIGHUP)
        said = ""
        while "is no certificate" not in said:
            said = (await asyncio.wait_for(daemon.process.stderr.readline(), WAIT_S)).decode()
            check(said, "it ended")
        check((await get(port_of(daemon.url), context, "/healthz")).startswith(b"HTTP/1.1 200"), "it no longer answers")


async def plain_and_slow_ones_are_cut_off(folder):
    """Neither is answered in the clear nor kept for ever, and others go on."""
    cert, key = certificate(folder, "good")
    async with Daemon(*SKY, "--tls-cert", str(cert), "--tls-key", str(key)) as daemon:
        port = port_of(daemon.url)
        for words in (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"\x16\x03\x01\x02\x00\x01", b""):
            began = time.monotonic()
            with socket.create_connection(("127.0.0.1", port)) as s:
                s.setblocking(False)
                loop, heard = asyncio.get_running_loop(), b""
                if words:
                    await loop.sock_sendall(s, words)
                try:
                    while part := await asyncio.wait_for(loop.sock_recv(s, 4096), WAIT_S):
                        heard += part
                except ConnectionResetError:
                    pass
            check(b"HTTP/1.1 200" not in heard and b"<html" not in heard, f"answered in the clear: {heard[:80]}")
            print(f"{words[:8]}: cut after {time.monotonic() - began:.1f} s")
        check((await get(port, trust(cert), "/healthz")).startswith(b"HTTP/1.1 200"), "it no longer answers")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
