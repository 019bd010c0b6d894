#include "scene/geometry/gbuffer.h"

#include "base/mem.h"
#include "base/progress.h"
#include "scene/geometry/gbuffer_build.h"

#include <assert.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#define SIDE_MAX 16384u   /* as IMAGE_MAX_SIDE */
#define EDGE_RAYS_MAX 64u /* bounds the rays of a pixel: 4,096 */
#define BAND_ROWS 16u     /* rows per thread and step; one more above and below is traced for edge detection */
#define COLOUR_STEP 0.04f /* a larger difference in texture colour between neighbours is an edge */

/* Rows are stored in blocks large enough to be returned to the system when freed: below 32 MiB the C library may keep
 * them in its heap, unusable for the larger arrays that follow. */
#define SLAB_BYTES ((size_t)33 << 20)

struct slab {
    _Alignas(MEM_ALIGN) size_t size; /* bytes after this header */
    size_t used;
    uint32_t holders; /* reference count: rows, and the thread that is filling it */
};

struct build {
    struct sight sight;
    struct view view;
    const struct gbuffer_desc *desc;
    struct gbuffer *g;
    struct row *rows;
    uint32_t side; /* camera rays per side of an edge pixel */
    uint64_t max_bytes;
    _Atomic uint64_t bytes; /* memory held, including what sorting will need */
    _Atomic bool failed;    /* out of memory */
};

/* Per thread: centre samples of a band, the leaves of one pixel, and the row being built. */
struct scratch {
    struct leaf *centres;    /* [rows of a band + 2][width] */
    uint8_t *uneven;         /* likewise: mirror, glass or a mask's holes (sight_trace) */
    float *glow;             /* likewise [3]: what is seen to be emitted; NULL: the scene has no lamps */
    struct leaf *leaves;     /* [side * side * LEAF_MAX] */
    struct leaf_link *links; /* likewise */
    struct row draft;        /* each row is built here and then copied at its exact size */
    struct slab *slab;       /* receives the copies; NULL: none yet */
};

/* Traces the ray through (x, y), one of `side` x `side` in the pixel, whose solid angle is an edge squared. */
static uint32_t trace(const struct build *b, double x, double y, uint32_t side, bool glance, struct leaf out[LEAF_MAX],
                      struct sighting *found, struct sight_count *count)
{
    const struct vec3 o = b->desc->camera->position, dir = view_direction(&b->view, x, y);
    const float angle = (float)(sqrt(view_solid_angle(&b->view, dir)) / side);

    *found = (struct sighting){ .uneven = false };
    if (!view_sees(&b->view, x, y))
        return 0;
    const uint32_t n = sight_trace(&b->sight, o, dir, angle, glance, out, found, count);
    const uint32_t cell = pixel_cell((uint32_t)((x - floor(x)) * 4.0), (uint32_t)((y - floor(y)) * 4.0));
    for (struct leaf *l = out; l < out + n; l++) {
        const bool alone = b->side < 2 || l->missed || l->bounces > 0;
        l->pixel = alone ? 0.0f : l->footprint / b->sight.pixel_angle * angle * (float)side;
        l->cells = side > 1 ? 1u << cell : PIXEL_WHOLE;
        l->cell = side > 1 ? cell : PIXEL_CELLS;
    }
    return n;
}

/* The centre sample of each pixel of row y, if it is even: then there is one leaf. Of others nothing else is known. */
static void trace_centres(const struct build *b, uint32_t y, struct leaf *centres, uint8_t *uneven, float *glow,
                          struct leaf *leaves, struct sight_count *count)
{
    for (uint32_t x = 0; x < b->desc->width; x++) {
        struct sighting found;
        const uint32_t n = trace(b, x + 0.5, y + 0.5, 1, true, leaves, &found, count);
        uneven[x] = found.uneven || n != 1;
        if (glow)
            memcpy(glow + 3 * (size_t)x, found.glow, sizeof(found.glow));
        centres[x] = n > 0 ? leaves[0] : (struct leaf){ .missed = false };
    }
}

static bool same_colour(const struct leaf *a, const struct leaf *b)
{
    return fabsf(a->diffuse.x - b->diffuse.x) <= COLOUR_STEP && fabsf(a->diffuse.y - b->diffuse.y) <= COLOUR_STEP &&
           fabsf(a->diffuse.z - b->diffuse.z) <= COLOUR_STEP;
}

