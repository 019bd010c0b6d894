#!/usr/bin/python3
"""The commands of README.md and of the users' pages in docs/ run as typed, in a folder that looks like a clone.

Each program there is a wrapper that keeps every flag and file but makes the work small: few pixels, samples and frames. A server runs
where others of its block talk to it, on a free port; elsewhere --check-config reads its flags and files. A client of a server on
another machine must get as far as trying to connect."""

import asyncio
import os
import re
import shutil
import socket
import stat
import subprocess
from pathlib import Path

from peer import BIN, WAIT_S, check, main

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ("relightd", "relight-render", "relight-feed", "relight-record", "relight-diff", "relight-chart", "relight-bench")
TYPED = re.compile(r"^(?:studio\$|rig\$)? *(?:sudo )?(?:RELIGHT_TOKEN=\S+ )?(?:build/bin/)?(?:\./run\b|relightd\b|relight-[a-z]+\b)")
# Lines around these commands that a shell understands, and that harm nothing.
SHELL = re.compile(r"^ *(?:mkdir|recorder=|scene=|wait\b|cat >|export PATH=|\(?umask|for role in|(?:python3 )?docs/examples/(?:house|product|weather)\.py)")
BY_OTHERS = re.compile(r"^(?:xdg-open|\./test|docs/examples/producer\.py|(?:python3|node) clients/|deploy/|docker|cmake|cd build|apt|systemctl|journalctl|curl|ffmpeg|mpirun|sbatch|gendaymtx|dctimestep|oconv|vwrays|#)")

WRAPPER = """#!/usr/bin/python3
import os, sys
name = os.path.basename(sys.argv[0])
args = sys.argv[1:]
if name == "run":
    name = "relightd"
few = {"--size": "32x32", "--samples": "1", "--eye-paths": "1", "--particles": "2000", "--rate": "60", "--fps": "60",
       "--budgets": "1,2", "--edge-rays": "1", "--error": "0.5"}
given = set()
def local(word):
    for sign in ("watch:/", "hls:/", "record:/"):
        if word.startswith(sign):
            word = word.replace(sign, sign + "root/", 1).replace("/root", "root", 1)
            os.makedirs(word.split(":", 1)[1].split("?")[0], exist_ok=True)
    if word.startswith("/"):
        word = "root" + word
    return word.replace("ws://127.0.0.1:8080", "ws://127.0.0.1:" + os.environ["PORT"])
for i, a in enumerate(args):
    args[i] = a = local(a)
    given.add(a)
    if a.startswith("sky:") and "size=" not in a:
        args[i] = a + ("" if a == "sky:" else ",") + "size=128x64"
    if i and args[i - 1] in few and not (args[i - 1] == "--size" and "--probe" in args):
        args[i] = few[args[i - 1]]
    if a.startswith("epw:") and {"--annual", "--sun-hours"} & set(args):
        args[i] = a + ",days=06-21"
    if i and args[i - 1] == "--frames" and "-" in a:
        args[i] = a.split("-")[0] + "-" + str(int(a.split("-")[0]) + 1)
extra = []
if name == "relight-render":
    for flag in ("--size", "--samples", "--eye-paths", "--particles"):
        if flag not in given and not given & {"--fps", "--error"} and not (flag == "--size" and "--probe" in given):
            extra += [flag, few[flag]]
    if "cached" in given and "--paths" not in given:  # most of its time is indirect light's
        extra += ["--paths", "direct"]
    if "--edge-rays" not in given:
        extra += ["--edge-rays", "1"]
if name == "relight-chart":
    extra += ["--size", "16x9", "--seeds", "4", "--reference", "4", "--techniques", "mis", "--sources", "sky:"]
    extra += [] if "--budgets" in given else ["--budgets", "1,2"]
if name == "relightd":
    extra += ["--port", os.environ["PORT"]] if os.environ["SERVE"] else ["--check-config"]
    if "--size" not in given:
        extra += ["--size", few["--size"]]
    if os.environ["SERVE"] and not given & {"--samples", "--method", "--error"}:  # all of a frame's time is taken otherwise
        extra += ["--samples", "1"]
if name in ("relight-feed", "relight-record"):
    if not given & {"--to", "--from", "--out"} or (name == "relight-record" and "--from" not in given):
        extra += ["--to" if name == "relight-feed" else "--from", "ws://127.0.0.1:" + os.environ["PORT"]]
os.execv(os.path.join(os.environ["RELIGHT_BIN"], name), [name] + args + extra)
"""


