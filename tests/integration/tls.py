#!/usr/bin/python3
"""relightd's own TLS: the page and the stream over HTTPS and WSS, unusable certificates, and clients without or with
slow TLS. The clients are Python's ssl and python3-websockets; openssl makes the certificates."""

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

SKY = ("--source", "sky:size=128x64", "--size", "64x36", "--samples", "1", "--method", "mis", "--paths", "direct", "--edge-rays", "1")


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
CURVE = ("ec", "-pkeyopt", "ec_paramgen_curve:prime256v1")
NAME = ("-nodes", "-subj", "/CN=localhost")
KEY = ("-newkey", *CURVE, *NAME)


def openssl(*arguments):
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True)


def certificate(folder, name, kind=CURVE, days=30, names="DNS:localhost,IP:127.0.0.1"):
    if not shutil.which("openssl"):
        skip("openssl is not installed")
    cert, key = folder / f"{name}.pem", folder / f"{name}.key"
    openssl("req", "-x509", "-newkey", *kind, *NAME, "-days", days, "-addext",
            f"subjectAltName={names}", "-keyout", key, "-out", cert)
    return cert, key


def expired(folder):
    """Backdated to 2020, which only an authority can do."""
    cert, key, request, rules = (folder / f"old.{end}" for end in ("pem", "key", "csr", "conf"))
    rules.write_text(AUTHORITY.format(folder))
    (folder / "index").touch()
    (folder / "serial").write_text("01\n")
    openssl("req", "-new", *KEY, "-keyout", key, "-out", request)
    openssl("ca", "-batch", "-config", rules, "-selfsign", "-keyfile", key, "-in", request, "-out", cert, "-notext",
            "-startdate", "20200101000000Z", "-enddate", "20200201000000Z")
    return cert, key


def text_of(cert, *what):
    """openssl's output for -serial, -enddate."""
    said = subprocess.run(["openssl", "x509", "-in", str(cert), "-noout", *what], check=True, capture_output=True)
    return said.stdout.decode().split("=", 1)[1].strip()