/* row: index of the pixel's row in the scratch buffer; y: its row in the image. */
static bool is_edge(const struct build *b, const struct scratch *s, uint32_t row, uint32_t x, uint32_t y)
{
    const uint32_t width = b->desc->width, height = b->desc->height;
    const struct leaf *own = &s->centres[(size_t)row * width + x];

    if (b->side < 2)
        return false;
    if (b->desc->every_pixel || s->uneven[(size_t)row * width + x])
        return true;
    for (int dy = -1; dy <= 1; dy++) {
        for (int dx = -1; dx <= 1; dx++) {
            const int64_t nx = (int64_t)x + dx, ny = (int64_t)y + dy;
            if (nx < 0 || ny < 0 || nx >= width || ny >= height)
                continue;
            const size_t at = (size_t)((int64_t)row + dy) * width + (size_t)nx;
            const struct leaf *other = &s->centres[at];
            if (s->uneven[at] || own->missed != other->missed)
                return true;
            if (!own->missed && (!leaf_alike(&b->sight, own, other, INFINITY) || !same_colour(own, other)))
                return true;
        }
    }
    return false;
}

/* Whether a neighbour's glow differs, as at the edges of an emissive texture's details. */
static bool glow_varies(const struct build *b, const struct scratch *s, uint32_t row, uint32_t x, uint32_t y)
{
    const int64_t width = b->desc->width, at = row * width + x;

    for (int k = 0; k < 9; k++) {
        const int64_t dx = k % 3 - 1, dy = k / 3 - 1, nx = x + dx, ny = y + dy;
        if (nx < 0 || ny < 0 || nx >= width || ny >= b->desc->height)
            continue;
        const float *own = s->glow + 3 * at, *other = s->glow + 3 * (at + dy * width + dx);
        for (int c = 0; c < 3; c++) {
            if (fabsf(own[c] - other[c]) > COLOUR_STEP * fmaxf(own[c], other[c]))
                return true;
        }
    }
    return false;
}

/* Leaves of pixel (x, y) from side^2 rays, merged, and the mean of what they saw emitted. */
static uint32_t trace_edge(const struct build *b, const struct scratch *s, uint32_t x, uint32_t y, float glow[3],
                           struct sight_count *count)
{
    const float share = 1.0f / (float)(b->side * b->side);
    uint32_t n = 0;

    glow[0] = glow[1] = glow[2] = 0.0f;
    for (uint32_t i = 0; i < b->side * b->side; i++) {
        double at[2];
        view_ray_in_pixel(i, b->side, at);
        struct sighting found;
        const uint32_t more = trace(b, x + at[0], y + at[1], b->side, false, s->leaves + n, &found, count);
        for (int c = 0; c < 3; c++)
            glow[c] += share * found.glow[c];
        for (uint32_t k = n; k < n + more; k++) {
            for (int c = 0; c < 3; c++)
                s->leaves[k].weight[c] *= share;
        }
        n += more;
    }
    leaves_merge(&b->sight, s->leaves, s->links, &n);
    return n;
}

static bool add_miss(struct row *r, const struct leaf *l)
{
    if (!mem_reserve(&r->misses, r->miss_count, &r->miss_room, sizeof(*r->misses)))
        return false;
    struct gbuffer_miss *out = &r->misses[r->miss_count++];
    out->direction = l->arrival;
    out->width = l->footprint;
    memcpy(out->weight, l->weight, sizeof(out->weight));
    return true;
}

