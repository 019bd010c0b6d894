/* Shared by the files of this room. The service thread owns all sockets; other threads access only what is
 * marked {lock} or atomic. */
#pragma once

#include "base/err.h"
#include "net/access/site.h"
#include "net/access/tls.h"
#include "net/message/message.h"
#include "net/stream/ingest.h"
#include "net/stream/limits.h"
#include "net/stream/server.h"

#include <libwebsockets.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* ---- Measurements ---- */

/* Measurements of the running server, and their text for Prometheus (exposition format 0.0.4). Any thread adds to
 * histograms without a lock; the service thread formats the text. */

#define METRICS_BOUNDS 13                    /* 0.5 ms to 5 s */
#define METRICS_KINDS (PROTOCOL_CHANGES + 6) /* of images: H.264 by size only, not by rate; renditions as one */

struct histogram {
    atomic_uint_fast64_t bucket[METRICS_BOUNDS + 1]; /* not cumulative; the last is above all bounds */
    atomic_uint_fast64_t sum_ns;
};

struct metrics {
    struct histogram timing[SERVER_TIMINGS];
    struct histogram encode[METRICS_KINDS];          /* SERVER_ENCODE, by kind of image */
    atomic_uint_fast64_t faults[FAULT_CODES];        /* protocol errors */
    atomic_uint_fast64_t published[METRICS_KINDS];   /* images, by kind */
    atomic_uint_fast64_t sent[METRICS_KINDS];        /* whole, to any viewer */
    atomic_uint_fast64_t skipped_slow, skipped_rate; /* because a viewer was slow, or limits its rate */
    atomic_uint_fast64_t scrapes;

    atomic_int_fast64_t loop_us;      /* last tick of the service thread (stream_now_us) */
    atomic_int_fast64_t loop_most_us; /* its longest piece of work */
    atomic_int_fast64_t loop_late_us; /* the longest delay of its tick */
    int64_t tick_due_us;              /* private to the service thread */

    atomic_int_fast64_t beat_ms;    /* of server_beat, on clock_ms; 0: never */
    atomic_int_fast64_t worked_ms;  /* when its thread last used a processor */
    atomic_int_fast64_t beat_clock; /* the thread's clockid_t; {beat_ms > 0} */
    int64_t worked_ns;              /* of that clock, service thread's own */
};

/* Adds one time. Negative times and NaN count as 0. Any thread. */
void histogram_add(struct histogram *h, double seconds);

struct server;

/* Maps a kind of STREAM_KINDS to one of METRICS_KINDS. */
unsigned metrics_kind(unsigned kind);

/* Thread: service. The whole text, freed by mem_free; NULL: out of memory. */
char *metrics_text(struct server *s, size_t *size);

/* Thread: service. The half-second tick; every_us: its period. */
void metrics_tick(struct server *s, int64_t now_us, int64_t every_us);

/* Thread: service. Reports the end of work that began at begun_us. */
void metrics_worked(struct server *s, int64_t begun_us);

/* ---- Pixel inspector ---- */

/* Queries about pixels (PROTOCOL.md 4.15 to 4.17): pending queries, unsent answers, and pixels followed from image to
 * image. Guarded by the server's lock. */

#define INSPECTIONS_WAITING 32 /* bound memory: further questions are refused, the oldest answers dropped */
#define INSPECTIONS_ANSWERS 8
#define INSPECTIONS_RATE 4.0  /* answers per second, for all clients together: a token bucket */
#define INSPECTIONS_BURST 8.0 /* its size */

struct inspect_reply {
    uint64_t by, request;
    char *text; /* the answer's fields; NULL: none, because of */
    char error[sizeof(struct reason)];
};

struct inspect_followed {
    struct server_follow pixel;
    struct server_radiance radiance;
    bool due; /* not sent yet */
};

struct inspections {
    struct server_inspection waiting[INSPECTIONS_WAITING]; /* not about the sky alone */
    struct client *askers[INSPECTIONS_WAITING];            /* of these */
    unsigned waiting_count;
    uint64_t turns; /* questions taken: the next is of the client whose last turn is longest ago */
    bool sky_waits; /* somebody asks for the sky alone; all share the answer */
    bool sky_due;   /* that answer is to be sent: */
    char *sky;      /* its fields; NULL: none, because of */
    char sky_error[sizeof(struct reason)];
    struct inspect_reply answers[INSPECTIONS_ANSWERS]; /* to send; when full, the oldest is dropped */
    unsigned answer_count;
    struct inspect_followed followed[SERVER_FOLLOWED_MAX];
    struct client *followers[SERVER_FOLLOWED_MAX]; /* of these */
    unsigned followed_count;
    struct bucket questions;
};

