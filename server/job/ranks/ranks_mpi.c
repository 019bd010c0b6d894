#define _GNU_SOURCE /* sched_getaffinity */
#include "job/ranks/ranks.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#include <mpi.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define POLL_NS 1000000             /* MPI's own waits spin, on processors that other ranks may need */
#define SOON_NS 100000              /* likewise, for the first */
#define SOON 100                    /* polls: an answer within a frame comes as soon as it can */
#define KEEP_NS 500000              /* until the keeper looks again: at least, while an answer is sent; */
#define EXPECT_NS 1000000           /* while messages are expected or posted; */
#define CALM_NS 10000000            /* at most */
#define CALM_PARTS 8                /* while numbers are taken: this part of the time since the last one */
#define GONE_S 0.3                  /* after the signal to stop, a rank that does not answer is taken to be gone */
#define STOPPED (UINT64_C(1) << 62) /* added to the counter: more than there are frames */
#define TAG_SIZE 1
#define TAG_BYTES 2 /* tags differ, no more is needed */
#define TAG_TAKE 3  /* to rank 0: the number to add to the counter; the answer is what it was before */
#define TAG_PART 4
#define TAG_POST 5       /* likewise */
#define PIECE (64 << 20) /* bytes of a message; MPI counts by int */
#define PIECES 8         /* at most, of a turn's broadcasts */

struct ranks {
    int own, count, local; /* local: ranks on this host */
    char name[160];
    atomic_uint_least64_t counter; /* rank 0's */
    pthread_t keeper;
    bool has_keeper;
    atomic_bool leaving;
    atomic_bool sending, posting, open[2]; /* for the keeper: messages under way; open: of a turn */
    pthread_mutex_t sent_lock;             /* who tests `sent` or `posted` */
    const atomic_bool *stop;
    bool lost;                 /* stopped while it waited for a rank */
    struct turn {              /* rank 0's */
        MPI_Request *expected; /* [count] */
        MPI_Request begun[PIECES];
        int pieces;
    } turn[2];
    MPI_Request sent;      /* another rank's last answer */
    MPI_Request posted;    /* of another rank: its last post, */
    uint8_t *post;         /* and its bytes */
    int ended;             /* rank 0: ranks whose last message has arrived */
    bool asked;            /* another rank: for a number, */
    uint64_t number, more; /* which comes here; what is added */
    MPI_Request took, asking;
};

static void wait_for(MPI_Request *q)
{
    int done = 0;

    for (int k = 0; MPI_Test(q, &done, MPI_STATUS_IGNORE) == MPI_SUCCESS && !done; k++)
        nanosleep(&(struct timespec){ 0, k < SOON ? SOON_NS : POLL_NS }, NULL);
}

/* Until it is done, or the program is to stop and it does not come. */
static enum err wait_or_stop(struct ranks *r, MPI_Request *q)
{
    double stopped_s = 0.0;
    int done = 0;

    for (int k = 0; !r->lost && MPI_Test(q, &done, MPI_STATUS_IGNORE) == MPI_SUCCESS && !done; k++) {
        nanosleep(&(struct timespec){ 0, k < SOON ? SOON_NS : POLL_NS }, NULL);
        if (!r->stop || !atomic_load(r->stop))
            continue;
        if (stopped_s == 0.0)
            stopped_s = clock_seconds();
        r->lost = clock_seconds() - stopped_s > GONE_S;
    }
    return r->lost ? ERR_IO : ERR_OK;
}

/* Other ranks than 0. */
static void ask_counter(struct ranks *r, uint64_t more)
{
    r->asked = true;
    r->more = more;
    MPI_Irecv(&r->number, 1, MPI_UINT64_T, 0, TAG_TAKE, MPI_COMM_WORLD, &r->took);
    MPI_Isend(&r->more, 1, MPI_UINT64_T, 0, TAG_TAKE, MPI_COMM_WORLD, &r->asking);
}

static uint64_t answered(struct ranks *r)
{
    wait_for(&r->asking);
    wait_for(&r->took);
    r->asked = false;
    return r->number;
}

