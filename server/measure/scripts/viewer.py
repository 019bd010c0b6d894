"""--live: what a viewer gets of each scene at each size under each source, from relightd as a user starts it. The first start
computes the cache; every source then has a start of its own, which finds that cache on disk."""

import os
import shutil
import statistics
import subprocess
import time

import truth
from relightd import EXR_FLOAT, FINER, H264, REPEAT, Daemon, Failure, Viewer

FIRST, LAST = 8, 31  # frames whose flicker is measured: some after the start, so that nothing fades in any more
JUDGED = range(FIRST, LAST + 1, 3)  # eight frames, whose errors are measured
CONVERGED = range(FIRST, FIRST + 8)  # frames of a sequence whose flicker is that of the light, with so many times
CONVERGED_TIMES = 8  # the samples of other references; what is left of their noise flickers, too
ROUNDS = 3  # a viewer that is too slow misses frames: until it has all of these
START_S = 300.0  # patience for a first image
LEAST = 3  # images of a row, however slow the machine
AGAIN_S = 10.0  # for a cache that the first start did not complete, and for a wish before it is repeated


def new_skies(messages, last=None):
    """Those that show a sky for the first time: no repeated image, no refinement, no frame a second time."""
    out = []
    for p in messages:
        if not p.flags & (REPEAT | FINER) and p.frame != last:
            out.append(p)
            last = p.frame
    return out


def percentile(values, share):
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


class Start:
    """relightd, started with the cache folder of this scene and size, and its viewer; entered when the first image has come."""

    def __init__(self, bench, scene, size, source, *more):
        flags = ["--size", size, "--source", source, "--cache-dir", os.path.join(bench.folder, "cache"),
                 *(["--scene", scene] if scene else []), *bench.flags, *more]
        self.daemon = Daemon(bench.programs.folder, *flags, port=bench.arguments.port)
        self.peak = self.images = 0
        self.first_s = self.complete_s = None
        self.share = 0.0

    def __enter__(self):
        try:
            self.daemon.wait_listening()
            self.viewer = Viewer(self.daemon)
            self.viewer.on_picture = self.count
            self.viewer.subscribe("jpeg")
            if not self.viewer.run(lambda: self.images, START_S, self.note):
                raise Failure(f"no image within {START_S:g} s")
        except BaseException:
            self.daemon.stop()
            raise
        return self

    def __exit__(self, *_):
        self.viewer.close()
        self.daemon.stop()

    def count(self, picture):
        self.images += 1
        if self.first_s is None:
            self.first_s = picture.received_s - self.daemon.begun_s

    def note(self):
        self.peak = max(self.peak, self.daemon.peak_bytes())

    def wait_complete(self, patience_s):
        """Waits for the whole cache, at most so long. Failure: there will be none."""
        def refusal():
            return next((w for w in self.daemon.warnings() if "cache" in w and "more than the limit" in w), None)

        def look():
            self.note()
            self.share = self.daemon.cache_share()
            if self.share >= 1.0:
                self.complete_s = time.monotonic() - self.daemon.begun_s

        self.viewer.run(lambda: self.complete_s or refusal(), patience_s, look)
        if refusal():
            raise Failure("the cache is refused: " + refusal())

    def wait_sun(self, patience_s):
        """Seconds until what points see of the sun on this day is known; None: not within patience, or its way is not known."""
        def said():
            return next((s for s, line in self.daemon.lines if "sun: what points see" in line), None)

        self.viewer.run(said, patience_s, self.note)
        return said()

    def go_back(self, coding, on_picture):
        """Subscribes, goes to the first frame, and waits for an image of the first few, or for what a busy machine delivers: of
        a frame before those that had come."""
        limit, back = -1, False

        def take(picture):
            nonlocal back
            back = back or picture.frame < limit
            on_picture(picture)

        self.viewer.on_picture = take
        self.viewer.subscribe(coding)
        end_s = time.monotonic() + START_S
        while not back:
            if time.monotonic() >= end_s:
                raise Failure(f"no image of the first frames within {START_S:g} s")
            self.viewer.control(seek=0)
            limit = max(FIRST, self.viewer.frame)
            self.viewer.run(lambda: back, AGAIN_S)


# ---- Speed and flicker ----

def measure(bench, start, coding):
    messages = []
    start.go_back(coding, messages.append)
    before, work_s, begun_s = len(messages), start.daemon.processor_s(), time.monotonic()
    end_s = begun_s + bench.arguments.seconds

    def skies():
        return new_skies(messages[before:], messages[before - 1].frame)

    start.viewer.run(lambda: time.monotonic() >= end_s and len(skies()) >= LEAST, bench.arguments.seconds + START_S, start.note)
    span_s, work_s, new = time.monotonic() - begun_s, start.daemon.processor_s() - work_s, skies()
    if not new:
        raise Failure(f"no image of a new sky within {bench.arguments.seconds:g} s")
    latency_ms = [p.latency_us * 1e-3 for p in new]
    return {"coding": coding, "images": len(new), "messages": len(messages) - before, "seconds": span_s,
            "images_per_s": len(new) / span_s, "processor_ms": 1e3 * work_s / len(new),
            "latency_ms": statistics.median(latency_ms), "latency_p95_ms": percentile(latency_ms, 0.95),
            "latency_from": "capture" if new[0].captured else "reading", "bytes": sum(len(p.payload) for p in new) / len(new),
            "flicker": delivered_flicker(bench, coding, messages, before - 1)}