/* Frees the unsent answers; zeroed memory is allowed. Thread: the owner's, when no other thread uses p. */
void inspections_finish(struct inspections *p);

/* ---- Control ---- */

/* Controllers' requests and the current settings. Guarded by the server's lock. */

#define CONTROL_WAITING 16 /* pending requests */
#define CONTROL_ANSWERS 32

struct control_answer {
    uint64_t by, request;
    char error[sizeof(struct reason)]; /* "": success */
    const char *clause;
};

struct control {
    struct server_control waiting[CONTROL_WAITING];
    unsigned waiting_count;
    struct control_answer answers[CONTROL_ANSWERS]; /* to send; when full, the oldest is dropped */
    unsigned answer_count;
    char *shared;         /* the settings, see message_control_shared; NULL: unknown */
    uint64_t version;     /* increases with each change */
    uint64_t by, request; /* of the last change */
};

/* Queues a request, or merges it into the last one of the same controller. False: the queue is full. Takes the lock
 * itself. Any thread. */
MUST_CHECK bool control_ask(struct server *s, const struct server_control *c);

/* ---- Connections ---- */

/* Kinds of image, each with its own newest image and sequence numbers: JPEG and EXR formats, JPEG at half and
 * quarter size, the tracks of H.264, and renditions. A kind is an enum protocol_format or one of these. */
#define STREAM_JPEG_HALF (PROTOCOL_CHANGES + 1)
#define STREAM_JPEG_QUARTER (PROTOCOL_CHANGES + 2)
#define STREAM_TRACKS (PROTOCOL_CHANGES + 3)              /* the first of them */
#define STREAM_RENDITIONS (STREAM_TRACKS + SERVER_TRACKS) /* likewise, of renditions */
#define STREAM_KINDS (STREAM_RENDITIONS + SERVER_RENDITIONS)
#define STREAM_CHAIN 16                    /* H.264 images kept for viewers that are behind */
#define STREAM_CHUNK ((size_t)64 << 10)    /* one fragment of an image */
#define STREAM_UNSENT (128 << 10)          /* maximum unsent bytes in the kernel: these cannot be skipped */
#define STREAM_RECEIVE ((size_t)128 << 10) /* largest piece received at once */
#define STREAM_OUTBOX 256                  /* text messages waiting for one client: more than STREAM_BURST answers */
#define STREAM_PONGS 8                     /* with more messages waiting, pings get no answer */
#define STREAM_PIECES 4096                 /* maximum callbacks for one text message */

enum {
    STREAM_STATUS_US = 500000,   /* between statuses */
    STREAM_HELLO_US = 5000000,   /* from connection to hello */
    STREAM_STALL_US = 10000000,  /* without a byte taken while some wait */
    STREAM_GOODBYE_US = 2000000, /* for clients to leave when the server stops */
    STREAM_FRAME_MS = 30000,     /* default time limit for receiving a frame */
    STREAM_SILENT_US = 5000000,  /* another producer may replace one silent for this long */
    STREAM_ABSENT_US = 10000000, /* a recorder that left keeps its name for this long */
    STREAM_GRANT_US = 2000,      /* between two grants of credit, so that small frames cannot flood */
    STREAM_LAG_US = 500000,      /* an H.264 viewer further behind skips to the newest image */
};

/* Rate limit of a client's text messages: a token bucket. */
#define STREAM_BURST 200.0
#define STREAM_RATE 300.0

/* A connection after the upgrade to WebSocket, whatever its role. */
struct websocket {
    struct server *server;
    struct websocket *next; /* in server->websockets */
    struct lws *wsi;
    uint64_t id; /* 1, 2, ... in the order of arrival */
    char peer[CLIENT_NAME];
    struct connection *connection; /* its place and client; NULL only until it is open */
    int64_t opened_us, heard_us;   /* when it connected, and when it last sent bytes */

