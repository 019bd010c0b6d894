#!/usr/bin/python3
"""Images between captured skies: of files, and of skies that come by themselves, as users run them."""

import asyncio
import json

from control import Party
from peer import check, expect, main, radiance, run, until
from still import Daemon
from watch import FEW, metrics, until_ready, value

RENDER = ("--size", "32x18", "--samples", "4", "--paths", "direct", "--edge-rays", "1")


async def render(*arguments):
    return await run("relight-render", *RENDER, *arguments)


def put(folder, number, level, size=(8, 4)):
    """A sky of the watched folder, complete at once."""
    hidden = folder / f".sky.{number}"
    hidden.write_bytes(radiance(level, size))
    hidden.rename(folder / f"sky.{number:02d}.hdr")


async def a_held_sequence_has_images_between_its_skies(folder):
    skies = folder / "skies"
    skies.mkdir()
    for k, level in ((0, 64), (1, 128), (2, 192)):
        put(skies, k, level)
    expect(await render("--source", skies, "--out", folder / "own.%02d.exr"), 0)
    expect(await render("--source", skies, "--hold", "5", "--out", folder / "all.%02d.exr"), 0, "11 images")
    for k in range(3):
        own, held = folder / f"own.{k:02d}.exr", folder / f"all.{5 * k:02d}.exr"
        check(own.read_bytes() == held.read_bytes(), f"the image of sky {k} is not the sky's own")
    halfway = (folder / "all.01.exr").read_bytes()
    check(halfway not in [(folder / f"own.{k:02d}.exr").read_bytes() for k in range(3)], "nothing between")
    expect(await render("--source", skies, "--hold", "5", "--between", "off", "--out", folder / "off.%02d.exr"), 0)
    check((folder / "off.04.exr").read_bytes() == (folder / "own.00.exr").read_bytes(), "--between off is not the sky before")
    # Any frame alone is the same as in the whole sequence.
    expect(await render("--source", skies, "--hold", "5", "--frames", "1-2", "--out", folder / "part.%02d.exr"), 0, "6 images")
    check((folder / "part.05.exr").read_bytes() == (folder / "all.05.exr").read_bytes(), "the numbers are others")


async def layouts_are_applied_once(folder):
    """Upside down, the sky lights from below, with images between skies and without."""
    for k in range(2):
        rows = b"".join(bytes((level,) * 3 + (129,)) * 32 for level in [200] * 8 + [10] * 8)
        (folder / f"sky.{k}.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n" + rows)
    source = ("--source", folder / "sky.%d.hdr", "--exposure", "0", "--samples", "64")
    expect(await render(*source, "--layout", "latlong-bottom", "--out", folder / "own.%d.exr"), 0)
    expect(await render(*source, "--layout", "latlong-bottom", "--hold", "3", "--out", folder / "held.%d.exr"), 0, "4 images")
    expect(await render(*source, "--out", folder / "upright.%d.exr"), 0)
    expect(await run("relight-diff", folder / "held.0.exr", folder / "own.0.exr", "--max-relmse", "0.01"), 0)
    expect(await run("relight-diff", folder / "upright.0.exr", folder / "own.0.exr", "--max-relmse", "0.01"), 1)


async def statistics_say_what_was_corrected(folder):
    """Every second sky is a fifth brighter, 0.27 stops: it loses them, and the image between is halfway."""
    skies = folder / "skies"
    skies.mkdir()
    for k in range(8):
        put(skies, k, 200 if k % 2 else 166, (64, 32))
    stats = folder / "stats.json"
    expect(await render("--source", skies, "--deflicker", "--hold", "2", "--stats", stats, "--out", folder / "x.%02d.exr"), 0)
    gains = [one["corrected"]["gain"] for one in json.loads(stats.read_text()) if "corrected" in one]
    check(len(gains) == 15, f"{len(gains)} records state a correction")
    for c in range(3):
        check(abs(gains[10][c] / gains[8][c] - 166 / 200) < 0.01, f"corrected by {gains}")
        check(abs(gains[9][c] - 0.5 * (gains[8][c] + gains[10][c])) < 1e-3, f"between two skies: {gains[8:11]}")
    expect(await render("--source", skies, "--stats", stats, "--out", folder / "x.%02d.exr"), 0)
    check("corrected" not in stats.read_text(), "corrections are stated though none was asked for")


async def what_makes_no_sense_is_refused_by_name(folder):
    put(folder, 0, 64)
    source = ("--source", folder / "sky.00.hdr", "--out", folder / "x.exr")
    expect(await render(*source, "--hold", "0"), 2, "--hold")
    expect(await render(*source, "--between", "zoom"), 2, "off, fade or motion")
    expect(await render(*source, "--align", "sun"), 2, "--place 48.14,11.58")
    expect(await render(*source, "--align", "sun", "--place", "100,10"), 2, "is not LATITUDE,LONGITUDE")
    expect(await render(*source, "--place", "10,10"), 0, "--place has no effect")
    expect(await render(*source, "--sun", "dim"), 2, "--sun")
    expect(await render("--source", "sky:", "--frames", "0-1", "--align", "sun", "--place", "10,10", "--out", folder / "x.%d.exr"), 2,
           "--align is for captured ones")
    expect(await render("--source", f"watch:{folder}", "--deflicker", "--frames", "0-1", "--out", folder / "x.%d.exr"), 2, "--deflicker")
    expect(await render(*source, "--align", "sun", "--place", "10,10"), 0, "nothing says when it was taken")


async def until_first_image(daemon, folder):
    put(folder, 99, 128)
    await until_ready(daemon)


def shaded(values):
    return value(values, "relightd_frames_total", fate="shaded", reason="")


async def slow_skies_get_images_between(folder):
    """Skies come every 0.7 s or more: more images than skies are made, and the status says so."""
    async with Daemon("--source", f"watch:{folder}", *FEW, "--fps", "20") as daemon:
        await until_first_image(daemon, folder)
        viewer = await Party.come(daemon.url, "viewer")
        hearing = asyncio.create_task(viewer.until(lambda: viewer.last["status"]["source"]["between"]))
        number = 0
        while not hearing.done() or shaded(await metrics(daemon)) < 2 * number:
            put(folder, number % 90, 60 + 30 * (number % 5))
            number += 1
            await asyncio.sleep(0.7)
        await hearing
        check("the sun moves" in viewer.last["status"]["source"]["between"], viewer.last["status"]["source"])
        check(viewer.last["status"]["source"]["delay_s"] > 0.4, viewer.last["status"]["source"])


async def slow_skies_are_shown_as_they_come_if_asked(folder):
    async with Daemon("--source", f"watch:{folder}", "--between", "off", *FEW) as daemon:
        await until_first_image(daemon, folder)
        for k in range(5):
            put(folder, k, 60 + 30 * k)
            await asyncio.sleep(0.7)
        async def all_came():
            return value(await metrics(daemon), "relightd_frames_received_total") >= 6
        await until(all_came)
        check(shaded(await metrics(daemon)) <= 6, f"{shaded(await metrics(daemon))} images of 6 skies")


if __name__ == "__main__":
    main(globals())
