/* server/stream/internal.h */
/* What the files of this room share. The service thread owns every socket and every viewer; other threads reach only
 * what is marked {lock} or atomic. */
#ifndef STREAM_INTERNAL_H
#define STREAM_INTERNAL_H

#include "assembly.h"
#include "control.h"
#include "ingest.h"
#include "message.h"
#include "metrics.h"
#include "probe.h"
#include "server.h"
#include "site.h"
#include "tls.h"
#include "visitors.h"

#include <libwebsockets.h>
#include <pthread.h>
#include <stdatomic.h>

/* Kinds of picture, each with a newest one and numbers of its own: the formats but for H.264, JPEG at half and a
 * quarter of its size, and the tracks of H.264. A kind is an enum protocol_format or one of these. */
#define STREAM_JPEG_HALF (PROTOCOL_H264 + 1)
#define STREAM_JPEG_QUARTER (PROTOCOL_H264 + 2)
#define STREAM_TRACKS (PROTOCOL_H264 + 3) /* the first of them */
#define STREAM_KINDS (STREAM_TRACKS + SERVER_TRACKS)
#define STREAM_CHAIN 16                    /* pictures of H.264 that are kept for those who are behind */
#define STREAM_CHUNK ((size_t)64 << 10)    /* one fragment of a picture */
#define STREAM_UNSENT (128 << 10)          /* bytes the kernel may hold unsent: what is behind cannot be skipped */
#define STREAM_RECEIVE ((size_t)128 << 10) /* the largest piece that is received at once */
#define STREAM_OUTBOX 32                   /* text messages waiting for one client */
#define STREAM_PONGS 8                     /* above so many waiting, pings stay unanswered */
#define STREAM_PIECES 4096                 /* callbacks that one text message may take */

enum {
    STREAM_STATUS_US = 500000,   /* between statuses */
    STREAM_HELLO_US = 5000000,   /* from connection to hello */
    STREAM_STALL_US = 10000000,  /* without a byte taken while some wait */
    STREAM_GOODBYE_US = 2000000, /* for all to hear that the server goes */
    STREAM_FRAME_MS = 30000,     /* from a frame's first byte to its last, where nothing else is said */
    STREAM_SILENT_US = 5000000,  /* after which another producer may take a silent one's place */
    STREAM_GRANT_US = 2000,      /* between two grants of credit, so that small frames cannot flood */
    STREAM_LAG_US = 500000,      /* by which a viewer of H.264 may be behind before it is taken to the newest picture */
};

/* Text messages a viewer may send: so many at once, and so many a second in the long run. */
#define STREAM_BURST 200.0
#define STREAM_RATE 300.0

/* A connection, whatever its role. */
struct viewer {
    struct server *server;
    struct viewer *next; /* in server->viewers */
    struct lws *wsi;
    uint64_t id; /* 1, 2, ... in the order of arrival */
    char peer[VISITOR_NAME];
    struct visitor *visitor;     /* where it comes from; NULL: unknown */
    int64_t opened_us, heard_us; /* when it came, and when bytes last came from it */

    bool greeted; /* hello was accepted */
    enum server_role role;
    bool subscribed;
    struct message wish; /* the last subscribe, */
    unsigned kind;       /* and the kind of picture that it comes to, by the size that there is */
    int64_t since_us;    /* when the last subscribe came that began or resumed watching */

    struct picture *current; /* being sent, or NULL */
    bool repeated;           /* current is older than since_us */
    size_t offset;           /* bytes of current that lws has taken */
    struct {
        uint64_t sequence;
        int64_t placed_us; /* monotonic */
    } unacked[PROTOCOL_CREDIT_H264];
    unsigned unacked_count;
    uint64_t begun;    /* sequence of the last picture begun, of the kind of the moment */
    bool chained;      /* H.264: it has what picture begun + 1 needs */
    uint64_t outdated; /* acks up to this sequence may mean pictures of a kind watched before */
    uint64_t sent, skipped;
    int64_t due_us; /* not before: the viewer's max_rate */
    lws_sorted_usec_list_t pace;

    struct sequence *sequence; /* of a lockstep producer or a recorder */
    bool recorder, told_end;