static bool add_point(struct row *r, const struct leaf *l, uint32_t x, uint32_t y)
{
    if (!mem_reserve(&r->points, r->point_count, &r->point_room, sizeof(*r->points)) ||
        !mem_reserve(&r->entries, r->point_count, &r->entry_room, sizeof(*r->entries)))
        return false;
    struct gbuffer_entry *entry = &r->entries[r->point_count];
    entry->point = r->point_count;
    memcpy(entry->weight, l->weight, sizeof(entry->weight));
    const struct surface *s = &l->surface;
    r->points[r->point_count++] = (struct shade_point){
        .position = vec3_add(s->position, vec3_scale(s->geometric, s->offset)),
        .geometric = s->geometric,
        .shading = s->shading,
        .wo = vec3_scale(l->arrival, -1.0f),
        .diffuse = l->diffuse,
        .specular = l->specular,
        .gloss = l->gloss,
        .pixel = l->pixel,
        .cells = l->cells,
        .cell = l->cell,
        .mesh = l->mesh,
        .material = l->material,
        .kind = l->kind,
        .layer = l->layer,
        .behind = l->bounces > 0,
        .x = x,
        .y = y,
    };
    return true;
}

static bool add_leaf(struct row *r, const struct leaf *l, uint32_t x, uint32_t y)
{
    if (l->weight[0] + l->weight[1] + l->weight[2] <= 0.0f)
        return true;
    return l->missed ? add_miss(r, l) : add_point(r, l, x, y);
}

#define RISE 1.0f /* ray offsets: within the pixel, neighbours of a curved surface rise by a seventh of that at most */

/* Whether other rays through the pixel of a centre sample meet its plane where its surface is. */
static bool is_flat(const struct build *b, const struct scratch *s, uint32_t row, uint32_t x, uint32_t y)
{
    const uint32_t width = b->desc->width;
    const struct leaf *own = &s->centres[(size_t)row * width + x];

    for (int k = 0; k < 9 && !own->missed; k++) {
        const int64_t nx = (int64_t)x + k % 3 - 1, ny = (int64_t)y + k / 3 - 1;
        if (nx < 0 || ny < 0 || nx >= width || ny >= b->desc->height)
            continue;
        const struct leaf *other = &s->centres[(size_t)((int64_t)row + k / 3 - 1) * width + (size_t)nx];
        if (!other->missed && !leaf_level(own, other, RISE))
            return false;
    }
    return true;
}

/* Builds a row of pixels. entry_first and miss_first receive counts within the row; prefix sums are computed later.
 */
static bool build_row(struct build *b, struct scratch *s, uint32_t in_band, uint32_t y)
{
    const uint32_t width = b->desc->width;
    struct row *r = &s->draft;

    r->point_count = r->miss_count = r->edge_pixels = 0;
    r->count = b->rows[y].count; /* of its centre samples */
    for (uint32_t x = 0; x < width; x++) {
        const size_t pixel = (size_t)y * width + x;
        const uint32_t points = r->point_count, misses = r->miss_count;
        const bool edge = is_edge(b, s, in_band, x, y);
        const size_t centre = (size_t)in_band * width + x;
        struct sighting found = { .uneven = s->uneven[centre] };
        uint32_t n;
        if (s->glow)
            memcpy(found.glow, s->glow + 3 * centre, sizeof(found.glow));
        if (edge) {
            n = trace_edge(b, s, x, y, found.glow, &r->count);
            r->edge_pixels++;
        } else if (found.uneven) {
            n = trace(b, x + 0.5, y + 0.5, 1, false, s->leaves, &found, &r->count);
        } else {
            if (b->sight.lamps && b->side >= 2 && glow_varies(b, s, in_band, x, y))
                (void)trace_edge(b, s, x, y, found.glow, &r->count); /* the leaf stays that of the centre */
            s->leaves[0] = s->centres[(size_t)in_band * width + x];
            if (!is_flat(b, s, in_band, x, y))
                s->leaves[0].pixel = 0.0f;
            n = 1;
        }
        const double turn = 0.75487766624669276 * x + 0.56984029099805327 * y; /* powers of the plastic number */
        leaves_thin(s->leaves, turn - floor(turn), &n);
        for (uint32_t i = 0; i < n; i++) {
            if (!add_leaf(r, &s->leaves[i], x, y))
                return false;
        }
        if (b->g->glow)
            memcpy(b->g->glow + 3 * pixel, found.glow, sizeof(found.glow));
        b->g->entry_first[pixel + 1] = r->point_count - points;
        b->g->miss_first[pixel + 1] = r->miss_count - misses;
    }
    return true;
}

static void slab_release(struct slab *slab)
{
    if (slab && --slab->holders == 0)
        mem_free(slab);
}

