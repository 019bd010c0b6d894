"""nginx with the settings of deploy/ and a test certificate, in front of relightd or alone; shared by the tests of this folder. Uses nginx
on the path, or the unpacked one in RELIGHT_TOOLS."""

import asyncio
import os
import re
import shutil
import socket
import ssl
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "integration"))
from peer import BIN, WAIT_S, check, skip  # noqa: E402

DEPLOY = Path(__file__).parent.parent.parent / "deploy"
SITE = DEPLOY / "nginx.conf"
NAME = "relight.example.org"


def find(program):
    tools = Path(os.environ.get("RELIGHT_TOOLS", "/nonexistent"))
    here = shutil.which(program) or next((str(p) for p in tools.glob(f"usr/*bin/{program}")), None)
    return here or skip(f"no {program}: deploy/install-packages.sh --unpack DIR unpack, and RELIGHT_TOOLS=DIR")


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as s:
        return s.getsockname()[1]


def substituted(text, *pairs):
    """A shipped file with other ports and folders: each pattern must stand there as often as is said."""
    for old, new, times in pairs:
        text, count = re.subn(old, new, text)
        check(count == times, f"'{old}' stands {count} times in the file")
    return text


class Nginx:
    """nginx with one site: .port speaks TLS. A subclass gives name, main() and site()."""

    name = NAME

    def __init__(self, folder):
        self.folder = folder
        self.port, self.plain = free_port(), free_port()
        self.processes = []

    def make_certificate(self):
        subprocess.run([find("openssl"), "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-days", "2", "-subj", f"/CN={self.name}", "-addext", f"subjectAltName=DNS:{self.name},DNS:localhost",
                        "-keyout", self.folder / "privkey.pem", "-out", self.folder / "fullchain.pem"],
                       check=True, capture_output=True)

    def main(self):
        """Outside `http`."""
        return ""

    def start(self, *command):
        log = open(self.folder / (Path(command[0]).name + ".log"), "w+")
        self.processes.append(subprocess.Popen(command, stderr=log, stdout=log,
                                               env=dict(os.environ, XDG_CACHE_HOME=str(self.folder))))
        return self.processes[-1]

    async def __aenter__(self):
        nginx = find("nginx")
        self.make_certificate()
        os.chmod(self.folder, 0o755)  # nginx's workers run as another user
        temporary = "".join(f"{kind}_temp_path {self.folder}/{kind};\n"
                            for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        (self.folder / "nginx.conf").write_text(
            f"daemon off; pid {self.folder}/pid; error_log stderr warn;\n{self.main()}\nevents {{ worker_connections 4096; }}\n"
            f"http {{ access_log off;\n{temporary}{self.site()}\n}}\n")
        self.start(nginx, "-e", "stderr", "-p", str(self.folder), "-c", str(self.folder / "nginx.conf"))
        await self.listens(self.port)
        return self

    def log(self, name):
        return (self.folder / f"{name}.log").read_text()

    async def listens(self, port):
        for _ in range(WAIT_S * 10):
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                return
            except OSError:
                check(all(p.poll() is None for p in self.processes), "".join(p.read_text() for p in self.folder.glob("*.log")))
                await asyncio.sleep(0.1)
        check(False, f"nobody listens at {port}: {self.log('nginx')}")

    async def __aexit__(self, *_):
        for process in reversed(self.processes):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()

    def trust(self):
        return ssl.create_default_context(cafile=str(self.folder / "fullchain.pem"))

    def request(self, path, name=None, plain=False, fields=""):
        """Status and whole response of one GET; fields: more of the request's head."""
        with socket.create_connection(("127.0.0.1", self.plain if plain else self.port), WAIT_S) as s:
            s = s if plain else self.trust().wrap_socket(s, server_hostname=self.name)
            s.sendall(f"GET {path} HTTP/1.1\r\nHost: {name or self.name}:{self.port}\r\nConnection: close\r\n{fields}\r\n".encode())
            answer = b""
            while piece := s.recv(65536):
                answer += piece
        return int(answer.split()[1]), answer


class Proxy(Nginx):
    """relightd with these arguments behind nginx: .port speaks TLS, .plain does not."""

    def __init__(self, folder, *arguments):
        super().__init__(folder)
        self.arguments = arguments
        self.inner = free_port()

    def site(self):
        """The shipped file with a different certificate and ports, otherwise unchanged."""
        return substituted(SITE.read_text(), (f"/etc/ssl/{NAME}/", f"{self.folder}/", 2), (r"127\.0\.0\.1:8080", f"127.0.0.1:{self.inner}", 1),
                           (r"listen 443 ssl", f"listen 127.0.0.1:{self.port} ssl", 1),
                           (r"listen 80;", f"listen 127.0.0.1:{self.plain};", 1))

    async def __aenter__(self):
        find("nginx")
        self.start(str(BIN / "relightd"), "--port", str(self.inner), "--behind-proxy", "--public-name", NAME, *self.arguments)
        await super().__aenter__()
        await self.listens(self.inner)
        for _ in range(WAIT_S * 10):
            if "listening on" in self.log("relightd"):
                return self
            await asyncio.sleep(0.1)
        check(False, self.log("relightd"))
