/* The helper process's side of the socket (wire.h). Thread: main. */
#pragma once

#include <stdbool.h>
#include <stddef.h>

/* Prints that the program is not for users, who started it without the arguments that it needs: `purpose` is what other
 * programs start it for. Returns the exit code. */
int helper_refuse(int argc, char **argv, const char *purpose);

/* Says hello after the process has been confined, with errno of the attempt or 0; and waits for, and sends, one
 * message. False: the parent is gone or has sent something else. */
bool helper_hello(int unconfined);
bool helper_receive(void *message, size_t size);
bool helper_send(const void *message, size_t size);
