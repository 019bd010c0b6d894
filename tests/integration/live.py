#!/usr/bin/python3
"""Live streams and web servers as relightd's sky, sent by ffmpeg and by GStreamer's RTSP server: what comes, what viewers are
told when a stream is lost, and playlists that point at local files."""

import asyncio
import functools
import http.server
import shutil
import socket
import ssl
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

from control import Party
from peer import check, expect, main, run, skip, until
from still import Daemon
from tls import certificate

SMALL = ("--samples", "1", "--paths", "direct", "--edge-rays", "1")


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Sender:
    """A program that sends until the test ends."""

    def __init__(self, *arguments):
        self.arguments = arguments

    async def __aenter__(self):
        self.process = await asyncio.create_subprocess_exec(*map(str, self.arguments), stdout=asyncio.subprocess.PIPE,
                                                            stderr=asyncio.subprocess.DEVNULL)
        return self

    async def __aexit__(self, *_):
        if self.process.returncode is None:
            self.process.kill()
        await self.process.wait()


class Web:
    """A web server for a folder, with TLS if there is a certificate with its key."""

    def __init__(self, folder, port=0, tls=None):
        class Handler(http.server.SimpleHTTPRequestHandler):
            def log_message(self, *_):
                pass
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", port), functools.partial(Handler, directory=folder))
        self.server.handle_error = lambda *_: None  # clients that do not trust it break off
        if tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*tls)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.url = f"http{'s' if tls else ''}://localhost:{self.server.server_port}"

    def __enter__(self):
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.server_close()


def ffmpeg(*arguments):
    if not shutil.which("ffmpeg"):
        skip("ffmpeg is not installed")
    return ("ffmpeg", "-v", "error", "-y", *arguments)


def clip(folder, name="clip.mp4"):
    """Two seconds with a keyframe every ten frames."""
    path = folder / name
    subprocess.run(ffmpeg("-f", "lavfi", "-i", "testsrc2=s=128x64:r=25:d=2", "-c:v", "libx264", "-pix_fmt", "yuv420p",
                          "-g", "10", path), check=True)
    return path


def endless(path, *output):
    return Sender(*ffmpeg("-re", "-stream_loop", "-1", "-i", path, "-c", "copy", *output))


def source(party):
    return party.last["status"]["source"]


async def frames(party, count):
    """Waits until so many more frames were shown."""
    start = len(party.gains)
    await party.until(lambda: len(party.gains) >= start + count)


def check_captures(party, least_us):
    """The pictures tell when their skies were captured: since then, until now, and one after the other."""
    told = party.captures[-3:]
    check(all(least_us < t <= 1e6 * time.time() for t in told) and told == sorted(set(told)), f"captured at {told}")


async def srt_that_breaks_off_comes_back(folder):
    path = clip(folder)
    port = free_port(socket.SOCK_DGRAM)
    url = f"srt://127.0.0.1:{port}"
    listener = ("-f", "mpegts", url + "?mode=listener")
    begun_us = 1e6 * time.time()
    async with endless(path, *listener) as sender:
        async with Daemon("--source", url, *SMALL) as daemon:
            party = await Party.come(daemon.url, "viewer")
            await party.until(lambda: source(party)["state"] == "live")
            check(source(party)["kind"] == "live" and source(party)["length"] is None, f"not a live source: {source(party)}")
            await frames(party, 3)
            check_captures(party, begun_us)
            sender.process.kill()
            await party.until(lambda: source(party)["state"] == "waiting")
            detail = source(party)["detail"]
            check("trying again" in detail and "the last sky stays" in detail, f"viewers are told: {detail}")
            check(source(party)["position"] is not None, "the last sky is gone")
            async with endless(path, *listener):
                await party.until(lambda: source(party)["state"] == "live")
                await frames(party, 3)
            error = await (await Party.come(daemon.url, "controller")).ask(paused=True, seek=1)
            check(error and "live" in error["message"], f"a live source was moved: {error}")


