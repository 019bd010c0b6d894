/* Checks headers that Assimp 5.2 does not check, before it reads the file. */
#include "import/formats/import.h"

#include <string.h>

#define PLY_LINES_MAX 1000 /* bounds the search for the end of a header */
#define PLY_LINE_MAX 1023  /* bytes */

static bool is_ply_line(const char *line)
{
    static const char *const starts[] = {
        "ply", "format ", "comment", "obj_info", "element ", "property ", "end_header"
    };

    for (size_t i = 0; i < sizeof(starts) / sizeof(starts[0]); i++) {
        if (strncmp(line, starts[i], strlen(starts[i])) == 0)
            return true;
    }
    return false;
}

enum err ply_check(const struct bytes *file, struct reason *why)
{
    size_t at = 0;

    for (int number = 1; number <= PLY_LINES_MAX && at < file->size; number++) {
        char line[PLY_LINE_MAX + 1];
        const size_t left = file->size - at;
        const uint8_t *end = memchr(file->at + at, '\n', left < PLY_LINE_MAX ? left : PLY_LINE_MAX);
        const size_t length = end ? (size_t)(end - (file->at + at)) : left < PLY_LINE_MAX ? left : PLY_LINE_MAX;
        memcpy(line, file->at + at, length);
        line[length] = '\0';
        at += length + 1;
        line[strcspn(line, "\r")] = '\0';
        if (strcmp(line, "end_header") == 0 && end)
            return ERR_OK;
        if (!is_ply_line(line) || !end || strncmp(line, "end_header", 10) == 0)
            return err_say(why, ERR_FORMAT, "line %d is not part of a PLY header", number);
    }
    return err_say(why, ERR_FORMAT, "the PLY header has no end_header");
}
