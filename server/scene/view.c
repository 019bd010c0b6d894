#include "scene/view.h"

#include "base/vec.h"

#include <math.h>

void view_init(struct view *v, const struct camera *c, uint32_t width, uint32_t height)
{
    const struct vec3 ahead = vec3_normalize(vec3_sub(c->look_at, c->position));
    const struct vec3 right = vec3_normalize(vec3_cross(ahead, vec3_normalize(c->up)));
    const struct vec3 up = vec3_cross(right, ahead);
    const double step = 2.0 * tan(0.5 * c->fov_y) / height;
    const float a[3] = { ahead.x, ahead.y, ahead.z }, r[3] = { right.x, right.y, right.z };
    const float u[3] = { up.x, up.y, up.z }, o[3] = { c->position.x, c->position.y, c->position.z };

    v->width = width;
    v->height = height;
    v->step = step;
    for (int i = 0; i < 3; i++) {
        v->origin[i] = o[i];
        v->ahead[i] = a[i];
        v->step_x[i] = step * r[i];
        v->step_y[i] = -step * u[i];
        v->corner[i] = a[i] - 0.5 * width * v->step_x[i] - 0.5 * height * v->step_y[i];
    }
}

struct vec3 view_direction(const struct view *v, double x, double y)
{
    double d[3];

    for (int i = 0; i < 3; i++)
        d[i] = v->corner[i] + x * v->step_x[i] + y * v->step_y[i];
    const double l = 1.0 / sqrt(dot3(d, d));
    return vec3_make((float)(d[0] * l), (float)(d[1] * l), (float)(d[2] * l));
}

bool view_project(const struct view *v, struct vec3 p, struct projection *out)
{
    const double d[3] = { p.x - v->origin[0], p.y - v->origin[1], p.z - v->origin[2] };
    const double depth = dot3(d, v->ahead), area = v->step * v->step;

    if (!(depth > 0.0))
        return false;
    out->x = 0.5 * v->width + dot3(d, v->step_x) / (depth * area);
    out->y = 0.5 * v->height + dot3(d, v->step_y) / (depth * area);
    if (!(out->x >= 0.0 && out->x < v->width && out->y >= 0.0 && out->y < v->height))
        return false;
    out->distance = sqrt(dot3(d, d));
    const double l = -1.0 / out->distance, cosine = depth / out->distance;
    out->to_eye = vec3_make((float)(d[0] * l), (float)(d[1] * l), (float)(d[2] * l));
    out->response = 1.0 / (area * out->distance * out->distance * cosine * cosine * cosine);
    return true;
}