    bool greeted; /* hello was accepted */
    enum server_role role;
    bool subscribed;
    struct message wish; /* the last subscribe */
    unsigned kind;       /* kind of image that this selects at the present size */
    int64_t since_us;    /* when it last started or resumed watching */

    struct sent_image *current; /* being sent, or NULL */
    bool repeated;              /* current is older than since_us */
    size_t offset;              /* bytes of current handed to libwebsockets */
    struct {
        uint64_t sequence;
        int64_t placed_us; /* monotonic */
    } unacked[PROTOCOL_CREDIT_H264];
    unsigned unacked_count;
    uint64_t begun;    /* sequence of the last image begun, of the present kind */
    bool chained;      /* H.264: it can decode image begun + 1 */
    uint64_t outdated; /* acks up to this sequence may mean images of a kind watched before */
    uint64_t sent, skipped;
    int64_t due_us; /* no image before this time: the viewer's max_rate */
    lws_sorted_usec_list_t pace;

    struct sequence *sequence; /* of a lockstep producer or a recorder */
    bool recorder, sent_end;

    bool producing;           /* it is server->producer */
    uint32_t credit;          /* frames that it may still start to send */
    struct assembly assembly; /* the frame being received */
    int64_t frame_us;         /* when its reception began */
    int64_t granted_us;
    lws_sorted_usec_list_t grant;

    uint64_t control_seen; /* version of the settings last sent to it */
    bool probing;          /* a question about a pixel is open */
    bool asking_sky;       /* likewise about the sky alone, */
    uint64_t sky_request;  /* by this request */
    bool answer_due;       /* its control message `answer` waits for a reply */
    uint64_t answer;

    char *outbox[STREAM_OUTBOX + 1]; /* the last place is for the error that ends the connection */
    unsigned outbox_count;
    size_t outbox_bytes;
    bool status_due;
    int64_t moved_us; /* when the kernel last took bytes, or when the first began to wait */
    bool waiting;     /* a write callback was requested */

    bool cut;            /* will be closed without a word */
    uint16_t close_code; /* 0: stays */
    char close_text[FAULT_REASON];

    char text[PROTOCOL_TEXT_MAX]; /* the message being received */
    size_t text_size;
    unsigned pieces;
    struct bucket messages; /* rate limit of these */
    struct flood flood;

    uint8_t staging[LWS_PRE +
                    STREAM_CHUNK]; /* libwebsockets writes its header in front of the bytes, so copy shared ones here */
};

/* Counted by the service thread, read by any. */
struct stream_counts {
    atomic_uint_fast64_t connections, open, refused, errors, sent, skipped, acked, bytes, stalled;
    atomic_uint_fast64_t frames_cut, frame_bytes;
    atomic_uint_fast64_t wrong_tokens, too_fast;
};

struct server {
    /* Constant once the thread runs, so any thread may read it; except tokens, limits, public names and certificate,
     * which server_take_change changes and only the service thread reads. */
    struct site site;
    char address[64];
    char url[96];
    char *tls_cert, *tls_key; /* NULL: plain */
    struct tls *tls;          /* the content of these files; NULL: plain */
    char session[20];         /* random, new with every start */
    char *tokens[SERVER_ROLES];
    char *token_metrics;                             /* required for /metrics; NULL: none */
    bool loopback;                                   /* it listens on a loopback address */
    bool allow_remote, push, controllers, recorders; /* the last three: the role is offered */
    bool h264;                                       /* the format is offered */
    const struct setting *controls;                  /* see server_desc */
    atomic_bool *new_work;                           /* set when a request from a controller waits; may be NULL */
    const atomic_bool *leave;                        /* set when the program ends; may be NULL */
    size_t max_frame_bytes;
    uint32_t frame_ms;
    uint16_t port;
    bool behind_proxy;
    uint8_t proxies[2][16]; /* its addresses as IPv6: both that were given, or this machine's by IPv4 and IPv6 */
    uint32_t silent_s;
    char *public_names; /* further Host names to accept, separated by commas; or NULL */
    char *embed_policy; /* the content security policy of /embed */
    struct lws_context *context;
    struct lws_protocols protocols[3];
    lws_retry_bo_t validity;
    pthread_t thread;
    bool running; /* the thread was started */