async def stream_that_is_not_there_is_waited_for(folder):
    path = clip(folder)
    port = free_port(socket.SOCK_STREAM)
    url = f"rtmp://127.0.0.1:{port}/live/sky"
    async with Daemon("--source", f"rtmp://user:secret@127.0.0.1:{port}/live/sky", *SMALL) as daemon:
        party = await Party.come(daemon.url, "viewer")
        await party.until(lambda: "refused" in source(party)["detail"])
        check(source(party)["state"] == "waiting", f"state {source(party)}")
        check("secret" not in str(party.last), "the password is shown to viewers")
        check("last sky" not in source(party)["detail"], "there is no last sky yet")
        async with endless(path, "-f", "flv", "-listen", "1", url):
            await party.until(lambda: source(party)["state"] == "live")
            await frames(party, 2)


async def rtsp_of_gstreamer_is_a_source(folder):
    del folder
    try:
        import gi
        gi.require_version("GstRtspServer", "1.0")
    except (ImportError, ValueError):
        skip("gir1.2-gst-rtsp-server-1.0 is not installed")
    async with Sender(sys.executable, Path(__file__).with_name("rtsp_server.py")) as server:
        port = int(await server.process.stdout.readline())
        async with Daemon("--source", f"rtsp://127.0.0.1:{port}/sky", *SMALL) as daemon:
            party = await Party.come(daemon.url, "viewer")
            begun_us = 1e6 * time.time()
            await party.until(lambda: source(party)["state"] == "live")
            await frames(party, 5)
            check_captures(party, begun_us - 5e6)


async def live_playlist_is_a_source(folder):
    path = clip(folder)
    async with endless(path, "-f", "hls", "-hls_time", "1", "-hls_list_size", "3", folder / "live.m3u8"):
        await until((folder / "live.m3u8").exists)
        with Web(folder) as web:
            async with Daemon("--source", web.url + "/live.m3u8", *SMALL) as daemon:
                party = await Party.come(daemon.url, "viewer")
                await party.until(lambda: source(party)["state"] == "live")
                check(source(party)["kind"] == "live", f"not live: {source(party)}")
                await frames(party, 3)


async def video_of_a_web_server_plays_like_a_file(folder):
    clip(folder)
    with Web(folder) as web:
        program = await run("relight-render", "--source", web.url + "/clip.mp4", "--frames", "3-4", "--size", "32x18",
                            *SMALL, "--out", folder / "out.%d.exr")
        expect(program, 0)
        check(sorted(p.name for p in folder.glob("out.*")) == ["out.3.exr", "out.4.exr"], "other frames")
        program = await run("relight-render", "--source", web.url + "/none.mp4", "--out", folder / "none.exr")
        expect(program, 1, "404")
        program = await run("relight-feed", "--out", folder / "none.%d.exr", web.url + "/none.mp4")
        expect(program, 1, "404")  # at once: nobody waits for a web server to write files


async def web_server_that_is_down_is_waited_for(folder):
    clip(folder)
    port = free_port(socket.SOCK_STREAM)
    async with Daemon("--source", f"http://localhost:{port}/clip.mp4", *SMALL) as daemon:
        party = await Party.come(daemon.url, "controller")
        await party.until(lambda: "trying again" in source(party)["detail"])
        check(source(party)["state"] == "waiting" and source(party)["kind"] == "live", f"{source(party)}")
        with Web(folder, port):
            await party.until(lambda: source(party)["state"] == "live")
            await party.until(lambda: source(party)["length"] == 50)
            check(source(party)["kind"] == "files", f"it is no video that can be moved in: {source(party)}")
            check(await party.ask(paused=True) is None and await party.ask(seek=37) is None, "it cannot be moved")
            await party.until_place(37)


async def render_gives_up_a_stream_that_never_comes(folder):
    port = free_port(socket.SOCK_STREAM)
    program = await run("relight-render", "--source", f"rtsp://user:secret@127.0.0.1:{port}/sky", "--out", folder / "x.exr", *SMALL)
    expect(program, 1, "Connection refused; no frame came in 4 attempts")
    check("secret" not in program.err, "the password is shown")


