/* What Assimp 5.2 takes on trust, checked before it reads the file. */
#include "import/parts.h"

#include "base/mem.h"

#include <inttypes.h>
#include <jansson.h>
#include <string.h>

#define PLY_LINES_MAX 1000
#define PLY_LINE_MAX 1023  /* bytes */
#define NESTING_MAX 256    /* of JSON's brackets, and of nodes */
#define COPIES_MAX 1000000 /* nodes, where those with several parents count as often */
#define GLB_HEAD 20 /* bytes before the JSON text: magic, version, length; the length and kind of the first chunk */

/* ---- PLY ---- */

static bool is_ply_line(const char *line)
{
    static const char *const starts[] = {
        "ply", "format ", "comment", "obj_info", "element ", "property ", "end_header"
    };

    for (size_t i = 0; i < sizeof(starts) / sizeof(starts[0]); i++) {
        if (strncmp(line, starts[i], strlen(starts[i])) == 0)
            return true;
    }
    return false;
}

enum err ply_check(const struct bytes *file, struct reason *why)
{
    size_t at = 0;

    for (int number = 1; number <= PLY_LINES_MAX && at < file->size; number++) {
        char line[PLY_LINE_MAX + 1];
        const size_t left = file->size - at;
        const uint8_t *end = memchr(file->at + at, '\n', left < PLY_LINE_MAX ? left : PLY_LINE_MAX);
        const size_t length = end ? (size_t)(end - (file->at + at)) : left < PLY_LINE_MAX ? left : PLY_LINE_MAX;
        memcpy(line, file->at + at, length);
        line[length] = '\0';
        at += length + 1;
        line[strcspn(line, "\r")] = '\0';
        if (strcmp(line, "end_header") == 0 && end)
            return ERR_OK;
        if (!is_ply_line(line) || !end || strncmp(line, "end_header", 10) == 0)
            return err_say(why, ERR_FORMAT, "line %d is not part of a PLY header", number);
    }
    return err_say(why, ERR_FORMAT, "the PLY header has no end_header");
}

/* ---- glTF ---- */

