/* Prints QR codes in a terminal. Thread: any. */
#pragma once

#include <stdbool.h>
#include <stdio.h>

/* Whether this build can: it needs libqrencode. */
bool qr_available(void);

/* Prints the code of a text in UTF-8 half blocks, two modules a character, black on white whatever the terminal's
 * colours are. False: not available, or the text is too long. */
bool qr_print(FILE *out, const char *text);
