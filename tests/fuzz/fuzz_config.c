/* A configuration file is parsed, or refused with file and line; its keys are at the reported lines, and readers of
 * flags accept the values, or say what is wrong. */
#include "harness.h"

#include "base/command.h"
#include "base/setting_table.h"

#include <jansson.h>
#include <math.h>
#include <string.h>

#define NAME "f.json"

struct values {
    uint32_t size[2];
    uint64_t samples;
    double gain;
    struct setting_frames frames;
    bool fast;
};

#define IN .section = "what goes in"
#define AT(field) SETTING_AT(values, field)

static const struct setting rows[] = {
    { "size", "WxH", "the image's size", "640x360", IN, .type = SETTING_SIZE, AT(size) },
    { "samples", "N", "how many", "64", IN, WHOLE(1, 4096), AT(samples) },
    { "gain", "X", "a factor", "1", IN, REAL(-1e3, 1e3), AT(gain) },
    { "frames", "A-B", "which", NULL, IN, .type = SETTING_FRAMES, AT(frames) },
    { "fast", NULL, "a switch", NULL, IN, SWITCH, AT(fast) },
    { .name = NULL },
};
static struct values values;
static struct command command = { .name = "relight-fuzz", .lists = { { rows, &values } } };

/* Checks that "f.json:3: ..." names an existing line. */
static void check_reason(const struct reason *why, unsigned lines)
{
    char *end;

    require(strncmp(why->text, NAME ":", sizeof(NAME)) == 0, "a reason begins with the file");
    const unsigned long line = strtoul(why->text + sizeof(NAME), &end, 10);
    require(line >= 1 && line <= lines && end[0] == ':' && end[1] == ' ' && end[2], "and with a line of it");
}

/* Reading the flags gives values within the limits, or a reason. */
static void read_flags(void)
{
    struct reason why = { "" };

    if (command_read(&command, &why)) {
        require(why.text[0] == '-', "a reason that begins with the flag");
        return;
    }
    require(values.samples >= 1 && values.samples <= 4096, "a whole number within its limits");
    require(fabs(values.gain) <= 1e3, "a number within its limits");
    for (int k = 0; k < 2; k++)
        require(values.size[k] >= 1 && values.size[k] <= 16384, "a size within its limits");
    require(!values.frames.given || values.frames.first <= values.frames.last, "a range in order");
}

/* An accepted flag has exactly the file's value, to the last bit of a number. */
static void check_value(const struct command_flag *row, const json_t *value)
{
    if (!row->row->unit)
        require(json_is_boolean(value) && (row->given != NULL) == json_is_true(value), "a switch is as it was put");
    else if (json_is_string(value))
        require(strcmp(row->given, json_string_value(value)) == 0, "words are those of the file");
    else if (json_is_integer(value))
        require(strtoll(row->given, NULL, 10) == json_integer_value(value), "a whole number is that of the file");
    else
        require(json_is_real(value) && strtod(row->given, NULL) == json_real_value(value),
                "a number is that of the file");
}

static void check_entry(const struct config *c, size_t index, const json_t *root, unsigned lines)
{
    const char *key = config_key(c, index);
    struct reason why = { "" };

    command_begin(&command);
    const struct command_flag *row = command_flag(&command, key);
    const enum err e = config_apply(c, index, &command, &why);
    require(e == ERR_OK || e == ERR_USAGE, "taken, or refused as a fault of the user's");
    require(e != ERR_OK || row, "no flag but those of the table");
    if (e)
        check_reason(&why, lines);
    else
        check_value(row, json_object_get(root, key));
    read_flags();
    snprintf(why.text, sizeof(why.text), "--%.64s is wrong", key);
    require(config_add_location(c, index, ERR_USAGE, &why) == ERR_USAGE, "the error that was blamed");
    check_reason(&why, lines);
}

/* The line, without its end. */
static const char *line_at(const char *text, size_t size, unsigned line, size_t *length)
{
    const char *end = text + size;

    while (line-- > 1)
        text = (const char *)memchr(text, '\n', (size_t)(end - text)) + 1;
    const char *stop = memchr(text, '\n', (size_t)(end - text));
    *length = (size_t)((stop ? stop : end) - text);
    return text;
}

/* The line that a reason about key i names. */
static unsigned line_of(const struct config *c, size_t i)
{
    struct reason why = { "" };

    (void)config_add_location(c, i, ERR_USAGE, &why);
    return (unsigned)strtoul(why.text + sizeof(NAME), NULL, 10);
}

/* Without escapes, the quoted key is on the reported line. */
static void check_lines(const struct config *c, const char *text, size_t size, unsigned lines)
{
    const bool plain = !memchr(text, '\\', size);
    unsigned before = 1;

    for (size_t i = 0; i < config_count(c); i++) {
        const unsigned line = line_of(c, i);
        const size_t want = strlen(config_key(c, i));
        bool found = !plain;
        size_t length;
        require(line >= before && line <= lines, "keys stand in the order of the file");
        const char *at = line_at(text, size, line, &length);
        for (size_t k = 0; !found && k + want + 2 <= length; k++)
            found = at[k] == '"' && memcmp(at + k + 1, config_key(c, i), want) == 0 && at[k + 1 + want] == '"';
        require(found, "a key stands on its line");
        before = line;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    const char *text = (const char *)bytes;
    struct config *c = NULL;
    struct reason why = { "" };
    unsigned lines = 1;

    for (size_t i = 0; i < size; i++)
        lines += text[i] == '\n';
    const enum err e = config_parse(NAME, text, size, &c, &why);
    require((e == ERR_OK) == (c != NULL), "a configuration or an error");
    require(!e || e == ERR_FORMAT, "what is wrong with bytes is their format");
    if (e) {
        check_reason(&why, lines);
        return 0;
    }
    require(strcmp(config_name(c), NAME) == 0, "the name that was given");
    check_lines(c, text, size, lines);
    json_t *root = json_loadb(text, size, 0, NULL);
    require(config_count(c) == json_object_size(root), "every key");
    for (size_t i = 0; i < config_count(c); i++)
        check_entry(c, i, root, lines);
    json_decref(root);
    config_destroy(c);
    return 0;
}
