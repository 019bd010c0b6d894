#include "import/formats/import.h"

#include "base/mem.h"
#include "import/parts/obj_text.h"

#include <assimp/cfileio.h>
#include <assimp/types.h>
#include <string.h>

struct reading { /* one open file */
    struct aiFile file;
    struct bytes bytes;
    bool owned; /* bytes are this file's */
    size_t at;
};

static struct reading *of(struct aiFile *f)
{
    return (struct reading *)(void *)f->UserData;
}

/* As fread. */
static size_t read_file(struct aiFile *f, char *out, size_t size, size_t count)
{
    struct reading *r = of(f);
    const size_t left = size ? (r->bytes.size - r->at) / size : 0, n = count < left ? count : left;

    memcpy(out, r->bytes.at + r->at, n * size);
    r->at += n * size;
    return n;
}

static size_t write_file(struct aiFile *f, const char *bytes, size_t size, size_t count)
{
    (void)f, (void)bytes, (void)size, (void)count;
    return 0;
}

static size_t tell_file(struct aiFile *f)
{
    return of(f)->at;
}

static size_t file_size(struct aiFile *f)
{
    return of(f)->bytes.size;
}

static enum aiReturn seek_file(struct aiFile *f, size_t offset, enum aiOrigin origin)
{
    struct reading *r = of(f);
    const size_t from = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? r->at : r->bytes.size;
    const size_t to = from + offset; /* offset may be a negative number */

    if (to > r->bytes.size)
        return aiReturn_FAILURE;
    r->at = to;
    return aiReturn_SUCCESS;
}

static void flush_file(struct aiFile *f)
{
    (void)f;
}

static void close_file(struct aiFileIO *io, struct aiFile *f)
{
    struct reading *r = of(f);

    (void)io;
    if (r->owned)
        bytes_finish(&r->bytes);
    mem_free(r);
}

static struct aiFile *open_file(struct aiFileIO *io, const char *path, const char *mode)
{
    struct assimp_files *files = (struct assimp_files *)(void *)io->UserData;

    if (mode[0] != 'r')
        return NULL;
    struct reading *r = mem_alloc(1, sizeof(*r));
    if (!r)
        return NULL;
    r->owned = strcmp(path, files->path) != 0;
    r->bytes = *files->model;
    struct reason why = { "" };
    if (r->owned && host_read(files->host, path, &r->bytes, &why)) {
        if (!files->refused.text[0]) /* Assimp may try other names after it */
            files->refused = why;
        mem_free(r);
        return NULL;
    }
    if (r->owned && path_ends_in(path, ".mtl") && mtl_text(&r->bytes, &files->defined)) {
        bytes_finish(&r->bytes);
        mem_free(r);
        return NULL;
    }
    files->others |= r->owned;
    r->file = (struct aiFile){ read_file, write_file, tell_file, file_size, seek_file, flush_file, (aiUserData)r };
    return &r->file;
}

void assimp_files_init(struct assimp_files *files, struct aiFileIO *out)
{
    *out = (struct aiFileIO){ open_file, close_file, (aiUserData)files };
}
