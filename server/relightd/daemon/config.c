#include "relightd/daemon/config.h"

#include "base/command.h"
#include "base/mem.h"
#include "base/process.h"
#include "net/access/tls.h"
#include "relightd/daemon/settings.h"

#include <errno.h>
#include <inttypes.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define TOKEN_BYTES 256 /* bounds a file's first line */

static const char *const token_flags[] = { "token-viewer", "token-controller", "token-producer", "token-recorder",
                                           "token-metrics" };
#define TOKENS (sizeof(token_flags) / sizeof(token_flags[0]))
#define SHARED_TOKENS 4 /* the first of them, which --share makes */

/* One reading of everything. */
struct config_reading {
    struct daemon_flags flags;
    struct config *config; /* NULL: no file was named */
    char tokens[TOKENS][TOKEN_BYTES];
    char own_cert[4096], own_key[4096]; /* paths of --tls-self-signed */
    int argc;
    char **argv;
};

static void config_reading_destroy(struct config_reading *s)
{
    if (!s)
        return;
    config_destroy(s->config);
    mem_free(s);
}

/* Flags that hold tokens, or stream keys: their values are not logged. */
static bool is_secret(const char *name)
{
    return strncmp(name, "token-", 6) == 0 || strcmp(name, "publish") == 0;
}

/* ---- Tokens in files ---- */

/* The first line of the file. Permissions of a service manager's copy of a secret are not reported, because we do not
 * control them. */
static enum err read_token(const char *path, bool complain, char out[TOKEN_BYTES], struct reason *why)
{
    struct stat st;
    FILE *f = fopen(path, "r");

    if (!f)
        return err_say(why, ERR_USAGE, "%s: cannot be read: %s", path, strerror(errno));
    const size_t size = fread(out, 1, TOKEN_BYTES - 1, f);
    const bool more = size == TOKEN_BYTES - 1 && fgetc(f) != EOF;
    if (complain && fstat(fileno(f), &st) == 0 && (st.st_mode & 077))
        log_warning("%s holds a token that other users can access (mode %03o): run chmod 600 on it", path,
                    (unsigned)st.st_mode & 0777);
    fclose(f);
    out[size] = '\0';
    if (memchr(out, '\0', size))
        return err_say(why, ERR_USAGE, "%s: contains a byte that tokens cannot have", path);
    out[strcspn(out, "\r\n")] = '\0';
    if (more || !out[0])
        return err_say(why, ERR_USAGE, "%s: its first line is not a token of 1 to %d bytes", path, TOKEN_BYTES - 2);
    return ERR_OK;
}

/* --share DIR stands for these. A flag that is given counts. */
static enum err take_share(struct config_reading *s, struct reason *why)
{
    struct command *c = &s->flags.command;
    const char *dir = command_get(c, "share");
    const bool make = !command_get(c, "check-config");
    enum err e = ERR_OK;
    char path[4096];

    if (!dir)
        return ERR_OK;
    if (!command_given(c, "bind"))
        command_flag(c, "bind")->given = "0.0.0.0";
    if (!command_given(c, "tls-cert") && !command_given(c, "tls-key") && !command_given(c, "tls-self-signed"))
        command_flag(c, "tls-self-signed")->given = dir;
    for (size_t i = 0; i < SHARED_TOKENS && !e; i++) {
        if (command_flag(c, token_flags[i])->given)
            continue;
        e = share_token(dir, token_flags[i], make, path, sizeof(path), why);
        if (!e && access(path, F_OK) == 0)
            e = read_token(path, true, s->tokens[i], why);
        else if (!e) /* what --check-config has instead */
            snprintf(s->tokens[i], sizeof(s->tokens[i]), "%s will be made", token_flags[i]);
        command_flag(c, token_flags[i])->given = s->tokens[i];
    }
    return e;
}

/* Reads each token that is not set directly from its file, or, if neither is set, from the service manager's
 * credentials (LoadCredential= of systemd). */
static enum err take_tokens(struct config_reading *s, struct reason *why)
{
    const char *folder = getenv("CREDENTIALS_DIRECTORY");
    enum err e = ERR_OK;

