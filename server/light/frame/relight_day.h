/* What points see of the sun along its day, asked for while images are made (light/cache_direct/transport.h), so that
 * the images that meet it trace no rays to it, and kept in a file for the next start. */
#pragma once

#include "light/frame/relight_cache.h"

#include <pthread.h>

/* Where the sun goes, by the frames' thread. */
struct aim {
    struct transport *transport; /* NULL: not known yet */
    struct sun_day day;
    float axis[3];   /* of the last frame's sun */
    uint64_t since;  /* number of the frame that began this day */
    uint32_t frames; /* that had this day one after another */
};

struct relight_day {
    const struct prepared_scene *set;
    struct relight_keep keep;
    const struct precedence *urgent;
    pthread_mutex_t lock; /* of the rest */
    pthread_cond_t aimed;
    struct aim aim;
    bool ended;
};

/* The caller keeps set and urgent. */
void relight_day_init(struct relight_day *d, const struct prepared_scene *set, const struct relight_desc *light,
                      const struct relight_keep *caches, const struct precedence *urgent);
void relight_day_finish(struct relight_day *d);

/* After a frame by the finished cache t: see relight_builder_aim. Thread: the frames'. */
void relight_day_aim(struct relight_day *d, struct transport *t, const struct sun_day *day);

/* Asks, day after day, until relight_day_end. Thread: the builder's. */
void relight_day_follow(struct relight_day *d);
void relight_day_end(struct relight_day *d); /* thread: any */
