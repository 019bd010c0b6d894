/* Frames from producers and their fates: the state shared by the service thread, which receives frames, and the threads
 * that take them and return images. Uses no sockets. The server's lock guards these structures unless noted.
 *
 * A live frame stays in `live` until it is taken or replaced. A lockstep sequence outlives its connections: IDLE ->
 * WAITING (frame accepted) -> WORKING (taken) -> KEPT (its image is ready) -> IDLE (stored), or WORKING -> IDLE when
 * the frame is refused. Frames are accepted in IDLE only, so either end may disconnect at any time and resume later. */
#pragma once

#include "base/mem.h"
#include "image/codec/frame.h"
#include "net/message/message.h"
#include "net/stream/server.h"
#include "protocol/relight_protocol.h"

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Assembly of a message ---- */

/* Assembles an environment message (PROTOCOL.md section 7) from network pieces, directly in the frame's final memory.
 * Checks the size against the limit as soon as the header is complete, before it allocates. No sockets, no clock. One
 * thread per assembly. */

#define ASSEMBLY_FRAGMENTS 65536 /* maximum WebSocket fragments of a message */

/* A block of mem_alloc or mem_alloc_raw, or none: {NULL, 0}. */
struct block {
    uint8_t *bytes;
    size_t capacity;
};

struct assembly {
    size_t limit; /* largest message; set by the caller */

    struct protocol_environment header; /* valid once complete */
    struct block payload;               /* the caller may provide one, and takes the full one */

    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    size_t received; /* bytes of this message so far */
    size_t offset;   /* where the payload begins; 0: header incomplete */
    uint32_t fragments;
    bool under_way, whole;
};

/* Adds a piece, in[length]. `coming`: remaining bytes of the same WebSocket fragment. `last`: it is the message's last
 * fragment. With the last piece a->whole is set: the caller takes header and payload, and the next piece begins a new
 * message. Returns FAULT_NONE, or drops the message and describes the error in *fault. */
enum fault_code assembly_add(struct assembly *a, const uint8_t *in, size_t length, size_t coming, bool last,
                             struct fault *fault);

/* Drops the message and frees the block. Zeroed memory is allowed; the limit stays. */
void assembly_finish(struct assembly *a);

/* Allocates size bytes with undefined contents. ERR_NOMEM leaves {NULL, 0}. */
MUST_CHECK enum err block_reserve(struct block *b, size_t size);
void block_finish(struct block *b);

/* Converts a producer's raw texels to float RGB: fills *f as FRAME_TEXELS, top row first, and leaves its other fields
 * unchanged. Float texels are not copied: frame and payload swap blocks. ERR_NOMEM leaves FRAME_NONE. Any thread. */
MUST_CHECK enum err texels_take(struct frame *f, const struct protocol_environment *header, struct block *payload);

#define INGEST_SEQUENCES 16 /* sequences remembered */
#define INGEST_TICKETS 16   /* taken frames with open fate; the oldest live one is dropped */
#define INGEST_NOTES 32     /* fates not yet sent: more than tickets and one delivery can make */
#define INGEST_FATES 64     /* fates that a lockstep sequence remembers */
#define INGEST_CREDIT 2     /* frames in advance for a live producer */
#define INGEST_FRAME_BYTES ((size_t)256 << 20)

enum sequence_stage {
    SEQUENCE_IDLE,
    SEQUENCE_WAITING,
    SEQUENCE_WORKING,
    SEQUENCE_KEPT,
};

struct websocket;
struct client;

struct sequence {
    char name[PROTOCOL_NAME_MAX + 1]; /* "": free */
    enum sequence_stage stage;
    bool has_accepted, has_stored;
    uint64_t accepted;     /* number of the last frame received whole */
    uint64_t stored;       /* number of the last frame whose image is stored */
    uint64_t stored_count; /* images */
    bool ended;            /* the producer ended it */
    struct {
        uint64_t number, picture; /* image: made of the frame; 0: it was refused */
    } fates[INGEST_FATES];        /* of the last frames, in a ring */
    unsigned fate_count;          /* so many frames had a fate */
    struct sent_image *kept;      /* in SEQUENCE_KEPT */
    enum protocol_format format;  /* of its images; 0 before a recorder has subscribed */
    bool recording;               /* its recorder has subscribed */
    int64_t touched_us;           /* when a connection last came or went */
    int64_t left_us;              /* when its recorder last left; 0: never */
    uint8_t owner[16];            /* address of its recorder, or else of who named it first */