/* A message that was sent no longer needs the keeper. The main thread may be waiting for it. */
static void follow_sent(struct ranks *r, MPI_Request *q, atomic_bool *under_way)
{
    int done = 0;

    if (!atomic_load(under_way) || pthread_mutex_trylock(&r->sent_lock))
        return;
    if (MPI_Test(q, &done, MPI_STATUS_IGNORE) == MPI_SUCCESS && done)
        atomic_store(under_way, false);
    pthread_mutex_unlock(&r->sent_lock);
}

/* Each look costs some 12 microseconds of a processor that lights images. */
static long pause_ns(struct ranks *r, double calm_s)
{
    const double calm_ns = 1e9 * calm_s / CALM_PARTS;

    if (atomic_load(&r->sending))
        return KEEP_NS;
    if (atomic_load(&r->open[0]) || atomic_load(&r->open[1]) || atomic_load(&r->posting))
        return r->local < r->count ? EXPECT_NS : 2 * EXPECT_NS; /* on one host a look copies a message */
    return calm_ns < KEEP_NS ? KEEP_NS : calm_ns > CALM_NS ? CALM_NS : (long)calm_ns;
}

/* A thread, because messages make progress only inside MPI, which the main thread may not enter during a frame. On rank
 * 0 it also gives the other ranks their numbers; MPI's own one-sided access would do that, but Debian's Open MPI has
 * none between hosts that TCP joins. Both messages are so short that no call waits. */
static void *keep_moving(void *context)
{
    struct ranks *r = context;
    double taken_s = clock_seconds();

    while (!atomic_load(&r->leaving)) {
        MPI_Status status;
        uint64_t more, before;
        int found = 0;
        follow_sent(r, &r->sent, &r->sending);
        follow_sent(r, &r->posted, &r->posting);
        MPI_Iprobe(MPI_ANY_SOURCE, TAG_TAKE, MPI_COMM_WORLD, &found, &status);
        if (!found) {
            nanosleep(&(struct timespec){ 0, pause_ns(r, clock_seconds() - taken_s) }, NULL);
            continue;
        }
        taken_s = clock_seconds();
        MPI_Recv(&more, 1, MPI_UINT64_T, status.MPI_SOURCE, TAG_TAKE, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
        before = atomic_fetch_add(&r->counter, more);
        MPI_Send(&before, 1, MPI_UINT64_T, status.MPI_SOURCE, TAG_TAKE, MPI_COMM_WORLD);
    }
    return NULL;
}

/* ---- Joining and leaving ---- */

static enum err meet(const struct ranks *r, const struct ranks_desc *desc, struct reason *why)
{
    struct rank_identity own, *all = mem_alloc((size_t)r->count, sizeof(*all));
    MPI_Request q;

    if (!all)
        ranks_abort(r, "out of memory");
    rank_identify(desc, &own);
    MPI_Iallgather(&own, sizeof(own), MPI_BYTE, all, sizeof(own), MPI_BYTE, MPI_COMM_WORLD, &q);
    wait_for(&q);
    const enum err e = rank_compare(all, r->count, desc->program, why);
    mem_free(all);
    return e;
}

static void find_place(struct ranks *r)
{
    char host[64] = "";
    MPI_Comm here;

    MPI_Comm_rank(MPI_COMM_WORLD, &r->own);
    MPI_Comm_size(MPI_COMM_WORLD, &r->count);
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &here);
    MPI_Comm_size(here, &r->local);
    MPI_Comm_free(&here);
    gethostname(host, sizeof(host) - 1);
    snprintf(r->name, sizeof(r->name), "rank %d of %d on %s", r->own, r->count, host);
}

static enum err start_keeper(struct ranks *r, struct reason *why)
{
    if (r->count == 1)
        return ERR_OK;
    r->has_keeper = pthread_create(&r->keeper, NULL, keep_moving, r) == 0;
    return r->has_keeper ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");
}

static void release(struct ranks *r)
{
    pthread_mutex_destroy(&r->sent_lock);
    mem_free(r->turn[0].expected);
    mem_free(r->turn[1].expected);
    mem_free(r);
}

bool ranks_available(void)
{
    return true;
}

enum err ranks_create(const struct ranks_desc *desc, struct ranks **out, struct reason *why)
{
    int level;

