/* server/film/light_options.h */
/* The flags by which light is asked for, the same in every program that lights a scene: what stands in its --help, and
 * how it is read. */
#ifndef FILM_LIGHT_OPTIONS_H
#define FILM_LIGHT_OPTIONS_H

#include "options.h"
#include "relight.h"

#define LIGHT_OPTIONS 21 /* rows, the last of which ends the table */

/* Fills a table for struct options.shared; `samples` and `paths` are the program's defaults. */
void light_options_init(struct option_row rows[LIGHT_OPTIONS], const char *samples, const char *paths);

/* Fills *light, set->interleave and the environment's importance. ERR_USAGE names the flag. */
MUST_CHECK enum err light_options_read(const struct options *o, struct relight_desc *light, struct set_desc *set,
                                       struct environment_desc *environment, struct reason *why);

/* "direct", "caustics", "indirect" or "all" as PATH_* bits; with direct and all comes what is seen of the sky. */
MUST_CHECK enum err paths_parse(const char *name, uint32_t *classes, struct reason *why);
/* The name for that, or "" where there is none. */
const char *paths_name(uint32_t classes);

#endif
