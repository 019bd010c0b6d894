#include "light/estimators/light_tracer.h"

#include <assert.h>
#include <math.h>
#include <string.h>

/* The scene's bounds are enlarged by this share of their largest coordinate: about 16 times the rounding error of a
 * start position in float. */
#define BOUNDS_MARGIN 1e-6

/* The parameters where line p + t along enters and leaves a box. False if it misses. */
static bool cross_box(const double low[3], const double high[3], const double p[3], const double along[3],
                      double *enter)
{
    double first = -INFINITY, last = INFINITY;

    for (int i = 0; i < 3; i++) {
        if (along[i] == 0.0) {
            if (p[i] < low[i] || p[i] > high[i])
                return false;
            continue;
        }
        const double a = (low[i] - p[i]) / along[i], b = (high[i] - p[i]) / along[i];
        first = fmax(first, fmin(a, b));
        last = fmin(last, fmax(a, b));
    }
    *enter = first;
    return first <= last;
}

static double shape_faces(struct start_shape *s, const double along[3])
{
    for (int a = 0; a < 3; a++)
        s->face[a] = 4.0 * s->half[(a + 1) % 3] * s->half[(a + 2) % 3] * fabs(along[a]);
    return s->face[0] + s->face[1] + s->face[2];
}

/* A minimum-area rectangle around a convex polygon has a side along one of its edges [Freeman and Shapira 1975]; the
 * edges of a projected box are its projected axes, so there are three candidates. */
static double shape_quad(struct start_shape *s, const double along[3])
{
    double least = INFINITY;

    for (int axis = 0; axis < 3; axis++) {
        double side[2][3], reach[2] = { 0.0, 0.0 };
        const double length = sqrt(fmax(0.0, 1.0 - along[axis] * along[axis]));
        if (length < 1e-6) /* seen end-on: the other two cover it */
            continue;
        for (int i = 0; i < 3; i++)
            side[0][i] = ((i == axis) - along[axis] * along[i]) / length;
        for (int i = 0; i < 3; i++) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            side[1][i] = along[j] * side[0][k] - along[k] * side[0][j];
        }
        for (int i = 0; i < 3; i++) {
            reach[0] += fabs(side[0][i]) * s->half[i];
            reach[1] += fabs(side[1][i]) * s->half[i];
        }
        if (4.0 * reach[0] * reach[1] < least) {
            least = 4.0 * reach[0] * reach[1];
            memcpy(s->side, side, sizeof(side));
            memcpy(s->reach, reach, sizeof(reach));
        }
    }
    return least;
}

static double shape_disc(struct start_shape *s)
{
    s->reach[0] = sqrt(dot3(s->half, s->half));
    return PI * s->reach[0] * s->reach[0];
}

static double shape_init(struct start_shape *s, enum start_kind kind, const struct box *b, const double along[3])
{
    const float low[3] = { b->low.x, b->low.y, b->low.z }, high[3] = { b->high.x, b->high.y, b->high.z };

    memset(s, 0, sizeof(*s));
    for (int i = 0; i < 3; i++) {
        s->centre[i] = 0.5 * ((double)low[i] + high[i]);
        s->half[i] = 0.5 * ((double)high[i] - low[i]);
    }
    return kind == START_FACES ? shape_faces(s, along) : kind == START_QUAD ? shape_quad(s, along) : shape_disc(s);
}

void start_init(struct start *s, enum start_kind kind, const struct box *boxes, uint32_t count,
                const struct box *bounds, struct vec3 along)
{
    const double length = sqrt((double)along.x * along.x + (double)along.y * along.y + (double)along.z * along.z);
    const double low[3] = { bounds->low.x, bounds->low.y, bounds->low.z };
    const double high[3] = { bounds->high.x, bounds->high.y, bounds->high.z };
    double margin = 0.0;

    assert(count >= 1 && count <= START_BOXES_MAX);
    s->kind = kind;
    s->along[0] = along.x / length;
    s->along[1] = along.y / length;
    s->along[2] = along.z / length;
    for (int i = 0; i < 3; i++)
        margin = fmax(margin, BOUNDS_MARGIN * fmax(fabs(low[i]), fabs(high[i])));
    for (int i = 0; i < 3; i++) {
        s->low[i] = low[i] - margin;
        s->high[i] = high[i] + margin;
    }
    s->area = 0.0;
    s->count = count;
    for (uint32_t k = 0; k < count; k++) {
        s->areas[k] = shape_init(&s->shapes[k], kind, &boxes[k], s->along);
        s->area += s->areas[k];
    }
}

static bool crosses(const struct start *s, const struct start_shape *k, const double p[3])
{
    double d[3], low[3], high[3], enter;

    for (int i = 0; i < 3; i++)
        d[i] = p[i] - k->centre[i];
    if (s->kind == START_QUAD)
        return fabs(dot3(d, k->side[0])) <= k->reach[0] && fabs(dot3(d, k->side[1])) <= k->reach[1];
    if (s->kind == START_DISC) {
        const double along = dot3(d, s->along);
        return dot3(d, d) - along * along <= k->reach[0] * k->reach[0];
    }
    for (int i = 0; i < 3; i++) {
        low[i] = -k->half[i];
        high[i] = k->half[i];
    }
    return cross_box(low, high, d, s->along, &enter);
}

