/* Settings in control messages and in the state file. */
#include "base/setting.h"

#include <jansson.h>
#include <limits.h>
#include <math.h>
#include <string.h>

static bool is_number(const struct setting *s)
{
    return s->type == SETTING_WHOLE || s->type == SETTING_REAL;
}

static enum err number_from_json(const struct setting *s, unsigned program, const json_t *v, void *values,
                                 struct reason *why)
{
    const bool whole = s->type == SETTING_WHOLE;
    char words[80] = "";
    int word;

    if (s->choices && json_is_string(v) &&
        choice_parse(s->choices, program, s->key, json_string_value(v), &word, NULL) == ERR_OK) {
        setting_store_real(s, values, word);
        return ERR_OK;
    }
    if (whole ? !json_is_integer(v) : !json_is_number(v))
        goto wrong;
    const double x = json_number_value(v); /* JSON has no NaN */
    if (!(x >= s->least && x <= s->most))
        goto wrong;
    if (whole)
        setting_store_whole(s, values, (uint64_t)json_integer_value(v));
    else
        setting_store_real(s, values, x);
    return ERR_OK;
wrong:
    if (s->choices)
        choice_list(s->choices, program, words, sizeof(words));
    return whole ? err_say(why, ERR_USAGE, "%s must be an integer from %.0f to %.0f", s->key, s->least, s->most)
                 : err_say(why, ERR_USAGE, "%s must be a number from %g to %g%s%s", s->key, s->least, s->most,
                           words[0] ? ", " : "", words);
}

static enum err word_from_json(const struct setting *s, unsigned program, const json_t *v, void *values,
                               struct reason *why)
{
    const size_t length = json_string_length(v);
    int choice = 0;

    if (length == 0 || (s->type == SETTING_NAME && length >= s->size))
        return err_say(why, ERR_USAGE, "%s must be a word of at most %u bytes", s->key,
                       s->type == SETTING_NAME ? s->size - 1 : 40);
    if (s->type == SETTING_NAME) {
        memcpy((char *)values + s->offset, json_string_value(v), length + 1);
        return ERR_OK;
    }
    const enum err e = choice_parse(s->choices, program, s->key, json_string_value(v), &choice, why);
    if (!e)
        setting_store_whole(s, values, (uint64_t)(unsigned)choice);
    return e;
}

static enum err row_from_json(const struct setting *s, unsigned program, const json_t *v, void *values,
                              struct reason *why)
{
    if (s->has_null && json_is_null(v)) {
        if (s->type == SETTING_REAL)
            setting_store_real(s, values, s->null);
        else
            setting_store_whole(s, values, (uint64_t)s->null);
        return ERR_OK;
    }
    if (is_number(s))
        return number_from_json(s, program, v, values, why);
    if (s->type != SETTING_SWITCH)
        return word_from_json(s, program, v, values, why);
    if (!json_is_boolean(v))
        return err_say(why, ERR_USAGE, "%s must be true or false", s->key);
    setting_store_whole(s, values, json_is_true(v));
    return ERR_OK;
}

/* Whether the row excludes others of its group: what adds up and null do not. */
static bool excludes(const struct setting *s, const void *values)
{
    return s->group && !(s->use & SETTING_ADDS) && !setting_is_null(s, values);
}

enum err settings_from_json(const struct setting *rows, unsigned program, const json_t *object, uint32_t *asked,
                            void *values, const char **clause, struct reason *why)
{
    *asked = 0;
    for (uint32_t k = 0; rows && rows[k].key; k++) {
        const struct setting *s = &rows[k];
        const json_t *v = s->use & SETTING_ASKED ? json_object_get(object, s->key) : NULL;
        if (!v)
            continue;
        *clause = s->clause;
        const enum err e = row_from_json(s, program, v, values, why);
        if (e)
            return e;
        for (uint32_t j = 0; j < k; j++)
            if (*asked >> j & 1 && rows[j].group == s->group && excludes(&rows[j], values) && excludes(s, values))
                return err_say(why, ERR_USAGE, "%s and %s exclude each other", rows[j].key, s->key);
        if (!(s->use & SETTING_ADDS) || setting_whole(s, values) != 0)
            *asked |= (uint32_t)1 << k;
    }
    return ERR_OK;
}

void settings_join(const struct setting *rows, uint32_t *asked, void *values, uint32_t then, const void *then_values)
{
    for (uint32_t k = 0; rows && rows[k].key; k++)
        for (uint32_t j = 0; then >> k & 1 && rows[j].key; j++)
            if (excludes(&rows[k], then_values) && rows[j].group == rows[k].group)
                *asked &= ~((uint32_t)1 << j);
    for (uint32_t k = 0; rows && rows[k].key; k++) {
        if (!(then >> k & 1))
            continue;
        if (rows[k].use & SETTING_ADDS && *asked >> k & 1)
            setting_store_whole(&rows[k], values,
                                (uint64_t)(setting_whole(&rows[k], values) + setting_whole(&rows[k], then_values)));
        else
            setting_copy(&rows[k], values, then_values);
    }
    *asked |= then;
}

json_t *words_to_json(const char *text)
{
    json_t *s = json_string(text);
    return s ? s : json_string("(not UTF-8)");
}

static json_t *row_to_json(const struct setting *s, const void *values)
{
    const char *at = (const char *)values + s->offset;

    if (setting_is_null(s, values))
        return json_null();
    switch (s->type) {
    case SETTING_SWITCH: return json_boolean(setting_whole(s, values) != 0);
    case SETTING_REAL: {
        const double v = setting_real(s, values);
        const char *word = s->choices ? choice_name(s->choices, (int)fmin(fmax(v, INT_MIN), INT_MAX)) : "";
        if (word[0] && (v < s->least || v > s->most))
            return json_string(word);
        return json_real(isfinite(v) ? v : 0.0); /* JSON has neither NaN nor infinity */
    }
    case SETTING_CHOICE: return json_string(choice_name(s->choices, (int)setting_whole(s, values)));
    case SETTING_NAME: return words_to_json(at);
    default: return json_integer(setting_whole(s, values));
    }
}

json_t *settings_to_json(const struct setting *rows, unsigned use, const void *values)
{
    json_t *all = json_object();

    for (const struct setting *s = rows; s && s->key; s++)
        if ((s->use & use) == use && json_object_set_new(all, s->key, row_to_json(s, values))) {
            json_decref(all);
            return NULL;
        }
    return all;
}

static json_t *choices_to_json(const struct setting *s, unsigned program)
{
    json_t *all = json_object();

    for (const struct setting_choice *c = s->choices; c->name; c++)
        if (choice_has(c->programs, program) &&
            json_object_set_new(all, c->name, json_string(c->about ? c->about : ""))) {
            json_decref(all);
            return NULL;
        }
    return all;
}

json_t *settings_ranges(const struct setting *rows, unsigned program)
{
    json_t *all = json_object();

    for (const struct setting *s = rows; s && s->key; s++) {
        json_t *row = NULL;
        if (!(s->use & SETTING_ASKED) || (!is_number(s) && s->type != SETTING_CHOICE))
            continue;
        row = is_number(s) ? json_pack("{s:f, s:f}", "least", s->least, "most", s->most)
                           : json_pack("{s:o}", "choices", choices_to_json(s, program));
        if (json_object_set_new(all, s->key, row)) {
            json_decref(all);
            return NULL;
        }
    }
    return all;
}
