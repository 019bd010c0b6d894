/* A digest of the code that computes the caches of light transport, made at build time (cache_code.cmake): sources of
 * the rooms that a cache's bits depend on, and compiler and flags. It is part of a stored cache's key, so that no
 * build loads a cache that it would compute differently. */
#pragma once

extern const char cache_code[]; /* 64 hexadecimal digits */