    bool producing;           /* it is server->producer */
    uint32_t credit;          /* frames that it may still begin to send */
    struct assembly assembly; /* the frame that is coming in */
    int64_t frame_us;         /* when that began */
    int64_t granted_us;
    lws_sorted_usec_list_t grant;

    uint64_t control_seen; /* version of what is in force that it was told */
    bool probing;          /* a question about a pixel is under way */
    bool asking_sky;       /* one about the sky alone */
    bool answer_due;       /* an answer to its own control message `answer` */
    uint64_t answer;

    char *outbox[STREAM_OUTBOX];
    unsigned outbox_count;
    bool status_due;
    int64_t moved_us; /* when bytes were last taken, or when the first began to wait */
    bool waiting;     /* a write callback has been asked for */

    uint16_t close_code; /* 0: stays */
    char close_text[FAULT_REASON];

    char text[PROTOCOL_TEXT_MAX]; /* the message coming in */
    size_t text_size;
    unsigned pieces;
    double tokens; /* of the rate limit */
    int64_t tokens_us;

    uint8_t staging[LWS_PRE + STREAM_CHUNK]; /* lws writes its header in front, so shared bytes are copied here */
};

/* Counted by the service thread, read by any. */
struct stream_counts {
    atomic_uint_fast64_t connections, open, refused, errors, sent, skipped, acked, bytes, stalled;
    atomic_uint_fast64_t frames_cut, frame_bytes;
    atomic_uint_fast64_t crowded, wrong_tokens, too_fast;
};

struct server {
    /* Fixed once the thread runs, and so any thread may read it, but for what server_take_change changes: tokens,
     * limits, hosts and certificate, which the service thread alone reads from then on. */
    struct site site;
    char address[64];
    char url[96];
    char *tls_cert, *tls_key; /* NULL: plain */
    struct tls *tls;          /* what is in these files; NULL: plain */
    char session[20];         /* random, new with every start */
    char *tokens[SERVER_ROLES];
    char *token_metrics;                  /* what /metrics asks for; NULL: nothing */
    bool loopback;                        /* it listens to this machine alone */
    bool allow_remote, push, controllers; /* the last two: that role is offered */
    bool h264;                            /* that format is offered */
    atomic_bool *stirred;                 /* set when a controller asks for something; may be NULL */
    const atomic_bool *leave;             /* set when the program is to end; may be NULL */
    size_t max_frame_bytes;
    uint32_t frame_ms;
    uint16_t port;
    uint32_t max_connections, max_per_address;
    bool max_per_address_said; /* then this machine's own address is not spared */
    bool behind_proxy;
    uint32_t silent_s;
    char *hosts; /* other names that are answered to, with commas between; or NULL */
    struct lws_context *context;
    struct lws_protocols protocols[3];
    lws_retry_bo_t validity;
    pthread_t thread;
    bool running; /* the thread was started */

    /* The service thread's own. */
    struct viewer *viewers;
    struct viewer *producer; /* the one there is, or NULL */
    struct visitors visitors;
    uint64_t last_id;
    lws_sorted_usec_list_t tick;
    bool leaving; /* everybody has been told */

    atomic_bool stopping;
    atomic_bool urgent;  /* a status is to go out at once */
    atomic_bool resized; /* pictures have another size: what fits a viewer may be of another kind */
    struct stream_counts counts;
    struct metrics metrics;

    pthread_mutex_t lock;
    struct picture *latest[STREAM_KINDS];               /* {lock} NULL before the first */
    uint64_t issued[STREAM_KINDS];                      /* {lock} the last sequence number given */
    struct picture *chain[SERVER_TRACKS][STREAM_CHAIN]; /* {lock} picture n at n % STREAM_CHAIN; NULL: not kept */
    uint32_t keys_wanted;      /* {lock} bit 1 << track: somebody can go on only at a key picture */
    uint32_t width, height;    /* {lock} of a whole picture, as the status says; 0: unknown */
    uint64_t published;        /* {lock} */
    int64_t captured_us;       /* {lock} of the last frame whose age was taken */
    char *status;              /* {lock} what all viewers are told, see message_status_shared */
    enum server_source source; /* {lock} of that status */
    char detail[sizeof(((struct reason *)NULL)->text)]; /* {lock} */
    struct server_demand demand;                        /* {lock} what viewers want; the rest is found when asked */
    struct ingest ingest;                               /* {lock} but for what it says of itself */
    struct control control;                             /* {lock} */
    struct probes probes;                               /* {lock} */
    struct server_figures figures;                      /* {lock} */
    struct server_decoder decoder;                      /* {lock} */
    struct server *next;                                /* {lock} one that never runs: what server_change was told */
    int64_t source_us;                                  /* {lock} wall clock: since when the source is in this state */
};

