/* Warnings about elements of the file: the first by name, and the number of the others. */
#include "import/formats/gltf.h"

#include "base/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

void gltf_note(struct gltf_note *n, size_t index)
{
    if (n->count == 0)
        n->first = index;
    else if (n->last == index)
        return;
    n->last = index;
    n->count++;
}

/* "material" of "materials", "mesh" of "meshes" */
static int singular(const char *key)
{
    return (int)strlen(key) - (strcmp(key, "meshes") == 0 ? 2 : 1);
}

void gltf_warn_of(const struct gltf *g, enum gltf_list list, const struct gltf_note *n, const char *format, ...)
{
    const char *scene = g->desc->place, *key = g->lists[list].key;
    char place[128], more[40] = "", text[320];
    va_list args;

    if (n->count == 0)
        return;
    const struct gltf_at first = gltf_element(g, list, n->first);
    const char *name = gltf_string(&first, "name");
    if (name && name[0])
        snprintf(place, sizeof(place), "%.*s \"%.63s\"", singular(key), key, name);
    else
        snprintf(place, sizeof(place), "%s[%zu]", key, n->first);
    if (n->count > 1)
        snprintf(more, sizeof(more), " and %zu more", n->count - 1);
    va_start(args, format);
    vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    log_warning("%s%s%s: %s%s: %s", scene ? scene : "", scene ? ": " : "", g->desc->path, place, more, text);
}
