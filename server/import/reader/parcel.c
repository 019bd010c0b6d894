#define _GNU_SOURCE /* fallocate */
#include "import/reader/wire.h"

#include "base/mem.h"
#include "scene/geometry/scene_build.h"

#include <errno.h>
#include <fcntl.h>
#include <float.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAGIC 0x524c5036u /* "RLP6"; the digit changes with the layout */
#define SLACK 1e-4f       /* rounding beyond the limits of a value */

struct head {
    uint32_t magic;
    uint32_t materials, cameras, lights, textures, meshes, unmodelled, ground;
    double origin[3];
};

struct texture_head {
    uint32_t width, height;
    uint32_t values, wrap_u, wrap_v; /* enum texture_values, enum texture_wrap */
};

struct mesh_head {
    uint32_t vertices, triangles, material;
    uint32_t has_normals, has_uvs, has_more_uvs, has_tangents, has_colours; /* 0 or 1 */
    char name[64];
    uint32_t source; /* as in struct mesh; not 0: the rest is undefined */
    uint32_t placed; /* 0 or 1 */
};

/* ---- Writing ---- */

static enum err put(int fd, const void *bytes, size_t size, struct reason *why)
{
    const uint8_t *at = bytes;

    while (size > 0) {
        const ssize_t done = write(fd, at, size);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return err_say(why, errno == EFBIG ? ERR_NOMEM : ERR_IO, "cannot hand over the scene: %s", strerror(errno));
        at += done;
        size -= (size_t)done;
    }
    return ERR_OK;
}

static enum err put_texture(int fd, struct texture *t, struct reason *why)
{
    const struct texture_head head = { t->width, t->height, t->values, t->wrap_u, t->wrap_v };
    const size_t size = 4 * texture_texel_count(t->width, t->height);
    enum err e = put(fd, &head, sizeof(head), why);

    if (!e)
        e = put(fd, t->texels, size, why);
    texture_finish(t);
    return e;
}

static enum err put_mesh(int fd, struct mesh *m, struct reason *why)
{
    struct mesh_head head = { .vertices = m->vertex_count,
                              .triangles = m->triangle_count,
                              .material = m->material,
                              .has_normals = m->normals != NULL,
                              .has_uvs = m->uvs != NULL,
                              .has_more_uvs = m->more_uvs != NULL,
                              .has_tangents = m->tangents != NULL,
                              .has_colours = m->colours != NULL,
                              .source = m->source,
                              .placed = m->placed };

    memcpy(head.name, m->name, sizeof(head.name));
    enum err e = put(fd, &head, sizeof(head), why);

    if (!e && m->placed)
        e = put(fd, m->place.matrix, sizeof(m->place.matrix), why);
    if (e || m->source != 0)
        return e;
    if (!e)
        e = put(fd, m->positions, 3 * sizeof(float) * m->vertex_count, why);
    if (!e && m->normals)
        e = put(fd, m->normals, 3 * sizeof(float) * m->vertex_count, why);
    if (!e && m->uvs)
        e = put(fd, m->uvs, 2 * sizeof(float) * m->vertex_count, why);
    if (!e && m->more_uvs)
        e = put(fd, m->more_uvs, 2 * sizeof(float) * m->vertex_count, why);
    if (!e && m->tangents)
        e = put(fd, m->tangents, 4 * sizeof(float) * m->vertex_count, why);
    if (!e && m->colours)
        e = put(fd, m->colours, 4 * sizeof(float) * m->vertex_count, why);
    if (!e)
        e = put(fd, m->indices, 3 * sizeof(uint32_t) * m->triangle_count, why);
    mesh_finish(m);
    return e;
}

enum err parcel_write(int fd, struct scene *s, struct reason *why)
{
    const struct head head = { MAGIC,
                               (uint32_t)s->material_count,
                               (uint32_t)s->camera_count,
                               (uint32_t)s->light_count,
                               (uint32_t)s->texture_count,
                               (uint32_t)s->mesh_count,
                               s->unmodelled,
                               s->wants_ground,
                               { s->origin[0], s->origin[1], s->origin[2] } };
    enum err e = put(fd, &head, sizeof(head), why);

