/* What the messages between a program and its helper processes have in common: each is one packet of a seqpacket
 * socket, has the size that its receiver expects and begins with WIRE_MAGIC. The first is the process's hello. */
#pragma once

#include <stdint.h>

#define WIRE_MAGIC 0x524c5701u /* differs between incompatible builds */
#define WIRE_SOCKET 3          /* the process's descriptor of the socket; behind it those that it was given, in order */

struct wire_hello {
    uint32_t magic;
    int32_t unconfined; /* 0: seccomp is active; else errno: it is not */
};
