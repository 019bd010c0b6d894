/* The file: chunks of .glb, JSON text, buffers, and URIs. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <inttypes.h>
#include <string.h>
#include <strings.h>

#define NESTING_MAX 256       /* of JSON's brackets */
#define GLB_HEADER 12         /* bytes: magic, version, length */
#define CHUNK_HEADER 8        /* bytes: length, kind */
#define CHUNK_JSON 0x4e4f534a /* "JSON" */
#define CHUNK_BINARY 0x4e4942 /* "BIN" */
#define CONVERT_1_0 "glTF 1.0 is not supported; convert it to 2.0, for instance with 'gltf-pipeline -i IN -o OUT'"

static uint32_t little(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static enum err cut_off(const struct gltf *g, const char *what, uint64_t end)
{
    return gltf_fault(g, NULL, ERR_FORMAT, "is cut off: its %s ends at byte %" PRIu64 " of %zu", what, end,
                      g->file.size);
}

/* The chunk that begins at *pos, which moves behind it. */
static enum err take_chunk(const struct gltf *g, const char *what, uint64_t *pos, uint32_t *kind, struct bytes *out)
{
    if (*pos + CHUNK_HEADER > g->file.size)
        return cut_off(g, what, *pos + CHUNK_HEADER);
    const uint64_t length = little(g->file.at + *pos), begin = *pos + CHUNK_HEADER;
    *kind = little(g->file.at + *pos + 4);
    if (length > g->file.size - begin)
        return cut_off(g, what, begin + length);
    *out = (struct bytes){ g->file.at + begin, (size_t)length };
    *pos = begin + ((length + 3) & ~UINT64_C(3));
    return ERR_OK;
}

static enum err split_glb(struct gltf *g, struct bytes *text)
{
    uint64_t pos = GLB_HEADER;
    uint32_t kind = 0;

    if (g->file.size < GLB_HEADER)
        return cut_off(g, "header", GLB_HEADER);
    const uint32_t version = little(g->file.at + 4);
    if (version == 1)
        return gltf_fault(g, NULL, ERR_UNSUPPORTED, CONVERT_1_0);
    if (version != 2)
        return gltf_fault(g, NULL, ERR_UNSUPPORTED, "is version %" PRIu32 " of the .glb format; expected 2", version);
    enum err e = take_chunk(g, "JSON text", &pos, &kind, text);
    if (!e && kind != CHUNK_JSON)
        e = gltf_fault(g, NULL, ERR_FORMAT, "its first chunk is not JSON text");
    if (!e && pos + CHUNK_HEADER <= g->file.size) {
        e = take_chunk(g, "binary data", &pos, &kind, &g->chunk);
        if (!e && kind != CHUNK_BINARY)
            g->chunk = (struct bytes){ 0 }; /* chunks of other kinds are for others */
    }
    return e;
}

/* Jansson descends once per bracket. */
static enum err check_nesting(const struct gltf *g, const struct bytes *text)
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
            return gltf_fault(g, NULL, ERR_RANGE, "byte %zu: JSON nested deeper than %d", i, NESTING_MAX);
        else if (!quoted && (c == ']' || c == '}'))
            depth--;
    }
    return ERR_OK;
}

static enum err parse_text(struct gltf *g, const char *text, size_t size)
{
    json_error_t fault;

    g->json = json_loadb(text, size, JSON_ALLOW_NUL, &fault);
    if (g->json)
        return ERR_OK;
    if (json_error_code(&fault) == json_error_out_of_memory)
        return ERR_NOMEM;
    return gltf_fault(g, NULL, ERR_FORMAT, "line %d, column %d: %.150s", fault.line, fault.column, fault.text);
}

/* Some files pad their JSON with zeros or begin it with a byte order mark. Names in another encoding than UTF-8 become
 * question marks. */
static enum err parse_json(struct gltf *g, const struct bytes *text)
{
    static const uint8_t mark[3] = { 0xef, 0xbb, 0xbf };
    const uint8_t *zero = memchr(text->at, 0, text->size);
    const size_t size = zero ? (size_t)(zero - text->at) : text->size;
    const size_t skip = size >= sizeof(mark) && memcmp(text->at, mark, sizeof(mark)) == 0 ? sizeof(mark) : 0;
    const enum err e = parse_text(g, (const char *)text->at + skip, size - skip);

    if (e != ERR_FORMAT)
        return e;
    char *plain = mem_alloc_raw(size - skip, 1);
    if (!plain)
        return ERR_NOMEM;
    for (size_t i = skip; i < size; i++)
        plain[i - skip] = text->at[i] < 0x80 ? (char)text->at[i] : '?';
    const enum err again = parse_text(g, plain, size - skip);
    mem_free(plain);
    return again;
}

