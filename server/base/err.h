/* Error codes and error messages.
 * A function that can fail returns `enum err`; 0 is success. A function that reads external data also takes a
 * `struct reason *`: the function that detects the error writes one line there (what, where, why), callers pass it on,
 * and only the program's outermost layer prints it or sends it to a client. Thread: any. */
#pragma once

#define MUST_CHECK __attribute__((warn_unused_result))
#define PRINTF_LIKE(text, first) __attribute__((format(printf, text, first)))

enum err {
    ERR_OK = 0,
    ERR_NOMEM,       /* out of memory */
    ERR_IO,          /* a file or socket could not be opened, read or written */
    ERR_FORMAT,      /* the data are malformed */
    ERR_RANGE,       /* a size or value lies outside the stated limits */
    ERR_UNSUPPORTED, /* well-formed, but this program does not support it */
    ERR_USAGE,       /* an invalid command line or configuration */
    ERR_END,         /* end of data: no frame is left */
};

/* One line of text without a newline; empty if there is no message. */
struct reason {
    char text[320];
};

/* A short English description of the code; never NULL. */
const char *err_text(enum err e);

/* Formats a line into *why (may be NULL; longer text is truncated) and returns e, so that a call site is one statement:
 * `return err_say(why, ERR_FORMAT, "%s: byte %zu: ...", ...)`. */
enum err err_say(struct reason *why, enum err e, const char *format, ...) PRINTF_LIKE(3, 4);

/* The exit code of a program that ended with e: 0 for ERR_OK, 2 for ERR_USAGE, 1 otherwise. */
int err_exit_code(enum err e);
