/* A square in a glTF file, with a material of textures. */
#pragma once

#include "gltf_make.h"

#include "pngs.h"

static const float corners[] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
static const float uvs[] = { 0, 1, 1, 1, 1, 0, 0, 0 };
static const float normals[] = { 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1 };
static const float tangents[] = { 0, 1, 0, -1, 0, 1, 0, -1, 0, 1, 0, -1, 0, 1, 0, -1 }; /* not those of the uvs */
static const uint8_t two_triangles[] = { 0, 1, 2, 0, 2, 3 };

#define REST                                                                                                           \
    "\"nodes\":[{\"mesh\":0%s}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0%s},"                      \
    "\"indices\":1,\"material\":0}]}],\"textures\":[{\"source\":0},{\"source\":1}],"                                   \
    "\"images\":[{\"uri\":\"map.png\"},{\"uri\":\"t.png\"}],\"materials\":[{%s}]"
#define UVS ",\"TEXCOORD_0\":2,\"TEXCOORD_1\":2,\"TEXCOORD_2\":2,\"NORMAL\":3"
#define TANGENTS UVS ",\"TANGENT\":4"

/* A square with a material, further attributes and members of its node. Textures: 0 is map.png, which the test writes,
 * 1 an image of colours. */
static inline const char *square_with(struct make *m, const char *material, const char *attributes, const char *node)
{
    static char text[4096];

    m->size = 0;
    m->views[0] = m->accessors[0] = '\0';
    m->view_count = m->accessor_count = 0;
    FLOATS(m, corners, "VEC3", 4);
    make_array(m, two_triangles, sizeof(two_triangles), 5121, "SCALAR", 6);
    FLOATS(m, uvs, "VEC2", 4);
    FLOATS(m, normals, "VEC3", 4);
    FLOATS(m, tangents, "VEC4", 4);
    folder_write(&m->folder, "t.png", four_png, sizeof(four_png));
    snprintf(text, sizeof(text), REST, node, attributes, material);
    return make_gltf(m, text);
}

static inline const char *square_of(struct make *m, const char *material)
{
    return square_with(m, material, UVS, "");
}

/* The material that was read, and its warnings; its maps must be textures of numbers. */
static inline struct material read_material(struct make *m, const char *material, const char **said)
{
    log_begin();
    struct scene *s = load_or_fail(square_of(m, material));
    *said = log_end();
    const struct material out = s->materials[0];
    if (out.maps & MAP_NORMAL)
        assert_int_equal(s->textures[out.normal_texture].values, TEXTURE_LINEAR);
    if (out.maps & MAP_ROUGHNESS)
        assert_int_equal(s->textures[out.roughness_texture].values, TEXTURE_LINEAR);
    scene_destroy(s);
    return out;
}
