/* server/relightd_config.c */
#include "relightd_config.h"

#include "log.h"
#include "mem.h"
#include "notify.h"

#include <errno.h>
#include <inttypes.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define TOKEN_BYTES 256

static const char *const token_flags[] = { "token-viewer", "token-controller", "token-producer", "token-metrics" };
#define TOKENS (sizeof(token_flags) / sizeof(token_flags[0]))

/* One reading of everything. */
struct said {
    struct daemon_flags flags;
    struct config *config; /* NULL: no file was named */
    char tokens[TOKENS][TOKEN_BYTES];
    int argc;
    char **argv;
};

static void said_destroy(struct said *s)
{
    if (!s)
        return;
    config_destroy(s->config);
    mem_free(s);
}

/* ---- Tokens in files ---- */

/* The first line of the file. A service manager's own copy of a secret is not ours to complain about. */
static enum err read_token(const char *path, bool complain, char out[TOKEN_BYTES], struct reason *why)
{
    struct stat st;
    FILE *f = fopen(path, "r");

    if (!f)
        return err_say(why, ERR_USAGE, "%s: cannot be read: %s", path, strerror(errno));
    const size_t size = fread(out, 1, TOKEN_BYTES - 1, f);
    const bool more = size == TOKEN_BYTES - 1 && fgetc(f) != EOF;
    if (complain && fstat(fileno(f), &st) == 0 && (st.st_mode & 077))
        log_warning("%s holds a token, and others than its owner may use it (mode %03o): chmod 600", path,
                    (unsigned)st.st_mode & 0777);
    fclose(f);
    out[size] = '\0';
    if (memchr(out, '\0', size))
        return err_say(why, ERR_USAGE, "%s: holds a byte that no token has", path);
    out[strcspn(out, "\r\n")] = '\0';
    if (more || !out[0])
        return err_say(why, ERR_USAGE, "%s: its first line is no token of 1 to %d bytes", path, TOKEN_BYTES - 2);
    return ERR_OK;
}

/* Each token that was not said from the file that was; or, where neither was, from what the service manager keeps for
 * us (LoadCredential= of systemd). */
static enum err take_tokens(struct said *s, struct reason *why)
{
    const char *folder = getenv("CREDENTIALS_DIRECTORY");
    enum err e = ERR_OK;

    for (size_t i = 0; i < TOKENS && !e; i++) {
        struct option_row *row = options_row(&s->flags.options, token_flags[i]);
        char flag[64], path[4096];
        snprintf(flag, sizeof(flag), "%s-file", token_flags[i]);
        const char *file = options_get(&s->flags.options, flag);
        if (file && row->given)
            return err_say(why, ERR_USAGE, "--%s and --%s exclude each other", token_flags[i], flag);
        if (!file && !row->given && folder &&
            snprintf(path, sizeof(path), "%s/%s", folder, token_flags[i]) < (int)sizeof(path) &&
            access(path, R_OK) == 0)
            e = read_token(path, false, s->tokens[i], why);
        else if (file)
            e = read_token(file, true, s->tokens[i], why);
        else
            continue;
        row->given = s->tokens[i];
    }
    return e;
}

/* ---- Reading it all ---- */

/* A daemon of no other use than to find out whether what was said makes sense. */
static enum err try_out(const struct options *o, struct reason *why)
{
    struct daemon *d = mem_alloc(1, sizeof(*d));
    const enum err e = d ? daemon_understand(o, d, why) : err_say(why, ERR_NOMEM, "out of memory");

    mem_free(d);
    return e;
}

/* That key of the file alone, everything else being at its default: so each fault is found, and not the first only. */
static enum err try_key(const struct config *c, size_t index, struct reason *why)
{
    struct said *s = mem_alloc(1, sizeof(*s));
    enum err e;

    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    daemon_flags_init(&s->flags);
    why->text[0] = '\0';
    if (strcmp(config_key(c, index), "config") == 0 || strcmp(config_key(c, index), "check-config") == 0) {
        e = config_blame(c, index, err_say(why, ERR_USAGE, "it belongs on a command line"), why);
        goto done;
    }
    e = config_apply(c, index, &s->flags.options, why);
    if (e)
        goto done; /* it names the place already */
    const char *key = config_key(c, index);
    if (strncmp(key, "token-", 6) == 0 && strcmp(key + strlen(key) - 5, "-file") == 0)
        e = access(options_get(&s->flags.options, key), R_OK) == 0
                ? ERR_OK
                : err_say(why, ERR_USAGE, "%s: cannot be read: %s", options_get(&s->flags.options, key),
                          strerror(errno));
    else
        e = try_out(&s->flags.options, why);
    if (e)
        e = config_blame(c, index, e, why);
done:
    mem_free(s);
    return e;
}

/* Several faults are told one a line in the log, and *why counts them. */
static enum err try_keys(const struct config *c, struct reason *why)
{
    struct reason each, first = { "" };
    enum err e = ERR_OK;
    unsigned count = 0;

