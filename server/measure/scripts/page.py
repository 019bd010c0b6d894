"""The report for people: one HTML file that fetches nothing. First it says which method to choose; then comes a section for each
panel, with charts, images at equal time and a table; last, how it was made."""

import math
import shlex
from html import escape

import plot
from serve import date, processor
from winners import ERRORS, LIMIT, MARGIN, MARKS, MIDDLE, rank

# Quiet, so that charts and images are what is seen; light or dark as the reader's system is. Contrast of all text on its ground is at
# least 4.5:1.
STYLE = """
:root{color-scheme:light dark;--ground:#fbfaf8;--raised:#fff;--line:#dcd8d0;--text:#22242a;--soft:#5d626c;--best:#e4f2e6;--best-ink:#1d5f2d;--bad:#a03a22;--bar:#cfdcec}
@media(prefers-color-scheme:dark){:root{--ground:#121419;--raised:#1a1d23;--line:#31353d;--text:#eceae5;--soft:#a9b0ba;--best:#1d3325;--best-ink:#8fdba6;--bad:#f3a08c;--bar:#2c3d52}}
*{box-sizing:border-box}
body{margin:0 auto;max-width:78rem;padding:clamp(1rem,3vw,2.5rem);background:var(--ground);color:var(--text);font:16px/1.5 system-ui,'Segoe UI',Roboto,'Noto Sans','Liberation Sans',sans-serif;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
h1{font-size:clamp(1.6rem,4vw,2.3rem);line-height:1.15;margin:0 0 .3rem;letter-spacing:-.01em}
h2{font-size:1.35rem;margin:3rem 0 .6rem;line-height:1.25}h3{font-size:1rem;margin:1.6rem 0 .4rem}.card h3{margin-top:0}
p{margin:.4rem 0;max-width:65ch}.soft,figcaption,small{color:var(--soft)}nav{display:flex;flex-wrap:wrap;gap:.4rem 1rem;margin:1rem 0}
a{color:inherit;text-decoration-color:var(--soft)}
.card{background:var(--raised);border:1px solid var(--line);border-radius:.7rem;padding:1rem 1.2rem;margin:1rem 0}
.choice{display:grid;gap:1rem;grid-template-columns:repeat(auto-fit,minmax(min(100%,30rem),1fr));align-items:start}.choice .card{margin:0}
.answer{font-size:1.15rem;line-height:1.4}
.charts{display:grid;gap:1rem;grid-template-columns:repeat(auto-fit,minmax(min(100%,32rem),1fr))}figure{margin:0}
.charts figure{background:var(--raised);border:1px solid var(--line);border-radius:.7rem;padding:.6rem;overflow-x:auto}
svg.chart{display:block;width:100%;min-width:26rem;height:auto;color:var(--text)}svg.chart text{font-family:inherit}.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.92rem;overflow-wrap:normal}
th,td{padding:.3rem .6rem;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}
th{font-weight:600;color:var(--soft);vertical-align:bottom;font-size:.85rem}th:first-child,td:first-child,.left{text-align:left}
td.words{white-space:normal;text-align:left;min-width:12rem}td.best{background:var(--best);color:var(--best-ink);font-weight:700}
td.bar{position:relative;isolation:isolate}
td.bar i{position:absolute;z-index:-1;inset:.2rem auto .2rem .3rem;background:var(--bar);border-radius:.2rem}
.name{white-space:nowrap;font-weight:600}
.name b{display:inline-block;width:.75em;height:.75em;border-radius:50%;margin-right:.45em;background:var(--text)}
.times{color:var(--soft);font-weight:400;font-size:.88em}.bad{color:var(--bad)}
.strip{display:grid;gap:.7rem;grid-template-columns:repeat(auto-fill,minmax(min(100%,13rem),1fr))}
.strip figure{background:var(--raised);border:1px solid var(--line);border-radius:.5rem;overflow:hidden}
.strip figure.first{outline:2px solid var(--best-ink)}.strip img{display:block;width:100%;height:auto;image-rendering:pixelated}
.strip figcaption{padding:.35rem .55rem .5rem;font-size:.85rem;line-height:1.35}
.ramp{display:inline-block;width:7rem;height:.7em;border-radius:.2em;margin:0 .4em;vertical-align:baseline}details{margin:.8rem 0}
summary{cursor:pointer;font-weight:600}dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1.2rem;margin:.6rem 0}
dt{color:var(--soft)}dd{margin:0}@media print{body{max-width:none}.card,.charts figure{break-inside:avoid}}
"""


def title(panel):
    return f"{panel['scene']}, {panel['source']}: {panel['light']} light"


