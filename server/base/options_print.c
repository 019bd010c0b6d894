#include "base/options.h"

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

static void put_manual_rows(const struct option_row *rows)
{
    for (const struct option_row *r = rows; r && r->name; r++) {
        if (!r->name[0]) {
            printf(".SS \"");
            putchar(toupper((unsigned char)r->help[0]));
            put_roff(r->help + 1);
            printf("\"\n");
            continue;
        }
        printf(".TP\n\\fB\\-\\-");
        put_roff(r->name);
        printf("\\fR");
        if (r->value) {
            printf(" \\fI");
            put_roff(r->value);
            printf("\\fR");
        }
        putchar('\n');
        put_roff(r->help);
        if (r->value && r->given) {
            printf(" [");
            put_roff(r->given);
            putchar(']');
        }
        putchar('\n');
    }
}

void options_print_manual(const struct options *o)
{
    static const char *const programs[] = { "relight-bench", "relight-chart",  "relight-diff",  "relight-feed",
                                            "relightd",      "relight-record", "relight-render" };
    const char *separator = "";

    printf(".TH ");
    put_upper(o->program);
    printf(" 1 \"\" \"relightd %s\" \"User Commands\"\n.nh\n.SH NAME\n%s \\- ", RELIGHT_VERSION, o->program);
    put_summary(o->about);
    printf("\n.SH SYNOPSIS\n.B %s\n", o->program);
    put_roff(o->synopsis);
    printf("\n.SH DESCRIPTION\n");
    put_roff(o->about);
    printf("\n.SH OPTIONS\nA value follows its flag after a blank or an equals sign. Defaults are shown in "
           "brackets.\n");
    put_manual_rows(o->rows);
    put_manual_rows(o->shared);
    printf(".SS \"All programs\"\n.TP\n\\fB\\-\\-help\\fR\nprint this help and exit\n.TP\n\\fB\\-\\-version\\fR\n"
           "print the version and exit\n");
    if (o->epilogue) {
        printf(".SH \"");
        put_upper(o->epilogue_title);
        printf("\"\n.nf\n");
        put_roff_lines(o->epilogue);
        printf(".fi\n");
    }
    printf(".SH \"SEE ALSO\"\n");
    for (size_t i = 0; i < sizeof(programs) / sizeof(programs[0]); i++) {
        if (strcmp(programs[i], o->program) == 0)
            continue;
        printf("%s.BR %s (1)", separator, programs[i]);
        separator = ",\n";
    }
    printf("\n.PP\nThe documents in /usr/share/doc/relightd.\n");
}

/* ---- bash completion ---- */

static void put_flags(const struct option_row *rows)
{
    for (const struct option_row *r = rows; r && r->name; r++)
        if (r->name[0])
            printf(" --%s", r->name);
}

/* The flags whose value is a file or a folder or, with kind NULL, cannot be completed, as a case pattern. */
static int put_pattern(const struct option_row *rows, const char *kind, int count)
{
    for (const struct option_row *r = rows; r && r->name; r++) {
        if (!r->name[0] || !r->value)
            continue;
        const bool path = strcmp(r->value, "FILE") == 0, folder = strcmp(r->value, "DIR") == 0;
        const bool taken = !kind ? !path && !folder : strcmp(r->value, kind) == 0;
        if (taken)
            printf("%s--%s", count++ ? "|" : "", r->name);
    }
    return count;
}

static void put_case(const struct options *o, const char *kind, const char *action)
{
    const int count = put_pattern(o->rows, kind, 0);

    if (put_pattern(o->shared, kind, count) > 0)
        printf(") %s; return ;;\n", action);
    else
        printf("--) ;;\n"); /* a pattern that never matches the previous word */
}

void options_print_completion(const struct options *o)
{
    char name[64];

    snprintf(name, sizeof(name), "_%s", o->program);
    for (char *p = name; *p; p++)
        *p = *p == '-' ? '_' : *p;
    printf("# Completion of %s for bash, made from the table of its flags.\n%s()\n{\n", o->program, name);
    printf("    local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]}\n    COMPREPLY=()\n");
    printf("    if [[ $cur == = ]]; then cur=\n    elif [[ $prev == = ]]; then prev=${COMP_WORDS[COMP_CWORD - 2]}\n"
           "    fi\n    case $prev in\n    ");
    put_case(o, "FILE", "compopt -o filenames; mapfile -t COMPREPLY < <(compgen -f -- \"$cur\")");
    printf("    ");
    put_case(o, "DIR", "compopt -o filenames; mapfile -t COMPREPLY < <(compgen -d -- \"$cur\")");
    printf("    ");
    put_case(o, NULL, "compopt -o default");
    printf("    esac\n    if [[ $cur == -* ]]; then\n        mapfile -t COMPREPLY < <(compgen -W '");
    put_flags(o->rows);
    put_flags(o->shared);
    printf(" --help --version' -- \"$cur\")\n");
    if (o->operand_max > 0)
        printf("    else\n        compopt -o filenames\n        mapfile -t COMPREPLY < <(compgen -f -- \"$cur\")\n");
    printf("    fi\n}\ncomplete -F %s %s\n", name, o->program);
}
