#include "net/qr.h"

bool qr_available(void)
{
    return false;
}

bool qr_print(FILE *out, const char *text)
{
    (void)out;
    (void)text;
    return false;
}
