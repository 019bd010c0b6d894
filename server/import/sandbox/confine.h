/* The sandbox of a process that reads untrusted data: irrevocably drops everything that reading does not need.
 * Thread: main, before any other starts. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct confine_limits {
    size_t address_bytes; /* address space */
    uint64_t file_bytes;  /* size up to which it may write files that it was given */
    unsigned seconds;     /* processor time; SIGXCPU ends the process */
    unsigned descriptors; /* that stay open, counted from 0; those above are closed */
    unsigned received;    /* more that may be open, received from the socket or opened */
    bool threads;         /* it may start threads; confine_network keeps it from starting processes */
};

/* Drops all capabilities and the right to gain any; a process of root becomes one of nobody, if root may do that.
 * Returns 0 or errno. Part of confine_limits. */
int confine_user(void);

/* Drops privileges, denies new files, core dumps and processes, and sets these limits. Returns 0 or errno. */
int confine_limits(const struct confine_limits *l);

/* Installs a seccomp filter: every system call other than read, write, memory, clocks and exit ends the process
 * (SIGSYS). `receives`: it may also receive descriptors from its socket, close them, and abort. Returns 0, or errno if
 * the kernel has no seccomp. */
int confine_calls(bool receives);
/* Likewise, but such a call fails with EPERM: for libraries that try some and do without. */
int confine_calls_softly(void);

/* Of a process that reads from the network: a seccomp filter that allows internet sockets, threads and what belongs to
 * them, and Landlock where the kernel has it: of files it may read only those that resolving names and checking
 * certificates need, and `file`, which may be NULL. Calls are checked with their arguments: sockets of TCP, UDP and for
 * asking which addresses there are; no signals through descriptors. Everything else fails with EPERM; starting a
 * program ends the process. Returns 0, or errno if the kernel has no seccomp; a missing Landlock is no error, then
 * reading files is not limited. */
int confine_network(const char *file);
