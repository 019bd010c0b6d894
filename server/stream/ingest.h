/* server/stream/ingest.h */
/* What producers have pushed and what has become of it: the state between the service thread, which receives frames,
 * and the threads that take them and hand back pictures. No socket is touched here. Everything in these structures
 * is guarded by the server's lock unless it says otherwise.
 *
 * A live frame stands in `live` until it is taken or a newer one comes. A lockstep sequence outlives its connections:
 * it goes IDLE -> WAITING (a frame is accepted) -> WORKING (taken) -> KEPT (its picture is there) -> IDLE (stored), or
 * back to IDLE from WORKING when the frame is refused; only in IDLE can a frame be accepted. So at any moment either
 * end may vanish, and whoever comes back finds what is owed to him. */
#ifndef STREAM_INGEST_H
#define STREAM_INGEST_H

#include "assembly.h"
#include "message.h"
#include "recent.h"
#include "server.h"

#include <pthread.h>

#define INGEST_SEQUENCES 16 /* names that are remembered */
#define INGEST_TICKETS 16   /* frames taken whose fate is open; of live ones the oldest is forgotten */
#define INGEST_NOTES 32     /* fates not yet told: above what tickets and one delivery can make */
#define INGEST_CREDIT 2     /* frames that a live producer may be ahead */
#define INGEST_FRAME_BYTES ((size_t)256 << 20)

enum sequence_stage {
    SEQUENCE_IDLE,
    SEQUENCE_WAITING,
    SEQUENCE_WORKING,
    SEQUENCE_KEPT,
};

struct viewer;

struct sequence {
    char name[PROTOCOL_NAME_MAX + 1]; /* "": free */
    enum sequence_stage stage;
    bool has_accepted, has_stored;
    uint64_t accepted;           /* number of the last frame received whole */
    uint64_t stored;             /* number of the last frame whose picture is stored */
    uint64_t stored_count;       /* pictures */
    bool refused;                /* the last frame accepted was */
    bool ended;                  /* the producer said so, and no frame came since */
    struct picture *kept;        /* in SEQUENCE_KEPT */
    enum protocol_format format; /* of its pictures; 0 before a recorder has subscribed */
    bool recording;              /* the recorder is there and has subscribed */
    int64_t touched_us;          /* when a connection last came or went */

    /* The service thread's own: who is connected. */
    struct viewer *producer, *recorder;
};

/* A frame that was received whole. */
struct pushed {
    bool full;
    struct protocol_environment header;
    struct block payload;
    uint64_t producer;         /* its connection */
    char peer[64];             /* where that came from */
    struct sequence *sequence; /* NULL: live */
};

struct ticket {
    uint64_t id; /* 0: free */
    uint64_t producer, number;
    struct sequence *sequence;
};

/* A fate to be told. */
struct note {
    uint64_t producer; /* told to this connection, or to the sequence's producer of the moment */
    struct sequence *sequence;
    uint64_t number, picture;
    enum server_fate fate;
    struct fault fault; /* why it was refused */
};

struct ingest {
    pthread_cond_t arrived;
    struct pushed live, lockstep;
    struct block spare;   /* a block that was in use before; while a producer is connected */
    struct recent recent; /* payloads */
    struct sequence sequences[INGEST_SEQUENCES];
    struct ticket tickets[INGEST_TICKETS];
    uint64_t last_ticket;
    struct note notes[INGEST_NOTES];
    unsigned note_count;

    uint64_t producer;        /* connection of the one there is; 0: none */
    struct sequence *current; /* its sequence */
    uint32_t returned;        /* credit of a live producer that is to be told */
    bool ended;               /* the last producer said so, and no frame came since */

    uint64_t received, superseded, refused, repeated;
};

void ingest_init(struct ingest *g);
void ingest_finish(struct ingest *g);

/* All below take the server's lock themselves. Thread: service. */

/* sequence.c: the sequence of that name, made if need be, in place of one that is of no use any more. NULL when all
 * are in use. now_us: any clock that only rises. */
struct sequence *ingest_sequence(struct server *s, const char *name, int64_t now_us);

/* A producer has come (sequence NULL: live), or is gone. */
void ingest_attach(struct server *s, uint64_t producer, struct sequence *sequence);
void ingest_detach(struct server *s, uint64_t producer);

/* A block to receive a frame into, if one is left over. */
void ingest_spare(struct server *s, struct block *out);

/* A frame is whole. refusal: why it must not be used, or NULL. Moves the payload out if the frame is kept. */
void ingest_deliver(struct server *s, struct assembly *a, uint64_t producer, const char *peer,
                    struct sequence *sequence, const struct fault *refusal);

/* What there is to tell: up to INGEST_NOTES fates, which are then forgotten here. */
unsigned ingest_notes(struct server *s, struct note out[INGEST_NOTES]);

/* Whether the sequence may be granted a frame: when nothing of it is under way, and its format is known; what a live
 * producer is granted anew, which then counts as told. */
bool ingest_may_grant(struct server *s, const struct sequence *sequence);
uint32_t ingest_returned(struct server *s);

/* ---- sequence.c ---- */

/* The recorder has subscribed: false when a frame is under way that is to be a picture of another format. */
bool ingest_record(struct server *s, struct sequence *sequence, enum protocol_format format);

/* The recorder's ack: true when that was the picture kept. */
bool ingest_stored(struct server *s, struct sequence *sequence, uint64_t picture);

/* The picture that the recorder has not acknowledged, as a new reference; NULL: none. */
struct picture *ingest_kept(struct server *s, const struct sequence *sequence);

/* {lock} The part of server_demand that is about producers and recorders. Any thread. */
void ingest_demand(const struct ingest *g, struct server_demand *out);

/* The producer will send no more (sequence NULL: live). */
void ingest_end(struct server *s, struct sequence *sequence);

/* Whether the producer has said so, and all its pictures are stored. */
bool ingest_is_over(struct server *s, const struct sequence *sequence, uint64_t *stored);

#endif
