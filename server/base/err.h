/* server/base/err.h */
/* Error codes, and the sentence that goes with one.
 * What can fail returns `enum err`; 0 is success. A function that reads outside data also takes a `struct reason *`:
 * who finds the fault writes one line there (what, where, why), callers pass it on, and only the program's outermost
 * layer prints it or sends it to a client. Any thread. */
#ifndef BASE_ERR_H
#define BASE_ERR_H

#define MUST_CHECK __attribute__((warn_unused_result))
#define PRINTF_LIKE(text, first) __attribute__((format(printf, text, first)))

enum err {
    ERR_OK = 0,
    ERR_NOMEM,       /* memory could not be had */
    ERR_IO,          /* a file or socket could not be opened, read or written */
    ERR_FORMAT,      /* the data are not what they claim to be */
    ERR_RANGE,       /* a size or value lies outside the stated limits */
    ERR_UNSUPPORTED, /* well-formed, but not modelled here */
    ERR_USAGE,       /* the command line or configuration asks for the impossible */
    ERR_END,         /* nothing more will come: the last frame was read */
};

/* One line without a newline; empty when nothing was said. */
struct reason {
    char text[320];
};

/* A short English name of the code, never NULL. */
const char *err_text(enum err e);

/* Writes the line into *why (NULL is allowed; longer text is cut) and returns e, so that
 * `return err_say(why, ERR_FORMAT, "%s: byte %zu: ...", ...)` is one statement. */
enum err err_say(struct reason *why, enum err e, const char *format, ...) PRINTF_LIKE(3, 4);

/* Exit code of a tool that ended with e: 0 ok, 2 usage, 1 all else. */
int err_exit_code(enum err e);

#endif
