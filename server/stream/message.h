/* server/stream/message.h */
/* The text messages of relight.v1 (PROTOCOL.md sections 3 to 5): JSON in, checked values out, and back. No socket and
 * no state: functions of their arguments, any thread. */
#ifndef STREAM_MESSAGE_H
#define STREAM_MESSAGE_H

#include "server.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* PROTOCOL.md section 8: what can be wrong, its name on the wire and its close code (0: the connection stays). */
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
    FAULT_TOO_BIG,
    FAULT_UNKNOWN_OP,
    FAULT_NOT_OFFERED,
    FAULT_CODES,
};

struct fault {
    enum fault_code code;
    const char *clause; /* of PROTOCOL.md */
    char text[120];     /* fits a close frame's reason */
};

const char *fault_name(enum fault_code code);
uint16_t fault_close_code(enum fault_code code);

/* Sets *f and returns its code. */
enum fault_code fault_say(struct fault *f, enum fault_code code, const char *clause, const char *format, ...)
    PRINTF_LIKE(4, 5);

enum message_op {
    MESSAGE_HELLO,
    MESSAGE_SUBSCRIBE,
    MESSAGE_ACK,
    MESSAGE_PING,
};

struct message {
    enum message_op op;
    union {
        struct {
            enum server_role role;
            uint32_t major, minor;
            char token[256];
        } hello;
        struct {
            enum protocol_format format;
            int quality;     /* 1..100; 0: not said */
            double max_rate; /* pictures per second; 0: no limit */
            bool paused;
            uint64_t request; /* echoed; 0: not said */
        } subscribe;
        struct {
            uint64_t sequence;
            int64_t displayed_us; /* on the server's clock as the viewer estimates it; 0: not said */
        } ack;
        struct {
            uint64_t id;
        } ping;
    };
};

/* Reads one text message. FAULT_NONE, or what is wrong with it, said in *fault. *m is then undefined. */
enum fault_code message_parse(const char *text, size_t length, struct message *m, struct fault *fault);

/* Whole messages, to be freed with message_free; NULL when out of memory. */
char *message_welcome(const char *session, uint32_t max_connections);
char *message_subscribed(const struct message *m);
char *message_pong(uint64_t id, int64_t server_us);
char *message_error(const struct fault *fault);

/* A status, in two parts: what all viewers share, made once, and a message made of it for one viewer. */
char *message_status_shared(const struct server_status *status);
char *message_status(const char *shared, int64_t server_us, uint32_t viewers, uint64_t sent, uint64_t skipped);

void message_free(char *text); /* NULL is allowed */

#endif
