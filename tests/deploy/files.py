#!/usr/bin/python3
"""The files of deploy/ that our programs do not read: the container's commands against the tree and the package list,
metric names of the monitoring against /metrics, the example configuration against relightd."""

import asyncio
import json
import os
import re
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "integration"))
from live import free_port  # noqa: E402
from peer import BIN, WAIT_S, check, main  # noqa: E402
from still import Daemon  # noqa: E402

ROOT = Path(__file__).parent.parent.parent
DEPLOY = ROOT / "deploy"


def instructions():
    """Instructions of the container file: (name, words), without comments, with continued lines joined."""
    text = re.sub(r"^#.*\n", "", (DEPLOY / "Containerfile").read_text(), flags=re.M).replace("\\\n", " ")
    return [line.split(maxsplit=1) for line in text.splitlines() if line.strip()]


async def the_container_is_made_of_what_is_there(folder):
    steps = instructions()
    names = [name for name, _ in steps]
    check(set(names) <= {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENV", "VOLUME", "EXPOSE", "STOPSIGNAL", "HEALTHCHECK",
                         "ENTRYPOINT", "CMD"}, f"{names}")
    groups = {line.split()[0] for line in (DEPLOY / "packages.txt").read_text().splitlines()
              if line.strip() and not line.startswith("#")}
    for name, words in steps:
        if name == "COPY" and "--from" not in words:
            for source in words.split()[:-1]:
                check((ROOT / source).exists(), f"COPY {source}")
        if name == "FROM":
            check(re.match(r"docker\.io/library/debian:12-slim\b", words), f"another system than the packages are of: {words}")
        if name == "RUN":
            subprocess.run(["bash", "-n", "-c", words], check=True)
            for wanted in re.findall(r"install-packages\.sh ([a-z0-9 ]+)", words):
                check(set(wanted.split()) <= groups, f"no such groups: {wanted}")
                check({"build", "h264"} <= set(wanted.split()), "something is missing to build it")
        if name in ("ENTRYPOINT", "CMD") or (name == "HEALTHCHECK" and "CMD" in words):
            json.loads(words[words.index("["):])
    last = {name: words for name, words in steps}
    check(last["USER"] == "relightd", "it runs as root")
    runs = " ".join(words for name, words in steps if name == "RUN")
    owned = re.search(r"install -d -o relightd -g relightd -m 0700 ([a-z/ ]+)", runs)[1].split()
    check(owned == ["/var/lib/relightd", "/var/cache/relightd"] == last["VOLUME"].split(), f"it may write to {owned}")
    check("--no-create-home" in runs and "chmod o-w" in runs, "it may write elsewhere")
    entry = json.loads(last["ENTRYPOINT"])
    check(any(name == "COPY" and words.split() == ["deploy/container.sh", *entry] for name, words in steps), f"{entry} is not copied")


async def a_container_without_configuration_prints_links_with_tokens(folder):
    """container.sh, which the container runs, twice: the second start keeps the tokens."""
    state = folder / "state"
    state.mkdir()
    env = dict(os.environ, PATH=f"{BIN}:{os.environ['PATH']}", RELIGHT_CONFIG=str(folder / "none"), RELIGHT_STATE=str(state))
    links = []
    for _ in range(2):
        small = ("--port", str(free_port(socket.SOCK_STREAM)), "--size", "64x36", "--samples", "1", "--paths", "direct")
        daemon = subprocess.Popen([DEPLOY / "container.sh", *small], env=env, stderr=subprocess.PIPE, text=True)
        port, text = None, ""
        while port is None and (line := daemon.stderr.readline()):
            text += line
            port = re.search(r"listening on http://[^ ]*?:(\d+)/", line)
        check(port, f"it does not listen: {text}")
        links.append(dict(re.findall(r"^(viewer|controller) .*token=(\S+)$", text, re.M)))
        check(len(links[-1]) == 2, f"no links: {text}")
        def code(token):
            ask = urllib.request.Request(f"http://localhost:{port[1]}/snapshot.jpg", headers={"Authorization": f"Bearer {token}"})
            try:
                return urllib.request.urlopen(ask, timeout=WAIT_S).status
            except urllib.error.HTTPError as error:
                return error.code
        while (answer := code(links[-1]["viewer"])) == 503:  # no image yet
            await asyncio.sleep(0.1)
        check(answer == 200, f"the printed token is refused: {answer}")
        check(code("another") in (401, 403), "any token is good")
        daemon.terminate()
        daemon.communicate(timeout=WAIT_S)
        check(daemon.returncode == 0, f"the signal does not reach it: {daemon.returncode}")
    check(links[0] == links[1], "a restart makes new tokens")
    check(all(path.stat().st_mode & 0o077 == 0 for path in state.iterdir()), "others may read the tokens")
    (folder / "none").write_text('{ "port": "x" }\n')
    done = subprocess.run([DEPLOY / "container.sh"], env=env, capture_output=True, text=True, timeout=WAIT_S)
    check(done.returncode == 2 and "none:1: port" in done.stderr, f"the configuration is not read: {done.stderr}")


