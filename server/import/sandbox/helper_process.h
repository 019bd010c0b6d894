/* A helper process with which this one talks through a seqpacket socket. Thread: one at a time. */
#pragma once

#include "base/err.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

struct child {
    pid_t pid; /* 0: not running */
    int socket;
    int unconfined; /* as struct wire_hello has it */
};

/* Memory that is shared with a child. */
struct child_memory {
    int fd; /* -1: none */
    void *at;
    size_t bytes;
    size_t used; /* bytes that may be backed by pages */
};

/* Creates it as a descriptor of that name, as /proc shows it, and maps it with this protection; `program` will share
 * it. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err child_share(struct child_memory *m, const char *name, const char *program, size_t bytes,
                                int protection, struct reason *why);
void child_unshare(struct child_memory *m); /* fd -1 is allowed */

/* Finds the program `name` beside this one or in the package's lib folder, ../lib/relightd relative to it;
 * `requested` is used instead unless it is NULL. ERR_IO: not there, or not executable. */
MUST_CHECK enum err child_find(const char *name, const char *requested, char *out, size_t size, struct reason *why);

/* Starts `program` with these arguments (NULL at their end, the first is its name), descriptors, an empty environment
 * and default signal handling; standard input and outputs are /dev/null. Waits until clock_ms() is until_ms for its
 * hello. ERR_IO: it cannot be started, or says none. ERR_END: *stop was set, which may be NULL. */
MUST_CHECK enum err child_start(struct child *c, const char *program, char *const arguments[], const int *descriptors,
                                size_t count, int64_t until_ms, const atomic_bool *stop, struct reason *why);

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

/* Sends one message. False: the process has ended. */
bool child_send(struct child *c, const void *message, size_t size);

/* Waits for one message of exactly `size` bytes, the first of which are WIRE_MAGIC, until clock_ms() is until_ms. stop
 * may be NULL. */
enum child_receipt child_receive(struct child *c, void *message, size_t size, int64_t until_ms,
                                 const atomic_bool *stop);

/* ---- The helper's side ---- */

/* The helper process's side of the socket. Thread: main. */

/* Prints that the program is not for users, who started it without the arguments that it needs: `purpose` is what other
 * programs start it for. Returns the exit code. */
int helper_refuse(int argc, char **argv, const char *purpose);

/* Says hello after the process has been confined, with errno of the attempt or 0; and waits for, and sends, one
 * message. False: the parent is gone or has sent something else. */
bool helper_hello(int unconfined);
bool helper_receive(void *message, size_t size);
bool helper_send(const void *message, size_t size);

/* ---- Messages ---- */

/* What the messages between a program and its helper processes have in common: each is one packet of a seqpacket
 * socket, has the size that its receiver expects and begins with WIRE_MAGIC. The first is the process's hello. */

#define WIRE_MAGIC 0x524c5701u /* differs between incompatible builds */
#define WIRE_SOCKET 3          /* the process's descriptor of the socket; behind it those that it was given, in order */

struct wire_hello {
    uint32_t magic;
    int32_t unconfined; /* 0: seccomp is active; else errno: it is not */
};
