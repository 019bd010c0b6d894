/* Sources of environment frames: a file, a folder, a printf or glob pattern, a watched folder, a video, a live stream,
 * or the built-in sky.
 *
 * `sky.%04d.exr`  The numbered files that exist between first and last, ascending. One %d, %i or %u with an optional
 *                 width, in the file name; every other character, '%' included, is literal.
 * folder          Its *.exr and *.hdr files, in any case, in natural order (1, 2, 10: files_compare), numbered from 0.
 * glob            The matching files, likewise.
 * file            One frame with number 0, regardless of digits in its name (dawn_1k.hdr is not frame 1).
 * `{face}`        In a file spec: a cube map of six files, with px, nx, py, ny, pz, nz or posx, negx, ... in its place
 *                 (`pier/{face}.hdr`, `sky.%04d.{face}.exr`). No pattern may follow it.
 * `watch:DIR`     The files in DIR, in natural order and assumed complete, then those closed after writing or moved
 *                 in, as they appear, numbered from 0. Hidden names (".x.exr") are ignored, so writers can rename when
 * done. `sky:key=...`   Computed frames (sky.h); never ends by itself. From the largest number that a frame can have on
 *                 (FRAME_NUMBER_MAX), it repeats that frame.
 * `epw:FILE,...`  The hours with daylight of a weather file (sky.h), numbered by their place in the year.
 * `cie:TYPE,...`  One standard sky, likewise.
 * `mtx:FILE,...`  The time steps with light of a matrix of Radiance's gendaymtx, numbered from 0.
 * `clip.mp4`      A video (.mp4, .mkv, .mov, .webm and others), or http(s):// of one: its frames, numbered from 0.
 * `rtsp://...`    A live stream: also rtsps, rtmp, rtmps, srt, http(s) of a live playlist, and v4l2:/dev/video0. Each
 *                 frame is the newest; frames are numbered as they are taken. Lost connections are retried;
 *                 one that never delivers is given up after source_desc.tries.
 * A file that exists under exactly the name of the spec takes precedence. `push:` is handled by relightd.
 *
 * Thread: one per source. */
#pragma once

#include "base/setting.h"
#include "image/codec/frame.h"
#include "import/decoder/decoder.h"
#include "sky/between/between.h"
#include "sky/daylight/sun.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sky_desc;
struct source;

/* The spec for messages and viewers: a URL without user name and password. Returns out. Any thread. */
const char *source_name(const char *spec, char *out, size_t size);

struct source_desc {
    const char *spec;             /* as on the command line */
    struct setting_frames frames; /* only frames with these numbers */
    bool loop;                    /* restart after the last frame; numbers repeat */
    double turn; /* degrees from frame to frame (frame.turn); a single file is then as many frames as `frames` says */
    struct video_colour colour;  /* of videos, instead of what they say; zero: as they say */
    const char *ca;              /* of network sources: see demux.h */
    bool wait;                   /* wait for a web server that is down, as for other network sources */
    struct between_desc between; /* with `hold` above 1, that many images from one frame to the next, of sources that
                                    can be sought in; frames and positions are images then, numbered from hold times the
                                    first frame's number */
    unsigned tries;              /* give up on a live stream after this many connections without a frame; 0: never */
};

bool source_has_video(void); /* whether this build reads videos and live streams */

/* Opens a source. On ERR_OK the caller owns *out; on error *out is NULL and *why names the spec and the fault. ERR_IO:
 * nothing found or not readable. ERR_USAGE: an invalid spec or range, a URL that is no source, or a number above
 * FRAME_NUMBER_MAX. ERR_UNSUPPORTED: video that this build or program does not read. ERR_NOMEM. */
MUST_CHECK enum err source_open(const struct source_desc *desc, struct source **out, struct reason *why);
void source_close(struct source *s); /* NULL is allowed */

