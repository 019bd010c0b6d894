#include "scene/surface/lobe.h"

#include <math.h>

#define MIN_COSINE 1e-3 /* minimum cosine of wo with a shading normal that faces away from it, as in lobes.h */

struct lobe lobe_of(const struct scatter *s)
{
    return (
        struct lobe){ s->kind, s->surface.geometric, s->surface.shading, s->diffuse, s->specular, s->gloss, s->veil };
}

struct lobe lobe_of_lane(const struct shade_packet *p, uint32_t l)
{
    return (struct lobe){
        .kind = (enum lobe_kind)p->kind,
        .geometric = { p->ng_x[l], p->ng_y[l], p->ng_z[l] },
        .shading = { p->ns_x[l], p->ns_y[l], p->ns_z[l] },
        .diffuse = { p->diffuse[0][l], p->diffuse[1][l], p->diffuse[2][l] },
        .specular = { p->specular[0][l], p->specular[1][l], p->specular[2][l] },
        .gloss = p->gloss[l],
    };
}

void frame_about(struct vec3 n, struct vec3 *t, struct vec3 *u)
{
    /* [Duff et al. 2017, listing 3] */
    const float sign = copysignf(1.0f, n.z), a = -1.0f / (sign + n.z), b = n.x * n.y * a;
    *t = vec3_make(1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *u = vec3_make(b, sign + n.y * n.y * a, -n.y);
}

struct vec3 frame_direction(struct vec3 n, double x, double y, double z)
{
    struct vec3 t, u;

    frame_about(n, &t, &u);
    return vec3_normalize(
        vec3_add(vec3_scale(n, (float)z), vec3_add(vec3_scale(t, (float)x), vec3_scale(u, (float)y))));
}

static struct vec3 reflected(struct vec3 w, struct vec3 n)
{
    return vec3_sub(vec3_scale(n, 2.0f * vec3_dot(w, n)), w);
}

/* wo, bent until it is above the shading normal. */
static struct vec3 lifted(const struct lobe *l, struct vec3 wo)
{
    const double out = vec3_dot_double(l->shading, wo);
    if (out >= MIN_COSINE)
        return wo;
    return vec3_normalize(vec3_add(wo, vec3_scale(l->shading, (float)(MIN_COSINE - out))));
}

/* The probability of sampling the diffuse lobe. */
static double diffuse_part(const struct lobe *l, struct vec3 out)
{
    const double d = rgb_luminance(l->diffuse.x, l->diffuse.y, l->diffuse.z);
    const double f0 = rgb_luminance(l->specular.x, l->specular.y, l->specular.z);

    if (l->kind == LOBE_LAMBERT || (l->kind == LOBE_GGX && l->gloss <= 0.0f))
        return 1.0;
    if (l->kind == LOBE_PHONG)
        return d + f0 > 0.0 ? d / (d + f0) : 1.0;
    const double grown = f0 + (1.0 - f0) * schlick(vec3_dot_double(l->shading, out)), matte = (1.0 - grown) * d;
    return matte + grown > 0.0 ? matte / (matte + grown) : 1.0;
}

/* D of [Walter et al. 2007, Eq. 33] about the normal n. The sine comes from a cross product, which is accurate where it
 * is small: 1 - cos^2 of two rounded vectors has an error of 10 % at alpha = ALPHA_DELTA. */
static double microfacets(double alpha, struct vec3 n, struct vec3 h)
{
    const double x = (double)n.y * h.z - (double)n.z * h.y, y = (double)n.z * h.x - (double)n.x * h.z,
                 z = (double)n.x * h.y - (double)n.y * h.x;
    const double a2 = alpha * alpha, nh = vec3_dot_double(n, h), q = a2 * nh * nh + x * x + y * y + z * z;
    return nh > 0.0 ? a2 / (PI * fmax(q * q, 1e-30)) : 0.0;
}

static double masked(double alpha, double cosine)
{
    return sqrt(alpha * alpha + (1.0 - alpha * alpha) * cosine * cosine);
}

static void evaluate_bare(const struct lobe *l, struct vec3 wo, struct vec3 wi, double brdf[3])
{
    const double diffuse[3] = { l->diffuse.x, l->diffuse.y, l->diffuse.z };
    const double specular[3] = { l->specular.x, l->specular.y, l->specular.z };
    const double in = vec3_dot_double(l->shading, wi);

    brdf[0] = brdf[1] = brdf[2] = 0.0;
    if (!(in > 0.0 && vec3_dot_double(l->geometric, wi) > 0.0))
        return;
    if (l->kind != LOBE_GGX) {
        const double c = l->kind == LOBE_PHONG ? vec3_dot_double(reflected(wo, l->shading), wi) : 0.0;
        const double shine = c > 0.0 ? (l->gloss + 2.0) / (2.0 * PI) * pow(fmin(c, 1.0), l->gloss) : 0.0;
        for (int k = 0; k < 3; k++)
            brdf[k] = diffuse[k] / PI + specular[k] * shine;
        return;
    }
    const struct vec3 o = lifted(l, wo), h = vec3_normalize(vec3_add(o, wi));
    const double out = vec3_dot_double(l->shading, o), d = microfacets(l->gloss, l->shading, h);
    const double shine = d * 0.5 / (in * masked(l->gloss, out) + out * masked(l->gloss, in) + 1e-20);
    const double fresnel = schlick(vec3_dot_double(o, h)), enter = 1.0 - schlick(in), leave = 1.0 - schlick(out);
    for (int k = 0; k < 3; k++) {
        const double f0 = specular[k];
        brdf[k] = enter * leave * diffuse[k] / PI + (f0 + (1.0 - f0) * fresnel) * shine;
    }
}

void lobe_evaluate(const struct lobe *l, struct vec3 wo, struct vec3 wi, double brdf[3])
{
    evaluate_bare(l, wo, wi, brdf);
    if (!veil_is(&l->veil))
        return;
    const double passes = veil_passes(&l->veil, wo);
    for (int k = 0; k < 3; k++)
        brdf[k] *= passes;
}

bool lobe_weight(const struct lobe *l, struct vec3 wo, struct vec3 wi, double density, double weight[3])
{
    double brdf[3];

    lobe_evaluate(l, wo, wi, brdf);
    if (!(density > 0.0 && brdf[0] + brdf[1] + brdf[2] > 0.0))
        return false;
    const double scale = vec3_dot_double(l->shading, wi) / density;
    for (int c = 0; c < 3; c++)
        weight[c] = brdf[c] * scale;
    return true;
}

double lobe_density(const struct lobe *l, struct vec3 wo, struct vec3 wi)
{
    const struct vec3 o = l->kind == LOBE_GGX ? lifted(l, wo) : wo;
    const double part = diffuse_part(l, o), in = vec3_dot_double(l->shading, wi);
    double p = in > 0.0 ? part * in / PI : 0.0;

    if (l->kind == LOBE_PHONG) {
        const double c = vec3_dot_double(reflected(wo, l->shading), wi);
        p += c > 0.0 ? (1.0 - part) * (l->gloss + 1.0) / (2.0 * PI) * pow(fmin(c, 1.0), l->gloss) : 0.0;
    } else if (l->kind == LOBE_GGX) {
        const struct vec3 h = vec3_normalize(vec3_add(o, wi));
        const double out = vec3_dot_double(l->shading, o);
        /* visible normals: G1 D / (4 cos_out), G1 = 2 cos_out / (cos_out + masked) */
        p += (1.0 - part) * microfacets(l->gloss, l->shading, h) * 0.5 / (out + masked(l->gloss, out));
    }
    return p;
}

static struct vec3 about(struct vec3 n, double z, double azimuth)
{
    const double r = sqrt(fmax(0.0, 1.0 - z * z));

    return frame_direction(n, r * cos(azimuth), r * sin(azimuth), z);
}

/* Samples a half vector from the distribution of visible normals [Dupuy and Benyoub 2023, listing 3]. */
static struct vec3 visible_normal(const struct lobe *l, struct vec3 out, double x, double y)
{
    struct vec3 t, u;

    frame_about(l->shading, &t, &u);
    double w[3] = { vec3_dot_double(out, t) * l->gloss, vec3_dot_double(out, u) * l->gloss,
                    vec3_dot_double(out, l->shading) };
    const double scale = 1.0 / sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (int k = 0; k < 3; k++)
        w[k] *= scale;
    const double z = (1.0 - x) * (1.0 + w[2]) - w[2], r = sqrt(fmax(0.0, 1.0 - z * z)), phi = 2.0 * PI * y;
    const double h[3] = { l->gloss * (r * cos(phi) + w[0]), l->gloss * (r * sin(phi) + w[1]), fmax(0.0, z + w[2]) };
    return frame_direction(l->shading, h[0], h[1], h[2]);
}

struct vec3 lobe_sample(const struct lobe *l, struct vec3 wo, const double x[3])
{
    const struct vec3 o = l->kind == LOBE_GGX ? lifted(l, wo) : wo;

    if (x[0] < diffuse_part(l, o))
        return about(l->shading, sqrt(1.0 - x[1]), 2.0 * PI * x[2]);
    if (l->kind == LOBE_PHONG)
        return about(reflected(wo, l->shading), pow(x[1], 1.0 / (l->gloss + 1.0)), 2.0 * PI * x[2]);
    const struct vec3 h = visible_normal(l, o, x[1], x[2]);
    return vec3_sub(vec3_scale(h, 2.0f * vec3_dot(o, h)), o);
}

double lobe_albedo(const struct lobe *l, struct vec3 wo)
{
    const struct vec3 d = l->diffuse, s = l->specular;
    const double f0 = fmax(s.x, fmax(s.y, s.z)), both = fmax(d.x + s.x, fmax(d.y + s.y, d.z + s.z));
    const double c = 1.0 - fmin(1.0, fmax(0.0, vec3_dot_double(l->shading, wo)));

    return fmin(1.0, l->kind == LOBE_GGX ? fmax(both, f0 + (1.0 - f0) * c * c * c * c * c) : both);
}

double lobe_shine(const struct lobe *l, struct vec3 wo)
{
    const double f0 = fmax((double)l->specular.x, fmax((double)l->specular.y, (double)l->specular.z));

    if (l->kind == LOBE_GGX)
        return l->gloss > 0.0 ? f0 + (1.0 - f0) * schlick(vec3_dot_double(l->shading, wo)) : 0.0;
    return l->kind == LOBE_PHONG ? f0 : 0.0;
}

const char *lobe_kind_name(enum lobe_kind kind)
{
    static const char *const names[] = { [LOBE_LAMBERT] = "lambert", [LOBE_PHONG] = "phong", [LOBE_GGX] = "ggx" };
    return names[kind];
}
