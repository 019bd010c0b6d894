#include "year/paint.h"

#include "base/file_store.h"
#include "base/mem.h"
#include "image/codec/jpeg.h"
#include "image/film/false_colour.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const uint8_t black[3] = { 20, 20, 20 };

enum err canvas_init(struct canvas *c, uint32_t width, uint32_t height)
{
    c->width = width;
    c->height = height;
    c->rgb = mem_alloc((size_t)width * height, 3);
    if (!c->rgb)
        return ERR_NOMEM;
    memset(c->rgb, 255, (size_t)width * height * 3);
    return ERR_OK;
}

void canvas_finish(struct canvas *c)
{
    mem_free(c->rgb);
    *c = (struct canvas){ .width = 0 };
}

void paint_box(struct canvas *c, int x, int y, int width, int height, const uint8_t rgb[3])
{
    const int right = x + width < (int)c->width ? x + width : (int)c->width;
    const int bottom = y + height < (int)c->height ? y + height : (int)c->height;

    for (int j = y > 0 ? y : 0; j < bottom; j++)
        for (int i = x > 0 ? x : 0; i < right; i++)
            memcpy(c->rgb + 3 * ((size_t)j * c->width + (size_t)i), rgb, 3);
}

/* Letters of 3 x 5 dots, rows from the top, three bits each. */
#define ROWS(a, b, c, d, e) (uint16_t)((a) << 12 | (b) << 9 | (c) << 6 | (d) << 3 | (e))
static const struct {
    char letter;
    uint16_t rows;
} letters[] = {
    { '0', ROWS(7, 5, 5, 5, 7) }, { '1', ROWS(2, 6, 2, 2, 7) }, { '2', ROWS(7, 1, 7, 4, 7) },
    { '3', ROWS(7, 1, 3, 1, 7) }, { '4', ROWS(5, 5, 7, 1, 1) }, { '5', ROWS(7, 4, 7, 1, 7) },
    { '6', ROWS(7, 4, 7, 5, 7) }, { '7', ROWS(7, 1, 1, 2, 2) }, { '8', ROWS(7, 5, 7, 5, 7) },
    { '9', ROWS(7, 5, 7, 1, 7) }, { '.', ROWS(0, 0, 0, 0, 2) }, { ',', ROWS(0, 0, 0, 2, 4) },
    { ':', ROWS(0, 2, 0, 2, 0) }, { '-', ROWS(0, 0, 7, 0, 0) }, { '/', ROWS(1, 1, 2, 4, 4) },
    { '%', ROWS(5, 1, 2, 4, 5) }, { '=', ROWS(0, 7, 0, 7, 0) }, { '>', ROWS(4, 2, 1, 2, 4) },
    { 'A', ROWS(2, 5, 7, 5, 5) }, { 'B', ROWS(6, 5, 6, 5, 6) }, { 'C', ROWS(3, 4, 4, 4, 3) },
    { 'D', ROWS(6, 5, 5, 5, 6) }, { 'E', ROWS(7, 4, 6, 4, 7) }, { 'F', ROWS(7, 4, 6, 4, 4) },
    { 'G', ROWS(3, 4, 5, 5, 3) }, { 'H', ROWS(5, 5, 7, 5, 5) }, { 'I', ROWS(7, 2, 2, 2, 7) },
    { 'J', ROWS(1, 1, 1, 5, 2) }, { 'K', ROWS(5, 5, 6, 5, 5) }, { 'L', ROWS(4, 4, 4, 4, 7) },
    { 'M', ROWS(5, 7, 7, 5, 5) }, { 'N', ROWS(6, 5, 5, 5, 5) }, { 'O', ROWS(2, 5, 5, 5, 2) },
    { 'P', ROWS(6, 5, 6, 4, 4) }, { 'Q', ROWS(2, 5, 5, 6, 3) }, { 'R', ROWS(6, 5, 6, 5, 5) },
    { 'S', ROWS(3, 4, 2, 1, 6) }, { 'T', ROWS(7, 2, 2, 2, 2) }, { 'U', ROWS(5, 5, 5, 5, 7) },
    { 'V', ROWS(5, 5, 5, 5, 2) }, { 'W', ROWS(5, 5, 7, 7, 5) }, { 'X', ROWS(5, 5, 2, 5, 5) },
    { 'Y', ROWS(5, 5, 2, 2, 2) }, { 'Z', ROWS(7, 1, 2, 4, 7) },
};

static uint16_t rows_of(char letter)
{
    const char capital = (char)toupper((unsigned char)letter);

    for (size_t k = 0; k < sizeof(letters) / sizeof(letters[0]); k++)
        if (letters[k].letter == capital)
            return letters[k].rows;
    return 0;
}

void paint_text(struct canvas *c, int x, int y, int scale, const char *text, const uint8_t rgb[3])
{
    for (; *text; text++, x += 4 * scale)
        for (int j = 0; j < 5; j++)
            for (int i = 0; i < 3; i++)
                if (rows_of(*text) >> (3 * (4 - j) + 2 - i) & 1)
                    paint_box(c, x + i * scale, y + j * scale, scale, scale, rgb);
}

int paint_text_width(const char *text, int scale)
{
    return 4 * scale * (int)strlen(text) - scale;
}

double paint_share(const struct paint_scale *s, double value)
{
    if (isnan(value))
        return NAN;
    if (!s->logarithmic)
        return fmin(1.0, fmax(0.0, (value - s->least) / (s->most - s->least)));
    return fmin(1.0, fmax(0.0, log(fmax(value, s->least) / s->least) / log(s->most / s->least)));
}

int paint_steps(const struct paint_scale *s)
{
    return s->logarithmic ? 6 : 5;
}

double paint_round_up(double v)
{
    const double power = pow(10.0, floor(log10(v) + 1e-9)), first = v / power;
    return power * (first <= 1.0 + 1e-9 ? 1.0 : first <= 2.0 + 1e-9 ? 2.0 : first <= 5.0 + 1e-9 ? 5.0 : 10.0);
}

static void label(double v, char *out, size_t size)
{
    const bool thousands = v >= 999.5;

    snprintf(out, size, "%.3g%s", thousands ? v / 1000.0 : v, thousands ? "k" : "");
}

void paint_legend(struct canvas *c, int x, int y, int height, const struct paint_scale *s)
{
    const int top = y + 16, length = height - 26;
    char text[32];
    uint8_t rgb[3];

    paint_text(c, x + 8, y, 2, s->unit, black);
    for (int j = 0; j < length; j++) {
        false_colour(1.0 - (j + 0.5) / length, rgb);
        paint_box(c, x + 8, top + j, 18, 1, rgb);
    }
    const int steps = paint_steps(s);
    for (int k = 0; k <= steps; k++) {
        const double share = (double)k / steps;
        const double v =
            s->logarithmic ? s->least * pow(s->most / s->least, share) : s->least + share * (s->most - s->least);
        const int at = top + (int)((1.0 - share) * (length - 1));
        label(v, text, sizeof(text));
        paint_box(c, x + 26, at, 5, 1, black);
        paint_text(c, x + 35, at - 4, 2, text, black);
    }
}

enum err canvas_write(const struct canvas *c, const char *path, struct reason *why)
{
    const struct png_desc d = { .samples = c->rgb, .width = c->width, .height = c->height };
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum err e = png_encode(&d, &bytes, &size, why);

    if (!e)
        e = file_store(path, bytes, size, why);
    mem_free(bytes);
    return e;
}
