#!/usr/bin/python3
"""deploy/nginx-hls.conf and nginx-rtmp.conf in a real nginx: who serves what to whom, how long it may be kept, and that a stream sent by
RTMP arrives as HLS. No relightd answers any of it."""

import asyncio
import os
import re
import subprocess
import time
import urllib.request
from email.utils import formatdate
from pathlib import Path

from proxy import DEPLOY, Nginx, find, free_port, substituted
from peer import BIN, WAIT_S, check, main, skip

WEB = DEPLOY.parent / "clients" / "web"


def module():
    tools = Path(os.environ.get("RELIGHT_TOOLS", "/nonexistent"))
    for root in ("/", tools):
        path = Path(root, "usr/lib/nginx/modules/ngx_rtmp_module.so")
        if path.exists():
            return path
    return skip("no libnginx-mod-rtmp: deploy/install-packages.sh --unpack DIR unpack, and RELIGHT_TOOLS=DIR")


def types():
    tools = Path(os.environ.get("RELIGHT_TOOLS", "/nonexistent"))
    return next(path for path in (Path("/etc/nginx/mime.types"), tools / "etc/nginx/mime.types") if path.exists())


class Site(Nginx):
    """The shipped site, with the folder .hls; rtmp: and the shipped ingest at .rtmp."""

    name = "watch.example.org"

    def __init__(self, folder, rtmp=False):
        super().__init__(folder)
        self.rtmp = free_port() if rtmp else None
        self.hls = folder / "hls"
        self.hls.mkdir()
        os.chmod(self.hls, 0o777)  # nginx's workers run as another user

    def main(self):
        if not self.rtmp:
            return ""
        text = (DEPLOY / "nginx-rtmp.conf").read_text()
        check(not re.search(r"^ *(exec|-|/var).*\$", text, re.M), "a publisher's name becomes a part of a path")
        text = substituted(text, (r"listen 1935", f"listen 127.0.0.1:{self.rtmp}", 1),
                           (r"127\.0\.0\.1:1935", f"127.0.0.1:{self.rtmp}", 1), (r"(?<!www-data )/var/lib/nginx/relightd-hls", str(self.hls), 2),
                           (r"/usr/bin/ffmpeg", find("ffmpeg"), 1), # without nginx installed there is no /var/log/nginx
                           (r"rtmp \{", f"rtmp {{ access_log {self.folder}/rtmp.log;", 1))
        return f"load_module {module()};\n{text}"

    def site(self):
        return f"include {types()};\n" + substituted(
            (DEPLOY / "nginx-hls.conf").read_text(), (f"/etc/ssl/{self.name}/", f"{self.folder}/", 2),
            (r"listen 443 ssl", f"listen 127.0.0.1:{self.port} ssl", 1), (r"set \$hls [^;]*;", f"set $hls {self.hls};", 1),
            (r"/usr/share/relightd/web", str(WEB), 1))

    def ask(self, path, fields=""):
        """Status, headers by their names in small letters, body."""
        status, answer = self.request(path, fields=fields)
        head, _, body = answer.partition(b"\r\n\r\n")
        lines = [line.decode().partition(": ") for line in head.split(b"\r\n")[1:]]
        return status, {name.lower(): value for name, _, value in lines}, body


def expect(answer, **wanted):
    """Headers with these values; None: absent."""
    status, headers, _ = answer
    check(status == 200, f"{status} {headers}")
    for name, value in wanted.items():
        got = headers.get(name.replace("_", "-"))
        check(got == value, f"{name}: {got}, not {value}")


async def the_playlist_is_always_new_and_segments_may_be_kept(folder):
    async with Site(folder) as site:
        text = "#EXTM3U\n" + 500 * "#some lines\n"
        (site.hls / "live.m3u8").write_text(text)
        for name in ("live-7.m4s", "live.mp4", "live-7.ts"):
            (site.hls / name).write_bytes(1500 * b"segment ")
        zipped = "Accept-Encoding: gzip\r\n"
        expect(site.ask("/hls/live.m3u8"), content_type="application/vnd.apple.mpegurl", cache_control="max-age=0, s-maxage=1",
               access_control_allow_origin="*", etag=None, last_modified=None, content_length=str(len(text)))
        expect(site.ask("/hls/live.m3u8", zipped), content_encoding="gzip")
        for name, kind in (("live-7.m4s", "video/iso.segment"), ("live-7.ts", "video/mp2t")):
            expect(site.ask(f"/hls/{name}", zipped), content_type=kind, cache_control="public, max-age=31536000, immutable",
                   access_control_allow_origin="*", content_encoding=None, content_length="12000")
        expect(site.ask("/hls/live.mp4", zipped), content_type="video/mp4", cache_control="no-cache", access_control_allow_origin="*",
               content_encoding=None)
        status, headers, _ = site.ask("/hls/live-8.m4s")
        check(status == 404 and "cache-control" not in headers, f"what is not there yet must not be kept: {status} {headers}")
        # the same size within the same second, as a playlist with a new segment has: no validator may hide it
        (site.hls / "live.m3u8").write_text(text.replace("some", "else"))
        os.utime(site.hls / "live.m3u8", (1e9, 1e9))
        status, _, body = site.ask("/hls/live.m3u8", f"If-Modified-Since: {formatdate(1e9, usegmt=True)}\r\n")
        check(status == 200 and b"#else lines" in body, f"{status}: an old playlist")


