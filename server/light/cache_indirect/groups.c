/* Groups blocks that share V: close together in the image, of similar orientation and distance. */
#include "base/mem.h"
#include "light/cache_indirect/internal.h"

#include <math.h>
#include <stdlib.h>

#define TRAITS 7    /* direction from the eye, distance, normal */
#define TURNED 0.3f /* weight of normals relative to directions from the eye */
#define AWAY 0.5f   /* weight of distances, in units of the mean distance */

struct trait {
    struct indirect_block block;
    float at[TRAITS], key;
};

static void add_trait(const struct indirect_desc *d, const struct shade_packet *p, uint32_t l, float mean,
                      float at[TRAITS])
{
    const struct vec3 to = vec3_sub((struct vec3){ p->x[l], p->y[l], p->z[l] }, d->eye);
    const float length = fmaxf(vec3_length(to), 1e-30f), distance = length / (length + mean);
    const float traits[TRAITS] = { to.x / length,       to.y / length,       to.z / length,      AWAY * distance,
                                   TURNED * p->ns_x[l], TURNED * p->ns_y[l], TURNED * p->ns_z[l] };

    for (int k = 0; k < TRAITS; k++)
        at[k] += traits[k];
}

static float mean_distance(const struct indirect_desc *d)
{
    const struct gbuffer *g = d->gbuffer;
    double sum = 0.0;
    uint64_t count = 0;

    for (uint32_t i = 0; i < g->packet_count; i++)
        for (uint32_t l = 0; l < g->packets[i].count; l++, count++)
            sum += (double)vec3_length(
                vec3_sub((struct vec3){ g->packets[i].x[l], g->packets[i].y[l], g->packets[i].z[l] }, d->eye));
    return count > 0 && sum > 0.0 ? (float)(sum / (double)count) : 1.0f;
}

static void fill_traits(const struct indirect_desc *d, float mean, struct trait *t)
{
    float count = 0.0f;

    for (uint32_t k = 0; k < t->block.packets; k++) {
        const struct shade_packet *p = &d->gbuffer->packets[t->block.first + k];
        for (uint32_t l = 0; l < p->count; l++, count++)
            add_trait(d, p, l, mean, t->at);
    }
    for (int k = 0; k < TRAITS; k++)
        t->at[k] /= fmaxf(count, 1.0f);
}

static int by_key(const void *a, const void *b)
{
    const struct trait *x = a, *y = b;

    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->block.first < y->block.first ? -1 : 1;
}

static int by_rows(const void *a, const void *b)
{
    const struct trait *x = a, *y = b;

    if (x->block.rows != y->block.rows)
        return x->block.rows < y->block.rows ? -1 : 1;
    return x->block.first < y->block.first ? -1 : 1;
}

/* Splits more than a group in halves along the widest trait, at a multiple of a group. */
static void split(struct trait *t, uint32_t count)
{
    float widest = -1.0f;
    int along = 0;

    if (count <= INDIRECT_GROUP)
        return;
    for (int k = 0; k < TRAITS; k++) {
        float least = INFINITY, most = -INFINITY;
        for (uint32_t i = 0; i < count; i++) {
            least = fminf(least, t[i].at[k]);
            most = fmaxf(most, t[i].at[k]);
        }
        if (most - least > widest) {
            widest = most - least;
            along = k;
        }
    }
    for (uint32_t i = 0; i < count; i++)
        t[i].key = t[i].at[along];
    qsort(t, count, sizeof(*t), by_key);
    const uint32_t groups = (count + INDIRECT_GROUP - 1) / INDIRECT_GROUP, first = groups / 2 * INDIRECT_GROUP;
    split(t, first);
    split(t + first, count - first);
}

/* Writes the blocks in the order of their groups, whose blocks have the same number of rows. */
static void write_down(struct indirect_cache *b, const struct trait *traits)
{
    b->group_count = 0;
    for (uint32_t k = 0; k < b->block_count; k++) {
        struct indirect_group *g = k > 0 ? &b->groups[b->group_count - 1] : NULL;
        b->blocks[k] = traits[k].block;
        if (!g || g->count == INDIRECT_GROUP || g->rows != b->blocks[k].rows) {
            g = &b->groups[b->group_count++];
            *g = (struct indirect_group){ .first = k, .rows = b->blocks[k].rows };
        }
        g->count++;
    }
}

enum err indirect_group(struct indirect_cache *b, const struct indirect_desc *d)
{
    struct trait *traits = mem_alloc(b->block_count, sizeof(*traits));
    const float mean = mean_distance(d);

    b->groups = mem_alloc(b->block_count, sizeof(*b->groups));
    if (!traits || !b->groups) {
        mem_free(traits);
        return ERR_NOMEM;
    }
    for (uint32_t k = 0; k < b->block_count; k++) {
        traits[k].block = b->blocks[k];
        fill_traits(d, mean, &traits[k]);
    }
    qsort(traits, b->block_count, sizeof(*traits), by_rows);
    for (uint32_t first = 0, until; first < b->block_count; first = until) {
        for (until = first; until < b->block_count && traits[until].block.rows == traits[first].block.rows; until++)
            ;
        split(traits + first, until - first);
    }
    write_down(b, traits);
    mem_free(traits);
    return ERR_OK;
}
