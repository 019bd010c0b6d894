"""Charts: error over time, both logarithmic, a line for each technique with its 10-90 % band, and a guide with the slope that more
samples give."""

import math
from html import escape

from winners import ERRORS

WIDTH, HEIGHT = 820, 500
LEFT, TOP, BELOW = 92, 14, 60  # of the plot; the key is at its right
KEY_LINE, CHARACTER, ROW = 34, 8, 20  # of the key: widths of a sample and of a letter, height of a row
SPAN = 300  # highest over least error that is drawn: what is wronger is named in the key
TICKS = 8  # at most
STEPS = ([k / 10 for k in range(10, 100)], [k / 2 for k in range(2, 20)], range(1, 10), (1, 2, 3, 5, 7), (1, 2, 5), (1,))
GREY = "#888888"

# kind -> width of the line, dashes, size of its marks, whether they are square, whether they are hollow
STYLES = {"fixed": (2, "", 3, False, False), "auto": (3, "", 4, False, False), "baseline": (1.6, "6 3", 3, False, True),
          "prepared": (2, "2 3", 3.5, True, True), "filtered": (2.4, "8 2 2 2", 3, True, False)}


def colour_of(curve):
    return f"#{curve['colour']:06x}" if curve["colour"] else "currentColor"


def ranges(panel, kind):
    """Of both axes: of all medians, but no more than SPAN upwards."""
    points = [point for curve in panel["measured"] for point in curve["points"]]
    x = [v for point in points if 0 < (v := point["frame_ms"][1]) < math.inf]
    y = [v for point in points if 0 < (v := point["bands"][kind][1]) < math.inf]
    if not x or not y:
        return (1, 10), (0.1, 1)
    return (min(x) / 1.15, max(x) * 1.15), (min(y) / 1.6, min(max(y), SPAN * min(y)) * 1.6)


def ticks(low, high):
    """The finest that are not too many."""
    for steps in STEPS:
        found = [v for k in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1) for s in steps
                 if low <= (v := s * 10.0 ** k) <= high]
        if len(found) <= TICKS:
            break
    return found


def is_above(curve, kind, top):
    """Whether all of it is."""
    return all(point["bands"][kind][1] >= top for point in curve["points"])


def path(points):
    """With a gap where a point is None."""
    out, move = "", True
    for point in points:
        if point:
            out += "%s%.1f %.1f" % ("M" if move else "L", *point)
        move = point is None
    return out


def mark(curve, x, y):
    _, _, size, square, hollow = STYLES[curve["kind"]]
    colour = colour_of(curve)
    fill = f'fill="none" stroke="{colour}" stroke-width="1.2"' if hollow else f'fill="{colour}"'
    if square:
        return f'<rect x="{x - size:.1f}" y="{y - size:.1f}" width="{2 * size}" height="{2 * size}" {fill}/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size}" {fill}/>'


def stroke(colour, width, dashes):
    return f'fill="none" stroke="{colour}" stroke-width="{width}"' + (f' stroke-dasharray="{dashes}"' if dashes else "")


def draw(panel, kind, attributes):
    """SVG with these attributes of its root. What is black has the colour of its text."""
    title, slope, _ = ERRORS[kind]
    (x0, x1), (y0, y1) = ranges(panel, kind)
    names = [c["technique"] + " (above)" * is_above(c, kind, y1) for c in panel["measured"]]
    right = KEY_LINE + 14 + CHARACTER * max(map(len, ["reference ends", *names]))
    width, height = WIDTH - LEFT - right, HEIGHT - TOP - BELOW

    def at(x, y):
        return (width * math.log(x / x0) / math.log(x1 / x0), height * math.log(y1 / y) / math.log(y1 / y0)) if 0 < y < math.inf else None

    back, lines, front, key = [], [], [], []

    def add_key(text, style, sample=None):
        y = TOP + 8 + ROW * len(key)
        key.append(f'<path d="M{WIDTH - right + 8:.1f} {y}h{KEY_LINE}" {style}/>'
                   + (mark(sample, WIDTH - right + 8 + KEY_LINE / 2, y) if sample else "")
                   + f'<text x="{WIDTH - right + 14 + KEY_LINE:.1f}" y="{y + 5}" font-size="14">{escape(text)}</text>')

    def add_guide(text, dashes, *ends):
        style = stroke(GREY, 1.5, dashes)
        lines.append(f'<path d="{path(ends)}" {style}/>')
        add_key(text, style)

    middle = math.sqrt(y0 * y1) / math.sqrt(x0 * x1) ** slope
    add_guide(f"slope {slope}", "2 4", *(at(x, middle * x ** slope) for x in (x0, x1)))
    if kind == "rel_mse" and 2 * panel["reference_doubt"] > y0:
        add_guide("reference ends", "8 6", *(at(x, 2 * panel["reference_doubt"]) for x in (x0, x1)))
    for c, name in zip(panel["measured"], names):
        bands = [[at(p["frame_ms"][1], p["bands"][kind][k]) for p in c["points"]] for k in range(3)]
        whole = [ends for ends in zip(bands[0], bands[2]) if all(ends)]
        style = stroke(colour_of(c), *STYLES[c["kind"]][:2])
        if whole and not is_above(c, kind, y1):
            back.append(f'<path d="{path([b for _, b in whole] + [a for a, _ in reversed(whole)])}Z" '
                        f'fill="#{c["colour"] or 0x808080:06x}" fill-opacity="0.13"/>')
        front.append(f'<path d="{path(bands[1])}" {style}/>' + "".join(mark(c, *p) for p in bands[1] if p))
        add_key(name, style, c)
    grid = [(f"M{at(v, y0)[0]:.1f} 0V{height}", f'<text x="{LEFT + at(v, y0)[0]:.1f}" y="{TOP + height + 24}" text-anchor="middle">{v:g}</text>')
            for v in ticks(x0, x1)]
    grid += [(f"M0 {at(x0, v)[1]:.1f}H{width:.1f}", f'<text x="{LEFT - 10}" y="{TOP + at(x0, v)[1] + 5:.1f}" text-anchor="end">{v:g}</text>')
             for v in ticks(y0, y1)]
    return (f'<svg {attributes} viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="15" fill="currentColor">'
            f'<path d="{"".join(d for d, _ in grid)}" transform="translate({LEFT} {TOP})" {stroke(GREY, 0.4, "1 4")}/>'
            f'<svg x="{LEFT}" y="{TOP}" width="{width:.1f}" height="{height}">{"".join(back + lines + front)}</svg>'
            f'<path d="M{LEFT} {TOP}v{height}h{width:.1f}" {stroke("currentColor", 1, "")}/>'
            + "".join(text for _, text in grid) + "".join(key)
            + f'<text x="{LEFT + width / 2:.1f}" y="{HEIGHT - 8}" text-anchor="middle">milliseconds for a whole frame</text>'
            f'<text transform="translate(18 {TOP + height / 2}) rotate(-90)" text-anchor="middle">{title}</text></svg>')


def draw_file(panel, kind):
    """On white, whatever shows it."""
    return draw(panel, kind, f'xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" style="background:#fff;color:#000"') + "\n"


def draw_inline(panel, kind):
    """For a page: in its colours."""
    return draw(panel, kind, f'class="chart" role="img" aria-label="{ERRORS[kind][0]} over milliseconds a frame, a line for each method"')
