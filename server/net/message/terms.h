/* What messages are about: roles, requests of controllers, questions about a pixel. Plain data; any thread. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

enum server_role {
    SERVER_VIEWER,
    SERVER_CONTROLLER,
    SERVER_PRODUCER,
    SERVER_RECORDER,
    SERVER_ROLES,
};
extern const char *const server_role_names[SERVER_ROLES]; /* "viewer", ... */

/* What becomes of a producer's frame. */
enum server_fate {
    SERVER_USED,       /* an image was made */
    SERVER_SUPERSEDED, /* a newer one replaced it */
    SERVER_REFUSED,    /* unusable: `why` gives the reason */
};

/* A controller's request: the values are those of a struct that the rows of the settings describe. */
#define SERVER_CONTROL_BYTES 512
struct server_control {
    uint32_t asked; /* bit k: the request sets row k */
    _Alignas(8) char values[SERVER_CONTROL_BYTES];
    uint64_t by, request; /* the requesting connection and the number of its request, which the answer repeats */
    const char *clause;   /* of PROTOCOL.md, static: the caller sets it with an error; NULL: 4.13 */
};

/* A question about a pixel. */
struct server_inspection {
    uint64_t by, request; /* connection and number of the request, for the answer */
    uint32_t x, y;        /* within the image, if its size is known */
    uint32_t samples;     /* 0: default */
    bool figure, sky;     /* the preset of [LPG13, Fig. 1]; include an image of the sky */
    bool sky_alone;       /* the query is about the sky only, not a pixel */
};

/* A pixel that a client follows from image to image, */
struct server_follow {
    uint64_t by;
    uint32_t x, y;
};

/* and an image's radiance there. */
struct server_radiance {
    uint64_t frame;
    int64_t capture_us; /* 0: unknown */
    bool finer;         /* a refined image of the same frame */
    float rgb[3];
};
