#include "sky/between/align.h"

#include "base/vec.h"
#include "sky/between/latlong.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define DEGREE (PI / 180.0)

/* ---- The sun of a place and time ---- */

/* Refraction in degrees of a body whose geometric elevation is h degrees; below the horizon, where nobody looks, it
 * fades away. */
static double refraction(double h)
{
    const double above = fmax(h, -1.0), fade = fmin(1.0, fmax(0.0, h + 2.0));
    return fade * fmax(0.0, 1.02 / tan((above + 10.3 / (above + 5.11)) * DEGREE) / 60.0);
}

void align_sun(double latitude, double longitude, int64_t micros, double w[3])
{
    const double days = (double)micros / 86400e6 - 10957.5; /* since noon of 1 January 2000 */
    const double anomaly = (357.528 + 0.9856003 * days) * DEGREE;
    const double ecliptic = (280.460 + 0.9856474 * days + 1.915 * sin(anomaly) + 0.020 * sin(2.0 * anomaly)) * DEGREE;
    const double tilt = (23.439 - 4e-7 * days) * DEGREE;
    const double right = atan2(cos(tilt) * sin(ecliptic), cos(ecliptic)), decl = asin(sin(tilt) * sin(ecliptic));
    const double turn = (fmod(280.46062 + 360.98564737 * days, 360.0) + longitude) * DEGREE - right; /* hour angle */
    const double east = -cos(decl) * sin(turn), lat = latitude * DEGREE;
    const double north = sin(decl) * cos(lat) - cos(decl) * cos(turn) * sin(lat);
    const double up = sin(lat) * sin(decl) + cos(lat) * cos(decl) * cos(turn);
    const double h = atan2(up, hypot(east, north)) / DEGREE, azimuth = atan2(east, north);
    const double seen = fmin(90.0, h + refraction(h)) * DEGREE;

    w[0] = -cos(seen) * sin(azimuth);
    w[1] = sin(seen);
    w[2] = cos(seen) * cos(azimuth);
}

/* ---- The sun of an image ---- */

#define FAR_BRIGHTER 2.0f        /* than the clamped mean of the image */
#define SUN_SPOT (10.0 * DEGREE) /* radius: a larger spot is a cloud or a window */
#define LEVELS 6
#define CLIPPED 10.0f /* a sun that is so little brighter has clipped: its flat spot is where it is */
#define CONTRAST 1.3f /* of the sun to its surroundings, at least */
#define SUN_ROUND 0.4 /* see latlong.h */

/* Mean of the largest channel over the sphere, of values held at `most`. */
static double mean_brightness(const float *rgb, uint32_t width, uint32_t height, float most)
{
    double sum = 0.0;

    for (uint32_t y = 0; y < height; y++) {
        double row = 0.0;
        for (uint32_t x = 0; x < width; x++)
            row += (double)fminf(most, texel_brightest(rgb, (size_t)y * width + x));
        sum += row * texel_solid_angle(width, height, y);
    }
    return sum / (4.0 * PI);
}

/* Mean of the largest channel in a ring around a spot. */
static double around(const struct spot_area *a, const struct spot *s)
{
    const double inner = 1.1 * s->radius + 0.5 * DEGREE, outer = 1.5 * s->radius + 3.0 * DEGREE;
    double sum = 0.0, whole = 0.0;

    for (uint32_t y = 0; y < a->rows; y++) {
        const double o = texel_solid_angle(a->width, a->height, y), up = cos(PI * (y + 0.5) / a->height);
        if (fabs(asin(up) - asin(fmax(-1.0, fmin(1.0, s->w[1])))) > outer)
            continue;
        for (uint32_t x = 0; x < a->width; x++) {
            double w[3];
            texel_direction(a->width, a->height, x + 0.5, y + 0.5, w);
            const double angle = angle_between(w, s->w);
            if (angle < inner || angle > outer)
                continue;
            sum += o * (double)texel_brightest(a->rgb, (size_t)y * a->width + x);
            whole += o;
        }
    }
    return whole > 0.0 ? sum / whole : 0.0;
}