def decode_h264(chain, names):
    """Decodes a chain from its keyframe on with ffmpeg; names: what becomes of its images, by their places in it."""
    folder = os.path.dirname(next(iter(names.values())))
    stream = os.path.join(folder, "stream.h264")
    with open(stream, "wb") as file:
        file.write(b"".join(p.payload for p in chain))
    command = ["ffmpeg", "-v", "error", "-f", "h264", "-i", stream, "-vf", "scale=in_color_matrix=bt709", "-vsync", "0",
               "-frames:v", str(max(names) + 1), os.path.join(folder, "decoded.%d.png")]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Failure("ffmpeg: " + done.stderr.strip()[-200:])
    for place, name in names.items():
        os.replace(os.path.join(folder, f"decoded.{place + 1}.png"), name)


def delivered_flicker(bench, coding, messages, begin):
    """Of images as a viewer decodes them; messages[begin:] are those since the first frame. None: not known."""
    if coding == "h264" and not shutil.which("ffmpeg"):
        bench.say("the flicker of H.264 is left out: there is no ffmpeg")
        return None
    folder = os.path.join(bench.folder, "shown")
    shutil.rmtree(folder, ignore_errors=True)
    os.mkdir(folder)
    pattern = os.path.join(folder, "%d.jpg" if coding == "jpeg" else "%d.png")
    places = {p.frame: place for place, p in reversed(list(enumerate(messages)))
              if place >= begin and FIRST <= p.frame <= LAST and not p.flags & (REPEAT | FINER)}
    if coding == "h264" and places:
        chain = [p for p in messages if p.form == H264]
        lead = len(messages) - len(chain)  # the last of the images before, of another form
        decode_h264(chain, {place - lead: pattern % frame for frame, place in places.items()})
    for frame, place in places.items() if coding == "jpeg" else ():
        with open(pattern % frame, "wb") as file:
            file.write(messages[place].payload)
    if not any(frame + 1 in places and frame + 2 in places for frame in places):
        bench.say("the flicker is left out: no three images in a row")
        return None
    return truth.flicker(bench.programs, pattern, FIRST, LAST)


# ---- Error ----

def take_floats(bench, start):
    """{frame: file} of the frames that are judged, as they were delivered."""
    out, newest = {}, -1

    def take(picture):
        nonlocal newest
        if picture.form != EXR_FLOAT or picture.flags & (REPEAT | FINER):
            return
        newest = picture.frame
        if newest in JUDGED and newest not in out:
            out[picture.frame] = os.path.join(bench.folder, f"float.{picture.frame}.exr")
            with open(out[picture.frame], "wb") as file:
                file.write(picture.payload)

    for _ in range(ROUNDS):
        start.go_back("exr_float", take)
        start.viewer.run(lambda: newest >= LAST, START_S)
        if len(out) == len(JUDGED):
            break
    return out


def mean(values):
    return sum(values) / len(values)


def judge(bench, view, floats, title):
    """Mean errors of the frames, whose standard errors are independent."""
    if not floats:
        return None
    each = []
    for frame in sorted(floats):
        bench.say(f"{title}: error of frame {frame}")
        each.append(view.judge(floats[frame], frame))
    out = {key: mean([e[key] for e in each]) for key in ("rel_mse", "rel_mse_surfaces", "mean_ratio", "flip", "flip_halves")}
    return {**out, "standard_error": mean([e["standard_error"] ** 2 for e in each]) ** 0.5 / len(each) ** 0.5, "frames": each}


# ---- Rows ----

def first_start(bench, scene, size, source):
    patience_s = bench.arguments.patience
    with Start(bench, scene, size, source) as start:
        start.wait_complete(patience_s)
        passed_s = time.monotonic() - start.daemon.begun_s
        return {"kind": "first start", "first_s": start.first_s, "complete_s": start.complete_s, "share": start.share,
                "images_per_s": start.images / passed_s, "peak_bytes": start.peak, "processor_s": start.daemon.processor_s()}