def figure(v):
    """About three figures, without an exponent where that can be."""
    if v == 0:
        return "0"
    if abs(v) >= 100:
        return f"{v:.0f}"
    return f"{v:.{2 - math.floor(math.log10(abs(v)))}f}" if abs(v) >= 1e-3 else f"{v:.1e}"


def times(ratio):
    return f"{ratio:.{2 if ratio < 2 else 1 if ratio < 10 else 0}f} times"


def swatch(curve):
    """A technique's colour and name."""
    colour = f' style="background:{plot.colour_of(curve)}"' if curve["colour"] else ""
    return f'<span class="name"><b{colour}></b>{curve["technique"]}</span>'


def where(panel):
    return escape(f"{panel['scene']}, {panel['source']}")


# ---- The choice ----

def answer(ranking, everywhere):
    best, worst = ranking[0], max(ranking, key=lambda r: r.worst)
    automatic = next((r for r in ranking if r.curve["kind"] == "auto" and r is not best), None)
    at_worst = f"; at worst it has {times(best.worst)} the best one's error" if best.wins < everywhere else ""
    return (f'<p class="answer">Choose {swatch(best.curve)}: it takes {best.curve["about"]}. In {best.wins} of {everywhere} comparisons '
            f"it is the best or within {100 * (MARGIN - 1):.0f} % of it{at_worst}.</p>"
            + (f"<p>{swatch(automatic.curve)} is the server's default: typically {times(automatic.mean)} the best error, at worst "
               f"{times(automatic.worst)}.</p>" if automatic else "")
            + f'<p><span class="bad">Worst case:</span> {swatch(worst.curve)} on {where(worst.where)}, with {times(worst.worst)} the error '
            "of the best in the same time.</p>")


def choice(charted, light, heading):
    ranking = rank(charted, light)
    if not ranking:
        return ""
    longest = math.log(max(1.0, *(r.worst for r in ranking)))
    rows = "".join(
        f'<tr><td>{swatch(r.curve)}</td><td class="words">{r.curve["about"]}</td><td>{r.wins} of {r.panels}</td><td>{r.mean:.3g}</td>'
        f'<td class="bar"><i style="width:calc((100% - .6rem) * {math.log(max(r.worst, 1)) / longest if longest else 0:.3f})"></i>'
        f'{r.worst:.3g}</td><td class="words">{where(r.where) if r.worst >= 1.005 else ""}</td></tr>' for r in ranking)
    return (f'<section class="card"><h3>{heading}</h3>{answer(ranking, sum(p["light"] == light for p, _ in charted))}'
            '<details><summary>All of them, by their worst case</summary><div class="wide"><table><tr><th>method</th>'
            '<th class="left">takes</th><th>best, or<br>nearly</th><th>error over the best\'s,<br>typical</th><th>at<br>worst</th>'
            f'<th class="left">where</th></tr>{rows}</table></div><p class="soft">Compared at equal time, the median of each panel\'s '
            "times; typical is the geometric mean over panels.</p></details></section>")


def how_to_read(ramp):
    kinds = "".join(f"<p><b>{name}</b>: {plain}</p>" for name, _, plain in ERRORS.values())
    return ('<details class="card"><summary>How to read this</summary><p>Every line is one way of lighting the image. Time increases to '
            "the right, the error decreases downwards: <b>choose the lowest line at the time you have.</b> The shaded band about a line "
            "contains eight of ten runs with other random numbers. A line parallel to the dotted guide turns more time into "
            "proportionally more samples; one that becomes level has an error that no time removes.</p><p>Time is that of a whole frame "
            "of a stream: reading the sky, making its tables, lighting, tone curve and JPEG. Precomputation for a scene is stated "
            f'separately.</p>{kinds}<p>In error maps black is 0.1 % off or less<span class="ramp" style="background:linear-gradient('
            f'90deg,{",".join(ramp)})"></span>100 % or more.</p></details>')


# ---- A panel ----

def cell(own, best, is_best, scale=1.0):
    """A number, and how many times the best one it is; the best is marked. own: (value, at_most) or None."""
    if own is None:
        return '<td class="soft">&ndash;</td>'
    value, at_most = own
    more = ""
    if not is_best and best > 0:
        more = f' <span class="times">{value / best:.{1 if value / best < 10 else 0}f}&times;</span>'
    return f'<td{" class=best" * is_best}>{"&le; " * at_most}{figure(scale * value)}{more}</td>'


