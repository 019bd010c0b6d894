#include "base/command.h"

#include "base/log.h"
#include "base/mem.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

struct entry {
    const char *key; /* owned by the JSON object */
    const json_t *value;
    unsigned line;
    char text[32]; /* a number, written as text */
};

struct config {
    char *name;
    json_t *root;
    struct entry *entries;
    size_t count;
    bool others_can_read; /* group or others may read the file */
};

/* ---- Lines ---- */

/* Jansson keeps keys in file order but not their positions. The text is known to be valid JSON by now, so a second scan
 * finds them: the n-th string at depth one that follows a brace or a comma is the n-th key. */
static void find_lines(struct config *c, const char *text, size_t size)
{
    unsigned line = 1, depth = 0;
    bool key_next = false;
    size_t found = 0;

    for (size_t i = 0; i < size; i++) {
        const char x = text[i];
        if (x == '\n') {
            line++;
        } else if (x == '"') {
            if (depth == 1 && key_next && found < c->count)
                c->entries[found++].line = line;
            key_next = false;
            for (i++; i < size && text[i] != '"'; i++)
                i += text[i] == '\\';
        } else if (x == '{' || x == '[') {
            depth++;
            key_next = x == '{';
        } else if (x == '}' || x == ']') {
            depth--;
        } else if (x == ',') {
            key_next = true;
        }
    }
}

/* ---- Reading ---- */

/* The fewest digits that read back as the same number. */
static void write_number(const json_t *value, char *text, size_t size)
{
    if (json_is_integer(value)) {
        snprintf(text, size, "%" JSON_INTEGER_FORMAT, json_integer_value(value));
        return;
    }
    for (int digits = 6; digits <= 17; digits++) {
        snprintf(text, size, "%.*g", digits, json_real_value(value));
        if (strtod(text, NULL) == json_real_value(value))
            return;
    }
}

static enum err list_entries(struct config *c, struct reason *why)
{
    const char *key;
    json_t *value;

    c->entries = mem_alloc(json_object_size(c->root) + 1, sizeof(*c->entries));
    if (!c->entries)
        return err_say(why, ERR_NOMEM, "%s: out of memory", c->name);
    json_object_foreach(c->root, key, value)
    {
        struct entry *e = &c->entries[c->count++];
        e->key = key;
        e->value = value;
        e->line = 1;
        if (json_is_number(value))
            write_number(value, e->text, sizeof(e->text));
    }
    return ERR_OK;
}

enum err config_parse(const char *name, const char *text, size_t size, struct config **out, struct reason *why)
{
    json_error_t fault;
    enum err e = ERR_OK;

    *out = NULL;
    struct config *c = mem_alloc(1, sizeof(*c));
    if (c)
        c->name = mem_text(name);
    if (!c || !c->name) {
        config_destroy(c);
        return err_say(why, ERR_NOMEM, "%s: out of memory", name);
    }
    c->root = json_loadb(text, size, JSON_REJECT_DUPLICATES, &fault);
    if (!c->root)
        e = err_say(why, ERR_FORMAT, "%s:%d: %s", name, fault.line > 0 ? fault.line : 1, fault.text);
    else if (!json_is_object(c->root))
        e = err_say(why, ERR_FORMAT, "%s:1: not a JSON object; expected {\"flag\": value, ...}", name);
    else
        e = list_entries(c, why);
    if (e) {
        config_destroy(c);
        return e;
    }
    find_lines(c, text, size);
    *out = c;
    return ERR_OK;
}

enum err config_read(const char *path, struct config **out, struct reason *why)
{
    struct stat st;
    enum err e;