    /* The service thread's own. */
    struct websocket *websockets;
    struct watcher *watchers;   /* of plain HTTP, the newest first */
    struct websocket *producer; /* NULL: none */
    struct limits limits;
    uint64_t last_id, rounds; /* the latter of holdings.c */
    lws_sorted_usec_list_t tick;
    bool leaving; /* all clients were told */

    atomic_bool stopping;
    atomic_bool urgent;  /* send a status at once */
    atomic_bool resized; /* images changed size: viewers may need another kind */
    struct stream_counts counts;
    struct metrics metrics;

    pthread_mutex_t lock;
    struct sent_image *latest[STREAM_KINDS];               /* {lock} NULL before the first */
    uint64_t issued[STREAM_KINDS];                         /* {lock} the last sequence number given */
    uint64_t begun;                                        /* {lock} calls of server_begin_image */
    struct sent_image *chain[SERVER_TRACKS][STREAM_CHAIN]; /* {lock} image n at n % STREAM_CHAIN; NULL: not kept */
    uint32_t keys_wanted;                                  /* {lock} bits 1 << track: a viewer needs a keyframe */
    uint64_t published;                                    /* {lock} */
    int64_t captured_us;                                   /* {lock} of the last frame whose age was observed */
    char *status;                /* {lock} the part of a status that all viewers share; NULL: figures have changed */
    struct server_demand demand; /* {lock} what viewers want; server_demand adds the rest */
    uint32_t users[SERVER_RENDITIONS]; /* {lock} watchers of each rendition */
    uint64_t last_serial;              /* {lock} of renditions */
    struct ingest ingest;              /* {lock} unless noted there */
    struct control control;            /* {lock} */
    struct inspections inspections;    /* {lock} */
    struct server_figures figures;     /* {lock} */
    struct server *next;               /* {lock} the description from server_change; never runs */
};

/* sent_image.c: gives an image its place in the stream, before other threads see it. Adds flags. */
void image_stamp(struct sent_image *p, uint64_t sequence, uint64_t made, int64_t published_us, uint8_t flags);
uint64_t image_made(const struct sent_image *p);                   /* server.begun when it was published */
int image_rendition(const struct sent_image *p, uint64_t *serial); /* its slot; -1: none */
int64_t image_placed_us(const struct sent_image *p);               /* when, by stream_now_us */

/* server.c: the kind of an image; {lock} the kind for a subscription: the largest size that fits. */
unsigned image_kind(const struct sent_image *p);
unsigned subscribed_kind(const struct server *s, const struct message *wish);

/* server.c: a server from its description, not started. *e: as server_create; free it in every case. NULL: ERR_NOMEM.
 */
struct server *server_prepare(const struct server_desc *desc, enum err *e, struct reason *why);
/* server.c: checks address, roles and tokens. ERR_USAGE: not allowed together. */
MUST_CHECK enum err server_may_listen(struct server *s, uint16_t port, struct reason *why);

/* change.c, thread: service. Applies what server_change has left in s->next. */
void server_take_change(struct server *s);
/* change.c, thread: the owner of the certificate. Logs its expiry, as a warning if it is soon. */
void server_log_certificate(const struct server *s);

/* holdings.c, thread: service. Cuts clients while what all of them have not read takes too much memory. */
void holdings_limit(struct server *s);

/* sent_image.c, thread: service. Whether it was not counted in this round yet; counts it. */
bool image_count(struct sent_image *p, uint64_t round);

/* server.c: {lock} makes the image the newest of its kind. The caller releases the one before, which it returns. */
struct sent_image *server_place(struct server *s, struct sent_image *p, uint8_t flags);

/* chain.c: H.264 images, each of which needs the one before unless it is a keyframe. All {lock}. */
void chain_place(struct server *s, struct sent_image *p); /* keeps it if watched, with a new reference */
void chains_clear(struct server *s, uint32_t watched);    /* drops the images of tracks not in `watched` */
/* The viewer's next image: the next of its chain, or else the newest keyframe. Not referenced; NULL: none. */
struct sent_image *chain_next(const struct server *s, const struct websocket *ws);
uint64_t chain_newest(struct server *s, unsigned track); /* the last sequence number; takes the lock itself */
/* Whether p may begin before images under way are acknowledged. */
bool chain_may_begin(const struct server *s, const struct websocket *ws, const struct sent_image *p);
/* Requests a keyframe if the viewer cannot continue without one. */
void chain_ask(struct server *s, const struct websocket *ws);

