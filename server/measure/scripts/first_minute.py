"""--first-minute: how the error of a live image falls while the cache is computed and the sky moves. Images arrive as they do
at a viewer, as floats; each is judged against converged images of its own sky."""

import math
import os
import re
import shutil
import time

import truth
from relightd import FINER, REPEAT, Daemon, Failure, Viewer

MARKS_S = (1, 1.5, 2, 3, 4, 5, 7, 10, 14, 20, 30, 45, 60)  # after exec: of these the nearest images are judged
GOOD, GOOD_S = 2e-2, 3.0
BETTER, BETTER_S = 5e-3, 10.0
FIRST_S = 1.0
MEAN = 0.01  # of the mean's ratio, off 1
CURVE = 24


def watch(bench, scene, source):
    """Starts relightd without a cache; returns the images to judge, what each status said, and the log."""
    arguments = bench.arguments
    kept, first, statuses, logged = {}, [], [], []
    cache = os.path.join(bench.folder, "fresh")
    shutil.rmtree(cache, ignore_errors=True)
    flags = ["--size", arguments.sizes[0], "--source", source, "--cache-dir", cache, *(["--scene", scene] if scene else []), *bench.flags]
    with Daemon(bench.programs.folder, *flags, port=arguments.port) as daemon:
        daemon.wait_listening()
        seen = set()

        def take(picture):
            if picture.flags & (REPEAT | FINER) or picture.frame in seen:
                return
            seen.add(picture.frame)
            now_s = picture.received_s - daemon.begun_s
            if len(first) < 2:
                first.append(picture)
            for mark in MARKS_S:
                if mark not in kept or abs(now_s - mark) < abs(kept[mark].received_s - daemon.begun_s - mark):
                    kept[mark] = picture

        def note():
            if viewer.status:
                statuses.append((time.monotonic() - daemon.begun_s, daemon.processor_s(), daemon.cache_share(), viewer.status))

        with Viewer(daemon) as viewer:
            viewer.on_picture = take
            viewer.subscribe("exr_float")
            viewer.run(lambda: time.monotonic() - daemon.begun_s >= arguments.seconds and len(seen) >= 2,
                       max(arguments.seconds, arguments.patience), note)
            if len(seen) < 2:
                raise Failure(f"{len(seen)} images came within {arguments.patience:g} s")
        logged += daemon.lines
        begun_s = daemon.begun_s
    pictures = {p.frame: (p.received_s - begun_s, p) for p in first + list(kept.values())}
    return [pictures[frame] for frame in sorted(pictures)], statuses, logged, len(seen)


def curve(error):
    """A mark between 1e-1 and 1e-3."""
    at = 1.0 if error <= 0 else min(max(math.log10(1e-1 / error) / 2, 0.0), 1.0)
    return " " * int(at * (CURVE - 1)) + "*"


def measure(bench, scene_title, scene, source_title, source):
    arguments = bench.arguments
    bench.say(f"{scene_title}, {source_title}: {arguments.seconds:g} s of images")
    pictures, statuses, logged, count = watch(bench, scene, source)
    view = truth.View(bench.programs, os.path.join(bench.folder, "references"), scene, arguments.sizes[0], source,
                      arguments.reference_samples)
    images = []
    for number, (at_s, picture) in enumerate(pictures):
        bench.say(f"{scene_title}, {source_title}: reference {number + 1} of {len(pictures)}")
        path = os.path.join(bench.folder, "picture.exr")
        with open(path, "wb") as file:
            file.write(picture.payload)
        later = [s for s in statuses if s[3]["frame"] >= picture.frame]  # a status comes up to half a second after its image
        before = [s for s in statuses if s[0] <= at_s]
        status = later[0] if later else statuses[-1]
        light = status[3]["light"]
        images.append({**view.judge(path, picture.frame), "seconds": at_s, "processor_s": before[-1][1] if before else None,
                       "by": "cache" if status[3]["method"] == "cached" else f"{picture.samples} samples",
                       "share": status[2], "stated": light.get("error"), "stated_at_most": light.get("error_at_most")})
        for which in (0, 1):
            os.unlink(view.half(picture.frame, which))
    left = [(at, float(m[1])) for at, line in logged if (m := re.search(r"about ([0-9.]+) s left", line))]
    return {"scene": scene_title, "source": source_title, "spec": source, "size": arguments.sizes[0], "images": images,
            "images_received": count, "time_left": left, **verdict(images, left)}


