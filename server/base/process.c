#include "base/process.h"

#include "base/clock.h"
#include "base/log.h"

#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

enum { FILES_ELSEWHERE = 24 }; /* descriptors that the rest of the program uses */

/* /proc/self/stat holds the program's name in parentheses. The name may contain any character, so fields are counted
 * from the last parenthesis [proc(5)]. */
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
    /* In ticks since boot; converting to calendar time here would step with the calendar. */
    const double age_s = clock_boot_seconds() - (double)started / (double)sysconf(_SC_CLK_TCK);
    out->started_s = 1e-6 * (double)clock_wall_us() - age_s;
}

static int64_t count_files(void)
{
    int64_t count = -3; /* excludes ".", ".." and the descriptor that reads the folder */
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
        out->max_files = files.rlim_cur == RLIM_INFINITY ? 0 : (int64_t)files.rlim_cur;
}

uint32_t process_connections_allowed(uint32_t wanted)
{
    struct rlimit files;

    if (getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur >= wanted + FILES_ELSEWHERE)
        return wanted;
    const uint32_t left =
        files.rlim_cur > 2 * FILES_ELSEWHERE ? (uint32_t)files.rlim_cur - FILES_ELSEWHERE : FILES_ELSEWHERE;
    log_warning("the limit of %u file descriptors leaves %u for connections", (unsigned)files.rlim_cur, left);
    return left;
}
