#!/usr/bin/python3
"""relightd --publish with real receivers: ffmpeg for RTMP, RTSP and SRT, ffprobe for HLS and recordings; and targets that are
dead, silent, slow or full, beside a viewer who must not notice."""

import asyncio
import contextlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import urllib.request
from pathlib import Path

from control import Party
from live import Sender, ffmpeg, free_port
from peer import WAIT_S, check, expect, main, run, skip
from still import Daemon

SMALL = ("--samples", "1", "--paths", "direct", "--edge-rays", "1")
SKY = ("--source", "sky:size=128x64,speed=1")
STILL = ("--source", "sky:size=128x64,speed=0", "--converge", "off")


def targets(*urls):
    return [word for url in urls for word in ("--publish", url)]


def told(party):
    """The targets by what they are called."""
    return {t["to"]: t for t in party.last["status"]["publish"]}


def frames(party, name):
    """How many pictures a target took; 0 before the status names it."""
    return told(party).get(name, {}).get("frames", 0)


def page(daemon, path):
    with urllib.request.urlopen(daemon.url.replace("ws://", "http://").removesuffix("ws") + path, timeout=WAIT_S) as answer:
        return answer.read()


async def ffprobe(*arguments):
    """What it prints. Viewers of this test answer pings meanwhile, or would be dropped on a busy machine."""
    process = await asyncio.create_subprocess_exec("ffprobe", "-v", "error", *map(str, arguments), stdout=asyncio.subprocess.PIPE,
                                                   stderr=asyncio.subprocess.PIPE)
    out, said = await asyncio.wait_for(process.communicate(), WAIT_S)
    check(process.returncode == 0, f"ffprobe {arguments}: {said.decode()}")
    return out.decode()


async def probe(path, *more):
    """What ffprobe says about a file's only stream, its packets included."""
    streams = json.loads(await ffprobe("-count_packets", "-show_streams", "-of", "json", *more, path))["streams"]
    check(len(streams) == 1, streams)
    return streams[0]


async def key_times(path):
    """Seconds of a file's keyframes."""
    said = await ffprobe("-show_entries", "packet=pts_time,flags", "-of", "csv=p=0", path)
    return [float(line.split(",")[0]) for line in said.split() if "K" in line.split(",")[1]]


def check_stream(stream):
    wanted = {"codec_name": "h264", "width": 96, "height": 54, "color_range": "pc", "color_space": "bt709",
              "color_transfer": "iec61966-2-1", "color_primaries": "bt709"}
    got = {key: stream.get(key) for key in wanted}
    check(got == wanted, f"{got} instead of {wanted}")


def boxes(path):
    """The kinds of an MP4 file's outermost boxes, which must fill it."""
    data, at, kinds = path.read_bytes(), 0, []
    while at < len(data):
        kinds.append(data[at + 4:at + 8].decode("latin1"))
        at += int.from_bytes(data[at:at + 4], "big")
    check(at == len(data), f"{path} is cut within {kinds[-1]}")
    return kinds


def receiver(*arguments, frames=30):
    """ffmpeg that takes so many frames and decodes them."""
    return Sender(*ffmpeg("-fflags", "nobuffer", "-probesize", "32768", "-analyzeduration", "200000", *arguments[:-1],
                          "-frames:v", frames, *arguments[-1]))


async def received(sender):
    """Waits until it has all frames."""
    await asyncio.wait_for(sender.process.wait(), WAIT_S)
    check(sender.process.returncode == 0, f"the receiver failed: {sender.arguments}")


def luma(rgb):
    """BT.709: it has all pixels, which colour in H.264 has not."""
    return [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in zip(rgb[::3], rgb[1::3], rgb[2::3])]


class Log:
    """Reads what relightd logs after it listens."""

    def __init__(self, daemon):
        self.text = daemon.before
        self.task = asyncio.create_task(self.read(daemon.process.stderr))

    async def read(self, stream):
        while line := await stream.readline():
            self.text += line.decode()


def note_waits(pid, waits):
    """{thread: nanoseconds for which it was ready, but had no processor}, also of threads that end meanwhile."""
    for path in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError):
            waits[path.parent.name] = int(path.read_text(encoding="ascii").split()[1])


