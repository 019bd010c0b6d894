#!/usr/bin/python3
"""Cameras that the scene does not have: by flags, from controllers, saved by name and kept across restarts."""

import asyncio
import json

from control import Party
from peer import BIN, check, expect, main, run
from still import Daemon

STILL = ("--source", "sky:size=128x64,time=10:00", "--method", "mis", "--samples", "4", "--paths", "direct")
SIZE = ("--size", "96x54")
SIDE = "@-6,3,6;0,1,0;50"


async def flags_place_the_camera_as_a_scene_file_does(folder):
    camera = {"position": [-6, 3, 6], "look_at": [0, 1, 0], "fov_y_degrees": 50}
    ball = {"models": [{"file": "ball.obj", "material": "grey"}], "materials": {"grey": {"type": "lambert", "albedo": [0.5, 0.5, 0.5]}}}
    (folder / "ball.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n")
    for name, placed in ("there", camera), ("elsewhere", {"position": [9, 9, 9], "look_at": [0, 0, 0], "fov_y_degrees": 30}):
        (folder / f"{name}.json").write_text(json.dumps({**ball, "camera": placed}))

    async def render(name, out, *flags):
        expect(await run("relight-render", "--scene", folder / f"{name}.json", *STILL, *SIZE, *flags, "--out", folder / out), 0)
        return (folder / out).read_bytes()

    wanted = await render("there", "a.exr")
    moved = ("--position", "-6,3,6", "--look-at", "0,1,0", "--fov", "50")
    check(await render("elsewhere", "b.exr", *moved) == wanted, "another picture by flags")
    check(await render("elsewhere", "c.exr", "--camera", SIDE) == wanted, "another picture by a free view")
    check(await render("elsewhere", "d.exr", *moved[:2]) != wanted, "the position alone is enough")
    for flags, words in ((("--position", "1,2"), "--position 1,2: expected three numbers"),
                         (("--position", "1,2,3", "--look-at", "1,2,3"), "the point that it looks at"),
                         (("--camera", "@1,2,3"), "is not a view such as"), (("--fov", "0"), "--fov")):
        said = await run("relight-render", "--scene", folder / "there.json", *STILL, *SIZE, *flags, "--out", folder / "x.exr")
        expect(said, 2, words)


async def a_controller_moves_the_camera_freely(folder):
    async with Daemon(*STILL) as daemon:
        one, two = await Party.come(daemon.url, "controller"), await Party.come(daemon.url, "viewer")
        status = one.last["status"]
        check(status["view"].startswith("@"), status)
        first = status["camera"]
        for bad in "@1,2,3", "@1,2,3;1,2,3;40", "@0,0,0;1,1,1;500", "nowhere":
            error = await one.ask(camera=bad)
            check(error and error["clause"] == "4.13.15", f"{bad}: {error}")
        for i in range(8):  # as by dragging: those on the way may be shown, the last one is
            await one.ask(camera=f"@{i - 8},3,6;0,1,0;50")
        await one.ask(camera=SIDE)
        await two.until(lambda: two.last["status"]["view"] == SIDE and two.last["status"]["camera"] == SIDE)
        seen = len(two.gains)
        await two.until(lambda: len(two.gains) > seen)
        check(await one.ask(camera=first) is None, "no way back")
        await two.until(lambda: two.last["status"]["camera"] == first and two.last["status"]["view"] == status["view"])


async def a_moved_view_is_coarse_at_first(folder):
    del folder
    async with Daemon(*STILL, "--size", "320x180", "--edge-rays", "16") as daemon:
        one = await Party.come(daemon.url, "controller")
        await one.until(lambda: one.gains)
        # It is shown, with a picture, while it is computed once more: for how long depends on the machine, so that several may
        # have to be moved to before this is seen.
        for i in range(30):
            view = f"@-6,3,{6 + i};0,1,0;50"
            one.views.clear()
            await one.ask(camera=view)
            await one.until(lambda: one.last["status"]["camera"] == view and not one.last["status"]["preparing"])
            check(one.last["status"]["view"] == view, one.last["status"])
            if (view, view) in one.views:
                return
        check(False, "no view was coarse at first")


async def views_are_saved_by_name_and_kept(folder):
    keep = ("--state", str(folder / "state"))
    async with Daemon(*STILL, *keep) as daemon:
        one = await Party.come(daemon.url, "controller")
        cameras = one.last["status"]["offers"]["cameras"]
        await one.ask(camera=SIDE)
        check(await one.ask(save_view="from the side") is None, "not saved")
        await one.until(lambda: one.last["status"]["offers"]["cameras"] == cameras + ["from the side"])
        check(one.last["status"]["offers"]["views"] == ["from the side"], one.last["status"]["offers"])
        check(await one.ask(camera="from the side") is None, "not offered")
        await one.until(lambda: one.last["status"]["camera"] == "from the side" and one.last["status"]["view"] == SIDE)
        for wish in {"save_view": cameras[0]}, {"save_view": "@x"}, {"forget_view": "nothing"}, {"forget_view": "from the side"}:
            error = await one.ask(**wish)
            check(error and error["clause"] == "4.13.22", f"{wish}: {error}")
        for i in range(15):
            check(await one.ask(save_view=f"view {i}") is None, f"view {i}")
        error = await one.ask(save_view="one more")
        check(error and "16 views are saved already" in error["message"], f"{error}")
        check(await one.ask(forget_view="view 7") is None, "not forgotten")
        await one.until(lambda: len(one.last["status"]["offers"]["cameras"]) == len(cameras) + 15)
    async with Daemon(*STILL, *keep) as daemon:
        one = await Party.come(daemon.url, "controller")
        await one.until(lambda: one.last["status"]["view"] == SIDE)
        offered = one.last["status"]["offers"]["cameras"]
        check("from the side" in offered and "view 14" in offered and "view 7" not in offered, offered)
        check(one.last["control"]["camera"] == "from the side", one.last["control"])


if __name__ == "__main__":
    main({name: f for name, f in globals().items() if asyncio.iscoroutinefunction(f)})
