/* server/scene/gbuffer_thin.c: one shade point for each pixel, of those that a G-buffer has. */
#include "gbuffer.h"
#include "mem.h"

#include <string.h>

#define NOT_KEPT UINT32_MAX

/* The entry that weighs most; of equals the first. */
static uint32_t heaviest_of(const struct gbuffer *g, size_t pixel)
{
    uint32_t heaviest = g->entry_first[pixel];
    float most = -1.0f;

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const float *w = g->entries[k].weight, sum = w[0] + w[1] + w[2];
        if (sum > most) {
            most = sum;
            heaviest = k;
        }
    }
    return heaviest;
}

/* to[point]: NOT_KEPT, but of those that stay. */
static void mark(const struct gbuffer *g, uint32_t *to)
{
    memset(to, 0xff, (size_t)g->packet_count * PACKET * sizeof(*to));
    for (size_t i = 0; i < (size_t)g->width * g->height; i++)
        if (g->entry_first[i] < g->entry_first[i + 1])
            to[g->entries[heaviest_of(g, i)].point] = 0;
}

void shade_packet_put(struct shade_packet *to, uint32_t at, const struct shade_packet *from, uint32_t lane,
                      int32_t valid)
{
    to->x[at] = from->x[lane];
    to->y[at] = from->y[lane];
    to->z[at] = from->z[lane];
    to->ng_x[at] = from->ng_x[lane];
    to->ng_y[at] = from->ng_y[lane];
    to->ng_z[at] = from->ng_z[lane];
    to->ns_x[at] = from->ns_x[lane];
    to->ns_y[at] = from->ns_y[lane];
    to->ns_z[at] = from->ns_z[lane];
    to->wo_x[at] = from->wo_x[lane];
    to->wo_y[at] = from->wo_y[lane];
    to->wo_z[at] = from->wo_z[lane];
    for (int c = 0; c < 3; c++) {
        to->diffuse[c][at] = from->diffuse[c][lane];
        to->specular[c][at] = from->specular[c][lane];
    }
    to->gloss[at] = from->gloss[lane];
    to->valid[at] = valid;
    to->mesh[at] = from->mesh[lane];
    to->material[at] = from->material[lane];
    to->behind[at] = from->behind[lane];
}

/* New places for the points that stay, in the order that they had, so that neighbours stay together; a packet ends
 * where the kind or the set does. How many packets that makes. */
static uint32_t number(const struct gbuffer *g, uint32_t *to)
{
    const struct shade_packet *last = NULL;
    uint32_t packets = 0, lane = 0;

    for (uint32_t k = 0; k < g->packet_count; k++) {
        const struct shade_packet *p = &g->packets[k];
        for (uint32_t l = 0; l < p->count; l++) {
            if (to[k * PACKET + l] == NOT_KEPT)
                continue;
            if (!last || lane == PACKET || last->kind != p->kind || last->set != p->set) {
                packets++;
                lane = 0;
            }
            to[k * PACKET + l] = (packets - 1) * PACKET + lane++;
            last = p;
        }
    }
    return packets;
}

static void repack(const struct gbuffer *g, const uint32_t *to, struct gbuffer *out)
{
    for (uint32_t k = 0; k < g->packet_count; k++) {
        const struct shade_packet *p = &g->packets[k];
        for (uint32_t l = 0; l < p->count; l++) {
            const uint32_t at = to[k * PACKET + l];
            if (at == NOT_KEPT)
                continue;
            struct shade_packet *one = &out->packets[at / PACKET];
            one->kind = p->kind;
            one->set = p->set;
            one->count++;
            shade_packet_put(one, at % PACKET, p, l, -1);
            out->point_count++;
        }
    }
    for (uint32_t k = 0; k < out->packet_count; k++)
        for (uint32_t rest = out->packets[k].count; rest < PACKET; rest++)
            shade_packet_put(&out->packets[k], rest, &out->packets[k], out->packets[k].count - 1, 0);
}

/* One entry a pixel, with the weight of all. */
static void rewrite(const struct gbuffer *g, const uint32_t *to, struct gbuffer *out)
{
    uint32_t count = 0;

    for (size_t i = 0; i < (size_t)g->width * g->height; i++) {
        out->entry_first[i] = count;
        if (g->entry_first[i] == g->entry_first[i + 1])
            continue;
        struct gbuffer_entry *one = &out->entries[count++];
        *one = (struct gbuffer_entry){ .point = to[g->entries[heaviest_of(g, i)].point] };
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
            for (int c = 0; c < 3; c++)
                one->weight[c] += g->entries[k].weight[c];
    }
    out->entry_first[(size_t)g->width * g->height] = count;
}

static bool allocate(const struct gbuffer *g, uint32_t packets, struct gbuffer *out)
{
    const size_t pixels = (size_t)g->width * g->height, escapes = g->escape_first[pixels];

    *out = *g;
    out->packet_count = packets;
    out->point_count = 0;
    out->edge_pixels = 0;
    out->packets = mem_alloc(packets, sizeof(*out->packets));
    out->entry_first = mem_alloc(pixels + 1, sizeof(*out->entry_first));
    out->entries = mem_alloc(pixels, sizeof(*out->entries));
    out->escape_first = mem_alloc(pixels + 1, sizeof(*out->escape_first));
    out->escapes = mem_alloc(escapes, sizeof(*out->escapes));
    out->bytes = packets * sizeof(*out->packets) + pixels * (sizeof(*out->entries) + 2 * sizeof(uint32_t)) +
                 escapes * sizeof(*out->escapes);
    if (!out->packets || !out->entry_first || !out->entries || !out->escape_first || !out->escapes)
        return false;
    memcpy(out->escape_first, g->escape_first, (pixels + 1) * sizeof(*out->escape_first));
    memcpy(out->escapes, g->escapes, escapes * sizeof(*out->escapes));
    return true;
}

enum err gbuffer_thin(const struct gbuffer *g, struct gbuffer **out)
{
    uint32_t *to = mem_alloc((size_t)g->packet_count * PACKET, sizeof(*to));
    struct gbuffer *thin = mem_alloc(1, sizeof(*thin));

    *out = NULL;
    if (to)
        mark(g, to);
    if (!to || !thin || !allocate(g, number(g, to), thin)) {
        gbuffer_destroy(thin);
        mem_free(to);
        return ERR_NOMEM;
    }
    repack(g, to, thin);
    rewrite(g, to, thin);
    mem_free(to);
    *out = thin;
    return ERR_OK;
}