def row(curve, w):
    name, floor = curve["technique"], curve["points"][-1]["floor"]
    firsts = [w.seconds[m.by_seconds][k][0] if m.by_seconds else 0.0 for k, m in enumerate(w.marks)]
    return (f"<tr><td>{swatch(curve)}</td>"
            + "".join(cell(own, m.error, m.by_error == name) for own, m in zip(w.errors[name], w.marks))
            + "".join(cell(own, first, m.by_seconds == name, 1e3) for own, first, m in zip(w.seconds[name], firsts, w.marks))
            + f'<td>{figure(floor["bias"]) if floor["z"] >= 3 else "<span class=soft>none seen</span>"} <span class="times">z '
            f'{floor["z"]:.1f}</span></td><td>{floor["energy"]:.4f} <span class="times">&plusmn; {floor["energy_doubt"]:.4f}</span></td></tr>')


def winners_table(panel, w):
    marks = ("".join(f"<th>{figure(1e3 * m.seconds)} ms</th>" for m in w.marks) + "".join(f"<th>{figure(m.error)}</th>" for m in w.marks))
    return ('<h3>Winners</h3><div class="wide"><table><tr><th rowspan="2">method</th>'
            f'<th colspan="{len(MARKS)}">error at equal time</th><th colspan="{len(MARKS)}">milliseconds to equal error</th>'
            '<th rowspan="2">bias floor<br><small>at its most samples</small></th><th rowspan="2">brightness<br><small>over the '
            f'truth\'s</small></th></tr><tr>{marks}</tr>{"".join(row(c, w) for c in panel["measured"])}</table></div>')


def nearest(curve, seconds):
    """The point whose time is nearest."""
    return min(curve["points"], key=lambda point: abs(math.log(1e-3 * point["frame_ms"][1] / seconds)))


def verdicts(w):
    """Of auto, and of the filter."""
    out, v, f = "", w.automatic, w.filtered
    if v:
        stays = ("stays" if v.within else "may or may not stay" if v.worst <= LIMIT else '<span class="bad">does not stay</span>')
        out = (f"<p><b>auto</b> {stays} within {LIMIT:.1f} times the best of the fixed methods: at worst it had {v.worst:.2f} times their "
               f"error, at {figure(1e3 * v.seconds)} ms. Nine of ten bootstrap rounds stay below {v.upper:.2f}; {100 * v.confidence:.0f} % "
               "of them hold the limit.</p>")
    if f.get("flip") and f.get("rel_mse"):
        out += (f'<p><b>denoised</b> has at most {f["flip"].worst:.2f} times the FLIP and {f["rel_mse"].worst:.2f} times the relMSE of the '
                f'same samples unfiltered, at equal time; nine of ten bootstrap rounds stay below {f["flip"].upper:.2f} and '
                f'{f["rel_mse"].upper:.2f}. It is biased, and therefore not ranked.</p>')
    return out


def floor_of_best(panel, w):
    """The share of the best error at the middle time that is bias."""
    middle = w.marks[MIDDLE]
    for c in panel["measured"]:
        floor = nearest(c, middle.seconds)["floor"]
        if c["technique"] == middle.by_error and c["kind"] != "baseline" and floor["bias"] > 0.2 * floor["error"]:
            return (f'<p>Of the best error at the middle time, {100 * min(floor["bias"] / floor["error"], 1):.0f} % is not noise but the '
                    "bias of one shading point per pixel, the same for all methods that shade points. More camera rays reduce it "
                    "(<code>--every-pixel</code>), more samples do not.</p>")
    return ""


def costs(panel):
    parts = ", ".join(f"{part} {figure(v)}" for part, v in panel["common_ms"].items())
    return (f'<p class="soft">Of every frame\'s time {parts} = {figure(sum(panel["common_ms"].values()))} ms are common to all methods. Once '
            f'per scene: loading {figure(panel["load_ms"])}, ray structure {figure(panel["bvh_ms"])}, G-buffer '
            f'{figure(panel["gbuffer_ms"])}, resampling table {figure(panel["table_ms"])} ms; the G-buffer\'s {panel["points"]} shade points '
            f'take {1e-6 * panel["gbuffer_bytes"]:.1f} MB. Relative squared errors below {2 * panel["reference_doubt"]:.1e} cannot be told '
            "from 0 by these references.</p>")


def notes(panel, curve, w):
    """On one method."""
    name = f"<b>{curve['technique']}</b>"
    if curve["left_out"]:
        return f'<p class="soft">{name} is left out: {escape(curve["left_out"])}.</p>'
    out, energy = "", curve["points"][-1]["floor"]["energy"]
    if curve["kind"] == "auto":
        out += (f'<p class="soft">{name} got the time of <b>{panel["pace"]}</b>, for its measurements too. It expected noise of '
                f'{", ".join(figure(p["expected"]) for p in curve["points"])}; measured: '
                f'{", ".join(figure(p["floor"]["variance"]) for p in curve["points"])}.</p>')
    if curve["kind"] == "prepared":
        frames = w.break_even.get(curve["technique"])
        pays = (f"pays off after {frames} frames, compared with <b>{w.marks[MIDDLE].by_seconds}</b>" if frames else "does not pay off")
        out += (f'<p>{name} first computes for {figure(1e-3 * curve["prepared_ms"])} s and keeps {1e-6 * curve["prepared_bytes"]:.0f} MB, '
                "for this scene, camera and size. No time above includes that, and it is not ranked. At the best error at the middle time "
                f"it {pays}.</p>")
    if curve["bias"]:
        out += f'<p class="soft">{name} is biased: {escape(curve["bias"])}.</p>'
    elif energy < 0.9:
        out += (f'<p class="soft">{name} shows {100 * energy:.0f} % of the light: the rest comes in pixels that are rare and very bright, '
                f'and {panel["seeds"]} seeds have met too few of them. It is not wrong in the mean.</p>')
    return out