def verdict(images, left):
    """The targets. An error counts as above a limit only beyond two of its standard errors."""
    def above(image, limit):
        return image["rel_mse"] - 2 * image["standard_error"] > limit
    def from_when(limit):
        """When the first of the images came that stay within the limit."""
        at = None
        for image in images:
            at = None if above(image, limit) else image["seconds"] if at is None else at
        return at
    sampled = [image for image in images if image["by"] != "cache"]
    worse = [image["seconds"] for image in images if image["by"] == "cache" and sampled
             and image["seconds"] > sampled[-1]["seconds"] and above(image, sampled[-1]["rel_mse"] + 2 * sampled[-1]["standard_error"])]
    means = [image["seconds"] for image in images[1:] if abs(image["mean_ratio"] - 1) > MEAN]
    return {"first_s": images[0]["seconds"] if images else None, "good_s": from_when(GOOD), "better_s": from_when(BETTER),
            "worse_than_denoised_s": worse, "mean_off_s": means,
            "counts_up": [b[0] for a, b in zip(left, left[1:]) if b[1] > a[1]]}


def rows(bench):
    for scene_title, scene_name in bench.scenes:
        for source_title, source_name in bench.sources:
            try:
                scene, source = bench.inputs.scene(scene_title, scene_name), bench.inputs.source(source_title, source_name)
            except LookupError as fault:
                bench.say(str(fault))
                continue
            try:
                yield measure(bench, scene_title, scene, source_title, source)
            except Failure as fault:
                bench.say(f"error: {scene_title}, {source_title}: {fault}")
                yield {"scene": scene_title, "source": source_title, "fault": str(fault)}


def number(value, form=".2g"):
    return "-" if value is None else format(value, form)


def print_row(row):
    if "fault" in row:
        return
    print(f"\n{row['scene']}, {row['source']} ({row['spec']}), {row['size']}, {row['images_received']} images\n"
          f"{'seconds':>8} {'processor s':>11} {'frame':>6}  {'by':<11} {'cache':>6} {'relMSE':>8} {'+-':>7} {'surfaces':>8} "
          f"{'mean':>6} {'FLIP':>6} {'states':>8} {'at most':>8}  |1e-1{' ' * (CURVE - 8)}1e-3|")
    for i in row["images"]:
        print(f"{i['seconds']:8.2f} {number(i['processor_s'], '.2f'):>11} {i['frame']:6}  {i['by']:<11} {100 * i['share']:5.0f}% "
              f"{i['rel_mse']:8.1e} {i['standard_error']:7.0e} {i['rel_mse_surfaces']:8.1e} {i['mean_ratio']:6.3f} {i['flip']:6.3f} "
              f"{number(i['stated'], '.1e'):>8} {number(i['stated_at_most'], '.1e'):>8}  |{curve(i['rel_mse']):<{CURVE}}|")
    for at, seconds in row["time_left"]:
        print(f"{at:8.1f} s: it states {seconds:g} s left{' (counts up!)' if at in row['counts_up'] else ''}", flush=True)


def mark(value, limit):
    return "never !" if value is None else f"{value:.3g}{' !' if value > limit else ''}"


def print_end(report):
    print(f"\nthe first minute under a moving sky, all light; relMSE against path tracing over all but plain background; seconds "
          f"since exec\nuntil it stays at or below; !: above the target; {report['machine']['cpu']}, {report['machine']['processors']} "
          f"processors, load {report['machine']['load']:.1f}\n"
          f"{'scene':<12} {'sky':<10} {'first':>8} {'2e-2':>8} {'5e-3':>8}  {'worse than denoised':<20} {'mean off by 1 %':<20} time left up\n"
          f"{'':<12} {'target':<10} {FIRST_S:8g} {GOOD_S:8g} {BETTER_S:8g}  {'never':<20} {'never from image 2':<20} never")
    for r in [row for row in report["rows"] if "fault" not in row]:
        lists = [" ".join(f"{s:.3g}" for s in r[key]) or "never" for key in ("worse_than_denoised_s", "mean_off_s", "counts_up")]
        print(f"{r['scene']:<12} {r['source']:<10} {mark(r['first_s'], FIRST_S):>8} {mark(r['good_s'], GOOD_S):>8} "
              f"{mark(r['better_s'], BETTER_S):>8}  {lists[0]:<20} {lists[1]:<20} {lists[2]}")
