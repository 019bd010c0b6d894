/* Sharing of resampling tables between environments. */
#include "base/mem.h"
#include "sky/tables/resample.h"

#include <assert.h>
#include <pthread.h>

struct resample_tables {
    pthread_mutex_t lock;
    struct resample_table *first; /* {lock} tables in use, linked by `next` */
};

struct resample_tables *resample_tables_create(void)
{
    struct resample_tables *s = mem_alloc(1, sizeof(*s));

    if (s)
        pthread_mutex_init(&s->lock, NULL);
    return s;
}

void resample_tables_destroy(struct resample_tables *s)
{
    if (!s)
        return;
    assert(!s->first);
    pthread_mutex_destroy(&s->lock);
    mem_free(s);
}

bool resample_key_equal(const struct resample_key *a, const struct resample_key *b)
{
    return a->layout == b->layout && a->width == b->width && a->height == b->height && a->n == b->n &&
           a->rotation == b->rotation;
}

/* Holds the lock while a table is computed: another user of the same table would have to wait anyway, and two
 * computations would only compete for the same processors. */
enum err resample_table_take(struct resample_tables *s, const struct resample_key *key, struct resample_table **out)
{
    struct resample_table *t;
    enum err e = ERR_OK;

    if (!s)
        return resample_table_create(key, out);
    pthread_mutex_lock(&s->lock);
    for (t = s->first; t && !resample_key_equal(&t->key, key);)
        t = t->next;
    if (!t) {
        e = resample_table_create(key, &t);
        if (!e) {
            t->next = s->first;
            s->first = t;
        }
    }
    if (!e)
        t->users++;
    *out = t;
    pthread_mutex_unlock(&s->lock);
    return e;
}

void resample_table_release(struct resample_tables *s, struct resample_table *t)
{
    if (!s || !t) {
        resample_table_destroy(t);
        return;
    }
    pthread_mutex_lock(&s->lock);
    assert(t->users > 0);
    if (--t->users == 0) {
        struct resample_table **link = &s->first;
        while (*link != t)
            link = &(*link)->next;
        *link = t->next;
        resample_table_destroy(t);
    }
    pthread_mutex_unlock(&s->lock);
}
