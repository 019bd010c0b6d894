#include "programs/render/render.h"

#include "sky/tables/sky_table.h"

#include <jansson.h>

/* Which estimator took which class, with what, and what was left out and why. */
static json_t *plan_stats(const struct relight_stats *s)
{
    const struct plan *p = &s->plan;
    json_t *left_out = json_array();

    for (uint32_t k = 0; k < p->left_out_count; k++)
        json_array_append_new(left_out, json_string(p->left_out[k]));
    return json_pack("{s:{s:i, s:b, s:b}, s:s, s:s, s:s, s:I, s:i, s:o}", "direct", "strata", (int)s->direct.strata,
                     "sun_apart", s->direct.sun, "compensated", s->direct.compensated, "caustics",
                     plan_estimator_name(p->caustics), "interreflection", plan_estimator_name(p->indirect),
                     "interreflection_of_caustics", plan_estimator_name(p->indirect_caustics), "particles",
                     (json_int_t)p->particles, "eye_paths", (int)p->eye_paths, "left_out", left_out);
}

/* Where the environment's sun stands; null: it has none. */
static json_t *sun_stats(const struct environment *e)
{
    struct sun_place sun;

    return sky_find_sun(e, &sun) ? json_pack("{s:f, s:f}", "elevation", sun.elevation, "azimuth", sun.azimuth)
                                 : json_null();
}

static json_t *image_stats(const struct render *r, const struct relight_stats *s, const double ms[3])
{
    const struct gbuffer *g = r->set->gbuffer;
    const struct image_faults *f = &r->environment->image.faults;

    return json_pack("{s:{s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}, s:{s:I, s:I, s:I, s:I}, s:{s:I, s:I, s:I, s:I}, "
                     "s:{s:I, s:I, s:I}, "
                     "s:{s:I, s:I, s:I, s:I}, s:{s:I, s:I, s:f, s:I}, s:o}",
                     "ms", "decode", ms[0], "rebuild", ms[1], "shade", s->shade_ms, "eye_paths", s->eye_ms,
                     "light_tracer", s->light_ms, "filter", s->filter_ms, "resolve", s->resolve_ms, "write", ms[2],
                     "rays", "direct", (json_int_t)s->direct.rays, "eye_paths", (json_int_t)s->eye.rays, "light_tracer",
                     (json_int_t)s->light.rays, "reference", (json_int_t)s->reference_rays, "light_samples",
                     "generated", (json_int_t)s->direct.generated, "chosen", (json_int_t)s->direct.chosen, "effective",
                     (json_int_t)s->direct.effective, "lobes", (json_int_t)s->direct.lobes, "light_paths", "particles",
                     (json_int_t)s->light.particles, "starts_hit", (json_int_t)s->light.starts_hit, "splats",
                     (json_int_t)s->light.splats, "repaired", "nan", (json_int_t)f->nan, "infinite",
                     (json_int_t)f->infinite, "negative", (json_int_t)f->negative, "clipped", (json_int_t)f->clipped,
                     "gbuffer", "shade_points", (json_int_t)g->point_count, "edge_pixels", (json_int_t)g->edge_pixels,
                     "cut_rays", g->cut_weight, "bytes", (json_int_t)g->bytes, "sun", sun_stats(r->environment));
}

/* The audit's estimate of the frame's relMSE; nulls: it is not known. */
static json_t *error_stats(const struct relight_stats *s)
{
    return json_pack("{s:o, s:o, s:i, s:I, s:f}", "estimate", s->error > 0.0 ? json_real(s->error) : json_null(),
                     "upper_bound", s->error_at_most > 0.0 ? json_real(s->error_at_most) : json_null(), "pixels",
                     (int)s->audited.pixels, "rays", (json_int_t)s->audited.rays, "ms", s->audited.ms);
}

/* The target, what was chosen, and the error that is expected of it. */
static json_t *estimate_stats(const struct render *r, const struct pilot_stats *s)
{
    json_t *parts = json_array();

    for (int k = 0; k < PILOT_PARTS; k++) {
        const struct pilot_part_stats *part = &s->part[k];
        if (part->there)
            json_array_append_new(parts, json_pack("{s:s, s:s, s:f, s:f, s:f}", "part",
                                                   pilot_part_name((enum pilot_part)k), "by", part->name, "count",
                                                   part->n, "ms", 1e3 * part->seconds, "error", part->error));
    }
    return json_pack("{s:f, s:f, s:f, s:b, s:b, s:I, s:f, s:f, s:o}", "error", s->error, "wished_error",
                     r->desc.target.error, "wished_ms", 1e3 * r->desc.target.seconds, "met", s->met, "denoised",
                     s->denoised, "readings", (json_int_t)s->readings, "light_ms", 1e3 * s->seconds, "pilot_ms",
                     1e3 * s->pilot_seconds, "parts", parts);
}

/* What was computed beforehand, and what this frame did with it. */
static json_t *cache_stats(const struct render *r, const struct relight_stats *s)
{
    const struct transport_stats *c = &s->cache;
    const struct transport_frame_stats *f = &s->cache_frame;

    return json_pack(
        "{s:b, s:f, s:f, s:I, s:I, s:I, s:i, s:i, s:i, s:i, s:i, s:f, s:{s:i, s:f, s:I, s:i}, s:{s:i, s:i}}", "loaded",
        s->cache_loaded, "load_ms", s->cache_loaded ? r->cache_ms : 0.0, "precomputation_ms",
        s->cache_loaded ? 0.0 : r->cache_ms, "bytes", (json_int_t)c->bytes, "dense_bytes", (json_int_t)c->dense, "rays",
        (json_int_t)c->rays, "packets", (int)c->packets, "packets_narrow", (int)c->narrow, "pieces", (int)c->pieces,
        "raw", (int)c->raw, "halves", (int)c->halves, "mean_rank", c->rank, "bright", "texels", (int)f->sun, "share",
        f->share, "rays", (json_int_t)f->rays, "penumbra_packets", (int)f->penumbra, "computed", "packets_cells",
        (int)f->lit, "packets_bright", (int)f->shone);
}

