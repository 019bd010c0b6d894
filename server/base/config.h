/* server/base/config.h */
/* A configuration file: one JSON object [RFC 8259] whose keys are a program's flags without their dashes, so that what
 * can be said on a command line can be said in a file, and nothing else. A flag with a value takes a string or a
 * number, a switch takes true or false. Main thread, or one thread at a time. */
#ifndef BASE_CONFIG_H
#define BASE_CONFIG_H

#include "err.h"
#include "options.h"

#include <stdbool.h>
#include <stddef.h>

struct config;

#define CONFIG_BYTES_MAX ((size_t)1 << 20)

/* Reads the file. On any error *out is NULL and *why begins with file and line, where there is one. ERR_IO: it cannot
 * be read. ERR_FORMAT: no JSON, no object, or a key twice. ERR_RANGE: too large. ERR_NOMEM. */
MUST_CHECK enum err config_read(const char *path, struct config **out, struct reason *why);
/* The same of bytes; the name is for messages. */
MUST_CHECK enum err config_parse(const char *name, const char *text, size_t size, struct config **out,
                                 struct reason *why);
void config_destroy(struct config *c); /* NULL is allowed */

const char *config_name(const struct config *c);
bool config_is_readable_by_others(const struct config *c); /* by more than its owner, when it was read */

/* Keys in the order of the file; index below config_count. */
size_t config_count(const struct config *c);
const char *config_key(const struct config *c, size_t index);
unsigned config_line(const struct config *c, size_t index); /* from 1 */

/* Takes the value of that key as the row's. Strings live as long as c does. ERR_USAGE, with file, line and key: the
 * table has no such flag, or the value is of a type that the flag does not take. */
MUST_CHECK enum err config_apply(const struct config *c, size_t index, struct options *o, struct reason *why);

/* Puts file, line and key in front of what a reader of options had to say of the value: "F:3: port: '0' is ...". */
enum err config_blame(const struct config *c, size_t index, enum err e, struct reason *why);

#endif
