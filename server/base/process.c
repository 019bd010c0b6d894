#include "process.h"

#include "clock.h"
#include "log.h"

#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

enum { FILES_ELSEWHERE = 24 }; /* files, pipes and threads of the rest of the program */

/* /proc/self/stat has the program's name in brackets, which may hold anything but does not end the line: fields are
 * counted from the last bracket [proc(5)]. */
static void read_stat(struct process_usage *out)
{
    char text[1024];
    unsigned long long started, bytes;
    long pages, threads;
    FILE *in = fopen("/proc/self/stat", "re");

    if (!in)
        return;
    const size_t size = fread(text, 1, sizeof(text) - 1, in);
    fclose(in);
    text[size] = '\0';
    const char *after = strrchr(text, ')');
    if (!after ||
        sscanf(after + 1, " %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %*u %*u %*d %*d %*d %*d %ld %*d %llu %llu %ld",
               &threads, &started, &bytes, &pages) != 4)
        return;
    out->threads = threads;
    out->virtual_bytes = (int64_t)bytes;
    out->resident_bytes = (int64_t)pages * sysconf(_SC_PAGESIZE);
    /* Since the machine began, in ticks; what the calendar says of that moment steps with the calendar. */
    const double age_s = clock_boot_seconds() - (double)started / (double)sysconf(_SC_CLK_TCK);
    out->started_s = 1e-6 * (double)clock_wall_us() - age_s;
}

static int64_t count_files(void)
{
    int64_t count = -3; /* ".", "..", and the folder itself, which is open for this */
    DIR *folder = opendir("/proc/self/fd");

    if (!folder)
        return -1;
    while (readdir(folder))
        count++;
    closedir(folder);
    return count;
}

void process_usage(struct process_usage *out)
{
    struct rlimit files;

    *out = (struct process_usage){ -1, -1, -1, -1, -1, clock_processor(), -1.0 };
    read_stat(out);
    out->open_files = count_files();
    if (getrlimit(RLIMIT_NOFILE, &files) == 0)
        out->most_files = files.rlim_cur == RLIM_INFINITY ? 0 : (int64_t)files.rlim_cur;
}

uint32_t process_files(uint32_t wanted)
{
    struct rlimit files;

    if (getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur >= wanted + FILES_ELSEWHERE)
        return wanted;
    const uint32_t left =
        files.rlim_cur > 2 * FILES_ELSEWHERE ? (uint32_t)files.rlim_cur - FILES_ELSEWHERE : FILES_ELSEWHERE;
    log_warning("only %u descriptors are allowed: at most %u are for connections", (unsigned)files.rlim_cur, left);
    return left;
}