enum err align_find_sun(const float *rgb, uint32_t width, uint32_t height, double w[3], bool *found)
{
    const struct spot_area a = { .rgb = rgb, .width = width, .height = height, .rows = height };
    float most = 0.0f;
    struct spot s;

    *found = false;
    for (size_t i = 0; i < (size_t)width * height; i++)
        most = fmaxf(most, texel_brightest(rgb, i));
    /* Clamping at the mean takes most of a sun out of it. */
    const float once = (float)mean_brightness(rgb, width, height, INFINITY);
    const float rest = (float)mean_brightness(rgb, width, height, once);
    enum err result = ERR_OK;
    float level = 0.0f, below = fmaxf(rest, 1e-6f * most);
    /* Half way to the maximum in logarithm: from the rest of the image, then from what is around the spot, until the
     * level stays. */
    for (int k = 0; most >= FAR_BRIGHTER * rest && most > 0.0f && !result && k < LEVELS; k++) {
        const float last = level, highest = most / CONTRAST;
        level = sqrtf(most) * sqrtf(below);
        if (level > most / CLIPPED)
            level = highest;
        if (*found && level < 1.1f * last)
            break;
        result = spot_find(&a, level, true, &s);
        *found = !result && s.radius < SUN_SPOT && s.round > SUN_ROUND;
        for (int c = 0; c < 3; c++)
            w[c] = *found ? s.w[c] : 0.0;
        below = *found ? fmaxf((float)around(&a, &s), 1e-6f * most) : level;
        if (level >= highest)
            break;
    }
    return result;
}

/* ---- The rotation ---- */

struct candidate {
    bool mirrored;  /* x changes its sign first */
    double r[3][3]; /* proper, of what follows */
    double cost;    /* mean of the squared angle, degrees, held at ALIGN_TRUST_DEGREES */
};

static void exchanged(bool mirrored, const double w[3], double out[3])
{
    out[0] = mirrored ? -w[0] : w[0];
    out[1] = w[1];
    out[2] = w[2];
}

/* Of a seen direction into the world. */
static void turn(const struct candidate *c, const double seen[3], double out[3])
{
    double w[3];

    exchanged(c->mirrored, seen, w);
    for (int i = 0; i < 3; i++)
        out[i] = dot3(c->r[i], w);
}

/* Degrees that a pair is off. */
static double off(const struct candidate *c, const struct sun_pair *p)
{
    double turned[3];

    turn(c, p->seen, turned);
    return angle_between(turned, p->known) / DEGREE;
}

static void find_cost(struct candidate *c, const struct sun_pair *pairs, size_t count)
{
    const double most = ALIGN_TRUST_DEGREES * ALIGN_TRUST_DEGREES;

    c->cost = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double a = off(c, &pairs[i]);
        c->cost += fmin(a * a, most) / (double)count;
    }
}

/* The rotation about +Y by `angle`, radians, that takes +Z towards +X. */
static void about_up(double angle, double r[3][3])
{
    const double c = cos(angle), s = sin(angle);
    const double m[3][3] = { { c, 0.0, s }, { 0.0, 1.0, 0.0 }, { -s, 0.0, c } };

    memcpy(r, m, sizeof(m));
}

/* One turn of Jacobi's method: makes a[p][q] zero. */
static void jacobi(double a[4][4], double v[4][4], int p, int q)
{
    if (fabs(a[p][q]) < 1e-300)
        return;
    const double angle = 0.5 * atan2(2.0 * a[p][q], a[q][q] - a[p][p]), c = cos(angle), s = sin(angle);
    for (int k = 0; k < 4; k++) {
        const double x = a[k][p], y = a[k][q];
        a[k][p] = c * x - s * y;
        a[k][q] = s * x + c * y;
    }
    for (int k = 0; k < 4; k++) {
        const double x = a[p][k], y = a[q][k], vx = v[k][p], vy = v[k][q];
        a[p][k] = c * x - s * y;
        a[q][k] = s * x + c * y;
        v[k][p] = c * vx - s * vy;
        v[k][q] = s * vx + c * vy;
    }
}

