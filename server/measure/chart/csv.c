#include "measure/chart/csv.h"

#include <inttypes.h>
#include <math.h>

/* A number; an empty field for what is none. */
static void add_number(struct text *t, double v)
{
    if (isfinite(v))
        text_add(t, ",%.6g", v);
    else
        text_add(t, ",");
}

static void add_band(struct text *t, const struct band *b, double scale)
{
    add_number(t, scale * b->low);
    add_number(t, scale * b->median);
    add_number(t, scale * b->high);
}

static void add_place(struct text *t, const struct panel *p, const struct panel_curve *c)
{
    text_add_field(t, p->scene);
    text_add(t, ",");
    text_add_field(t, p->source);
    text_add(t, ",%s,%s", light_class_name(p->light_class), c->technique->name);
}

static void add_point(struct text *t, const struct panel *p, const struct panel_curve *c, const struct panel_point *k)
{
    static const char *const kinds[] = { "fixed", "baseline", "prepared", "filtered", "auto" };
    double common = 0.0;

    add_place(t, p, c);
    text_add(t, ",%s,%u,%u,%u,%" PRIu64 ",%" PRIu64 ",%u", kinds[c->technique->kind], k->budget, k->samples,
             k->eye_paths, k->particles, k->rays, p->seeds);
    add_band(t, &k->seconds, 1e3);
    for (int m = 0; m < ERROR_KINDS; m++)
        add_band(t, &k->errors[m], 1.0);
    add_number(t, k->floor.error);
    add_number(t, k->floor.bias);
    add_number(t, k->floor.doubt);
    add_number(t, k->floor.z);
    add_number(t, k->floor.variance);
    add_number(t, k->floor.energy);
    add_number(t, k->floor.energy_doubt);
    add_number(t, k->expected > 0.0 ? k->expected : NAN);
    for (int m = 0; m < COMMON_PARTS; m++) {
        add_number(t, p->common_ms[m]);
        common += p->common_ms[m];
    }
    add_number(t, 1e3 * k->seconds.median - common);
    add_number(t, p->load_ms);
    add_number(t, p->bvh_ms);
    add_number(t, p->gbuffer_ms);
    add_number(t, p->table_ms);
    add_number(t, p->judge.noise);
    add_number(t, p->judge.doubt);
    add_number(t, c->prepared_ms);
    text_add(t, ",%u,%u,%u\n", p->truth.samples[0] + p->truth.samples[1], p->width, p->height);
}

void csv_points(struct text *t, const struct panel *const *panels, size_t count)
{
    text_add(t, "scene,source,light,technique,kind,budget,samples,eye_paths,particles,rays,seeds,"
                "frame_ms_p10,frame_ms_median,frame_ms_p90");
    for (int m = 0; m < ERROR_KINDS; m++) {
        const char *name = error_about((enum error_kind)m)->name;
        text_add(t, ",%s_p10,%s_median,%s_p90", name, name, name);
    }
    text_add(t, ",rel_mse_mean,bias,bias_doubt,bias_z,variance,energy,energy_doubt,expected_noise");
    for (int m = 0; m < COMMON_PARTS; m++)
        text_add(t, ",%s_ms", common_name((enum common_part)m));
    text_add(t, ",technique_ms,load_ms,bvh_ms,gbuffer_ms,table_ms,reference_noise,reference_doubt,prepared_ms,"
                "reference_samples,"
                "width,height\n");
    for (size_t k = 0; k < count; k++)
        for (size_t c = 0; c < panels[k]->curve_count; c++)
            for (uint32_t b = 0; b < panels[k]->budget_count && !panels[k]->curves[c].left_out.text[0]; b++)
                add_point(t, panels[k], &panels[k]->curves[c], &panels[k]->curves[c].points[b]);
}

void csv_runs(struct text *t, const struct panel *const *panels, size_t count)
{
    text_add(t, "scene,source,light,technique,budget,seed,frame_ms");
    for (int m = 0; m < ERROR_KINDS; m++)
        text_add(t, ",%s", error_about((enum error_kind)m)->name);
    text_add(t, "\n");
    for (size_t k = 0; k < count; k++) {
        const struct panel *p = panels[k];
        const size_t runs = (size_t)p->budget_count * p->seeds;
        for (size_t i = 0; i < p->curve_count * runs; i++) {
            const struct panel_curve *c = &p->curves[i / runs];
            if (c->left_out.text[0])
                continue;
            add_place(t, p, c);
            text_add(t, ",%u,%u", p->budgets[i % runs / p->seeds], (uint32_t)(i % p->seeds));
            add_number(t, 1e3 * c->seconds[i % runs]);
            for (size_t m = 0; m < ERROR_KINDS; m++)
                add_number(t, c->errors[m * runs + i % runs]);
            text_add(t, "\n");
        }
    }
}