def commands(page):
    """The blocks of commands of a page: lists of (line, text), continued lines joined; a command in a table is a block of its own."""
    blocks, block, joined, start, fenced = [], [], "", 0, False
    for number, line in enumerate(page.read_text().split("\n") + [""], 1):
        fenced ^= line.startswith("```")
        if line.startswith("    ") and not fenced:
            joined += line[4:].rstrip()
            start = start or number
            if joined.endswith("\\"):
                joined = joined[:-1]
                continue
            block.append((start, joined))
            joined, start = "", 0
        elif line.strip() or not block:
            if block:
                blocks.append(block)
                block = []
            for code in re.findall(r"`([^`]+)`", line) if line.startswith("|") else []:
                code = code.replace("\\|", "|")
                if TYPED.match(code) and " -" in code and "..." not in code and " M " not in code:
                    blocks.append([(number, code)])
    if block:
        blocks.append(block)
    return [b for b in blocks if any(TYPED.match(text) or SHELL.match(text) for _, text in b)]


def wrap(clone):
    """Wrappers of the programs, where a build has them."""
    (clone / "build" / "bin").mkdir(parents=True)
    for name in PROGRAMS + ("../../run",):
        wrapper = clone / "build" / "bin" / name
        wrapper.write_text(WRAPPER)
        wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR)


def furnish(clone):
    """A folder like a clone whose programs are wrappers, with the files that readers are told to bring."""
    wrap(clone)
    for name in ("docs", "deploy", "clients", "tests"):
        (clone / name).symlink_to(ROOT / name)
    (clone / "captures").mkdir()
    render = [str(BIN / "relight-render"), "--size", "32x16", "--samples", "1", "--paths", "direct"]
    subprocess.run(render + ["--out", str(clone / "park.exr")], check=True, capture_output=True)
    for name in ("captures/sky", "sky"):
        for frame in range(2):
            shutil.copy(clone / "park.exr", clone / f"{name}.{frame:04d}.exr")
    (clone / "skies").mkdir()
    for minute in range(2):
        shutil.copy(clone / "park.exr", clone / f"skies/sky_20240612_14{minute:02d}00.exr")
    subprocess.run(render + ["--out", str(clone / "sky.jpg")], check=True, capture_output=True)
    subprocess.run(render + ["--source", "sky:speed=5", "--frames", "0-1", "--out", str(clone / "sky.mp4")], check=False, capture_output=True)
    (clone / "studio.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes([128, 128, 128, 129]) * 8)
    shutil.copy(clone / "studio.hdr", clone / "park.hdr")
    (clone / "city.mtx").write_text("#?RADIANCE\nNROWS=146\nNCOLS=1\nNCOMP=3\nFORMAT=ascii\n\n" + "1 1 1\n" * 146)
    (clone / "suns.rad").write_text("void light solar720 0 0 3 1e6 1e6 1e6\nsolar720 source sun720 0 0 4 0 -0.6 0.8 0.533\n")
    with open(clone / "city.epw", "w") as out:
        subprocess.run([str(ROOT / "docs/examples/weather.py")], check=True, stdout=out)
    shutil.copy(ROOT / "docs/examples/table.obj", clone / "chair.obj")
    glb = subprocess.run(["/usr/bin/python3", "-c", GLB], capture_output=True, check=True).stdout
    for name in ("house.glb", "chair.glb"):
        (clone / name).write_bytes(glb)
    (clone / "root/etc/relightd").mkdir(parents=True)
    (clone / "root/etc/relightd/relightd.json").write_text('{ "bind": "127.0.0.1", "fps": 30 }\n')
    names = ["fullchain.pem", "cert.pem", "studio.pem", "studio-authority.pem", "lan-authority.pem"]
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj",
                    "/CN=relight.lan", "-keyout", "key.pem", "-out", names[0]], cwd=clone, check=True, capture_output=True)
    for name in names[1:]:
        shutil.copy(clone / names[0], clone / name)
    shutil.copy(clone / "key.pem", clone / "studio.key")


