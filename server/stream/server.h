/* server/stream/server.h */
/* HTTP and WebSocket on one port: the viewer page, /healthz, /readyz, /metrics, and relight.v1 (protocol/PROTOCOL.md)
 * on /ws. A thread of its own owns all sockets. Others hand it immutable pictures and words about the state; the newest
 * picture wins, a slow viewer skips, and nothing here ever waits for a viewer. */
#ifndef STREAM_SERVER_H
#define STREAM_SERVER_H

#include "err.h"
#include "frame.h"
#include "picture.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct server;

enum server_role {
    SERVER_VIEWER,
    SERVER_CONTROLLER,
    SERVER_PRODUCER,
    SERVER_ROLES,
};

/* Zero means the default. Strings are copied. */
struct server_desc {
    const char *address;              /* numeric IPv4 or IPv6, or "localhost"; default 127.0.0.1 */
    uint16_t port;                    /* 0: any free one, see server_port */
    const char *web_dir;              /* what is served over HTTP; default: that of site_folder (site.h) */
    uint32_t max_connections;         /* WebSockets at once; default 128 */
    uint32_t max_per_address;         /* of these from one address (IPv6: from one /64); default 32, and then none for
                                       * this machine's own */
    bool behind_proxy;                /* who comes from this machine with X-Forwarded-For is who that names last */
    const char *hosts;                /* names that are answered to beside this machine's own, with commas between */
    uint32_t silent_s;                /* after which a silent peer is asked for a sign of life, and given up after as
                                       * much again and a half; default 10 */
    bool allow_remote;                /* an address other than loopback, and any Host name, are taken */
    const char *tokens[SERVER_ROLES]; /* what hello must carry per role, 1 to 255 bytes; NULL: none asked */
    const char *token_metrics;        /* what whoever reads /metrics must show; NULL: see monitor.c */
    const char *tls_cert, *tls_key;   /* PEM files (tls.h): HTTPS and WSS alone; NULL: neither */
    bool push;                        /* producers are taken; else their role is not offered */
    bool h264;                        /* H.264 is offered: who publishes must heed server_demand.h264_keys */
    size_t max_frame_bytes;           /* largest environment message that a producer may send; default 256 MiB */
    atomic_bool *stirred;             /* set when a controller has asked for something; NULL: nobody is told so */
    const atomic_bool *leave;         /* once it is set everybody is told that the server goes; NULL: nobody sets it */
    uint32_t frame_ms;                /* within which a frame must be complete once begun; default 30 s */
};

/* Starts listening and starts the thread. On any error *out is NULL.
 * ERR_IO: the address is taken or cannot be had, or web_dir has no index.html. ERR_USAGE: not an address, or neither
 * loopback nor allow_remote. ERR_NOMEM. */
MUST_CHECK enum err server_create(const struct server_desc *desc, struct server **out, struct reason *why);

/* Tells every connection that the server goes (close code 1001), takes no new one, and returns at once. Any thread;
 * NULL is not allowed. */
void server_drain(struct server *s);

/* Tells every viewer that the server goes (close code 1001), waits at most two seconds for them, ends the thread.
 * No other call may be under way or follow. NULL is allowed. */
void server_destroy(struct server *s);

/* Whether a server could be had so, as far as that can be said without listening. */
MUST_CHECK enum err server_check(const struct server_desc *desc, struct reason *why);

/* From now on, for those who come: the tokens, hosts and limits of this one, and, where both speak TLS, its certificate
 * and key, whose files are read again. Address, roles, whether it speaks TLS and the number of connections stay as they
 * are, and so do those who are in. On any error nothing is changed. Any thread but the server's. */
MUST_CHECK enum err server_change(struct server *s, const struct server_desc *desc, struct reason *why);

uint16_t server_port(const struct server *s);
const char *server_url(const struct server *s); /* "http://127.0.0.1:8080/", to print; lives as long as s */

/* H.264 comes in tracks, each a chain of pictures of its own: at whole, half and a quarter of the size, and of each as
 * many a second as there are, or at most 60, or half as many as the track before. Who publishes makes those that are
 * watched (server_demand), at their rates: none of a chain can be left out later. */
#define SERVER_SCALES 3
#define SERVER_RATES 8
#define SERVER_TRACKS (SERVER_SCALES * SERVER_RATES)

/* Sides are divided by 2^scale. */
static inline unsigned server_track_scale(unsigned track)
{
    return track / SERVER_RATES;
}

/* A mask of the tracks of one scale. */
#define SERVER_TRACKS_OF(scale) (((1u << SERVER_RATES) - 1) << ((scale)*SERVER_RATES))