    if (!e)
        e = put(fd, s->materials, sizeof(*s->materials) * s->material_count, why);
    if (!e)
        e = put(fd, s->cameras, sizeof(*s->cameras) * s->camera_count, why);
    if (!e)
        e = put(fd, s->lights, sizeof(*s->lights) * s->light_count, why);
    for (size_t i = 0; i < s->texture_count && !e; i++)
        e = put_texture(fd, &s->textures[i], why);
    for (size_t i = 0; i < s->mesh_count && !e; i++)
        e = put_mesh(fd, &s->meshes[i], why);
    return e;
}

/* ---- Reading ---- */

struct parcel {
    int fd;
    uint64_t at, size; /* bytes */
    const char *name;
    struct head head;
    struct scene *scene;
    struct reason *why;
};

static enum err forged(const struct parcel *p, const char *what)
{
    return err_say(p->why, ERR_FORMAT, "%s: the reader sent an invalid scene: %s", p->name, what);
}

/* Copies the next bytes. What has been read of a large array is given back to the system. */
static enum err take(struct parcel *p, void *out, uint64_t size)
{
    uint8_t *at = out;
    uint64_t left = size;

    if (size > p->size - p->at)
        return forged(p, "it is too short");
    while (left > 0) {
        const ssize_t got = pread(p->fd, at, left, (off_t)p->at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return err_say(p->why, ERR_IO, "%s: %s", p->name, strerror(errno));
        if (got == 0)
            return forged(p, "it is too short");
        at += got;
        left -= (uint64_t)got;
        p->at += (uint64_t)got;
    }
    if (size > 1 << 20)
        (void)fallocate(p->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)(p->at - size), (off_t)size);
    return ERR_OK;
}

/* An array of count * size bytes and `spare` zeroed ones behind it; owned by the caller even on error. */
static enum err take_array(struct parcel *p, uint64_t count, size_t size, size_t spare, void **out)
{
    if (count > (p->size - p->at) / size)
        return forged(p, "it is too short");
    *out = mem_alloc_raw(count * size + spare, 1);
    if (!*out)
        return ERR_NOMEM;
    memset((uint8_t *)*out + count * size, 0, spare);
    return take(p, *out, count * size);
}

static bool is_text(const char *text, size_t size)
{
    return memchr(text, '\0', size) != NULL;
}

/* False for NaN, too. */
static bool within(const float *v, size_t count, float least, float most)
{
    bool good = true;

    for (size_t i = 0; i < count; i++)
        good &= v[i] >= least && v[i] <= most;
    return good;
}

static bool is_colour(struct vec3 c)
{
    return within((const float[]){ c.x, c.y, c.z }, 3, 0.0f, 1.0f + SLACK);
}

static enum err check_emission(const struct parcel *p, const struct material *m)
{
    const float e[3] = { m->emission.x, m->emission.y, m->emission.z };

    if (!within(e, 3, 0.0f, EMISSION_MAX))
        return forged(p, "an emission is out of range");
    if (!within(e, 3, 0.0f, 0.0f) && m->emission_texture != MATERIAL_NO_TEXTURE &&
        m->emission_texture >= p->head.textures)
        return forged(p, "a material names an emissive texture that is not there");
    return ERR_OK;
}

static bool lacks_map(const struct parcel *p, const struct material *m, enum material_map map, uint32_t texture)
{
    return (m->maps & map) && texture >= p->head.textures;
}

