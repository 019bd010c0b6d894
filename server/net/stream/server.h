/* HTTP and WebSocket on one port: the viewer page, /healthz, /readyz, /metrics, and relight.v1 (protocol/PROTOCOL.md)
 * on /ws. A separate thread, the service thread, owns all sockets. Other threads pass it immutable images and
 * figures; the newest image wins, slow viewers skip images, and no call waits for a viewer. Unless noted, any
 * thread may call any function while the server exists. */
#pragma once

#include "base/err.h"
#include "image/codec/frame.h"
#include "net/access/figures.h"
#include "net/message/message.h"
#include "protocol/relight_protocol.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Encoded images ---- */

/* An encoded image: header and bytes, reference-counted and constant once published, so that all viewers share one
 * copy. All functions: any thread. */

struct sent_image;

#define IMAGE_BYTES_MAX ((size_t)512 << 20) /* bounds memory */

/* Copies `size` bytes of an encoded image. This function or server_publish sets header->payload, sequence and
 * published_us. The caller owns one reference. NULL: out of memory, or size is 0 or above IMAGE_BYTES_MAX. */
struct sent_image *image_create(const struct protocol_picture *header, const uint8_t *bytes, size_t size);

/* Before publication, of H.264: its track (server.h). Default 0. */
void image_set_track(struct sent_image *p, unsigned track);
unsigned image_track(const struct sent_image *p);

/* Before publication: marks it as a rendition (server.h), which is not for viewers; its header's format is ignored. */
void image_set_rendition(struct sent_image *p, unsigned slot, uint64_t serial);

struct sent_image *image_ref(struct sent_image *p); /* returns p */
void image_unref(struct sent_image *p);             /* frees it with the last reference; NULL is allowed */

/* Owned by p; complete once it is published. */
const struct protocol_picture *image_header(const struct sent_image *p);

/* The bytes on the wire: encoded header, then payload. Owned by p. */
const uint8_t *image_message(const struct sent_image *p, size_t *size);

struct server;

/* Zero means the default. server_create copies the strings. */
struct server_desc {
    const char *address;              /* numeric IPv4 or IPv6, or "localhost"; default 127.0.0.1 */
    uint16_t port;                    /* 0: any free one, see server_port */
    const char *web_dir;              /* files served over HTTP; default: as site_folder (site.h) */
    uint32_t max_connections;         /* WebSockets at once; default 128 */
    uint32_t max_per_address;         /* WebSockets from one address (IPv6: one /64); default 32, and no limit for
                                       * loopback */
    bool behind_proxy;                /* the client of the proxy's connections is the last name in X-Forwarded-For */
    const char *proxy;                /* the proxy's numeric address; default: 127.0.0.1 or ::1 */
    const char *public_names;         /* further Host names to accept, separated by commas */
    const char *embed_from;           /* origins whose pages may show /embed in a frame, separated by commas */
    uint32_t silent_s;                /* ping a silent peer after this time, and drop it after 2.5 times this;
                                       * default 10 */
    bool allow_remote;                /* accept addresses other than loopback */
    const char *tokens[SERVER_ROLES]; /* required in hello, by role, 1 to 255 bytes; NULL: none */
    const char *token_metrics;        /* required for /metrics; NULL: see monitor.c */
    const char *tls_cert, *tls_key;   /* PEM files (tls.h): HTTPS and WSS only; NULL: plain */
    bool push;                        /* offer the producer role */
    bool h264;                        /* offer H.264: the caller must respect server_demand.h264_keys */
    size_t max_frame_bytes;           /* largest environment message that a producer may send; default 256 MiB */
    const struct setting *controls;   /* static rows, those with keys first: settings that controllers may change and
                                         that all clients receive; NULL: none */
    atomic_bool *new_work;            /* set when a controller's request is pending; may be NULL */
    const atomic_bool *leave;         /* once set, the server tells all clients that it stops; may be NULL */
    uint32_t frame_ms;                /* time limit for receiving a frame; default 30 s */
};

/* Starts listening and starts the service thread. On any error *out is NULL.
 * ERR_IO: the address is in use or not available, or web_dir has no index.html. ERR_USAGE: not an address, or neither
 * loopback nor allow_remote. ERR_NOMEM. */
MUST_CHECK enum err server_create(const struct server_desc *desc, struct server **out, struct reason *why);

/* Tells every client that the server stops (close code 1001), accepts no new clients and returns at once. */
void server_drain(struct server *s);

/* Tells every client that the server stops (close code 1001), waits at most two seconds for them and ends the thread.
 * No other call may run at the same time or follow. NULL is allowed. */
void server_destroy(struct server *s);

/* Checks a description without listening. Errors as server_create. */
MUST_CHECK enum err server_check(const struct server_desc *desc, struct reason *why);

