/* Steady exposure: finds from one sky to the next what the camera changed, in each channel, and undoes what flickers.
 * Most of a sky hardly changes in seconds, so that the median ratio of its parts to themselves before is the camera's,
 * and not a cloud's or the sun's. A random share of each image's exposure and white balance is taken out; what goes on
 * for several images (dusk) stays; a jump that all texels share (another shutter speed) is undone for good. Causal:
 * needs no later image. Source: a level with a trend [Holt 1957], that follows faster while its errors have one sign
 * [Trigg and Leach 1967]. Thread: one at a time. Allocates nothing; no errors. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

enum { DEFLICKER_WIDE = 64, DEFLICKER_HIGH = 16 }; /* cells: columns of the sky, rows of its upper half */

#define DEFLICKER_GAP_S 1800.0 /* the sun moves 7.5 degrees: skies further apart are not compared */

struct deflicker_channel { /* natural logarithms of exposure */
    double level, steady;  /* the tracked level, and once more smoothed, above the camera's own path */
    double trend;          /* per second */
    double error, scatter; /* means of the level's errors and of their sizes */
    double undone;         /* jumps, as they came */
};

struct deflicker { /* zeroed: no sky was seen; all fields are private */
    struct deflicker_channel channel[3];
    float last[3][DEFLICKER_HIGH * DEFLICKER_WIDE]; /* logarithms of the last sky's cells; NAN: not used */
    float now[3][DEFLICKER_HIGH * DEFLICKER_WIDE];
    double pending_s; /* since the last sky that was compared */
    double usual_s;   /* between two skies */
    unsigned count;   /* skies since the start */
    float gain[3];    /* of the last sky */
};

struct deflicker_result {
    float gain[3];  /* multiply the sky's channels by these; above 0 */
    float stops;    /* of the green one */
    float spread;   /* stops within which half of the green ratios lie; 0: nothing was compared */
    bool jumped;    /* a jump of the exposure, or of a channel, was undone in this image */
    bool restarted; /* the first sky, one of an earlier time or after a gap: all before it is forgotten, gains are 1 */
    bool blind;     /* too dark or too bright to be compared: it has the gains of the sky before it */
};

/* Takes the next sky: lat-long, linear, float rgb[height][width][3], top row first, any size, which may change.
 * seconds: since the sky before; 0: unknown; below 0, or above DEFLICKER_GAP_S, begins anew. */
void deflicker_take(struct deflicker *d, const float *rgb, uint32_t width, uint32_t height, double seconds,
                    struct deflicker_result *out);
