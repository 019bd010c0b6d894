/* What ranks must have in common: their images would differ otherwise. */
#include "job/ranks/ranks.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Of the running program's file; on an error, of none of it. */
static void digest_program(struct digest *d)
{
    char block[1 << 16];
    FILE *f = fopen("/proc/self/exe", "rb");
    size_t n;

    while (f && (n = fread(block, 1, sizeof(block), f)) > 0)
        digest_bytes(d, block, n);
    if (f)
        fclose(f);
}

void rank_identify(const struct ranks_desc *desc, struct rank_identity *own)
{
    memset(own, 0, sizeof(*own));
    gethostname(own->host, sizeof(own->host) - 1);
    digest_program(&own->program);
    snprintf(own->level, sizeof(own->level), "%s", desc->level);
    for (int k = 1; k < desc->argc; k++)
        digest_bytes(&own->arguments, desc->argv[k], strlen(desc->argv[k]));
}

enum err rank_compare(const struct rank_identity *all, int count, const char *program, struct reason *why)
{
    for (int k = 1; k < count; k++) {
        if (memcmp(&all[k].program, &all[0].program, sizeof(all[0].program)) != 0)
            return err_say(why, ERR_USAGE,
                           "rank 0 on %s and rank %d on %s are different builds of %s, whose images "
                           "may differ: install the same one on all hosts",
                           all[0].host, k, all[k].host, program);
        if (strcmp(all[k].level, all[0].level) != 0)
            return err_say(why, ERR_USAGE,
                           "rank 0 on %s would use CPU level %s and rank %d on %s %s, whose images may differ by "
                           "rounding: add --cpu %s",
                           all[0].host, all[0].level, k, all[k].host, all[k].level,
                           strcmp(all[k].level, all[0].level) < 0 ? all[k].level : all[0].level);
        if (memcmp(&all[k].arguments, &all[0].arguments, sizeof(all[0].arguments)) != 0)
            return err_say(why, ERR_USAGE, "rank %d has other flags than rank 0: give all ranks the same", k);
    }
    return ERR_OK;
}