    for (size_t i = 0; i < TOKENS && !e; i++) {
        struct command_flag *token = command_flag(&s->flags.command, token_flags[i]);
        char flag[64], path[4096];
        snprintf(flag, sizeof(flag), "%s-file", token_flags[i]);
        const char *file = command_get(&s->flags.command, flag);
        if (file && token->given)
            return err_say(why, ERR_USAGE, "--%s and --%s exclude each other", token_flags[i], flag);
        if (!file && !token->given && folder &&
            snprintf(path, sizeof(path), "%s/%s", folder, token_flags[i]) < (int)sizeof(path) &&
            access(path, R_OK) == 0)
            e = read_token(path, false, s->tokens[i], why);
        else if (file)
            e = read_token(file, true, s->tokens[i], why);
        else
            continue;
        token->given = s->tokens[i];
    }
    return e;
}

/* ---- Reading it all ---- */

/* Checks flags without using them. */
static enum err try_out(struct daemon_flags *f, struct reason *why)
{
    struct daemon_config c = { 0 };

    return daemon_config_from_flags(f, &c, why);
}

/* Applies one key of the file with all others at their defaults, so that every fault is found, not only the first. */
static enum err try_key(const struct config *c, size_t index, struct reason *why)
{
    struct config_reading *s = mem_alloc(1, sizeof(*s));
    enum err e;

    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    daemon_flags_init(&s->flags);
    why->text[0] = '\0';
    if (strcmp(config_key(c, index), "config") == 0 || strcmp(config_key(c, index), "check-config") == 0 ||
        strcmp(config_key(c, index), "show-link") == 0) {
        e = config_add_location(c, index, err_say(why, ERR_USAGE, "it works only on the command line"), why);
        goto done;
    }
    e = config_apply(c, index, &s->flags.command, why);
    if (e)
        goto done; /* it names the place already */
    const char *key = config_key(c, index);
    if (strncmp(key, "token-", 6) == 0 && strcmp(key + strlen(key) - 5, "-file") == 0)
        e = access(command_get(&s->flags.command, key), R_OK) == 0
                ? ERR_OK
                : err_say(why, ERR_USAGE, "%s: cannot be read: %s", command_get(&s->flags.command, key),
                          strerror(errno));
    else
        e = try_out(&s->flags, why);
    if (e)
        e = config_add_location(c, index, e, why);
done:
    mem_free(s);
    return e;
}

/* Several faults are logged, one per line, and *why counts them. */
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

static enum err take_file(struct config_reading *s, const char *path, struct reason *why)
{
    bool secret = false, done;
    enum err e = config_read(path, &s->config, why);

    if (!e)
        e = try_keys(s->config, why);
    if (e) /* its own faults are not the ones to report */
        return e == ERR_NOMEM ? e : ERR_USAGE;
    daemon_flags_init(&s->flags);
    s->flags.command.quiet = true; /* the first reading has warned */
    for (size_t i = 0; i < config_count(s->config) && !e; i++) {
        const char *key = config_key(s->config, i);
        secret |= is_secret(key) && strcmp(key + strlen(key) - 5, "-file") != 0;
        e = config_apply(s->config, i, &s->flags.command, why);
    }
    if (secret && config_is_readable_by_others(s->config))
        log_warning("%s holds tokens or stream keys, and other users may read it: run chmod 600 on it, or keep tokens "
                    "in files of their own (token-...-file)",
                    path);
    return e ? e : command_parse(&s->flags.command, s->argc, s->argv, &done, why);
}

static enum err config_reading_create(int argc, char **argv, struct config_reading **out, bool *done,
                                      struct reason *why)
{
    struct config_reading *s = mem_alloc(1, sizeof(*s));
    enum err e;

    *out = NULL;
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    s->argc = argc;
    s->argv = argv;
    daemon_flags_init(&s->flags);
    e = command_parse(&s->flags.command, argc, argv, done, why);
    if (e || *done)
        goto failed;
    const char *path = command_get(&s->flags.command, "config");
    if (path)
        e = take_file(s, path, why);
    if (!e)
        e = take_tokens(s, why);
    if (!e)
        e = take_share(s, why);
    if (e)
        goto failed;
    *out = s;
    return ERR_OK;
failed:
    config_reading_destroy(s);
    return e;
}

/* Translates all settings together for d. If that fails although the command line alone is valid, *why begins with
 * the configuration file's name. */
static enum err understand(struct config_reading *s, struct daemon_config *d, struct reason *why)
{
    const enum err e = daemon_config_from_flags(&s->flags, d, why);
    struct reason alone;
    bool done;

