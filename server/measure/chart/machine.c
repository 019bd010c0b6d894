#include "measure/chart/machine.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#ifndef RELIGHT_COMMIT
#define RELIGHT_COMMIT "unknown"
#endif

static void read_cpu(char *cpu, size_t size)
{
    FILE *f = fopen("/proc/cpuinfo", "r");
    char line[256];

    snprintf(cpu, size, "unknown");
    while (f && fgets(line, sizeof(line), f)) {
        const char *colon = strchr(line, ':');
        if (strncmp(line, "model name", 10) != 0 || !colon)
            continue;
        line[strcspn(line, "\n")] = '\0';
        snprintf(cpu, size, "%s", colon + 1 + strspn(colon + 1, " "));
        break;
    }
    if (f)
        fclose(f);
}

void machine_describe(struct machine *m, const char *level)
{
    const time_t now = time(NULL);
    struct tm utc;

    *m = (struct machine){
        .processors = omp_get_num_procs(),
        .threads = omp_get_max_threads(),
        .level = level,
        .commit = RELIGHT_COMMIT,
        .version = RELIGHT_VERSION,
    };
    read_cpu(m->cpu, sizeof(m->cpu));
    if (!gmtime_r(&now, &utc) || strftime(m->date, sizeof(m->date), "%Y-%m-%d %H:%M UTC", &utc) == 0)
        snprintf(m->date, sizeof(m->date), "unknown");
}
