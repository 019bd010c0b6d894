/* Models that are placed several times share their meshes. */
#include "import/formats/import.h"

/* The rows of `move` times the matrix that places mesh m, if one does. */
static void moved_rows(const struct mesh *m, const double move[16], float rows[3][4])
{
    double place[16] = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 }, world[16];

    for (int row = 0; m->placed && row < 3; row++)
        for (int column = 0; column < 4; column++)
            place[4 * column + row] = m->place.matrix[row][column];
    matrix_multiply(move, place, world);
    matrix_rows(world, rows);
}

/* Whether a copy of the mesh could be placed there; of meshes in world space also as they are. */
static bool suits(const struct mesh *m, const double move[16])
{
    static const double identity[16] = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 };
    struct mesh trial = *m;
    float rows[3][4];

    moved_rows(m, identity, rows);
    if (mesh_place(&trial, (const float(*)[4])rows))
        return false;
    moved_rows(m, move, rows);
    return mesh_place(&trial, (const float(*)[4])rows) == ERR_OK;
}

static enum err repeat(struct scene *s, size_t mesh, const double move[16])
{
    static const float identity[3][4] = { { 1.0f }, { 0.0f, 1.0f }, { 0.0f, 0.0f, 1.0f } };
    struct mesh *m = &s->meshes[mesh];
    float rows[3][4];

    moved_rows(m, move, rows);
    const enum err e = m->placed ? ERR_OK : mesh_place(m, identity);
    return e ? e : scene_add_instance(s, (uint32_t)mesh, m->name, (const float(*)[4])rows);
}

enum err meshes_repeat(struct scene *s, size_t first, size_t end, const double from[16], const double to[16])
{
    double back[16], move[16];
    enum err e = ERR_OK;

    if (!matrix_inverse(from, back))
        return ERR_RANGE;
    matrix_multiply(to, back, move);
    for (size_t i = first; i < end; i++) {
        if (!suits(&s->meshes[i], move))
            return ERR_RANGE;
    }
    for (size_t i = first; i < end && !e; i++)
        e = repeat(s, i, move);
    return e;
}
