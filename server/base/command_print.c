#include "base/command.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

#define SUMMARY_MAX 90 /* characters; whatis(1) prints the summary on one line */

/* ---- Manual page, in man(7) macros ---- */

/* Escapes text for roff: a backslash would start a request, a minus sign would become a hyphen, and a period or an
 * apostrophe at the start of a line would start a request. Newlines become blanks, since roff fills lines. */
static void put_roff(const char *text)
{
    bool begins = true;

    for (const char *p = text; *p; p++) {
        if (begins && (*p == '.' || *p == '\''))
            fputs("\\&", stdout);
        if (*p == '\\')
            fputs("\\e", stdout);
        else if (*p == '-')
            fputs("\\-", stdout);
        else
            putchar(*p == '\n' ? ' ' : *p);
        begins = false;
    }
}

/* Preformatted lines keep their line breaks. */
static void put_roff_lines(const char *text)
{
    while (*text) {
        char line[512];
        const size_t length = strcspn(text, "\n");
        snprintf(line, sizeof(line), "%.*s", (int)length, text);
        put_roff(line);
        putchar('\n');
        text += length + (text[length] == '\n');
    }
}

static void put_upper(const char *text)
{
    for (; *text; text++)
        putchar(toupper((unsigned char)*text));
}

/* The summary after the name, for the man page and whatis(1): the description up to its first end of sentence or
 * clause, or only up to its first comma if that is too long. A period inside a word does not count. */
static void put_summary(const char *about)
{
    char text[200];
    size_t n = 0;

    for (; about[n] && n < sizeof(text) - 1; n++) {
        const char next = about[n + 1];
        if ((about[n] == '.' || about[n] == ':') && (next == ' ' || next == '\n' || next == '\0'))
            break;
        text[n] = n == 0 ? (char)tolower((unsigned char)about[n]) : about[n];
    }
    text[n] = '\0';
    if (n > SUMMARY_MAX)
        text[strcspn(text, ",")] = '\0';
    put_roff(text);
}

static bool is_shown(const struct command *c, size_t k, bool all)
{
    return command_offers(c, c->flags[k].row) && (all || c->flags[k].row->level == SETTING_COMMON);
}

/* A section's heading goes before its first flag that is shown. */
static const char *heading(const struct command *c, size_t k, bool all)
{
    const char *section = c->flags[k].row->section;

    while (k > 0 && strcmp(c->flags[k - 1].row->section, section) == 0)
        if (is_shown(c, --k, all))
            return NULL;
    return section;
}

/* What a flag does: its sentence, its choices and its default. */
static void describe(const struct command *c, const struct command_flag *f, void (*put)(const char *text))
{
    char text[600], names[200] = "";
    const struct setting *s = f->row;

    if (s->type == SETTING_CHOICE)
        choice_list(s->choices, c->program, names, sizeof(names));
    snprintf(text, sizeof(text), s->unit && f->initial ? "%s%s%s%s [%s]" : "%s%s%s%s", s->help, command_also(c, s),
             names[0] ? ": " : "", names, f->initial);
    put(text);
    putchar('\n');
}

static void put_plain(const char *text)
{
    fputs(text, stdout);
}

/* "--size WxH", or "cells=K" for a key of --tune. */
static void put_flag(const struct command *c, const struct command_flag *f)
{
    const struct setting *s = f->row;
    const bool is_key = s->level == SETTING_TUNE;
    char left[40];

    snprintf(left, sizeof(left), "%s%s%s%s", is_key ? "" : "--", s->name,
             !s->unit ? ""
             : is_key ? "="
                      : " ",
             s->unit ? s->unit : "");
    printf("  %-26s ", left);
    describe(c, f, put_plain);
}

void command_print_keys(const struct command *c)
{
    for (size_t k = 0; k < c->flag_count; k++)
        if (c->flags[k].row->level == SETTING_TUNE)
            put_flag(c, &c->flags[k]);
}

void command_print_help(const struct command *c, bool all)
{
    printf("usage: %s %s\n\n%s\n", c->name, c->synopsis, c->about);
    for (size_t k = 0; k < c->flag_count; k++) {
        if (!is_shown(c, k, all))
            continue;
        if (heading(c, k, all))
            printf("\n%s\n", heading(c, k, all));
        put_flag(c, &c->flags[k]);
    }
    printf("\n  %-26s print the common flags, or all, and exit\n  %-26s print the version and exit\n", "--help [all]",
           "--version");
    if (c->epilogue)
        printf("\n%s\n%s", c->epilogue_title, c->epilogue);
}

static void put_manual_flags(const struct command *c)
{
    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *s = c->flags[k].row;
        const bool is_key = s->level == SETTING_TUNE;
        if (!command_offers(c, s))
            continue;
        if (heading(c, k, true)) {
            printf(".SS \"%c", toupper((unsigned char)s->section[0]));
            put_roff(s->section + 1);
            printf("\"\n");
        }
        printf(".TP\n\\fB%s", is_key ? "" : "\\-\\-");
        put_roff(s->name);
        printf("\\fR");
        if (s->unit) {
            printf("%s\\fI", is_key ? "=" : " ");
            put_roff(s->unit);
            printf("\\fR");
        }
        putchar('\n');
        describe(c, &c->flags[k], put_roff);
    }
}

void command_print_manual(const struct command *c)
{
    static const char *const programs[] = { "relight-bench", "relight-chart",  "relight-diff",  "relight-feed",
                                            "relightd",      "relight-record", "relight-render" };
    const char *separator = "";

    printf(".TH ");
    put_upper(c->name);
    printf(" 1 \"\" \"relightd %s\" \"User Commands\"\n.nh\n.SH NAME\n%s \\- ", RELIGHT_VERSION, c->name);
    put_summary(c->about);
    printf("\n.SH SYNOPSIS\n.B %s\n", c->name);
    put_roff(c->synopsis);
    printf("\n.SH DESCRIPTION\n");
    put_roff(c->about);
    printf("\n.SH OPTIONS\nA value follows its flag after a space or an equals sign. Defaults are shown in "
           "brackets.\n");
    put_manual_flags(c);
    printf(".SS \"All programs\"\n.TP\n\\fB\\-\\-help\\fR [all]\nprint the common flags, or all, and "
           "exit\n.TP\n\\fB\\-\\-version\\fR\n"
           "print the version and exit\n");
    if (c->epilogue) {
        printf(".SH \"");
        put_upper(c->epilogue_title);
        printf("\"\n.nf\n");
        put_roff_lines(c->epilogue);
        printf(".fi\n");
    }
    printf(".SH \"SEE ALSO\"\n");
    for (size_t i = 0; i < sizeof(programs) / sizeof(programs[0]); i++) {
        if (strcmp(programs[i], c->name) == 0)
            continue;
        printf("%s.BR %s (1)", separator, programs[i]);
        separator = ",\n";
    }
    printf("\n.PP\nThe documents in /usr/share/doc/relightd.\n");
}