def shown(port, kinds="DEFAULT"):
    """The serial number of the certificate that a new connection gets, whoever signed it."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    context.maximum_version = ssl.TLSVersion.TLSv1_2  # in TLS 1.2 the client's cipher list determines the type of key
    context.set_ciphers(kinds)
    with socket.create_connection(("127.0.0.1", port), WAIT_S) as plain, context.wrap_socket(plain) as link:
        der = link.getpeercert(binary_form=True)
    said = subprocess.run(["openssl", "x509", "-inform", "der", "-noout", "-serial"], input=der, check=True,
                          capture_output=True)
    return said.stdout.decode().split("=", 1)[1].strip()


async def renew(daemon, words):
    """Sends SIGHUP; returns the log up to these words."""
    daemon.process.send_signal(signal.SIGHUP)
    said = ""
    while words not in said:
        line = (await asyncio.wait_for(daemon.process.stderr.readline(), WAIT_S)).decode()
        check(line, f"it ended: {said}")
        said += line
    return said


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
                                      subprotocols=["relight.v1"], compression=None, max_size=None, ping_interval=None, max_queue=None) as link:
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
                             (("--tls-cert", text, "--tls-key", key), "text.pem: is not a PEM certificate"),
                             (("--tls-cert", cert, "--tls-key", text), "text.pem: is no private key"),
                             (("--tls-cert", cert, "--tls-key", other), "other.key: is not the key of that"),
                             (("--tls-cert", old, "--tls-key", old_key), "old.pem: has expired")):
        process = await asyncio.create_subprocess_exec(str(BIN / "relightd"), "--port", "0", *map(str, arguments),
                                                       stderr=asyncio.subprocess.PIPE)
        _, said = await asyncio.wait_for(process.communicate(), WAIT_S)
        check(process.returncode == 2 and words in said.decode(), f"{arguments}: {process.returncode}, {said.decode()}")


async def a_renewed_certificate_is_shown_to_those_who_come(folder):
    """A renewed certificate of the same type of key, and one of another type, after which the old one is never used
    again; existing connections stay."""
    cert, key = certificate(folder, "good")
    async with Daemon(*SKY, "--tls-cert", str(cert), "--tls-key", str(key)) as daemon:
        port = port_of(daemon.url)
        check(f"{cert}: is valid until " in daemon.before, f"not until when: {daemon.before}")
        serials = [text_of(cert, "-serial")]
        check(shown(port) == serials[0], "another certificate than its own")
        async with websockets.connect(f"wss://localhost:{port}/ws", ssl=trust(cert), subprotocols=["relight.v1"],
                                      origin=f"https://localhost:{port}", compression=None, max_size=None, ping_interval=None, max_queue=None) as link:
            await link.send(json.dumps({"op": "hello", "role": "viewer", "version": {"major": 1, "minor": 1}}))
            for kind in (CURVE, ("rsa:2048",), CURVE):
                certificate(folder, "good", kind)
                await renew(daemon, f"{cert}: is valid until ")
                serials.append(text_of(cert, "-serial"))
                check(shown(port) == serials[-1], f"shown is {shown(port)} of {serials}")
                check((await get(port, trust(cert), "/healthz")).startswith(b"HTTP/1.1 200"), "it does not answer")
                try:
                    other = shown(port, "ECDSA" if kind != CURVE else "aRSA")
                except ssl.SSLError:
                    other = None
                check(other is None, f"who takes another kind of key only is shown {other} of {serials}")
                await link.send(json.dumps({"op": "ping", "id": len(serials)}))
                while (said := json.loads(await asyncio.wait_for(link.recv(), WAIT_S)))["op"] != "pong":
                    pass
                check(said["id"] == len(serials), f"the open connection is told {said}")


async def renewed_files_may_have_other_names(folder):
    (cert, key), (other, other_key) = certificate(folder, "good"), certificate(folder, "other")
    config = folder / "config.json"
    config.write_text(json.dumps({"tls-cert": str(cert), "tls-key": str(key)}))
    async with Daemon(*SKY, "--config", str(config)) as daemon:
        config.write_text(json.dumps({"tls-cert": str(other), "tls-key": str(other_key)}))
        said = await renew(daemon, "reload: done")
        check("next start" not in said and f"tls-cert is {other}" in said, said)
        for _ in range(20 * WAIT_S):
            if shown(port_of(daemon.url)) == text_of(other, "-serial"):
                break
            await asyncio.sleep(0.05)
        check(shown(port_of(daemon.url)) == text_of(other, "-serial"), "the old one is shown")
        config.write_text("{}")
        said = await renew(daemon, "reload: done")
        check(f"tls-cert stays {other} until the next start" in said, said)
        check((await get(port_of(daemon.url), trust(other), "/healthz")).startswith(b"HTTP/1.1 200"), "no more TLS")


async def when_a_certificate_ends_is_told_and_warned_of(folder):
    cert, key = certificate(folder, "good", days=30)
    async with Daemon(*SKY, "--tls-cert", str(cert), "--tls-key", str(key)) as daemon:
        def ends():
            return ssl.cert_time_to_seconds(text_of(cert, "-enddate"))
        async def measured():
            text = (await get(port_of(daemon.url), trust(cert), "/metrics")).decode()
            return int(text.split("\nrelightd_tls_certificate_expires_seconds ")[1].split()[0])
        check("warning: --tls-cert" not in daemon.before, f"warned of 30 days: {daemon.before}")
        check(await measured() == ends(), f"{await measured()} is not {ends()}")
        certificate(folder, "good", days=13)
        said = await renew(daemon, f"{cert}: is valid until ")
        date = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(ends()))
        warning = f"relightd: warning: --tls-cert {cert}: is valid until {date}, {{}} days from now"
        check(warning.format(12) in said or warning.format(13) in said, said)
        check(await measured() == ends(), f"{await measured()} is not {ends()}")


async def a_bad_certificate_on_reload_changes_nothing(folder):
    cert, key = certificate(folder, "good")
    good, good_key = cert.read_bytes(), key.read_bytes()
    (folder / "config.json").write_text(json.dumps({"tls-cert": str(cert), "tls-key": str(key)}))
    async with Daemon(*SKY, "--config", str(folder / "config.json")) as daemon:
        port, context, serial = port_of(daemon.url), trust(cert), text_of(cert, "-serial")
        _, other_key = certificate(folder, "other")
        old, old_key = expired(folder)
        for files, words in (((b"no certificate\n", good_key), f"{cert}: is not a PEM certificate"),
                             ((good, other_key.read_bytes()), f"{key}: is not the key of that certificate"),
                             ((old.read_bytes(), old_key.read_bytes()), f"{cert}: has expired")):
            cert.write_bytes(files[0])
            key.write_bytes(files[1])
            said = await renew(daemon, "nothing has changed")
            check(words in said, f"no '{words}': {said}")
            check(shown(port) == serial, f"{words}: shown is {shown(port)}")
            check((await get(port, context, "/healthz")).startswith(b"HTTP/1.1 200"), "it no longer answers")
        cert.write_bytes(good)
        key.write_bytes(good_key)
        await renew(daemon, "reload: done")
        check(shown(port) == serial, "the good one is not taken after bad ones")


async def plain_and_slow_ones_are_cut_off(folder):
    """Neither gets a plain answer nor stays connected for ever, and others continue."""
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
