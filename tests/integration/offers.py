#!/usr/bin/python3
"""What is offered is accepted: the words of --help, of the manual, of the three shells' completions and of `--FLAG help` are the
same, and the programs take each; a controller may ask for each choice of a status, under skies and scenes that differ."""

import asyncio
import re
import shlex
import subprocess
from pathlib import Path

from control import Party
from peer import BIN, check, expect, main, radiance, run
from still import Daemon

PROGRAMS = ("relightd", "relight-render", "relight-bench", "relight-chart", "relight-diff", "relight-feed", "relight-record")
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"

# What a word is for, where it is not for a plain image: flags that go with it, or the file to write.
WITH = {"align sun": ["--place", "48,11"], 
    "method components": ["--parts", "145.mtx"], "tone pq": ["--out", "o.mp4"], "probe-preset fig1": ["--probe", "1,1"],
    **{f"reinhart {k}": ["--components", "none/%04d.hdr"] for k in (1, 2, 4)}, # up to 2,306 images: read, not made
    **{f"luminance {w}": ["--calibrate", "5000"] for w in ("rec709", "radiance")},
}
SHAPES = {"cube": (4, 24), "hcross": (16, 12), "vcross": (12, 16), "cube-3x2": (12, 8), "cube-6x1": (24, 4), "ball": (16, 16),
          "fisheye": (16, 16)}


def printed(program, *words):
    done = subprocess.run((BIN / program, *words), capture_output=True, text=True, check=False)
    check(done.returncode == 0 and not done.stderr, f"{program} {words}: {done.stderr}")
    return done.stdout


def words_of(program):
    """{flag: words}, the same wherever they are offered, and all flags."""
    bash, zsh, fish = (printed(program, f"--print-completion-{shell}") for shell in ("bash", "zsh", "fish"))
    text, manual = printed(program, "--help", "all"), printed(program, "--print-manual").replace("\\-", "-")
    flags = re.findall(r"^  --([a-z0-9-]+)", text, re.M)
    check(sorted(flags) == sorted(re.findall(r"^\\fB--([a-z0-9-]+)", manual, re.M)), f"{program}: manual")
    check(set(flags) == set(re.findall(r" --([a-z0-9-]+)", re.search(r"-W '( --.*?)'", bash)[1])), f"{program}: bash")
    check(set(flags) == set(re.findall(r"^    '\*?--([a-z0-9-]+)", zsh, re.M)) | {"version"}, f"{program}: zsh")
    check(set(flags) == set(re.findall(r" -l ([a-z0-9-]+)", fish)), f"{program}: fish")
    common = re.findall(r"^  --([a-z0-9-]+)", printed(program, "--help"), re.M)
    check(set(common) <= set(flags) and len(common) < 40, f"{program}: {common}")
    keys = re.findall(r"^  ([a-z][a-z-]*)(=?)", text, re.M)
    if "tune" in flags:
        words = " ".join("".join(k) for k in keys)
        check(len(keys) > 5 and re.findall(r"^  ([a-z][a-z-]*)(=?)", printed(program, "--tune", "help"), re.M) == keys, f"{program} --tune help")
        check(f"compgen -W '{words} help'" in bash and f":({words} help)'" in zsh and f"-xa '{words} help'" in fish, f"{program} --tune: {words}")
        check(all(f"\\fB{key}\\fR" in manual for key, _ in keys), f"{program} --tune: manual")
    found = {}
    for flag, words in re.findall(r"^    --([a-z0-9-]+)\) mapfile -t COMPREPLY < <\(compgen -W '(.*?)'", bash, re.M):
        *found[flag], last = words.split()
        check(last == "help", f"{program} --{flag}: {words}")
        words = " ".join(found[flag])
        check(f":({words} help)'" in zsh and f"-l {flag} " in fish and f"-xa '{words} help'" in fish, f"{program} --{flag}: shells")
        check(re.findall(r"^  ([a-z0-9-]+) +\S", printed(program, f"--{flag}", "help"), re.M) == found[flag], f"{program} --{flag} help")
        said = re.search(rf"^  --{flag} [^\n]*", text, re.M)[0]
        check(all(re.search(rf"[ ,]{re.escape(w)}\b", said) for w in found[flag]), f"{program} --help: {said}")
    return found


def map_for(layout, folder):
    width, height = SHAPES.get(layout, (8, 4))
    name = folder / f"{width}x{height}.hdr"
    name.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + bytes([128, 128, 128, 130]) * width * height)
    return name


