/* clients/feed/reader.h */
/* Reads a source ahead on a thread of its own, so that slow disks, watched folders and computed skies never keep the
 * connection waiting: at most two parcels are held, in order. */
#ifndef FEED_READER_H
#define FEED_READER_H

#include "parcel.h"
#include "source.h"

#define READER_SLOTS 2

struct reader;

struct reader_desc {
    struct source_desc source;
    struct parcel_desc parcel;
    void (*wake)(void *user); /* something new to take, or the end; on the reader's thread */
    void *user;
};

struct reader_counts {
    uint64_t passed; /* frames that reader_begin's `after` left out */
    uint64_t faulty; /* frames that could not be read or packed: each was named on standard error */
};

/* Opens the source; errors as source_open's. Nothing is read before reader_begin. */
MUST_CHECK enum err reader_create(const struct reader_desc *d, struct reader **out, struct reason *why);
void reader_destroy(struct reader *r); /* NULL is allowed */

/* Starts, or starts again from the source's first frame with nothing held; with has_after only frames with numbers
 * above `after` are given. ERR_NOMEM: no thread. What reader_take gave is not valid any more. */
MUST_CHECK enum err reader_begin(struct reader *r, bool has_after, uint64_t after, struct reason *why);

/* The oldest parcel, again and again until reader_drop; NULL: none yet, or the end. One thread. */
struct parcel *reader_take(struct reader *r);
void reader_drop(struct reader *r);

bool reader_is_done(struct reader *r);         /* the source has ended and nothing is held */
uint64_t reader_total(const struct reader *r); /* frames of one pass; 0 unknown or without end */
void reader_counts(struct reader *r, struct reader_counts *out);

#endif