    *out = NULL;
    if (!ranks_launched())
        return ERR_OK;
    MPI_Init_thread(NULL, NULL, MPI_THREAD_MULTIPLE, &level);
    struct ranks *r = mem_alloc(1, sizeof(*r));
    if (!r)
        ranks_abort(NULL, "out of memory");
    find_place(r);
    r->posted = MPI_REQUEST_NULL;
    r->sent = MPI_REQUEST_NULL;
    pthread_mutex_init(&r->sent_lock, NULL);
    for (int turn = 0; turn < 2; turn++) {
        MPI_Request *all = mem_alloc((size_t)r->count, sizeof(*all));
        if (!all)
            ranks_abort(r, "out of memory");
        for (int k = 0; k < r->count; k++)
            all[k] = MPI_REQUEST_NULL;
        r->turn[turn].expected = all;
    }
    enum err e = level >= MPI_THREAD_MULTIPLE ? ERR_OK
                                              : err_say(why, ERR_UNSUPPORTED,
                                                        "this MPI does not allow calls from several threads "
                                                        "(MPI_THREAD_MULTIPLE); Debian's Open MPI does");
    if (!e)
        e = meet(r, desc, why);
    if (e) {
        if (r->own == 0) /* before another rank's end makes mpirun kill this one */
            log_error("%s", why->text);
        why->text[0] = '\0';
        MPI_Finalize();
        release(r);
        return e;
    }
    *out = r;
    return ranks_agree(r, start_keeper(r, why), why);
}

static void end_keeper(struct ranks *r)
{
    atomic_store(&r->leaving, true);
    if (r->has_keeper)
        pthread_join(r->keeper, NULL);
}

void ranks_destroy(struct ranks *r)
{
    MPI_Request q;

    if (!r)
        return;
    if (r->lost) { /* MPI's own end would wait for that rank */
        end_keeper(r);
        release(r);
        return;
    }
    if (r->asked)
        (void)answered(r);
    MPI_Ibarrier(MPI_COMM_WORLD, &q);
    wait_for(&q);
    end_keeper(r);
    wait_for(&r->posted);
    MPI_Finalize();
    mem_free(r->post);
    release(r);
}

noreturn void ranks_abort(const struct ranks *r, const char *text)
{
    log_error("%s%s%s: the job ends", r ? r->name : "", r ? ": " : "", text);
    MPI_Abort(MPI_COMM_WORLD, 1);
    abort();
}

void ranks_set_stop(struct ranks *r, const atomic_bool *stop)
{
    if (r)
        r->stop = stop;
}

uint32_t ranks_index(const struct ranks *r)
{
    return r ? (uint32_t)r->own : 0;
}

uint32_t ranks_count(const struct ranks *r)
{
    return r ? (uint32_t)r->count : 1;
}

const char *ranks_name(const struct ranks *r)
{
    return r ? r->name : "";
}

/* Launchers that bind ranks to processors have divided them already. */
uint32_t ranks_threads(const struct ranks *r)
{
    const long all = sysconf(_SC_NPROCESSORS_ONLN);
    cpu_set_t set;

    if (!r)
        return 0;
    CPU_ZERO(&set);
    const int mine = sched_getaffinity(0, sizeof(set), &set) == 0 ? CPU_COUNT(&set) : (int)all;
    const int threads = mine < all ? mine : mine / r->local;
    return threads > 1 ? (uint32_t)threads : 1;
}

/* ---- Together ---- */

enum err ranks_agree(struct ranks *r, enum err own, struct reason *why)
{
    struct {
        int error, rank;
    } mine = { own != ERR_OK, r ? r->own : 0 }, worst;
    MPI_Request q;

    if (!r)
        return own;
    MPI_Iallreduce(&mine, &worst, 1, MPI_2INT, MPI_MAXLOC, MPI_COMM_WORLD, &q);
    wait_for(&q);
    if (own || !worst.error)
        return own;
    why->text[0] = '\0';
    return r->own == 0 ? err_say(why, ERR_IO, "rank %d has failed; all ranks stop", worst.rank) : ERR_IO;
}

uint64_t ranks_sum(struct ranks *r, uint64_t own)
{
    uint64_t sum = own;
    MPI_Request q;

    if (!r)
        return own;
    MPI_Iallreduce(&own, &sum, 1, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD, &q);
    wait_for(&q);
    return sum;
}