double server_track_rate(unsigned track); /* pictures a second; 0: no limit */

/* Gives the picture its sequence number and time and offers it to all viewers of its format. Takes over the caller's
 * reference. A picture is published once, to one server. Any thread. */
void server_publish(struct server *s, struct picture *picture);

/* ---- Frames that producers push ---- */

/* Names a frame that was taken, until its fate is told. id 0 names none: every call below then does nothing for it. */
struct server_ticket {
    uint64_t id;
    bool lockstep; /* owed exactly one picture, made the same way however fast or often */
};

/* The newest frame that a producer has completed, or the one of a lockstep sequence. Its memory is moved into *f, whose
 * old memory may be taken over in return: FRAME_FILE holds a file's bytes that may be decoded though they came from a
 * network, FRAME_TEXELS what came raw, as float RGB. number, capture_us, layout and name ("frame 17 of producer
 * 127.0.0.1") are set. A second lockstep frame is not given out while the fate of one is open.
 * False after timeout_ms without one. One thread takes. */
bool server_take_frame(struct server *s, struct frame *f, struct server_ticket *ticket, int timeout_ms);

enum server_fate {
    SERVER_USED,       /* a picture was made of it */
    SERVER_SUPERSEDED, /* a newer one came before it was */
    SERVER_REFUSED,    /* it could not be used: `why` says so */
};

/* What became of a taken frame: told to its producer, if it is still there, and its credit returned as the pace asks. A
 * lockstep frame is never superseded. Any thread; a second call for the same frame does nothing. why may be NULL. */
void server_frame_fate(struct server *s, const struct server_ticket *ticket, enum server_fate fate, const char *why);

/* As server_publish, for a picture made of that frame, and tells SERVER_USED with its number. Of a lockstep frame the
 * picture in the recorder's format (server_demand) does so, and is kept until the recorder has acknowledged it as
 * stored, which returns the producer's credit; others are only shown. Any thread. */
void server_publish_for(struct server *s, struct picture *picture, const struct server_ticket *ticket);

/* ---- What controllers ask for ---- */

struct server_control {
    bool has_rotate, has_scale, has_method, has_samples, has_tone, has_paused;
    bool has_exposure, has_bias, has_error, has_fps, has_paths, has_camera;
    bool has_step, has_seek, has_hour; /* asked for and done, not in force */
    double rotate_degrees, scale_stops;
    char method[32], tone[16], paths[16], camera[64];
    uint32_t samples; /* 0: asked for, as many as there is time for; in force, with `counted` false, what that was */
    bool counted;     /* in force: samples binds */
    bool paused;
    bool exposure_auto; /* else the picture's gain is 2^exposure_stops */
    double exposure_stops, bias_stops;
    double error; /* relMSE; 0: none is wished for */
    double fps;
    int64_t step;         /* frames, either way */
    uint64_t seek;        /* a place in the source, from 0; comes before step */
    double hour;          /* of a computed sky's day, 0..24 */
    uint64_t by, request; /* who asked, and the number of the request: handed back with the answer */
    const char *clause;   /* of PROTOCOL.md, static: set beside an error by who cannot do it; NULL: 4.13 */
};

/* The next change asked for; what one controller asked in a row is one change, in which the newest word wins. Ranges
 * are those of PROTOCOL.md 4.13; whether method and tone are known is for the caller to say. False: none. Any thread.
 */
bool server_take_control(struct server *s, struct server_control *out);

/* What is in force (all has_ fields set that are known), told to all controllers and viewers and to those who come.
 * `answered`: what server_take_control gave; NULL at the start, or when the change came from elsewhere. `error`: why it
 * was not done, told to who asked; NULL when it was. Any thread. */
void server_set_control(struct server *s, const struct server_control *now, const struct server_control *answered,
                        const char *error);

/* ---- Questions about a pixel ---- */

struct server_probe {
    uint64_t by, request; /* who asked, and the number of the request: handed back with the answer */
    uint32_t x, y;        /* within the picture, as far as its size was said */
    uint32_t samples;     /* 0: not said */
    bool figure, sky;     /* the preset of [LPG13, Fig. 1]; with the sky's picture */
    bool sky_alone;       /* nothing else is asked, and no pixel named */
};

/* The next question. False: none. Any thread. */
bool server_take_probe(struct server *s, struct server_probe *out);

/* Its answer: a JSON object, copied; or NULL and why there is none. Each question that was taken must get one. Any
 * thread. */
void server_answer_probe(struct server *s, const struct server_probe *asked, const char *text, const char *error);