static enum err check_maps(const struct parcel *p, const struct material *m)
{
    if ((m->maps & ~(uint32_t)MAPS_ALL) || ((m->maps & MAP_ROUGHNESS) && !material_has_finish(m)))
        return forged(p, "a material has maps that it cannot have");
    if ((m->second & ~(m->maps | MAPS_COLOURS)) || (m->moved & ~(m->maps & MAPS_MOVED)) ||
        !within(m->moved_by[0], 12, -MOVED_MAX, MOVED_MAX))
        return forged(p, "the place of a map is out of range");
    if (!within(&m->normal_scale, 1, -NORMAL_SCALE_MAX, NORMAL_SCALE_MAX))
        return forged(p, "the scale of a normal map is out of range");
    if (lacks_map(p, m, MAP_ROUGHNESS, m->roughness_texture) || lacks_map(p, m, MAP_NORMAL, m->normal_texture))
        return forged(p, "a material names a map that is not there");
    if (lacks_map(p, m, MAP_COAT, m->coat_texture) || lacks_map(p, m, MAP_COAT_ROUGHNESS, m->coat_roughness_texture))
        return forged(p, "a clear coat names a map that is not there");
    if ((m->sheen.x + m->sheen.y + m->sheen.z > 0.0f && m->sheen_texture != MATERIAL_NO_TEXTURE &&
         m->sheen_texture >= p->head.textures) ||
        lacks_map(p, m, MAP_SHEEN_ROUGHNESS, m->sheen_roughness_texture))
        return forged(p, "a sheen names a texture that is not there");
    return ERR_OK;
}

static enum err check_material(const struct parcel *p, const struct material *m)
{
    const struct vec3 sum = vec3_add(m->diffuse, m->specular),
                      f0 = vec3_add(m->specular, vec3_make(0.04f, 0.04f, 0.04f));

    if (!is_text(m->name, sizeof(m->name)))
        return forged(p, "the name of a material has no end");
    if ((uint32_t)m->kind > MATERIAL_GLASS || !is_colour(m->diffuse) ||
        !is_colour(material_has_finish(m) ? f0 : m->specular) || (m->kind == MATERIAL_PHONG && !is_colour(sum)) ||
        !within(&m->exponent, 1, 0.0f, 1e6f) || !within(&m->metallic, 1, 0.0f, 1.0f + SLACK) ||
        !within(&m->roughness, 1, 0.0f, 1.0f + SLACK) ||
        (m->kind == MATERIAL_GLASS && !within(&m->ior, 1, 0.25f, 4.0f)) ||
        !within(&m->attenuation.x, 3, 0.0f, ATTENUATION_MAX) || m->thin > (m->kind == MATERIAL_GLASS) ||
        !within(&m->transmits, 1, 0.0f, 1.0f) || !is_colour(m->through) || !within(&m->coat, 2, 0.0f, 1.0f + SLACK) ||
        m->coat_bent > 1 || !is_colour(m->sheen) || !within(&m->sheen_roughness, 1, 0.0f, 1.0f + SLACK) ||
        ((m->transmits > 0.0f || m->coat > 0.0f || m->sheen.x + m->sheen.y + m->sheen.z > 0.0f) &&
         !material_has_layers(m)))
        return forged(p, "a material is out of range");
    if (m->ground != 0) /* is added afterwards */
        return forged(p, "a material says that it is the ground's");
    if ((uint32_t)m->alpha_mode > ALPHA_BLEND || !within(&m->alpha, 1, 0.0f, 1.0f + SLACK) ||
        !within(&m->alpha_cutoff, 1, 0.0f, FLT_MAX))
        return forged(p, "the alpha of a material is out of range");
    if ((m->texture != MATERIAL_NO_TEXTURE && m->texture >= p->head.textures) ||
        (m->alpha_mode != ALPHA_OPAQUE && m->alpha_texture != MATERIAL_NO_TEXTURE &&
         m->alpha_texture >= p->head.textures) ||
        (m->transmits > 0.0f && m->through_texture != MATERIAL_NO_TEXTURE && m->through_texture >= p->head.textures))
        return forged(p, "a material names a texture that is not there");
    const enum err e = check_maps(p, m);
    return e ? e : check_emission(p, m);
}

static enum err take_materials(struct parcel *p)
{
    struct material m;
    enum err e = ERR_OK;

    for (uint32_t i = 0; i < p->head.materials && !e; i++) {
        e = take(p, &m, sizeof(m));
        if (!e)
            e = check_material(p, &m);
        if (!e)
            e = scene_add_material(p->scene, &m, NULL);
    }
    return e;
}

static enum err take_cameras(struct parcel *p)
{
    struct camera c;
    enum err e = ERR_OK;