/* The unit quaternion x, y, z, w that belongs to the largest eigenvalue of a. */
static void largest_eigenvector(double a[4][4], double q[4])
{
    double v[4][4] = { { 1.0 }, { 0.0, 1.0 }, { 0.0, 0.0, 1.0 }, { 0.0, 0.0, 0.0, 1.0 } };
    int best = 0;

    for (int sweep = 0; sweep < 30; sweep++)
        for (int p = 0; p < 3; p++)
            for (int k = p + 1; k < 4; k++)
                jacobi(a, v, p, k);
    for (int k = 1; k < 4; k++)
        best = a[k][k] > a[best][best] ? k : best;
    for (int k = 0; k < 4; k++)
        q[k] = v[k][best];
}

/* The proper rotation that maximises sum_ij r[i][j] b[i][j], b = sum of weight known seen^T [Davenport 1968]. */
static void best_rotation(const double b[3][3], double r[3][3])
{
    const double trace = b[0][0] + b[1][1] + b[2][2];
    const double z[3] = { b[2][1] - b[1][2], b[0][2] - b[2][0], b[1][0] - b[0][1] };
    double k[4][4] = { { 0.0 } }, q[4];

    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            k[i][j] = b[i][j] + b[j][i] - (i == j ? trace : 0.0);
        k[i][3] = k[3][i] = z[i];
    }
    k[3][3] = trace;
    largest_eigenvector(k, q);
    const double x = q[0], y = q[1], u = q[2], w = q[3];
    const double m[3][3] = { { 1.0 - 2.0 * (y * y + u * u), 2.0 * (x * y - u * w), 2.0 * (x * u + y * w) },
                             { 2.0 * (x * y + u * w), 1.0 - 2.0 * (x * x + u * u), 2.0 * (y * u - x * w) },
                             { 2.0 * (x * u - y * w), 2.0 * (y * u + x * w), 1.0 - 2.0 * (x * x + y * y) } };
    memcpy(r, m, sizeof(m));
}

static void add_pair(bool mirrored, const struct sun_pair *p, double b[3][3])
{
    double w[3];

    exchanged(mirrored, p->seen, w);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            b[i][j] += p->known[i] * w[j];
}

/* Refits on the pairs that agree, until they stay the same. */
static void refine(struct candidate *c, const struct sun_pair *pairs, size_t count)
{
    for (int step = 0; step < 10; step++) {
        struct candidate next = *c;
        double b[3][3] = { { 0.0 } };
        for (size_t i = 0; i < count; i++)
            if (off(c, &pairs[i]) < ALIGN_TRUST_DEGREES)
                add_pair(c->mirrored, &pairs[i], b);
        best_rotation((const double(*)[3])b, next.r);
        find_cost(&next, pairs, count);
        if (!(next.cost < c->cost))
            return;
        *c = next;
    }
}

#define SEEDS 64 /* pairs that are combined by two; of more, as many evenly spaced ones */

static struct candidate fit_all(bool mirrored, const struct sun_pair *pairs, size_t count)
{
    const size_t step = (count + SEEDS - 1) / SEEDS;
    struct candidate best = { .mirrored = mirrored, .cost = HUGE_VAL };

    about_up(0.0, best.r);
    for (size_t i = 0; i < count; i += step) {
        for (size_t j = i + step; j < count; j += step) {
            struct candidate c = { .mirrored = mirrored };
            double b[3][3] = { { 0.0 } };
            if (angle_between(pairs[i].known, pairs[j].known) < 0.5 * ALIGN_SPREAD_DEGREES * DEGREE)
                continue;
            add_pair(mirrored, &pairs[i], b);
            add_pair(mirrored, &pairs[j], b);
            best_rotation((const double(*)[3])b, c.r);
            find_cost(&c, pairs, count);
            if (c.cost < best.cost)
                best = c;
        }
    }
    refine(&best, pairs, count);
    return best;
}

static double azimuth_of(const double w[3])
{
    return atan2(w[0], w[2]);
}

/* About +Y alone: the pair's turn that suits most, then the mean turn of those that agree, each by the squared cosine
 * of its elevation. */
