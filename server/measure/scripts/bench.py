#!/usr/bin/python3
"""bench.py [--json]: prints what relight-bench measures, with its targets. relight-bench starts this script."""

import json
import sys

from serve import date, processor, serve

# ---- The stages ----

SENSES = {"at_least": ">=", "at_most": "<="}


def verdict(row):
    if row["skipped"]:
        return "not measured"
    for key in SENSES:
        if key in row:
            holds = row["ratio"] is not None and (row["ratio"] >= row[key] if key == "at_least" else row["ratio"] <= row[key])
            return "holds" if holds else "does not hold"
    return "stated"


def print_rows(report):
    print(f"{report['title']}\n{'what':<34} {'ours':>10} {'bare':>10} {'unit':<9} {'ratio':>7} {'target':>8}  verdict")
    for row in report["rows"]:
        target = next((f"{SENSES[key]} {row[key]:.4g}" for key in SENSES if key in row), "-")
        ours = "-" if row["skipped"] else f"{row['ours']:.4g}"
        bare, ratio = ("-", "-") if row["skipped"] or row["bare"] == 0 else (f"{row['bare']:.4g}", f"{row['ratio']:.3g}")
        reason = ": " + row["skipped"] if row["skipped"] else ""
        print(f"{row['name']:<34} {ours:>10} {bare:>10} {row['unit']:<9} {ratio:>7} {target:>8}  {verdict(row)}{reason}")
        if row["note"]:
            print("    " + row["note"])


def plain(row):
    """A row of the JSON that users get: without what was not measured."""
    keys = ["skipped"] if row["skipped"] else ["ours", "rounds"] + ["bare", "ratio"] * (row["bare"] != 0) + list(SENSES)
    return {"name": row["name"], "unit": row["unit"], "verdict": verdict(row), "note": row["note"],
            **{key: row[key] if key in ("skipped", "rounds") else float(f"{row[key]:.6g}") for key in keys if row.get(key) is not None}}


# ---- --speed ----

# By size, of the usual two only; in pairs with a sun and without: bare over shading, milliseconds from EXR to JPEG.
TARGETS = {
    (640, 360): {"bare": (60, 250), "exr": 40, "seconds": 5},
    (1280, 720): {"bare": (80, 300), "jpeg": (66, 33), "MB": 50},
}
MOST_ALL = 2.0  # all light over direct light
MOST_GROWTH = {"four times the pixels": 3.1, "16 times the triangles": 1.7}  # times the time
MOST_BIAS = {"relMSE": 2e-4, "delta E": 0.2, "% of seams": 1.0, "second differences in codes": 0.2}

HEADS = (("scene", "size", "kernels", "sky", "shading", "shading", "bare/", "bare/", "all/", "to JPEG", "to JPEG", "to EXR", "relMSE",
          "relMSE", "mis 256", "mis 256"),
         ("", "", "", "", "all", "direct", "all", "direct", "direct", "all", "direct", "direct", "direct", "all", "direct", "all"))


def cells(words):
    """Twelve figures, of which two may have an exponent and a mark."""
    return " ".join(f"{word:>{9 if k in (8, 9) else 8}}" for k, word in enumerate(words))


def marked(value, least=None, most=None, form=".3g"):
    """"41.2", with a mark where a target is missed; "-" where nothing was measured."""
    if value is None:
        return "-"
    return format(value, form) + (" <" if least is not None and value < least else " >" if most is not None and value > most else "")


def print_heads(machine):
    print(f"{processor()}, commit {machine['commit']}, {date()}\n"
          "milliseconds; shading: the clock's, all threads; bare: 64 shadow rays at each shade point; to JPEG: processor\n"
          "time from EXR to JPEG; to EXR: from EXR to a float EXR on one thread; < and >: below or above the target")
    for size, t in TARGETS.items():
        print("targets at %dx%d: bare/all %g with a sun, %g without;" % (*size, *t["bare"])
              + (" to JPEG %g; %g;" % t["jpeg"] if "jpeg" in t else "")
              + "".join(text % t[key] for key, text in (("exr", " to EXR without a sun %g;"), ("seconds", " precomputation %g s;"),
                                                        ("MB", " %g MB of direct light;")) if key in t))
    print("  all sizes: all/direct at most %g; relMSE, of surfaces against paths with camera rays of their own, at most that of mis;\n"
          "  four times the pixels %g, 16 times the triangles %g of the time; bias, against the same shading points: relMSE %g, delta E "
          "%g, seams %g %%, second differences %g codes" % (MOST_ALL, *MOST_GROWTH.values(), *MOST_BIAS.values()))
    for scene, size, kernels, sky, *rest in HEADS:
        print(f"{scene:<10} {size:<9} {kernels:<8} {sky:<10} {cells(rest)}")


def each(rows, most, key, form):
    """"; name figure" of each row, or why there is none."""
    return "".join(f"; {name}: {row['skipped']}" if row["skipped"] else "; " + form.format(name, marked(row[key], most=most[name]))
                   for name, row in rows.items())


def print_case(case):
    """A scene at one size by one level."""
    target = TARGETS.get(tuple(case["size"]), {})
    width, height = case["size"]
    place = f"{case['scene']:<10.10} {width:4}x{height:<4} {case['machine']['level']:<8.8} "
    for sky in case["skies"]:
        kind = 0 if sky["sun"] else 1
        bare, jpeg = (target.get(key, (None, None))[kind] for key in ("bare", "jpeg"))
        errors = [sky.get(key) for key in ("error_direct", "error_all", "mis_direct", "mis_all")]
        figures = [marked(sky["all_ms"]), marked(sky["direct_ms"]), marked(sky["bare_all"], least=bare), marked(sky["bare_direct"]),
                   marked(sky["all_over_direct"], most=MOST_ALL), marked(sky["jpeg_all"], most=jpeg), marked(sky["jpeg_direct"]),
                   marked(sky["exr_direct"], most=target.get("exr") if kind else None)]
        print(f"{place}{sky['title']:<10.10} "
              + cells(figures + [marked(error, most=most, form=".1e") for error, most in zip(errors, errors[2:] + [None, None])]))
    for sky in case["skies"]:
        if "bias" in sky:
            print(f"{place}{sky['title']:<10.10} direct light without the sky's sun"
                  + each(sky["bias"], MOST_BIAS, "ours", "{} {}"))
    print(f"{place}precomputation of all light {marked(case['wall_s'], most=target.get('seconds'))} s, {case['processor_s']:.3g} s of "
          f"processor time; {marked(1e-6 * case['direct_bytes'], most=target.get('MB'))} MB of direct light, {1e-6 * case['bytes']:.3g} "
          "of all" + each(case.get("growth", {}), MOST_GROWTH, "ratio", "{}: {} times the time"))


class Printer:
    def __init__(self, as_json):
        self.as_json, self.begun = as_json, False

    def take(self, report):
        if "rows" not in report:
            if not self.begun:
                print_heads(report["machine"])
            self.begun = True
            print_case(report)
        else:
            report["title"] += f"\n{processor()}, commit {report['machine']['commit']}, {date()}"
            if self.as_json:
                print(json.dumps({"title": report["title"], "rows": [plain(row) for row in report["rows"]]}, indent=1))
            else:
                print_rows(report)
        sys.stdout.flush()


if __name__ == "__main__":
    sys.stdout.reconfigure(errors="replace")
    serve(Printer("--json" in sys.argv).take)
