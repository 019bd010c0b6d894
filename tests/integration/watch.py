#!/usr/bin/python3
"""relightd as who watches over it sees it: /metrics, /healthz, /readyz, its log, its end, and what comes back."""

import asyncio
import math
import re
import urllib.request

from peer import WAIT_S, Failed, check, main, radiance
from still import Daemon

try:
    from prometheus_client.parser import text_string_to_metric_families
except ImportError:  # then the parser below must do
    text_string_to_metric_families = None

NAME = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
LABEL = re.compile(r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\["\\n])*)"')
TYPES = {"counter", "gauge", "histogram"}


def samples_of(line, number):
    """One sample line: name, labels, value."""
    name = NAME.match(line)
    check(name, f"line {number}: no name: {line}")
    rest, labels = line[name.end():], {}
    if rest.startswith("{"):
        rest = rest[1:]
        while not rest.startswith("}"):
            label = LABEL.match(rest)
            check(label and label[1] not in labels, f"line {number}: not a label: {rest}")
            labels[label[1]] = label[2]
            rest = rest[label.end():]
            check(rest[:1] in (",", "}"), f"line {number}: after a label: {rest}")
            rest = rest[1:] if rest.startswith(",") else rest
        rest = rest[1:]
    check(rest.startswith(" ") and len(rest.split()) == 1, f"line {number}: not one value: {rest}")
    return name[0], labels, float(rest)


def parse(text):
    """Prometheus' exposition format 0.0.4, read as strictly as it is written; {(name, labels): value}, {name: type}."""
    check(text.endswith("\n"), "the last line has no end")
    values, types, helped, family = {}, {}, set(), None
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("# HELP "):
            _, _, family, words = line.split(" ", 3)
            check(family not in helped and words, f"line {number}: HELP of {family} again, or without words")
            helped.add(family)
        elif line.startswith("# TYPE "):
            _, _, name, kind = line.split(" ")
            check(name == family and name not in types and kind in TYPES, f"line {number}: {line}")
            types[name] = kind
        else:
            check(line and not line.startswith("#"), f"line {number}: {line}")
            name, labels, value = samples_of(line, number)
            base = re.sub(r"_(bucket|sum|count)$", "", name) if types.get(family) == "histogram" else name
            check(base == family and family in types, f"line {number}: {name} stands under {family}")
            key = (name, tuple(sorted(labels.items())))
            check(key not in values, f"line {number}: {key} again")
            check((types[family] == "counter") == name.endswith("_total"), f"{name} is a {types[family]}")
            check(types[family] == "gauge" or value >= 0, f"{name} is {value}")
            values[key] = value
    check_histograms(values, types)
    return values, types


def check_histograms(values, types):
    series = {}
    for (name, labels), value in values.items():
        base = name.removesuffix("_bucket")
        if types.get(base) == "histogram" and base != name:
            labels = dict(labels)
            series.setdefault((base, tuple(sorted(l for l in labels.items() if l[0] != "le"))), []).append(
                (float(labels["le"]), value))
    check(series, "there is no histogram")
    for (base, labels), buckets in series.items():
        bounds, counts = zip(*buckets)
        check(list(bounds) == sorted(set(bounds)) and math.isinf(bounds[-1]), f"{base}{labels}: bounds {bounds}")
        check(list(counts) == sorted(counts), f"{base}{labels}: buckets fall: {counts}")
        check(values[(base + "_count", labels)] == counts[-1], f"{base}{labels}: its count is another")
        total = values[(base + "_sum", labels)]
        check(counts[-1] > 0 or total == 0, f"{base}{labels}: a sum of nothing")


def fetch(daemon, path):
    """Status and body."""
    try:
        with urllib.request.urlopen(daemon.url.replace("ws://", "http://").removesuffix("/ws") + path, timeout=WAIT_S) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as answer:
        return answer.code, answer.read().decode()


async def ask(daemon, path):
    return await asyncio.to_thread(fetch, daemon, path)


async def metrics(daemon):
    status, text = await ask(daemon, "/metrics")
    check(status == 200, f"/metrics says {status}")
    return parse(text)[0]


def value(values, name, **labels):
    key = (name, tuple(sorted(labels.items())))
    check(key in values, f"no {key}")
    return values[key]


async def until_value(daemon, wanted, name, **labels):
    for _ in range(10 * WAIT_S):
        is_now = value(await metrics(daemon), name, **labels)
        if is_now >= wanted:
            break
        await asyncio.sleep(0.1)
    check(is_now == wanted, f"{name}{labels} is {is_now}, not {wanted}")


async def until_ready(daemon):
    for _ in range(10 * WAIT_S):
        status, text = await ask(daemon, "/readyz")
        if status == 200:
            return
        check(status == 503, f"/readyz says {status}: {text}")
        await asyncio.sleep(0.1)
    raise Failed("it is not ready")


async def metrics_read_as_prometheus_reads_them(folder):
    async with Daemon("--source", "sky:speed=60", "--samples", "4") as daemon:
        await until_ready(daemon)
        status, text = await ask(daemon, "/metrics")
        before, types = parse(text)
        check(status == 200 and types["relightd_stage_seconds"] == "histogram", types)
        if text_string_to_metric_families:
            read = {(s.name, tuple(sorted(s.labels.items()))): s.value
                    for family in text_string_to_metric_families(text) for s in family.samples}
            check(read == before, f"read in two ways: {set(read.items()) ^ set(before.items())}")
        await asyncio.sleep(1.5)
        after = await metrics(daemon)
        check(set(before) <= set(after), f"gone: {set(before) - set(after)}")
        for key in before:
            if key[0].endswith(("_total", "_bucket", "_count", "_sum")):
                check(after[key] >= before[key], f"{key} has fallen from {before[key]} to {after[key]}")
        check(value(after, "relightd_frames_total", fate="shaded", reason="")
              > value(before, "relightd_frames_total", fate="shaded", reason=""), "no frame was counted")
        check(value(after, "relightd_rays_total", part="direct") > 0, "no ray was counted")
        check((await ask(daemon, "/healthz"))[0] == 200, "it is not healthy")


async def frames_are_counted_by_their_fate(folder):
    for i in range(6):
        (folder / f"sky.{i}.hdr").write_bytes(b"broken" if i == 3 else radiance(64 + i))
    async with Daemon("--source", str(folder / "sky.%d.hdr"), "--once", "--samples", "4", "--rate", "5") as daemon:
        await until_value(daemon, 6, "relightd_frames_received_total")
        await until_value(daemon, 1, "relightd_frames_total", fate="refused", reason="unreadable")
        for _ in range(100):
            now = await metrics(daemon)
            shaded = value(now, "relightd_frames_total", fate="shaded", reason="")
            dropped = value(now, "relightd_frames_total", fate="dropped", reason="superseded")
            if shaded + dropped == 5:
                break
            await asyncio.sleep(0.1)
        check(shaded + dropped == 5, f"{shaded} shaded and {dropped} dropped of 5")
        check(value(now, "relightd_stage_seconds_count", stage="decode") == shaded, "times of other frames")


if __name__ == "__main__":
    main(globals())