/* Ensures `bytes` more in the thread's slab, or starts a new one. */
static bool slab_reserve(struct slab **slab, size_t bytes)
{
    if (*slab && (*slab)->size - (*slab)->used >= bytes)
        return true;
    const size_t least = SLAB_BYTES - sizeof(**slab), size = bytes > least ? bytes : least;
    struct slab *fresh = mem_alloc_raw(1, sizeof(*fresh) + size);
    if (!fresh)
        return false;
    *fresh = (struct slab){ .size = size, .holders = 1 };
    slab_release(*slab);
    *slab = fresh;
    return true;
}

static size_t aligned(size_t bytes)
{
    return (bytes + MEM_ALIGN - 1) / MEM_ALIGN * MEM_ALIGN;
}

static void *slab_copy(struct slab *slab, const void *from, size_t bytes)
{
    void *to = (char *)(slab + 1) + slab->used;

    if (bytes > 0)
        memcpy(to, from, bytes);
    slab->used += aligned(bytes);
    return to;
}

/* Copies the draft as row y. */
static bool keep_row(struct build *b, struct scratch *s, uint32_t y)
{
    const struct row *draft = &s->draft;
    const size_t points = draft->point_count * sizeof(*draft->points);
    const size_t entries = draft->point_count * sizeof(*draft->entries);
    const size_t misses = draft->miss_count * sizeof(*draft->misses);
    struct row *r = &b->rows[y];

    if (!slab_reserve(&s->slab, aligned(points) + aligned(entries) + aligned(misses)))
        return false;
    *r = *draft;
    r->slab = s->slab;
    r->slab->holders++;
    r->points = slab_copy(r->slab, draft->points, points);
    r->entries = slab_copy(r->slab, draft->entries, entries);
    r->misses = slab_copy(r->slab, draft->misses, misses);
    return true;
}

static uint64_t row_bytes(const struct row *r)
{
    return r->point_count * (sizeof(struct shade_point) + sizeof(struct gbuffer_entry) + PACKING_BYTES) +
           r->miss_count * sizeof(struct gbuffer_miss);
}

static void build_band(struct build *b, struct scratch *s, uint32_t band)
{
    const uint32_t width = b->desc->width, height = b->desc->height;
    const uint32_t from = band * BAND_ROWS, to = from + BAND_ROWS < height ? from + BAND_ROWS : height;

    /* Scratch row k is image row from - 1 + k. */
    for (uint32_t k = from == 0; k <= to - from + 1 && from + k <= height; k++) {
        const uint32_t y = from + k - 1;
        trace_centres(b, y, s->centres + (size_t)k * width, s->uneven + (size_t)k * width,
                      s->glow ? s->glow + 3 * (size_t)k * width : NULL, s->leaves,
                      &b->rows[y < from ? from
                               : y < to ? y
                                        : to - 1]
                           .count);
    }
    for (uint32_t y = from; y < to; y++) {
        if (!build_row(b, s, y - from + 1, y) || !keep_row(b, s, y)) {
            b->failed = true;
            return;
        }
        atomic_fetch_add(&b->bytes, row_bytes(&b->rows[y]));
        progress_step(b->desc->progress, 1);
    }
}

/* Number of centre samples of a band and its neighbouring rows. */
static size_t centre_count(const struct gbuffer_desc *d)
{
    return ((d->height < BAND_ROWS ? d->height : BAND_ROWS) + 2) * (size_t)d->width;
}

static bool scratch_init(struct scratch *s, const struct gbuffer_desc *d, uint32_t side, bool lamps)
{
    const size_t leaves = (size_t)side * side * LEAF_MAX, centres = centre_count(d);

    *s = (struct scratch){
        .centres = mem_alloc(centres, sizeof(*s->centres)),
        .uneven = mem_alloc(centres, sizeof(*s->uneven)),
        .glow = lamps ? mem_alloc(centres, 3 * sizeof(*s->glow)) : NULL,
        .leaves = mem_alloc(leaves, sizeof(*s->leaves)),
        .links = mem_alloc(leaves, sizeof(*s->links)),
    };
    return s->centres && s->uneven && (s->glow || !lamps) && s->leaves && s->links;
}