    for (uint32_t i = 0; i < p->head.cameras && !e; i++) {
        e = take(p, &c, sizeof(c));
        if (!e && !is_text(c.name, sizeof(c.name)))
            e = forged(p, "the name of a camera has no end");
        if (!e)
            e = camera_check(&c, p->name, p->why);
        if (!e)
            e = scene_add_camera(p->scene, &c);
    }
    return e;
}

static enum err take_lights(struct parcel *p)
{
    struct punctual_light l;
    enum err e = ERR_OK;

    for (uint32_t i = 0; i < p->head.lights && !e; i++) {
        e = take(p, &l, sizeof(l));
        if (!e && (uint32_t)l.kind > LIGHT_DIRECTIONAL)
            e = forged(p, "the kind of a light");
        if (!e)
            e = light_check(&l, p->name, p->why);
        if (!e)
            e = scene_add_light(p->scene, &l);
    }
    return e;
}

static enum err take_texture(struct parcel *p)
{
    struct texture_head head;
    struct texture t = { 0 };

    enum err e = take(p, &head, sizeof(head));
    if (e)
        return e;
    if (head.width < 1 || head.height < 1 || head.width > TEXTURE_SIDE_MAX || head.height > TEXTURE_SIDE_MAX ||
        (uint64_t)head.width * head.height > TEXTURE_TEXELS_MAX)
        return forged(p, "the size of a texture");
    if (head.values > TEXTURE_LINEAR || head.wrap_u > TEXTURE_MIRROR || head.wrap_v > TEXTURE_MIRROR)
        return forged(p, "the kind of a texture");
    t.width = head.width;
    t.height = head.height;
    t.values = (enum texture_values)head.values;
    t.wrap_u = (enum texture_wrap)head.wrap_u;
    t.wrap_v = (enum texture_wrap)head.wrap_v;
    e = take_array(p, texture_texel_count(t.width, t.height), 4, 0, (void **)&t.texels);
    if (!e)
        e = scene_add_texture(p->scene, &t, NULL);
    if (e)
        texture_finish(&t);
    return e;
}

static bool indices_are_below(const uint32_t *indices, uint64_t count, uint32_t limit)
{
    bool good = true;

    for (uint64_t i = 0; i < count; i++)
        good &= indices[i] < limit;
    return good;
}

static enum err take_arrays(struct parcel *p, const struct mesh_head *head, struct mesh *m)
{
    enum err e = take_array(p, m->vertex_count, 3 * sizeof(float), sizeof(float), (void **)&m->positions);
    if (!e && head->has_normals)
        e = take_array(p, m->vertex_count, 3 * sizeof(float), 0, (void **)&m->normals);
    if (!e && head->has_uvs)
        e = take_array(p, m->vertex_count, 2 * sizeof(float), 0, (void **)&m->uvs);
    if (!e && head->has_more_uvs)
        e = take_array(p, m->vertex_count, 2 * sizeof(float), 0, (void **)&m->more_uvs);
    if (!e && head->has_tangents)
        e = take_array(p, m->vertex_count, 4 * sizeof(float), 0, (void **)&m->tangents);
    if (!e && head->has_colours)
        e = take_array(p, m->vertex_count, 4 * sizeof(float), 0, (void **)&m->colours);
    if (!e)
        e = take_array(p, m->triangle_count, 3 * sizeof(uint32_t), 0, (void **)&m->indices);
    if (e)
        return e;
    if (!within(m->positions, 3 * (size_t)m->vertex_count, -MESH_COORDINATE_MAX, MESH_COORDINATE_MAX))
        return forged(p, "a position is out of range");
    if (m->normals && !within(m->normals, 3 * (size_t)m->vertex_count, -1.0f - SLACK, 1.0f + SLACK))
        return forged(p, "a normal is out of range");
    if (m->tangents && !within(m->tangents, 4 * (size_t)m->vertex_count, -1.0f - SLACK, 1.0f + SLACK))
        return forged(p, "a tangent is out of range");
    if (m->colours && !within(m->colours, 4 * (size_t)m->vertex_count, 0.0f, 1.0f))
        return forged(p, "a colour is out of range");
    if (!indices_are_below(m->indices, 3 * (uint64_t)m->triangle_count, m->vertex_count))
        return forged(p, "a triangle names a vertex that is not there");
    return ERR_OK;
}

