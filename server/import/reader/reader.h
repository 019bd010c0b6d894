/* Loads a scene from files through relight-reader, a confined process that cannot open files: this process opens the
 * files that a scene may use (files.h) and sends their descriptors. If a file makes relight-reader crash, hang or
 * exceed its limits, the scene is refused with a reason. The result is not trusted either (wire.h). Thread: any. */
#pragma once

#include "scene/geometry/scene.h"

struct progress;

/* How to read a scene; zero means the default. */
struct scene_reading {
    uint64_t memory_bytes;  /* for reading, and for the scene itself; SCENE_MEMORY_DEFAULT */
    uint64_t texture_bytes; /* of all textures, beyond which they lose resolution; SCENE_TEXTURES_DEFAULT */
    unsigned seconds;       /* of processor time; 60. Ten times as long by the clock. */
    const char *program;    /* default: relight-reader beside this program, or in ../lib/relightd relative to it */
    bool animate;           /* models with an animation stand as it has them at */
    double time;            /* s, 0..1e6; else they are at rest */
};

#define SCENE_MEMORY_DEFAULT UINT64_C(4000000000)
#define SCENE_TEXTURES_DEFAULT UINT64_C(450000000)

/* Reads a .json scene or a model of any format of docs/scenes.md. On ERR_OK the caller owns *out; on error *out is NULL
 * and *why names file, place and fault. ERR_IO: a file is missing, is none, or must not be read; no relight-reader.
 * ERR_FORMAT: malformed JSON or model, an unknown material; the process crashed. ERR_RANGE: a value, the memory or the
 * time is outside its limits. ERR_UNSUPPORTED: an unknown file format. ERR_NOMEM: this process is out of memory.
 * Unsupported features are named once each in a warning. reading and progress may be NULL; progress is stepped once per
 * model. */
MUST_CHECK enum err scene_load(const char *path, const struct scene_reading *reading, struct scene **out,
                               struct progress *progress, struct reason *why);

/* ---- The built-in scene ---- */

/* The built-in scene, shown if no file is given. Thread: any. */

/* The caller owns it. NULL: out of memory. */
struct scene *scene_create_builtin(void);
