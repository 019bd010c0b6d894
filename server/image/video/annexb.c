#include "image/video/h264.h"

#include <stdbool.h>

/* nal_unit_type [H.264, Table 7-1] */
enum {
    SEQUENCE_PARAMETERS = 7,
    IMAGE_PARAMETERS = 8,
    DELIMITER = 9,
};

/* The place of the next start code from `at` on, with the zero byte in front of it if there is one; size: none. */
static size_t next_start(const uint8_t *bytes, size_t size, size_t at)
{
    for (; at + 3 < size; at++)
        if (bytes[at] == 0 && bytes[at + 1] == 0 && (bytes[at + 2] == 1 || (bytes[at + 2] == 0 && bytes[at + 3] == 1)))
            return at;
    return size;
}

size_t annexb_header_size(const uint8_t *bytes, size_t size)
{
    unsigned seen = 0;
    size_t at = next_start(bytes, size, 0);

    if (at != 0)
        return 0;
    while (at < size) {
        const size_t nal = at + (bytes[at + 2] == 1 ? 3 : 4);
        const unsigned type = nal < size ? bytes[nal] & 31u : 0;
        if (type != SEQUENCE_PARAMETERS && type != IMAGE_PARAMETERS && type != DELIMITER)
            break;
        seen |= 1u << type;
        at = next_start(bytes, size, nal);
    }
    const bool both = seen >> SEQUENCE_PARAMETERS & 1 && seen >> IMAGE_PARAMETERS & 1;
    return both ? at : 0;
}
