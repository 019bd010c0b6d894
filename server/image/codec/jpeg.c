#include "image/codec/encode.h"

#include "base/mem.h"

#include <assert.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h> /* which jpeglib.h forgets */

#include <jerror.h>
#include <jpeglib.h>

#define SIDE_MAX 65500 /* the library's limit; the format allows 65535 */
#define ROW_ALIGN 64   /* the library's vector loops access whole vectors, in pairs, at the end of a row */
#define ROWS_AT_ONCE 16

struct jpeg_encoder {
    struct jpeg_compress_struct library;
    struct jpeg_error_mgr errors;
    struct jpeg_destination_mgr to;
    jmp_buf failed;
    struct scratch *scratch; /* serves per-image allocations of the library; permanent ones come from the system */
    void *(*own_small)(j_common_ptr, int, size_t);
    void *(*own_large)(j_common_ptr, int, size_t);
    JSAMPARRAY (*own_rows)(j_common_ptr, int, JDIMENSION, JDIMENSION);
    void (*own_free)(j_common_ptr, int);
    bool ready; /* the library's object exists */
    unsigned char *bytes;
    size_t capacity;
};

/* ---- Callbacks of the library ---- */

static void give_up(j_common_ptr c)
{
    struct jpeg_encoder *j = c->client_data;

    longjmp(j->failed, 1);
}

static void say_nothing(j_common_ptr c)
{
    (void)c;
}

static void begin_bytes(j_compress_ptr c)
{
    const struct jpeg_encoder *j = c->client_data;

    c->dest->next_output_byte = j->bytes;
    c->dest->free_in_buffer = j->capacity;
}

static boolean want_more_room(j_compress_ptr c)
{
    ERREXIT(c, JERR_BUFFER_SIZE); /* the buffer holds the worst case */
    return FALSE;
}

static void end_bytes(j_compress_ptr c)
{
    (void)c;
}

static void *take(j_common_ptr c, size_t bytes)
{
    const struct jpeg_encoder *j = c->client_data;
    void *p = scratch_alloc(j->scratch, bytes);

    if (!p)
        ERREXIT1(c, JERR_OUT_OF_MEMORY, 0);
    return p;
}

static void *take_small(j_common_ptr c, int pool, size_t bytes)
{
    const struct jpeg_encoder *j = c->client_data;

    return pool == JPOOL_IMAGE ? take(c, bytes) : j->own_small(c, pool, bytes);
}

static void *take_large(j_common_ptr c, int pool, size_t bytes)
{
    const struct jpeg_encoder *j = c->client_data;

    return pool == JPOOL_IMAGE ? take(c, bytes) : j->own_large(c, pool, bytes);
}

static JSAMPARRAY take_rows(j_common_ptr c, int pool, JDIMENSION width, JDIMENSION rows)
{
    const struct jpeg_encoder *j = c->client_data;
    const size_t pitch = ((size_t)width + ROW_ALIGN - 1) / ROW_ALIGN * ROW_ALIGN;

    if (pool != JPOOL_IMAGE)
        return j->own_rows(c, pool, width, rows);
    JSAMPARRAY row = take(c, rows * sizeof(*row));
    JSAMPROW samples = take(c, rows * pitch * sizeof(*samples));
    for (JDIMENSION y = 0; y < rows; y++)
        row[y] = samples + y * pitch;
    return row;
}

static void free_pool(j_common_ptr c, int pool)
{
    const struct jpeg_encoder *j = c->client_data;

    j->own_free(c, pool);
    if (pool == JPOOL_IMAGE)
        scratch_begin(j->scratch);
}

/* ---- Encoder ---- */

/* Makes the library allocate its per-image memory from `scratch`. */
static void divert_memory(struct jpeg_encoder *j)
{
    struct jpeg_memory_mgr *m = j->library.mem;

    j->own_small = m->alloc_small;
    j->own_large = m->alloc_large;
    j->own_rows = m->alloc_sarray;
    j->own_free = m->free_pool;
    m->alloc_small = take_small;
    m->alloc_large = take_large;
    m->alloc_sarray = take_rows;
    m->free_pool = free_pool;
}

