/* Skies between captured skies. A camera takes a sky every few seconds, at irregular times; this gives the sky at any
 * time between two of them. The sun is taken out of both (sun_patch.h), moves along its arc with the energy that is
 * interpolated linearly, and is put back; the rest fades, or its clouds move (drift.h). What a camera did is undone
 * first.
 *
 * A window of the last SUN_MARKS skies is kept, decoded, as lat-long images of the first one's size. Times are seconds
 * on any one clock. The result depends on the skies in the window and the time alone, not on the number of threads.
 *
 * Thread: one per struct between; OpenMP is used. */
#pragma once

#include "base/err.h"
#include "base/setting.h"
#include "image/codec/decode.h"
#include "image/codec/frame.h"
#include "image/codec/image.h"
#include "sky/between/sun_patch.h"

#include <stdbool.h>
#include <stdint.h>

enum between_mode {
    BETWEEN_OFF,    /* each sky is shown until the next */
    BETWEEN_FADE,   /* the sun moves, the rest fades */
    BETWEEN_MOTION, /* clouds move, too, where that explains the next sky better */
};

extern const struct setting_choice between_choices[];

#define BETWEEN_HOLD_MAX 1000

enum between_align {
    BETWEEN_ALIGN_OFF,
    BETWEEN_ALIGN_SUN,
};

/* What between_desc.sun may be instead of an illuminance. */
#define BETWEEN_SUN_KEEP 0.0
#define BETWEEN_SUN_AUTO (-1.0)

extern const struct setting_choice between_sun_choices[];
extern const struct setting_choice between_align_choices[];

struct between_desc {
    enum between_mode mode;
    uint32_t hold;  /* of a sequence: images from one sky to the next; 0: 1 */
    bool deflicker; /* undo a camera's scatter of exposure and white balance (deflicker.h); needs skies in order */
    double sun; /* restore a clipped sun (restore.h) so that the sky has this horizontal illuminance, lux; or a word */
    enum between_align align; /* turn skies so that their suns stand where they must (align.h), at this place: */
    double place[2];          /* latitude, longitude, degrees */
    enum layout layout;       /* as environment_desc; */
    const char *layer;        /* likewise; borrowed */
    uint32_t max_side;        /* likewise */
};

bool between_corrects(const struct between_desc *d); /* whether it changes the skies themselves */
/* Whether images of a sequence differ from its frames. */
bool between_is_used(const struct between_desc *d);

struct between;

/* The caller owns *out. ERR_NOMEM. */
MUST_CHECK enum err between_create(const struct between_desc *desc, struct between **out);
void between_destroy(struct between *b); /* NULL is allowed */

/* Decodes f, the sky at `seconds`, which must be later than the window's last, and adds it to the window. decoder: as
 * environment_desc.decoder, borrowed for the call. Errors of environment_decode, with *why; the window is unchanged
 * then. */
MUST_CHECK enum err between_take(struct between *b, const struct frame *f, double seconds,
                                 const struct image_decoder *decoder, struct reason *why);

/* Looks at the sun of a sky and no more, so that the alignment is known before the first is shown: of some frames of a
 * sequence, spread over it. Errors as those of between_take. */
MUST_CHECK enum err between_learn(struct between *b, const struct frame *f, struct reason *why);

/* The alignment stays as it was learnt, and is logged; if no sun was seen, no sky is turned. */
void between_settle(struct between *b);

/* Empties the window: what follows has nothing to do with what was before. */
void between_forget(struct between *b);

/* How many skies the window has, and the time of one, from the oldest, 0. */
uint32_t between_count(const struct between *b);
double between_seconds(const struct between *b, uint32_t k);

/* The sky at a time, as texels of a lat-long image; number, name, time and units are those of the last sky at or before
 * it. At a sky's own time, and with BETWEEN_OFF, it is that sky, bit for bit. Before the first: the first. After the
 * last: it with its sun moved on, by up to the last interval. The window must not be empty. ERR_NOMEM. */
MUST_CHECK enum err between_show(struct between *b, double seconds, struct frame *out);

/* What happens between the window's last two skies and what was corrected, for people, such as "the sun moves, the rest
 * fades; a clipped sun was restored". moving: there are images between. Returns out. */
const char *between_state(const struct between *b, bool moving, char *out, size_t size);
