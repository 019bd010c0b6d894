/* server/relightd.h */
/* What the files of the daemon share: relightd.c wires the rooms and runs the threads, relightd_ingest.c and
 * relightd_encode.c are two of these (relightd_video.c is the latter's H.264), relightd_still.c makes a picture better
 * while no frame comes, relightd_camera.c goes to another camera, relightd_service.c speaks with the service manager,
 * relightd_options.c knows the flags, relightd_config.c takes them from the command line and a file,
 * relightd_settings.c holds what a controller may change, relightd_state.c keeps that, relightd_status.c is what
 * viewers are told, relightd_watch.c what whoever runs it sees. */
#ifndef RELIGHTD_H
#define RELIGHTD_H

#include "buyer.h"
#include "decoder.h"
#include "environment.h"
#include "film.h"
#include "h264.h"
#include "handoff.h"
#include "jpeg.h"
#include "log.h"
#include "pilot.h"
#include "probe_report.h"
#include "progress.h"
#include "relight.h"
#include "server.h"
#include "sky.h"
#include "source.h"
#include "still.h"

#include <pthread.h>
#include <stdatomic.h>

/* What may change while the daemon runs. */
struct settings {
    enum method method;
    uint32_t samples;
    bool counted;     /* somebody has said how many samples: no pilot */
    double error;     /* relMSE that is good enough for the pilot; 0: as good as there is time for */
    uint32_t classes; /* PATH_* of paths.h */
    double fps;       /* pictures per second at most; also the pilot's wish */
    double rotation_degrees, scale_stops;
    char camera[64]; /* its name */
    enum tone_curve tone;
    bool exposure_auto;    /* it follows the picture; else the gain is */
    double exposure_stops; /* 2^this; */
    double bias_stops;     /* on top of the one that follows */
    bool paused;           /* the source is held */
    uint64_t version;      /* rises when the standing frame is to be lit anew, */
    uint64_t looks;        /* and when its picture is to be shown anew */
};

/* What was asked of the source's place and not done yet. */
struct moves {
    bool has_seek, has_hour;
    uint64_t seek; /* a place */
    double hour;   /* solar time */
    int64_t step;  /* frames from there, or from the one that stands */
};

/* A frame that is ready to light the scene. */
struct ingested {
    struct environment *environment;
    struct server_ticket ticket; /* id 0: not pushed by a producer */
    double decode_ms;
    int64_t ready_ms;    /* when it began to wait */
    uint64_t position;   /* in the source */
    bool has_sky;        /* it was computed, */
    struct sky_desc sky; /* as this has it */
};

/* A linear picture on its way to the encoder. */
struct shaded {
    float *rgb;
    struct protocol_picture header;
    struct server_ticket ticket;
    bool anew; /* of another view than the one before: exposure does not go over to it, but begins */
};

/* What the last picture was made of. */
struct still_frame {
    const struct ingested *in; /* the shade thread's until the next frame is taken */
    struct shaded *first;      /* the picture: nobody writes to it until the next one is begun */
    struct relight_desc light;
    struct protocol_picture header;
    double shown_s, interval_s; /* when it was made, and how long after the one before it */
};

/* The view of another camera on its way. Shade thread, but for what the thread itself does until it is done. */
struct camera_build {
    pthread_t thread;
    bool running;
    atomic_bool done;
    char name[64];
    struct progress line;
    struct set *set; /* what it made; NULL where it failed: */
    struct reason why;
};

/* Pictures of H.264 of one size and rate. */
struct video_track {
    struct h264_encoder *encoder; /* NULL: nobody has watched since it was last looked at */
    double key_s;                 /* when it made a key picture last */
    double due_s;                 /* before which it gets no other picture */
    bool behind;                  /* so it has not had the last one */
};

