/* The header of an EXR file from the network: the decoder agrees that every accepted file has one part, scanlines and
 * an allowed compression. */
#include "harness.h"

#include "image/codec/decode.h"

#include <openexr.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct file {
    const uint8_t *bytes;
    size_t size;
};

static int64_t read_bytes(exr_const_context_t ctx, void *user, void *out, uint64_t count, uint64_t offset,
                          exr_stream_error_func_ptr_t fail)
{
    const struct file *f = user;

    (void)ctx;
    (void)fail;
    if (offset >= f->size)
        return 0;
    if (count > f->size - offset)
        count = f->size - offset;
    memcpy(out, f->bytes + offset, (size_t)count);
    return (int64_t)count;
}

static int64_t count_bytes(exr_const_context_t ctx, void *user)
{
    (void)ctx;
    return (int64_t)((const struct file *)user)->size;
}

static void hear(exr_const_context_t ctx, exr_result_t code, const char *text)
{
    (void)ctx;
    (void)code;
    (void)text;
}

/* The library's view of an accepted header. */
static void check_library(const uint8_t *bytes, size_t size)
{
    struct file f = { bytes, size };
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t file;
    exr_compression_t compression;
    exr_storage_t storage;
    int parts;

    init.error_handler_fn = hear;
    init.user_data = &f;
    init.read_fn = read_bytes;
    init.size_fn = count_bytes;
    init.flags = EXR_CONTEXT_FLAG_STRICT_HEADER | EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    if (exr_start_read(&file, "sky", &init) != EXR_ERR_SUCCESS)
        return;
    require(exr_get_count(file, &parts) == EXR_ERR_SUCCESS && parts == 1, "one part");
    require(exr_get_storage(file, 0, &storage) == EXR_ERR_SUCCESS && storage == EXR_STORAGE_SCANLINE, "scanlines");
    require(exr_get_compression(file, 0, &compression) == EXR_ERR_SUCCESS && compression <= EXR_COMPRESSION_ZIP,
            "compression");
    exr_finish(&file);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct reason why = { "" };

    if (exr_policy_check(bytes, size, "sky", &why) == ERR_OK) {
        check_library(bytes, size);
        return 0;
    }
    require(strncmp(why.text, "sky: ", 5) == 0, "a reason has the name");
    for (const char *s = why.text; *s; s++)
        require(*s >= 0x20 && *s < 0x7f, "a reason is one plain line");
    return 0;
}
