/* A cache file, possibly forged: reading a section stays within its declared size, and damage is reported. */
#include "as_file.h"
#include "harness.h"

#include "light/cache/cache_file.h"

#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    static const char *const names[] = { "transport", "bounce", "view", "one", "two", "" };
    const struct digest key = { { 1, 2 } };
    struct cache_reader *r = NULL;
    struct reason why = { "" };
    uint8_t room[300];
    const char *path = as_file(".tables", bytes, size);

    if (cache_reader_open(path, &r, &why)) {
        require(r == NULL && why.text[0], "a refusal has a reason and no reader");
        return 0;
    }
    for (size_t i = 0; r && i < sizeof(names) / sizeof(names[0]); i++) {
        if (cache_reader_find(r, names[i], &key, &why))
            continue;
        size_t got = 0;
        for (size_t n = 1; cache_reader_get(r, room, n, &why) == ERR_OK; n = n * 2 % 299 + 1) {
            got += n;
            require(got <= size, "a section lies within its file");
        }
        while (cache_reader_get(r, room, 1, &why) == ERR_OK) {
            got++;
            require(got <= size, "no byte behind its end");
        }
        if (cache_reader_end(r, &why))
            require(why.text[0] != 0, "a damage is told");
    }
    if (r)
        require(cache_reader_refuse(r, &why) == ERR_FORMAT && strstr(why.text, path), "a refusal names the file");
    cache_reader_close(r);
    return 0;
}
