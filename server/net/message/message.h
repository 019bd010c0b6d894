/* The text messages of relight.v1 (PROTOCOL.md sections 3 to 5): JSON to checked values and back. No sockets, no state;
 * any thread. */
#pragma once

#include "base/setting.h"
#include "net/access/figures.h"
#include "protocol/relight_protocol.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What messages are about: roles, requests of controllers, questions about a pixel. Plain data; any thread. */

enum server_role {
    SERVER_VIEWER,
    SERVER_CONTROLLER,
    SERVER_PRODUCER,
    SERVER_RECORDER,
    SERVER_ROLES,
};
extern const char *const server_role_names[SERVER_ROLES]; /* "viewer", ... */

/* What becomes of a producer's frame. */
enum server_fate {
    SERVER_USED,       /* an image was made */
    SERVER_SUPERSEDED, /* a newer one replaced it */
    SERVER_REFUSED,    /* unusable: `why` gives the reason */
};

/* A controller's request: the values are those of a struct that the rows of the settings describe. */
#define SERVER_CONTROL_BYTES 512
struct server_control {
    uint32_t asked; /* bit k: the request sets row k */
    _Alignas(8) char values[SERVER_CONTROL_BYTES];
    uint64_t by, request; /* the requesting connection and the number of its request, which the answer repeats */
    const char *clause;   /* of PROTOCOL.md, static: the caller sets it with an error; NULL: 4.13 */
};

/* A question about a pixel. */
struct server_inspection {
    uint64_t by, request; /* connection and number of the request, for the answer */
    uint32_t x, y;        /* within the image, if its size is known */
    uint32_t samples;     /* 0: default */
    bool figure, sky;     /* the preset of [LPG13, Fig. 1]; include an image of the sky */
    bool sky_alone;       /* the query is about the sky only, not a pixel */
};

/* A pixel that a client follows from image to image, */
struct server_follow {
    uint64_t by;
    uint32_t x, y;
};

/* and an image's radiance there. */
struct server_radiance {
    uint64_t frame;
    int64_t capture_us; /* 0: unknown */
    bool finer;         /* a refined image of the same frame */
    float rgb[3];
};

/* Errors of PROTOCOL.md section 8. */
enum fault_code {
    FAULT_NONE,
    FAULT_BAD_JSON,
    FAULT_BAD_FIELD,
    FAULT_BAD_ORDER,
    FAULT_WRONG_ROLE,
    FAULT_BAD_VERSION,
    FAULT_BAD_TOKEN,
    FAULT_FULL,
    FAULT_NO_HELLO,
    FAULT_STALLED,
    FAULT_TOO_FAST,
    FAULT_SUPERSEDED,
    FAULT_BUSY,
    FAULT_TOO_SLOW,
    FAULT_NO_CREDIT,
    FAULT_BAD_UTF8,
    FAULT_TOO_BIG,
    FAULT_UNKNOWN_OP,
    FAULT_NOT_OFFERED,
    FAULT_BAD_FRAME,
    FAULT_CODES,
};

struct fault {
    enum fault_code code;
    const char *clause; /* of PROTOCOL.md */
    bool stays;         /* does not close the connection, although its code usually does */
    bool has_request;   /* it answers a control or probe message, whose number is */
    uint64_t request;
    char text[160];
};

/* The code's name in `error` messages (PROTOCOL.md 4.9); static. All functions here: any thread. */
const char *fault_name(enum fault_code code);
uint16_t fault_close_code(const struct fault *f); /* 0: the connection stays */

/* "clause 4.3.2: ...", in plain ASCII, cut to fit a close frame. Returns out. */
#define FAULT_REASON 120 /* 125 less the code, and a NUL [RFC 6455, 5.5] */
/* f is not changed. */
char *fault_reason(const struct fault *f, char out[FAULT_REASON]);