struct daemon {
    /* Said on the command line, then only read. */
    struct settings said;      /* a lockstep sequence is made with these, whatever a controller changes */
    struct relight_desc light; /* but for method and samples, which are settings */
    enum importance importance;
    bool reseed;
    struct still_wish converge; /* error 0: a picture stays as it was shown first */
    double rate;                /* 0: each frame waits until the one before it is shaded */
    atomic_int quality;
    uint64_t threads;                   /* 0: as many as there are processors */
    struct said *said_first, *said_now; /* as the daemon was started, and as it was told last (relightd_config.h) */
    double h264_bits;                   /* a second, at most, of the whole picture; 0: by its size and rate */
    struct set_desc set_desc;
    struct source_desc source_desc;
    enum layout layout;
    struct server_desc server_desc;
    const struct kernels *kernels;
    struct log_desc log;
    const char *state_dir; /* NULL: nothing is kept */
    bool push;             /* frames come over the protocol */
    bool no_sandbox;       /* and are decoded in this process */
    uint32_t most_side;    /* of their pictures, in texels; 0: of what this machine's user names himself */
    struct decoder_desc decoder_desc;
    bool computed_sky;
    struct sky_desc sky;

    struct set *set;       /* shade thread: of the camera that is shown, */
    struct set *first_set; /* and of the one that was said, whose scene and rays they share */
    struct camera_build camera;
    struct source *source;             /* ingest thread; NULL when frames are pushed */
    enum source_kind kind;             /* of it, for all threads */
    uint64_t length;                   /* likewise: frames in a pass; 0: unknown or without end */
    bool warned_clipped;               /* ingest thread */
    struct relighter *relighter;       /* shade thread */
    struct relighter *first_relighter; /* lockstep sequences are made with it; NULL where it is not needed */
    uint64_t looks;                    /* shade thread: what the last picture was handed on with */
    uint64_t turn;                     /* shade thread: pictures that were made in no lockstep */
    struct pilot *pilot;               /* shade thread; NULL until it is wanted */
    struct buyer buyer;                /* shade thread: of the cache that auto may take */
    struct still *still;               /* shade thread, and what follows; NULL until it is wanted */
    struct still_frame still_frame;
    bool still_known; /* still_frame is the one that is shown */
    bool still_open, still_begun;
    double still_s, still_told_s; /* seconds that its passes took; when its last picture was published, */
    uint64_t still_told;          /* of how many passes; 0: none was */
    double still_logged_s;        /* 0: never */
    struct prober *prober;        /* shade thread; NULL until it is wanted */
    char *sky_text;               /* shade thread: the answer to who asks for the sky alone; NULL: none, */
    uint64_t sky_frame;           /* of which frame, */
    double sky_s;                 /* when it was made, */
    double sky_rotation;          /* and how the sky was turned */
    const struct shaded *latest;  /* shade thread: the last picture, handed on, of still_frame; NULL: there is none */
    atomic_bool *stirred;         /* set by whoever has something new: ends the pass that is under way */
    atomic_bool show_again;    /* somebody has not got the standing picture in a format that is made of its numbers */
    atomic_bool reading;       /* a frame is being read */
    struct jpeg_encoder *jpeg; /* encode thread, and what follows */
    struct exposure exposure;
    uint64_t exposed; /* the frame to which exposure has adapted */
    float gain;       /* of exposure that follows, without the bias */
    struct video_track video[SERVER_TRACKS];
    bool h264_failed; /* which was said */
    uint8_t
        *display[SERVER_SCALES];  /* the last picture as it is shown, whole, at half and at a quarter of its sides, */
    unsigned shown;               /* which of these there are: bits 1 << scale */
    struct protocol_picture last; /* what the whole one is; format 0: none */
    unsigned last_jpeg;           /* it was published as JPEG: bits 1 << scale, */
    unsigned last_exr;            /* and as these: bits 1 << enum protocol_format */
    float *small;                 /* a picture of half the sides or less */

    struct server *server;
    struct resample_tables *tables; /* of the slots' environments */
    struct ingested ingested[HANDOFF_SLOTS];
    struct handoff frames;
    struct shaded shaded[HANDOFF_SLOTS];
    struct handoff pictures;
    struct decoder *decoder; /* ingest thread: of producers' files; NULL: they are decoded in this process */
    pthread_t ingest_thread, encode_thread, watch_thread;
    bool ingesting, encoding, watching; /* the threads run */

