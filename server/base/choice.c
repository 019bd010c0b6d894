#include "base/setting.h"

#include <stdio.h>
#include <string.h>

bool choice_has(unsigned programs, unsigned program)
{
    return programs == 0 || (programs & program) != 0;
}

const char *choice_name(const struct setting_choice *choices, int value)
{
    for (const struct setting_choice *c = choices; c->name; c++)
        if (c->value == value)
            return c->name;
    return "";
}

void choice_list(const struct setting_choice *choices, unsigned program, char *out, size_t size)
{
    const struct setting_choice *pending = NULL;
    size_t used = 0;

    out[0] = '\0';
    for (const struct setting_choice *c = choices;; c++) {
        if (c->name && !choice_has(c->programs, program))
            continue;
        if (pending && used < size)
            used += (size_t)snprintf(out + used, size - used, "%s%s",
                                     !used     ? ""
                                     : c->name ? ", "
                                               : " or ",
                                     pending->name);
        if (!c->name)
            return;
        pending = c;
    }
}

enum err choice_parse(const struct setting_choice *choices, unsigned program, const char *what, const char *name,
                      int *out, struct reason *why)
{
    bool elsewhere = false; /* another program takes it */
    char names[200];

    for (const struct setting_choice *c = choices; c->name; c++)
        if (strcmp(c->name, name) == 0) {
            elsewhere = !choice_has(c->programs, program);
            if (elsewhere)
                break;
            *out = c->value;
            return ERR_OK;
        }
    choice_list(choices, program, names, sizeof(names));
    return err_say(why, ERR_USAGE, "%s '%.40s' is %s; expected %s", what, name,
                   elsewhere ? "not available here" : "unknown", names);
}