    *out = NULL;
    FILE *f = fopen(path, "rb");
    if (!f)
        return err_say(why, ERR_IO, "%s: cannot read the file: %s", path, strerror(errno));
    char *text = mem_alloc(CONFIG_BYTES_MAX + 1, 1);
    if (!text) {
        e = err_say(why, ERR_NOMEM, "%s: out of memory", path);
        goto done;
    }
    const size_t size = fread(text, 1, CONFIG_BYTES_MAX + 1, f);
    if (ferror(f))
        e = err_say(why, ERR_IO, "%s: cannot read the file: %s", path, strerror(errno));
    else if (size > CONFIG_BYTES_MAX)
        e = err_say(why, ERR_RANGE, "%s: larger than %zu bytes, the limit of a configuration file", path,
                    CONFIG_BYTES_MAX);
    else
        e = config_parse(path, text, size, out, why);
    if (!e)
        (*out)->others_can_read = fstat(fileno(f), &st) == 0 && (st.st_mode & (S_IRGRP | S_IROTH));
done:
    mem_free(text);
    fclose(f);
    return e;
}

void config_destroy(struct config *c)
{
    if (!c)
        return;
    json_decref(c->root);
    mem_free(c->entries);
    mem_free(c->name);
    mem_free(c);
}

/* ---- Using ---- */

const char *config_name(const struct config *c)
{
    return c->name;
}

bool config_is_readable_by_others(const struct config *c)
{
    return c->others_can_read;
}

size_t config_count(const struct config *c)
{
    return c->count;
}

const char *config_key(const struct config *c, size_t index)
{
    return c->entries[index].key;
}

/* An array of strings, each as one flag on a command line. */
static enum err apply_list(const struct config *c, const struct entry *entry, struct command *to,
                           struct command_flag *f, struct reason *why)
{
    const json_t *value;
    size_t index;
    enum err e = ERR_OK;

    json_array_foreach(entry->value, index, value)
    {
        if (!json_is_string(value))
            return err_say(why, ERR_USAGE, "%s:%u: %s: expected a string or an array of strings: %s", c->name,
                           entry->line, entry->key, f->row->unit);
        e = command_give(to, f, json_string_value(value), why);
        if (e)
            return err_say(why, e, "%s:%u: %s: more than %d", c->name, entry->line, entry->key, SETTING_TEXTS_MAX);
    }
    return e;
}

enum err config_apply(const struct config *c, size_t index, struct command *to, struct reason *why)
{
    const struct entry *e = &c->entries[index];
    struct command_flag *f = command_flag(to, e->key);

    if (!f)
        return err_say(why, ERR_USAGE, "%s:%u: %s: %s has no such flag", c->name, e->line, e->key, to->name);
    if (f->row->level == SETTING_TUNE && !to->quiet)
        log_warning("%s:%u: %s is a key of tune now: \"tune\": \"%s%s\"", c->name, e->line, e->key, e->key,
                    f->row->unit ? "=..." : "");
    if (!f->row->unit) {
        if (!json_is_boolean(e->value))
            return err_say(why, ERR_USAGE, "%s:%u: %s: is a switch; expected true or false", c->name, e->line, e->key);
        f->given = json_is_true(e->value) ? "1" : NULL;
        return ERR_OK;
    }
    if (f->row->type == SETTING_TEXTS && json_is_array(e->value))
        return apply_list(c, e, to, f, why);
    if (!json_is_string(e->value) && !json_is_number(e->value))
        return err_say(why, ERR_USAGE, "%s:%u: %s: expected a string or %s: %s", c->name, e->line, e->key,
                       f->row->type == SETTING_TEXTS ? "an array of strings" : "a number", f->row->unit);
    const enum err failed = command_give(to, f, json_is_string(e->value) ? json_string_value(e->value) : e->text, why);
    return failed ? config_add_location(c, index, failed, why) : ERR_OK;
}

enum err config_add_location(const struct config *c, size_t index, enum err e, struct reason *why)
{
    const struct entry *entry = &c->entries[index];
    const size_t length = strlen(entry->key);
    const struct reason cause = *why;
    const char *text = cause.text[0] ? cause.text : err_text(e);
    const char *name = strncmp(text, "--tune ", 7) == 0 ? text + 7 : strncmp(text, "--", 2) == 0 ? text + 2 : text;

    if (name > text && strncmp(name, entry->key, length) == 0 && name[length] == ' ')
        text = name + length + 1;
    return err_say(why, e, "%s:%u: %s: %s", c->name, entry->line, entry->key, text);
}