/* Without the draft, which is one row among thousands. */
static uint64_t scratch_bytes(const struct gbuffer_desc *d, uint32_t side, bool lamps)
{
    return centre_count(d) * (sizeof(struct leaf) + 1 + (lamps ? 3 * sizeof(float) : 0)) +
           (uint64_t)side * side * LEAF_MAX * (sizeof(struct leaf) + sizeof(struct leaf_link));
}

static void scratch_finish(struct scratch *s)
{
    mem_free(s->centres);
    mem_free(s->uneven);
    mem_free(s->glow);
    mem_free(s->leaves);
    mem_free(s->links);
    mem_free(s->draft.points);
    mem_free(s->draft.entries);
    mem_free(s->draft.misses);
    slab_release(s->slab);
}

static void build_bands(struct build *b)
{
    const int bands = (int)((b->desc->height + BAND_ROWS - 1) / BAND_ROWS);

#pragma omp parallel
    {
        struct scratch s;
        atomic_fetch_add(&b->bytes, scratch_bytes(b->desc, b->side, b->sight.lamps));
        if (!scratch_init(&s, b->desc, b->side, b->sight.lamps))
            b->failed = true;
#pragma omp for schedule(dynamic)
        for (int band = 0; band < bands; band++) {
            if (!b->failed && b->bytes <= b->max_bytes)
                build_band(b, &s, (uint32_t)band);
        }
        scratch_finish(&s);
    }
}

/* Converts counts to prefix sums, first[0] = 0; returns the total. */
static uint64_t prefix_sum(uint32_t *first, size_t count)
{
    uint64_t sum = 0;

    for (size_t i = 0; i < count; i++) {
        sum += first[i + 1];
        first[i + 1] = (uint32_t)sum;
    }
    return sum;
}

/* Concatenates the rows in the G-buffer's arrays. Each row is freed at once, and the new arrays are committed only when
 * written, so that both never exist in full. */
static enum err join_rows(struct build *b, struct packing *p)
{
    struct gbuffer *g = b->g;
    const size_t pixels = (size_t)g->width * g->height;

    g->packets = mem_alloc_raw(g->packet_count, sizeof(*g->packets));
    g->entries = mem_alloc_raw(g->entry_first[pixels], sizeof(*g->entries));
    g->misses = mem_alloc_raw(g->miss_first[pixels], sizeof(*g->misses));
    if (!g->packets || !g->entries || !g->misses)
        return ERR_NOMEM;
    for (uint32_t y = 0; y < g->height; y++) {
        struct row *r = &b->rows[y];
        const uint32_t first = g->entry_first[(size_t)y * g->width];
        packing_put(p, r, first, &b->view, g->packets);
        for (uint32_t i = 0; i < r->point_count; i++) {
            g->entries[first + i] = r->entries[i];
            g->entries[first + i].point = p->slots[first + i];
        }
        if (r->miss_count > 0)
            memcpy(g->misses + g->miss_first[(size_t)y * g->width], r->misses, r->miss_count * sizeof(*g->misses));
        slab_release(r->slab);
        r->slab = NULL;
    }
    return ERR_OK;
}

static void add_counts(struct build *b)
{
    for (uint32_t y = 0; y < b->g->height; y++) {
        b->g->edge_pixels += b->rows[y].edge_pixels;
        b->g->camera_rays += b->rows[y].count.rays;
        b->g->cut_weight += b->rows[y].count.cut;
    }
}

static enum err too_large(const struct build *b, struct reason *why)
{
    return err_say(
        why, ERR_RANGE,
        "G-buffer of %u x %u pixels: more than the allowed %.1f GiB: use a smaller --size or fewer --edge-rays",
        b->desc->width, b->desc->height, (double)b->max_bytes / 1073741824.0);
}

static enum err finish(struct build *b, struct reason *why)
{
    struct gbuffer *g = b->g;
    struct packing packing;
    const size_t pixels = (size_t)g->width * g->height;
    const uint64_t point_count = prefix_sum(g->entry_first, pixels);
    const uint64_t miss_count = prefix_sum(g->miss_first, pixels);

