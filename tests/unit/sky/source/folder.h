/* A folder of one test's own, with files in it; removed with all that it holds. */
#pragma once

#include "support/unit.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

struct folder {
    char path[64];
    char joined[8][1024]; /* what folder_path gave out, the last eight */
    unsigned turn;
};

static inline void folder_make(struct folder *f)
{
    *f = (struct folder){ .turn = 0 };
    snprintf(f->path, sizeof(f->path), "/tmp/relight-source-XXXXXX");
    assert_non_null(mkdtemp(f->path));
}

static inline const char *folder_path(struct folder *f, const char *name)
{
    char *joined = f->joined[f->turn++ % 8];
    const size_t n = strlen(f->path), m = strlen(name);

    assert_true(n + 1 + m < sizeof(f->joined[0]));
    memcpy(joined, f->path, n);
    joined[n] = '/';
    memcpy(joined + n + 1, name, m + 1);
    return joined;
}

static inline void folder_put_bytes(struct folder *f, const char *name, const void *bytes, size_t size)
{
    FILE *out = fopen(folder_path(f, name), "wb");
    assert_non_null(out);
    assert_int_equal(fwrite(bytes, 1, size, out), size);
    assert_int_equal(fclose(out), 0);
}

static inline void folder_put(struct folder *f, const char *name, const char *text)
{
    folder_put_bytes(f, name, text, strlen(text));
}

/* One level: folders inside must be empty. */
static inline void folder_remove(struct folder *f)
{
    DIR *d = opendir(f->path);

    for (const struct dirent *e = d ? readdir(d) : NULL; e; e = readdir(d))
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0)
            remove(folder_path(f, e->d_name));
    if (d)
        closedir(d);
    rmdir(f->path);
}