def source_rows(bench, scene, size, source, codings, complete, title):
    """A start that finds the cache, then a row for each coding; the error is that of the first."""
    view = truth.View(bench.programs, bench.references, scene, size, source, bench.arguments.reference_samples)
    out = []
    with Start(bench, scene, size, source, "--exposure", view.exposure()) as start:
        start.wait_complete(bench.arguments.patience if complete else AGAIN_S)
        sun_s = start.wait_sun(bench.arguments.patience) if source.startswith("sky:") and start.complete_s else None
        known = {"kind": "moving sky", "spec": source, "first_s": start.first_s, "complete_s": start.complete_s, "share": start.share,
                 "sun_s": sun_s}
        for coding in codings:
            bench.say(f"{title}, {coding}: {bench.arguments.seconds:g} s of images")
            out.append({**known, **measure(bench, start, coding)})
        floats = take_floats(bench, start)
        for row in out:
            row["peak_bytes"] = start.peak
    bench.say(f"{title}: a converged sequence of {len(CONVERGED)} frames")
    converged = view.converged_flicker(CONVERGED, CONVERGED_TIMES * bench.arguments.reference_samples)
    error = judge(bench, view, floats, title)
    for row in out:
        row["flicker_converged"] = converged
        row["error"] = error if row is out[0] else None
    return out


def scene_rows(bench, title, scene, size, sources):
    shutil.rmtree(os.path.join(bench.folder, "cache"), ignore_errors=True)
    known = {"scene": title, "size": size}
    bench.say(f"{title}, {size}: first start, until the cache is complete")
    row = first_start(bench, scene, size, sources[0][1])
    yield {**known, "source": sources[0][0], **row}
    for number, (source_title, source) in enumerate(sources):
        last = number == len(sources) - 1 and not bench.arguments.quick
        for one in source_rows(bench, scene, size, source, ["jpeg", "h264"] if last else ["jpeg"], row["complete_s"] is not None,
                               f"{title}, {size}, {source_title}"):
            yield {**known, "source": source_title, **one}


def rows(bench):
    sources = []
    for title, name in bench.sources:
        try:
            sources.append((title, bench.inputs.source(title, name)))
        except LookupError as fault:
            bench.say(str(fault))
    for size in bench.arguments.sizes:
        for title, name in bench.scenes if size == bench.arguments.sizes[0] else bench.scenes[:1]:
            mine = sources if size == bench.arguments.sizes[0] else [s for s in sources if s[0] == "12"]
            if not mine:
                continue
            try:
                yield from scene_rows(bench, title, bench.inputs.scene(title, name), size, mine)
            except LookupError as fault:
                bench.say(str(fault))
            except Failure as fault:
                bench.say(f"error: {title}, {size}: {fault}")
                yield {"scene": title, "size": size, "source": "", "fault": str(fault)}


# ---- The table ----

COLUMNS = f"{'scene':<10} {'size':<9} {'sky':<8} {'':<5}"


def number(value, form):
    return "-" if value is None else format(value, form)


def print_row(row):
    head = f"{row['scene']:<10.10} {row['size']:<9} {row['source']:<8.8} "
    if "fault" in row:
        return
    starts = f"first image {row['first_s']:.2f} s, cache " + (
        f"complete after {row['complete_s']:.1f} s" if row["complete_s"] else f"{100 * row['share']:.0f} % computed")
    if row["kind"] == "first start":
        print(f"{head}first start: {starts}, {row['images_per_s']:.1f} images/s meanwhile, {row['processor_s']:.1f} s of processor "
              f"time, {row['peak_bytes'] / 2**20:.0f} MB", flush=True)
        return
    flicker, still, error = row["flicker"], row["flicker_converged"], row["error"]
    print(f"{head}{row['coding']:<5} {row['images_per_s']:6.1f} images/s  {row['processor_ms']:7.1f} ms each  latency "
          f"{row['latency_ms']:.0f} ms, 95 %: {row['latency_p95_ms']:.0f}  {row['bytes'] / 1024:.0f} KB  flicker "
          + (f"{flicker['p99_9']}, most {flicker['most']}" if flicker else "-")
          + f" (converged {still['p99_9']}, {still['most']})"
          + (f"\n{'':<29} relMSE {error['rel_mse']:.1e} +- {error['standard_error']:.0e}, surfaces {error['rel_mse_surfaces']:.1e}, "
             f"mean {error['mean_ratio']:.3f}, FLIP {error['flip']:.3f} (halves {error['flip_halves']:.3f})" if error else "")
          + f"\n{'':<29} this start: {starts}, " + (f"the sun's day known after {row['sun_s']:.0f} s, " if row["sun_s"] else "")
          + f"{row['peak_bytes'] / 2**20:.0f} MB", flush=True)


def print_end(report):
    m = report["machine"]
    print(f"\n{m['cpu']}, {m['processors']} processors, load {m['load']:.1f} at the start, {report['version']}. Processor time is "
          "that of relightd with\nits helper processes, not the viewer's. Latency is from the computation of the sky, or from the "
          "reading of its file, to the\nreceipt of the whole image. Flicker: 99.9 % of the second differences in time, and the "
          "largest, in 8-bit codes.")