    char state_file[4096]; /* watch thread, and before and after it main: */
    char *state_text;      /* what stands there, */
    double state_due_s;    /* and not before this is it written again */
    pthread_t service_thread;
    bool servicing;           /* it runs */
    atomic_bool service_over; /* it is to end */

    pthread_mutex_t settings_lock;
    struct settings settings; /* {settings_lock} */
    struct moves moves;       /* {settings_lock} */
    atomic_bool moves_wait;   /* there are some */

    pthread_mutex_t status_lock;
    struct server_figures figures; /* {status_lock} */
    uint64_t cache_rays;           /* {status_lock} of the cache that there is */
    struct server_status status;   /* {status_lock} its strings point into what follows */
    char detail[sizeof(struct reason)], refusal[sizeof(struct reason)], sky_time[8]; /* {status_lock} */
    char paths[320], left_out[1024];                                                 /* {status_lock} */
    char cameras[1024], methods[256], tones[64], paths_known[64];                    /* {status_lock} */
    char camera_shown[64], preparing[64];                                            /* {status_lock} */
};

/* ---- relightd.c ---- */

/* Any thread. */
bool daemon_is_stopping(struct daemon *d);

/* ---- relightd_ingest.c ---- */

/* Starts the process that decodes what producers send. Before the ingest thread; and its end, after that. */
MUST_CHECK enum err daemon_decoder_begin(struct daemon *d, const atomic_bool *stop, struct reason *why);
void daemon_decoder_end(struct daemon *d);

/* The ingest thread; arg is the daemon. */
void *daemon_ingest_main(void *arg);

/* ---- relightd_encode.c ---- */

/* The encode thread; arg is the daemon. */
void *daemon_encode_main(void *arg);

/* An encoded picture, whose header says what it is; track is H.264's, else 0. */
void daemon_publish(struct daemon *d, struct shaded *in, unsigned track, const uint8_t *bytes, size_t size);

/* ---- relightd_video.c: encode thread ---- */

/* Lets go of the encoders of tracks that nobody watches: whoever comes needs a key picture, which a new one makes. */
void daemon_video_rest(struct daemon *d, const struct server_demand *demand);
/* The new picture of this scale, as it stands in d->display, for whoever watches it as H.264. Milliseconds. */
double daemon_video_encode(struct daemon *d, const struct shaded *in, unsigned scale, double tone_ms,
                           const struct server_demand *demand);
/* The same, while no newer one comes: for those who have not had it yet, or cannot begin. */
void daemon_video_again(struct daemon *d, const struct shaded *in, unsigned scale, const struct server_demand *demand);
/* Until that may be due for somebody. */
int daemon_video_wait_ms(struct daemon *d, int most_ms);
void daemon_video_finish(struct daemon *d);

/* ---- relightd_still.c: shade thread ---- */

/* A picture was handed on; what becomes of it while no newer frame comes. */
void daemon_still_open(struct daemon *d, const struct still_frame *frame);
void daemon_still_close(struct daemon *d);

/* The standing picture once more, as it is by now: for another tone curve or exposure. Where frames come it is left to
 * the next one. */
void daemon_still_show(struct daemon *d);

/* Nothing of the former view is kept: what is standing is no picture of the present one. */
void daemon_still_forget(struct daemon *d);

/* Whether there is a pass to be run now: nothing else is to be done, somebody looks, and it is not good enough yet. */
bool daemon_still_is_due(struct daemon *d);

/* One pass, and at times a picture. Ended early by d->stirred, and then as if it had not been begun. */
MUST_CHECK enum err daemon_still_pass(struct daemon *d, struct reason *why);

/* ---- relightd_probe.c: shade thread ---- */

/* A picture is handed on: whoever follows a pixel is told what it has there. */
void daemon_probe_picture(struct daemon *d, const struct shaded *picture);

/* Answers one question about a pixel of the last picture, if there is one; where no picture is, none can be had. */
void daemon_probe_answer(struct daemon *d);

/* ---- relightd_camera.c: shade thread ---- */

