/* A camera's view: from pixels to directions, and from points to pixels. Pixel (0, 0) is at the top left, square; pixel
 * (x, y) spans x..x+1 and y..y+1. A fisheye's image is a circle, as high as the image; a point at distance r pixels
 * from the centre shows the angle t to the viewing direction:
 *     equidistant: t = step r        equisolid: sin(t/2) = step r / 2
 * Immutable after view_init. Thread: any. */
#pragma once

#include "base/err.h"
#include "base/setting.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"

#include <stdbool.h>
#include <stdint.h>

struct view { /* the camera's axes, scaled to one pixel on the plane at distance 1, or by a fisheye's step */
    double origin[3], corner[3], step_x[3], step_y[3];
    double ahead[3]; /* unit */
    double step;     /* m: edge of a pixel on that plane; of a fisheye radians, in the middle */
    uint32_t width, height;
    enum camera_projection projection;
    double half_angle; /* of a fisheye's circle, radians */
};

/* The view of camera c with an image of width x height pixels. */
void view_init(struct view *v, const struct camera *c, uint32_t width, uint32_t height);

/* The unit direction through (x, y) of the image; ahead, where nothing is seen. */
struct vec3 view_direction(const struct view *v, double x, double y);

/* The unit direction in which the image's x grows there. */
struct vec3 view_right(const struct view *v, double x, double y);

/* Whether (x, y) of the image shows anything: not outside a fisheye's circle. */
bool view_sees(const struct view *v, double x, double y);

/* Where ray i of the side^2 of a pixel goes, in pixels from its upper left corner: one to each cell of a grid, to each
 * of side^2 columns and to each of side^2 rows, so that of an upright or level edge half a ray is missed at most. */
void view_ray_in_pixel(uint32_t i, uint32_t side, double out[2]);

/* The solid angle of a pixel in unit direction w, sr. */
double view_solid_angle(const struct view *v, struct vec3 w);

/* The projection of a point. A pixel's value is the mean radiance over its area A on the plane at distance 1, and dA =
 * cos(theta_p) dA_p / (d^2 cos^3(theta_c)): flux Phi that arrives at p and leaves by BRDF f adds Phi f |n.w| response,
 * with n the geometric normal and w the direction to the camera. In general response is 1 / (d^2 W), with the pixel's
 * solid angle W. */
struct projection {
    double x, y;        /* pixels */
    struct vec3 to_eye; /* unit */
    double distance;    /* m */
    double response;    /* 1 / (A d^2 cos^3 theta_c), m^-2 */
};

/* False if p is behind the camera or outside the image. */
bool view_project(const struct view *v, struct vec3 p, struct projection *out);

/* ---- Free views ---- */

/* Free views, in addition to the scene's cameras, as text: "@X,Y,Z;X,Y,Z;DEGREES" gives the position, the target and
 * the vertical field of view. No camera's name begins with "@". Thread: any. */

#define FREE_VIEW_TEXT sizeof(((struct camera *)0)->name)

bool free_view_is(const char *name); /* tests the first character */

/* Parses a free view; the text becomes the camera's name. Up is +Y, or +Z where that is the viewing direction.
 * ERR_USAGE: *why says what is wrong. */
MUST_CHECK enum err free_view_read(const char *text, struct camera *out, struct reason *why);

/* Rounded to a tenth of a millimetre, or six digits; "" if the camera is so far away that it does not fit. */
void free_view_write(const struct camera *c, char out[FREE_VIEW_TEXT]);

/* Cameras' projections by name: "perspective" and so on. */
extern const struct setting_choice projection_choices[];

/* The changes that --position X,Y,Z, --look-at X,Y,Z, --fov DEGREES and --projection make to a camera. */
struct view_change {
    bool has_position, has_look_at;
    double position[3], look_at[3]; /* m, in the coordinates of the scene's file */
    float fov_y;                    /* radians; 0: none */
    bool has_projection;
    enum camera_projection projection; /* a fisheye without fov_y spans 180 degrees */
};

/* position, look_at: NULL: not given; degrees 0: not given. ERR_USAGE names the flag. */
MUST_CHECK enum err view_change_read(const char *position, const char *look_at, double degrees, struct view_change *out,
                                     struct reason *why);
/* Changes a camera of the scene. ERR_USAGE: it would see nothing. */
MUST_CHECK enum err view_change_apply(const struct view_change *change, const struct scene *scene, struct camera *c,
                                      struct reason *why);

/* ---- First hits ---- */

/* The first surface in each pixel, including mirrors and glass, which the G-buffer looks through: position, normal and
 * distance at the pixel's centre, and each mesh's share of the pixel. Shares match the G-buffer's sub-pixel coverage: a
 * pixel with one shading point or escape holds one mesh or none; other pixels get the same edge_rays^2 rays. Immutable.
 * Thread: any number may read. */

#define FIRST_HITS_FAR 1e10f /* depth where nothing is hit */

struct first_part {
    uint32_t mesh;
    float share; /* of the pixel, 0..1 */
};

struct first_hits {
    float *position; /* [height][width][3]: m, world; 0 where nothing is hit, as is `normal` */
    float *normal;   /* [height][width][3]: unit, shading, on the camera's side */
    float *depth;    /* [height][width]: m along the camera's axis */
    struct first_part *parts;
    uint32_t
        *first; /* [width * height + 1]: pixel i owns parts first[i] .. first[i + 1], in descending order of share */
};

/* edge_rays: as in the G-buffer's description; 0: 4. Traces on all OpenMP threads. The caller owns *out. ERR_NOMEM. */
MUST_CHECK enum err first_hits_create(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                                      const struct view *view, uint32_t edge_rays, struct first_hits **out);
void first_hits_destroy(struct first_hits *f); /* NULL is allowed */
