/* The machine, date and build of a measurement, without which times mean nothing. */
#pragma once

struct machine {
    char cpu[128]; /* as the system names it, else "unknown" */
    char date[32]; /* UTC, to the minute */
    int processors, threads;
    const char *level;  /* of the kernels: "v4" */
    const char *commit; /* that the program was built from; "unknown" outside a repository */
    const char *version;
};

/* level: of the kernels in use. Reads /proc/cpuinfo. Any thread. */
void machine_describe(struct machine *m, const char *level);
