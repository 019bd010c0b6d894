#include "sky/tables/layout.h"

#include "base/vec.h"

#define STEP 0.125 /* maximum distance between two groups of nodes, in radii */

/* In the order of cube.h: +X, -X, +Y, -Y, +Z, -Z. */
static const struct layout_face cube[CUBE_FACES] = {
    { 0, 0, 3, -2 }, { 0, 1, -3, -2 }, { 0, 2, 1, -3 }, { 0, 3, 1, 3 }, { 0, 4, -1, -2 }, { 0, 5, 1, -2 },
};
static const struct layout_face hcross[CUBE_FACES] = {
    { 0, 1, 3, -2 }, { 2, 1, -3, -2 }, { 1, 0, -1, 3 }, { 1, 2, -1, -3 }, { 1, 1, -1, -2 }, { 3, 1, 1, -2 },
};
static const struct layout_face vcross[CUBE_FACES] = {
    { 0, 1, 3, -2 }, { 2, 1, -3, -2 }, { 1, 0, -1, 3 }, { 1, 2, -1, -3 }, { 1, 1, -1, -2 }, { 1, 3, -1, 2 },
};
/* Video: the faces right (-X), left (+X), up, down, front (+Z) and back, with the cross's orientations. */
static const struct layout_face cube_3x2[CUBE_FACES] = {
    { 1, 0, 3, -2 }, { 0, 0, -3, -2 }, { 2, 0, -1, 3 }, { 0, 1, -1, -3 }, { 1, 1, -1, -2 }, { 2, 1, 1, -2 },
};
static const struct layout_face cube_6x1[CUBE_FACES] = {
    { 1, 0, 3, -2 }, { 0, 0, -3, -2 }, { 2, 0, -1, 3 }, { 3, 0, -1, -3 }, { 4, 0, -1, -2 }, { 5, 0, 1, -2 },
};

/* The layouts of cube faces, and their cells. */
static const struct {
    const struct layout_face *faces;
    uint32_t columns, rows;
} unfolded[LAYOUT_LAST + 1] = {
    [LAYOUT_CUBE] = { cube, 1, 6 },         [LAYOUT_HCROSS] = { hcross, 4, 3 },     [LAYOUT_VCROSS] = { vcross, 3, 4 },
    [LAYOUT_CUBE_3X2] = { cube_3x2, 3, 2 }, [LAYOUT_CUBE_6X1] = { cube_6x1, 6, 1 },
};

const struct layout_face *layout_faces(enum layout layout)
{
    return unfolded[layout].faces;
}

static void count_cells(enum layout layout, uint32_t *columns, uint32_t *rows)
{
    *columns = unfolded[layout].columns;
    *rows = unfolded[layout].rows;
}

uint32_t layout_face_size(enum layout layout, uint32_t width)
{
    uint32_t columns, rows;

    count_cells(layout, &columns, &rows);
    return columns ? width / columns : width;
}

bool layout_is_disc(enum layout layout)
{
    return layout == LAYOUT_BALL || layout == LAYOUT_FISHEYE;
}

enum err layout_fits(enum layout layout, uint32_t width, uint32_t height, const char *name, struct reason *why)
{
    uint32_t columns, rows;

    if (layout_is_disc(layout) && (width < LAYOUT_DISC_MIN || height < LAYOUT_DISC_MIN))
        return err_say(why, ERR_UNSUPPORTED, "%s: %ux%u is too small for a %s, which needs at least %dx%d", name, width,
                       height, layout_name(layout), LAYOUT_DISC_MIN, LAYOUT_DISC_MIN);
    if (!layout_faces(layout))
        return ERR_OK;
    count_cells(layout, &columns, &rows);
    if (width % columns == 0 && height % rows == 0 && width / columns == height / rows)
        return ERR_OK;
    return err_say(why, ERR_UNSUPPORTED, "%s: %ux%u does not fit the layout %s, which has %u x %u square faces", name,
                   width, height, layout_name(layout), columns, rows);
}

enum err layout_guess(uint32_t width, uint32_t height, const char *name, enum layout *out, struct reason *why)
{
    static const enum layout of_faces[] = { LAYOUT_CUBE, LAYOUT_HCROSS, LAYOUT_VCROSS, LAYOUT_CUBE_6X1 };
    const char *fits = "latlong, ball or fisheye (with a centred circle)";

