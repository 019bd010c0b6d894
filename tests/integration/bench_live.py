#!/usr/bin/python3
"""relight-bench --live and --first-minute on a real relightd: the form of what they print, what they count, and bad input. No
speeds."""

import json
import os
import signal
import socket
import sys
from pathlib import Path

from peer import Program, check, expect, main, run

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "server/measure/scripts"))
import first_minute  # noqa: E402
import live  # noqa: E402
import relightd  # noqa: E402
import viewer  # noqa: E402

SMALL = ("--scenes", "builtin", "--size", "32x18", "--reference-samples", "4", "--cpu", "v3")
SKY = "sky:size=64x32,hour=7,speed=10"  # twice as bright after three hours: references of another sky are noticed
SLOW_SKY = "sky:size=64x32,hour=10,speed=1"  # as before the cache is complete light lags behind the sky


def bench(folder, *arguments):
    """With temporary files in folder/tmp, which must be empty afterwards."""
    (folder / "tmp").mkdir(exist_ok=True)
    os.environ["TMPDIR"] = str(folder / "tmp")
    return Program("relight-bench", *arguments, "--references", folder / "references")


def left_behind(folder):
    """Folders and processes of a run that has ended."""
    found = [str(p) for p in (folder / "tmp").iterdir()]
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            if str(folder) in command and "bench_live.py" not in command:
                found.append(command)
    return found


async def the_first_minute_judges_each_image_under_its_own_sky(folder):
    program = await (await bench(folder, "--first-minute", "--sources", f"sky={SLOW_SKY}", "--seconds", "4", *SMALL, "--json").start()).end(600)
    expect(program, 0)
    report = json.loads(program.out)
    row, = report["rows"]
    images = row["images"]
    check(images and row["images_received"] >= len(images), row)
    frames = [image["frame"] for image in images]
    check(frames == sorted(set(frames)) and frames[0] == 0, frames)
    for image in images:
        check(image["standard_error"] > 0 and image["rel_mse"] < 1, image)
        check(0.7 < image["mean_ratio"] < 1.3, f"not of this sky: {image}")
        check(0 <= image["share"] <= 1 and image["by"] and 0 < image["seconds"], image)
    check(left_behind(folder) == [], left_behind(folder))


async def a_viewer_gets_what_live_states(folder):
    program = await (await bench(folder, "--live", "--sources", f"sky={SKY}", "--seconds", "1", "--patience", "2", *SMALL, "--json",
                                 folder / "report.json").start()).end(900)
    expect(program, 0)
    first, jpeg, h264 = json.loads((folder / "report.json").read_text())["rows"]
    check(first["kind"] == "first start" and 0 < first["first_s"] and 0 <= first["share"] <= 1 and first["peak_bytes"] > 1e7, first)
    check([jpeg["coding"], h264["coding"]] == ["jpeg", "h264"], h264)
    for row in (jpeg, h264):
        check(abs(row["images_per_s"] * row["seconds"] - row["images"]) < 1e-6 and 1 <= row["images"] <= row["messages"], row)
        check(row["latency_from"] == "capture" and 0 < row["latency_ms"] <= row["latency_p95_ms"], row)
        check(row["processor_ms"] > 0 and 0 < row["bytes"] < 20000 and row["peak_bytes"] > 1e7, row)
        check(row["flicker_converged"]["triples"] == 6, row)
        check(not row["flicker"] or row["flicker"]["p99_9"] <= row["flicker"]["most"], row)
    error = jpeg["error"]
    judged = [e["frame"] for e in error["frames"]] if error else []  # a slow viewer misses some, or all
    check(set(judged) <= set(range(8, 32, 3)) and h264["error"] is None, error)
    check(judged or jpeg["latency_p95_ms"] > 200, f"none of the frames was judged: {jpeg}")
    check(not judged or -2 * error["standard_error"] < error["rel_mse"] < 1 and 0.7 < error["mean_ratio"] < 1.3 and 0 < error["flip"] < 1, error)
    kept = sorted(p.name for p in (folder / "references").glob("*/*.*") if p.suffix)
    check(len(kept) == 2 * len(judged) + 8 + 2 * bool(judged) and not any("part" in name for name in kept), kept)
    check("first start" in program.out and "images/s" in program.out, program.out)
    check(left_behind(folder) == [], left_behind(folder))


