/* Writes the frames of a source as OpenEXR files instead of sending them: computed skies and videos for other programs.
 * Thread: one; the caller's. */
#pragma once

#include "clients/feed/reader.h"

/* Writes every frame to `pattern`, a name with %d or %04d for the frame number, as linear Rec.709 with 32-bit floats,
 * or 16-bit floats with RAW_HALF, in the layout of the frame. Frames that cannot be read are reported and skipped;
 * then, and if Ctrl-C ends it early, the result is ERR_IO. ERR_USAGE: a pattern of no EXR file, one name for many
 * frames, a source that never ends. Errors of source_open and exr_write, which name the file. */
MUST_CHECK enum err files_write(const struct reader_desc *d, const char *pattern, struct reason *why);