# A triangle as a binary glTF file.
GLB = r"""
import json, struct, sys
points = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
text = json.dumps({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "buffers": [{"byteLength": 36}], "bufferViews":
    [{"buffer": 0, "byteLength": 36}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
    "min": [0, 0, 0], "max": [1, 1, 0]}]}).encode()
text += b" " * (-len(text) % 4)
sys.stdout.buffer.write(struct.pack("<III", 0x46546C67, 2, 28 + len(text) + 36) + struct.pack("<II", len(text), 0x4E4F534A) + text +
    struct.pack("<II", 36, 0x004E4942) + points)
"""


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def script_of(block, page):
    """A block as a shell script, and whether its server is to run; None: nothing of ours in it."""
    lines = ["set -e"]
    serves = any(re.match(r"relightd\b.*&$", text) for _, text in block)
    for number, text in block:
        text = re.sub(r"^(?:studio|rig)\$ *", "", text)
        text = re.sub(r"^sudo ", "", text)
        if BY_OTHERS.match(text) or "..." in text:
            continue
        check(TYPED.match(text) or SHELL.match(text), f"{page}:{number}: is not known to this test: {text}")
        name = re.sub(r"^RELIGHT_TOKEN=\S+ ", "", text).split()[0]
        if re.search(r"relight-(?:feed|record)$", name) and not serves and not ("feed" in name and "--out" in text):
            text = f"timeout 2 {text} || {{ code=$?; [ $code != 2 ]; }}" if "RELIGHT_TOKEN" not in text else \
                text.replace("relight-feed", "timeout 2 relight-feed") + " || { code=$?; [ $code != 2 ]; }"
        if " | " in text and "ffplay" in text:
            text = text.split(" | ")[0] + " >piped"
        server = serves and re.match(r"relightd\b.*&$", text)
        lines.append(f"# line {number}\n{'rm -f server.log; ' + text[:-1] + '2>server.log &' if server else text}")
        if server: # it takes connections before it can be stopped in good order
            lines.append("server=$!; trap 'kill $server || true; wait $server || { cat server.log >&2; false; }' EXIT\n"
                         "until grep -qs 'listening on' server.log; do kill -0 $server; sleep 0.1; done")
    return "\n".join(lines), serves


def run_page(page, clone):
    count, faults = 0, []
    for block in commands(page):
        script, serves = script_of(block, page.name)
        env = dict(os.environ, PATH=f"{clone}/build/bin:{os.environ['PATH']}", RELIGHT_BIN=str(BIN), PORT=str(free_port()),
                   SERVE="1" if serves else "", RIG="a-token-for-the-rig-1", EYES="a-token-for-viewers-2", HAND="a-token-for-controllers-3",
                   XDG_CACHE_HOME=str(clone / "cache"))
        done = subprocess.run(["bash", "-c", script], cwd=clone, env=env, capture_output=True, text=True, timeout=WAIT_S, check=False)
        where = f"{page.relative_to(ROOT)}:{block[0][0]}"
        away = re.search(r"--source '?(?:https?|rtsp|rtmp|srt|v4l2):", script) and "cannot be opened" in done.stderr
        if done.returncode != 0 and not away:
            faults.append(f"{where}: exit code {done.returncode}\n{script}\n{done.stderr[-1500:]}")
        count += sum(bool(TYPED.match(text)) for _, text in block)
    print(f"{page.name}: {count} commands")
    check(not faults, "\n".join(faults))
    return count


async def commands_of_the_readme_run(folder):
    clone = folder / "clone"
    furnish(clone)
    check(run_page(ROOT / "README.md", clone) >= 6, "commands are missing; are they still indented by four spaces?")


def run_pages(folder, first, last, least):
    """The users' pages whose names begin with these letters; commands.py has inputs-and-outputs.md."""
    clone = folder / "clone"
    furnish(clone)
    pages = [page for page in sorted((ROOT / "docs").glob("*.md")) if first <= page.name[0].lower() <= last and page.name != "inputs-and-outputs.md"]
    count = sum(run_page(page, clone) for page in pages)
    check(count >= least, f"only {count} commands found; are they still indented by four spaces?")


# Together these are the alphabet; each is short enough that none ends long after the others.
async def commands_of_pages_a_to_o_run(folder):
    run_pages(folder, "a", "o", 15)


async def commands_of_pages_p_to_r_run(folder):
    run_pages(folder, "p", "r", 20)


async def commands_of_pages_s_to_z_run(folder):
    run_pages(folder, "s", "z", 15)


async def a_wrong_flag_would_be_seen(folder):
    page = folder / "page.md"
    page.write_text("Try\n\n    relight-render --sample 8 --out x.exr\n")
    script, _ = script_of(commands(page)[0], "page.md")
    clone = folder / "clone"
    wrap(clone)
    env = dict(os.environ, PATH=f"{clone}/build/bin:{os.environ['PATH']}", RELIGHT_BIN=str(BIN), PORT="1", SERVE="")
    done = subprocess.run(["bash", "-c", script], cwd=clone, env=env, capture_output=True, text=True, timeout=WAIT_S, check=False)
    check(done.returncode == 2 and "--sample" in done.stderr, f"{done.returncode}: {done.stderr}")


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