static uint64_t add_to_counter(struct ranks *r, uint64_t more)
{
    if (r->own == 0)
        return atomic_fetch_add(&r->counter, more);
    if (r->asked) /* for a number that is not needed */
        (void)answered(r);
    ask_counter(r, more);
    return answered(r);
}

void ranks_ask(struct ranks *r)
{
    if (r && r->own > 0 && !r->asked)
        ask_counter(r, 1);
}

uint64_t ranks_take(struct ranks *r)
{
    const uint64_t next = r->asked ? answered(r) : add_to_counter(r, 1);

    return next < STOPPED ? next : UINT64_MAX;
}

void ranks_stop(struct ranks *r)
{
    if (r)
        (void)add_to_counter(r, STOPPED);
}

enum err ranks_broadcast(struct ranks *r, void *bytes, size_t size)
{
    return ranks_broadcast_from(r, 0, bytes, size);
}

void ranks_share_number(struct ranks *r, double own, double *all)
{
    MPI_Request q;

    all[0] = own;
    if (!r)
        return;
    MPI_Iallgather(&own, 1, MPI_DOUBLE, all, 1, MPI_DOUBLE, MPI_COMM_WORLD, &q);
    wait_for(&q);
}

enum err ranks_broadcast_from(struct ranks *r, uint32_t from, void *bytes, size_t size)
{
    enum err e = ERR_OK;

    for (size_t at = 0; at < size && !e; at += PIECE) {
        const int n = size - at < PIECE ? (int)(size - at) : PIECE;
        MPI_Request q;
        MPI_Ibcast((uint8_t *)bytes + at, n, MPI_BYTE, (int)from, MPI_COMM_WORLD, &q);
        e = wait_or_stop(r, &q);
    }
    return e;
}

enum err ranks_begin_broadcast(struct ranks *r, int turn, void *bytes, size_t size)
{
    struct turn *t = &r->turn[turn];

    atomic_store(&r->open[turn], true);
    for (size_t at = 0; at < size; at += PIECE) {
        const int n = size - at < PIECE ? (int)(size - at) : PIECE;
        if (t->pieces == PIECES)
            return ERR_RANGE;
        MPI_Ibcast((uint8_t *)bytes + at, n, MPI_BYTE, 0, MPI_COMM_WORLD, &t->begun[t->pieces++]);
    }
    return ERR_OK;
}

enum err ranks_expect(struct ranks *r, int turn, uint32_t from, void *bytes, size_t size)
{
    if (size > INT32_MAX)
        return ERR_RANGE;
    MPI_Irecv(bytes, (int)size, MPI_BYTE, (int)from, TAG_PART, MPI_COMM_WORLD, &r->turn[turn].expected[from]);
    return ERR_OK;
}

enum err ranks_receive(struct ranks *r, int turn, double *waited)
{
    struct turn *t = &r->turn[turn];
    enum err e = ERR_OK;

    for (int k = 0; k < t->pieces && !e; k++)
        e = wait_or_stop(r, &t->begun[k]);
    t->pieces = 0;
    for (int k = 1; k < r->count && !e; k++) {
        const double start = clock_seconds();
        if (t->expected[k] != MPI_REQUEST_NULL)
            e = wait_or_stop(r, &t->expected[k]);
        if (waited)
            waited[k] = clock_seconds() - start;
    }
    atomic_store(&r->open[turn], false);
    return e;
}

enum err ranks_sent(struct ranks *r)
{
    pthread_mutex_lock(&r->sent_lock);
    const enum err e = r->sent == MPI_REQUEST_NULL ? ERR_OK : wait_or_stop(r, &r->sent);
    pthread_mutex_unlock(&r->sent_lock);
    return e;
}

enum err ranks_send(struct ranks *r, const void *bytes, size_t size)
{
    const enum err e = ranks_sent(r);

    if (e || size > INT32_MAX)
        return e ? e : ERR_RANGE;
    pthread_mutex_lock(&r->sent_lock);
    MPI_Isend(bytes, (int)size, MPI_BYTE, 0, TAG_PART, MPI_COMM_WORLD, &r->sent);
    atomic_store(&r->sending, true);
    pthread_mutex_unlock(&r->sent_lock);
    return ERR_OK;
}

