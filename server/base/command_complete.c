/* Shell completions from the table of flags: names, files, folders, and the words that a choice takes. */
#include "base/command.h"
#include "base/setting.h"

#include <stdio.h>
#include <string.h>

enum kind { NOTHING, ANY, FILES, FOLDERS, WORDS }; /* what follows a flag; NOTHING: it is a switch */

static enum kind kind_of(const struct setting *s)
{
    if (!s->unit)
        return NOTHING;
    if ((s->type == SETTING_CHOICE && s->choices) || s->type == SETTING_KEYS)
        return WORDS;
    return strcmp(s->unit, "FILE") == 0 ? FILES : strcmp(s->unit, "DIR") == 0 ? FOLDERS : ANY;
}

/* Keys of --tune, old names of which count as flags, are offered there alone. */
static bool is_offered(const struct command *c, const struct setting *s)
{
    return command_offers(c, s) && s->level != SETTING_TUNE;
}

static void put_words(const struct command *c, const struct setting *s)
{
    for (const struct setting_choice *x = s->choices; x && x->name; x++)
        if (choice_has(x->programs, c->program))
            printf("%s ", x->name);
    for (size_t k = 0; k < c->flag_count && s->type == SETTING_KEYS; k++)
        if (c->flags[k].row->level == SETTING_TUNE)
            printf("%s%s ", c->flags[k].row->name, c->flags[k].row->unit ? "=" : "");
    printf("help");
}

/* Text within single quotes, without the characters that `unsafe` names. */
static void put_quoted(const char *text, const char *unsafe)
{
    for (; *text; text++) {
        if (*text == '\'')
            printf("'\\''");
        else if (strchr(unsafe, *text))
            printf("\\%c", *text);
        else
            putchar(*text == '\n' ? ' ' : *text);
    }
}

static void put_help(const struct command *c, const struct setting *s, const char *unsafe)
{
    put_quoted(s->help, unsafe);
    put_quoted(command_also(c, s), unsafe);
}

/* ---- bash ---- */

/* The flags of one kind, as a case pattern with what completes their values. */
static void put_case(const struct command *c, enum kind kind, const char *action)
{
    size_t count = 0;

    for (size_t k = 0; k < c->flag_count; k++)
        if (kind_of(c->flags[k].row) == kind && is_offered(c, c->flags[k].row))
            printf("%s--%s", count++ ? "|" : "    ", c->flags[k].row->name);
    if (count)
        printf(") %s; return ;;\n", action);
}

static void print_bash(const struct command *c)
{
    char name[64];

    snprintf(name, sizeof(name), "_%s", c->name);
    for (char *p = name; *p; p++)
        *p = *p == '-' ? '_' : *p;
    printf("# Completion of %s for bash, made from the table of its flags.\n%s()\n{\n", c->name, name);
    printf("    local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]}\n    COMPREPLY=()\n");
    printf("    if [[ $cur == = ]]; then cur=\n    elif [[ $prev == = ]]; then prev=${COMP_WORDS[COMP_CWORD - 2]}\n"
           "    fi\n    case $prev in\n");
    put_case(c, FILES, "compopt -o filenames; mapfile -t COMPREPLY < <(compgen -f -- \"$cur\")");
    put_case(c, FOLDERS, "compopt -o filenames; mapfile -t COMPREPLY < <(compgen -d -- \"$cur\")");
    put_case(c, ANY, "compopt -o default");
    for (size_t k = 0; k < c->flag_count; k++) {
        if (kind_of(c->flags[k].row) != WORDS || !is_offered(c, c->flags[k].row))
            continue;
        printf("    --%s) %smapfile -t COMPREPLY < <(compgen -W '", c->flags[k].row->name,
               c->flags[k].row->type == SETTING_KEYS ? "compopt -o nospace; " : "");
        put_words(c, c->flags[k].row);
        printf("' -- \"$cur\"); return ;;\n");
    }
    printf("    esac\n    if [[ $cur == -* ]]; then\n        mapfile -t COMPREPLY < <(compgen -W '");
    for (size_t k = 0; k < c->flag_count; k++)
        if (is_offered(c, c->flags[k].row))
            printf(" --%s", c->flags[k].row->name);
    printf(" --help --version' -- \"$cur\")\n");
    if (c->operand_max > 0)
        printf("    else\n        compopt -o filenames\n        mapfile -t COMPREPLY < <(compgen -f -- \"$cur\")\n");
    printf("    fi\n}\ncomplete -F %s %s\n", name, c->name);
}

/* ---- zsh ---- */

static void print_zsh(const struct command *c)
{
    printf("#compdef %s\n# Completion for zsh, made from the table of flags.\n_arguments -s \\\n", c->name);
    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *s = c->flags[k].row;
        const enum kind kind = kind_of(s);
        if (!is_offered(c, s))
            continue;
        printf("    '%s--%s%s[", s->type == SETTING_TEXTS || s->type == SETTING_KEYS ? "*" : "", s->name,
               kind == NOTHING ? "" : "=");
        put_help(c, s, "[]\\");
        printf("]");
        if (kind != NOTHING) {
            printf(":");
            put_quoted(s->unit, ":\\");
            printf(":%s", kind == FILES ? "_files" : kind == FOLDERS ? "_files -/" : kind == WORDS ? "(" : " ");
        }
        if (kind == WORDS) {
            put_words(c, s);
            printf(")");
        }
        printf("' \\\n");
    }
    printf("    '--help[print help and exit]' '--version[print the version and exit]'%s\n",
           c->operand_max > 0 ? " '*:file:_files'" : "");
}

/* ---- fish ---- */

static void print_fish(const struct command *c)
{
    printf("# Completion of %s for fish, made from the table of its flags.\n", c->name);
    if (c->operand_max == 0)
        printf("complete -c %s -f\n", c->name);
    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *s = c->flags[k].row;
        if (!is_offered(c, s))
            continue;
        printf("complete -c %s -l %s -d '", c->name, s->name);
        put_help(c, s, "\\");
        printf("'");
        switch (kind_of(s)) {
        case NOTHING: break;
        case ANY: printf(" -x"); break;
        case FILES: printf(" -rF"); break;
        case FOLDERS: printf(" -xa '(__fish_complete_directories)'"); break;
        case WORDS:
            printf(" -xa '");
            put_words(c, s);
            printf("'");
        }
        printf("\n");
    }
    printf("complete -c %s -l help -d 'print help and exit'\n", c->name);
    printf("complete -c %s -l version -d 'print the version and exit'\n", c->name);
}

bool command_print_completion(const struct command *c, const char *shell)
{
    if (strcmp(shell, "bash") == 0)
        print_bash(c);
    else if (strcmp(shell, "zsh") == 0)
        print_zsh(c);
    else if (strcmp(shell, "fish") == 0)
        print_fish(c);
    else
        return false;
    return true;
}