def strip(panel, w):
    """Images at equal time."""
    middle = w.marks[MIDDLE]
    out = (f'<h3>Images and errors at about {figure(1e3 * middle.seconds)} ms</h3><div class="strip"><figure><img alt="the truth" '
           f'src="{panel["truth"]}"><figcaption><span class="name">the truth</span><br>{panel["reference_samples"]} samples a pixel'
           "</figcaption></figure>")
    for c in panel["measured"]:
        point = nearest(c, middle.seconds)
        out += (f'<figure{" class=first" * (c["technique"] == middle.by_error)}><img alt="image by {c["technique"]}" src="{point["image"]}">'
                f'<img alt="its errors" src="{point["map"]}"><figcaption>{swatch(c)}<br>{figure(point["frame_ms"][1])} ms, error '
                f'{figure(point["bands"]["rel_mse"][1])}</figcaption></figure>')
    return out + "</div>"


def section(panel, w, number):
    """A panel with its winners; numbers count from 1."""
    charts = "".join(f"<figure>{plot.draw_inline(panel, kind)}<figcaption>{ERRORS[kind][0]}</figcaption></figure>" for kind in ERRORS)
    return (f'<section id="p{number}"><h2>{escape(title(panel))}</h2><div class="charts">{charts}</div>{winners_table(panel, w)}{verdicts(w)}'
            f"{floor_of_best(panel, w)}{costs(panel)}{''.join(notes(panel, c, w) for c in panel['curves'])}{strip(panel, w)}</section>")


# ---- The page ----

def made(panel, about, seconds):
    m = about["machine"]
    rows = {"machine": processor(), "threads": f"{m['threads']} of {m['processors']} processors, kernels of level {m['level']}",
            "images": f"{panel['width']}x{panel['height']}",
            "repeated": f"{panel['seeds']} seeds per point; the runs of all methods alternate, after one run of each that is not counted",
            "date": date(), "program": f"{m['version']}, commit {m['commit']}", "command": shlex.join(["relight-chart", *about["command"]]), "took": f"{seconds:.0f} s"}
    return ('<h2 id="made">How it was measured</h2><dl>' + "".join(f"<dt>{k}</dt><dd>{escape(v)}</dd>" for k, v in rows.items())
            + "</dl><p>The truth is two references made from different random numbers. An error is the mean of (x - a)(x - b) relative to "
            "brightness, so that the noise of the references cancels; no pixel that sees a surface is left out. It holds the whole pixel, "
            "while all methods but <code>path</code> and its like light one point of a plain pixel: the bias that is left to them at many "
            "samples is that. A method that finds the sun once in many images looks dark and biased in most of them, and far too bright in "
            'the others.</p><p>All numbers are in <a href="chart.csv">chart.csv</a>, single runs in <a href="runs.csv">runs.csv</a>.</p>')


def whole(charted, sections, about, seconds):
    """charted: (panel, winners) of each section."""
    panel, count = charted[0][0], len(charted)
    links = "".join(f'<a href="#p{k}">{escape(title(p))}</a>' for k, (p, _) in enumerate(charted, 1))
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, '
            f'initial-scale=1"><title>relight-chart: error against time</title><style>{STYLE}</style></head><body><header><h1>Error against '
            f'time</h1><p class="soft">{count} panel{"s" * (count > 1)}, {panel["width"]}x{panel["height"]} pixels, {panel["seeds"]} seeds, '
            f'{escape(processor())}, {date()}</p></header><main><h2 style="margin-top:1.2rem">Which to choose</h2><div class="choice">'
            + choice(charted, "direct", "Direct light: the sky and the surfaces that it lights")
            + choice(charted, "all", "All light: with indirect light, mirrors and glass")
            + f'</div>{how_to_read(about["ramp"])}<nav aria-label="panels">{links}<a href="#made">how it was measured</a></nav>'
            + "".join(sections) + made(panel, about, seconds) + "</main></body></html>\n")