static bool start_library(struct jpeg_encoder *j)
{
    j->library.err = jpeg_std_error(&j->errors);
    j->errors.error_exit = give_up;
    j->errors.output_message = say_nothing;
    j->library.client_data = j;
    if (setjmp(j->failed))
        return false;
    jpeg_create_compress(&j->library);
    j->ready = true;
    divert_memory(j);
    j->to = (struct jpeg_destination_mgr){ .init_destination = begin_bytes,
                                           .empty_output_buffer = want_more_room,
                                           .term_destination = end_bytes };
    j->library.dest = &j->to;
    return true;
}

struct jpeg_encoder *jpeg_encoder_create(void)
{
    struct jpeg_encoder *j = mem_alloc(1, sizeof(*j));
    if (!j)
        return NULL;
    j->scratch = scratch_create();
    if (!j->scratch || !start_library(j)) {
        jpeg_encoder_destroy(j);
        return NULL;
    }
    return j;
}

void jpeg_encoder_destroy(struct jpeg_encoder *j)
{
    if (!j)
        return;
    if (j->ready)
        jpeg_destroy_compress(&j->library);
    scratch_destroy(j->scratch);
    mem_free(j->bytes);
    mem_free(j);
}

/* Reserves the worst case, so that the library never needs more: two bytes per sample of the padded planes and 2048 for
 * the headers, as tjBufSize computes it. */
static enum err reserve(struct jpeg_encoder *j, uint32_t width, uint32_t height, bool whole_chroma)
{
    const size_t block = whole_chroma ? 8 : 16, w = (width + block - 1) / block * block,
                 h = (height + block - 1) / block * block;
    const size_t needed = w * h * (whole_chroma ? 6 : 3) + 2048;

    if (needed <= j->capacity)
        return ERR_OK;
    unsigned char *p = mem_alloc(needed, 1);
    if (!p)
        return ERR_NOMEM;
    mem_free(j->bytes);
    j->bytes = p;
    j->capacity = needed;
    return ERR_OK;
}

static void describe(struct jpeg_compress_struct *c, uint32_t width, uint32_t height, int quality, bool whole_chroma)
{
    c->image_width = width;
    c->image_height = height;
    c->in_color_space = JCS_EXT_RGB;
    c->input_components = 3;
    jpeg_set_defaults(c);
    jpeg_set_quality(c, quality, TRUE);
    jpeg_set_colorspace(c, JCS_YCbCr);
    /* The accurate transform: the fast one saves 3 % of the time at 640x360 and is visible in smooth skies. */
    c->dct_method = JDCT_ISLOW;
    for (int k = 0; k < 3; k++)
        c->comp_info[k].h_samp_factor = c->comp_info[k].v_samp_factor = k == 0 && !whole_chroma ? 2 : 1;
}

static void write_rows(struct jpeg_compress_struct *c, const uint8_t *rgb)
{
    const size_t pitch = 3 * (size_t)c->image_width;

    while (c->next_scanline < c->image_height) {
        JSAMPROW row[ROWS_AT_ONCE];
        const uint32_t left = c->image_height - c->next_scanline, n = left < ROWS_AT_ONCE ? left : ROWS_AT_ONCE;
        for (uint32_t y = 0; y < n; y++)
            row[y] = (JSAMPROW)(uintptr_t)(rgb + (c->next_scanline + y) * pitch); /* the library only reads it */
        jpeg_write_scanlines(c, row, n);
    }
}

enum err jpeg_encode(struct jpeg_encoder *j, const uint8_t *rgb, uint32_t width, uint32_t height, int quality,
                     const uint8_t **bytes, size_t *size)
{
    struct jpeg_compress_struct *const c = &j->library;
    const bool whole_chroma = quality >= 90;

    assert(quality >= 1 && quality <= 100);
    *bytes = NULL;
    *size = 0;
    if (width < 1 || height < 1 || width > SIDE_MAX || height > SIDE_MAX)
        return ERR_RANGE;
    const enum err e = reserve(j, width, height, whole_chroma);
    if (e)
        return e;
    if (setjmp(j->failed)) { /* arguments are checked and the buffer suffices, so only memory can be missing */
        jpeg_abort_compress(c);
        return ERR_NOMEM;
    }
    describe(c, width, height, quality, whole_chroma);
    jpeg_start_compress(c, TRUE);
    write_rows(c, rgb);
    jpeg_finish_compress(c);
    *bytes = j->bytes;
    *size = j->capacity - j->to.free_in_buffer;
    return ERR_OK;
}