static enum err check_version(const struct gltf *g)
{
    const struct gltf_at asset = gltf_key(&g->root, "asset");
    const char *version = gltf_string(&asset, "version"), *least = gltf_string(&asset, "minVersion");

    if (!version)
        return gltf_fault(g, &asset, ERR_FORMAT, "has no version; expected \"2.0\"");
    if (strncmp(version, "1.", 2) == 0 || strcmp(version, "1") == 0)
        return gltf_fault(g, &asset, ERR_UNSUPPORTED, CONVERT_1_0);
    if (strncmp(version, "2.", 2) != 0 && strcmp(version, "2") != 0)
        return gltf_fault(g, &asset, ERR_UNSUPPORTED, "version %.20s of glTF is not supported; expected 2.0", version);
    if (least && strcmp(least, "2.0") != 0)
        return gltf_fault(g, &asset, ERR_UNSUPPORTED, "needs a reader of glTF %.20s; expected 2.0", least);
    return ERR_OK;
}

static enum err find_lists(struct gltf *g)
{
    static const char *const keys[GLTF_LISTS] = {
        [GLTF_ACCESSORS] = "accessors",      [GLTF_ANIMATIONS] = "animations", [GLTF_BUFFERS] = "buffers",
        [GLTF_BUFFER_VIEWS] = "bufferViews", [GLTF_CAMERAS] = "cameras",       [GLTF_IMAGES] = "images",
        [GLTF_MATERIALS] = "materials",      [GLTF_MESHES] = "meshes",         [GLTF_NODES] = "nodes",
        [GLTF_SAMPLERS] = "samplers",        [GLTF_SCENES] = "scenes",         [GLTF_SKINS] = "skins",
        [GLTF_TEXTURES] = "textures",
    };

    g->root = (struct gltf_at){ .value = g->json };
    for (int i = 0; i < GLTF_LISTS; i++) {
        g->lists[i] = gltf_key(&g->root, keys[i]);
        g->counts[i] = json_array_size(g->lists[i].value);
    }
    g->buffers = mem_alloc(g->counts[GLTF_BUFFERS], sizeof(*g->buffers));
    g->views = mem_alloc(g->counts[GLTF_BUFFER_VIEWS], sizeof(*g->views));
    return g->buffers && g->views ? ERR_OK : ERR_NOMEM;
}

enum err gltf_parse(struct gltf *g)
{
    struct bytes text = g->file;
    enum err e = ERR_OK;

    if (g->file.size == 0)
        return gltf_fault(g, NULL, ERR_FORMAT, "is empty");
    if (g->file.size >= 4 && memcmp(g->file.at, "glTF", 4) == 0)
        e = split_glb(g, &text);
    if (!e)
        e = check_nesting(g, &text);
    if (!e)
        e = parse_json(g, &text);
    if (!e && !json_is_object(g->json))
        e = gltf_fault(g, NULL, ERR_FORMAT, "is not a JSON object");
    if (!e)
        e = find_lists(g);
    return e ? e : check_version(g);
}

/* ---- URIs ---- */

bool gltf_uri_is_data(const char *uri)
{
    return strncasecmp(uri, "data:", 5) == 0;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

enum err gltf_uri_path(const struct gltf *g, const struct gltf_at *at, const char *uri, char out[HOST_PATH_MAX])
{
    const char *slash = strrchr(g->desc->path, '/');
    size_t n = slash && uri[0] != '/' ? (size_t)(slash - g->desc->path) + 1 : 0;

    if (strstr(uri, "://"))
        return gltf_fault(g, at, ERR_UNSUPPORTED, "'%.100s' is not a relative path; only files are read", uri);
    if (n + strlen(uri) >= HOST_PATH_MAX)
        return gltf_fault(g, at, ERR_RANGE, "the path is too long");
    memcpy(out, g->desc->path, n);
    for (; *uri; uri++) {
        const int high = uri[0] == '%' ? hex_digit(uri[1]) : -1;
        const int low = high >= 0 ? hex_digit(uri[2]) : -1;
        const bool coded = low >= 0 && 16 * high + low != 0;
        out[n++] = coded ? (char)(16 * high + low) : *uri;
        uri += coded ? 2 : 0;
    }
    out[n] = '\0';
    return ERR_OK;
}

static int base64_digit(char c)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *found = c ? strchr(digits, c) : NULL;
    return found ? (int)(found - digits) : -1;
}

enum err gltf_uri_decode(const struct gltf *g, const struct gltf_at *at, const char *uri, struct bytes *out)
{
    const char *comma = strchr(uri, ',');
    int8_t table[256];
    uint32_t bits = 0;
    int held = 0; /* bits */