/* Changes tokens, public names and limits for new connections, and where TLS is on also certificate and key, whose
 * files are read again. Address, roles, TLS on or off and max_connections stay, and so do open connections. On any
 * error nothing changes; errors as server_create. Any thread but the service thread. */
MUST_CHECK enum err server_change(struct server *s, const struct server_desc *desc, struct reason *why);

/* The port that it listens on, even if the description has port 0. Any thread. */
uint16_t server_port(const struct server *s);
const char *server_url(const struct server *s); /* "http://127.0.0.1:8080/", to print; owned by s */

/* H.264 comes in tracks, each its own chain of images: three scales (full, half and quarter size) times eight rates
 * (unlimited, 60 per second, 30, ...). The caller encodes the tracks with viewers (server_demand) at their rates,
 * because no image of a chain can be skipped later. */
#define SERVER_SCALES 3
#define SERVER_RATES 8
#define SERVER_TRACKS (SERVER_SCALES * SERVER_RATES)

/* Sides are divided by 2^scale. */
static inline unsigned server_track_scale(unsigned track)
{
    return track / SERVER_RATES;
}

/* The tracks of one scale, as bits 1 << track. */
#define SERVER_TRACKS_OF(scale) (((1u << SERVER_RATES) - 1) << ((scale)*SERVER_RATES))

double server_track_rate(unsigned track); /* images per second; 0: no limit */

/* Plain HTTP serves images in more formats and widths than viewers get: renditions. Each width of each format has a
 * slot while there are requests for it, and the caller makes the renditions listed in server_demand. */
#define SERVER_RENDITIONS 8
enum server_image {
    SERVER_NO_IMAGE,
    SERVER_JPEG,
    SERVER_PNG,
    SERVER_EXR, /* half floats */
};
struct server_rendition {
    enum server_image image; /* SERVER_NO_IMAGE: the slot is free */
    uint32_t owner;          /* a client that asks for it, as a number; 0: none */
    uint32_t width;          /* maximum; 0: the image's width */
    uint64_t serial;         /* increases with each new use of a slot: for image_set_rendition */
};

/* The caller starts to encode another image: images published earlier are now outdated. */
void server_begin_image(struct server *s);

/* Gives the image its sequence number and time and offers it to all viewers of its format. Takes over the caller's
 * reference. An image is published once, to one server. */
void server_publish(struct server *s, struct sent_image *image);

/* ---- Frames that producers push ---- */

/* Identifies a taken frame until its fate is reported. id 0: no frame, for which the calls below do nothing. */
struct server_ticket {
    uint64_t id;
    bool lockstep; /* gets exactly one image, reproducibly */
};

/* Waits for a frame from a producer: the newest complete one, or that of a lockstep sequence. Moves its memory into *f
 * and may take over f's old memory: FRAME_FILE holds the bytes of an untrusted file, FRAME_TEXELS raw float RGB. Sets
 * number, capture_us, layout and name ("frame 17 of producer 127.0.0.1"). live false: lockstep frames only. No second
 * lockstep frame is returned while the fate of one is open. False after timeout_ms without a frame. One thread at a
 * time. */
bool server_take_frame(struct server *s, struct frame *f, struct server_ticket *ticket, bool live, int timeout_ms);

/* Reports the fate of a taken frame to its producer, if still connected, and returns credit. Lockstep frames are never
 * superseded. A second call for the same frame does nothing. why may be NULL. */
void server_frame_fate(struct server *s, const struct server_ticket *ticket, enum server_fate fate, const char *why);

/* As server_publish, for an image of that frame; also reports SERVER_USED. For a lockstep frame only the image in
 * the recorder's format (server_demand) does that; it is kept until the recorder acknowledges it as stored, which
 * returns the producer's credit. */
void server_publish_for(struct server *s, struct sent_image *image, const struct server_ticket *ticket);

/* ---- What controllers ask for ---- */

/* The next request. Consecutive requests of one controller are merged; the newest value wins. The rows define the
 * checks of ranges and choices; the caller checks values that depend on scene and source. False: none. */
bool server_take_control(struct server *s, struct server_control *out);

/* Whether a request is pending for server_take_control. */
bool server_control_waits(struct server *s);

/* Sends the current values, a struct that the rows describe, to all controllers and viewers, and to later ones.
 * `answered`: the request from server_take_control; NULL for a change from elsewhere. `error`: why the request failed,
 * sent to its controller; NULL on success. */
void server_set_control(struct server *s, const void *values, const struct server_control *answered, const char *error);

/* ---- Questions about a pixel ---- */

/* The next query. False: none. */
bool server_take_inspection(struct server *s, struct server_inspection *out);

/* Answers a query: text is a JSON object, copied; NULL: none, and error gives the reason. The caller must answer every
 * query that it takes. */
void server_answer_inspection(struct server *s, const struct server_inspection *asked, const char *text,
                              const char *error);