static struct candidate fit_azimuth(const struct sun_pair *pairs, size_t count)
{
    double best = 0.0, least = HUGE_VAL, sum = 0.0, whole = 0.0;
    struct candidate c = { .mirrored = false };
    const size_t step = (count + SEEDS - 1) / SEEDS;

    for (size_t i = 0; i < count; i += step) {
        const double angle = azimuth_of(pairs[i].known) - azimuth_of(pairs[i].seen);
        double cost = 0.0;
        for (size_t k = 0; k < count; k++)
            cost += fmin(ALIGN_TRUST_DEGREES * DEGREE,
                         fabs(remainder(azimuth_of(pairs[k].known) - azimuth_of(pairs[k].seen) - angle, 2.0 * PI)));
        if (cost < least) {
            least = cost;
            best = angle;
        }
    }
    for (size_t k = 0; k < count; k++) {
        const double d = remainder(azimuth_of(pairs[k].known) - azimuth_of(pairs[k].seen) - best, 2.0 * PI);
        const double weight = fmax(1e-12, 1.0 - pairs[k].known[1] * pairs[k].known[1]);
        if (fabs(d) <= ALIGN_TRUST_DEGREES * DEGREE) {
            sum += weight * d;
            whole += weight;
        }
    }
    about_up(best + (whole > 0.0 ? sum / whole : 0.0), c.r);
    find_cost(&c, pairs, count);
    return c;
}

/* ---- What it says ---- */

/* Between the image's vertical and the world's, above 90 if top and bottom are exchanged. */
static double turned_vertical(const struct candidate *c)
{
    return acos(fmax(-1.0, fmin(1.0, c->r[1][1]))) / DEGREE;
}

/* What is left of it when they are exchanged back. */
static double tilt_of(const struct candidate *c)
{
    const double t = turned_vertical(c);
    return fmin(t, 180.0 - t);
}

static bool spread_suffices(const struct sun_pair *pairs, size_t count)
{
    for (size_t i = 1; i < count; i++)
        for (size_t k = 0; k < i; k++)
            if (angle_between(pairs[i].known, pairs[k].known) > ALIGN_SPREAD_DEGREES * DEGREE)
                return true;
    return false;
}

/* A short arc of the sun fits a mirrored rig and a strongly tilted one alike: the one with less tilt is likelier. */
static struct candidate choose(const struct sun_pair *pairs, size_t count)
{
    const double noise = 0.01, less = 30.0; /* square degrees, below which nothing tells; degrees */
    const struct candidate plain = fit_all(false, pairs, count), mirrored = fit_all(true, pairs, count);

    if (plain.cost > 9.0 * mirrored.cost + noise)
        return mirrored;
    return mirrored.cost < 9.0 * plain.cost + noise && tilt_of(&mirrored) + less < tilt_of(&plain) ? mirrored : plain;
}

/* The pairs in use and their residual. */
static void measure(const struct candidate *c, const struct sun_pair *pairs, size_t count, struct alignment *out)
{
    double squares = 0.0, rise = 0.0;

    for (size_t i = 0; i < count; i++) {
        const struct sun_pair *p = &pairs[i];
        double w[3];
        turn(c, p->seen, w);
        const double a = off(c, p), turned = remainder(azimuth_of(p->known) - azimuth_of(w), 2.0 * PI);
        const double wrong = out->kind == ALIGN_ROTATION ? a : fabs(turned) / DEGREE;
        if (wrong > ALIGN_TRUST_DEGREES)
            continue;
        out->used++;
        squares += a * a;
        rise += (asin(fmax(-1.0, fmin(1.0, p->seen[1]))) - asin(fmax(-1.0, fmin(1.0, p->known[1])))) / DEGREE;
    }
    if (out->used) {
        out->residual = sqrt(squares / (double)out->used);
        out->elevation_off = rise / (double)out->used;
    }
}

