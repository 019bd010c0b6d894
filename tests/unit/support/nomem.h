/* Memory that runs out, for tests: the linker hands the allocator's calls of all our objects to the functions below
 * (nomem_test in tests/unit/CMakeLists.txt), which fail the n-th of them, or it and all that follow. Nothing of this is
 * in the programs. What shared libraries allocate for themselves does not come by here, but for Jansson, which takes
 * the functions that it is given.
 *
 * A use of a room is run for n = 1, 2, 3, ... It must end with ERR_NOMEM, or with ERR_OK where it can do without; leave
 * no block behind (each is written down); and succeed the next time. Included once in a program. */
#pragma once

#include "base/err.h"
#include "support/unit.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
void *__real_aligned_alloc(size_t alignment, size_t size);
void __real_free(void *p);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *old, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size);
char *__wrap_strdup(const char *text);
void __wrap_free(void *p);

#define NOMEM_BLOCKS ((size_t)1 << 18)

/* Blocks that are in use, by address: open addressing. What is given up leaves its place marked. */
static void *nomem_blocks[NOMEM_BLOCKS];
static size_t nomem_live;
static pthread_mutex_t nomem_lock = PTHREAD_MUTEX_INITIALIZER;
static atomic_uint nomem_count;    /* calls since nomem_arm */
static atomic_uint nomem_at;       /* the one that fails; 0: none */
static atomic_bool nomem_all;      /* and all after it */
static atomic_uint nomem_failures; /* that there were */
static pthread_t nomem_spared;     /* a thread whose allocations neither count nor fail, */
static bool nomem_spares;          /* if there is one */

#define NOMEM_MARK ((void *)1)

static size_t nomem_place(const void *p)
{
    return ((uintptr_t)p >> 4) * 0x9e3779b97f4a7c15u >> (64 - 18);
}

static void *nomem_note(void *p)
{
    if (!p)
        return NULL;
    pthread_mutex_lock(&nomem_lock);
    size_t i = nomem_place(p);
    while (nomem_blocks[i] && nomem_blocks[i] != NOMEM_MARK)
        i = (i + 1) % NOMEM_BLOCKS;
    nomem_blocks[i] = p;
    nomem_live++;
    pthread_mutex_unlock(&nomem_lock);
    return p;
}

static void nomem_forget(const void *p)
{
    pthread_mutex_lock(&nomem_lock);
    size_t i = nomem_place(p);
    while (nomem_blocks[i] && nomem_blocks[i] != p)
        i = (i + 1) % NOMEM_BLOCKS;
    if (nomem_blocks[i]) { /* else a library's own */
        nomem_blocks[i] = NOMEM_MARK;
        nomem_live--;
    }
    pthread_mutex_unlock(&nomem_lock);
}

static bool nomem_fails(void)
{
    if (nomem_spares && pthread_equal(nomem_spared, pthread_self()))
        return false;
    const unsigned n = atomic_fetch_add(&nomem_count, 1) + 1, at = atomic_load(&nomem_at);
    const bool fails = at > 0 && (n == at || (n > at && atomic_load(&nomem_all)));

    if (fails)
        atomic_fetch_add(&nomem_failures, 1);
    return fails;
}

void *__wrap_malloc(size_t size)
{
    return nomem_fails() ? NULL : nomem_note(__real_malloc(size));
}

void *__wrap_calloc(size_t count, size_t size)
{
    return nomem_fails() ? NULL : nomem_note(__real_calloc(count, size));
}

void *__wrap_aligned_alloc(size_t alignment, size_t size)
{
    return nomem_fails() ? NULL : nomem_note(__real_aligned_alloc(alignment, size));
}

void *__wrap_realloc(void *old, size_t size)
{
    if (nomem_fails())
        return NULL;
    if (old)
        nomem_forget(old);
    return nomem_note(__real_realloc(old, size));
}

char *__wrap_strdup(const char *text)
{
    const size_t size = strlen(text) + 1;
    char *copy = __wrap_malloc(size);

    return copy ? memcpy(copy, text, size) : NULL;
}

void __wrap_free(void *p)
{
    if (p)
        nomem_forget(p);
    __real_free(p);
}

static inline void nomem_arm(unsigned at, bool all)
{
    atomic_store(&nomem_all, all);
    atomic_store(&nomem_count, 0);
    atomic_store(&nomem_failures, 0);
    atomic_store(&nomem_at, at);
}

static inline void nomem_disarm(void)
{
    atomic_store(&nomem_at, 0);
}

typedef enum err nomem_use(void *context, struct reason *why);

/* Of the allocations of a use so many fail, evenly among them, half as many in each commit; what is slow sets it lower.
 * The variable NOMEM_MOST overrides it: a large number has all of them fail, which takes minutes. */
static unsigned nomem_most = 120;

/* How a run with a failure went: NULL, or what is wrong with it. */
static inline const char *nomem_once(nomem_use *use, void *context, unsigned n, bool all, unsigned *survived,
                                     struct reason *why)
{
    const size_t live = nomem_live;

    why->text[0] = '\0';
    nomem_arm(n, all);
    const enum err e = use(context, why);
    const unsigned failures = atomic_load(&nomem_failures);
    nomem_disarm();
    *survived += e == ERR_OK && failures > 0;
    if (e != ERR_OK && e != ERR_NOMEM)
        return "is called something else";
    if (nomem_live != live)
        return nomem_live > live ? "leaves blocks behind" : "frees what is others'";
    if (e == ERR_NOMEM && failures == 0)
        return "is said to have been";
    return NULL;
}

/* Prints how many allocations there are, how many of their failures were survived, and each that went wrong. */
static inline void nomem_each(const char *name, nomem_use *use, void *context)
{
    struct reason why = { "" };
    unsigned tried = 0, survived = 0, wrong = 0;

    if (use(context, &why)) /* what libraries keep from their first time on is there then */
        fail_msg("%s: %s", name, why.text);
    const size_t live = nomem_live;
    nomem_arm(0, false);
    if (use(context, &why))
        fail_msg("%s: %s", name, why.text);
    const unsigned count = atomic_load(&nomem_count);
    if (nomem_live != live)
        fail_msg("%s: leaves %zd blocks behind", name, (ssize_t)(nomem_live - live));
    const unsigned asked = getenv("NOMEM_MOST") ? (unsigned)atoi(getenv("NOMEM_MOST")) : 0;
    const unsigned most = asked > 0 ? asked : nomem_most / seeds_count(2, 1);
    const unsigned step = count > most ? (count + most - 1) / most : 1;
    for (unsigned n = 1; n <= count; n += step)
        for (int all = 0; all <= (tried % 3 == 0); all++) {
            const char *fault = nomem_once(use, context, n, all, &survived, &why);
            if (fault && wrong++ < 20)
                printf("%s: failure of allocation %u%s %s: %s\n", name, n, all ? " and all after it" : "", fault,
                       why.text);
            tried += !all;
        }
    if (use(context, &why))
        fail_msg("%s: does not work again: %s", name, why.text);
    printf("%s: %u allocations, %u of them failed in turn, %u failures were survived, %u went wrong\n", name, count,
           tried, survived, wrong);
    assert_true(count > 0 && wrong == 0);
}
