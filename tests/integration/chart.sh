#!/usr/bin/env bash
# relight-chart from scripts: output, cache, bad input.
. "$(dirname "$0")/lib.sh"
export XDG_CACHE_HOME="$work/cache"

# chart OUT FLAGS...: the smallest possible chart.
chart() {
    local out=$1
    shift
    "$bin/relight-chart" --quick --size 24x14 --seeds 4 --budgets 4,16 --reference 64 --out "$out" "$@" 2>"$work/log" ||
        { cat "$work/log"; fail "relight-chart $*"; }
}

# The page is self-contained and well-formed: tags nest, names are unique, nothing is fetched, images are JPEG files.
check_page() {
    /usr/bin/python3 -B - "$1" <<'PY'
import base64, html.parser, re, sys

class Page(html.parser.HTMLParser):
    void = {"meta", "img", "br", "link"}
    def __init__(self):
        super().__init__()
        self.open, self.ids, self.images, self.words = [], set(), 0, []
    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        assert len(named) == len(attributes), f"{tag}: an attribute twice"
        if "id" in named:
            assert named["id"] not in self.ids, f"id {named['id']} twice"
            self.ids.add(named["id"])
        for key in ("src", "href", "xlink:href"):
            value = named.get(key, "")
            assert re.match(r"(data:|#|(chart|runs)\.csv$|$)", value), f"{key}={value[:60]}"
        if tag == "img":
            head, data = named["src"].split(",")
            assert head == "data:image/jpeg;base64" and base64.b64decode(data, validate=True)[:3] == b"\xff\xd8\xff"
            assert named["alt"]
            self.images += 1
        if tag not in self.void:
            self.open.append(tag)
    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in self.void:
            self.open.pop()
    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"
    def handle_data(self, data):
        self.words.append(data)

text = open(sys.argv[1], encoding="utf-8").read()
page = Page()
page.feed(text)
page.close()
assert not page.open, page.open
words = " ".join(page.words)
for wanted in ("Which to choose", "Worst case", "Winners", "commit", "threads", "how it was measured"):
    assert wanted in words, wanted
for link in re.findall(r'href="#([^"]*)"', text):
    assert link in page.ids, link
assert "nan" not in words.lower().split() and "inf" not in words.lower().split()
print(page.images, "pictures")
PY
}

# Every row has every column, numbers are numbers, and there are as many rows as points.
check_table() {
    /usr/bin/python3 -B - "$1" "$2" <<'PY'
import csv, sys
rows = list(csv.DictReader(open(sys.argv[1], newline="")))
assert len(rows) == int(sys.argv[2]), len(rows)
words = {"scene", "source", "light", "technique", "kind"}
for row in rows:
    assert None not in row and None not in row.values(), row
    for key, value in row.items():
        assert key in words or value == "" or float(value) is not None
    assert float(row.get("frame_ms_median", row.get("frame_ms"))) > 0
PY
}

a_small_chart_has_all_its_files() {
    chart "$work/out" --size 16x9 --budgets 2,4 --reference 16 --sources 'sky:hour=12,size=64x32'
    check_page "$work/out/index.html" || fail "index.html"
    check_table "$work/out/chart.csv" $(((15 + 9) * 2)) || fail "chart.csv"
    check_table "$work/out/runs.csv" $(((15 + 9) * 2 * 4)) || fail "runs.csv"
    [ "$(find "$work/out" -name '*.svg' | wc -l)" = 8 ] || fail "not four charts for each of two panels"
    find "$work/out" -name '*.svg' -exec /usr/bin/python3 -B -c \
        'import sys, xml.etree.ElementTree as t; [t.parse(f) for f in sys.argv[1:]]' {} + || fail "an SVG file"
    [ -z "$(find "$work/out" -name '*.gp' -o -name '*.part')" ] || fail "something is left over"
}

# The light-transport cache, for direct and for all light: its computation is reported separately from frame times.
what_is_computed_beforehand_is_told_apart() {
    chart "$work/a" --techniques cached,mis,mis/eye --sources 'sky:hour=12,size=64x32'
    /usr/bin/python3 -B - "$work/a/chart.csv" <<'PY' || fail "chart.csv"
import csv, sys
rows = list(csv.DictReader(open(sys.argv[1], newline="")))
for light, other in (("direct", "mis"), ("all", "mis/eye")):
    cached, traced = ([r for r in rows if r["light"] == light and r["technique"] == name] for name in ("cached", other))
    assert len(cached) == len(traced) == 2, light
    for c, t in zip(cached, traced):
        assert c["kind"] == "prepared" and float(c["prepared_ms"]) > 0 and float(t["prepared_ms"]) == 0, (light, c, t)
        assert int(c["rays"]) < int(t["rays"]), (light, c, t)
    assert float(cached[0]["noise_median"]) < float(traced[0]["noise_median"]), (light, cached[0], traced[0])
of = {r["light"]: float(r["energy"]) for r in rows if r["technique"] == "cached" and r["budget"] == "16"}
assert abs(of["direct"] - 1) < 0.05 and abs(of["all"] - 1) < 0.05, of
PY
    [ "$(grep -o 'first computes for' "$work/a/index.html" | wc -l)" = 2 ] || fail "the page does not say so of both"
}

