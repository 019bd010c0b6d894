#include "sky/tables/irradiance.h"

#include "sky/tables/cube.h"

#include <math.h>
#include <string.h>

static double over_top(double u, double v)
{
    const double a = sqrt(1.0 + u * u), b = sqrt(1.0 + v * v);

    return 0.5 * (v / b * atan(u / b) + u / a * atan(v / a));
}

static double over_side(double u, double v)
{
    const double b = sqrt(1.0 + v * v);

    return -0.5 * atan(u / b) / b;
}

void irradiance_weights(uint32_t n, double *out)
{
    const double step = 2.0 / n;

    for (uint32_t k = 0; k < n * n; k++) {
        const double u0 = -1.0 + step * (k % n), v0 = -1.0 + step * (k / n), u1 = u0 + step, v1 = v0 + step;
        const double above = fmax(v0, 0.0); /* with n = 1 the only texel is half below */
        out[k] = over_top(u1, v1) - over_top(u0, v1) - over_top(u1, v0) + over_top(u0, v0);
        out[n * n + k] =
            v1 <= 0.0 ? 0.0 : over_side(u1, v1) - over_side(u0, v1) - over_side(u1, above) + over_side(u0, above);
    }
}

void irradiance_upward(const struct environment *e, const double *weights, double rgb[3])
{
    const uint32_t n = e->n, up = 2; /* +Y; its opposite, 3, is below */

    rgb[0] = rgb[1] = rgb[2] = 0.0;
    for (uint32_t face = 0; face < CUBE_FACES; face++) {
        const bool columns = face < 2; /* whether columns run along Y, or rows do */
        for (uint32_t k = 0; k < n * n && face != up + 1; k++) {
            const struct texel *t = &e->texels[(size_t)face * n * n + k];
            const uint32_t side = columns ? k % n * n + k / n : k;
            const double w = face == up ? weights[k] : weights[n * n + side];
            rgb[0] += w * (double)t->r;
            rgb[1] += w * (double)t->g;
            rgb[2] += w * (double)t->b;
        }
    }
}

static float brightness(const struct texel *t)
{
    return rgb_luminance(t->r, t->g, t->b);
}

static void add_texel(struct irradiance_cells *c, uint32_t cell, const struct texel *t, const float w[3], float angle)
{
    const float weight = brightness(t) * angle, mean = weight * (1.0f - angle / 12.0f); /* of a square's directions */

    c->weight[cell] += (double)weight;
    c->x[cell] += mean * w[0];
    c->y[cell] += mean * w[1];
    c->z[cell] += mean * w[2];
    c->spread[cell] += angle;
    c->rgb[0][cell] += t->r * angle;
    c->rgb[1][cell] += t->g * angle;
    c->rgb[2][cell] += t->b * angle;
}

static void fill_row(struct irradiance_cells *c, const struct environment *e, const struct sky_table *t, uint32_t face,
                     uint32_t i)
{
    const uint32_t n = e->n;

    for (uint32_t j = 0; j < n; j++) {
        const uint32_t at = (face * n + i) * n + j, cell = sky_cell(face, i * SKY_EDGE / n, j * SKY_EDGE / n);
        double d[3];
        if (t && t->has_sun && brightness(&e->texels[at]) > t->level && sky_table_sun(t, at, 1.0f) > 0.0f)
            continue;
        cube_direction(face, -1.0 + (2.0 * j + 1.0) / n, -1.0 + (2.0 * i + 1.0) / n, d);
        const double scale = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        const float w[3] = { (float)(d[0] * scale), (float)(d[1] * scale), (float)(d[2] * scale) };
        add_texel(c, cell, &e->texels[at], w, (float)e->solid_angle[i * n + j]);
    }
}

