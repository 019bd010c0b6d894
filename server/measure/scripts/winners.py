"""Statistics of errors over time: bands over seeds, the time to an error, the lower envelope of several lines, and with which
confidence another one stays near it; who wins at equal time, at equal error and over all panels.

A curve is a list of points, each a list of runs (seconds, error) that differ in their seeds; a line is a list of (seconds, error)
with ascending seconds."""

import math
import random
from dataclasses import dataclass
from types import SimpleNamespace

# name -> title of an axis; slope over time in log-log, where more time is more samples and there is no bias; what it means.
ERRORS = {
    "rel_mse": ("relative squared error (relMSE)", -1, "The squared error of a pixel relative to its brightness; 0.01 is 10 % off."),
    "noise": ("noise alone (relMSE without bias)", -1,
              "The part of that error that more samples reduce: how much two runs differ."),
    "delta_e": ("visible difference (mean delta E*ab)", -0.5,
                "How different the finished image looks; 1 is just noticeable side by side, 5 is plain."),
    "flip": ("perceived difference (mean FLIP)", -0.5,
             "The difference that is visible when the finished image and the true one alternate, viewed at 67 pixels per degree; "
             "0 is none, 1 the largest."),
}
MARKS = (0.25, 0.5, 0.75)  # of the way through a panel's times, in log
MIDDLE = 1
CONFIDENCE = 0.9
ROUNDS = 500  # of the bootstrap
LIMIT = 1.1  # of auto over the envelope
MARGIN = 1.05  # within which of the best one nearly wins


# ---- Series ----

def quantile(ordered, share):
    """Linear between neighbours [Hyndman and Fan 1996, type 7]; between a number and infinity there is infinity."""
    at = share * (len(ordered) - 1)
    k, part = int(at), at % 1
    return ordered[k] * (1 - part) + ordered[k + 1] * part if part > 0 else ordered[k]


def band(values):
    """10 %, 50 % and 90 %."""
    ordered = sorted(values)
    return tuple(quantile(ordered, share) for share in (0.1, 0.5, 0.9))


def median(values):
    return quantile(sorted(values), 0.5)


def line_of(curve, rng=None):
    """Medians over the seeds, or over as many that are drawn from them with replacement."""
    line = []
    for runs in curve:
        seconds, errors = zip(*(rng.choices(runs, k=len(runs)) if rng else runs))
        line.append((median(seconds), median(errors)))
    return sorted(line, key=lambda point: point[0])


def error_at(line, seconds):
    """Straight in log-log; None outside of the line, and where an error has no logarithm."""
    for (x, y), (next_x, next_y) in zip(line, line[1:] + line[-1:]):
        if x <= seconds <= next_x and 0 < y < math.inf and 0 < next_y < math.inf:
            part = math.log(seconds / x) / math.log(next_x / x) if next_x > x else 0.0
            return math.exp(math.log(y) * (1 - part) + math.log(next_y) * part)
    return None


def seconds_to(line, goal):
    """When the error has come down to the goal, and whether it begins below; None: never."""
    for k, (x, y) in enumerate(line):
        if y > goal:
            continue
        if k and y > 0 and line[k - 1][1] < math.inf:
            before_x, before_y = line[k - 1]
            x = before_x * (x / before_x) ** (math.log(before_y / goal) / math.log(before_y / y))
        return x, k == 0
    return None


def worst_ratio(lines, tested):
    """The largest ratio of the tested line over the least of the others, and when; 0 where none can be told."""
    worst = (0.0, 0.0)
    for x, y in tested:
        others = [e for e in (error_at(line, x) for line in lines) if e is not None]
        if others and y / min(others) > worst[0]:
            worst = (y / min(others), x)
    return worst


@dataclass
class Verdict:
    worst: float  # largest ratio of errors, tested over envelope,
    seconds: float  # and where
    upper: float  # 90 % of the rounds have a largest ratio below this one
    confidence: float  # share of the rounds whose largest ratio is within the limit

    @property
    def within(self):
        return self.confidence >= CONFIDENCE


def envelope(others, tested, limit, rounds=ROUNDS, seed=1):
    """How far above the lower envelope of others a curve is; None: there was no point to compare. The bootstrap draws the seeds of
    every point anew, with replacement [Efron and Tibshirani 1993, chapter 6]. The envelope of noisy curves is on the low side: the
    test errs on the strict side."""
    worst, seconds = worst_ratio([line_of(c) for c in others], line_of(tested))
    if worst == 0:
        return None
    rng = random.Random(seed)
    ratios = sorted(worst_ratio([line_of(c, rng) for c in others], line_of(tested, rng))[0] for _ in range(rounds))
    return Verdict(worst, seconds, quantile(ratios, CONFIDENCE), sum(ratio <= limit for ratio in ratios) / rounds)


# ---- Panels ----