references_are_kept_and_used_again() {
    chart "$work/a" --techniques mis,faces --sources 'a<b, "c"&d=sky:hour=12,size=64x32'
    find "$work/cache" -name '*.truth' -exec sha256sum {} + | sort >"$work/before"
    [ "$(wc -l <"$work/before")" = 2 ] || fail "not two references"
    chart "$work/b" --techniques faces,uniform --sources 'a<b, "c"&d=sky:hour=12,size=64x32'
    find "$work/cache" -name '*.truth' -exec sha256sum {} + | sort >"$work/after"
    cmp "$work/before" "$work/after" || fail "references have changed"
    check_page "$work/b/index.html" || fail "a title with marks of HTML"
    check_table "$work/b/chart.csv" 4 || fail "a title with marks of CSV"
    # The same seeds and references give the same errors, whatever else is charted.
    /usr/bin/python3 -B - "$work/a/runs.csv" "$work/b/runs.csv" <<'PY' || fail "errors differ"
import csv, sys
def errors(name):
    return [(r["budget"], r["seed"], r["rel_mse"], r["noise"], r["delta_e"]) for r in csv.DictReader(open(name))
            if r["technique"] == "faces"]
a, b = map(errors, sys.argv[1:])
assert len(a) == 8 and a == b, (a, b)
PY
    head -c 100 /dev/zero >"$(cut -c 67- "$work/before" | head -n 1)"
    chart "$work/c" --techniques faces --sources 'sky:hour=12,size=64x32'
    grep -q 'computing it again' "$work/log" || fail "damage is not reported"
    find "$work/cache" -name '*.truth' -exec sha256sum {} + | sort >"$work/after"
    cmp "$work/before" "$work/after" || fail "the reference is not the same again"
}

bad_input_ends_with_its_code() {
    local program=("$bin/relight-chart" --quick)
    expect 2 '--out is missing' "${program[@]}"
    expect 2 "there are uniform,brdf,light" "${program[@]}" --out "$work/o" --techniques metropolis
    expect 2 'does not ascend' "${program[@]}" --out "$work/o" --budgets 8,4
    expect 2 '--seeds' "${program[@]}" --out "$work/o" --seeds 3
    expect 2 '--size' "${program[@]}" --out "$work/o" --size 320
    expect 2 'at least one of each' "${program[@]}" --out "$work/o" --sources ' ; '
    expect 1 'nowhere.json' "${program[@]}" --out "$work/o" --scenes "$work/nowhere.json"
    expect 1 'nowhere.exr' "${program[@]}" --out "$work/o" --sources "$work/nowhere.exr"
    : >"$work/file"
    expect 1 "$work/file.*is not a folder" "${program[@]}" --out "$work/file"
    expect 1 "$work/file.*is not a folder" "${program[@]}" --out "$work/o" --cache "$work/file"
    expect 2 'neither XDG_CACHE_HOME nor HOME' env -u XDG_CACHE_HOME -u HOME "${program[@]}" --out "$work/o"
}

what_the_script_cannot_do_is_told() {
    mkdir "$work/empty"
    expect 1 'python3 cannot be started: No such file' env PATH="$work/empty" "$bin/relight-chart" --quick --out "$work/o"
    mkdir -p "$work/o/chart.csv.part"
    expect 1 "error: $work/o/chart.csv.part: Is a directory" "$bin/relight-chart" --quick --size 16x9 --seeds 4 --budgets 2,4 \
        --reference 16 --techniques mis --out "$work/o" --sources sky:size=64x32
}

# Ranks make the references; rank 0 finds them in the cache and measures. The pictures' errors are those of one process.
ranks_share_out_the_references_of_a_chart() {
    begin_jobs
    local flags=(--techniques faces --sources 'noon=sky:hour=12,size=64x32;grey=sky:hour=12,size=64x32,turbidity=10')
    chart alone "${flags[@]}" --cache alone.cache
    mpirun --oversubscribe -n 2 "$bin/relight-chart" --quick --size 24x14 --seeds 4 --budgets 4,16 --reference 64 \
        "${flags[@]}" --cache joint.cache --out joint 2>log || { cat log; fail "a chart by two ranks"; }
    [ "$(cd alone.cache && ls)" = "$(cd joint.cache && ls)" ] || fail "other references: $(ls joint.cache)"
    for file in alone.cache/*; do cmp "$file" "joint.cache/${file#*/}"; done
    [ -s joint/index.html ] || fail "no page"
}

"$1"