static enum err check_place(const struct parcel *p, enum err e)
{
    return e == ERR_RANGE ? forged(p, "the place of a mesh is out of range") : e;
}

static enum err take_instance(struct parcel *p, const struct mesh_head *head, const float matrix[3][4])
{
    const struct scene *s = p->scene;
    const uint32_t of = head->source - 1;

    if (head->placed != 1 || of >= s->mesh_count || !s->meshes[of].placed || s->meshes[of].source != 0)
        return forged(p, "an instance names a mesh that is not there");
    return check_place(p, scene_add_instance(p->scene, of, head->name, matrix));
}

static enum err take_mesh(struct parcel *p)
{
    struct mesh_head head;
    struct mesh m = { 0 };
    float matrix[3][4];

    enum err e = take(p, &head, sizeof(head));
    if (!e && head.placed)
        e = take(p, matrix, sizeof(matrix));
    if (e)
        return e;
    if (!is_text(head.name, sizeof(head.name)))
        return forged(p, "the name of a mesh has no end");
    if (head.source != 0)
        return take_instance(p, &head, matrix);
    if (head.placed > 1 || head.vertices > MESH_ELEMENTS_MAX || head.triangles < 1 ||
        head.triangles > MESH_ELEMENTS_MAX || head.has_normals > 1 || head.has_uvs > 1 || head.has_more_uvs > 1 ||
        head.has_tangents > 1 || head.has_colours > 1)
        return forged(p, "the size of a mesh");
    if (head.material >= p->head.materials)
        return forged(p, "a mesh names a material that is not there");
    memcpy(m.name, head.name, sizeof(m.name));
    m.vertex_count = head.vertices;
    m.triangle_count = head.triangles;
    m.material = head.material;
    e = take_arrays(p, &head, &m);
    if (!e && head.placed)
        e = check_place(p, mesh_place(&m, (const float(*)[4])matrix));
    if (!e)
        e = scene_add_mesh(p->scene, &m);
    if (e)
        mesh_finish(&m);
    return e;
}

static enum err take_scene(struct parcel *p)
{
    enum err e = take(p, &p->head, sizeof(p->head));

    if (!e && (p->head.magic != MAGIC || p->head.unmodelled >= UINT32_C(1) << FEATURE_COUNT || p->head.cameras == 0 ||
               p->head.ground > 1))
        e = forged(p, "its beginning");
    if (e)
        return e;
    p->scene->unmodelled = p->head.unmodelled;
    p->scene->wants_ground = p->head.ground;
    for (int k = 0; k < 3; k++)
        p->scene->origin[k] = isfinite(p->head.origin[k]) ? p->head.origin[k] : 0.0;
    e = take_materials(p);
    if (!e)
        e = take_cameras(p);
    if (!e)
        e = take_lights(p);
    for (uint32_t i = 0; i < p->head.textures && !e; i++)
        e = take_texture(p);
    for (uint32_t i = 0; i < p->head.meshes && !e; i++)
        e = take_mesh(p);
    if (!e && p->at != p->size)
        e = forged(p, "it is too long");
    return e ? e : scene_finish(p->scene, p->name, p->why);
}

enum err parcel_read(int fd, const char *name, struct scene **out, struct reason *why)
{
    struct parcel p = { .fd = fd, .name = name, .why = why };
    struct stat st;

    *out = NULL;
    if (fstat(fd, &st) != 0)
        return err_say(why, ERR_IO, "%s: %s", name, strerror(errno));
    p.size = (uint64_t)st.st_size;
    p.scene = scene_create();
    if (!p.scene)
        return err_say(why, ERR_NOMEM, "%s: out of memory", name);
    const enum err e = take_scene(&p);
    if (e == ERR_NOMEM)
        err_say(why, e, "%s: out of memory", name);
    if (e)
        scene_destroy(p.scene);
    else
        *out = p.scene;
    return e;
}