async def render_takes_every_word_that_it_offers(folder):
    (folder / "145.mtx").write_text("#?RADIANCE\nNROWS=144\nNCOLS=146\nNCOMP=3\nFORMAT=ascii\n\n" + ("1 1 1 " * 146 + "\n") * 144)
    offered = words_of("relight-render")
    check({"method", "layout", "tone"} <= set(offered), f"{list(offered)}")
    for flag, words in offered.items():
        for word in words:
            more = [str(folder / w) if "." in w else w for w in WITH.get(f"{flag} {word}", [])]
            source = [] if "--components" in more else ["--frames", "0", "--source", map_for(word if flag == "layout" else "", folder)]
            out = [] if {"--out", "--components"} & set(more) else ["--out", folder / "o.png"]
            done = await run("relight-render", f"--{flag}", word, "--size", "16x9", "--lamps", "0", "--scene", str(EXAMPLES / "ball.obj"), *source, *out, *more)
            expect(done, 1 if flag == "reinhart" else 0)
            check(f"--{flag} has no effect" not in done.err, f"--{flag} {word}: {done.err}")


async def servers_and_senders_take_every_word_that_they_offer(folder):
    (folder / "145.mtx").write_text("")
    for program in PROGRAMS:
        for flag, words in words_of(program).items():
            for word in words:
                more = [str(folder / w) if "." in w else w for w in WITH.get(f"{flag} {word}", [])]
                sky = str(map_for(word if flag == "layout" else "", folder))
                if program == "relightd":
                    expect(await run(program, f"--{flag}", word, "--check-config", "--source", sky, *more), 0)
                elif program == "relight-feed":
                    expect(await run(program, f"--{flag}", word, "--out", folder / "f.exr", sky), 0)
                elif program == "relight-record": # nobody is there; wrong usage would end it with 2 before
                    expect(await run(program, f"--{flag}", word, "--from", "ws://127.0.0.1:9", "--retry", "0", "--out", folder / "r%d.jpg"
                                     if word == "jpeg" else folder / "r%d.exr"), 1)


async def a_wrong_place_for_a_layout_is_refused_at_once(folder):
    """The computed sky is no cross; looking for a frame that fits would never end."""
    for program, more in (("relight-render", ["--out", folder / "a.png", "--frames", "0"]), ("relightd", ["--port", "0"])):
        expect(await run(program, "--layout", "hcross", "--size", "16x9", *more), 2, "--layout is for maps from files")


async def try_all(daemon, sky):
    """A controller asks for each choice; each gives a picture by it."""
    party = await Party.come(daemon.url, "controller")
    check("latlong" not in party.last["status"]["offers"]["methods"] or party.last["status"]["frame"] is not None, "offered before a sky is there")
    await party.until(lambda: len(party.gains) >= 2) # the status after the first may not know the sky's layout yet
    party.last.pop("status")
    await party.until(lambda: "status" in party.last)
    offers = {"method": "methods", "tone": "tones", "paths": "paths", "exposure_stops": "exposures"}
    tried = []
    for key, name in offers.items():
        for word in party.last["status"]["offers"][name]:
            error = await party.ask(**{key: word})
            check(not error, f"{sky}: {key} {word} is offered and refused: {error}")
            check(party.last["control"][key] == (None if word == "follow" else word), f"{sky}: {key} {word}: {party.last['control']}")
            if key == "method": # the others may change nothing
                before = len(party.gains)
                await party.until(lambda: len(party.gains) > before)
            tried.append(word)
        if key == "method":
            await party.ask(method="mis")
    party.last.pop("status")
    await party.until(lambda: "status" in party.last)
    frames = party.last["status"]["frames"]
    check(frames["refused"] == 0, f"{sky}: {frames}")
    await party.link.close()
    return tried


async def a_controller_may_ask_for_all_that_is_offered(folder):
    panoramic = None
    for sky, more in (("sky:size=64x32", ["--scene", str(EXAMPLES / "ring.json")]), (str(map_for("hcross", folder)), ["--layout", "hcross"]),
                      (str(map_for("fisheye", folder)), ["--layout", "fisheye", "--scene", str(EXAMPLES / "ring.json"), "--ground"])):
        async with Daemon("--source", sky, "--size", "32x18", "--samples", "1", "--cache-dir", "off", "--fps", "100",
                          "--max-picture-seconds", "86400", *more) as daemon:
            tried = await try_all(daemon, sky)
        panoramic = panoramic or set(tried)
        check("mis" in tried and "cached" in tried and len(tried) > 12, f"{sky}: {tried}")
        check(sky.startswith("sky:") or panoramic - set(tried) == {"latlong", "latlong-rows"}, f"{sky}: {tried}")


if __name__ == "__main__":
    main(globals())
