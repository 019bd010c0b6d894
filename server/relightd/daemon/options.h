/* The flags of relightd, which are also the keys of a configuration file. Main thread. */
#pragma once

#include "relightd/daemon/config.h"

#include "base/command.h"

/* All flags and their values. */
struct daemon_flags {
    struct command command; /* contains pointers into itself: do not copy */
};

/* Sets every flag to its default. */
void daemon_flags_init(struct daemon_flags *f);

/* Translates the flags into *c, which must be zeroed. The table keeps the ownership of strings. ERR_USAGE names the
 * flag. */
MUST_CHECK enum err daemon_config_from_flags(struct daemon_flags *f, struct daemon_config *c, struct reason *why);