    if (point_count > UINT32_MAX - 4 * PACKET || miss_count > UINT32_MAX)
        return too_large(b, why);
    enum err e = packing_init(&packing, b->rows, g->height, (uint32_t)point_count);
    if (e)
        return e;
    g->point_count = point_count;
    g->packet_count = packing.packet_count;
    g->bytes = sizeof(*g) + g->packet_count * sizeof(*g->packets) + point_count * sizeof(*g->entries) +
               miss_count * sizeof(*g->misses) + 2 * (pixels + 1) * sizeof(*g->entry_first) +
               (g->glow ? pixels * 3 * sizeof(*g->glow) : 0);
    if (g->bytes > b->max_bytes)
        e = too_large(b, why);
    else
        e = join_rows(b, &packing);
    add_counts(b);
    packing_finish(&packing);
    return e;
}

static enum err build_all(struct build *b, struct reason *why)
{
    struct gbuffer *g = b->g;
    const size_t pixels = (size_t)g->width * g->height;
    enum err e = ERR_OK;

    /* every pixel needs at least its list offsets and one escape */
    b->bytes = pixels * (2 * sizeof(*g->entry_first));
    if (b->bytes + pixels * sizeof(struct gbuffer_entry) > b->max_bytes)
        return too_large(b, why);
    b->rows = mem_alloc(g->height, sizeof(*b->rows));
    g->entry_first = mem_alloc(pixels + 1, sizeof(*g->entry_first));
    g->miss_first = mem_alloc(pixels + 1, sizeof(*g->miss_first));
    g->glow = b->sight.lamps ? mem_alloc(pixels, 3 * sizeof(*g->glow)) : NULL;
    if (!b->rows || !g->entry_first || !g->miss_first || (b->sight.lamps && !g->glow))
        return ERR_NOMEM;
    build_bands(b);
    if (b->failed)
        e = ERR_NOMEM;
    else if (b->bytes > b->max_bytes)
        e = too_large(b, why);
    else
        e = finish(b, why);
    return e;
}

static void free_rows(struct row *rows, uint32_t count)
{
    for (uint32_t y = 0; rows && y < count; y++)
        slab_release(rows[y].slab);
    mem_free(rows);
}

enum err gbuffer_create(const struct scene *scene, const struct rays *rays, const struct gbuffer_desc *desc,
                        struct gbuffer **out, struct reason *why)
{
    assert(scene && rays && desc && desc->camera);
    *out = NULL;
    if (desc->width < 1 || desc->height < 1 || desc->width > SIDE_MAX || desc->height > SIDE_MAX)
        return err_say(why, ERR_RANGE, "image of %u x %u pixels: each side must be 1 to %u", desc->width, desc->height,
                       SIDE_MAX);
    if (desc->edge_rays > EDGE_RAYS_MAX)
        return err_say(why, ERR_RANGE, "%u camera rays per side of an edge pixel; the limit is %u", desc->edge_rays,
                       EDGE_RAYS_MAX);
    struct build b = {
        .desc = desc,
        .g = mem_alloc(1, sizeof(*b.g)),
        .side = desc->edge_rays ? desc->edge_rays : 4,
        .max_bytes = desc->max_bytes ? desc->max_bytes : UINT64_C(4) << 30,
    };
    if (!b.g)
        return err_say(why, ERR_NOMEM, "out of memory for the G-buffer");
    b.g->width = desc->width;
    b.g->height = desc->height;
    view_init(&b.view, desc->camera, desc->width, desc->height);
    b.g->pixel_angle = (float)b.view.step;
    b.sight = (struct sight){ .scene = scene,
                              .rays = rays,
                              .pixel_angle = b.g->pixel_angle,
                              .lamps = scene_has_lamps(scene),
                              .holes = rays_have_holes(rays) };
    const enum err e = build_all(&b, why);
    free_rows(b.rows, desc->height);
    if (e == ERR_NOMEM)
        err_say(why, e, "out of memory for the G-buffer of %u x %u pixels", desc->width, desc->height);
    if (e)
        gbuffer_destroy(b.g);
    else
        *out = b.g;
    return e;
}

void gbuffer_destroy(struct gbuffer *g)
{
    if (!g)
        return;
    mem_free(g->packets);
    mem_free(g->entry_first);
    mem_free(g->entries);
    mem_free(g->miss_first);
    mem_free(g->misses);
    mem_free(g->glow);
    mem_free(g);
}
