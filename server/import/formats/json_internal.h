/* The parts of JSON scenes: json.c reads materials, cameras and lights, json_models.c places models. Private to this
 * room. Thread: one at a time. */
#pragma once

#include "import/formats/internal.h"

#include <jansson.h>

/* A JSON object being read. */
struct spot {
    const json_t *object;
    char place[320]; /* beginning of messages: "plaza.json: materials 'wall'" */
    struct scene *scene;
    uint32_t named; /* materials of the scene file, which come before those of models */
    const char *path;
    const struct host *host;
    struct reason *why;
};

/* Enters the object `value` of s, called `name` in messages. ERR_FORMAT: not an object. */
MUST_CHECK enum err spot_enter(const struct spot *s, const json_t *value, const char *name, struct spot *out);

/* Warns of keys that are not in `known`, which ends with NULL. */
void spot_warn_unknown(const struct spot *s, const char *const *known);

/* Reads a number within [least, most]; the key may be missing if fallback is not NULL. ERR_FORMAT, ERR_RANGE. */
MUST_CHECK enum err spot_number(const struct spot *s, const char *key, const double *fallback, double least,
                                double most, float *out);

/* Reads a string, which the JSON value owns. ERR_FORMAT: missing, empty, or none. */
MUST_CHECK enum err spot_string(const struct spot *s, const char *key, const char **out);

/* Adds the models of the scene file. Errors of model_load. */
MUST_CHECK enum err json_add_models(const struct spot *root);