/* The light paths that are kept, and what was drawn anew for this image. */
static json_t *stored_stats(const struct relight_stats *s)
{
    const struct caustic_store_stats *c = &s->stored;
    const struct eye_store_stats *b = &s->stored_behind;

    return json_pack("{s:I, s:I, s:I, s:I, s:i, s:i, s:I, s:{s:I, s:I, s:I, s:I}}", "paths", (json_int_t)c->paths,
                     "wished_paths", (json_int_t)c->requested, "splats", (json_int_t)c->splats, "bytes",
                     (json_int_t)c->bytes, "parts", (int)c->parts, "renewed_parts", (int)c->renewed, "rays",
                     (json_int_t)c->rays, "behind", "paths", (json_int_t)b->paths, "ends", (json_int_t)b->ends, "bytes",
                     (json_int_t)b->bytes, "rays", (json_int_t)b->rays);
}

static json_t *indirect_stats_of(const struct relight_stats *s)
{
    const struct indirect_stats *b = &s->indirect;

    return json_pack("{s:b, s:I, s:I, s:i, s:i, s:f, s:i, s:f}", "loaded", s->indirect_loaded, "bytes",
                     (json_int_t)b->bytes, "rays", (json_int_t)b->rays, "records", (int)b->records, "basis",
                     (int)b->basis, "basis_leaves_out", b->basis_rest, "bounces", (int)b->bounces, "mean_rank",
                     b->rank);
}

/* The part that all frames share. */
static json_t *lamps_stats_of(const struct render *r)
{
    struct lamps_stats s;
    double seconds;

    relight_lamps_get_stats(r->lamps, &s, &seconds);
    return json_pack("{s:f, s:I, s:I, s:I, s:I, s:f}", "scale", r->desc.setup.initial.lamps, "triangles",
                     (json_int_t)s.triangles, "lights", (json_int_t)s.lights, "samples", (json_int_t)s.samples, "rays",
                     (json_int_t)s.rays, "ms", 1e3 * seconds);
}

/* Whether auto took the cache, and why. */
static json_t *auto_stats(const struct cost_verdict *b)
{
    return json_pack("{s:b, s:o, s:s}", "cache", b->yes, "break_even_frames",
                     b->break_even > 0.0 ? json_real(b->break_even) : json_null(), "why", b->why);
}

/* Which pixels have other bits than in the frame before, and what was computed for pixels. */
static json_t *changes_stats(const struct changes *c)
{
    return json_pack("{s:I, s:I, s:[i, i, i, i], s:{s:I, s:I}}", "pixels", (json_int_t)c->changed, "of",
                     (json_int_t)c->pixels, "box", (int)c->box[0], (int)c->box[2], (int)c->box[1], (int)c->box[3],
                     "computed", "sky", (json_int_t)c->sky, "bright", (json_int_t)c->sun);
}

/* What was done to a captured sky. */
static json_t *corrections_of(const struct frame *f)
{
    return json_pack("{s:[f, f, f], s:b, s:f}", "gain", (double)f->gain[0], (double)f->gain[1], (double)f->gain[2],
                     "sun_restored", f->sun_restored, "turn", f->turn);
}

char *render_stats_text(struct render *r, const struct relight_stats *s, const struct pilot_stats *pilot,
                        const double ms[3])
{
    const struct relight_desc *light = &r->request.light;
    const bool measured = r->request.by == DECIDED_BY_MEASURES;
    json_t *name = json_string(r->environment->name); /* NULL where a file's name is not UTF-8 */
    json_t *j = json_pack("{s:I, s:o, s:s, s:i}", "frame", (json_int_t)r->frame.number, "environment",
                          name ? name : json_null(), "method",
                          measured ? "auto" : method_name(method_by_rule(light->direct.method)), "samples",
                          (int)(measured ? pilot->samples : light->direct.samples));
    json_t *more = image_stats(r, s, ms);
    char *text = NULL;

    if (j && more) {
        json_object_update(j, more);
        json_object_set_new(j, "unit", json_string(environment_unit(r->environment)));
        if (between_corrects(&r->desc.setup.source_desc.between))
            json_object_set_new(j, "corrected", corrections_of(&r->frame));
        if (!method_is_reference(light->direct.method))
            json_object_set_new(j, "plan", plan_stats(s));
        json_object_set_new(j, "changes", changes_stats(&r->changes));
        if (s->bias)
            json_object_set_new(j, "bias", json_string(s->bias));
        if (light->direct.method == METHOD_CACHED)
            json_object_set_new(j, "cache", cache_stats(r, s));
        if (s->plan.caustics == PLAN_STORED)
            json_object_set_new(j, "stored_caustics", stored_stats(s));
        if (s->indirect.basis > 0)
            json_object_set_new(j, "interreflection", indirect_stats_of(s));
        if (r->decider.cache.last.why)
            json_object_set_new(j, "auto", auto_stats(&r->decider.cache.last));
        if (r->lamps)
            json_object_set_new(j, "lamps", lamps_stats_of(r));
        json_object_set_new(j, "error", error_stats(s));
        json_object_set_new(j, "estimate", measured ? estimate_stats(r, pilot) : json_null()); /* null: not known */
        text = json_dumps(j, JSON_REAL_PRECISION(6));
    }
    json_decref(more);
    json_decref(j);
    return text;
}