    /* The service thread's own: who is connected. */
    struct websocket *producer, *recorder;
};

/* A complete frame. */
struct pushed {
    bool full;
    struct protocol_environment header;
    struct block payload;
    uint64_t producer;         /* connection */
    char peer[64];             /* its address */
    struct sequence *sequence; /* NULL: live */
};

struct ticket {
    uint64_t id; /* 0: free */
    uint64_t producer, number;
    struct sequence *sequence;
};

/* A fate to send. */
struct note {
    uint64_t producer; /* to this connection, or to the sequence's present producer */
    struct sequence *sequence;
    uint64_t number, picture;
    enum server_fate fate;
    struct fault fault; /* why it was refused */
};

struct ingest {
    pthread_cond_t arrived;
    struct pushed live, lockstep;
    struct block spare;   /* a block to reuse, while a producer is connected */
    struct recent recent; /* payloads */
    struct sequence sequences[INGEST_SEQUENCES];
    struct ticket tickets[INGEST_TICKETS];
    uint64_t last_ticket;
    struct note notes[INGEST_NOTES];
    unsigned note_count;

    uint64_t producer;        /* connection of the producer; 0: none */
    struct sequence *current; /* its sequence */
    uint32_t returned;        /* credit to return to a live producer */
    bool ended;               /* the last producer ended its stream */

    uint64_t received, superseded, refused, repeated;
};

/* Frees the sequences and notes. Thread: the owner's, after all others. */
void ingest_finish(struct ingest *g);

/* All below take the server's lock themselves. Thread: service. */

/* sequence.c: finds or creates the sequence, in place of one no longer needed, or of one that a recorder of an address
 * with many names waits for. by: the address that asks. NULL: all are in use. now_us: monotonic. */
struct sequence *ingest_sequence(struct server *s, const char *name, const struct client *by, int64_t now_us);

/* A producer connects (sequence NULL: live) or leaves. */
void ingest_attach(struct server *s, uint64_t producer, struct sequence *sequence);
void ingest_detach(struct server *s, uint64_t producer);

/* Moves the spare block, if any, into *out. */
void ingest_spare(struct server *s, struct block *out);

/* A frame is complete. refusal: why it must not be used, or NULL. Takes over the payload if it keeps the frame. */
void ingest_deliver(struct server *s, struct assembly *a, uint64_t producer, const char *peer,
                    struct sequence *sequence, const struct fault *refusal);

/* Takes the fates to send. Returns their number. */
unsigned ingest_notes(struct server *s, struct note out[INGEST_NOTES]);

/* Whether the sequence may send a frame: nothing is under way and its format is known. Credit to return to a live
 * producer, taken. */
bool ingest_may_grant(struct server *s, const struct sequence *sequence);
uint32_t ingest_returned(struct server *s);

/* ---- sequence.c ---- */

/* The recorder subscribes. False: a frame of another format is under way. */
bool ingest_record(struct server *s, struct sequence *sequence, enum protocol_format format);

/* The recorder acknowledges a stored image. True: it was the kept one. */
bool ingest_stored(struct server *s, struct sequence *sequence, uint64_t picture);

/* The image not yet acknowledged, as a new reference; NULL: none. */
struct sent_image *ingest_kept(struct server *s, const struct sequence *sequence);

/* {lock} Fills in producers and recorders. Any thread. */
void ingest_demand(const struct ingest *g, struct server_demand *out);

/* The producer ends its stream (sequence NULL: live). */
void ingest_end(struct server *s, struct sequence *sequence);

/* Whether the stream has ended and all its images are stored; *stored: how many. */
bool ingest_is_over(struct server *s, const struct sequence *sequence, uint64_t *stored);