async def stopped(daemon, log):
    """Ends relightd, which must not need its emergency exit after 5 s, unless it spent them waiting for a processor."""
    before, waits, ended = {}, {}, asyncio.ensure_future(daemon.process.wait())
    note_waits(daemon.process.pid, before)
    daemon.process.terminate()
    while not ended.done():
        note_waits(daemon.process.pid, waits)
        await asyncio.wait([ended], timeout=0.1)
    await log.task
    busy_s = sum(ns - before.get(thread, 0) for thread, ns in waits.items()) * 1e-9
    if "stopped while work was still running" in log.text and busy_s > 2:
        skip(f"on a busy machine it needed its emergency exit: its threads waited {busy_s:.1f} s for a processor")
    check(daemon.process.returncode == 0 and log.text.rstrip().endswith("relightd: stopped") and
          "left behind" not in log.text, f"no orderly end: {log.text}")


async def pictures_arrive_by_rtmp_rtsp_and_srt(folder):
    ports = [free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)]
    rgb = ("-f", "rawvideo", "-pix_fmt", "rgb24")
    inputs = [("-listen", "1", "-i", f"rtmp://127.0.0.1:{ports[0]}/live/stream"),
              ("-rtsp_flags", "listen", "-i", f"rtsp://127.0.0.1:{ports[1]}/stream"),
              ("-i", f"srt://127.0.0.1:{ports[2]}?mode=listener")]
    outputs = [folder / f"{name}.rgb" for name in ("rtmp", "rtsp", "srt")]
    one, two, three = (receiver(*given, (*rgb, path)) for given, path in zip(inputs, outputs))
    async with one, two, three:
        async with Daemon(*STILL, *SMALL, *targets(f"rtmp://127.0.0.1:{ports[0]}/live/stream", f"rtsp://127.0.0.1:{ports[1]}/stream",
                                                   f"srt://127.0.0.1:{ports[2]}")) as daemon:
            for sender in (one, two, three):
                await received(sender)
            seen = folder / "page.png"
            seen.write_bytes(page(daemon, "snapshot.png"))
            want = subprocess.run(ffmpeg("-i", seen, *rgb, "-"), capture_output=True, check=True).stdout
            for path in outputs:
                got = path.read_bytes()[-len(want):] # the last frame
                check(len(got) == len(want) == 3 * 96 * 54, f"{path}: {len(got)} bytes")
                off = sum(abs(a - b) for a, b in zip(luma(got), luma(want))) / (96 * 54)
                tint = max(abs(sum(got[c::3]) - sum(want[c::3])) for c in range(3)) / (96 * 54)
                check(off < 2 and tint < 1, f"{path.name} differs from the page by {off} and {tint} levels of 255")
    print("the still picture of the page arrived by RTMP, RTSP and SRT")


async def srt_receiver_may_call_and_call_again(folder):
    port = free_port(socket.SOCK_DGRAM)
    name = f"srt://127.0.0.1:{port}"
    async with Daemon(*SKY, *SMALL, *targets(f"{name}?mode=listener")) as daemon:
        log, party = Log(daemon), await Party.come(daemon.url, "viewer")
        for _ in range(2):
            await party.until(lambda: told(party).get(name, {}).get("detail") == "no receiver has connected yet")
            check(told(party)[name]["state"] == "waiting", told(party))
            async with receiver("-i", name, ("-f", "null", "-")) as sender:
                await received(sender)
        await stopped(daemon, log)


def playlist(path):
    """Segments of a media playlist in order, its initialization, and the number of the first segment."""
    text = path.read_text()
    for tag in ("#EXTM3U", "#EXT-X-VERSION:7", "#EXT-X-INDEPENDENT-SEGMENTS"):
        check(tag in text, f"no {tag}: {text}")
    check("ENDLIST" not in text, "the list ends, so players would not go on after a restart")
    longest = int(re.search(r"TARGETDURATION:(\d+)", text)[1])
    check(all(float(s) < longest + 0.5 for s in re.findall(r"#EXTINF:([\d.]+)", text)), text)
    return re.findall(r"^live-.*", text, re.M), re.search(r'MAP:URI="(.*?)"', text)[1], int(re.search(r"SEQUENCE:(\d+)", text)[1])


async def listed(party, path, count):
    await party.until(lambda: path.exists() and len(playlist(path)[0]) >= count)


