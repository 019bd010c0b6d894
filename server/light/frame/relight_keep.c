#include "light/frame/relight_cache.h"

#include "base/log.h"
#include "base/mem.h"
#include "light/cache/cache_file.h"
#include "light/cache/cache_share.h"
#include "light/cache_direct/transport.h"
#include "light/cache_indirect/indirect.h"
#include "scene/geometry/scene_digest.h"

#include <string.h>

void relight_keep_init(struct relight_keep *k, const struct prepared_scene *set, const struct kernels *kernels,
                       const struct relight_desc *desc, const struct transport_desc *transport)
{
    struct reason why;

    const struct cache_view view = { set->file, set->camera, set->view.width, set->view.height };

    *k = (struct relight_keep){ .share = transport->share };
    if (!desc->cache_file)
        return;
    k->key = transport_key(set->gbuffer, set->scene, transport);
    digest_u64(&k->key, (uint64_t)kernels->cpu << 32 | cpu_model()); /* LAPACK has code of its own for each model */
    digest_bytes(&k->key, cache_code, strlen(cache_code));
    if (cache_place_find(&view, desc->cache_file, desc->cache_dir, &k->key, &k->place, &why))
        log_warning("light transport is not kept for the next run: %s", why.text);
}

enum err relight_keep_agree(const struct relight_keep *k, enum err own, bool loaded, bool *all, struct reason *why)
{
    const struct cache_share *s = k->share;
    struct reason unsaid;

    *all = loaded;
    if (!s)
        return own;
    const enum err e = s->agree(s->context, own, why);
    if (!e)
        *all = s->agree(s->context, loaded ? ERR_OK : ERR_END, &unsaid) == ERR_OK;
    return e;
}

/* *out is NULL if there is no file to read. */
static enum err open_file(struct relight_keep *k, struct cache_reader **out, struct reason *why)
{
    enum err e = ERR_OK;

    *out = NULL;
    if (!k->place.path[0] || k->unreadable)
        return ERR_OK;
    if (k->place.folder[0])
        e = cache_folder_check(k->place.folder, why);
    k->unwritable |= e != ERR_OK; /* which is logged once */
    return e ? e : cache_reader_open(k->place.path, out, why);
}

/* Logs why the requested light in a file is not used; returns errors that are not the file's fault. */
static enum err refuse(struct relight_keep *k, enum err e, const char *light, struct reason *why)
{
    if (e == ERR_RANGE || e == ERR_NOMEM)
        return e;
    if (e == ERR_END) { /* a file that holds only the other light is nothing to warn of */
        log_info("%s: holds no %s yet; it is computed", k->place.path, light);
        return ERR_OK;
    }
    k->unreadable = true;
    log_warning("%s; it is computed%s", why->text, k->unwritable ? " and not kept for the next run" : " again");
    return ERR_OK;
}

enum err relight_keep_load(struct relight_keep *k, const struct prepared_scene *set, const struct kernels *kernels,
                           const struct transport_desc *transport, struct transport **out, struct reason *why)
{
    struct cache_reader *r;
    enum err e = open_file(k, &r, why);

    *out = NULL;
    if (!e && !r)
        return ERR_OK;
    if (!e)
        e = transport_load(r, &k->key, set->gbuffer, set->rays, kernels, transport, out, why);
    cache_reader_close(r);
    if (e)
        return refuse(k, e, "direct light", why);
    if (k->place.folder[0])
        cache_folder_touch(k->place.path);
    return ERR_OK;
}

enum err relight_keep_load_indirect(struct relight_keep *k, const struct kernels *kernels,
                                    const struct indirect_desc *desc, struct indirect_cache **out, struct reason *why)
{
    struct cache_reader *r;
    enum err e = open_file(k, &r, why);

    *out = NULL;
    if (!e && !r)
        return ERR_OK;
    if (!e) {
        const struct digest key = indirect_key(&k->key, desc);
        e = indirect_load(r, &key, desc, kernels, out, why);
    }
    cache_reader_close(r);
    return e ? refuse(k, e, "indirect light", why) : ERR_OK;
}

/* Writes `what`, sections begun by `add`, of about so many bytes, if the file is to be kept. */
static void store(struct relight_keep *k, const char *what, uint64_t bytes,
                  void (*add)(const void *context, struct cache_writer *w), const void *context)
{
    struct reason why = { "" };

    if (!k->place.path[0] || k->unwritable || !cache_share_takes_all(k->share))
        return;
    struct cache_writer *file = cache_writer_create();
    enum err e = file ? cache_place_prepare(&k->place, bytes, &why) : err_say(&why, ERR_NOMEM, "no memory");
    if (!e) {
        add(context, file);
        e = cache_writer_store(file, k->place.path, &why);
    }
    cache_writer_destroy(file);
    if (!e)
        log_info("%s: kept in %s", what, k->place.path);
    else
        log_warning("light transport is not kept for the next run: %s", why.text);
    k->unwritable = e != ERR_OK;
}

struct caches { /* what relight_keep_save stores */
    const struct relight_keep *keep;
    const struct transport *direct;
    const struct indirect_cache *indirect;
    const struct indirect_desc *desc;
};

static void add_caches(const void *context, struct cache_writer *w)
{
    const struct caches *c = context;

    if (c->direct)
        transport_save(c->direct, &c->keep->key, w);
    if (c->indirect) {
        const struct digest key = indirect_key(&c->keep->key, c->desc);
        indirect_save(c->indirect, &key, w);
    }
}

