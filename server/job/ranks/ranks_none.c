#include "job/ranks/ranks.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* nothing is done with them */

bool ranks_available(void)
{
    return false;
}

enum err ranks_create(const struct ranks_desc *desc, struct ranks **out, struct reason *why)
{
    *out = NULL;
    if (!ranks_launched())
        return ERR_OK;
    return err_say(why, ERR_UNSUPPORTED,
                   "started by an MPI launcher, but this build has no MPI: install libopenmpi-dev and build again, or "
                   "start it without mpirun");
}

void ranks_destroy(struct ranks *r)
{
}

uint32_t ranks_index(const struct ranks *r)
{
    return 0;
}

uint32_t ranks_count(const struct ranks *r)
{
    return 1;
}

const char *ranks_name(const struct ranks *r)
{
    return "";
}

uint32_t ranks_threads(const struct ranks *r)
{
    return 0;
}

enum err ranks_agree(struct ranks *r, enum err own, struct reason *why)
{
    return own;
}

uint64_t ranks_sum(struct ranks *r, uint64_t own)
{
    return own;
}

void ranks_ask(struct ranks *r)
{
}

uint64_t ranks_take(struct ranks *r)
{
    return UINT64_MAX;
}

void ranks_stop(struct ranks *r)
{
}

noreturn void ranks_abort(const struct ranks *r, const char *text)
{
    abort();
}

void ranks_set_stop(struct ranks *r, const atomic_bool *stop)
{
}

enum err ranks_broadcast(struct ranks *r, void *bytes, size_t size)
{
    return ERR_OK;
}

enum err ranks_broadcast_from(struct ranks *r, uint32_t from, void *bytes, size_t size)
{
    return ranks_broadcast(r, bytes, size);
}

void ranks_share_number(struct ranks *r, double own, double *all)
{
    all[0] = own;
}

enum err ranks_begin_broadcast(struct ranks *r, int turn, void *bytes, size_t size)
{
    return ERR_OK;
}

enum err ranks_expect(struct ranks *r, int turn, uint32_t from, void *bytes, size_t size)
{
    return ERR_OK;
}

enum err ranks_receive(struct ranks *r, int turn, double *waited)
{
    return ERR_OK;
}

enum err ranks_send(struct ranks *r, const void *bytes, size_t size)
{
    return ERR_OK;
}

enum err ranks_sent(struct ranks *r)
{
    return ERR_OK;
}

enum err ranks_post(struct ranks *r, const void *bytes, size_t size)
{
    return ERR_OK;
}

enum err ranks_collect(struct ranks *r, bool all, enum err (*take)(void *context, const void *bytes, size_t size),
                       void *context)
{
    return ERR_OK;
}

enum err ranks_gather(struct ranks *r, const void *bytes, size_t size,
                      enum err (*take)(void *context, const void *bytes, size_t size), void *context)
{
    return take(context, bytes, size);
}