def prepare(panel):
    """Adds to a panel as it was measured (server/measure/chart/chart.h) the time of what is common to all, in its runs too, and the
    bands of its points: frame_ms and one for each error."""
    panel["common_ms"] = {part: median(values) for part, values in panel["common_ms"].items()}
    common = 1e-3 * sum(panel["common_ms"].values())
    panel["measured"] = [curve for curve in panel["curves"] if not curve["left_out"]]
    for curve in panel["measured"]:
        for point in curve["points"]:
            point["seconds"] = [seconds + common for seconds in point["seconds"]]
            point["errors"] = {kind: [math.inf if e is None else e for e in values] for kind, values in point["errors"].items()}
            point["floor"] = {key: math.inf if v is None else v for key, v in point["floor"].items()}
            point["frame_ms"] = tuple(1e3 * v for v in band(point["seconds"]))
            point["bands"] = {kind: band(values) for kind, values in point["errors"].items()}
            point["expected"] = sum(v or 0.0 for v in point["expected"]) / len(point["expected"])
    return panel


def runs_of(curve, kind):
    return [list(zip(point["seconds"], point["errors"][kind])) for point in curve["points"]]


def is_ranked(curve):
    """What is computed beforehand, or filtered and biased, is shown beside the others."""
    return curve["kind"] not in ("prepared", "filtered")


def standing(line, mark_seconds):
    """A line's error at a time, and whether it is that of its last point, which takes less; None: it makes no image in that time."""
    last_x, last_y = line[-1]
    if last_x < mark_seconds and 0 < last_y < math.inf:
        return last_y, True
    error = error_at(line, mark_seconds)
    return None if error is None else (error, False)


def find_winners(panel, rounds=ROUNDS):
    """By medians of relMSE. Of each mark the time, the least error at that time and its technique, and the technique that has that
    error first; errors, seconds: of each technique at each mark (value, at_most) or None; break_even: frames after which what is
    computed beforehand pays off against the first of the others at the middle error; automatic: auto against the envelope of the
    fixed techniques; filtered: by each error a filtered one against the same one unfiltered, limit 1."""
    curves = panel["measured"]
    ranked = [c["technique"] for c in curves if is_ranked(c)] or [c["technique"] for c in curves]
    lines = {c["technique"]: line_of(runs_of(c, "rel_mse")) for c in curves}
    times = sorted(x for name in ranked for x, _ in lines[name])
    w = SimpleNamespace(marks=[], errors={name: [] for name in lines}, seconds={name: [] for name in lines}, break_even={},
                        automatic=None, filtered={})
    for share in MARKS:
        at = times[int(share * (len(times) - 1) + 0.5)] if times else 0.0
        errors = {name: standing(line, at) for name, line in lines.items()}
        best = min((name for name in ranked if errors[name]), key=lambda name: errors[name][0], default=None)
        goal = errors[best][0] if best else 0.0
        # A hair above, so that rounding does not keep the one that set the goal from reaching it.
        seconds = {name: seconds_to(line, goal * (1 + 1e-9)) if best else None for name, line in lines.items()}
        first = min((name for name in ranked if seconds[name]), key=lambda name: seconds[name][0], default=None)
        w.marks.append(SimpleNamespace(seconds=at, error=goal, by_error=best, by_seconds=first))
        for name in lines:
            w.errors[name].append(errors[name])
            w.seconds[name].append(seconds[name])
    first = w.marks[MIDDLE].by_seconds
    for c in curves:
        own = w.seconds[c["technique"]][MIDDLE]
        if c["kind"] == "prepared" and own and first and w.seconds[first][MIDDLE][0] > own[0]:
            w.break_even[c["technique"]] = math.ceil(1e-3 * c["prepared_ms"] / (w.seconds[first][MIDDLE][0] - own[0]))
    fixed = [c for c in curves if c["kind"] == "fixed"]
    for c in curves:
        if c["kind"] == "auto" and fixed:
            w.automatic = envelope([runs_of(f, "rel_mse") for f in fixed], runs_of(c, "rel_mse"), LIMIT, rounds)
        unfiltered = [f for f in fixed if f["method"] == c["method"]]
        if c["kind"] == "filtered" and unfiltered:
            w.filtered = {kind: envelope([runs_of(unfiltered[0], kind)], runs_of(c, kind), 1.0, rounds) for kind in ERRORS}
    return w


def rank(charted, light):
    """The ranked techniques over all (panel, winners) of a class of light, by their error at the middle time over the best there:
    first those that are in most panels, by their worst ratio. wins: where it is the least, or within MARGIN of it."""
    found = {}
    for panel, w in charted:
        for c in filter(is_ranked, panel["measured"] if panel["light"] == light else ()):
            if at := w.errors[c["technique"]][MIDDLE]:
                found.setdefault(c["technique"], (c, []))[1].append((at[0] / w.marks[MIDDLE].error, panel))
    out = []
    for curve, ratios in found.values():
        worst, where = max(ratios, key=lambda r: r[0])
        out.append(SimpleNamespace(curve=curve, panels=len(ratios), wins=sum(r <= MARGIN for r, _ in ratios), worst=worst, where=where,
                                   mean=math.exp(sum(math.log(r) for r, _ in ratios) / len(ratios))))
    return sorted(out, key=lambda r: (-r.panels, r.worst))
