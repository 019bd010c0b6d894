/* A relight.v1 client over libwebsockets: connects, with or without TLS, exchanges hello and welcome, carries text
 * and binary messages both ways, and reconnects with back-off when the connection breaks. One thread runs it
 * (connection_run) and gets all the hooks; only connection_wake may be called from others. */
#pragma once

#include "base/err.h"
#include "base/rng.h"

#include <jansson.h>
#include <openssl/ssl.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct connection;

/* How connection_run ended. */
enum connection_end {
    CONNECTION_DONE,    /* as asked for by connection_finish or connection_stop */
    CONNECTION_LOST,    /* gave up, or a fault that trying again does not mend */
    CONNECTION_REFUSED, /* the server does not want us: role, token, version, all places taken */
};

/* Called on the thread of connection_run. NULL: not of interest. */
struct connection_hooks {
    void (*welcome)(void *user, const json_t *welcome);           /* on every connection anew */
    void (*text)(void *user, const char *op, const json_t *text); /* all but welcome, pong, fatal errors */
    void (*binary)(void *user, const uint8_t *bytes, size_t size);
    void (*sent)(void *user); /* the last byte of connection_send's message was taken */
    void (*lost)(void *user); /* the connection that had been welcomed is gone; what was not sent is forgotten */
    void (*tick)(void *user); /* ten times a second, also without a connection, and after connection_wake */
};

struct connection_desc {
    const char *role;                       /* "viewer", "producer" or "recorder" */
    const char *pace, *sequence, *recorder; /* for hello (PROTOCOL.md 4.1); NULL: left out */
    const char *token;                      /* NULL: none */
    const char *url;                        /* as address_parse reads it */
    const char *ca_file; /* PEM file of the certificate authorities to trust; NULL: the system's. Of TLS only */
    int64_t tries;       /* attempts in a row before giving up after a loss; below 0: for ever */
    double give_up_s;    /* gives up after so long without a connection; 0: never */
    size_t binary_most;  /* bytes of a message from the server; larger ones end it with CONNECTION_LOST */
    bool quiet;          /* no lines about losing and finding the server */
    struct connection_hooks hooks;
    void *user;
};

/* ERR_USAGE: no such address, or a CA file without TLS. ERR_IO, ERR_FORMAT: the CA file. ERR_NOMEM. */
MUST_CHECK enum err connection_create(const struct connection_desc *d, struct connection **out, struct reason *why);
void connection_destroy(struct connection *c); /* NULL is allowed */

/* Returns at one of the ends. *why says what it was, but for CONNECTION_DONE. */
enum connection_end connection_run(struct connection *c, struct reason *why);

/* Queues a text message; the object is taken over. Nothing happens without a welcomed connection. */
void connection_say(struct connection *c, json_t *object);

/* Sends a binary message of two parts, in fragments; one at a time, only while welcomed. `head` is copied; `payload`
 * stays the caller's and must not change until the hook sent or lost. */
void connection_send(struct connection *c, const uint8_t *head, size_t head_size, const uint8_t *payload, size_t size);
bool connection_is_open(const struct connection *c); /* welcomed */

/* Ends after the server has confirmed that it read all that was said; when the connection breaks before that, it is
 * built again, and the next welcome may call this again. */
void connection_finish(struct connection *c);

/* Ends at once, with a clean close where there is a connection. */
void connection_stop(struct connection *c);

/* Ends with this result and text, after a clean close. The first such end counts. */
void connection_fail(struct connection *c, enum connection_end end, const char *format, ...) PRINTF_LIKE(3, 4);

/* Something useful was done: the next loss begins with the shortest wait again. */
void connection_thrive(struct connection *c);

/* The server's clock against ours, us; false while unknown. */
bool connection_clock(const struct connection *c, int64_t *ahead_us, int64_t *uncertain_us);

unsigned connection_count(const struct connection *c); /* welcomed so far */

void connection_tick_within(struct connection *c, int64_t us); /* the next tick, if a tenth of a second is too long */

void connection_wake(struct connection *c); /* any thread */

/* ---- Addresses ---- */

/* The address of a server, as a user writes it. Pure; any thread. */

#define ADDRESS_PORT 8080    /* relightd's own default */
#define ADDRESS_TLS_PORT 443 /* of every server with TLS */

struct address {
    bool tls;
    char host[256];  /* a name, or a numeric address without brackets */
    char named[272]; /* host and port as the Host header has them: brackets around IPv6, no zone */
    char path[256];  /* PROTOCOL_PATH unless the address names another */
    int port;
};

/* "ws://HOST[:PORT][/PATH]", or wss:// for TLS; http:// and https://, which relightd prints and browsers show, mean the
 * same. ERR_USAGE: *why quotes the address and says what is wrong with it. */
MUST_CHECK enum err address_parse(const char *text, struct address *out, struct reason *why);

/* ---- Trust ---- */

/* The servers that a TLS client trusts, and the reason if it does not trust one. Any thread. */

/* For TLS 1.2 and later. Trusts the certificate authorities in the PEM file, or the system's when it is NULL; the
 * certificate must name the address's host, also when that is numeric. ERR_USAGE: no certificate can; ERR_IO,
 * ERR_FORMAT: the file; ERR_NOMEM. The caller frees *out with SSL_CTX_free. */
MUST_CHECK enum err trust_create(const char *ca_file, const struct address *server, SSL_CTX **out, struct reason *why);

/* After a handshake that failed: true when the certificate is at fault; *why then says how, and what to do. */
bool trust_explain(const SSL *failed, const char *ca_file, struct reason *why);

/* ---- After a connection ---- */

/* Decides what to do after a connection has ended: PROTOCOL.md section 8 as a table, and the back-off. Pure; any
 * thread. */

#define RETRY_FIRST_MS 500  /* the back-off of PROTOCOL.md, section 8 */
#define RETRY_MOST_MS 10000 /* also what "later" waits at least */
#define RETRY_JITTER 0.2

enum retry_when {
    RETRY_AGAIN, /* with back-off */
    RETRY_LATER, /* the same, but not before RETRY_MOST_MS */
    RETRY_NEVER, /* until a person or a program changes something */
};

struct retry_rule {
    enum retry_when when;
    bool refused;     /* the server does not want this client; else a fault, or an accident */
    const char *name; /* of the close code, as section 8 has it; for messages */
};

/* After a close frame with this code; 1006 for none. Codes that are not known here are tried again later. */
struct retry_rule retry_after_close(int code);

/* After a handshake that was answered with this HTTP status; 0 for no answer at all. */
struct retry_rule retry_after_status(int status);

/* How long to wait before try number `tries` (from 0) since the last success: 500 ms doubling up to 10 s, 20 % more or
 * less, so that many clients do not come back at the same moment. */
int retry_wait_ms(unsigned tries, enum retry_when when, struct rng *rng);