/* picture.c: gives a picture its place in the stream; before anybody else sees it. flags are added. */
void picture_stamp(struct picture *p, uint64_t sequence, int64_t published_us, uint8_t flags);
int64_t picture_placed_us(const struct picture *p); /* when that was, on viewer_now_us's clock */

/* server.c: the kind of a picture, and {lock} the one that a subscription asks for: the largest that fits. */
unsigned picture_kind(const struct picture *p);
unsigned subscribed_kind(const struct server *s, const struct message *wish);

/* server.c: a server that knows what it was told, and has done nothing yet. NULL: out of memory; *e is what is wrong.
 */
struct server *server_told(const struct server_desc *desc, enum err *e, struct reason *why);
/* server.c: whether its address may be listened to, given what is asked for there. */
MUST_CHECK enum err server_may_listen(struct server *s, uint16_t port, struct reason *why);

/* change.c, thread: service. What server_change has brought is in force. */
void server_take_change(struct server *s);
/* change.c, thread: whose the certificate is. Tells the log until when it is valid, with a warning where that is soon.
 */
void server_tell_certificate(const struct server *s);

/* server.c: {lock} makes the picture the newest of its kind. Returns the one before, to be released by the caller. */
struct picture *server_place(struct server *s, struct picture *p, uint8_t flags);

/* chain.c: pictures of H.264, each of which but for key pictures needs the one before. All {lock}. */
void chain_place(struct server *s, struct picture *p); /* keeps it, with a reference of its own, if anybody watches */
void chains_clear(struct server *s, uint32_t watched); /* those of the other tracks */
/* The picture that the viewer gets next: the next of its chain, or else the newest key picture. Not referenced; NULL:
 * none. */
struct picture *chain_next(const struct server *s, const struct viewer *v);
uint64_t chain_newest(struct server *s, unsigned track); /* the last number given; takes the lock itself */
/* Whether it may begin before what is under way is acknowledged. */
bool chain_may_begin(const struct server *s, const struct viewer *v, const struct picture *p);
/* Notes that a key picture is wanted if the viewer has nothing to go on with. */
void chain_ask(struct server *s, const struct viewer *v);

/* http.c, viewer.c: the callbacks of lws. Thread: service. */
int http_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length);
int viewer_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length);

/* What http_callback keeps per request. */
struct http_session {
    const uint8_t *bytes; /* the rest of the file that is being sent */
    size_t left;
    char *text; /* of which bytes is a part, where it is no file; freed when it has gone */
};

const struct lws_protocol_vhost_options *http_headers(void);
/* http.c: whether this request's Host is one we answer to, and its Origin, if any, is that Host: pages of others must
 * not reach a server on a visitor's own machine, under whatever name they reach it. Thread: service. */
bool http_host_ok(const struct server *s, struct lws *wsi);
bool http_origin_ok(struct lws *wsi);
/* Answers and has the connection closed: returns -1. */
int http_refuse(struct server *s, struct lws *wsi, unsigned status, const char *text);
/* A short answer in one write, and a long one, whose text is taken over. */
int http_respond_text(struct lws *wsi, unsigned status, const char *type, const char *text, bool head);
int http_respond_long(struct lws *wsi, struct http_session *h, const char *type, char *text, size_t size, bool head);

/* monitor.c, thread: service. Whether that path is one of /healthz, /readyz, /metrics; and the answer. */
bool monitor_knows(const char *path);
int monitor_answer(struct server *s, struct lws *wsi, struct http_session *h, const char *path, bool head);

/* admission.c, before the thread runs: copies of what was said, *out NULL where there is none. False: out of memory.
 * What a token is is never said, in no message. */
