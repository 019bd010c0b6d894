#include "scene/geometry/view.h"

#include "base/vec.h"

#include <math.h>

/* An image's height spans the field of view. */
static double step_of(const struct camera *c, uint32_t height)
{
    switch (c->projection) {
    case PROJECTION_EQUIDISTANT: return (double)c->fov_y / height;
    case PROJECTION_EQUISOLID: return 4.0 * sin(0.25 * c->fov_y) / height;
    default: return 2.0 * tan(0.5 * c->fov_y) / height;
    }
}

void view_init(struct view *v, const struct camera *c, uint32_t width, uint32_t height)
{
    const struct vec3 ahead = vec3_normalize(vec3_sub(c->look_at, c->position));
    const struct vec3 right = vec3_normalize(vec3_cross(ahead, vec3_normalize(c->up)));
    const struct vec3 up = vec3_cross(right, ahead);
    const double step = step_of(c, height);
    const float a[3] = { ahead.x, ahead.y, ahead.z }, r[3] = { right.x, right.y, right.z };
    const float u[3] = { up.x, up.y, up.z }, o[3] = { c->position.x, c->position.y, c->position.z };

    v->width = width;
    v->height = height;
    v->step = step;
    v->projection = c->projection;
    v->half_angle = 0.5 * c->fov_y;
    for (int i = 0; i < 3; i++) {
        v->origin[i] = o[i];
        v->ahead[i] = a[i];
        v->step_x[i] = step * r[i];
        v->step_y[i] = -step * u[i];
        v->corner[i] = a[i] - 0.5 * width * v->step_x[i] - 0.5 * height * v->step_y[i];
    }
}

/* The angle to the viewing direction at a distance from a fisheye's centre, pixels. Above pi: nothing is there. */
static double fisheye_angle(const struct view *v, double r)
{
    const double at = v->step * r;

    if (v->projection == PROJECTION_EQUIDISTANT)
        return at;
    return at <= 2.0 ? 2.0 * asin(0.5 * at) : 2.0 * PI;
}

static double from_centre(const struct view *v, double x, double y)
{
    const double dx = x - 0.5 * v->width, dy = y - 0.5 * v->height;
    return sqrt(dx * dx + dy * dy);
}

bool view_sees(const struct view *v, double x, double y)
{
    return v->projection == PROJECTION_PERSPECTIVE ||
           fisheye_angle(v, from_centre(v, x, y)) <= fmin(v->half_angle * (1.0 + 1e-12), PI);
}

static struct vec3 fisheye_direction(const struct view *v, double x, double y)
{
    const double dx = x - 0.5 * v->width, dy = y - 0.5 * v->height, r = from_centre(v, x, y);
    const double angle = fisheye_angle(v, r);
    const double across = r > 0.0 && angle <= PI ? sin(angle) / (r * v->step) : 0.0,
                 along = angle <= PI ? cos(angle) : 1.0;
    double d[3];

    for (int i = 0; i < 3; i++)
        d[i] = along * v->ahead[i] + across * (dx * v->step_x[i] + dy * v->step_y[i]);
    return vec3_make((float)d[0], (float)d[1], (float)d[2]);
}

/* The solid angle of a fisheye's pixel, sr, at an angle to the viewing direction. */
static double fisheye_solid_angle(const struct view *v, double angle)
{
    const double squeeze =
        v->projection == PROJECTION_EQUIDISTANT && angle > 1e-6 ? fmax(0.0, sin(angle)) / angle : 1.0;
    return v->step * v->step * squeeze;
}

double view_solid_angle(const struct view *v, struct vec3 w)
{
    const double cosine = v->ahead[0] * w.x + v->ahead[1] * w.y + v->ahead[2] * w.z;

    if (v->projection == PROJECTION_PERSPECTIVE)
        return v->step * v->step * cosine * cosine * cosine;
    return fisheye_solid_angle(v, acos(fmin(1.0, fmax(-1.0, cosine))));
}

struct vec3 view_direction(const struct view *v, double x, double y)
{
    double d[3];

    if (v->projection != PROJECTION_PERSPECTIVE)
        return fisheye_direction(v, x, y);

    for (int i = 0; i < 3; i++)
        d[i] = v->corner[i] + x * v->step_x[i] + y * v->step_y[i];
    const double l = 1.0 / sqrt(dot3(d, d));
    return vec3_make((float)(d[0] * l), (float)(d[1] * l), (float)(d[2] * l));
}

struct vec3 view_right(const struct view *v, double x, double y)
{
    return vec3_normalize(vec3_sub(view_direction(v, x + 0.5, y), view_direction(v, x - 0.5, y)));
}

void view_ray_in_pixel(uint32_t i, uint32_t side, double out[2])
{
    out[0] = (i % side + (side - i / side - 0.5) / side) / side;
    out[1] = (i / side + (i % side + 0.5) / side) / side;
}

bool view_project(const struct view *v, struct vec3 p, struct projection *out)
{
    const double d[3] = { p.x - v->origin[0], p.y - v->origin[1], p.z - v->origin[2] };
    const double distance = sqrt(dot3(d, d)), depth = dot3(d, v->ahead), cosine = depth / distance;
    const double right = dot3(d, v->step_x), down = dot3(d, v->step_y), side = sqrt(right * right + down * down);
    double scale = 1.0 / (depth * v->step * v->step), solid_angle = v->step * v->step * cosine * cosine * cosine;
    bool seen = depth > 0.0;

    if (v->projection != PROJECTION_PERSPECTIVE) {
        const double angle = acos(fmin(1.0, fmax(-1.0, cosine)));
        const double r = v->projection == PROJECTION_EQUIDISTANT ? angle / v->step : 2.0 * sin(0.5 * angle) / v->step;
        scale = side > 0.0 ? r / side : 0.0;
        solid_angle = fmax(fisheye_solid_angle(v, angle), 1e-12);
        seen = distance > 0.0 && angle <= v->half_angle;
    }
    out->x = 0.5 * v->width + scale * right;
    out->y = 0.5 * v->height + scale * down;
    if (!(seen && out->x >= 0.0 && out->x < v->width && out->y >= 0.0 && out->y < v->height))
        return false;
    out->distance = distance;
    out->to_eye = vec3_make((float)(-d[0] / distance), (float)(-d[1] / distance), (float)(-d[2] / distance));
    out->response = 1.0 / (distance * distance * solid_angle);
    return true;
}