static void fill_cells(struct irradiance_cells *c, const struct environment *e, const struct sky_table *t)
{
#pragma omp parallel for /* the rows of a face whose cells are apart */
    for (uint32_t part = 0; part < CUBE_FACES * SKY_EDGE; part++)
        for (uint32_t i = 0; i < e->n; i++)
            if (i * SKY_EDGE / e->n == part % SKY_EDGE)
                fill_row(c, e, t, part / SKY_EDGE, i);
    for (uint32_t k = 0; k < SKY_CELLS; k++) {
        const float scale = c->weight[k] > 0.0 ? (float)(1.0 / c->weight[k]) : 0.0f;
        c->x[k] *= scale;
        c->y[k] *= scale;
        c->z[k] *= scale;
        c->spread[k] = fmaxf(0.5f * sqrtf(c->spread[k]), 1e-6f);
    }
}

/* The mean of max(0, c) where c spreads evenly about its mean. */
static void gather(const struct irradiance_cells *restrict cells, const float n[3], float out[IRRADIANCE_KINDS][3])
{
    float r = 0.0f, g = 0.0f, b = 0.0f, enter_r = 0.0f, enter_g = 0.0f, enter_b = 0.0f;

#pragma omp simd reduction(+ : r, g, b, enter_r, enter_g, enter_b)
    for (uint32_t k = 0; k < SKY_CELLS; k++) {
        const float mean = n[0] * cells->x[k] + n[1] * cells->y[k] + n[2] * cells->z[k], a = cells->spread[k];
        const float above = mean + a > 0.0f ? mean + a : 0.0f;
        const float c = mean > a ? mean : 0.25f * above * above / a;
        const float left = c < 1.0f ? 1.0f - c : 0.0f, enter = c * (1.0f - left * left * left * left * left);
        r += c * cells->rgb[0][k];
        g += c * cells->rgb[1][k];
        b += c * cells->rgb[2][k];
        enter_r += enter * cells->rgb[0][k];
        enter_g += enter * cells->rgb[1][k];
        enter_b += enter * cells->rgb[2][k];
    }
    const float sums[IRRADIANCE_KINDS][3] = { { r, g, b }, { enter_r, enter_g, enter_b } };
    memcpy(out, sums, sizeof(sums));
}

void irradiance_build(struct irradiance *out, const struct environment *e, const struct sky_table *t)
{
    const uint32_t side = IRRADIANCE_EDGE + 1;
    struct irradiance_cells *cells = &out->cells;

    memset(cells, 0, sizeof(*cells));
    fill_cells(cells, e, t);
#pragma omp parallel for schedule(static)
    for (uint32_t k = 0; k < CUBE_FACES * side * side; k++) {
        const uint32_t face = k / (side * side), i = k / side % side, j = k % side;
        double d[3];
        float sums[IRRADIANCE_KINDS][3];
        cube_direction(face, -1.0 + 2.0 * j / IRRADIANCE_EDGE, -1.0 + 2.0 * i / IRRADIANCE_EDGE, d);
        const double scale = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        gather(cells, (float[]){ (float)(d[0] * scale), (float)(d[1] * scale), (float)(d[2] * scale) }, sums);
        for (int kind = 0; kind < IRRADIANCE_KINDS; kind++)
            memcpy(out->rgb[kind][face][i][j], sums[kind], sizeof(sums[kind]));
    }
}

void irradiance_at(const struct irradiance *r, enum irradiance_kind kind, const float normal[3], float rgb[3])
{
    float u, v;
    const uint32_t face = cube_locate(normal, &u, &v);
    const float x = (u + 1.0f) * (0.5f * IRRADIANCE_EDGE), y = (v + 1.0f) * (0.5f * IRRADIANCE_EDGE);
    const uint32_t j = x < IRRADIANCE_EDGE - 1 ? (uint32_t)x : IRRADIANCE_EDGE - 1;
    const uint32_t i = y < IRRADIANCE_EDGE - 1 ? (uint32_t)y : IRRADIANCE_EDGE - 1;
    const float across = x - (float)j, down = y - (float)i;

    for (int c = 0; c < 3; c++) {
        const float above = (1.0f - across) * r->rgb[kind][face][i][j][c] + across * r->rgb[kind][face][i][j + 1][c];
        const float below =
            (1.0f - across) * r->rgb[kind][face][i + 1][j][c] + across * r->rgb[kind][face][i + 1][j + 1][c];
        rgb[c] = (1.0f - down) * above + down * below;
    }
}
