/* Short words for the rows of a table of settings; for the file that defines one, after all other headers. */
#pragma once

#include "base/command.h"

/* .offset and .size of a field. */
#define SETTING_AT(type, field) .offset = offsetof(struct type, field), .size = sizeof(((struct type *)0)->field)

/* Types with their ranges. */
#define SWITCH .type = SETTING_SWITCH
#define SWITCH_OFF .type = SETTING_SWITCH_OFF
#define WHOLE(from, to) .type = SETTING_WHOLE, .least = from, .most = to
#define POWER(to) .type = SETTING_POWER, .least = 1, .most = to
#define REAL(from, to) .type = SETTING_REAL, .least = from, .most = to
#define OR_WORD(list) .choices = list
#define CHOICE(list) .type = SETTING_CHOICE, .choices = list
#define TEXT .type = SETTING_TEXT
#define TEXTS .type = SETTING_TEXTS

/* The level of a row, before its section. */
#define EXPERT .level = SETTING_EXPERT
#define TUNE .level = SETTING_TUNE, .section = "Keys of --tune"
