"""Draws a year of light: heat maps over days and hours, maps of the sensors, and a page with everything, from the tables that
relight-render --annual has written to the folder. Standard library only."""

import csv
import json
import math
import os
import sys
from html import escape

STOPS = ((18, 12, 60), (42, 42, 134), (24, 96, 172), (18, 146, 160), (62, 184, 110), (160, 212, 60), (248, 222, 60), (246, 150, 46),
         (206, 44, 44))  # as server/image/film/false_colour.c
DAY, HOUR = 3, 14  # pixels
TOP, LEFT = 24, 34
PLAN = 560  # pixels of a plan's longer side
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
DAYS = (0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334)  # before each month
LUMINANCES = (1, 10, 100, 1000, 10000)  # of the false-colour images, cd/m2

PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>A year of light</title>
<style>body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2em auto;padding:0 1em;color:#222}
th{text-align:left;padding-right:2em;font-weight:600;vertical-align:top}figure{display:inline-block;margin:0 1.5em 1.5em 0;
vertical-align:top}img{max-width:100%}figcaption{color:#555}</style>
<h1>A year of light</h1>
"""


def colour(share):
    if math.isnan(share):
        return "#969696"
    at = 8 * min(1.0, max(0.0, share))
    k = min(int(at), 7)
    return "#%02x%02x%02x" % tuple(int(a + (at - k) * (b - a) + 0.5) for a, b in zip(STOPS[k], STOPS[k + 1]))


def round_up(v):
    """The least number 1, 2 or 5 times a power of ten that is not below v > 0."""
    power = 10 ** math.floor(math.log10(v) + 1e-9)
    return power * next(n for n in (1, 2, 5, 10) if v / power <= n + 1e-9)


class Drawing:
    def __init__(self, width, height, title):
        self.size = (width, height)
        self.parts = [f'<text x="{LEFT}" y="15" font-size="14">{escape(title)}</text>']

    def box(self, x, y, width, height, fill):
        self.parts.append(f'<rect x="{x:.6g}" y="{y:.6g}" width="{width:.6g}" height="{height:.6g}" fill="{fill}"/>')

    def text(self, x, y, words, anchor="start"):
        self.parts.append(f'<text x="{x:.6g}" y="{y:.6g}" text-anchor="{anchor}">{escape(words)}</text>')

    def legend(self, x, height, least, most, unit):
        self.text(x + 8, TOP + 8, unit)
        for j in range(50):
            self.box(x + 8, TOP + 16 + j * (height - 26) / 50, 18, (height - 26) / 50 + 0.5, colour(1 - (j + 0.5) / 50))
        for k in range(6):
            v = least + (most - least) * k / 5
            self.text(x + 32, TOP + 20 + (1 - k / 5) * (height - 26), f"{v / 1000:.3g}k" if v >= 999.5 else f"{v:.3g}")

    def write(self, path):
        head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.size[0]}" height="{self.size[1]}" font-family="sans-serif" ' \
               'font-size="11" fill="#141414" shape-rendering="crispEdges">\n<rect width="100%" height="100%" fill="#fff"/>\n'
        with open(path, "w", encoding="utf-8") as file:
            file.write(head + "\n".join(self.parts) + "\n</svg>\n")


def number(text):
    return float(text) if text else math.nan


def map_year(hours, column, step, title, least, most, unit, path):
    """Days to the right, hours downwards from midnight; dark hours are grey."""
    d = Drawing(LEFT + 365 * DAY + 100, TOP + 24 * HOUR + 22, title)
    d.box(LEFT, TOP, 365 * DAY, 24 * HOUR, "#e2e2e6")
    for row in hours:
        day = DAYS[int(row["month"]) - 1] + min(int(row["day"]), 31) - 1
        d.box(LEFT + DAY * day, TOP + (float(row["clock_h"]) - step / 2) * HOUR, DAY, step * HOUR,
              colour((number(row[column]) - least) / (most - least)))
    for m, before in enumerate(DAYS):
        d.text(LEFT + DAY * before + 45, TOP + 24 * HOUR + 16, MONTHS[m], "middle")
        if m:
            d.box(LEFT + DAY * before, TOP, 1, 24 * HOUR + 6, "#fafafa")
    for h in range(0, 25, 3):
        d.text(LEFT - 7, TOP + h * HOUR + 4, str(h), "end")
    d.legend(LEFT + 365 * DAY + 10, 24 * HOUR, least, most, unit)
    d.write(path)


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def places(sensors):
    """Of the sensors in plan, seen along the normal of the first: x to the right and z downwards for a floor."""
    n = tuple(float(sensors[0][k]) for k in ("nx", "ny", "nz"))
    right, down = (1, 0, 0), (0, 0, 1)
    if abs(n[1]) <= 0.9:
        right = cross((0, 1, 0), n)
        length = math.hypot(*right)
        right = tuple(v / length for v in right)
        down = cross(right, n)
    at = [tuple(float(s[k]) for k in "xyz") for s in sensors]
    return [tuple(sum(a * b for a, b in zip(p, axis)) for axis in (right, down)) for p in at]


def map_sensors(sensors, values, cell, title, most, unit, path):
    at = places(sensors)
    low = [min(p[a] for p in at) for a in (0, 1)]
    size = [max(p[a] for p in at) - low[a] + cell for a in (0, 1)]
    zoom = min(PLAN / max(size), 60 / cell)
    tall = max(180, zoom * size[1])
    d = Drawing(round(max(LEFT + zoom * size[0] + 100, 420)), round(TOP + tall + 8), title)
    d.box(LEFT, TOP, zoom * size[0], zoom * size[1], "#e2e2e6")
    for p, v in zip(at, values):
        d.box(LEFT + zoom * (p[0] - low[0]), TOP + zoom * (p[1] - low[1]), zoom * cell, zoom * cell, colour(v / most))
    d.legend(LEFT + zoom * size[0] + 10, tall, 0, most, unit)
    d.write(path)


def figure(file, words):
    return f'<figure><img src="{escape(file)}" alt="{escape(words)}"><figcaption>{escape(words)}</figcaption></figure>\n'


def draw_hours(folder, hours, summary):
    """(file, caption) of each map."""
    def most(column):
        values = sorted(number(row[column]) for row in hours)
        return round_up(max(1e-3, values[int(0.98 * (len(values) - 1))])) if values else 1.0
    maps = [("year-open.svg", "Outdoor horizontal illuminance, from the weather file", "open_horizontal_lx", 0, 1e5, "lx"),
            ("year-view.svg", "Mean luminance of the view", "picture_mean_cd_m2", 0, most("picture_mean_cd_m2"), "cd/m²")]
    if "occupied_share_dgp_above_0.35" in summary:
        maps.append(("year-glare.svg", "Daylight glare probability of the view", "dgp", 0.2, 0.5, "DGP"))
    if summary["sensors"]:
        maps.append(("year-sensors.svg", "Mean illuminance of the sensors", "sensors_mean_lx", 0, most("sensors_mean_lx"), "lx"))
    for file, words, column, least, top, unit in maps:
        map_year(hours, column, summary["step_hours"], words, least, top, unit, os.path.join(folder, file))
    return [(m[0], m[1]) for m in reversed(maps)]


def draw_sensors(folder, summary):
    with open(os.path.join(folder, "sensors.csv"), encoding="utf-8") as file:
        sensors = list(csv.DictReader(file))
    factors = [100 * float(s["daylight_factor"]) for s in sensors]
    maps = (("autonomy", "Daylight autonomy: share of the occupied time with 300 lx",
             [100 * float(s["daylight_autonomy"]) for s in sensors], 100, "%"),
            ("useful", "Useful daylight: share of the occupied time with 300 to 3000 lx",
             [100 * float(s["udi_300_3000"]) for s in sensors], 100, "%"),
            ("sunlit", "Sunlight exposure: occupied hours with 1000 lx from the sun alone",
             [float(s["sunlit_hours"]) for s in sensors], 500, "h"),
            ("factor", "Daylight factor under the CIE Standard Overcast Sky", factors, round_up(max(1.0, *factors)), "%"))
    for name, words, values, most, unit in maps:
        map_sensors(sensors, values, summary["spacing"] or 1.0, words, most, unit, os.path.join(folder, f"sensors-{name}.svg"))
    return [(f"sensors-{m[0]}.svg", m[1]) for m in maps]


def measures(s):
    """Rows of the table."""
    m = s["measures"]
    yield "Scene", s["scene"]
    yield "Weather", f"{s['weather_file']}: {s['place']['name']}"
    yield "Hours", (f"{s['lit_hours']} with daylight, {s['missing_hours']} missing; occupied: {s['occupied_hours']:.0f}, "
                    f"from {m['first_hour']:g} to {m['last_hour']:g} o'clock")
    if s["sensors"]:
        yield "Spatial daylight autonomy", (f"sDA {m['autonomy_lux']:g} lx, {100 * m['autonomy_share']:g} %: {100 * s['sda']:.1f} % "
                                            f"of {s['sensors']} sensors")
        yield "Annual sunlight exposure", f"ASE {m['sun_lux']:g} lx, {m['sun_hours']:g} h: {100 * s['ase']:.1f} % of the sensors"
        yield "Useful daylight illuminance", (
            f"below 100 lx {100 * s['udi_below_100']:.1f} %, 100 to 300 lx {100 * s['udi_100_300']:.1f} %, "
            f"300 to 3000 lx {100 * s['udi_300_3000']:.1f} %, above {100 * s['udi_above_3000']:.1f} % of the time")
        yield "Daylight factor", f"mean {100 * s['mean_daylight_factor']:.2f} %"
    if "occupied_share_dgp_above_0.35" in s:
        share = [100 * (s[f"occupied_share_dgp_above_{k}"] or 0) for k in ("0.35", "0.40", "0.45")]
        yield "Glare", f"DGP above 0.35 {share[0]:.1f} %, above 0.40 {share[1]:.1f} %, above 0.45 {share[2]:.1f} % of occupied lit hours"


def main():
    folder = sys.argv[1]
    with open(os.path.join(folder, "summary.json"), encoding="utf-8") as file:
        summary = json.load(file)
    with open(os.path.join(folder, "hours.csv"), encoding="utf-8") as file:
        hours = list(csv.DictReader(file))
    page = [PAGE, "<table>\n"]
    page += [f"<tr><th>{escape(name)}</th><td>{escape(words)}</td></tr>\n" for name, words in measures(summary)]
    page.append("</table>\n<h2>Over the year</h2>\n<p>Days to the right, hours downwards.</p>\n")
    page += [figure(*m) for m in draw_hours(folder, hours, summary)]
    if summary["sensors"]:
        page.append("<h2>Sensors</h2>\n")
        page += [figure(*m) for m in draw_sensors(folder, summary)]
    if summary["pictures"]:
        legend = ", ".join(f'<b style="color:{colour(k / 4)}">{v}</b>' for k, v in enumerate(LUMINANCES))
        page.append(f"<h2>Chosen hours</h2>\n<p>Luminance in false colour: {legend} cd/m²</p>\n")
    for picture in summary["pictures"]:
        page.append(figure(picture["name"] + ".png", picture["when"]) + figure(picture["name"] + "-falsecolour.png", "Luminance"))
    page.append("<p>Tables: " + ", ".join(f'<a href="{name}">{name}</a>' for name in
                                          ("hours.csv", "sensors.csv", "illuminance.csv", "summary.json")) + "</p>\n</html>\n")
    with open(os.path.join(folder, "index.html"), "w", encoding="utf-8") as file:
        file.write("".join(page))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except OSError as fault:
        sys.exit(f"relight-render: error: {fault}")