async def nothing_else_is_served(folder):
    async with Site(folder) as site:
        (folder / "secret.m4s").write_text("secret")
        for name in ("live.m3u8.tmp", "notes.txt", ".hidden"):
            (site.hls / name).write_text("secret")
        (site.hls / "below").mkdir()
        (site.hls / "below" / "x.m4s").write_text("secret")
        for path in ("/hls/live.m3u8.tmp", "/hls/notes.txt", "/hls/.hidden", "/hls/", "/hls/below/x.m4s", "/hls/..%2fsecret.m4s",
                     "/hls/../secret.m4s", "/ws", "/metrics", "/hls/live.m3u8"):
            status, _, body = site.ask(path)
            check(status in (400, 403, 404) and b"secret" not in body, f"{path}: {status}")


async def the_page_is_served_with_relightds_headers(folder):
    async with Site(folder) as site:
        status, headers, _ = site.ask("/")
        check(status == 302 and headers["location"].endswith("/?from=hls"), f"{status} {headers}")
        expect(site.ask("/?from=hls"), content_type="text/html; charset=utf-8", cache_control="no-cache", x_content_type_options="nosniff",
               referrer_policy="no-referrer")
        expect(site.ask("/embed?from=hls"), content_type="text/html; charset=utf-8")
        for script in WEB.glob("*.js"):
            status, headers, body = site.ask(f"/{script.name}")
            check(status == 200 and "javascript" in headers["content-type"] and body == script.read_bytes(), f"{script.name}: {status} {headers}")
        # the policy is the one that relightd sends
        policy = site.ask("/?from=hls")[1]["content-security-policy"]
        with (folder / "relightd.log").open("w") as log:
            site.processes.append(subprocess.Popen([str(BIN / "relightd"), "--port", "0", "--size", "16x9", "--samples", "1"], stderr=log))
        for _ in range(WAIT_S * 10):
            if address := re.search(r"listening on (http://\S+)", site.log("relightd")):
                break
            time.sleep(0.1)
        with urllib.request.urlopen(address[1], timeout=WAIT_S) as answer:
            theirs = answer.headers["content-security-policy"]
        check(theirs == policy, f"nginx: {policy}\nrelightd: {theirs}")


def send(site, seconds, target="live/live"):
    return subprocess.Popen([find("ffmpeg"), "-nostdin", "-loglevel", "error", "-re", "-f", "lavfi", "-i", f"testsrc2=s=160x90:r=10:d={seconds}",
                             "-c:v", "libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-g", "10", "-pix_fmt", "yuv420p", "-f", "flv",
                             f"rtmp://127.0.0.1:{site.rtmp}/{target}"])


def until(what, act):
    for _ in range(WAIT_S * 10):
        if got := act():
            return got
        time.sleep(0.1)
    return check(False, what)


async def rtmp_in_is_hls_out(folder):
    async with Site(folder, rtmp=True) as site:
        playlist = lambda: site.ask("/hls/live.m3u8")[2].decode()  # noqa: E731
        sender = send(site, 60)
        text = until("no playlist", lambda: (t := playlist()).count(".m4s") >= 2 and t)
        check("#EXT-X-PROGRAM-DATE-TIME" in text and "#EXT-X-MAP:URI=\"live.mp4\"" in text, text)
        first = re.findall(r"live-\d+\.m4s", text)
        probed = subprocess.run([find("ffprobe"), "-loglevel", "error", "-tls_verify", "0", "-show_entries", "stream=codec_name,width,height",
                                 "-of", "csv=p=0", f"https://127.0.0.1:{site.port}/hls/live.m3u8"], capture_output=True, text=True, timeout=WAIT_S)
        check("h264,160,90" in probed.stdout, probed.stdout + probed.stderr)
        sender.terminate()
        sender.wait()
        until("the playlist does not end with its sender", lambda: "#EXT-X-ENDLIST" in playlist())
        # the next one uses no name again, since a CDN keeps segments
        sender = send(site, 60)
        again = until("no second stream", lambda: "#EXT-X-ENDLIST" not in (t := playlist()) and t.count(".m4s") >= 1 and t)
        sender.terminate()
        sender.wait()
        second = re.findall(r"live-\d+\.m4s", again)
        check(second and not set(first) & set(second), f"{first} {second}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
