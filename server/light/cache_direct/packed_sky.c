/* Packs a frame's sky for another process: cells, coefficients of indirect light and the texels of the sun, some 20 KB
 * instead of 4.7 MB of faces. */
#include "light/cache_direct/transport.h"

#include "base/mem.h"
#include "light/cache_direct/internal.h"

#include <string.h>

/* Followed by the indirect light's coefficients and the texels of the sun. */
struct head {
    float level;
    uint32_t n, sun, indirect;
    double sun_energy, total_energy;
    float cells[SKY_CHUNKS][3][SKY_CHUNK];
};

struct sun_texel {
    struct texel texel;
    uint32_t at, padding;
    double cdf;
};

static uint32_t count_of(const struct transport_indirect *indirect)
{
    return indirect ? indirect->sky_count : 0;
}

static size_t bytes_of(uint32_t sun, uint32_t indirect)
{
    return sizeof(struct head) + sun * sizeof(struct sun_texel) + indirect * sizeof(float);
}

size_t transport_sky_bytes(const struct transport *t, const struct transport_indirect *indirect)
{
    return bytes_of(t->sky.sun_count, count_of(indirect));
}

void transport_pack_sky(const struct transport *t, const struct environment *e,
                        const struct transport_indirect *indirect, uint8_t *out)
{
    const struct sky_split *s = &t->sky;
    struct head h = { .level = s->level,
                      .n = s->n,
                      .sun = s->sun_count,
                      .indirect = count_of(indirect),
                      .sun_energy = s->sun_energy,
                      .total_energy = e->total_energy };

    memcpy(h.cells, s->cells, sizeof(h.cells));
    memcpy(out, &h, sizeof(h));
    out += sizeof(h);
    for (uint32_t k = 0; k < h.sun; k++, out += sizeof(struct sun_texel)) {
        const struct sun_texel one = { e->texels[s->sun[k]], s->sun[k], 0, s->sun_cdf[k] };
        memcpy(out, &one, sizeof(one));
    }
    if (h.indirect > 0)
        memcpy(out, indirect->sky, h.indirect * sizeof(float));
}

static enum err reserve(struct sky_split *s, uint32_t count)
{
    if (count <= s->sun_capacity)
        return ERR_OK;
    mem_free(s->sun);
    mem_free(s->sun_cdf);
    s->sun = mem_alloc(count, sizeof(*s->sun));
    s->sun_cdf = mem_alloc(count, sizeof(*s->sun_cdf));
    s->sun_capacity = s->sun && s->sun_cdf ? count : 0;
    return s->sun_capacity ? ERR_OK : ERR_NOMEM;
}

enum err transport_unpack_sky(struct transport *t, const uint8_t *bytes, size_t size,
                              const struct transport_indirect *indirect, struct environment *e)
{
    const uint32_t texels = CUBE_FACES * e->n * e->n;
    struct sky_split *s = &t->sky;
    struct head h;

    if (size < sizeof(h))
        return ERR_FORMAT;
    memcpy(&h, bytes, sizeof(h));
    if (h.n != e->n || h.sun > texels || h.indirect != count_of(indirect) || size != bytes_of(h.sun, h.indirect))
        return ERR_FORMAT;
    for (uint32_t k = 0; k < s->sun_count; k++) /* those of the frame before */
        e->texels[s->sun[k]] = (struct texel){ .r = 0.0f };
    s->sun_count = 0;
    if (reserve(s, h.sun))
        return ERR_NOMEM;
    memcpy(s->cells, h.cells, sizeof(h.cells));
    s->level = h.level;
    s->n = h.n;
    s->sun_energy = h.sun_energy;
    e->total_energy = h.total_energy;
    bytes += sizeof(h);
    for (uint32_t k = 0; k < h.sun; k++, bytes += sizeof(struct sun_texel)) {
        struct sun_texel one;
        memcpy(&one, bytes, sizeof(one));
        if (one.at >= texels)
            return ERR_FORMAT;
        e->texels[one.at] = one.texel;
        s->sun[k] = one.at;
        s->sun_cdf[k] = one.cdf;
    }
    s->sun_count = h.sun;
    if (h.indirect > 0)
        memcpy(indirect->sky, bytes, h.indirect * sizeof(float));
    return ERR_OK;
}
