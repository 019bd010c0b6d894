#include "net/access/qr.h"

#include <qrencode.h>
#include <stddef.h>

#define MARGIN 4 /* light modules around the code, which scanners need */

bool qr_available(void)
{
    return true;
}

static bool is_dark(const QRcode *code, int x, int y)
{
    return x >= 0 && y >= 0 && x < code->width && y < code->width &&
           code->data[(size_t)y * (size_t)code->width + (size_t)x] & 1;
}

bool qr_print(FILE *out, const char *text)
{
    static const char *const blocks[2][2] = { { " ", "\xe2\x96\x84" },
                                              { "\xe2\x96\x80", "\xe2\x96\x88" } }; /* upper, lower */
    QRcode *code = QRcode_encodeString8bit(text, 0, QR_ECLEVEL_L);

    if (!code)
        return false;
    for (int y = -MARGIN; y < code->width + MARGIN; y += 2) {
        fputs("\033[30;107m", out);
        for (int x = -MARGIN; x < code->width + MARGIN; x++)
            fputs(blocks[is_dark(code, x, y)][is_dark(code, x, y + 1)], out);
        fputs("\033[0m\n", out);
    }
    QRcode_free(code);
    return true;
}
