/* The layouts once more, the other way round (from a point of an image to its direction) and written from their
 * description alone, so that the server's own can be held against them. Used by the tests of env and by the program
 * that makes images of each layout for the integration tests. */
#pragma once

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* The way a viewer inside the cube looks, and what is above in what is seen; right of it is forward x up. */
struct view {
    int column, row;
    int forward[3], up[3];
};

static const struct view views_cube[6] = {
    { 0, 0, { 1, 0, 0 }, { 0, 1, 0 } },   { 0, 1, { -1, 0, 0 }, { 0, 1, 0 } }, { 0, 2, { 0, 1, 0 }, { 0, 0, 1 } },
    { 0, 3, { 0, -1, 0 }, { 0, 0, -1 } }, { 0, 4, { 0, 0, 1 }, { 0, 1, 0 } },  { 0, 5, { 0, 0, -1 }, { 0, 1, 0 } },
};
static const struct view views_hcross[6] = {
    { 0, 1, { 1, 0, 0 }, { 0, 1, 0 } },  { 1, 1, { 0, 0, 1 }, { 0, 1, 0 } },  { 2, 1, { -1, 0, 0 }, { 0, 1, 0 } },
    { 3, 1, { 0, 0, -1 }, { 0, 1, 0 } }, { 1, 0, { 0, 1, 0 }, { 0, 0, -1 } }, { 1, 2, { 0, -1, 0 }, { 0, 0, 1 } },
};
static const struct view views_vcross[6] = {
    { 0, 1, { 1, 0, 0 }, { 0, 1, 0 } },   { 1, 1, { 0, 0, 1 }, { 0, 1, 0 } },  { 2, 1, { -1, 0, 0 }, { 0, 1, 0 } },
    { 1, 3, { 0, 0, -1 }, { 0, -1, 0 } }, { 1, 0, { 0, 1, 0 }, { 0, 0, -1 } }, { 1, 2, { 0, -1, 0 }, { 0, 0, 1 } },
};

static const struct view views_3x2[6] = {
    { 0, 0, { -1, 0, 0 }, { 0, 1, 0 } }, { 1, 0, { 1, 0, 0 }, { 0, 1, 0 } }, { 2, 0, { 0, 1, 0 }, { 0, 0, -1 } },
    { 0, 1, { 0, -1, 0 }, { 0, 0, 1 } }, { 1, 1, { 0, 0, 1 }, { 0, 1, 0 } }, { 2, 1, { 0, 0, -1 }, { 0, 1, 0 } },
};
static const struct view views_6x1[6] = {
    { 0, 0, { -1, 0, 0 }, { 0, 1, 0 } }, { 1, 0, { 1, 0, 0 }, { 0, 1, 0 } }, { 2, 0, { 0, 1, 0 }, { 0, 0, -1 } },
    { 3, 0, { 0, -1, 0 }, { 0, 0, 1 } }, { 4, 0, { 0, 0, 1 }, { 0, 1, 0 } }, { 5, 0, { 0, 0, -1 }, { 0, 1, 0 } },
};

static inline bool view_direction(const struct view *views, double size, double x, double y, double w[3])
{
    for (int k = 0; k < 6; k++) {
        const struct view *v = &views[k];
        const double s = 2.0 * (x / size - v->column) - 1.0, t = 2.0 * (y / size - v->row) - 1.0;
        if (fabs(s) > 1.0 || fabs(t) > 1.0)
            continue;
        for (int c = 0; c < 3; c++) {
            const int a = (c + 1) % 3, b = (c + 2) % 3;
            w[c] = v->forward[c] + s * (v->forward[a] * v->up[b] - v->forward[b] * v->up[a]) - t * v->up[c];
        }
        return true;
    }
    return false;
}

/* The unit direction that an image of `layout` shows at (x, y), in texels from the top left; false where it shows
 * none. */
static inline bool test_direction(const char *layout, double width, double height, double x, double y, double w[3])
{
    const double pi = 3.14159265358979323846, side = width < height ? width : height;
    const double dx = (2.0 * x - width) / side, dy = (2.0 * y - height) / side, r = sqrt(dx * dx + dy * dy);
    bool shown = true;

    if (strcmp(layout, "cube") == 0) {
        shown = view_direction(views_cube, width, x, y, w);
    } else if (strcmp(layout, "hcross") == 0) {
        shown = view_direction(views_hcross, width / 4.0, x, y, w);
    } else if (strcmp(layout, "vcross") == 0) {
        shown = view_direction(views_vcross, width / 3.0, x, y, w);
    } else if (strcmp(layout, "cube-3x2") == 0) {
        shown = view_direction(views_3x2, width / 3.0, x, y, w);
    } else if (strcmp(layout, "cube-6x1") == 0) {
        shown = view_direction(views_6x1, width / 6.0, x, y, w);
    } else if (strcmp(layout, "ball") == 0) {
        /* A ray along -Z is thrown back by the normal (dx, -dy, nz). */
        const double nz = sqrt(fmax(0.0, 1.0 - r * r));
        w[0] = 2.0 * nz * dx;
        w[1] = -2.0 * nz * dy;
        w[2] = nz * nz - r * r;
        shown = r < 1.0;
    } else if (strcmp(layout, "fisheye") == 0) {
        const double theta = 0.5 * pi * r, turn = atan2(dy, dx);
        w[0] = sin(theta) * cos(turn);
        w[1] = cos(theta);
        w[2] = -sin(theta) * sin(turn);
        shown = r < 1.0;
    } else {
        const double v = strcmp(layout, "latlong-bottom") == 0 ? 1.0 - y / height : y / height;
        const double phi = pi - 2.0 * pi * x / width, theta = pi * v;
        w[0] = sin(theta) * sin(phi);
        w[1] = cos(theta);
        w[2] = sin(theta) * cos(phi);
    }
    const double length = shown ? sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) : 1.0;
    for (int c = 0; c < 3; c++)
        w[c] /= length;
    return shown;
}