    for (size_t i = 0; i < config_count(c); i++) {
        const enum err now = try_key(c, i, &each);
        if (!now)
            continue;
        if (count == 1)
            log_error("%s", first.text);
        if (count >= 1)
            log_error("%s", each.text);
        else
            first = each;
        count++;
        e = e ? e : now;
    }
    if (count == 1)
        *why = first;
    else if (count > 1)
        err_say(why, e, "%s: %u faults", config_name(c), count);
    return e;
}

static enum err take_file(struct said *s, const char *path, struct reason *why)
{
    bool secret = false, done;
    enum err e = config_read(path, &s->config, why);

    if (!e)
        e = try_keys(s->config, why);
    if (e) /* whatever is wrong with it, it is the wrong thing to be told */
        return e == ERR_NOMEM ? e : ERR_USAGE;
    daemon_flags_init(&s->flags);
    for (size_t i = 0; i < config_count(s->config) && !e; i++) {
        const char *key = config_key(s->config, i);
        secret |= strncmp(key, "token-", 6) == 0 && strcmp(key + strlen(key) - 5, "-file") != 0;
        e = config_apply(s->config, i, &s->flags.options, why);
    }
    if (secret && config_is_readable_by_others(s->config))
        log_warning("%s holds tokens, and others than its owner may read it: chmod 600, or token-...-file", path);
    return e ? e : options_parse(&s->flags.options, s->argc, s->argv, &done, why);
}

static enum err said_read(int argc, char **argv, struct said **out, bool *done, struct reason *why)
{
    struct said *s = mem_alloc(1, sizeof(*s));
    enum err e;

    *out = NULL;
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    s->argc = argc;
    s->argv = argv;
    daemon_flags_init(&s->flags);
    e = options_parse(&s->flags.options, argc, argv, done, why);
    if (e || *done)
        goto failed;
    const char *path = options_get(&s->flags.options, "config");
    if (path)
        e = take_file(s, path, why);
    if (!e)
        e = take_tokens(s, why);
    if (e)
        goto failed;
    *out = s;
    return ERR_OK;
failed:
    said_destroy(s);
    return e;
}

/* What all of it means for d. Where each key alone made sense, and the command line alone does, the two together do
 * not. */
static enum err understand(const struct said *s, struct daemon *d, struct reason *why)
{
    const enum err e = daemon_understand(&s->flags.options, d, why);
    struct reason alone;
    bool done;

    if (!e || !s->config)
        return e;
    struct said *line = mem_alloc(1, sizeof(*line));
    if (line) {
        daemon_flags_init(&line->flags);
        if (!options_parse(&line->flags.options, s->argc, s->argv, &done, &alone) &&
            !try_out(&line->flags.options, &alone)) {
            alone = *why;
            err_say(why, e, "%s: %s", config_name(s->config), alone.text);
        }
    }
    mem_free(line);
    return e;
}

/* What can be found out without starting: files that are not there, a source that gives nothing, an address that wants
 * tokens. Each fault is a line in the log. */
static enum err check(const struct said *s, const struct daemon *d, struct reason *why)
{
    const char *name = s->config ? config_name(s->config) : "the command line";
    struct source *source = NULL;
    unsigned count = 0;

    if (d->set_desc.scene && access(d->set_desc.scene, R_OK) != 0 && ++count)
        log_error("scene: %s: cannot be read: %s", d->set_desc.scene, strerror(errno));
    if (!d->push && source_open(&d->source_desc, &source, why) && ++count)
        log_error("source: %s", why->text);
    source_close(source);
    if (server_check(&d->server_desc, why) && ++count)
        log_error("%s", why->text);
    if (count)
        return err_say(why, ERR_USAGE, "%s: %u fault%s", name, count, count == 1 ? "" : "s");
    printf("relightd: %s: ok\n", name);
    return ERR_OK;
}

enum err daemon_read_options(struct daemon *d, int argc, char **argv, bool *done, struct reason *why)
{
    struct said *s = NULL;
    enum err e = said_read(argc, argv, &s, done, why);

    if (e || *done)
        return e;
    d->said_first = d->said_now = s;
    e = understand(s, d, why);
    if (e)
        return e;
    if (options_on(&s->flags.options, "check-config")) {
        *done = true;
        return check(s, d, why);
    }
    if (d->threads)
        omp_set_num_threads((int)d->threads);
    return ERR_OK;
}

void daemon_config_finish(struct daemon *d)
{
    if (d->said_now != d->said_first)
        said_destroy(d->said_now);
    said_destroy(d->said_first);
    d->said_now = d->said_first = NULL;
}

/* ---- Once more, while it runs ---- */

/* What each flag changes that can change. */
enum live {
    LIVE_NOTHING,
    LIVE_SETTINGS, /* as if a controller had asked for it */
    LIVE_QUALITY,
    LIVE_SERVER, /* who may do what, and how much */
};

