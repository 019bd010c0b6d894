/* server/decoder/confine.h */
/* The sandbox of relight-decoder: irrevocably drops everything that decoding does not need. Private to this room.
 * Thread: main, before any other starts. */
#ifndef DECODER_CONFINE_H
#define DECODER_CONFINE_H

#include <stddef.h>

/* Denies new files, core dumps, processes and privileges; limits the address space to `address_bytes` and the processor
 * time to `seconds`. Returns 0 or errno. */
int confine_limits(size_t address_bytes, unsigned seconds);

/* Installs a seccomp filter: every system call that decoding does not make ends the process (SIGSYS). Returns 0, or
 * errno if the kernel has no seccomp. */
int confine_calls(void);

#endif
