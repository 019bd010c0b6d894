/* What controllers have set, kept in a file of its own (--state DIR), so that it comes back after a crash or a restart.
 * The file is a control message of PROTOCOL.md 4.13, and goes through the same checks as one from the network; beside
 * it stands, under "said", what the command line said then. When that has changed, who changed it wants what it says
 * now. */
#include "relightd.h"

#include "clock.h"
#include "file_store.h"
#include "log.h"
#include "mem.h"
#include "message.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define STATE_VERSION 1
#define STATE_MOST 65536 /* bytes */
#define AGAIN_S 10.0     /* after a file that could not be written */

/* The settings as fields of a control message; NULL when out of memory. Whether the source is held is left out: a
 * server that comes back is to show something. */
static json_t *fields_of(const struct settings *s)
{
    struct server_control c;

    daemon_describe(s, &c);
    char *text = message_control_shared(&c);
    json_t *all = text ? json_loads(text, 0, NULL) : NULL;
    message_free(text);
    if (!all)
        return NULL;
    if (!c.counted)
        json_object_set_new(all, "samples", json_null());
    json_object_del(all, "counted");
    json_object_del(all, "paused");
    return all;
}

/* What the command line said; the camera is that of the scene where it said none. */
static json_t *said_of(const struct daemon *d)
{
    struct settings said = d->said;

    snprintf(said.camera, sizeof(said.camera), "%s", d->first_set->camera);
    json_t *all = fields_of(&said);
    if (all)
        json_object_set_new(all, "scene", json_string(d->set_desc.scene ? d->set_desc.scene : ""));
    return all;
}

/* The whole file's text, of mem_alloc's; NULL when out of memory. */
static char *text_of(struct daemon *d)
{
    const struct settings now = daemon_settings(d);
    json_t *all = fields_of(&now);
    char *text = NULL;

    if (all && json_object_set_new(all, "op", json_string("control")) == 0 &&
        json_object_set_new(all, "state", json_integer(STATE_VERSION)) == 0 &&
        json_object_set_new(all, "said", said_of(d)) == 0) {
        const size_t size = json_dumpb(all, NULL, 0, JSON_INDENT(2) | JSON_SORT_KEYS);
        text = mem_alloc(size + 2, 1);
        if (text) {
            json_dumpb(all, text, size, JSON_INDENT(2) | JSON_SORT_KEYS);
            text[size] = '\n';
        }
    }
    json_decref(all);
    return text;
}

/* NULL and ERR_OK: there is none. */
static enum err read_file(const char *path, char **out, struct reason *why)
{
    FILE *in = fopen(path, "re");

    *out = NULL;
    if (!in)
        return errno == ENOENT ? ERR_OK : err_say(why, ERR_IO, "cannot be read: %s", strerror(errno));
    char *text = mem_alloc(STATE_MOST + 1, 1);
    const size_t size = text ? fread(text, 1, STATE_MOST + 1, in) : 0;
    const bool failed = ferror(in) != 0;
    fclose(in);
    if (text && !failed && size <= STATE_MOST && strlen(text) == size) {
        *out = text;
        return ERR_OK;
    }
    mem_free(text);
    if (!text)
        return err_say(why, ERR_NOMEM, "no memory to read it");
    return err_say(why, ERR_FORMAT, failed ? "cannot be read" : "is no text of at most %d bytes", STATE_MOST);
}

/* Puts what the file says into force, or says why not. */
static enum err take(struct daemon *d, const char *text, bool *stale, struct reason *why)
{
    struct fault fault = { .code = FAULT_NONE };
    struct message m;
    json_error_t error;
    json_t *all = json_loads(text, JSON_REJECT_DUPLICATES, &error), *said = NULL;
    enum err e = ERR_OK;

    *stale = false;
    if (!all)
        return err_say(why, ERR_FORMAT, "line %d: %s", error.line, error.text);
    if (json_integer_value(json_object_get(all, "state")) != STATE_VERSION || !json_object_get(all, "said"))
        e = err_say(why, ERR_FORMAT, "it is no state of version %d", STATE_VERSION);
    if (!e) {
        said = said_of(d);
        *stale = said && !json_equal(said, json_object_get(all, "said"));
        json_object_del(all, "said");
    }
    if (!e && !*stale) {
        char *compact = json_dumps(all, JSON_COMPACT);
        if (!compact)
            e = err_say(why, ERR_NOMEM, "no memory to read it");
        else if (message_parse(compact, strlen(compact), &m, &fault) || m.op != MESSAGE_CONTROL)
            e = err_say(why, ERR_FORMAT, "%s", fault.code ? fault.text : "it is no control message");
        else
            e = daemon_apply(d, &m.control, why);
        free(compact);
    }
    json_decref(said);
    json_decref(all);
    return e;
}

void daemon_state_open(struct daemon *d)
{
    struct reason why = { "" };
    bool stale = false;

    if (!d->state_dir)
        return;
    snprintf(d->state_file, sizeof(d->state_file), "%s/state.json", d->state_dir);
    if ((mkdir(d->state_dir, 0700) != 0 && errno != EEXIST) || access(d->state_dir, W_OK | X_OK) != 0)
        log_warning("--state %s: cannot be written to: %s; what is set now will not come back", d->state_dir,
                    strerror(errno));
    enum err e = read_file(d->state_file, &d->state_text, &why);
    if (!e && d->state_text)
        e = take(d, d->state_text, &stale, &why);
    if (e)
        log_warning("%s: %s; it begins as the command line says", d->state_file, why.text);
    else if (stale)
        log_info("%s: the command line has changed since: it begins as that says", d->state_file);
    else if (d->state_text)
        log_info("%s: what was set before is in force again", d->state_file);
    if (!d->state_text)
        d->state_text = text_of(d); /* nothing to keep until something changes */
}

void daemon_state_keep(struct daemon *d)
{
    struct reason why = { "" };

    if (!d->state_dir || !d->state_text || clock_seconds() < d->state_due_s)
        return;
    char *text = text_of(d);
    if (!text || strcmp(text, d->state_text) == 0) {
        mem_free(text);
        return;
    }
    if (file_store(d->state_file, text, strlen(text), &why)) {
        log_warning("%s", why.text);
        d->state_due_s = clock_seconds() + AGAIN_S;
        mem_free(text);
        return;
    }
    mem_free(d->state_text);
    d->state_text = text;
}

void daemon_state_close(struct daemon *d)
{
    d->state_due_s = 0.0;
    daemon_state_keep(d);
    mem_free(d->state_text);
}
