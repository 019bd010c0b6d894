/* Runs the linked harness on every file of the given folders, without a fuzzer. */
#include "harness.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>

#define FILE_MOST ((size_t)1 << 20) /* bytes */

static int replay_file(const char *path, uint8_t *bytes)
{
    FILE *f = fopen(path, "rb");

    if (!f) {
        perror(path);
        return 1;
    }
    const size_t size = fread(bytes, 1, FILE_MOST, f);
    const int failed = ferror(f) != 0;
    fclose(f);
    /* a separate allocation, so that a sanitizer detects overruns */
    uint8_t *alone = malloc(size ? size : 1);
    if (failed || !alone) {
        fprintf(stderr, "%s: cannot be read\n", path);
        free(alone);
        return 1;
    }
    for (size_t i = 0; i < size; i++)
        alone[i] = bytes[i];
    printf("%s\n", path);
    fflush(stdout); /* the last line names the failing file */
    LLVMFuzzerTestOneInput(alone, size);
    free(alone);
    return 0;
}

static int replay_folder(const char *folder, uint8_t *bytes)
{
    char path[4096];
    int failed = 0, seen = 0;
    DIR *dir = opendir(folder);

    if (!dir) {
        perror(folder);
        return 1;
    }
    for (struct dirent *d; (d = readdir(dir));) {
        if (d->d_name[0] == '.')
            continue;
        snprintf(path, sizeof(path), "%s/%s", folder, d->d_name);
        failed |= replay_file(path, bytes);
        seen++;
    }
    closedir(dir);
    if (!seen)
        fprintf(stderr, "%s: holds no file\n", folder);
    return failed || !seen;
}

int main(int argc, char **argv)
{
    uint8_t *bytes = malloc(FILE_MOST);
    int failed = argc < 2 || !bytes;

    for (int i = 1; i < argc && bytes; i++)
        failed |= replay_folder(argv[i], bytes);
    free(bytes);
    return failed;
}
