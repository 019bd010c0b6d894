/* server/relightd_config.h */
/* What relightd was told: by flags, by a file whose keys are the flags, by files that hold tokens. Main thread. */
#ifndef RELIGHTD_CONFIG_H
#define RELIGHTD_CONFIG_H

#include "relightd.h"

#include "config.h"
#include "light_options.h"
#include "options.h"

#define DAEMON_ROWS_MAX 72

/* One table of all flags with what each was given. */
struct daemon_flags {
    struct option_row rows[DAEMON_ROWS_MAX], light[LIGHT_OPTIONS];
    struct options options; /* of these tables: not to be moved */
};

/* ---- relightd_options.c ---- */

/* Every flag at its default. */
void daemon_flags_init(struct daemon_flags *f);

/* What the flags mean, into the fields of d that hold what was said, and nothing else: d need not be one that runs.
 * Strings are those of the table. ERR_USAGE names the flag. */
MUST_CHECK enum err daemon_understand(const struct options *o, struct daemon *d, struct reason *why);

#endif
