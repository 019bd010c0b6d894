#include "scene/geometry/view.h"

#include "base/vec.h"
#include "scene/geometry/scene_build.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FAR 1e6         /* m, of a coordinate of a free view */
#define FAR_OF_FLAG 1e9 /* likewise of a flag, in the coordinates of a file */
#define NARROW 1.0      /* degrees: what a plane can show */
#define WIDE 170.0

/* Parses three numbers separated by commas, up to `end`. Returns the position after them, or NULL if they are
 * malformed or above `most`. */
static const char *read_point(const char *text, char end, double most, double out[3])
{
    for (int i = 0; i < 3; i++) {
        char *rest;
        out[i] = strtod(text, &rest);
        if (rest == text || !(fabs(out[i]) <= most) || *rest != (i < 2 ? ',' : end))
            return NULL;
        text = rest + (*rest != '\0');
    }
    return text;
}

static struct vec3 point_from(const double p[3], const double origin[3])
{
    return vec3_make((float)(p[0] - origin[0]), (float)(p[1] - origin[1]), (float)(p[2] - origin[2]));
}

const struct setting_choice projection_choices[] = {
    { "perspective", PROJECTION_PERSPECTIVE, "rectilinear, as an ordinary lens shows it", 0 },
    { "equidistant", PROJECTION_EQUIDISTANT, "fisheye: distance from the centre is proportional to the angle", 0 },
    { "equisolid", PROJECTION_EQUISOLID, "fisheye: equal areas show equal solid angles", 0 },
    { NULL, 0, NULL, 0 },
};

/* Parses ";equidistant" or ";equisolid" after the degrees. False: the text is something else. */
static bool read_projection(const char *text, enum camera_projection *out)
{
    *out = PROJECTION_PERSPECTIVE;
    for (int k = 1; *text && projection_choices[k].name; k++)
        if (text[0] == ';' && strcmp(text + 1, projection_choices[k].name) == 0)
            *out = (enum camera_projection)projection_choices[k].value;
    return !*text || *out != PROJECTION_PERSPECTIVE;
}

static enum err complete(struct camera *c, struct reason *why)
{
    const struct vec3 ahead = vec3_sub(c->look_at, c->position);
    struct reason what;

    if (!(vec3_length(ahead) > 1e-4f))
        return err_say(why, ERR_USAGE, "the camera's position is the point that it looks at");
    if (!(vec3_length(vec3_cross(vec3_normalize(ahead), vec3_normalize(c->up))) > 1e-3f))
        c->up = fabsf(ahead.z) > fabsf(ahead.y) ? vec3_make(0.0f, 1.0f, 0.0f) : vec3_make(0.0f, 0.0f, 1.0f);
    return camera_check(c, "the camera", &what) ? err_say(why, ERR_USAGE, "%s", what.text) : ERR_OK;
}

bool free_view_is(const char *name)
{
    return name[0] == '@';
}

enum err free_view_read(const char *text, struct camera *out, struct reason *why)
{
    static const double here[3] = { 0.0 };
    struct camera c = { .up = { 0.0f, 1.0f, 0.0f } };
    double position[3] = { 0.0 }, look_at[3] = { 0.0 };
    char *end = NULL;

    const char *at = read_point(text + 1, ';', FAR, position);
    at = at ? read_point(at, ';', FAR, look_at) : NULL;
    c.position = point_from(position, here);
    c.look_at = point_from(look_at, here);
    const double degrees = at ? strtod(at, &end) : 0.0;
    const bool known = at && end != at && read_projection(end, &c.projection);
    const double most = known && c.projection != PROJECTION_PERSPECTIVE ? 360.0 : WIDE;
    if (!known || !(degrees >= NARROW && degrees <= most) || strlen(text) >= sizeof(c.name))
        return err_say(
            why, ERR_USAGE,
            "'%.80s' is not a view such as @4,2,4;0,1,0;40: position, point looked at (m, within %g) and field of "
            "view (%g to %g degrees)",
            text, FAR, NARROW, WIDE);
    c.fov_y = (float)(degrees * (PI / 180.0));
    snprintf(c.name, sizeof(c.name), "%s", text);
    const enum err e = complete(&c, why);
    if (!e)
        *out = c;
    return e;
}

static double rounded(float x)
{
    return round((double)x * 1e4) / 1e4 + 0.0; /* no -0 */
}

void free_view_write(const struct camera *c, char out[FREE_VIEW_TEXT])
{
    char text[256];

    snprintf(text, sizeof(text), "@%.6g,%.6g,%.6g;%.6g,%.6g,%.6g;%.4g", rounded(c->position.x), rounded(c->position.y),
             rounded(c->position.z), rounded(c->look_at.x), rounded(c->look_at.y), rounded(c->look_at.z),
             (double)c->fov_y * 180.0 / PI);
    if (c->projection != PROJECTION_PERSPECTIVE)
        snprintf(text + strlen(text), sizeof(text) - strlen(text), ";%s", projection_choices[c->projection].name);
    const size_t size = strlen(text) + 1;
    out[0] = '\0';
    if (size <= FREE_VIEW_TEXT)
        memcpy(out, text, size);
}

enum err view_change_read(const char *position, const char *look_at, double degrees, struct view_change *out,
                          struct reason *why)
{
    static const char wants[] = "three numbers in metres with commas, such as 4,2,-1.5";

    *out = (struct view_change){ .has_position = position, .has_look_at = look_at };
    if (position && !read_point(position, '\0', FAR_OF_FLAG, out->position))
        return err_say(why, ERR_USAGE, "--position %s: expected %s", position, wants);
    if (look_at && !read_point(look_at, '\0', FAR_OF_FLAG, out->look_at))
        return err_say(why, ERR_USAGE, "--look-at %s: expected %s", look_at, wants);
    out->fov_y = (float)(degrees * (PI / 180.0));
    return ERR_OK;
}

enum err view_change_apply(const struct view_change *change, const struct scene *scene, struct camera *c,
                           struct reason *why)
{
    if (change->has_position)
        c->position = point_from(change->position, scene->origin);
    if (change->has_look_at)
        c->look_at = point_from(change->look_at, scene->origin);
    if (change->has_projection && change->projection != c->projection) {
        c->projection = change->projection;
        if (c->projection != PROJECTION_PERSPECTIVE && !(change->fov_y > 0.0f))
            c->fov_y = (float)PI;
    }
    if (change->fov_y > 0.0f)
        c->fov_y = change->fov_y;
    return change->has_position || change->has_look_at || change->has_projection || change->fov_y > 0.0f
               ? complete(c, why)
               : ERR_OK;
}
