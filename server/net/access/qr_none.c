#include "net/access/qr.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* nothing is done with them */

bool qr_available(void)
{
    return false;
}

bool qr_print(FILE *out, const char *text)
{
    return false;
}