void relight_keep_save(struct relight_keep *k, const struct transport *t, const struct indirect_cache *indirect,
                       const struct indirect_desc *desc)
{
    const uint64_t bytes = (t ? transport_stats(t)->bytes : 0) + (indirect ? indirect_stats(indirect)->bytes : 0);
    const struct caches caches = { k, t, indirect, desc };

    store(k,
          !t         ? "indirect light"
          : indirect ? "light transport and indirect light"
                     : "light transport",
          bytes, add_caches, &caches);
}

/* ---- Stored paths ---- */

static const char *const sections[] = { "eye paths 0", "eye paths 1", "caustics" };

void relight_keep_init_paths(struct relight_keep *k, const struct relight_keep *caches,
                             const struct prepared_scene *set, const struct relight_desc *desc,
                             const struct digest *paths)
{
    const struct cache_view view = { set->file, set->camera, set->view.width, set->view.height };
    struct reason why;

    *k = (struct relight_keep){ .share = caches->share, .key = caches->key };
    if (!caches->place.folder[0] || caches->unwritable)
        return;
    digest_bytes(&k->key, paths, sizeof(*paths));
    digest_scene(&k->key, set->scene);
    if (cache_place_find(&view, "", desc->cache_dir, &k->key, &k->place, &why))
        log_warning("stored paths are not kept for the next run: %s", why.text);
}

static enum err load_paths(const struct relight_keep *k, struct cache_reader *r, const struct prepared_scene *set,
                           bool behind, struct relight_paths *p, struct reason *why)
{
    enum err e = ERR_OK;

    for (int i = 0; i < 2 && behind && !e; i++) {
        e = cache_reader_find(r, sections[i], &k->key, why);
        if (!e)
            e = eye_store_load(r, set->gbuffer->packet_count, &p->behind[i], why);
        if (!e)
            e = cache_reader_end(r, why);
    }
    if (!e && p->caustics)
        e = cache_reader_find(r, sections[2], &k->key, why);
    return e || !p->caustics ? e : caustic_store_load(p->caustics, r, why);
}

bool relight_keep_load_paths(struct relight_keep *k, const struct prepared_scene *set, bool behind,
                             struct relight_paths *p)
{
    struct cache_reader *r;
    struct reason why;
    enum err e = open_file(k, &r, &why);

    if (!e && !r)
        return false;
    if (!e)
        e = load_paths(k, r, set, behind, p, &why);
    cache_reader_close(r);
    if (!e) {
        cache_folder_touch(k->place.path);
        log_info("caustics: loaded from %s", k->place.path);
        return true;
    }
    for (int i = 0; i < 2; i++) {
        eye_store_destroy(p->behind[i]);
        p->behind[i] = NULL;
    }
    if (refuse(k, e, "paths of caustics", &why))
        log_warning("%s: %s", k->place.path, why.text);
    return false;
}

struct kept_paths { /* what relight_keep_save_paths stores */
    const struct relight_keep *keep;
    const struct relight_paths *paths;
};

static void add_paths(const void *context, struct cache_writer *w)
{
    const struct kept_paths *c = context;

    for (int i = 0; i < 2; i++)
        if (c->paths->behind[i]) {
            cache_writer_section(w, sections[i], &c->keep->key);
            eye_store_save(c->paths->behind[i], w);
        }
    if (c->paths->caustics) {
        cache_writer_section(w, sections[2], &c->keep->key);
        caustic_store_save(c->paths->caustics, w);
    }
}

void relight_keep_save_paths(struct relight_keep *k, const struct relight_paths *p)
{
    const struct kept_paths all = { k, p };
    uint64_t bytes = p->caustics ? caustic_store_stats(p->caustics)->bytes : 0;

    for (int i = 0; i < 2; i++)
        bytes += p->behind[i] ? eye_store_stats(p->behind[i])->bytes : 0;
    store(k, "caustics", bytes, add_paths, &all);
}

/* ---- The sun's way ---- */

static const char day_section[] = "day"; /* nothing; its key says of which day all is known */

bool relight_keep_load_sun(struct relight_keep *k, struct transport *t, const struct digest *day, bool *whole)
{
    struct cache_reader *r;
    struct reason why, ignored;
    enum err e = open_file(k, &r, &why);

    if (!e && !r)
        return false;
    e = e ? e : transport_load_sun(t, r, &k->key, &why);
    *whole = !e && !cache_reader_find(r, day_section, day, &ignored);
    cache_reader_close(r);
    if (e && refuse(k, e, "way of the sun", &why))
        log_warning("%s: %s", k->place.path, why.text);
    if (!e)
        cache_folder_touch(k->place.path);
    return !e;
}

struct kept_sun { /* what relight_keep_save_sun stores */
    const struct relight_keep *keep;
    const struct digest *day;
    struct transport_sun_copy copy;
};

static void add_sun(const void *context, struct cache_writer *w)
{
    const struct kept_sun *c = context;

    transport_save_sun(&c->copy, &c->keep->key, w);
    cache_writer_section(w, day_section, c->day);
}

void relight_keep_save_sun(struct relight_keep *k, struct transport *t, const struct digest *day)
{
    struct kept_sun all = { .keep = k, .day = day };

    if (k->place.path[0] && !k->unwritable && !transport_copy_sun(t, &all.copy))
        store(k, "the sun's way", all.copy.size, add_sun, &all);
    mem_free(all.copy.bytes);
}