/* http.c, websocket.c: the callbacks of libwebsockets. Thread: service. */
int http_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length);
int websocket_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length);

/* One request. */
struct http_session {
    const uint8_t *bytes; /* the unsent rest of the body */
    size_t left;
    char *text; /* the body if it is no file; owned, freed once sent */
};

/* The head of a response. Zero means the default. */
struct http_head {
    unsigned status;
    const char *type;
    const char *etag;   /* in quotes; NULL: none */
    const char *policy; /* of a page that others may show in a frame: its content security policy */
    size_t size;        /* of the body */
    bool endless;       /* the body ends with the connection */
    bool fresh;         /* never to be stored; else to be checked each time */
    bool asks_password;
};
/* http.c: sends it. 0, or -1: close the connection. */
int http_send_head(struct lws *wsi, const struct http_head *head);

/* Whether a name is a socket's own address, numerically. */
bool http_is_address(const struct sockaddr_storage *local, const char *name);

/* http.c: the headers of every response, among them the content security policy. Static. Any thread. */
const struct lws_protocol_vhost_options *http_headers(void);
/* http.c: whether the request's Host is accepted, and its Origin, if any, is that Host: pages from elsewhere must not
 * reach a server on the user's own machine. Thread: service. */
bool http_host_ok(const struct server *s, struct lws *wsi);
bool http_origin_ok(struct lws *wsi);
/* http.c: whether the browser says that a page of another site asks, other than by a link to here, and, for what is
 * framed, by a frame: it would not get to see the answer, but take a place and time. Thread: service. */
bool http_is_foreign(struct lws *wsi, bool framed);
/* http.c: the policy of /embed for these origins, separated by commas; NULL: none. ERR_USAGE names what is no origin.
 * ERR_NOMEM. */
MUST_CHECK enum err embed_policy(const char *origins, char **out, struct reason *why);
/* Answers and closes the connection: returns -1. */
int http_refuse(struct server *s, struct lws *wsi, unsigned status, const char *text);
/* Short: one write, text of at most 1024 bytes. Long: takes over text. 0, or -1: close the connection. */
int http_respond_text(struct lws *wsi, unsigned status, const char *type, const char *text, bool head);
int http_respond_long(struct lws *wsi, struct http_session *h, const char *type, char *text, size_t size, bool head);

/* monitor.c, thread: service. Whether path is /healthz, /readyz or /metrics; and the answer, as http_respond_text. */
bool monitor_knows(const char *path);
int monitor_answer(struct server *s, struct lws *wsi, struct http_session *h, const char *path, bool head);

/* websocket_send.c, thread: service. */
static inline int64_t stream_now_us(void)
{
    return (int64_t)lws_now_usecs();
}
void websocket_request_write(struct websocket *ws);     /* requests a write callback */
void websocket_queue(struct websocket *ws, char *text); /* queues a message, takes it over; NULL: nothing */
void websocket_close(struct websocket *ws, uint16_t code, const char *text); /* closes after the queued messages */
void websocket_send_error(struct websocket *ws,
                          const struct fault *fault); /* sends the error, and closes if it is fatal */
/* The viewer's next image, not begun yet, as a new reference; NULL: none. */
struct sent_image *websocket_next_image(struct websocket *ws);
/* When a viewer's next image is due after one at now_us that was due at due_us, at so many a second, 0 for any. A
 * delay below one interval is made up for, so that the average rate holds. */
int64_t websocket_due(int64_t due_us, int64_t now_us, double rate);
/* Whether an image may begin now. If only the viewer's rate forbids it, schedules a write for later. */
bool websocket_may_begin(struct websocket *ws);
int websocket_write(struct websocket *ws); /* one write; -1: close the connection */

/* websocket_receive.c, thread: service. Chooses the viewer's kind for its subscription and the present size. */
void websocket_choose(struct websocket *ws);
/* One piece of a message from the viewer. */
void websocket_receive(struct websocket *ws, const uint8_t *in, size_t length);