async def what_is_no_video_is_an_error_at_once(folder):
    (folder / "page.html").write_text("<!DOCTYPE html><html><body>" + "no video " * 1000 + "</body></html>", encoding="ascii")
    with Web(folder) as web:
        for program in (("relightd", "--port", "0"), ("relight-render", "--out", folder / "x.exr"), ("relight-feed",)):
            url = (web.url + "/page.html",) if program[0] == "relight-feed" else ("--source", web.url + "/page.html")
            expect(await run(*program, *url), 1, "/page.html: not a video that this program can read")
    expect(await run("relight-render", "--out", folder / "x.exr", "--source", "gopher://x/y"), 2, "gopher:// is not a source; sources are rtsp://")
    expect(await run("relight-render", "--out", folder / "x.exr", "--source", "v4l2:video0"), 2, "expected v4l2:/dev/videoN")


async def camera_that_is_missing_is_named(folder):
    del folder
    async with Daemon("--source", "v4l2:/dev/video99", *SMALL) as daemon:
        party = await Party.come(daemon.url, "viewer")
        said = "v4l2:/dev/video99: cannot be opened: Cannot open video device /dev/video99: No such file"
        await party.until(lambda: source(party)["detail"].startswith(said) and "trying again" in source(party)["detail"])


async def certificates_of_sources_are_verified(folder):
    site, outside = folder / "site", folder / "outside"
    site.mkdir()
    outside.mkdir()
    path = clip(site)
    cert, key = certificate(folder, "good")
    other, _ = certificate(folder, "other")
    alien = certificate(folder, "alien", names="DNS:elsewhere.example.org")
    render = ("relight-render", "--frames", "0", "--size", "32x18", *SMALL, "--out", folder / "out.exr")
    with Web(site, tls=(cert, key)) as web, Web(site, tls=alien) as misnamed, Web(outside) as plain:
        subprocess.run(ffmpeg("-i", path, "-c", "copy", "-f", "hls", "-hls_base_url", web.url + "/", "-hls_segment_filename",
                              site / "v%d.ts", outside / "v.m3u8"), check=True)
        for url in (web.url + "/clip.mp4", plain.url + "/v.m3u8"):
            expect(await run(*render, "--source", url), 1, "its certificate is not trusted (Peer certificate failed verification): use --source-ca")
            expect(await run(*render, "--source", url, "--source-ca", other), 1, "its certificate is not trusted")
            check(not (folder / "out.exr").exists(), "a picture all the same")
            for ca in (cert, "none"):
                expect(await run(*render, "--source", url, "--source-ca", ca), 0)
                (folder / "out.exr").unlink()
        expect(await run(*render, "--source", misnamed.url + "/clip.mp4", "--source-ca", alien[0]), 1, "certificate")
        expect(await run(*render, "--source", web.url + "/clip.mp4", "--source-ca", folder / "no.pem"), 2, "no.pem: cannot be read")
        expect(await run(*render, "--source", "rtsps://localhost:1/sky"), 1, "cannot verify the certificate")
        expect(await run("relight-feed", "--frames", "0", web.url + "/clip.mp4"), 1, "its certificate is not trusted")


async def playlists_that_point_at_files_are_refused(folder):
    path = clip(folder, "secret.ts")
    for number, target in enumerate((f"file://{path}", str(path), f"concat:{path}", f"crypto+file://{path}",
                                     f"subfile,,start,0,end,0,,:{path}")):
        (folder / f"evil{number}.m3u8").write_text(
            f"#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXTINF:2,\n{target}\n#EXTINF:2,\n{target}\n#EXT-X-ENDLIST\n",
            encoding="ascii")
    with Web(folder / "..") as web:
        for number in range(5):
            program = await run("relight-render", "--source", f"{web.url}/{folder.name}/evil{number}.m3u8", "--size",
                                "32x18", *SMALL, "--out", folder / "evil.exr")
            check(program.code == 1, f"playlist {number}: exit code {program.code}")
            check(not (folder / "evil.exr").exists(), f"playlist {number} was read")
            if number == 0:
                expect(program, 1, "it may not open")


