/* Data and functions that the files of this room share. Private. Thread: the relighter's. */
#pragma once

#include "base/mem.h"
#include "job/team/team.h"
#include "light/cache/cache_share.h"
#include "light/frame/part.h"

/* ---- Passes for another process ---- */

/* Serialises the passes of an image for another process. Thread: the relighter's. */

/* The passes at the shade points without pointers, for another process of the same program. */
struct light_work {
    bool by_cache, eye_left; /* eye[1] is used, for the packets that the cache omits */
    struct relight_desc cached;
    struct direct_desc direct;
    struct eye_paths_desc eye[2];
    struct plan plan;
};

/* Pack the passes and *stats in one process and unpack them in another, where *work must live as long as *plan.
 * light_work_unpack: ERR_IO if the passes need a cache and this process has none. */
void light_work_pack(const struct frame_plan *plan, const struct relight_stats *stats, struct light_work *work);
MUST_CHECK enum err light_work_unpack(struct relighter *r, const struct light_work *work, struct frame_plan *plan,
                                      struct relight_stats *stats);

/* Copies a request without its pointers. */
struct relight_desc light_work_request(const struct relight_desc *request);

/* ---- The team ---- */

#define BLOCK (3 * PACKET) /* floats of a packet */

struct team_stats {
    uint64_t dealt;               /* images that all ranks have lit */
    uint64_t early;               /* of these, whose order went out while the image before was lit */
    uint64_t sent, received;      /* bytes of the last distributed image: to each rank, from all ranks */
    uint64_t memory, memory_most; /* of the last one, bytes of G-buffer and caches: of rank 0, and the most of
                                     another rank */
    double wait_s;                /* time that rank 0 waited for other ranks, in all distributed images */
    double part_s;                /* seconds of this rank's own parts */
};

/* The first message of an image, followed by the cuts, the packed sky and the faces. */
struct order {
    /* prepare: work.cached is the request. Keep: the cuts that follow are the shares from now on. */
    enum order_kind { ORDER_IMAGE, ORDER_PREPARE, ORDER_KEEP, ORDER_LEAVE } kind;
    bool narrow; /* ranks light those of their parts: faces follow */
    uint64_t sky, faces;
    struct light_work work;
};

/* What a rank sends before its part's light. */
struct answer {
    int64_t error;
    double seconds;
    uint64_t rays, memory;
};

struct bytes {
    uint8_t *at;
    size_t capacity;
};

/* An image of which rank 0 has sent the order. */
struct dealt {
    bool open;
    const struct environment *e;
    struct order order;
    uint32_t *cuts; /* [count + 1]: rank k has packets cuts[k] .. cuts[k + 1] - 1 */
    struct bytes out, in;
};

struct team {
    struct team_desc desc;
    uint32_t own, count;
    struct light_team light;
    struct team_stats stats;
    struct environment *environment; /* of other ranks */
    double *waited;                  /* [count]: seconds that rank 0 waited for the last image's answers */
    double *way_s;                   /* [count]: seconds per packet from a part's end to its answer's arrival */
    double *speed;                   /* [count]: packets a second; 0: not measured yet */
    double *weight;                  /* [count]: initial shares, sum 1 */
    uint32_t *shares;                /* [count + 1]: the cuts about which ranks keep packets */
    struct dealt dealt[2];           /* rank 0: this image's, dealt[turn], and the next one's */
    int turn;
    team_next *next; /* NULL: images are not known ahead */
    void *next_context;
    bool was_early; /* rank 0: the last image */
    double end_s;   /* when the last image's points were complete; 0: others had no order meanwhile */
    uint32_t *cuts; /* dealt[0].cuts, of other ranks */
    struct cache_share share;
    uint32_t first;          /* rank 0: images with a cache so far, up to FIRST */
    bool settled;            /* shares are measured, and each rank keeps its own */
    struct order order;      /* rank 0: of ORDER_KEEP */
    bool together;           /* the caches were computed or loaded by all ranks */
    bool released;           /* packets of other ranks */
    struct bytes in, out[2]; /* of other ranks' messages; out[turn] is the next answer, */
    struct answer failure;   /* or this */
};

static inline uint32_t packets_of(const struct team *t)
{
    return relighter_set(t->desc.relighter)->gbuffer->packet_count;
}

static inline uint8_t *room_for(struct bytes *b, size_t size)
{
    if (size <= b->capacity)
        return b->at;
    mem_free(b->at);
    b->at = mem_alloc_raw(size, 1);
    b->capacity = b->at ? size : 0;
    return b->at;
}

static inline size_t value_bytes(const struct team *t)
{
    return t->desc.half ? sizeof(uint16_t) : sizeof(float);
}

static inline size_t answer_bytes(const struct team *t, uint32_t packets)
{
    return sizeof(struct answer) + (size_t)packets * BLOCK * value_bytes(t);
}

static inline size_t cuts_bytes(const struct team *t)
{
    return ((size_t)t->count + 1) * sizeof(uint32_t);
}

/* ---- shares.c ---- */

/* Collective. Initial shares by the processor time that each rank's G-buffer took, in powers of two, since it is
 * measured only once. */
void team_share_out(struct team *t);
/* Rank 0, after the first images: shares that take all ranks the same time, as far as the memory of none exceeds its
 * initial share by much. ERR_NOMEM. */
MUST_CHECK enum err team_choose_shares(struct team *t, const struct transport *cache);
/* Moves cuts [count + 1] as little as needed for rank k to have at most most[k] bytes, to within a packet. before:
 * [packets + 1], the bytes of all packets before one; the sum of `most` must not be less than all of them. */
void team_limit_shares(const double *before, uint32_t packets, const double *most, uint32_t count, uint32_t *cuts);
/* The shares are known: frees what other ranks need. ERR_NOMEM. */
MUST_CHECK enum err team_settle(struct team *t);
/* Rank 0: the cuts of an image by measured speed, near the shares. Parts of images with the cache begin at a
 * block. */
void team_cut(const struct team *t, const struct transport *cache, uint32_t *cuts);
/* Rank 0: what a rank's part of an image took. */
void team_learn(struct team *t, uint32_t rank, uint32_t packets, double seconds);
/* Rank 0: what another rank's part took, of which lit_s is light. If rank 0 waited for the answer (t->waited), it is
 * all the time since the image before, taken_s. Otherwise the answer came earlier; its way is then taken to be that
 * of the last time, less a little, so that a link that became fast is noticed. */
void team_learn_answer(struct team *t, uint32_t rank, uint32_t packets, double lit_s, double taken_s);