bool admission_copy(char **out, const char *text);
enum err admission_copy_token(const char *name, const char *token, char **out, struct reason *why);

/* admission.c, thread: service. A connection has come: -1 turns it away, since its address has too many. It is gone. */
int admission_arrive(struct server *s, struct lws *wsi);
void admission_leave(struct lws *wsi);
/* Before the upgrade is answered: from here on the connection counts as the one that our proxy speaks for. False: what
 * the proxy says makes no sense. */
bool admission_forwarded(struct server *s, struct lws *wsi);
/* It has become a WebSocket: false when its address has too many; and is one no more. */
bool admission_socket(struct viewer *v);
void admission_socket_leave(struct viewer *v);
/* Whether the token is the one that is wanted. Compared in constant time; LATER: too many wrong ones came from there,
 * so that this one was not looked at. */
enum admission {
    ADMISSION_RIGHT,
    ADMISSION_WRONG,
    ADMISSION_LATER,
};
enum admission admission_token(struct server *s, struct lws *wsi, const char *given, const char *wanted);

/* viewer_send.c, thread: service. */
static inline int64_t viewer_now_us(void)
{
    return (int64_t)lws_now_usecs();
}
void viewer_want(struct viewer *v);            /* asks lws for a moment to write */
void viewer_say(struct viewer *v, char *text); /* queues a message and takes it over; NULL says nothing */
void viewer_part(struct viewer *v, uint16_t code, const char *text); /* closes, after what is queued */
void viewer_complain(struct viewer *v, const struct fault *fault); /* says what is wrong, and closes if that is fatal */
/* The newest picture of the viewer's format that it has not begun to get, as a new reference; NULL: none. */
struct picture *viewer_next_picture(struct viewer *v);
/* Whether a picture may begin now. Comes back by itself when only the viewer's rate stands against it. */
bool viewer_may_begin(struct viewer *v);
int viewer_write(struct viewer *v); /* one write; -1: the connection ends */

/* viewer_receive.c, thread: service. What the viewer's wish comes to, by the size that pictures have. */
void viewer_choose(struct viewer *v);
/* One piece of a message from the viewer. */
void viewer_receive(struct viewer *v, const uint8_t *in, size_t length);

/* producer.c, thread: service. */
void producer_hello(struct viewer *v, const struct message *m, struct welcome *w, struct fault *fault);
/* One piece of a binary message. */
void producer_receive(struct viewer *v, const uint8_t *in, size_t length, size_t coming, bool last);
void producer_tick(struct viewer *v, int64_t now_us);
void producer_leave(struct viewer *v); /* it is closed, or replaced: frees what was coming in */
void producers_tell(struct server *s); /* fates and credit that are due */

/* recorder.c, thread: service. A recorder is a viewer that gets the pictures of one lockstep sequence, all of them. */
void recorder_hello(struct viewer *v, const struct message *m, struct welcome *w, struct fault *fault);
bool recorder_subscribe(struct viewer *v, const struct message *m, struct fault *fault);
void recorder_ack(struct viewer *v, const struct message *m, struct fault *fault);
void recorder_tell(struct viewer *v); /* that its sequence is over, if it is */
void recorder_leave(struct viewer *v);

/* control.c, thread: service. */
void controls_tell(struct server *s);     /* answers that have come */
bool control_due(const struct viewer *v); /* whether v is to be told what is in force */
char *control_text(struct viewer *v);     /* the message that is due; NULL: out of memory */

/* probe.c, thread: service. */
void probe_take(struct viewer *v, const struct message *m, struct fault *fault); /* a question */
void probe_leave(struct viewer *v);                                              /* it is closed */
void probes_tell(struct server *s);                                              /* answers that have come */
bool probe_due(const struct viewer *v); /* whether v is to be told of the pixel that it follows */
char *probe_text(struct viewer *v);     /* the message that is due; NULL: out of memory, or none */

/* viewer.c, thread: service. */
void viewers_wake(struct server *s);   /* new pictures or states: whoever may now send is asked to */
void viewers_tick(struct server *s);   /* twice a second: statuses, time limits */
void viewers_leave(struct server *s);  /* tells all that the server goes */
void viewers_demand(struct server *s); /* sums up what is wanted */

#endif
