#include "light/relight_keep.h"

#include "bounce/file.h"
#include "base/log.h"
#include "transport/file.h"

void relight_keep_init(struct relight_keep *k, const struct set *set, const struct relight_desc *desc,
                       const struct transport_desc *transport)
{
    *k = (struct relight_keep){ .places = { .count = 0 }, .read_only = desc->cache_read_only };
    cache_places_find(set, desc->cache_file, &k->places);
    if (k->places.count > 0)
        k->key = transport_key(set->gbuffer, set->scene, transport);
}

enum err relight_keep_load(const struct relight_keep *k, const struct set *set, const struct kernels *kernels,
                           const struct transport_desc *transport, struct transport **out, struct reason *why)
{
    *out = NULL;
    for (int i = 0; i < k->places.count && !*out; i++) {
        struct cache_reader *r;
        enum err e = cache_reader_open(k->places.path[i], &r, why);
        if (!e && !r)
            continue;
        if (!e)
            e = transport_load(r, &k->key, set->gbuffer, set->rays, kernels, transport, out, why);
        cache_reader_close(r);
        if (e == ERR_RANGE || e == ERR_NOMEM)
            return e;
        if (e)
            log_warning("%s; light transport is not taken from it", why->text);
    }
    return ERR_OK;
}

enum err relight_keep_load_bounce(const struct relight_keep *k, const struct kernels *kernels,
                                  const struct bounce_desc *desc, struct bounce **out, struct reason *why)
{
    const struct digest key = k->places.count > 0 ? bounce_key(&k->key, desc) : (struct digest){ { 0 } };

    *out = NULL;
    for (int i = 0; i < k->places.count && !*out; i++) {
        struct cache_reader *r;
        enum err e = cache_reader_open(k->places.path[i], &r, why);
        if (!e && !r)
            continue;
        if (!e)
            e = bounce_load(r, &key, desc, kernels, out, why);
        cache_reader_close(r);
        if (e == ERR_RANGE || e == ERR_NOMEM)
            return e;
        if (e == ERR_END) /* a file of direct light alone is nothing to warn of */
            log_info("%s; interreflection is computed", why->text);
        else if (e)
            log_warning("%s; interreflection is not taken from it", why->text);
    }
    return ERR_OK;
}

void relight_keep_save(const struct relight_keep *k, const struct transport *t, const struct bounce *bounce,
                       const struct bounce_desc *desc)
{
    struct reason why = { "" };

    if (k->read_only)
        return;
    for (int i = 0; i < k->places.count; i++) {
        struct cache_writer *file = cache_writer_create();
        enum err e = file ? cache_place_prepare(&k->places, i, &why) : err_say(&why, ERR_NOMEM, "no memory");
        if (!e) {
            transport_save(t, &k->key, file);
            if (bounce) {
                const struct digest key = bounce_key(&k->key, desc);
                bounce_save(bounce, &key, file);
            }
            e = cache_writer_store(file, k->places.path[i], &why);
        }
        cache_writer_destroy(file);
        if (!e) {
            log_info("%s: kept in %s", bounce ? "interreflection" : "light transport", k->places.path[i]);
            return;
        }
    }
    if (k->places.count > 0)
        log_warning("light transport is not kept for the next run: %s", why.text);
}