/* The pixels that somebody follows from picture to picture. Returns how many. Any thread. */
#define SERVER_FOLLOWED_MAX 32
struct server_follow {
    uint64_t by;
    uint32_t x, y;
};
uint32_t server_followed(struct server *s, struct server_follow out[SERVER_FOLLOWED_MAX]);

/* What a picture has at a followed pixel; who is slow is told the newest only. Any thread. */
struct server_radiance {
    uint64_t frame;
    int64_t capture_us; /* 0: unknown */
    bool finer;         /* of a frame that was told before, made better since */
    float rgb[3];
};
void server_tell_radiance(struct server *s, const struct server_follow *f, const struct server_radiance *r);

/* ---- The state, told and asked ---- */

enum server_source {
    SERVER_WAITING, /* no frame yet */
    SERVER_LIVE,
    SERVER_PAUSED,
    SERVER_ENDED,  /* the last frame was shown and stays */
    SERVER_FAILED, /* the last frame could not be used; the one before stays: `detail` says why */
};

/* What viewers are told about twice a second, and at once when source or detail change. Strings are copied; NULL is
 * "". Phrases without capital and full stop, as they stand inside a sentence. */
struct server_status {
    const char *scene;  /* "the built-in scene" */
    const char *sky;    /* "a computed sky" */
    const char *method; /* "mis" */
    uint32_t samples;   /* per shade point */
    uint32_t width, height;
    enum server_source source;
    const char *detail; /* of the source: what it waits for, or why it failed */
    int64_t since_us;   /* wall clock: since when; 0: unknown */
    uint64_t frame;     /* number of the last environment frame used */
    double fps;         /* pictures made per second, smoothed by the caller; 0: unknown */
    double queued_ms, decoded_ms, shaded_ms, encoded_ms; /* smoothed by the caller */
    uint64_t received, used, dropped, refused;           /* environment frames so far */
    const char *last_refusal;                            /* why, and which; "" when none was */
    uint64_t repaired;    /* NaN, infinite and negative texels set to something sane so far */
    bool has_sun;         /* the next three are known */
    double sun_elevation; /* degrees above the horizon */
    double sun_azimuth;   /* degrees, clockwise from north */
    const char *sky_time; /* the sky's own clock, "14:35" */
    const char *paths;    /* which light is in the picture and by whom: "direct light, caustics by light tracer" */
    const char *left_out; /* which is not, and why; "" where nothing is */
    double error;         /* of the last picture: relMSE, as the server estimates it; 0: unknown */
    bool computing;       /* what stands still is being computed beside the pictures, */
    double computed;      /* and this share of it is there */
    uint64_t passes;      /* unbiased ones in a picture that is made better while no frame comes; 0: it is not */
    bool converged;       /* and stays as it is now */

    const char *kind;        /* of the source: "files", "sky", "folder" (watched) or "producer" */
    uint64_t position;       /* of the frame that is shown, in the source, from 0 */
    uint64_t length;         /* 0: without end, or unknown */
    bool has_hour;           /* the source is a computed sky, */
    double hour;             /* this is its solar time, 0..24 */
    const char *camera;      /* by which the picture is made */
    const char *preparing;   /* a camera whose view is being computed; "": none */
    double prepared;         /* share of that, 0..1 */
    const char *cameras;     /* what a controller may ask for: names, one a line */
    const char *methods;     /* likewise */
    const char *tones;       /* likewise */
    const char *paths_known; /* likewise */
};

/* Any thread. */
void server_set_status(struct server *s, const struct server_status *status);

/* What is wanted just now, so that nothing is rendered or encoded that nobody looks at. Any thread. */
struct server_demand {
    uint32_t viewers;      /* subscribed and not paused */
    uint32_t formats;      /* bit 1 << enum protocol_format for each that somebody watches */
    bool halves, quarters; /* somebody watches JPEG at half, at a quarter of the size (flags of the picture's header) */
    uint32_t h264;         /* bit 1 << track for each of H.264 that somebody watches, */
    uint32_t h264_keys;    /* and of these, where somebody can go on only at a key picture (flag of its header) */
    int jpeg_quality;      /* the best anyone wishes, 1..100; 0: nobody said */
    double max_rate;       /* the highest anyone takes, pictures per second; 0: no limit */

    bool producer; /* one is connected */
    bool ended;    /* the last one said that no more frames come, and none has */
    /* Of the lockstep frame that was taken last, or else of the sequence whose producer is connected. */
    bool recorder;                        /* its recorder is connected and has subscribed */
    enum protocol_format recorder_format; /* as it subscribed last; 0: it never did */
};
void server_demand(struct server *s, struct server_demand *out);

