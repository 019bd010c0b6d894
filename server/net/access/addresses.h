/* This machine's own network addresses. Thread: any. */
#pragma once

#include <stddef.h>

#define ADDRESSES_MAX 32
#define ADDRESS_TEXT 46

/* Numeric, without loopback and link-local ones, IPv4 first, in the system's order. Returns their number. */
size_t addresses_of_machine(char out[ADDRESSES_MAX][ADDRESS_TEXT]);