/* The pixels that clients follow from image to image. Returns their number. */
#define SERVER_FOLLOWED_MAX 32
/* Copies them to out. Any thread. */
uint32_t server_followed(struct server *s, struct server_follow out[SERVER_FOLLOWED_MAX]);

/* Copies *r, an image's radiance at a followed pixel, for the client that follows f; does nothing if it no longer
 * follows. Any thread. */
void server_send_radiance(struct server *s, const struct server_follow *f, const struct server_radiance *r);

/* ---- Figures out, demand in ---- */

/* Passes the figures to viewers, about twice a second and at once when source or detail change, and to /metrics.
 * Copied. Any thread. */
void server_set_figures(struct server *s, const struct server_figures *figures);

/* The clients' current demand, so that the caller renders and encodes only what is needed. */
struct server_demand {
    uint32_t viewers;      /* subscribed and not paused */
    uint32_t formats;      /* formats with viewers, as bits 1 << enum protocol_format */
    bool halves, quarters; /* JPEG at half or quarter size has viewers (flags of the image's header) */
    uint32_t h264;         /* H.264 tracks with viewers, as bits 1 << track */
    uint32_t h264_keys;    /* of these, tracks that need a keyframe (flag of its header) */
    struct server_rendition renditions[SERVER_RENDITIONS];
    int jpeg_quality; /* the highest requested, 1..100; 0: none requested */
    double max_rate;  /* the highest requested, images per second; 0: no limit */

    bool producer; /* a producer is connected */
    bool ended;    /* the last producer ended its stream */
    /* Of the last lockstep frame taken, or else of the sequence whose producer is connected. */
    bool recorder;                        /* its recorder has subscribed */
    enum protocol_format recorder_format; /* 0: it never subscribed */
};
/* Writes the current demand to *out. Any thread. */
void server_demand(struct server *s, struct server_demand *out);

/* ---- Measurements: /metrics, /healthz and /readyz ---- */

/* Heartbeat of the shade thread, the only caller, at least once a second while it waits. While it computes, its
 * processor time counts as a heartbeat, for at most SERVER_BUSY_MS. /healthz requires it from the first call on. */
void server_beat(struct server *s);
#define SERVER_BEAT_MS 2000   /* twice the second that is promised */
#define SERVER_BUSY_MS 300000 /* a frame that takes longer counts as hung */

struct server_health {
    bool alive;               /* the service thread and the shade thread make progress */
    bool ready;               /* alive, and a new viewer will get an image */
    const char *reason;       /* why not alive or ready, static; "ok" otherwise */
    int64_t loop_ms, beat_ms; /* time since the last sign of each; beat_ms -1: server_beat was never called */
};

/* Writes the current state to *out. Any thread. */
void server_health(struct server *s, struct server_health *out);

/* Times reported as histograms. */
enum server_timing {
    SERVER_DECODE, /* from bytes to sampling tables */
    SERVER_QUEUE,  /* waiting to be lit */
    SERVER_SHADE,
    SERVER_ENCODE,    /* one image in one format */
    SERVER_CAPTURED,  /* from capture to the publication of the first image, by wall clock */
    SERVER_SENT,      /* from publication until the kernel has the whole image */
    SERVER_DISPLAYED, /* from publication until the viewer shows it */
    SERVER_LOOP,      /* one piece of work of the service thread */
    SERVER_TIMINGS,
};

/* Adds one time without a lock. The caller reports the first three kinds; the server reports the others. */
void server_observe(struct server *s, enum server_timing timing, double seconds);

/* Counters since the start. */
struct server_counters {
    uint64_t connections; /* WebSockets accepted */
    uint64_t open;        /* of these, still open */
    uint64_t refused;     /* handshakes and connections refused */
    uint64_t errors;      /* protocol errors, fatal or not */
    uint64_t published;   /* images */
    uint64_t sent;        /* whole images, to any viewer */
    uint64_t skipped;     /* images that a viewer skipped: slow, paused or rate-limited */
    uint64_t acked;
    uint64_t bytes;   /* of images passed to the kernel */
    uint64_t stalled; /* connections closed because they took no bytes */
    uint64_t crowded; /* of those refused: the address had too many */
    uint64_t wrong_tokens;
    uint64_t too_fast; /* connections closed because they sent too many messages */

    /* Environment frames from producers. */
    uint64_t frames_received;   /* whole */
    uint64_t frames_superseded; /* of these, by a newer one before an image was made */
    uint64_t frames_refused;    /* of these */
    uint64_t frames_repeated;   /* of these, lockstep frames that had been received before */
    uint64_t frames_cut;        /* begun and never completed */
    uint64_t frame_bytes;       /* received, with headers, complete or not */
};
/* Writes the counts since server_create to *out. Any thread. */
void server_counters(struct server *s, struct server_counters *out);
