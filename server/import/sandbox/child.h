/* A helper process with which this one talks through a seqpacket socket. Thread: one at a time. */
#pragma once

#include "base/err.h"

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#define CHILD_SOCKET 3 /* the child's descriptors: the socket, and behind it those that it was given, in order */

struct child {
    pid_t pid; /* 0: not running */
    int socket;
};

/* Finds the program `name` beside this one or in the package's lib folder, ../lib/relightd relative to it;
 * `requested` is used instead unless it is NULL. ERR_IO: not there, or not executable. */
MUST_CHECK enum err child_find(const char *name, const char *requested, char *out, size_t size, struct reason *why);

/* Starts `program` with these arguments (NULL at their end, the first is its name), descriptors, an empty environment
 * and default signal handling; standard input and outputs are /dev/null. ERR_IO. */
MUST_CHECK enum err child_start(struct child *c, const char *program, char *const arguments[], const int *descriptors,
                                size_t count, struct reason *why);

/* Ends the process if it has not ended yet, closes the socket, and returns the exit status as waitpid does. */
int child_end(struct child *c);

/* The end of a sentence about a process that ended so: "crashed (signal 11)". */
const char *child_death(int status, char *out, size_t size);

enum child_receipt {
    CHILD_RECEIVED,
    CHILD_GONE,    /* the process has ended */
    CHILD_GARBLED, /* it sent something else */
    CHILD_SILENT,  /* nothing until the deadline */
    CHILD_STOPPED, /* *stop was set */
};

/* Waits for one message of exactly `size` bytes until clock_ms() is until_ms. stop may be NULL. */
enum child_receipt child_receive(struct child *c, void *message, size_t size, int64_t until_ms,
                                 const atomic_bool *stop);
