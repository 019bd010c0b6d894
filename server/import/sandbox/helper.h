/* The helper process's side of the socket (helper.h). Thread: main. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

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
