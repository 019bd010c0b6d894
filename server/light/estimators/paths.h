/* Classes of light paths. E: eye, L: environment, S and D: scattering events; a lobe is S if it is a delta (mirror,
 * glass, a highlight below ALPHA_DELTA), else D. In a frame, exactly one estimator computes each class.
 *   background       E S* L             looked up in the G-buffer's escape directions
 *   direct           E S* D L           direct.h, at the shading points
 *   caustics         E D S+ L           light_tracer.h or eye_paths.h
 *   indirect light  E D (S* D)+ S* L   eye_paths.h or light_tracer.h; two parts, by the last rough surface:
 *     lit directly     E D (S* D)+ L      eye paths find the sun by next event estimation
 *     by a caustic     E D (S* D)+ S+ L   only light paths find it, best those aimed at the casters
 *   behind specular  E S+ D S+ L        caustics and indirect light at points seen in a mirror or through glass
 *                    E S+ D (S* D)+ S* L  (shade_packet.behind), which light paths cannot reach:
 *                                       eye_paths.h */
#pragma once

enum path_class { /* bits */
                  PATH_BACKGROUND = 1,
                  PATH_DIRECT = 2,
                  PATH_CAUSTICS = 4,
                  PATH_INDIRECT_LIT = 8,      /* E D (S* D)+ L */
                  PATH_INDIRECT_CAUSTIC = 16, /* E D (S* D)+ S+ L */
                  PATH_INDIRECT = 24,
                  PATH_ALL = 31,
};

/* Maximum number of events of a path. Russian roulette ends lossy paths much earlier; the limit cuts off reflections
 * between lossless mirrors and glass. */
#define PATH_EVENTS_MAX 256