async def video_in_relightd_plays_at_its_rate_and_can_be_moved(folder):
    path = clip(folder)
    async with Daemon("--source", str(path), *SMALL) as daemon:
        party = await Party.come(daemon.url, "controller")
        await party.until(lambda: source(party)["state"] == "live")
        check(source(party)["kind"] == "files" and source(party)["length"] == 50, f"the source: {source(party)}")
        check(await party.ask(paused=True) is None, "it cannot be paused")
        check(await party.ask(seek=37) is None, "it cannot be moved")
        await party.until_place(37)
        check(await party.ask(step=-1) is None, "it cannot be moved back")
        await party.until_place(36)
        check(await party.ask(paused=False) is None, "it cannot go on")
        await party.until(lambda: 0 <= party.place() < 30)  # from the start again
        error = await party.ask(seek=50)
        check(error, "it has 50 frames")


async def feed_sends_a_video_frame_by_frame(folder):
    path = clip(folder)
    async with Daemon("--source", "push:", *SMALL) as daemon:
        program = await run("relight-feed", "--to", daemon.url.removesuffix("/ws"), "--frames", "0-4", "--json", path)
        expect(program, 0)
        check('"refused": 0' in program.out and '"sent": 5' in program.out, program.out)


# ---- Spherical metadata ----

def box(kind, *parts):
    body = b"".join(parts)
    return struct.pack(">I4s", 8 + len(body), kind) + body


def grow(data, path, inside, skipped):
    """Puts a box at the end of the box that the path names, and lets all boxes around it grow."""
    at, end, headers = 0, len(data), []
    for kind, skip_bytes in zip(path, skipped):
        while data[at + 4:at + 8] != kind:
            at += struct.unpack_from(">I", data, at)[0]
            check(at < end, f"no {kind}")
        headers.append(at)
        end = at + struct.unpack_from(">I", data, at)[0]
        at += 8 + skip_bytes
    grown = bytearray(data[:end] + inside + data[end:])
    for header in headers:
        struct.pack_into(">I", grown, header, struct.unpack_from(">I", data, header)[0] + len(inside))
    return bytes(grown)


def spherical(path, out, projection):
    """The clip with Google's spherical video metadata, version 2."""
    sv3d = box(b"sv3d", box(b"svhd", bytes(4), b"test\0"), box(b"proj", box(b"prhd", bytes(16)), projection))
    boxes = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"avc1")
    out.write_bytes(grow(path.read_bytes(), boxes, sv3d, (0, 0, 0, 0, 0, 8, 78)))


async def spherical_metadata_name_the_layout(folder):
    still = ("-f", "lavfi", "-i", "testsrc2=s=192x128:r=25:d=0.2", "-c:v", "libx264", "-qp", "0", "-pix_fmt", "yuv420p")
    subprocess.run(ffmpeg(*still, folder / "plain.mp4"), check=True)
    spherical(folder / "plain.mp4", folder / "cube.mp4", box(b"cbmp", bytes(12)))
    spherical(folder / "plain.mp4", folder / "padded.mp4", box(b"cbmp", bytes(8), struct.pack(">I", 4)))
    render = ("relight-render", "--frames", "0", "--size", "64x36", *SMALL, "--method", "uniform")
    expect(await run(*render, "--source", folder / "plain.mp4", "--out", folder / "none.exr"), 1, "--layout cube-3x2")
    expect(await run(*render, "--source", folder / "plain.mp4", "--layout", "cube-3x2", "--out", folder / "said.exr"), 0)
    expect(await run(*render, "--source", folder / "cube.mp4", "--out", folder / "read.exr"), 0)
    check((folder / "said.exr").read_bytes() == (folder / "read.exr").read_bytes(), "another picture than by --layout")
    expect(await run(*render, "--source", folder / "padded.mp4", "--out", folder / "none.exr"), 1, "a cube map with padding")


if __name__ == "__main__":
    main(globals())
