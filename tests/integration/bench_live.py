#!/usr/bin/python3
"""relight-bench --first-minute on a real relightd: the form of what it prints, and bad input. No speeds."""

import json
import os
import signal
from pathlib import Path

from peer import Program, check, expect, main, run

SMALL = ("--scenes", "builtin", "--size", "32x18", "--reference-samples", "4", "--cpu", "v3")
SKY = "sky:size=64x32,hour=10,speed=1"


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
            if str(folder) in command:
                found.append(command)
    return found


async def the_first_minute_judges_each_image_under_its_own_sky(folder):
    program = await (await bench(folder, "--first-minute", "--sources", f"sky={SKY}", "--seconds", "4", *SMALL, "--json").start()).end(600)
    expect(program, 0)
    report = json.loads(program.out)
    row, = report["rows"]
    images = row["images"]
    check(images and row["images_received"] >= len(images), row)
    frames = [image["frame"] for image in images]
    check(frames == sorted(set(frames)) and frames[0] == 0, frames)
    for image in images:
        check(image["standard_error"] > 0 and image["rel_mse"] < 1, image)
        check(0.8 < image["mean_ratio"] < 1.2, f"not of this sky: {image}")  # light at ten changes by 0.4 % a minute
        check(0 <= image["share"] <= 1 and image["by"] and 0 < image["seconds"], image)
    check(left_behind(folder) == [], left_behind(folder))


async def what_the_first_minute_cannot_measure_is_refused(folder):
    program = await (await bench(folder, "--first-minute", "--scenes", folder / "nowhere.json").start()).end()
    expect(program, 1, "nowhere.json")
    check(left_behind(folder) == [], left_behind(folder))
    expect(await run("relight-bench", "--first-minute", "--size", "wide"), 2, "--size wide")


async def an_interrupted_first_minute_leaves_nothing_behind(folder):
    program = await bench(folder, "--first-minute", "--sources", f"sky={SKY}", *SMALL).start()
    said = b""
    while b"s of images" not in said:
        said += await program.process.stderr.readline()
    program.process.send_signal(signal.SIGINT)
    await program.end()
    expect(program, 130)
    check(left_behind(folder) == [], left_behind(folder))


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if name.count("_") >= 2 and callable(f)})
