/* What has changed since the last frame of a cache of light transport, to the bit, so that only that is computed. A
 * block's light is made from the cells that its pieces list, from the samples of the bright part, and, of narrow lobes,
 * from the sky texel by texel: where these have the same bits, so has the light. Where all of them are those of the
 * last frame times one power of two, so is the light, since such products are exact; other gains round, and count as
 * changes. */
#ifndef SHADE_TRANSPORT_PAST_H
#define SHADE_TRANSPORT_PAST_H

#include "transport_parts.h"

struct transport_change {
    enum transport_what what;
    float gain;         /* TRANSPORT_GAIN: by which all is multiplied */
    uint64_t chunks[2]; /* TRANSPORT_SOME: a bit for each that has changed */
    bool texels;        /* the sky's texels have not changed either, but for the gain; false where that is not known */
};

/* Before the frame's sky is taken: keeps that of the frame before. */
void transport_past_begin(struct transport *t);

/* After it: what has changed. valid: lo is still what the frame before has left. */
void transport_past_compare(struct transport *t, const struct environment *e, const struct transport_guest *guest,
                            bool valid, struct transport_change *out);

/* The block's light does not have to be computed; at TRANSPORT_GAIN it has to be multiplied. */
bool transport_past_keeps(const struct transport_change *c, const struct transport_block *b);

void transport_past_finish(struct transport_past *p);

#endif
