/* server/shade/paths.h */
/* The classes of light paths. E eye, L environment, S and D scattering events: a lobe is S if it is a delta (mirror,
 * glass, ggx with alpha below ALPHA_DELTA), else D. Each class is estimated by exactly one estimator in a frame.
 *   background       E S* L             looked up at the G-buffer's escape directions
 *   direct           E S* D L           direct.h, at the shade points
 *   caustics         E D S+ L           light_tracer.h, or eye_paths.h
 *   interreflection  E D (S* D)+ S* L   eye_paths.h, or light_tracer.h; in two parts, by the last rough surface:
 *     lit directly     E D (S* D)+ L      eye paths find the sun by next event estimation
 *     by a caustic     E D (S* D)+ S+ L   only light paths find it, best those that are aimed at the casters
 *   behind specular  E S+ D S+ L        caustics and interreflection at points that the camera sees in a mirror or
 *                    E S+ D (S* D)+ S* L  through glass (shade_packet.behind), which no light path can reach:
 *                                       eye_paths.h */
#ifndef SHADE_PATHS_H
#define SHADE_PATHS_H

#include "err.h"

#include <stdint.h>

enum path_class { /* bits */
                  PATH_BACKGROUND = 1,
                  PATH_DIRECT = 2,
                  PATH_CAUSTICS = 4,
                  PATH_INDIRECT_LIT = 8,      /* E D (S* D)+ L */
                  PATH_INDIRECT_CAUSTIC = 16, /* E D (S* D)+ S+ L */
                  PATH_INDIRECT = 24,
                  PATH_ALL = 31,
};

/* No path has more events than this. Russian roulette ends those that lose light long before; what lossless mirrors and
 * glass keep among themselves is cut here. */
#define PATH_EVENTS_MAX 256

#endif