    if (!e || !s->config)
        return e;
    struct config_reading *line = mem_alloc(1, sizeof(*line));
    if (line) {
        daemon_flags_init(&line->flags);
        line->flags.command.quiet = true;
        if (!command_parse(&line->flags.command, s->argc, s->argv, &done, &alone) && !try_out(&line->flags, &alone)) {
            alone = *why;
            err_say(why, e, "%s: %s", config_name(s->config), alone.text);
        }
    }
    mem_free(line);
    return e;
}

/* Checks that are possible without starting: missing files, an empty source, an address that requires tokens. Logs each
 * fault on a line of its own. */
static enum err check(const struct config_reading *s, const struct daemon_config *d, struct reason *why)
{
    const char *name = s->config ? config_name(s->config) : "the command line";
    struct source *source = NULL;
    unsigned count = 0;

    if (d->setup.set_desc.scene && access(d->setup.set_desc.scene, R_OK) != 0 && ++count)
        log_error("scene: %s: cannot be read: %s", d->setup.set_desc.scene, strerror(errno));
    if (!d->push && source_open(&d->setup.source_desc, &source, why) && ++count)
        log_error("source: %s", why->text);
    source_close(source);
    for (uint32_t i = 0; i < d->publish_urls.count; i++)
        if (publish_target_check(&d->publish[i], why) && ++count)
            log_error("%s", why->text);
    if (d->state_dir && state_check(d->state_dir, why) && ++count)
        log_error("%s", why->text);
    if (server_check(&d->server_desc, why) && ++count)
        log_error("%s", why->text);
    if (count)
        return err_say(why, ERR_USAGE, "%s: %u fault%s", name, count, count == 1 ? "" : "s");
    printf("relightd: %s: ok\n", name);
    return ERR_OK;
}

/* The server's own certificate for --tls-self-signed; creates it if necessary. */
static enum err use_own_certificate(struct config_reading *s, struct daemon_config *d, struct reason *why)
{
    struct server_desc *server = &d->server_desc;
    const char *dir = command_get(&s->flags.command, "tls-self-signed");

    if (!dir)
        return ERR_OK;
    if (server->tls_cert || server->tls_key)
        return err_say(why, ERR_USAGE, "--tls-self-signed and --tls-cert exclude each other");
    const enum err e = tls_self_signed(dir, server->public_names, s->own_cert, s->own_key, sizeof(s->own_cert), why);
    server->tls_cert = s->own_cert;
    server->tls_key = s->own_key;
    return e;
}

/* Warns about flags that have no effect in combination with others. */
static void report_ignored(struct command *c, const struct daemon_config *d)
{
    static const struct {
        const char *flag, *other, *why;
        bool given; /* the other flag takes the effect away; else its absence */
    } rows[] = {
        { "decoder", "no-sandbox", "--no-sandbox decodes in this process", true },
        { "decode-seconds", "no-sandbox", "--no-sandbox decodes in this process", true },
        { "h264-mbit", "no-h264", "--no-h264 is given", true },
        { "proxy-address", "behind-proxy", "--behind-proxy is not given", false },
    };

    setup_report_ignored(c, &d->setup);
    for (size_t k = 0; k < sizeof(rows) / sizeof(rows[0]); k++)
        if (command_given(c, rows[k].flag) && command_given(c, rows[k].other) == rows[k].given)
            log_warning("--%s has no effect: %s", rows[k].flag, rows[k].why);
    if (command_given(c, "converge-passes") && !(d->converge.error > 0.0))
        log_warning("--converge-passes has no effect: --converge is off");
    if (command_given(c, "between-delay") && !setup_waits_for_skies(&d->setup))
        log_warning("--between-delay has no effect: the source is a sequence, of which images are exact");
}

enum err daemon_config_read(struct daemon_config *c, struct config_readings *r, int argc, char **argv, bool *done,
                            struct reason *why)
{
    struct config_reading *s = NULL;
    enum err e = config_reading_create(argc, argv, &s, done, why);

    if (e || *done)
        return e;
    r->first = r->latest = s;
    e = understand(s, c, why);
    if (e)
        return e;
    if (command_get(&s->flags.command, "check-config")) {
        *done = true;
        return check(s, c, why);
    }
    e = use_own_certificate(s, c, why);
    if (e)
        return e;
    if (command_get(&s->flags.command, "show-link")) {
        *done = true;
        return links_print(&c->server_desc, stdout, isatty(STDOUT_FILENO) == 1, why);
    }
    report_ignored(&s->flags.command, c);
    share_warn(&c->server_desc);
    c->tells_links =
        command_get(&s->flags.command, "share") && !getenv("JOURNAL_STREAM"); /* they hold tokens: no log */
    if (c->setup.threads)
        omp_set_num_threads((int)c->setup.threads);
    return ERR_OK;
}