    *out = width == 2 * height ? LAYOUT_LATLONG : LAYOUT_AUTO;
    if (*out != LAYOUT_AUTO)
        return ERR_OK;
    if (width == height)
        fits = "ball or fisheye";
    if (2 * width == 3 * height) /* also the shape of many cameras' images */
        fits = "cube-3x2, ball or fisheye (with a centred circle)";
    for (size_t k = 0; k < sizeof(of_faces) / sizeof(of_faces[0]); k++)
        if (layout_fits(of_faces[k], width, height, name, NULL) == ERR_OK)
            fits = layout_name(of_faces[k]);
    return err_say(why, ERR_UNSUPPORTED, "%s: %ux%u is not 2:1, so the layout is ambiguous: specify --layout %s", name,
                   width, height, fits);
}

static double component(const double w[3], int axis)
{
    return axis > 0 ? w[axis - 1] : -w[-axis - 1];
}

static void find_on_cube(const struct layout_face *faces, uint32_t size, const double w[3], struct layout_place *out)
{
    const double x = fabs(w[0]), y = fabs(w[1]), z = fabs(w[2]);
    const int a = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    const struct layout_face *f = &faces[2 * a + (w[a] < 0.0)];
    const double scale = 1.0 / fabs(w[a]);

    out->low[0] = (uint32_t)f->column * size;
    out->low[1] = (uint32_t)f->row * size;
    for (int k = 0; k < 2; k++)
        out->high[k] = out->low[k] + size;
    out->x = out->low[0] + 0.5 * (1.0 + scale * component(w, f->right)) * size;
    out->y = out->low[1] + 0.5 * (1.0 + scale * component(w, f->down)) * size;
}

/* Distance from the centre, in radii, at angle theta from the direction shown at the centre. */
static bool find_on_disc(enum layout layout, const double w[3], double *x, double *y)
{
    const bool ball = layout == LAYOUT_BALL;
    const double right = w[0], down = ball ? -w[1] : -w[2], axis = ball ? w[2] : w[1];
    const double across = sqrt(right * right + down * down), theta = atan2(across, axis);
    const double r = ball ? sin(0.5 * theta) : theta / (0.5 * PI);

    *x = across > 0.0 ? r * right / across : r;
    *y = across > 0.0 ? r * down / across : 0.0;
    return ball || axis > 0.0;
}

bool layout_find(enum layout layout, uint32_t width, uint32_t height, const double w[3], struct layout_place *out)
{
    const uint32_t side = width < height ? width : height;
    double x, y;

    *out = (struct layout_place){ .high = { width, height } };
    if (layout_faces(layout)) {
        find_on_cube(layout_faces(layout), layout_face_size(layout, width), w, out);
        return true;
    }
    if (layout_is_disc(layout)) {
        const bool shown = find_on_disc(layout, w, &x, &y);
        out->x = 0.5 * (width + side * x);
        out->y = 0.5 * (height + side * y);
        return shown;
    }
    const double phi = atan2(w[0], w[2]), theta = atan2(sqrt(w[0] * w[0] + w[2] * w[2]), w[1]);
    out->x = (PI - phi) / (2.0 * PI) * width;
    out->y = (layout == LAYOUT_LATLONG_BOTTOM_FIRST ? 1.0 - theta / PI : theta / PI) * height;
    out->wraps = true;
    return true;
}

/* A ball's normal n bisects the direction and the one to the camera: w = 2 (n.z) n - z. */
void layout_disc_direction(enum layout layout, double x, double y, double w[3])
{
    double r2 = x * x + y * y;

    if (r2 > 1.0 - 1e-13) { /* the rim, within rounding */
        x /= sqrt(r2);
        y /= sqrt(r2);
        r2 = 1.0;
    }
    if (layout == LAYOUT_BALL) {
        const double nz = sqrt(1.0 - r2);
        w[0] = 2.0 * nz * x;
        w[1] = -2.0 * nz * y;
        w[2] = 2.0 * nz * nz - 1.0;
    } else {
        const double r = sqrt(r2), scale = r > 0.0 ? sin(0.5 * PI * r) / r : 0.0;
        w[0] = scale * x;
        w[1] = r2 < 1.0 ? cos(0.5 * PI * r) : 0.0;
        w[2] = -scale * y;
    }
}

int layout_disc_border(const double low[2], const double high[2], double pieces[4][2][2])
{
    const double corner[4][2] = { { low[0], low[1] }, { high[0], low[1] }, { high[0], high[1] }, { low[0], high[1] } };
    int count = 0;

    for (int k = 0; k < 4; k++) {
        const double *from = corner[k], *to = corner[(k + 1) % 4];
        const int along = k & 1;
        const double fixed = from[1 - along], reach = sqrt(fmax(0.0, 1.0 - fixed * fixed));
        const double a = fmin(reach, fmax(-reach, from[along])), b = fmin(reach, fmax(-reach, to[along]));
        if (fabs(fixed) >= 1.0 || a == b)
            continue;
        pieces[count][0][along] = a;
        pieces[count][1][along] = b;
        pieces[count][0][1 - along] = pieces[count][1][1 - along] = fixed;
        count++;
    }
    return count;
}