static uint32_t little(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* The JSON text within the file. Version 1 of .glb has it at the same place. */
static enum err find_json(const struct bytes *file, bool binary, struct bytes *text, struct reason *why)
{
    *text = *file;
    if (!binary)
        return ERR_OK;
    if (file->size < GLB_HEAD || memcmp(file->at, "glTF", 4) != 0)
        return err_say(why, ERR_FORMAT, "is not a binary glTF file, or is cut off");
    const uint64_t length = little(file->at + 12), body = GLB_HEAD + ((length + 3) & ~UINT64_C(3));
    if (length > file->size - GLB_HEAD)
        return err_say(why, ERR_FORMAT, "is cut off: its JSON ends at byte %" PRIu64 " of %zu", GLB_HEAD + length,
                       file->size);
    if (little(file->at + 4) == 2 && body + 8 <= file->size && little(file->at + body) > file->size - body - 8)
        return err_say(why, ERR_FORMAT, "is cut off: its data end at byte %" PRIu64 " of %zu",
                       body + 8 + little(file->at + body), file->size);
    *text = (struct bytes){ file->at + GLB_HEAD, (size_t)length };
    return ERR_OK;
}

/* Assimp's JSON parser and Jansson's descend once per bracket. */
static enum err check_nesting(const struct bytes *text, struct reason *why)
{
    bool quoted = false;
    int depth = 0;

    for (size_t i = 0; i < text->size; i++) {
        const uint8_t c = text->at[i];
        if (c == '\\' && quoted)
            i++;
        else if (c == '"')
            quoted = !quoted;
        else if (!quoted && (c == '[' || c == '{') && ++depth > NESTING_MAX)
            return err_say(why, ERR_RANGE, "byte %zu: JSON nested deeper than %d", i, NESTING_MAX);
        else if (!quoted && (c == ']' || c == '}'))
            depth--;
    }
    return ERR_OK;
}

struct walk { /* over all nodes, parents before children */
    size_t count, *queue;
    uint32_t *parents; /* those that have not been passed */
    uint32_t *depth;   /* of the longest way from a root */
    double *copies;    /* ways from a root */
};

static const json_t *children_of(const json_t *nodes, size_t i)
{
    return json_object_get(json_array_get(nodes, i), "children");
}

static enum err count_parents(struct walk *w, const json_t *nodes, struct reason *why)
{
    for (size_t i = 0; i < w->count; i++) {
        const json_t *children = children_of(nodes, i);
        for (size_t k = 0; k < json_array_size(children); k++) {
            const json_int_t child = json_integer_value(json_array_get(children, k));
            if (child < 0 || (size_t)child >= w->count)
                return err_say(why, ERR_FORMAT, "nodes[%zu] has child %" JSON_INTEGER_FORMAT " of %zu nodes", i, child,
                               w->count);
            w->parents[child]++;
        }
    }
    return ERR_OK;
}

static enum err pass_node(struct walk *w, const json_t *nodes, size_t i, size_t *end, struct reason *why)
{
    const json_t *children = children_of(nodes, i);

    if (w->depth[i] > NESTING_MAX)
        return err_say(why, ERR_RANGE, "nodes nested deeper than %d", NESTING_MAX);
    for (size_t k = 0; k < json_array_size(children); k++) {
        const size_t child = (size_t)json_integer_value(json_array_get(children, k));
        w->copies[child] += w->copies[i];
        if (w->depth[child] < w->depth[i] + 1)
            w->depth[child] = w->depth[i] + 1;
        if (--w->parents[child] == 0)
            w->queue[(*end)++] = child;
    }
    return ERR_OK;
}

static enum err walk_nodes(struct walk *w, const json_t *nodes, struct reason *why)
{
    size_t end = 0;
    double copies = 0.0;

    enum err e = count_parents(w, nodes, why);
    for (size_t i = 0; i < w->count && !e; i++) {
        if (w->parents[i] == 0) {
            w->copies[i] = 1.0;
            w->queue[end++] = i;
        }
    }
    size_t at = 0;
    for (; at < end && !e; at++) {
        copies += w->copies[w->queue[at]];
        e = pass_node(w, nodes, w->queue[at], &end, why);
    }
    if (!e && at < w->count)
        e = err_say(why, ERR_FORMAT, "nodes are their own descendants");
    if (!e && copies > (double)w->count + COPIES_MAX)
        e = err_say(why, ERR_RANGE, "nodes with several parents make %g nodes, more than %d", copies, COPIES_MAX);
    return e;
}

static enum err check_nodes(const json_t *root, struct reason *why)
{
    const json_t *nodes = json_object_get(root, "nodes");
    struct walk w = { .count = json_array_size(nodes) };

    w.queue = mem_alloc(w.count, sizeof(*w.queue));
    w.parents = mem_alloc(w.count, sizeof(*w.parents));
    w.depth = mem_alloc(w.count, sizeof(*w.depth));
    w.copies = mem_alloc(w.count, sizeof(*w.copies));
    const enum err e = w.queue && w.parents && w.depth && w.copies ? walk_nodes(&w, nodes, why) : ERR_NOMEM;
    mem_free(w.queue);
    mem_free(w.parents);
    mem_free(w.depth);
    mem_free(w.copies);
    return e;
}

/* Only the structure matters here: text in another encoding than UTF-8, which Assimp accepts, becomes '?'. Some files
 * pad their JSON with zeros. */
static enum err check_json(const struct bytes *text, struct reason *why)
{
    json_error_t fault;
    char *plain = mem_alloc_raw(text->size, 1);
    if (!plain)
        return ERR_NOMEM;
    const uint8_t *zero = memchr(text->at, 0, text->size);
    const size_t size = zero ? (size_t)(zero - text->at) : text->size;
    for (size_t i = 0; i < size; i++)
        plain[i] = text->at[i] < 0x80 ? (char)text->at[i] : '?';
    json_t *root = json_loadb(plain, size, JSON_ALLOW_NUL, &fault);
    mem_free(plain);
    if (!root && json_error_code(&fault) == json_error_out_of_memory)
        return ERR_NOMEM;
    if (!root)
        return err_say(why, ERR_FORMAT, "line %d, column %d: %.150s", fault.line, fault.column, fault.text);
    const enum err e = check_nodes(root, why);
    json_decref(root);
    return e;
}

enum err gltf_check(const struct bytes *file, bool binary, struct reason *why)
{
    struct bytes text;
    enum err e = find_json(file, binary, &text, why);

    if (!e)
        e = check_nesting(&text, why);
    return e ? e : check_json(&text, why);
}
