/* server/decoder/confine.h */
/* Takes away from this process all that decoding does not need, for good. Inside this room only. Main thread, before
 * any other. */
#ifndef DECODER_CONFINE_H
#define DECODER_CONFINE_H

#include <stddef.h>

/* No files, no core dump, no other process, no new privileges, at most so many bytes mapped, and so many seconds of
 * processor time in its life. 0, or errno. */
int confine_limits(size_t address_bytes, unsigned seconds);

/* From here on every system call but the few that decoding makes ends the process (SIGSYS). 0, or errno where the
 * kernel has no seccomp. */
int confine_calls(void);

#endif
