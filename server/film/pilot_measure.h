/* server/film/pilot_measure.h */
/* Parts of a picture by which the whole is judged: groups of pixels spread over it, with the packets that hold their
 * shade points, and what two independent pictures of a group say. A set's groups are made once; one thread
 * of control. */
#ifndef FILM_PILOT_MEASURE_H
#define FILM_PILOT_MEASURE_H

#include "gbuffer.h"

#include <stdbool.h>
#include <stdint.h>

#define GROUPS_MAX 24

enum surface_kind { SURFACE_MATTE, SURFACE_GLOSSY, SURFACE_KINDS };

struct group {
    uint32_t *pixels; /* that hold a shade point */
    uint32_t pixel_count;
    uint32_t *index;                        /* of packets: the matte ones, then the glossy ones */
    struct packet_list list[SURFACE_KINDS]; /* into it */
    struct packet_list both;
    uint64_t points[SURFACE_KINDS]; /* in those packets, other pixels' included */
    double weight[SURFACE_KINDS];   /* of the pixels, in their own points: how many of them each kind fills */
};

struct group_tile {
    double weight;
    uint32_t tile;
};

struct tile_mean { /* of two estimates, and of both together, over so many pixels */
    double first[3], second[3], both[3], pixels;
};

struct groups {
    const struct gbuffer *gbuffer;
    struct group group[GROUPS_MAX];
    uint32_t count;
    struct group all;   /* the whole picture */
    double edge_points; /* share of the shade points in pixels that have several */
    /* Tiles of side x side pixels, row by row: each is of one group. */
    uint32_t side, across, tiles;
    bool dealt;               /* by a picture */
    uint8_t *deal;            /* [tiles]: its group */
    uint8_t *owner;           /* [pixels]: likewise */
    uint8_t *seen;            /* [packets]: scratch, as the others are */
    struct group_tile *order; /* [tiles] */
    struct tile_mean *mean;   /* [tiles]: scratch */
    uint64_t pixels;          /* that hold a shade point */
};

/* False when out of memory; finish all the same. */
bool groups_init(struct groups *s, const struct gbuffer *g);
void groups_finish(struct groups *s);

struct yardstick;
/* Deals the tiles anew, by a picture: errors are relative, so that they stand where it is dark, and each group is to
 * have its share of that. False when out of memory: the groups must not be used any more. */
bool groups_deal(struct groups *s, const struct yardstick *y);

static inline enum surface_kind surface_of(const struct shade_packet *p)
{
    return p->kind == LOBE_LAMBERT ? SURFACE_MATTE : SURFACE_GLOSSY;
}

/* What the picture has of the part that a pair is of. */
enum pair_place {
    PAIR_APART, /* another estimate of it: neither of the two */
    PAIR_FIRST, /* the first of the two */
    PAIR_NONE,  /* nothing: its mean over the neighbourhood stands for it */
};

/* The picture by which errors are made relative: float[height][width][3] as resolved, and 1e-2 mean(r)^2. r of a pixel
 * is the picture's own value, with the pair's mean for the part where that is known: of symmetric noise the mean of two
 * tells nothing about their difference. Where noise is as large as the light itself that would not do, since a pixel
 * that is far off would be measured by itself: then r is a mean over the neighbours, 3 x 3 pixels of a picture, and of
 * particles, which are sparse, the mean of 9 x 9 that `part` holds. */
struct yardstick {
    const float *rgb;
    const float *part; /* what is to be added; NULL: nothing */
    const uint8_t *mask;
    uint32_t width, height;
    enum pair_place place;
    bool smooth;
    bool even; /* at PAIR_NONE: of the part the neighbourhood's mean is as good as its own, and less noisy */
    double soft;
};

#define YARDSTICK_NOISY 0.05 /* relMSE of a part from which the smooth one is the better */

/* The mean of two pictures over 9 x 9 pixels, into out; spare is as large. */
void yardstick_spread(const float *a, const float *b, uint32_t width, uint32_t height, float *spare, float *out);

void yardstick_init(struct yardstick *y, const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height);

/* Sums over pixels, each the mean over its channels, relative as relMSE is. */
struct pair {
    double error;  /* of either of the two: half of the squared difference */
    double energy; /* product: of the part itself, squared */
    double edge;   /* of what edge pixels would be if their heaviest entry stood for all, squared */
    uint64_t pixels;
};

/* Two independent estimates of a part at the shade points, a and b: float[packet_count][3][16]. Points of the kinds
 * that are not wanted count 0. */
void pair_of_points(struct groups *s, const struct group *group, const bool kinds[SURFACE_KINDS], const float *a,
                    const float *b, const struct yardstick *y, struct pair *out);

/* Of two independent estimates, what each shade point has of half the squared difference, by the group's pixels: into
 * error[packet_count][16], for the group's packets. It may be negative by chance. */
void pair_by_point(const struct groups *s, const struct group *group, const bool kinds[SURFACE_KINDS], const float *a,
                   const float *b, const struct yardstick *y, float (*error)[PACKET]);

/* Two pictures of a part. */
void pair_of_pictures(const struct group *group, const float *a, const float *b, const struct yardstick *y,
                      struct pair *out);

#endif