static enum live live_of(const char *name)
{
    static const struct {
        const char *name;
        enum live live;
    } known[] = {
        { "method", LIVE_SETTINGS },      { "samples", LIVE_SETTINGS },    { "paths", LIVE_SETTINGS },
        { "fps", LIVE_SETTINGS },         { "error", LIVE_SETTINGS },      { "rotate", LIVE_SETTINGS },
        { "scale", LIVE_SETTINGS },       { "tone", LIVE_SETTINGS },       { "quality", LIVE_QUALITY },
        { "host", LIVE_SERVER },          { "behind-proxy", LIVE_SERVER }, { "max-per-address", LIVE_SERVER },
        { "max-frame-mib", LIVE_SERVER },
    };

    if (strncmp(name, "token-", 6) == 0)
        return LIVE_SERVER;
    for (size_t i = 0; i < sizeof(known) / sizeof(known[0]); i++)
        if (strcmp(known[i].name, name) == 0)
            return known[i].live;
    return LIVE_NOTHING;
}

static bool same(const char *a, const char *b)
{
    return a == b || (a && b && strcmp(a, b) == 0);
}

/* TLS neither begins nor ends while it runs, but its files may become others. */
static enum live live_now(const char *name, const char *old, const char *now)
{
    return strncmp(name, "tls-", 4) == 0 && old && now ? LIVE_SERVER : live_of(name);
}

/* Which kinds of what can change have changed, as bits 1 << enum live; the rest is said to need a restart. Tokens are
 * named and not shown. */
static unsigned compare_rows(const struct option_row *rows, const struct said *before)
{
    unsigned changed = 0;

    for (const struct option_row *r = rows; r->name; r++) {
        const char *old = r->name[0] ? options_get(&before->flags.options, r->name) : NULL;
        if (!r->name[0] || same(old, r->given))
            continue;
        const enum live live = live_now(r->name, old, r->given);
        changed |= 1u << live;
        if (strncmp(r->name, "token-", 6) == 0)
            log_info("reload: %s has changed", r->name);
        else if (live == LIVE_NOTHING)
            log_warning("reload: %s stays %s until the next start (now %s)", r->name, old ? old : "unset",
                        r->given ? r->given : "unset");
        else
            log_info("reload: %s is %s (was %s)", r->name, r->given ? r->given : "unset", old ? old : "unset");
    }
    return changed;
}

/* The settings that the file speaks of, and of these the changed ones only: what controllers have set beside stays. */
static void change_settings(struct daemon *d, const struct daemon *to, const struct said *before,
                            const struct said *after)
{
    struct settings s = daemon_settings(d);
    const struct settings *n = &to->said;
#define CHANGED(flag) (!same(options_get(&before->flags.options, flag), options_get(&after->flags.options, flag)))

    if (CHANGED("method") || CHANGED("samples") || CHANGED("error")) {
        s.method = n->method;
        s.samples = n->samples;
        s.counted = n->counted;
        s.error = n->error;
    }
    s.classes = CHANGED("paths") ? n->classes : s.classes;
    s.fps = CHANGED("fps") ? n->fps : s.fps;
    s.rotation_degrees = CHANGED("rotate") ? n->rotation_degrees : s.rotation_degrees;
    s.scale_stops = CHANGED("scale") ? n->scale_stops : s.scale_stops;
    s.tone = CHANGED("tone") ? n->tone : s.tone;
#undef CHANGED
    daemon_set(d, &s);
}

static enum err reload(struct daemon *d, struct daemon *to, struct reason *why)
{
    struct said *s = NULL;
    bool done;
    enum err e = said_read(d->said_first->argc, d->said_first->argv, &s, &done, why);

    if (!e)
        e = understand(s, to, why);
    if (!e)
        e = server_change(d->server, &to->server_desc, why);
    if (e) {
        said_destroy(s);
        return e;
    }
    const unsigned changed = compare_rows(s->flags.rows, d->said_now) | compare_rows(s->flags.light, d->said_now);
    if (changed >> LIVE_SETTINGS & 1)
        change_settings(d, to, d->said_now, s);
    atomic_store(&d->quality, atomic_load(&to->quality));
    if (d->said_now != d->said_first) /* whose strings are in use until the end */
        said_destroy(d->said_now);
    d->said_now = s;
    return ERR_OK;
}

void daemon_reload(struct daemon *d)
{
    struct daemon *to = mem_alloc(1, sizeof(*to));
    struct reason why = { "out of memory" };
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    notify_say("RELOADING=1\nMONOTONIC_USEC=%" PRIu64, (uint64_t)now.tv_sec * 1000000 + (uint64_t)now.tv_nsec / 1000);
    const enum err e = to ? reload(d, to, &why) : ERR_NOMEM;
    if (e)
        log_error("reload: %s; all stays as it was", why.text);
    else
        log_info("reload: done");
    notify_say("READY=1");
    mem_free(to);
}
