/* Saves controllers' settings in a file (--state DIR) and restores them after a crash or a restart. The file is a
 * control message of PROTOCOL.md 4.13 and passes the same checks as one from the network. It also contains the saved
 * views and, under "said", the command line's settings at that time. If the command line has changed since, its new
 * values take precedence. */
#include "relightd/daemon/settings.h"

#include "base/clock.h"
#include "base/file_store.h"
#include "base/log.h"
#include "base/mem.h"
#include "relightd/daemon/config.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define STATE_VERSION 1  /* of the file; others are not read */
#define STATE_MOST 65536 /* bytes */
#define AGAIN_S 10.0     /* after a file that could not be written */

/* The settings as fields of a control message; NULL when out of memory. Whether the source is held is left out: a
 * server that comes back is to show something. */
static json_t *settings_fields(struct settings s)
{
    if (!s.counted && s.method == METHOD_AUTO)
        s.samples = 0; /* null */
    return settings_to_json(settings_table, SETTING_KEPT, &s);
}

/* The command line's settings; if it names no camera, the scene's. */
static json_t *initial_fields(const struct state_file *f)
{
    struct settings initial = f->config->setup.initial;

    snprintf(initial.camera, sizeof(initial.camera), "%s", f->default_camera);
    json_t *all = settings_fields(initial);
    if (all)
        json_object_set_new(all, "scene",
                            json_string(f->config->setup.set_desc.scene ? f->config->setup.set_desc.scene : ""));
    return all;
}

/* The saved views by name; NULL when out of memory. */
static json_t *view_fields(struct settings_store *settings)
{
    struct saved_view views[SAVED_VIEWS];
    const unsigned count = settings_views(settings, views);
    json_t *all = json_object();

    for (unsigned i = 0; all && i < count; i++)
        json_object_set_new(all, views[i].name, json_string(views[i].view));
    return all;
}

/* Views belong to their scene, whatever the command line's other settings are. */
static enum err take_views(struct state_file *f, json_t *views, struct reason *why)
{
    const char *name;
    json_t *view;
    enum err e = ERR_OK;

    json_object_foreach(views, name, view) if (!e) e =
        json_is_string(view) && strlen(name) < sizeof(((struct saved_view *)0)->name)
            ? settings_save_view(f->settings, name, json_string_value(view), why)
            : err_say(why, ERR_FORMAT, "'%.80s' is not a saved view", name);
    return e;
}

/* The whole file's text, of mem_alloc's; NULL when out of memory. */
static char *text_of(struct state_file *f)
{
    json_t *all = settings_fields(settings_now(f->settings));
    char *text = NULL;

    if (all && json_object_set_new(all, "op", json_string("control")) == 0 &&
        json_object_set_new(all, "state", json_integer(STATE_VERSION)) == 0 &&
        json_object_set_new(all, "views", view_fields(f->settings)) == 0 &&
        json_object_set_new(all, "said", initial_fields(f)) == 0) {
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
    return err_say(why, ERR_FORMAT, failed ? "cannot be read" : "is not text of at most %d bytes", STATE_MOST);
}

/* Applies the settings in the file, or logs why it does not. stale: the command line has changed since they were
 * written. */
static enum err take(struct state_file *f, const char *text, bool *stale, struct reason *why)
{
    struct server_control c = { .asked = 0 };
    json_error_t error;
    json_t *all = json_loads(text, JSON_REJECT_DUPLICATES, &error), *initial = NULL;
    enum err e = ERR_OK;

    *stale = false;
    if (!all)
        return err_say(why, ERR_FORMAT, "line %d: %s", error.line, error.text);
    const json_t *written = json_object_get(all, "said");
    if (json_integer_value(json_object_get(all, "state")) != STATE_VERSION || !written) {
        e = err_say(why, ERR_FORMAT, "it is not a state file of version %d", STATE_VERSION);
    } else {
        initial = initial_fields(f);
        *stale = initial && !json_equal(initial, written);
    }
    if (!e && json_equal(json_object_get(initial, "scene"), json_object_get(written, "scene")))
        e = take_views(f, json_object_get(all, "views"), why);
    if (!e && !*stale)
        e = settings_from_json(settings_table, FOR_RELIGHTD, all, &c.asked, c.values, &c.clause, why);
    if (!e && !*stale)
        e = settings_apply(f->settings, &c, why);
    json_decref(initial);
    json_decref(all);
    return e;
}

enum err state_check(const char *folder, struct reason *why)
{
    const bool made = mkdir(folder, 0700) == 0;

    if (made)
        rmdir(folder);
    if (made || (errno == EEXIST && access(folder, W_OK | X_OK) == 0))
        return ERR_OK;
    return err_say(why, ERR_IO, "state: %s: cannot be written to: %s; name a folder that this user may write", folder,
                   strerror(errno));
}

void state_open(struct state_file *f, const struct daemon_config *config, struct settings_store *settings,
                const char *default_camera)
{
    struct reason why = { "" };
    bool stale = false;

    if (!config->state_dir)
        return;
    f->config = config;
    f->settings = settings;
    snprintf(f->default_camera, sizeof(f->default_camera), "%s", default_camera);
    snprintf(f->path, sizeof(f->path), "%s/state.json", f->config->state_dir);
    if ((mkdir(f->config->state_dir, 0700) != 0 && errno != EEXIST) || access(f->config->state_dir, W_OK | X_OK) != 0)
        log_warning("--state %s: cannot be written to: %s; settings made now will be lost at the next start",
                    f->config->state_dir, strerror(errno));
    enum err e = read_file(f->path, &f->text, &why);
    if (!e && f->text)
        e = take(f, f->text, &stale, &why);
    if (e)
        log_warning("%s: %s; starting with the command line's settings", f->path, why.text);
    else if (stale)
        log_info("%s: the command line has changed since; starting with its settings", f->path);
    else if (f->text)
        log_info("%s: the previous settings are restored", f->path);
    if (!e && !stale && f->text) /* an image was finished by it, else it would not be in the file */
        atomic_store(&settings->proven, settings_now(settings).light_version);
    if (!f->text)
        f->text = text_of(f); /* nothing to keep until something changes */
}

void state_save(struct state_file *f)
{
    struct reason why = { "" };

    if (!f->config || !f->text || clock_seconds() < f->retry_s ||
        atomic_load(&f->settings->proven) != settings_now(f->settings).light_version)
        return;
    char *text = text_of(f);
    if (!text || strcmp(text, f->text) == 0) {
        mem_free(text);
        return;
    }
    if (file_store(f->path, text, strlen(text), &why)) {
        log_warning("%s", why.text);
        f->retry_s = clock_seconds() + AGAIN_S;
        mem_free(text);
        return;
    }
    mem_free(f->text);
    f->text = text;
}

void state_close(struct state_file *f)
{
    f->retry_s = 0.0;
    state_save(f);
    mem_free(f->text);
}
