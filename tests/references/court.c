/* court FOLDER: writes the built-in scene as court.obj and court.json, for other renderers. All of it is matte, because
 * Cycles has no Phong, and flat, because it shades interpolated normals in its own way. */
#include "import/reader/reader.h"
#include "scene/geometry/mesh_read.h"

#include <stdio.h>

#define DEGREES (180.0 / PI)

static void write_mesh(const struct scene *s, const struct mesh *m, uint32_t first, FILE *to)
{
    fprintf(to, "usemtl %s\n", s->materials[m->material].name);
    for (uint32_t i = 0; i < m->vertex_count; i++) {
        double p[3];
        mesh_position(m, i, p);
        fprintf(to, "v %.7g %.7g %.7g\n", p[0], p[1], p[2]);
    }
    for (uint32_t i = 0; i < m->triangle_count; i++) {
        const uint32_t *t = m->indices + 3 * (size_t)i;
        fprintf(to, "f %u %u %u\n", first + t[0], first + t[1], first + t[2]);
    }
}

static void write_meshes(const struct scene *s, FILE *to)
{
    uint32_t first = 1;

    for (size_t i = 0; i < s->mesh_count; i++) {
        write_mesh(s, &s->meshes[i], first, to);
        first += s->meshes[i].vertex_count;
    }
}

static void write_scene(const struct scene *s, FILE *to)
{
    const struct camera *c = scene_camera(s, NULL);

    fprintf(to,
            "{\"camera\": {\"position\": [%.7g, %.7g, %.7g],\n"
            "  \"look_at\": [%.7g, %.7g, %.7g], \"fov_y_degrees\": %.7g},\n"
            " \"models\": [{\"file\": \"court.obj\"}],\n \"materials\": {",
            (double)c->position.x, (double)c->position.y, (double)c->position.z, (double)c->look_at.x,
            (double)c->look_at.y, (double)c->look_at.z, DEGREES * (double)c->fov_y);
    for (size_t i = 0; i < s->material_count; i++) {
        const struct vec3 d = s->materials[i].diffuse;
        fprintf(to, "%s\n  \"%s\": {\"type\": \"lambert\", \"albedo\": [%.6g, %.6g, %.6g]}", i ? "," : "",
                s->materials[i].name, (double)d.x, (double)d.y, (double)d.z);
    }
    fputs("}}\n", to);
}

static bool write_file(const struct scene *s, void (*write)(const struct scene *, FILE *), const char *folder,
                       const char *name)
{
    char path[4096];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    FILE *to = fopen(path, "w");
    if (to)
        write(s, to);
    if (to && fclose(to) == 0)
        return true;
    perror(path);
    return false;
}

int main(int argc, char **argv)
{
    if (argc != 2 || argv[1][0] == '-') {
        fputs("usage: court FOLDER\n", stderr);
        return 2;
    }
    struct scene *s = scene_create_builtin();
    const bool ok =
        s && write_file(s, write_meshes, argv[1], "court.obj") && write_file(s, write_scene, argv[1], "court.json");
    scene_destroy(s);
    return ok ? 0 : 1;
}