/* Begins to compute the view that the settings ask for, or goes on with it, beside the pictures. True when d->set and
 * d->relighter have just become those of another camera: the standing frame is to be lit with them. */
bool daemon_camera_follow(struct daemon *d);
void daemon_camera_finish(struct daemon *d);

/* ---- relightd_service.c: main thread; d->server is there ---- */

MUST_CHECK enum err daemon_service_begin(struct daemon *d, struct reason *why);
void daemon_service_end(struct daemon *d); /* before d->server goes */

/* ---- relightd_config.c: main thread ---- */

/* ERR_USAGE names the flag, or file, line and key. *done: --help, --version or the answer to --check-config was
 * printed. d keeps what was said until daemon_config_finish. */
MUST_CHECK enum err daemon_read_options(struct daemon *d, int argc, char **argv, bool *done, struct reason *why);
void daemon_config_finish(struct daemon *d);

/* Reads it all again; what can change while it runs is changed, and the log says what cannot. A file with faults
 * changes nothing. */
void daemon_reload(struct daemon *d);

/* ---- relightd_settings.c: any thread ---- */

struct settings daemon_settings(struct daemon *d);

/* Takes what controllers have asked for since the last call, if anything, and tells everybody what is in force. */
void daemon_take_control(struct daemon *d);

/* Tells it without having been asked: at the start, or (camera) when the view of that one stays after all. */
void daemon_tell_control(struct daemon *d, const char *camera);

/* These settings from now on, whoever asked for what before: everybody is told. */
void daemon_set(struct daemon *d, const struct settings *s);

/* What controllers have asked for of the source's place: handed out once. */
struct moves daemon_take_moves(struct daemon *d);
bool daemon_moves_wait(struct daemon *d);

/* What a control message asks for, done. */
MUST_CHECK enum err daemon_apply(struct daemon *d, const struct server_control *asked, struct reason *why);
/* Settings as a control message has them. */
void daemon_describe(const struct settings *s, struct server_control *out);

/* ---- relightd_state.c: what was set comes back after a crash ---- */

/* Once the set is there: puts into force what the file says; what is wrong with it is a warning. */
void daemon_state_open(struct daemon *d);
/* Writes the file when something has changed. Thread: watch. */
void daemon_state_keep(struct daemon *d);
void daemon_state_close(struct daemon *d);

/* ---- relightd_watch.c ---- */

/* The watch thread; arg is the daemon. */
void *daemon_watch_main(void *arg);

/* ---- relightd_status.c: any thread ---- */

void daemon_tell_start(struct daemon *d);
void daemon_tell_source(struct daemon *d, enum server_source source, const char *detail);
/* The producer has left without a word: since now. */
void daemon_tell_gone(struct daemon *d);
void daemon_tell_refused(struct daemon *d, const char *why, bool log);
/* A frame that was received and read, but that the method in force cannot use. */
void daemon_tell_unusable(struct daemon *d, const char *why);
void daemon_tell_received(struct daemon *d, const struct image_faults *faults, bool dropped);
/* A picture of a frame: how it was made, pilot NULL where none was at work, and how long after the one before it. */
struct shaded_news {
    const struct ingested *in;
    struct protocol_picture header;
    const struct relight_desc *light;
    const struct relight_stats *stats;
    const struct pilot_stats *pilot;
    double interval_s;
};
void daemon_tell_shaded(struct daemon *d, const struct shaded_news *news);
/* The cameras that there are, and the one that is shown, once the scene is loaded. */
void daemon_tell_cameras(struct daemon *d);
/* Which camera's view is computed, and how much of it; share 1: it is shown now. */
void daemon_tell_camera(struct daemon *d, const char *camera, double share);
void daemon_tell_encoded(struct daemon *d, double ms);
/* The picture that is handed on next is one of the same frame, this much better. */
void daemon_tell_finer(struct daemon *d, const struct still_stats *stats);

/* Every frame that came was shaded, dropped or refused. */
bool daemon_all_shown(struct daemon *d);

/* By how much shading a picture takes longer than reading its frame, of late; 0 when it does not. */
double daemon_slack_ms(struct daemon *d);

#endif
