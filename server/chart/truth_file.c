#include "chart/truth_file.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

struct head {
    char magic[8];
    uint32_t width, height, parts, reserved;
    uint64_t key[2];
    uint64_t check[2]; /* digest of what is above and of the sum */
};

static const char magic[8] = { 'R', 'L', 'T', 'R', 'U', 'T', 'H', '1' };

static size_t bytes_of(const struct truth_sum *sum)
{
    return 3 * sizeof(double) * (size_t)sum->width * sum->height;
}

static void seal(const struct head *h, const double *rgb, size_t size, uint64_t check[2])
{
    struct digest d = { { 0 } };

    digest_bytes(&d, h, offsetof(struct head, check));
    digest_bytes(&d, rgb, size);
    memcpy(check, d.half, sizeof(d.half));
}

static enum err read_file(FILE *f, const char *path, const struct digest *key, struct truth_sum *sum,
                          struct reason *why)
{
    struct head h;
    uint64_t check[2];

    if (fread(&h, sizeof(h), 1, f) != 1)
        return err_say(why, ERR_FORMAT, "%s: cut short within its head", path);
    if (memcmp(h.magic, magic, sizeof(magic)) != 0)
        return err_say(why, ERR_FORMAT, "%s: is no reference of this program", path);
    if (h.width != sum->width || h.height != sum->height || memcmp(h.key, key->half, sizeof(h.key)) != 0)
        return err_say(why, ERR_FORMAT, "%s: holds the reference of something else", path);
    if (fread(sum->rgb, bytes_of(sum), 1, f) != 1)
        return err_say(why, ERR_FORMAT, "%s: cut short", path);
    if (fgetc(f) != EOF)
        return err_say(why, ERR_FORMAT, "%s: has more bytes than it should", path);
    seal(&h, sum->rgb, bytes_of(sum), check);
    if (memcmp(check, h.check, sizeof(check)) != 0)
        return err_say(why, ERR_FORMAT, "%s: is damaged, its checksum does not agree", path);
    sum->parts = h.parts;
    return ERR_OK;
}

enum err truth_file_load(const char *path, const struct digest *key, struct truth_sum *sum, struct reason *why)
{
    FILE *f = fopen(path, "rb");

    sum->parts = 0;
    memset(sum->rgb, 0, bytes_of(sum));
    if (!f && errno == ENOENT)
        return ERR_END;
    if (!f)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    const enum err e = read_file(f, path, key, sum, why);
    fclose(f);
    if (e)
        memset(sum->rgb, 0, bytes_of(sum));
    return e;
}

enum err truth_file_store(const char *path, const struct digest *key, const struct truth_sum *sum, struct reason *why)
{
    const size_t size = bytes_of(sum);
    struct head h = { .width = sum->width, .height = sum->height, .parts = sum->parts };
    uint8_t *bytes = mem_alloc(sizeof(h) + size, 1);

    if (!bytes)
        return err_say(why, ERR_NOMEM, "%s: no memory to write it", path);
    memcpy(h.magic, magic, sizeof(magic));
    memcpy(h.key, key->half, sizeof(h.key));
    seal(&h, sum->rgb, size, h.check);
    memcpy(bytes, &h, sizeof(h));
    memcpy(bytes + sizeof(h), sum->rgb, size);
    const enum err e = file_store(path, bytes, sizeof(h) + size, why);
    mem_free(bytes);
    return e;
}
