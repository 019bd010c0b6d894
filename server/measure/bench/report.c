#include "measure/bench/bench.h"

#include <jansson.h>

bool bench_holds(const struct bench_row *r)
{
    if (r->skipped[0] || r->sense == BENCH_STATED)
        return false;
    return r->sense == BENCH_AT_LEAST ? r->ratio >= r->target : r->ratio <= r->target;
}

static const char *verdict(const struct bench_row *r)
{
    if (r->skipped[0])
        return "not measured";
    if (r->sense == BENCH_STATED)
        return "stated";
    return bench_holds(r) ? "holds" : "does not hold";
}

static void print_row(const struct bench_row *r, FILE *to)
{
    char bare[32] = "-", ratio[32] = "-", target[32] = "-";

    if (!r->alone) {
        snprintf(bare, sizeof(bare), "%.4g", r->bare);
        snprintf(ratio, sizeof(ratio), "%.3g", r->ratio);
    }
    if (r->sense != BENCH_STATED)
        snprintf(target, sizeof(target), "%s%.4g", r->sense == BENCH_AT_LEAST ? ">= " : "<= ", r->target);
    if (r->skipped[0])
        fprintf(to, "%-34s %10s %10s %-9s %7s %8s  %s: %s\n", r->name, "-", "-", r->unit, "-", target, verdict(r),
                r->skipped);
    else
        fprintf(to, "%-34s %10.4g %10s %-9s %7s %8s  %s\n", r->name, r->ours, bare, r->unit, ratio, target, verdict(r));
    if (r->note[0])
        fprintf(to, "    %s\n", r->note);
}

void bench_print_table(const struct bench_report *r, FILE *to)
{
    fprintf(to, "%s\n%-34s %10s %10s %-9s %7s %8s  %s\n", r->title, "what", "ours", "bare", "unit", "ratio", "target",
            "verdict");
    for (size_t i = 0; i < r->count; i++)
        print_row(&r->rows[i], to);
}

static json_t *row_object(const struct bench_row *r)
{
    json_t *o =
        json_pack("{s:s, s:s, s:s, s:s}", "name", r->name, "unit", r->unit, "verdict", verdict(r), "note", r->note);

    if (r->skipped[0]) {
        json_object_set_new(o, "skipped", json_string(r->skipped));
        return o;
    }
    json_object_set_new(o, "ours", json_real(r->ours));
    json_object_set_new(o, "rounds", json_integer(r->rounds));
    if (!r->alone) {
        json_object_set_new(o, "bare", json_real(r->bare));
        json_object_set_new(o, "ratio", json_real(r->ratio));
    }
    if (r->sense != BENCH_STATED)
        json_object_set_new(o, r->sense == BENCH_AT_LEAST ? "at_least" : "at_most", json_real(r->target));
    return o;
}

void bench_print_json(const struct bench_report *r, FILE *to)
{
    json_t *all = json_array();

    for (size_t i = 0; i < r->count; i++)
        json_array_append_new(all, row_object(&r->rows[i]));
    json_t *j = json_pack("{s:s, s:o}", "title", r->title, "rows", all);
    json_dumpf(j, to, JSON_INDENT(1) | JSON_REAL_PRECISION(6));
    fprintf(to, "\n");
    json_decref(j);
}