def picture(frame, flags=0):
    return relightd.Picture(0.0, 0, True, 1, flags, frame, 1.0, 1, b"")


async def only_images_of_new_skies_are_counted(folder):
    del folder
    pictures = [picture(4), picture(5), picture(5), picture(5, relightd.FINER), picture(3, relightd.REPEAT),
                picture(6), picture(4, relightd.FINER), picture(6)]
    check([p.frame for p in viewer.new_skies(pictures, 4)] == [5, 6], viewer.new_skies(pictures, 4))
    check([p.frame for p in viewer.new_skies(pictures)] == [4, 5, 6], viewer.new_skies(pictures))


async def the_first_minute_has_its_targets(folder):
    del folder
    def image(seconds, by, error, ratio=1.0):
        return {"seconds": seconds, "by": by, "rel_mse": error, "standard_error": 1e-4, "mean_ratio": ratio}
    good = [image(1, "4 samples", 3e-2, 0.9), image(2, "8 samples", 1e-2), image(5, "cache", 1e-2), image(9, "cache", 4e-3)]
    found = first_minute.verdict(good, [(10, 60.0), (20, 50.0)])
    check(found == {"first_s": 1, "good_s": 2, "better_s": 9, "worse_than_denoised_s": [], "mean_off_s": [], "counts_up": []}, found)
    bad = good[:2] + [image(5, "cache", 2.5e-2, 0.98), image(9, "cache", 4e-3), image(12, "cache", 6e-3)]
    found = first_minute.verdict(bad, [(10, 60.0), (20, 70.0), (30, 65.0)])
    check(found == {"first_s": 1, "good_s": 9, "better_s": None, "worse_than_denoised_s": [5], "mean_off_s": [5], "counts_up": [20]}, found)


async def what_they_cannot_measure_is_refused(folder):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for mode in ("--live", "--first-minute"):
            program = await (await bench(folder, mode, "--port", port).start()).end()
            expect(program, 1, f"port {port} of 127.0.0.1: Address already in use")
            program = await (await bench(folder, mode, "--sources", SKY, *SMALL, "--scenes", folder / "nowhere.json").start()).end()
            expect(program, 1, "nowhere.json")
            check(left_behind(folder) == [], left_behind(folder))
            expect(await run("relight-bench", mode, "--size", "wide"), 2, "--size wide")


async def its_own_scenes_are_there(folder):
    inputs = live.Inputs(folder, False)
    for name in ("house", "ring", "product", "room"):
        check(os.path.getsize(inputs.scene(name, name)) > 0, name)


async def a_refused_cache_is_named(folder):
    program = await (await bench(folder, "--live", "--sources", f"sky={SKY}", *SMALL, "--cache-memory", "1", "--size", "160x90",
                                 "--json").start()).end(900)
    expect(program, 1, "the cache is refused: the cache of direct light for 160x90 needs about")
    row, = json.loads(program.out)["rows"]
    check("refused" in row["fault"], row)
    check(left_behind(folder) == [], left_behind(folder))


async def an_interrupt_leaves_nothing_behind(folder):
    for mode, sign in (("--first-minute", b"s of images"), ("--live", b"first start"), ("--live", b"converged sequence")):
        program = await bench(folder, mode, "--sources", f"sky={SKY}", "--seconds", "1", "--patience", "1", *SMALL).start()
        said = b" "
        while sign not in said:
            said = await program.process.stderr.readline()
            check(said, f"it ended before '{sign}'")
        program.process.send_signal(signal.SIGINT)
        await program.end()
        expect(program, 130)
        check(left_behind(folder) == [], left_behind(folder))


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if name.count("_") >= 2 and callable(f)})