/* Reads the next frame into *f, whose memory is reused.
 * ERR_END: no frame is left; *f is unchanged, so that the caller can keep using it. ERR_IO, ERR_RANGE (a file above
 * 1 GiB), ERR_NOMEM: this frame could not be read (*why says which); f->kind is FRAME_NONE, and the next call continues
 * with the following frame.
 * Capture time: the modification time for `watch:` (0 and a line in the log if it is beyond FRAME_CAPTURE_MAX_US), the
 * time of computation for a sky, a live stream's time stamp, else 0 (unknown), since the files may be years old.
 * `watch:` and live streams block for at most SOURCE_WAIT_MS, or source_set_wait, and then return ERR_OK with
 * FRAME_NONE, so that the caller can stop. */
MUST_CHECK enum err source_next(struct source *s, struct frame *f, struct reason *why);

#define SOURCE_WAIT_MS 200

void source_set_wait(struct source *s, int most_ms); /* 0 and more */

/* Opens a source, reads its first frame and closes it; blocks for up to 30 s for that of a live stream. Errors of
 * source_open and source_next; ERR_IO also if there is no frame. */
MUST_CHECK enum err source_first(const struct source_desc *desc, struct frame *f, struct reason *why);

/* Number of frames in one pass; 0 if unknown or infinite. For a video, the container's figure until a pass is
 * complete. */
uint64_t source_count(const struct source *s);
/* The frames per second with which a video is to be played; 0: the source has no rate of its own. */
double source_rate(const struct source *s);

/* Whether frames can be expected. False: a live stream is not connected; *why has the reason. */
bool source_is_connected(struct source *s, struct reason *why);

/* Whether source_next gave up a live stream: it returned ERR_IO and always will. */
bool source_gave_up(struct source *s);

/* ---- Seeking. Watched folders and live streams do not support it: these functions then return 0 or false and change
 * nothing. ---- */

enum source_kind {
    SOURCE_FILES, /* one file, a folder, a pattern */
    SOURCE_WATCH,
    SOURCE_SKY,
    SOURCE_VIDEO,
    SOURCE_LIVE,
    SOURCE_DAYLIGHT,
};

enum source_kind source_kind(const struct source *s); /* of an open source. One that waits for a web server is LIVE
                                                         until it comes, then VIDEO if it has a known length. */

/* Position of the last frame returned, from 0 (0 before the first): in the file list, or among the sky's frames in the
 * range. */
uint64_t source_position(const struct source *s);

/* Makes the frame at `position` the next. False, with nothing changed, if there is none. */
bool source_seek(struct source *s, uint64_t position);

/* Moves the next frame to `by` positions from the last one returned: wraps around if the source loops, else clamps. */
bool source_step(struct source *s, int64_t by);

/* Sets the solar time of the next frame, on the day of the last one returned; later frames continue from there, as if
 * the sky's `time=` had been different. Frame numbers are not affected. False if the source is not a computed sky. */
bool source_set_hour(struct source *s, double hour);

/* Of a weather file: makes its daylit moment nearest to a day of the year (0: that of the last frame) and a clock hour
 * (below 0: likewise) the next; of the day itself, if it has any. False, with nothing changed, for other sources. */
bool source_set_moment(struct source *s, uint32_t day, double hour);

/* When and where the last frame returned (the first before it) is, of a weather file. */
struct source_place {
    uint32_t day;                      /* of the year, from 1 */
    double hour;                       /* local standard time of its middle */
    double latitude, longitude;        /* degrees, north and east positive */
    double zone;                       /* hours ahead of UTC */
    double north;                      /* where north is, degrees from +Z towards -X */
    double units;                      /* of the frame per W sr^-1 m^-2 */
    double sun_elevation, sun_azimuth; /* degrees; azimuth from north over east */
    struct sun_day sun_day;            /* by `hour`, in the frame */
};

/* False for other sources. */
bool source_place(const struct source *s, struct source_place *out);

/* The sky with its current hour; NULL if the source is not a computed sky. The source owns it. */
const struct sky_desc *source_sky(const struct source *s);