/* producer.c, thread: service. */
void producer_hello(struct websocket *ws, const struct message *m, struct welcome *w, struct fault *fault);
/* One piece of a binary message. */
void producer_receive(struct websocket *ws, const uint8_t *in, size_t length, size_t coming, bool last);
void producer_tick(struct websocket *ws, int64_t now_us);
void producer_leave(struct websocket *ws); /* closed or replaced: frees the frame being received */
void producers_send(struct server *s);     /* sends fates and credit that are due */

/* recorder.c, thread: service. A recorder is a viewer that gets every image of one lockstep sequence. */
void recorder_hello(struct websocket *ws, const struct message *m, struct welcome *w, struct fault *fault);
bool recorder_subscribe(struct websocket *ws, const struct message *m, struct fault *fault);
/* received: the image was sent to ws, and not acknowledged before. */
void recorder_ack(struct websocket *ws, const struct message *m, bool received, struct fault *fault);
void recorder_send_end(struct websocket *ws); /* sends the end of its sequence, if over */
void recorder_leave(struct websocket *ws);
void recorder_displace(struct websocket *ws); /* takes the name of its sequence, and closes it */

/* Drops the first of *count elements of an array. */
static inline void drop_first(void *array, unsigned *count, size_t size)
{
    --*count;
    memmove(array, (const char *)array + size, *count * size);
}

/* websocket.c: the connection of that number; NULL: it is gone. Thread: service. */
struct websocket *websocket_of(const struct server *s, uint64_t id);

/* control.c, thread: service. */
void controls_tell(struct server *s);         /* sends answers */
bool control_due(const struct websocket *ws); /* whether ws needs the present settings */
char *control_text(struct websocket *ws);     /* that message; NULL: out of memory */

/* pixel_inspection.c, thread: service. */
void inspect_take(struct websocket *ws, const struct message *m, struct fault *fault); /* a question */
void inspect_leave(struct websocket *ws);                                              /* it is closed */
void inspections_send(struct server *s);                                               /* sends answers */
bool inspect_due(const struct websocket *ws); /* whether ws needs the radiance of its pixel */
char *inspect_text(struct websocket *ws);     /* that message; NULL: out of memory, or none */

/* websocket.c, thread: service. Whether ws may be admitted; if not, it is told so and closed. */
bool websocket_has_room(struct websocket *ws);
void websockets_wake(struct server *s);       /* new images or states: requests writes */
void websockets_tick(struct server *s);       /* twice a second: statuses and time limits */
void websockets_leave(struct server *s);      /* tells all clients that the server stops */
void viewers_demand(struct server *s);        /* sums up what viewers want */
void websocket_limit_unsent(struct lws *wsi); /* of a connection, to STREAM_UNSENT */

/* A request for images by plain HTTP: for one, or for a stream. */
struct watcher {
    struct server *server;
    struct watcher *next; /* in server->watchers */
    struct lws *wsi;
    struct connection *connection;
    char peer[CLIENT_NAME];
    const struct resource *resource;
    bool head;                  /* without a body */
    unsigned kind;              /* of images */
    uint64_t fresh;             /* older images (image_made) do not count */
    int64_t opened_us, sent_us; /* the latter: when the last image had been sent */
    int64_t moved_us;           /* as in struct websocket */
    bool waiting, answered, closing;

    struct sent_image *current; /* being sent, or NULL */
    size_t offset;              /* bytes of it passed to libwebsockets */
    bool again;                 /* the same image is due again, for proxies that expect bytes */
    uint64_t begun, sent, skipped;
};

#define WATCHER_PATHS "/snapshot.jpg, .png and .exr, /stream.mjpeg"

/* watcher.c, thread: service. Whether path has images; the answer, as http_respond_text; one write. */
bool watcher_knows(const char *path);
int watcher_request(struct server *s, struct lws *wsi, const char *path, bool head);
int watcher_write(struct watcher *w);
bool watcher_streams(const struct watcher *w);
void watcher_close(struct watcher *w);   /* soon, by the server's own choice */
void watcher_destroy(struct watcher *w); /* NULL is allowed */
void watchers_wake(struct server *s);    /* as websockets_... */
void watchers_tick(struct server *s);
void watchers_demand(const struct server *s, struct server_demand *d); /* {lock} */

/* watcher.c: {lock} whether the image is of its slot's present use. */
bool rendition_is_wanted(const struct server *s, const struct sent_image *p);