void config_readings_finish(struct config_readings *r)
{
    if (r->latest != r->first)
        config_reading_destroy(r->latest);
    config_reading_destroy(r->first);
    *r = (struct config_readings){ 0 };
}

/* ---- Once more, while it runs ---- */

/* The kinds of reloadable settings that have changed, as bits 1 << enum setting_reload; logs others as needing a
 * restart. Tokens are named, not shown. TLS cannot be switched on or off at run time, but its files may change. */
static unsigned compare(const struct config_reading *before, const struct config_reading *after)
{
    const struct command *c = &after->flags.command;
    unsigned changed = 0;

    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *row = c->flags[k].row;
        const struct command_flag *flag = &c->flags[k], *flag_before = &before->flags.command.flags[k];
        const char *name = row->name, *now = flag->given, *old = flag_before->given;
        if (command_flag_equals(flag_before, flag))
            continue;
        const bool certificate = strncmp(name, "tls-", 4) == 0 && old && now;
        const enum setting_reload reload = certificate ? RELOAD_SERVER : row->reload;
        changed |= 1u << reload;
        if (is_secret(name))
            log_info("reload: %s has changed%s", name, reload == RELOAD_NEVER ? "; it stays until the next start" : "");
        else if (reload == RELOAD_NEVER)
            log_warning("reload: %s stays %s until the next start (now %s)", name, old ? old : "unset",
                        now ? now : "unset");
        else
            log_info("reload: %s is %s (was %s)", name, now ? now : "unset", old ? old : "unset");
    }
    return changed;
}

/* The changed settings among those in the file; other settings by controllers are kept. */
static void change_settings(struct settings_store *settings, const struct daemon_config *to,
                            const struct config_reading *before, const struct config_reading *after)
{
    struct settings s = settings_now(settings);
    const struct settings *n = &to->setup.initial;
    const struct command *c = &after->flags.command;
    struct reason why;
    bool effort = false;

    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *row = c->flags[k].row;
        if (row->reload != RELOAD_SETTINGS || command_flag_equals(&before->flags.command.flags[k], &c->flags[k]))
            continue;
        setting_copy(row, &s, n);
        effort |= row->group > 0 || strcmp(row->name, "method") == 0;
    }
    if (effort) { /* which of them counts depends on the others */
        s.method = n->method;
        s.samples = n->samples;
        s.counted = n->counted;
        s.error = n->error;
    }
    if (settings_cost_too_much(settings, &s, &why)) {
        log_error("reload: %s; method, samples and paths do not change", why.text);
        const struct settings now = settings_now(settings);
        s.method = now.method;
        s.samples = now.samples;
        s.counted = now.counted;
        s.classes = now.classes;
        s.error = now.error;
    }
    settings_replace(settings, &s);
}

static enum err reload(struct config_readings *r, struct settings_store *settings, struct server *server,
                       struct reason *why)
{
    struct daemon_config to = { 0 };
    struct config_reading *s = NULL;
    bool done;
    enum err e = config_reading_create(r->first->argc, r->first->argv, &s, &done, why);

    if (!e)
        e = understand(s, &to, why);
    if (!e)
        e = use_own_certificate(s, &to, why);
    if (!e)
        e = server_change(server, &to.server_desc, why);
    if (e) {
        config_reading_destroy(s);
        return e;
    }
    const unsigned changed = compare(r->latest, s);
    if (changed >> RELOAD_SETTINGS & 1)
        change_settings(settings, &to, r->latest, s);
    atomic_store(&settings->jpeg_quality, to.setup.quality);
    if (r->latest != r->first) /* whose strings are in use until the end */
        config_reading_destroy(r->latest);
    r->latest = s;
    return ERR_OK;
}

void daemon_config_reload(struct config_readings *r, struct settings_store *settings, struct server *server)
{
    struct reason why = { "" };
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    notify_send("RELOADING=1\nMONOTONIC_USEC=%" PRIu64, (uint64_t)now.tv_sec * 1000000 + (uint64_t)now.tv_nsec / 1000);
    if (reload(r, settings, server, &why))
        log_error("reload: %s; nothing has changed", why.text);
    else
        log_info("reload: done");
    notify_send("READY=1");
}
