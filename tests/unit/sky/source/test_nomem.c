/* Memory runs out while a source is opened and gives its frames. */
#include "support/nomem.h"

#include "image/codec/frame.h"
#include "sky/source/folder.h"
#include "sky/source/source.h"

static enum err play(void *context, struct reason *why)
{
    const struct source_desc desc = { .spec = context };
    struct source *s;
    struct frame f = { 0 };
    enum err e = source_open(&desc, &s, why);

    for (int k = 0; k < 2 && !e; k++)
        e = source_next(s, &f, why);
    frame_finish(&f);
    source_close(s);
    return e;
}

static void files_are_read(void **state)
{
    char pattern[4096];
    struct folder folder;
    (void)state;

    folder_make(&folder);
    for (int k = 0; k < 3; k++) {
        char name[32];
        snprintf(name, sizeof(name), "sky.%d.hdr", k);
        folder_put(&folder, name, "some bytes");
    }
    snprintf(pattern, sizeof(pattern), "%s/sky.%%d.hdr", folder.path);
    nomem_each("a pattern", play, pattern);
    nomem_each("a folder", play, folder.path);
    folder_remove(&folder);
}

static void a_sky_is_computed(void **state)
{
    char spec[] = "sky:";
    (void)state;

    nomem_most = 20;
    nomem_each("a sky", play, spec);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(files_are_read),
    cmocka_unit_test(a_sky_is_computed),
};

UNIT_MAIN(tests)
