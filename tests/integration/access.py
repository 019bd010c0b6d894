#!/usr/bin/python3
"""Links with tokens, their QR codes, and the server's own certificate. zbarimg reads the codes, Python's ssl and
relight-feed check the certificate."""

import asyncio
import os
import pty
import re
import shutil
import ssl
import stat
import subprocess
import urllib.error
import urllib.request

from peer import BIN, WAIT_S, check, expect, main, run, skip
from still import Daemon
from tls import certificate, port_of, renew, text_of

SKY = ("--source", "sky:size=128x64", "--size", "64x36", "--samples", "1", "--method", "mis", "--paths", "direct", "--edge-rays", "1")
BLOCKS = {" ": (0, 0), "\u2580": (1, 0), "\u2584": (0, 1), "\u2588": (1, 1)}


def links(*arguments, code=0):
    said = subprocess.run([BIN / "relightd", *map(str, arguments), "--show-link"], capture_output=True, text=True, timeout=WAIT_S)
    check(said.returncode == code, f"{said.returncode}: {said.stderr}")
    check("\033" not in said.stdout, "a QR code in a pipe")
    return said.stdout if code == 0 else said.stderr


async def links_have_the_tokens_of_their_role(folder):
    said = links()
    check("viewer      http://127.0.0.1:8080/#role=viewer\n" in said, said)
    check("controller  http://127.0.0.1:8080/#role=controller\n" in said, said)
    check("image       http://127.0.0.1:8080/snapshot.jpg\n" in said, said)
    (folder / "token").write_text("from a file\n")
    (folder / "token").chmod(0o600)
    said = links("--port", "9000", "--bind", "::1", "--token-viewer", "a b&'#c", "--token-controller-file", folder / "token",
                 "--token-producer", "it's", "--source", "push:")
    check("http://[::1]:9000/#role=viewer&token=a%20b%26%27%23c\n" in said, said)
    check("http://[::1]:9000/#role=controller&token=from%20a%20file\n" in said, said)
    check("http://viewer:a%20b%26%27%23c@[::1]:9000/snapshot.jpg\n" in said, said)
    check("RELIGHT_TOKEN='it'\\''s' relight-feed --to ws://[::1]:9000 SOURCE\n" in said, said)
    said = links("--behind-proxy", "--public-name", "relight.example.org,other.example.org", "--token-viewer", "v")
    check("https://relight.example.org/#role=viewer&token=v\n" in said, said)
    check("--port 0 takes any free port" in links("--port", "0", code=2), "no reason")


async def a_qr_code_on_a_terminal_is_the_link(folder):
    if not shutil.which("zbarimg"):
        skip("zbar-tools is not installed")
    ours, theirs = pty.openpty()
    process = subprocess.Popen([BIN / "relightd", "--token-viewer", "x" * 60, "--token-controller", "steer", "--show-link"],
                               stdout=theirs)
    os.close(theirs)
    said = b""
    try:
        while part := os.read(ours, 65536):
            said += part
    except OSError:  # the other end is closed
        pass
    check(process.wait() == 0, "it failed")
    text = said.decode().replace("\r", "")
    if "without libqrencode" in text:
        skip("built without libqrencode")
    wanted = re.findall(r"^(?:viewer|controller) +(\S+)$", text, re.M)
    check(len(wanted) == 2, text)
    for link, after in zip(wanted, text.split("http://")[1:]):
        lines = re.findall("\033\\[30;107m(.*)\033\\[0m", after)
        rows = [[BLOCKS[c][half] for c in line] for line in lines for half in (0, 1)]
        pixels = b"".join(bytes(0 if dark else 255 for dark in row for _ in range(4)) * 4 for row in rows)
        (folder / "code.pgm").write_bytes(b"P5 %d %d 255\n" % (4 * len(rows[0]), 4 * len(rows)) + pixels)
        read = subprocess.run(["zbarimg", "-q", "--raw", folder / "code.pgm"], capture_output=True, text=True, check=True)
        check(read.stdout.strip() == link, f"{read.stdout} instead of {link}")


async def one_flag_makes_tokens_and_certificate_and_prints_the_links(folder):
    said = links("--share", folder / "share", "--source", "push:")
    check(stat.S_IMODE((folder / "share").stat().st_mode) == 0o700, "others may look into the folder")
    tokens = {}
    for role in "viewer", "controller", "producer", "recorder":
        path = folder / "share" / f"token-{role}"
        tokens[role] = path.read_text().strip()
        check(re.fullmatch("[0-9a-f]{32}", tokens[role]), f"{role}: {tokens[role]!r}")
        check(stat.S_IMODE(path.stat().st_mode) == 0o600, f"{role}: others may read it")
        check(tokens[role] in said, f"{role}: {said}")
    check(len(set(tokens.values())) == 4, "roles share a token")
    check(re.search(r"^viewer +https://[^/]+/#role=viewer&token=" + tokens["viewer"], said, re.M), said)
    check(links("--share", folder / "share", "--source", "push:") == said, "the second start makes others")
    given = links("--share", folder / "share", "--token-viewer", "one that was given", "--bind", "127.0.0.1")
    check("one%20that%20was%20given" in given and tokens["viewer"] not in given, given)
    (folder / "open").mkdir()
    (folder / "open").chmod(0o777)
    check("other users may write to it" in links("--share", folder / "open", code=2), "a folder that all may write to is taken")
    (folder / "link").symlink_to(folder / "share")
    check("is not a folder" in links("--share", folder / "link", code=2), "a link is taken")
    async with Daemon(*SKY, "--share", str(folder / "share")) as daemon:
        context = ssl.create_default_context(cafile=folder / "share" / "cert.pem")
        def status(token):
            request = urllib.request.Request(f"https://127.0.0.1:{port_of(daemon.url)}/snapshot.jpg", headers={"Authorization": f"Bearer {token}"})
            try:
                return urllib.request.urlopen(request, context=context, timeout=WAIT_S).status
            except urllib.error.HTTPError as refusal:
                return refusal.code
        check(await asyncio.to_thread(status, "wrong") == 401, "a wrong token is taken")
        check(await asyncio.to_thread(status, tokens["viewer"]) in (200, 503), "the right token is refused")