/* ---- What is measured: /metrics, /healthz and /readyz ---- */

/* The thread that makes pictures lives: to be called by it, and it alone, at least once a second while it waits for
 * something. While it computes it need not call: then the time that it gets from a processor counts, though not for
 * more than SERVER_BUSY_MS. From the first call on /healthz asks for this. */
void server_beat(struct server *s);
#define SERVER_BEAT_MS 2000
#define SERVER_BUSY_MS 300000

struct server_health {
    bool alive;               /* the network's loop and the thread that makes pictures */
    bool ready;               /* alive, and whoever comes will get a picture */
    const char *reason;       /* why it is not, static; "ok" */
    int64_t loop_ms, beat_ms; /* since either was last seen; beat_ms -1: no thread has called server_beat */
};

/* Any thread. */
void server_health(struct server *s, struct server_health *out);

/* Times that are told as histograms. */
enum server_timing {
    SERVER_DECODE, /* from a frame's bytes to its sampling tables */
    SERVER_QUEUE,  /* how long it waits to be shaded */
    SERVER_SHADE,
    SERVER_ENCODE,    /* of one picture in one format */
    SERVER_CAPTURED,  /* from a frame's capture to the publication of its first picture: by the calendar's clock */
    SERVER_SENT,      /* from publication until the kernel has all of a picture */
    SERVER_DISPLAYED, /* and until the viewer says that it shows it */
    SERVER_LOOP,      /* one piece of work of the network's thread */
    SERVER_TIMINGS,
};

/* Any thread; takes no lock. Of the times above all but the first three are observed by the server itself. */
void server_observe(struct server *s, enum server_timing timing, double seconds);

enum server_waste {                    /* why a frame was refused */
                    SERVER_UNREADABLE, /* it could not be decoded */
                    SERVER_UNUSABLE,   /* the method in force cannot use it */
                    SERVER_WASTES,
};

/* What the makers of pictures count. */
struct server_figures {
    bool loaded;                         /* the scene is there */
    uint64_t received, used, superseded; /* environment frames, whatever they came from */
    uint64_t refused[SERVER_WASTES];
    uint64_t repaired;                          /* texels */
    uint64_t direct_rays, eye_rays, light_rays; /* traced for pictures */
    uint64_t cache_rays;                        /* traced for the cache */
    uint64_t generated, chosen, effective;      /* light samples */
    uint64_t finer;                             /* passes by which a standing picture was made better */
    double fps, error;                          /* error 0: unknown */
    uint64_t frame;                             /* the last one shown */
    uint64_t cache_bytes;
    double cache_share;                        /* 0..1 */
    unsigned frames_waiting, pictures_waiting; /* read and not shaded, shaded and not encoded */
};

/* Copied. Any thread. */
void server_set_figures(struct server *s, const struct server_figures *figures);

/* Producers' files are decoded in a process of its own: what became of it (decoder.h). */
struct server_decoder {
    bool separate, confined; /* it is; and the kernel holds it to its few system calls */
    uint64_t files, died, hung, lied, waited, starts;
};

/* Copied. Any thread. */
void server_set_decoder(struct server *s, const struct server_decoder *decoder);

/* Counters since the start. Any thread. */
struct server_counters {
    uint64_t connections; /* WebSockets accepted */
    uint64_t open;        /* of these, still there */
    uint64_t refused;     /* handshakes and connections turned away */
    uint64_t errors;      /* protocol errors, whatever they cost */
    uint64_t published;   /* pictures */
    uint64_t sent;        /* pictures, whole, to any viewer */
    uint64_t skipped;     /* pictures that a viewer did not get since it was slow, paused or rate-limited */
    uint64_t acked;
    uint64_t bytes;   /* of pictures handed to the kernel */
    uint64_t stalled; /* connections cut since they took no bytes */
    uint64_t crowded; /* of those refused, since their address had too many */
    uint64_t wrong_tokens;
    uint64_t too_fast; /* connections closed since they sent too many messages */

    /* Environment frames that producers pushed. */
    uint64_t frames_received;   /* whole */
    uint64_t frames_superseded; /* of these, by a newer one before a picture was made */
    uint64_t frames_refused;    /* of these */
    uint64_t frames_repeated;   /* of these, lockstep frames that had been received before */
    uint64_t frames_cut;        /* begun and never completed */
    uint64_t frame_bytes;       /* received, with headers, complete or not */
};
void server_counters(struct server *s, struct server_counters *out);

#endif