def at_once(hls, folder):
    """A copy of the playlist and its segments, of which the oldest may go at any time."""
    while True:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        shutil.copy(hls / "live.m3u8", folder)
        segments, init, _ = playlist(folder / "live.m3u8")
        with contextlib.suppress(FileNotFoundError):
            for name in (init, *segments):
                shutil.copy(hls / name, folder)
            return folder


async def hls_segments_play_and_a_restart_reuses_no_name(folder):
    hls = folder / "www" / "hls"
    known = {}
    last = 0
    for turn in range(2):
        async with Daemon(*SKY, *SMALL, *targets(f"hls:{hls}")) as daemon:
            log, party = Log(daemon), await Party.come(daemon.url, "viewer")
            await party.until(lambda: told(party).get(f"hls:{hls}", {}).get("state") == "live")
            for old in known:
                check((hls / old).read_bytes() == known[old], f"{old} has been written again")
            await party.until(lambda: (hls / "live.m3u8").exists() and playlist(hls / "live.m3u8")[1] not in known and
                              len(playlist(hls / "live.m3u8")[0]) >= 2)
            copy = at_once(hls, folder / f"copy{turn}")
            segments, init, number = playlist(copy / "live.m3u8")
            check(all(os.stat(copy / name).st_mode & 0o444 == 0o444 for name in (init, "live.m3u8", *segments)),
                  "the web server may not read them")
            with open(copy / "live.m3u8", "a", encoding="ascii") as file:
                file.write("#EXT-X-ENDLIST\n")  # a reader waits for no more
            check(number > last, f"the media sequence went from {last} to {number}")
            check(not set(segments) & set(known), f"{segments} were there before")
            check_stream(await probe(copy / "live.m3u8", "-read_intervals", "%+2", "-live_start_index", "0"))
            for segment in segments: # each plays by itself
                whole = folder / "one.mp4"
                whole.write_bytes((copy / init).read_bytes() + (copy / segment).read_bytes())
                check(int((await probe(whole))["nb_read_packets"]) >= 1, f"{segment} is empty")
            await stopped(daemon, log)
            check((f"{hls}: made this folder" in log.text) == (turn == 0), f"a new folder is not told, or an old one is: {log.text}")
            known = {p.name: p.read_bytes() for p in hls.iterdir() if p.name != "live.m3u8"}
            check(all(p.suffix != ".part" for p in hls.iterdir()), "unfinished files stay")
            segments, _, number = playlist(hls / "live.m3u8")
            last = number + len(segments) - 1
    old = hls / "live-1000-1.m4s" # of an earlier run, and old
    old.write_bytes(b"x")
    os.utime(old, (1, 1))
    other = hls / "logo.png"
    other.write_bytes(b"x")
    os.utime(other, (1, 1))
    async with Daemon(*SKY, *SMALL, *targets(f"hls:{hls}")) as daemon:
        party = await Party.come(daemon.url, "viewer")
        await party.until(lambda: not old.exists())
        check(other.exists(), "a file that is not ours is gone")


async def recordings_play_also_after_a_kill(folder):
    def files(pattern):
        return sorted(p.name for p in folder.glob(pattern))
    url = f"record:{folder}?minutes=0.05"
    async with Daemon(*SKY, *SMALL, *targets(url)) as daemon:
        party = await Party.come(daemon.url, "viewer")
        await party.until(lambda: files("*.mp4"))
        whole = files("*.mp4")[0]
        check(re.fullmatch(r"relightd-\d{8}T\d{6}Z\.mp4", whole), whole)
        stream = await probe(folder / whole)
        check_stream(stream)
        check(boxes(folder / whole).count("moof") >= 2, "not in fragments")
        colour = b"colrnclx\0\1\0\x0d\0\1\x80" # BT.709, sRGB, BT.709, full range [ITU-T H.273]
        check(colour in (folder / whole).read_bytes(), "its header names no colours")
        starts = await key_times(folder / whole)
        check(float(stream["duration"]) >= 3 > starts[-1], f"{stream['duration']} s, keyframes at {starts}")
        await party.until(lambda: any(p.stat().st_size > 10000 for p in folder.glob("*.part")))
        daemon.process.kill()
        await daemon.process.wait()
    cut, = files("*.part")
    packets = int((await probe(folder / cut))["nb_read_packets"])
    check(packets >= 1, f"{packets} packets after a kill")
    before = {*files("*.mp4"), cut.removesuffix(".part")}
    async with Daemon(*SKY, *SMALL, *targets(url)) as daemon:
        log, party = Log(daemon), await Party.come(daemon.url, "viewer")
        await party.until(lambda: cut.removesuffix(".part") in files("*.mp4"))
        check(int((await probe(folder / cut.removesuffix(".part")))["nb_read_packets"]) == packets, "it has changed")
        await party.until(lambda: frames(party, f"record:{folder}") > 20)
        taken = frames(party, f"record:{folder}")
        await stopped(daemon, log)
    check(not files("*.part"), "unfinished files stay after an orderly end")
    kept = sum([int((await probe(folder / name))["nb_read_packets"]) for name in set(files("*.mp4")) - before])
    check(kept >= taken, f"{kept} pictures were kept of {taken}")


