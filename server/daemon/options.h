/* The flags of relightd. A configuration file has the same ones as keys. Main thread. */
#ifndef DAEMON_OPTIONS_H
#define DAEMON_OPTIONS_H

#include "daemon/config.h"

#include "base/command.h"

/* All flags with the value each was given. */
struct daemon_flags {
    struct command command; /* points into itself: do not copy */
};

/* Every flag at its default. */
void daemon_flags_init(struct daemon_flags *f);

/* Translates the flags into *c, which is zeroed. Strings stay those of the table. ERR_USAGE names the flag. */
MUST_CHECK enum err daemon_config_from_flags(struct daemon_flags *f, struct daemon_config *c, struct reason *why);

#endif
