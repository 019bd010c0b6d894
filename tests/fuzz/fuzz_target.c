/* A target of --publish is parsed, or refused with what would be right; what is displayed of it is plain text without
 * user name and password. */
#include "harness.h"

#include "net/publish/publish.h"

#include <jansson.h>
#include <string.h>

/* What follows scheme://, or the last @ before the path. */
static const char *host_of(const char *url)
{
    const char *host = strstr(url, "://") + 3;

    for (const char *p = host; *p && !strchr("/?", *p); p++)
        if (*p == '@')
            host = p + 1;
    return host;
}

static void check_name(const struct publish_target *t)
{
    json_t *name = json_string(t->name);

    require(name != NULL, "a name in UTF-8");
    json_decref(name);
    require(strpbrk(t->name, "\"\\\n\r\t\x7f\x1b") == NULL, "a name that can be a label");
    if (t->kind < PUBLISH_HLS) {
        const char *host = host_of(t->url), *shown = strstr(t->name, "://") + 3;
        for (size_t i = 0; shown[i]; i++)
            require(shown[i] == host[i] || shown[i] == '?', "the host alone, without user and password");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct publish_target t;
    struct reason why = { "" };
    char *url = malloc(size + 1);

    if (!url)
        return 0;
    memcpy(url, bytes, size);
    url[size] = '\0';
    const enum err e = publish_target_parse(url, &t, &why);
    if (e) {
        require(e == ERR_USAGE && strncmp(why.text, "--publish ", 10) == 0, "a reason that begins with the flag");
    } else {
        require(t.url == url, "the target as it was given");
        check_name(&t);
        if (t.kind >= PUBLISH_HLS)
            require(t.folder[0] != '\0' && strstr(url, t.folder) != NULL, "a folder of the target");
        if (t.kind == PUBLISH_RECORD)
            require(t.file_s >= 3.0 && t.file_s <= 86400.0, "files of three seconds to a day");
    }
    free(url);
    return 0;
}