static void describe(struct alignment *out)
{
    static const char *const rigs[] = { "", ", the camera hangs upside down", ", the image is mirrored left to right",
                                        ", the image is mirrored top to bottom" };

    if (out->kind == ALIGN_NONE)
        snprintf(out->note, sizeof(out->note), "north: %zu of %zu suns agree, too few: nothing was turned", out->used,
                 out->count);
    else if (out->kind == ALIGN_AZIMUTH)
        snprintf(out->note, sizeof(out->note),
                 "north: turned by %.2f degrees clockwise after %zu of %zu suns, whose elevations are %.2f degrees off",
                 out->azimuth, out->used, out->count, out->elevation_off);
    else
        snprintf(out->note, sizeof(out->note),
                 "north: turned by %.2f degrees clockwise with a tilt of %.2f after %zu of %zu suns, residual %.3f "
                 "degrees%s",
                 out->azimuth, out->tilt, out->used, out->count, out->residual, rigs[out->rig]);
}

/* The rotation with its exchange, and its angles. */
static void take(const struct candidate *c, struct alignment *out)
{
    for (int i = 0; i < 3; i++)
        exchanged(c->mirrored, c->r[i], out->r[i]); /* a column changes its sign */
    const bool down = turned_vertical(c) > 90.0;
    out->tilt = tilt_of(c);
    out->rig =
        c->mirrored ? (down ? ALIGN_MIRRORED_BOTTOM : ALIGN_MIRRORED) : (down ? ALIGN_UPSIDE_DOWN : ALIGN_UPRIGHT);
    const double ahead[3] = { c->r[0][2], c->r[1][2], c->r[2][2] }; /* where the image's centre goes */
    out->azimuth = -azimuth_of(ahead) / DEGREE;
}

void align_fit(const struct sun_pair *pairs, size_t count, struct alignment *out)
{
    *out = (struct alignment){ .kind = ALIGN_NONE, .count = count };
    about_up(0.0, out->r);
    if (count) {
        const bool whole = spread_suffices(pairs, count);
        const struct candidate c = whole ? choose(pairs, count) : fit_azimuth(pairs, count);
        out->kind = whole ? ALIGN_ROTATION : ALIGN_AZIMUTH;
        measure(&c, pairs, count, out);
        if (2 * out->used >= count)
            take(&c, out);
        else
            out->kind = ALIGN_NONE;
    }
    describe(out);
}

/* ---- Turning an image ---- */

/* A texel by row and column that may lie one beyond the border: over a pole is the other side of the sphere. */
static const float *texel_at(const float *in, uint32_t width, uint32_t height, long x, long y)
{
    const long w = (long)width, h = (long)height;

    if (y < 0 || y >= h) {
        y = y < 0 ? 0 : h - 1;
        x += w / 2;
    }
    return in + 3 * ((size_t)y * width + (size_t)((x % w + w) % w));
}

static void add_sample(const float *in, uint32_t width, uint32_t height, const double w[3], double weight,
                       double sum[3])
{
    double x, y;

    texel_place(width, height, w, &x, &y);
    const double left = floor(x - 0.5), top = floor(y - 0.5), u = x - 0.5 - left, v = y - 0.5 - top;
    for (int k = 0; k < 4; k++) {
        const float *t = texel_at(in, width, height, (long)left + (k & 1), (long)top + (k >> 1));
        const double share = weight * (k & 1 ? u : 1.0 - u) * (k >> 1 ? v : 1.0 - v);
        for (int c = 0; c < 3; c++)
            sum[c] += share * (double)t[c];
    }
}

void align_apply(const double r[3][3], const float *in, float *out, uint32_t width, uint32_t height)
{
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            double sum[3] = { 0.0 };
            for (int k = 0; k < 4; k++) {
                double w[3], from[3] = { 0.0 };
                texel_direction(width, height, x + 0.25 + 0.5 * (k & 1), y + 0.25 + 0.5 * (k >> 1), w);
                for (int c = 0; c < 3; c++)
                    for (int i = 0; i < 3; i++)
                        from[c] += r[i][c] * w[i]; /* the inverse is the transpose */
                add_sample(in, width, height, from, 0.25, sum);
            }
            for (int c = 0; c < 3; c++)
                out[3 * ((size_t)y * width + x) + (size_t)c] = (float)sum[c];
        }
    }
}