/* Sets *f and returns its code. */
enum fault_code fault_say(struct fault *f, enum fault_code code, const char *clause, const char *format, ...)
    PRINTF_LIKE(4, 5);

enum message_op {
    MESSAGE_UNKNOWN, /* no op, or not one of this version */
    MESSAGE_HELLO,
    MESSAGE_SUBSCRIBE,
    MESSAGE_ACK,
    MESSAGE_PING,
    MESSAGE_END,
    MESSAGE_CONTROL,
    MESSAGE_PROBE,
};

#define MESSAGE_PROBE_SAMPLES_MAX 256 /* that a question about a pixel may ask for */

#define MESSAGE_FORMATS 5                                  /* values of enum protocol_format */
extern const char *const message_formats[MESSAGE_FORMATS]; /* indexed by enum protocol_format - 1 */

struct message {
    enum message_op op;
    union {
        struct {
            enum server_role role;
            uint32_t major;
            char token[256];
            bool lockstep;
            char sequence[PROTOCOL_NAME_MAX + 1]; /* of a producer; "": none */
            char recorder[PROTOCOL_NAME_MAX + 1]; /* the sequence that a viewer records; "": none */
        } hello;
        struct {
            enum protocol_format format;
            int quality;                    /* 1..100; 0: not said */
            double max_rate;                /* images per second; 0: no limit */
            uint32_t max_width, max_height; /* pixels; 0: no limit */
            bool paused;
            uint64_t request; /* echoed; 0: not said */
        } subscribe;
        struct {
            uint64_t sequence;
            bool stored;
        } ack;
        struct {
            uint64_t id;
        } ping;
        struct server_control control;
        struct {
            bool asks; /* it names a pixel or asks for the sky: `question` is valid */
            struct server_inspection question;
            bool has_follow, follow;
        } inspection;
    };
};

/* Parses one text message. controls: the rows that a control message may name, or NULL. On a fault *fault says what is
 * wrong, and of *m only op is valid. */
enum fault_code message_parse(const char *text, size_t length, const struct setting *controls, struct message *m,
                              struct fault *fault);

/* Complete messages, freed with message_free; NULL: out of memory. */
struct welcome {
    const char *session;
    uint64_t id; /* of the connection */
    uint32_t max_connections;
    bool controllers, producers, recorders; /* roles offered */
    bool h264;                              /* format offered */
    bool producer, recorder;                /* the client's role */
    const struct setting *controls;         /* what controllers may ask for; NULL: not sent */
    bool has_after;                         /* `after` is the last frame accepted (producer) or stored (recorder) */
    uint64_t after;
    uint32_t credit;
    size_t frame_bytes;
};
/* PROTOCOL.md 4.2, 4.4, 4.7, 4.9 and 4.10. */
char *message_welcome(const struct welcome *w);
char *message_subscribed(const struct message *m);
char *message_pong(uint64_t id, int64_t server_us);
char *message_error(const struct fault *fault);
char *message_credit(uint32_t frames);
/* sequence: of the image, 0: none; fault: why the frame was refused, or NULL. */
char *message_fate(uint64_t number, enum server_fate fate, uint64_t sequence, const struct fault *fault);
char *message_sequence(const char *name, uint64_t stored);

/* The settings in force, in two parts as the status; values: the struct that the rows describe. */
char *message_control_shared(const struct setting *controls, const void *values);
char *message_control(const char *shared, uint64_t by, uint64_t request);

/* The answer about a pixel, from the text of a JSON object; and the radiance of a followed pixel. */
char *message_inspected(const char *object, uint64_t request);
char *message_radiance(const struct server_follow *pixel, const struct server_radiance *r);

/* A status in two parts: the one that all viewers share, and the message made from it for one viewer. */
char *message_status_shared(const struct server_figures *figures, const struct setting *controls);
char *message_status(const char *shared, int64_t server_us, uint32_t viewers, uint64_t sent, uint64_t skipped);

void message_free(char *text); /* NULL is allowed */