async def what_tokens_do_not_protect_is_warned_about(folder):
    """Where other machines reach the server; on loopback nothing is said."""
    long = [f"{role}-0123456789abcdef" for role in "vcpr"]

    async def said(*arguments):
        process = subprocess.Popen([BIN / "relightd", "--source", "push:", "--port", "0", *map(str, arguments)], stderr=subprocess.PIPE,
                                   text=True)
        lines = []
        for line in process.stderr:
            lines.append(line)
            if "listening" in line or "error" in line:
                break
        process.terminate()
        process.communicate()
        return "".join(lines)

    def flags(*tokens):
        roles = "viewer", "controller", "producer", "recorder"
        return [x for role, token in zip(roles, tokens) for x in (f"--token-{role}", token)]
    text = await said("--bind", "0.0.0.0", *flags("abc", "abc", "abc", long[3]))
    check(text.count("have the same token") == 3 and "every viewer can change settings for everybody" in text, text)
    check(text.count("has 3 characters: whoever reaches the port can guess it") == 3, text)
    check("without TLS everyone on the way can read tokens" in text, text)
    text = await said("--bind", "0.0.0.0", *flags(*long), "--tls-self-signed", folder / "tls")
    check("same token" not in text and "guess" not in text and "without TLS" not in text, text)
    text = await said(*flags("abc", "abc", "abc", "abc"))
    check("same token" not in text and "guess" not in text, text)
    text = await said("--behind-proxy", *flags("abc", long[1], long[2], long[3]))
    check("the viewers' token has 3 characters" in text, text)


def own(folder):
    return Daemon(*SKY, "--tls-self-signed", str(folder / "own"), "--public-name", "relight.lan")


async def the_servers_own_certificate_is_made_and_kept(folder):
    cert, key = folder / "own" / "cert.pem", folder / "own" / "key.pem"
    serials = set()
    for round_ in range(2):
        async with own(folder) as daemon:
            serials.add(text_of(cert, "-serial"))
            check(("made" if round_ == 0 else "using") in daemon.before, daemon.before)
            print_ = subprocess.run(["openssl", "x509", "-in", str(cert), "-noout", "-fingerprint", "-sha256"], check=True,
                                    capture_output=True, text=True).stdout.split("=")[1].strip()
            check(print_ in daemon.before, f"another fingerprint: {daemon.before}")
            check(stat.S_IMODE(key.stat().st_mode) == 0o600, "others may read the key")
            check(stat.S_IMODE(key.parent.stat().st_mode) == 0o700, "others may list the folder")
            context = ssl.create_default_context(cafile=str(cert))
            for host in "localhost", "127.0.0.1":
                with urllib.request.urlopen(f"https://{host}:{port_of(daemon.url)}/healthz", timeout=WAIT_S, context=context) as answer:
                    check(answer.status == 200, "no page")
            await renew(daemon, "reload: done")
    check(len(serials) == 1, "it was not kept")
    names = subprocess.run(["openssl", "x509", "-in", str(cert), "-noout", "-ext", "subjectAltName"], check=True,
                           capture_output=True, text=True).stdout
    check("DNS:relight.lan" in names and "IP Address:0:0:0:0:0:0:0:1" in names, names)


async def an_ending_or_foreign_certificate_is_dealt_with(folder):
    (folder / "own").mkdir()
    ending, its_key = certificate(folder, "ending", days=10)
    shutil.copy(ending, folder / "own" / "cert.pem")
    shutil.copy(its_key, folder / "own" / "key.pem")
    async with own(folder) as daemon:
        check("made" in daemon.before and text_of(ending, "-serial") != text_of(folder / "own" / "cert.pem", "-serial"), daemon.before)
    narrow, its_key = certificate(folder, "narrow", days=100)
    shutil.copy(narrow, folder / "own" / "cert.pem")
    shutil.copy(its_key, folder / "own" / "key.pem")
    async with own(folder) as daemon:
        check("does not cover" in daemon.before and "DNS:relight.lan" in daemon.before, daemon.before)
    (folder / "own" / "cert.pem").write_text("nonsense")
    for arguments, words in ((("--tls-self-signed", folder / "own"), "is not a PEM certificate"),
                             (("--tls-self-signed", folder / "no" / "such"), "cannot be made: No such file"),
                             (("--tls-self-signed", folder / "x", "--tls-cert", "a", "--tls-key", "b"), "exclude each other")):
        check(words in links(*arguments, code=2), words)


async def a_producer_trusts_the_servers_own_certificate(folder):
    async with Daemon("--source", "push:", "--size", "64x36", "--samples", "1", "--method", "mis", "--tls-self-signed",
                      str(folder / "own")) as daemon:
        to = ("--to", f"wss://localhost:{port_of(daemon.url)}", "--retry", "0", "--frames", "1-3", "sky:size=64x32")
        expect(await run("relight-feed", *to, "--ca", folder / "own" / "cert.pem"), 0)
        expect(await run("relight-feed", *to), 1, "its certificate is not trusted")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