/* Selects one of several adjacent intervals by *at, and rescales *at to 0..1 within it. */
static uint32_t pick(const double *length, uint32_t count, double *at)
{
    uint32_t last = 0;

    for (uint32_t i = 0; i < count; i++) {
        const double l = length[i];
        if (!(l > 0.0))
            continue;
        last = i;
        if (*at < l) {
            *at /= l;
            return i;
        }
        *at -= l;
    }
    *at = 1.0; /* rounding: the end of the last nonempty one */
    return last;
}

static void place_on(const struct start *s, const struct start_shape *k, double x, double y, double p[3])
{
    memcpy(p, k->centre, 3 * sizeof(p[0]));
    if (s->kind == START_QUAD) {
        for (int i = 0; i < 3; i++)
            p[i] += (2.0 * x - 1.0) * k->reach[0] * k->side[0][i] + (2.0 * y - 1.0) * k->reach[1] * k->side[1][i];
        return;
    }
    if (s->kind == START_DISC) {
        const double r = k->reach[0] * sqrt(x), phi = 2.0 * PI * y;
        /* two unit vectors perpendicular to the direction [Duff et al. 2017, listing 3] */
        const double *n = s->along, sign = copysign(1.0, n[2]), a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
        const double t[3] = { 1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0] };
        const double u[3] = { b, sign + n[1] * n[1] * a, -n[1] };
        for (int i = 0; i < 3; i++)
            p[i] += r * (cos(phi) * t[i] + sin(phi) * u[i]);
        return;
    }
    double at = x * (k->face[0] + k->face[1] + k->face[2]);
    const uint32_t a = pick(k->face, 3, &at);
    p[a] += s->along[a] > 0.0 ? -k->half[a] : k->half[a]; /* the side that light reaches first */
    p[(a + 1) % 3] += (2.0 * at - 1.0) * k->half[(a + 1) % 3];
    p[(a + 2) % 3] += (2.0 * y - 1.0) * k->half[(a + 2) % 3];
}

bool start_sample(const struct start *s, const double x[2], struct vec3 *origin, double *density)
{
    double at = x[0] * s->area, p[3], enter;

    *density = 0.0;
    if (!(s->area > 0.0))
        return false;
    const uint32_t chosen = pick(s->areas, s->count, &at);
    place_on(s, &s->shapes[chosen], at, x[1], p);
    /* the selected shape is crossed, regardless of rounding at its border */
    uint32_t count = 1;
    for (uint32_t k = 0; k < s->count; k++)
        count += k != chosen && s->areas[k] > 0.0 && crosses(s, &s->shapes[k], p);
    *density = count / s->area;
    if (!cross_box(s->low, s->high, p, s->along, &enter))
        return false;
    *origin = vec3_make((float)(p[0] + enter * s->along[0]), (float)(p[1] + enter * s->along[1]),
                        (float)(p[2] + enter * s->along[2]));
    return true;
}

static struct box joined(const struct box *a, const struct box *b)
{
    return (struct box){
        vec3_make(fminf(a->low.x, b->low.x), fminf(a->low.y, b->low.y), fminf(a->low.z, b->low.z)),
        vec3_make(fmaxf(a->high.x, b->high.x), fmaxf(a->high.y, b->high.y), fmaxf(a->high.z, b->high.z)),
    };
}

/* Half the surface area: the mean projected area over all directions is half of it [Cauchy 1841]. */
static double surface(const struct box *b)
{
    const double x = (double)b->high.x - b->low.x, y = (double)b->high.y - b->low.y, z = (double)b->high.z - b->low.z;
    return x * y + y * z + z * x;
}

/* Joins the pair of count > 1 boxes that costs least; the last box moves to the freed place. */
static void join_cheapest(struct box *boxes, uint32_t count)
{
    uint32_t first = 0, second = 1;
    double least = INFINITY;

    for (uint32_t i = 0; i < count; i++)
        for (uint32_t j = i + 1; j < count; j++) {
            const struct box both = joined(&boxes[i], &boxes[j]);
            const double more = surface(&both) - surface(&boxes[i]) - surface(&boxes[j]);
            if (more < least) {
                least = more;
                first = i;
                second = j;
            }
        }
    boxes[first] = joined(&boxes[first], &boxes[second]);
    boxes[second] = boxes[count - 1];
}

uint32_t start_join(struct box *boxes, size_t count)
{
    if (count <= START_BOXES_MAX)
        return (uint32_t)count;
    for (size_t k = START_BOXES_MAX; k < count; k++) {
        const struct box next = boxes[k];
        boxes[START_BOXES_MAX] = next; /* in place: that box was already read */
        join_cheapest(boxes, START_BOXES_MAX + 1);
    }
    return START_BOXES_MAX;
}