/* (1 - cos theta) / r^2, which is smooth at the centre. */
static double cap_per_r2(enum layout layout, double r2)
{
    if (layout == LAYOUT_BALL)
        return 2.0;
    const double s = sin(0.25 * PI * sqrt(r2));
    return r2 > 1e-12 ? 2.0 * s * s / r2 : PI * PI / 8.0;
}

/* Solid angle is the integral of (1 - cos theta) dphi along the border. On a straight piece with one coordinate equal
 * to c, dphi is c / r^2 times the step (three-node Gauss-Legendre quadrature); on the circle it is the angle. */
static double disc_solid_angle(enum layout layout, const double low[2], const double high[2])
{
    static const double node[3] = { -0.77459666924148338, 0.0, 0.77459666924148338 };
    static const double weight[3] = { 5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0 };
    double pieces[4][2][2], sum = 0.0;
    const int count = layout_disc_border(low, high, pieces);

    for (int k = 0; k < count; k++) {
        const double(*p)[2] = (const double(*)[2])pieces[k], *next = pieces[(k + 1) % count][0];
        const int along = p[0][0] == p[1][0];
        const double length = p[1][along] - p[0][along], c = p[0][1 - along] * (along == 0 ? -1.0 : 1.0);
        const int parts = 1 + (int)(fabs(length) / STEP);
        for (int q = 0; q < 3 * parts; q++) {
            const double t = p[0][along] + length * ((q / 3) + 0.5 + 0.5 * node[q % 3]) / parts;
            sum += weight[q % 3] / parts * length * c * cap_per_r2(layout, t * t + c * c);
        }
        const double cross = p[1][0] * next[1] - p[1][1] * next[0], dot = p[1][0] * next[0] + p[1][1] * next[1];
        if (p[1][0] != next[0] || p[1][1] != next[1])
            sum += cap_per_r2(layout, 1.0) * atan2(cross, dot);
    }
    return sum;
}

static double cube_part(enum layout layout, uint32_t width, const double low[2], const double high[2])
{
    const struct layout_face *faces = layout_faces(layout);
    const uint32_t size = layout_face_size(layout, width);
    const int column = (int)((0.5 * (low[0] + high[0])) / size), row = (int)((0.5 * (low[1] + high[1])) / size);

    for (int f = 0; f < CUBE_FACES; f++)
        if (faces[f].column == column && faces[f].row == row) {
            const double scale = 2.0 / size, u = -1.0 - 2.0 * column, v = -1.0 - 2.0 * row;
            return cube_solid_angle(u + scale * low[0], v + scale * low[1], u + scale * high[0], v + scale * high[1]);
        }
    return 0.0;
}

double layout_solid_angle(enum layout layout, uint32_t width, uint32_t height, const double low[2],
                          const double high[2])
{
    if (layout_faces(layout))
        return cube_part(layout, width, low, high);
    if (layout_is_disc(layout)) {
        const double size[2] = { width, height }, side = fmin(width, height);
        double a[2], b[2];
        for (int k = 0; k < 2; k++) {
            a[k] = (2.0 * low[k] - size[k]) / side;
            b[k] = (2.0 * high[k] - size[k]) / side;
        }
        return disc_solid_angle(layout, a, b);
    }
    /* cos a - cos b as a product, which is accurate for thin rows. */
    return 4.0 * PI / width * (high[0] - low[0]) * sin(0.5 * PI / height * (low[1] + high[1])) *
           sin(0.5 * PI / height * (high[1] - low[1]));
}

double layout_shown(enum layout layout)
{
    return layout == LAYOUT_FISHEYE ? 2.0 * PI : 4.0 * PI;
}

double layout_shown_of_face(enum layout layout, uint32_t face, double u0, double v0, double u1, double v1)
{
    if (layout == LAYOUT_FISHEYE) {
        if (face == 3)
            return 0.0;
        if (face < 2)
            u0 = fmin(u1, fmax(0.0, u0));
        else if (face >= 4)
            v0 = fmin(v1, fmax(0.0, v0));
    }
    return cube_solid_angle(u0, v0, u1, v1);
}