enum err ranks_post(struct ranks *r, const void *bytes, size_t size)
{
    if (size > INT32_MAX)
        return ERR_RANGE;
    pthread_mutex_lock(&r->sent_lock);
    wait_for(&r->posted);
    pthread_mutex_unlock(&r->sent_lock);
    mem_free(r->post);
    r->post = mem_alloc_raw(size + 1, 1);
    if (!r->post)
        return ERR_NOMEM;
    if (size > 0)
        memcpy(r->post, bytes, size);
    pthread_mutex_lock(&r->sent_lock);
    MPI_Isend(r->post, (int)size, MPI_BYTE, 0, TAG_POST, MPI_COMM_WORLD, &r->posted);
    atomic_store(&r->posting, true);
    pthread_mutex_unlock(&r->sent_lock);
    return ERR_OK;
}

/* A post that was announced. */
static enum err receive_post(struct ranks *r, const MPI_Status *status,
                             enum err (*take)(void *context, const void *bytes, size_t size), void *context)
{
    MPI_Request q;
    int size;

    MPI_Get_count(status, MPI_BYTE, &size);
    uint8_t *bytes = mem_alloc_raw((size_t)size + 1, 1);
    if (!bytes)
        ranks_abort(r, "out of memory for another rank's posted message");
    MPI_Irecv(bytes, size, MPI_BYTE, status->MPI_SOURCE, TAG_POST, MPI_COMM_WORLD, &q);
    wait_for(&q);
    r->ended += size == 0;
    const enum err e = size > 0 && take ? take(context, bytes, (size_t)size) : ERR_OK;
    mem_free(bytes);
    return e;
}

enum err ranks_collect(struct ranks *r, bool all, enum err (*take)(void *context, const void *bytes, size_t size),
                       void *context)
{
    enum err e = ERR_OK;

    while (r->ended < r->count - 1) {
        MPI_Status status;
        int found = 0;
        MPI_Iprobe(MPI_ANY_SOURCE, TAG_POST, MPI_COMM_WORLD, &found, &status);
        if (!found && !all)
            break;
        if (!found) {
            nanosleep(&(struct timespec){ 0, POLL_NS }, NULL);
            continue;
        }
        const enum err one = receive_post(r, &status, e ? NULL : take, context);
        e = e ? e : one;
    }
    return e;
}

/* Sends or receives size bytes in pieces. */
static void carry(uint8_t *bytes, uint64_t size, int peer, bool sends)
{
    for (uint64_t at = 0; at < size; at += PIECE) {
        const int n = size - at < PIECE ? (int)(size - at) : PIECE;
        MPI_Request q;
        if (sends)
            MPI_Isend(bytes + at, n, MPI_BYTE, peer, TAG_BYTES, MPI_COMM_WORLD, &q);
        else
            MPI_Irecv(bytes + at, n, MPI_BYTE, peer, TAG_BYTES, MPI_COMM_WORLD, &q);
        wait_for(&q);
    }
}

static enum err take_from(const struct ranks *r, int rank,
                          enum err (*take)(void *context, const void *bytes, size_t size), void *context)
{
    uint64_t size = 0;
    MPI_Request q;

    MPI_Irecv(&size, 1, MPI_UINT64_T, rank, TAG_SIZE, MPI_COMM_WORLD, &q);
    wait_for(&q);
    uint8_t *bytes = mem_alloc(size + 1, 1);
    if (!bytes)
        ranks_abort(r, "out of memory for another rank's message");
    carry(bytes, size, rank, false);
    const enum err e = take(context, bytes, size);
    mem_free(bytes);
    return e;
}

enum err ranks_gather(struct ranks *r, const void *bytes, size_t size,
                      enum err (*take)(void *context, const void *bytes, size_t size), void *context)
{
    const uint64_t length = size;
    enum err e = ERR_OK;
    MPI_Request q;

    if (!r || r->own == 0)
        e = take(context, bytes, size);
    if (r && r->own != 0) {
        MPI_Isend(&length, 1, MPI_UINT64_T, 0, TAG_SIZE, MPI_COMM_WORLD, &q);
        wait_for(&q);
        carry((uint8_t *)(uintptr_t)bytes, length, 0, true);
    }
    for (int k = 1; r && r->own == 0 && k < r->count; k++) {
        const enum err one = take_from(r, k, take, context);
        e = e ? e : one;
    }
    return e;
}