    *out = (struct bytes){ 0 };
    if (!comma || comma - uri < 7 || strncasecmp(comma - 7, ";base64", 7) != 0)
        return gltf_fault(g, at, ERR_FORMAT, "the data URI is not base64");
    for (int i = 0; i < 256; i++)
        table[i] = (int8_t)base64_digit((char)i);
    const size_t length = strlen(comma + 1);
    out->at = mem_alloc_raw(length / 4 * 3 + 3, 1);
    if (!out->at)
        return ERR_NOMEM;
    for (const char *c = comma + 1; *c && *c != '='; c++) {
        const int digit = table[(uint8_t)*c];
        if (digit < 0) {
            bytes_finish(out);
            return gltf_fault(g, at, ERR_FORMAT, "character %zu of the data is not base64", (size_t)(c - comma));
        }
        bits = bits << 6 | (uint32_t)digit;
        held += 6;
        if (held >= 8) {
            held -= 8;
            out->at[out->size++] = (uint8_t)(bits >> held);
        }
    }
    return ERR_OK;
}

/* ---- Buffers ---- */

static enum err read_file(const struct gltf *g, const struct gltf_at *at, const char *uri, struct bytes *out)
{
    struct reason cause = { "" };
    char path[HOST_PATH_MAX];

    enum err e = gltf_uri_path(g, at, uri, path);
    if (e)
        return e;
    e = host_read(g->desc->host, path, out, &cause);
    return e ? gltf_fault(g, at, e, "%s", cause.text) : ERR_OK;
}

static enum err read_buffer(struct gltf *g, const struct gltf_at *at, size_t index, struct gltf_buffer *b)
{
    const struct gltf_at uri = gltf_key(at, "uri");
    const char *text = json_string_value(uri.value);
    enum err e = ERR_OK;

    if (text && gltf_uri_is_data(text))
        e = gltf_uri_decode(g, &uri, text, &b->owned);
    else if (text)
        e = read_file(g, &uri, text, &b->owned);
    else if (index != 0 || !g->chunk.at)
        e = gltf_fault(g, at, ERR_FORMAT, "has neither a uri nor data in a .glb file");
    if (e)
        return e;
    const struct bytes found = text ? b->owned : g->chunk;
    b->at = found.at;
    e = gltf_size(g, at, "byteLength", found.size, &b->size);
    if (!e && b->size > found.size)
        e = gltf_fault(g, at, ERR_FORMAT, "has %zu bytes, but byteLength is %zu", found.size, b->size);
    return e;
}

enum err gltf_buffer_bytes(struct gltf *g, size_t index, const uint8_t **at, size_t *size)
{
    const struct gltf_at place = gltf_element(g, GLTF_BUFFERS, index);
    struct gltf_buffer *b = &g->buffers[index];

    const enum err e = b->ready ? ERR_OK : read_buffer(g, &place, index, b);
    if (e)
        return e;
    b->ready = true;
    *at = b->at;
    *size = b->size;
    return ERR_OK;
}

/* The bytes that a buffer view, or one of its extensions, names. */
static enum err read_view(struct gltf *g, const struct gltf_at *at, struct gltf_view *v)
{
    const uint8_t *buffer = NULL;
    size_t index, whole = 0, offset = 0;

    enum err e = gltf_index(g, at, "buffer", GLTF_BUFFERS, &index);
    if (!e && index == GLTF_NONE)
        e = gltf_fault(g, at, ERR_FORMAT, "names no buffer");
    if (!e)
        e = gltf_buffer_bytes(g, index, &buffer, &whole);
    if (!e)
        e = gltf_size(g, at, "byteOffset", 0, &offset);
    if (!e)
        e = gltf_size(g, at, "byteLength", 0, &v->size);
    if (!e)
        e = gltf_size(g, at, "byteStride", 0, &v->stride);
    if (!e && (offset > whole || v->size > whole - offset))
        e = gltf_fault(g, at, ERR_FORMAT, "ends at byte %zu of buffers[%zu], which has %zu", offset + v->size, index,
                       whole);
    if (!e)
        v->at = buffer + offset;
    return e;
}

enum err gltf_view_bytes(struct gltf *g, size_t index, struct gltf_view *out)
{
    const struct gltf_at at = gltf_element(g, GLTF_BUFFER_VIEWS, index), packed = gltf_meshopt(&at);
    struct gltf_view *v = &g->views[index];
    enum err e = ERR_OK;

    if (!v->at && packed.value) {
        e = gltf_size(g, &at, "byteStride", 0, &v->stride);
        if (!e)
            e = gltf_meshopt_decode(g, &packed, v);
    } else if (!v->at) {
        e = read_view(g, &at, v);
    }
    *out = *v;
    return e;
}