async def bad_targets_are_refused_before_anything_starts(folder):
    (folder / "file").write_text("")
    config = folder / "relightd.json"
    for given, said in (("https://a.example/SECRET", "--publish does not know 'https:'; it needs rtmp://HOST/APP/STREAM, "),
                        ("rtmp://u:SECRET@a.example", "--publish rtmp://a.example: names no stream"),
                        ("record:films?minutes=x", "'minutes=x' is not a number from 0.05 to 1440")):
        expect(await run("relightd", "--publish", given), 2, said)
        config.write_text(json.dumps({"publish": ["srt://a.example:9000", given]}))
        program = await run("relightd", "--config", config)
        expect(program, 2, "relightd.json:1: publish: ")
        check("SECRET" not in program.err, program.err)
    expect(await run("relightd", *targets("hls:x", "hls:x/")), 2, "--publish hls:x: given twice")
    expect(await run("relightd", "--check-config", *targets(f"hls:{folder}/file/hls")), 2,
           f"--publish hls:{folder}/file/hls: {folder}/file/hls cannot be written to: Not a directory")
    expect(await run("relightd", "--check-config", *SKY, "--port", "0", *targets(f"record:{folder}/new/films")), 0)
    check(not (folder / "new").exists(), "--check-config makes folders")


async def published_sky_does_not_pause_and_is_encoded_once(folder):
    names = [f"record:{folder}/{k}" for k in "ab"]
    config = folder / "relightd.json"
    config.write_text(json.dumps({"publish": names}))
    async with Daemon(*SKY, *SMALL, "--config", config) as daemon:
        log = Log(daemon)
        def figures():
            found = re.findall(r"^([a-z_]+)(\{.*\})? ([\d.e+-]+)$", page(daemon, "metrics").decode(), re.M)
            return {name + labels: float(value) for name, labels, value in found}
        published = f'relightd_publish_frames_total{{target="%d",to="%s"}}'
        # The counts of the targets are up to a second old: they come near the encoder's at some moment, or never.
        for _ in range(3000):
            now = figures()
            encoded = now['relightd_pictures_published_total{format="h264",size="whole"}']
            passed = [now.get(published % (k + 1, name), 0) for k, name in enumerate(names)]
            if max(passed) >= 60 and encoded <= max(passed) + 10:
                break
            await asyncio.sleep(0.1)
        else:
            check(False, f"{encoded} pictures were encoded for targets that took {passed}")
        shaded = now['relightd_frames_total{fate="shaded",reason=""}']
        check(shaded > max(passed) / 4, f"{shaded} skies were lit for {passed} pictures, as if nobody watched")
        config.write_text(json.dumps({"publish": [*names, "rtmp://a.example/live/SECRET"]}))
        daemon.process.send_signal(signal.SIGHUP)
        while "reload: done" not in log.text:
            await asyncio.sleep(0.05)
        check("reload: publish has changed; it stays until the next start" in log.text and "SECRET" not in log.text, log.text)
        await stopped(daemon, log)


class Silent:
    """Accepts connections and reads nothing."""

    def __enter__(self):
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.taken = []
        threading.Thread(target=self.accept, daemon=True).start()
        return self

    def accept(self):
        try:
            while True:
                self.taken.append(self.socket.accept())
        except OSError:
            pass

    def __exit__(self, *_):
        self.socket.close()


