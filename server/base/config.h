/* A configuration file: one JSON object [RFC 8259] whose keys are a program's flags without their dashes. A flag with a
 * value takes a string or a number; a switch takes true or false.
 * Thread: one at a time. Strings that are returned belong to the configuration and live as long as it does. */
#pragma once

#include "base/command.h"
#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>

struct config;

#define CONFIG_BYTES_MAX ((size_t)1 << 20) /* all flags take a few KB: a larger file is a mistake */

/* Reads a file. The caller owns *out. On error *out is NULL and *why begins with the file and, if known, the line.
 * ERR_IO: cannot be read. ERR_FORMAT: not JSON, not an object, or a duplicate key. ERR_RANGE: too large. ERR_NOMEM. */
MUST_CHECK enum err config_read(const char *path, struct config **out, struct reason *why);
/* As config_read, from `size` bytes of text. `name` stands for the file in messages. */
MUST_CHECK enum err config_parse(const char *name, const char *text, size_t size, struct config **out,
                                 struct reason *why);
void config_destroy(struct config *c); /* NULL is allowed */

const char *config_name(const struct config *c); /* the file's path, or the name given to config_parse */

/* Whether the file's permissions let anyone but its owner read it. */
bool config_is_readable_by_others(const struct config *c);

size_t config_count(const struct config *c);                  /* number of keys */
const char *config_key(const struct config *c, size_t index); /* in file order; index < config_count */

/* Copies the value of key `index` to the flag of that name. ERR_USAGE, with file, line and key: the table has no such
 * flag, or the flag does not take a value of this type. */
MUST_CHECK enum err config_apply(const struct config *c, size_t index, struct command *to, struct reason *why);

/* Prefixes *why with file, line and key: "F:3: port: '0' is ...". Returns e. */
enum err config_add_location(const struct config *c, size_t index, enum err e, struct reason *why);
