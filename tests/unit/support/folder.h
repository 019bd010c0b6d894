/* An empty folder for one test: set-up and tear-down of cmocka. */
#pragma once

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char folder[40]; /* its path */

static int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/relight-test-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    char command[100];
    (void)state;
    snprintf(command, sizeof(command), "rm -r %s", folder);
    return system(command);
}