async def dead_and_silent_targets_disturb_nobody(folder):
    port, dead_srt = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    name = f"rtmp://127.0.0.1:{port}"
    with Silent() as silent:
        urls = (f"{name}/live/SECRET", f"rtsp://user:SECRET@127.0.0.1:{silent.port}/x", f"rtmp://127.0.0.1:{silent.port}/live/SECRET",
                f"srt://127.0.0.1:{dead_srt}?passphrase=SECRETSECRET", f"record:{folder}")
        async with Daemon(*SKY, *SMALL, *targets(*urls)) as daemon:
            log, party = Log(daemon), await Party.come(daemon.url, "viewer")
            await party.until(lambda: told(party).get(name, {}).get("state") == "retrying" and
                              frames(party, f"record:{folder}") >= 30)
            check(told(party)[name]["detail"] == "connecting: Connection refused", told(party)[name])
            await party.until(lambda: told(party)[f"rtsp://127.0.0.1:{silent.port}"]["state"] == "connecting")
            start = len(party.gains)
            await party.until(lambda: len(party.gains) >= start + 30)
            async with Sender(*ffmpeg("-listen", "1", "-i", urls[0], "-f", "null", "-")):
                await party.until(lambda: told(party)[name]["state"] == "live" and frames(party, name) > 0)
                metrics = page(daemon, "metrics").decode()
            check(f'relightd_publish_state{{target="1",to="{name}",state="live"}} 1' in metrics, metrics)
            check(re.search(rf'relightd_publish_retries_total{{target="1",to="{name}"}} [1-9]', metrics), metrics)
            check("SECRET" not in metrics + json.dumps(party.last), "a key is told")
            await stopped(daemon, log)
            check(all(line.startswith("relightd: ") for line in log.text.splitlines()), log.text) # and no library writes
            check("SECRET" not in log.text and f"publishing to {name}: connecting: Connection refused" in log.text, log.text)


async def slow_target_loses_pictures_and_nobody_else_does(folder):
    port = free_port(socket.SOCK_STREAM)
    name = f"rtmp://127.0.0.1:{port}"
    # Noise fills the sockets' buffers within seconds.
    noisy = (*SMALL, "--size", "640x360", "--quality", "100", "--h264-mbit", "500")
    async with Sender(*ffmpeg("-listen", "1", "-i", f"{name}/live/x", "-f", "null", "-")) as sender:
        async with Daemon(*SKY, *noisy, *targets(f"{name}/live/x", f"record:{folder}")) as daemon:
            log, party = Log(daemon), await Party.come(daemon.url, "viewer")
            await party.until(lambda: frames(party, name) > 20)
            sender.process.send_signal(signal.SIGSTOP)
            await party.until(lambda: told(party)[name]["dropped"] > 0 or told(party)[name]["state"] == "retrying")
            slow, other = told(party)[name], told(party)[f"record:{folder}"]
            check(other["dropped"] == 0 and other["state"] == "live" and other["frames"] > slow["frames"], (slow, other))
            await stopped(daemon, log)
            sender.process.send_signal(signal.SIGCONT)
    print(f"{slow['dropped']} pictures dropped, state {slow['state']}: {slow['detail']}")


async def full_disk_is_told_and_tried_again(folder):
    full = folder / "full"
    full.mkdir()
    if os.geteuid() != 0 or subprocess.run(("mount", "-t", "tmpfs", "-o", "size=256k", "none", full), check=False,
                                           capture_output=True).returncode != 0:
        skip("no tmpfs can be mounted here")
    try:
        names = [f"{kind}:{full}/{kind}" for kind in ("record", "hls")]
        async with Daemon(*SKY, *SMALL, *targets(*names, f"record:{folder}/ample")) as daemon:
            log, party = Log(daemon), await Party.come(daemon.url, "viewer")
            for name in names:
                await party.until(lambda n=name: told(party).get(n, {}).get("state") == "retrying")
                check(told(party)[name]["detail"].endswith("No space left on device"), told(party)[name])
            check(told(party)[f"record:{folder}/ample"]["state"] == "live", told(party))
            for path in (full / "record").glob("*.mp4"): # what fitted is kept whole
                check(int((await probe(path))["nb_read_packets"]) > 0 and boxes(path).count("mdat") > 0, path)
            shutil.rmtree(full / "hls")
            subprocess.run(("mount", "-o", "remount,size=64m", full), check=True)
            for name in names:
                await party.until(lambda n=name: told(party)[n]["state"] == "live")
            await stopped(daemon, log)
    finally:
        subprocess.run(("umount", full), check=False)


if __name__ == "__main__":
    main(globals())