async def the_health_check_sees_health_and_its_end(folder):
    words = next(words for name, words in instructions() if name == "HEALTHCHECK")
    command = json.loads(words[words.index("["):])
    async with Daemon("--samples", "1") as daemon:
        port = re.search(r":(\d+)/", daemon.url).group(1)
        def run():
            return subprocess.run([w.replace("8080", port) for w in command], capture_output=True, timeout=WAIT_S).returncode
        check(run() == 0, "not healthy")
        daemon.process.terminate()
        await daemon.process.wait()
        check(run() != 0, "healthy after its end")


async def what_is_watched_is_what_is_told(folder):
    """Every metric and label name in rules and dashboard exists in /metrics."""
    async with Daemon("--samples", "1", "--publish", f"record:{folder}") as daemon:
        url = daemon.url.replace("ws:", "http:").removesuffix("ws")
        told = ""
        while "relightd_publish_state" not in told:
            await asyncio.sleep(0.1)
            with urllib.request.urlopen(url + "metrics", timeout=WAIT_S) as answer:
                told = answer.read().decode()
    names = set(re.findall(r"^# TYPE (\S+)", told, re.M))
    names |= {f"{name}_bucket" for name in re.findall(r"^# TYPE (\S+) histogram", told, re.M)}
    names.add("relightd_tls_certificate_expires_seconds")  # only with TLS: tests/integration/tls.py
    text = (DEPLOY / "relightd.rules.yml").read_text() + (DEPLOY / "grafana.json").read_text().replace('\\"', '"')
    used = set(re.findall(r"\b(?:relightd|process)_[a-z_]+\b", text))
    check(len(used) > 15 and used <= names, f"nobody tells {used - names}")
    for name, label, value in re.findall(r'\b((?:relightd|process)_[a-z_]+)\{([a-z]+)="([^"]+)"\}', text):
        check(label == "job" or re.search(rf'^{name}\{{[^}}]*{label}="{value}"', told, re.M), f"no {name}{{{label}={value}}}")
    for name in re.findall(r"by \(([a-z, ]+)\)", text):
        for label in name.split(", "):
            check(label in ("le", "instance") or f'{label}="' in told, f"no label {label}")


async def the_examples_make_sense_to_who_reads_them(folder):
    done = subprocess.run([BIN / "relightd", "--check-config", "--config", DEPLOY / "relightd.json"], capture_output=True, text=True)
    check(done.returncode == 0, done.stderr)
    board = json.loads((DEPLOY / "grafana.json").read_text())
    check(len({panel["id"] for panel in board["panels"]}) == len(board["panels"]), "panels with one id")
    try:
        import yaml
    except ImportError:
        return
    rules = yaml.safe_load((DEPLOY / "relightd.rules.yml").read_text())["groups"][0]["rules"]
    check(all({"alert", "expr", "labels", "annotations"} <= set(rule) for rule in rules), f"{rules}")
    scrape = yaml.safe_load((DEPLOY / "prometheus.yml").read_text())["scrape_configs"][0]
    check(scrape["metrics_path"] == "/metrics" and scrape["job_name"] == "relightd", f"{scrape}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
