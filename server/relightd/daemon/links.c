#include "relightd/daemon/config.h"

#include "net/access/qr.h"
#include "net/access/site.h"

#include <ctype.h>
#include <string.h>

#define TEXT 1024 /* a token of 255 bytes and a name, percent-encoded */

struct links {
    const struct server_desc *desc;
    FILE *out;
    bool codes, tls;
    char place[300]; /* "192.168.1.20:8080" */
};

/* As encodeURIComponent of browsers. */
static const char *encode(const char *text, char out[TEXT])
{
    size_t n = 0;

    for (; *text && n + 4 < TEXT; text++) {
        const unsigned char c = (unsigned char)*text;
        if (isalnum(c) || strchr("-_.~", c))
            out[n++] = *text;
        else
            n += (size_t)snprintf(out + n, 4, "%%%02X", c);
    }
    out[n] = '\0';
    return out;
}

/* For a POSIX shell, in quotes. */
static void print_quoted(FILE *out, const char *text)
{
    fputc('\'', out);
    for (; *text; text++)
        *text == '\'' ? fputs("'\\''", out) : fputc(*text, out);
    fputc('\'', out);
}

static void set_place(struct links *l, const char *host, uint16_t port)
{
    const char *open = strchr(host, ':') ? "[" : "", *close = open[0] ? "]" : "";

    if (port == (l->tls ? 443 : 80))
        snprintf(l->place, sizeof(l->place), "%s%s%s", open, host, close);
    else
        snprintf(l->place, sizeof(l->place), "%s%s%s:%u", open, host, close, port);
}

/* The first public name; else the address that it listens on, or one of this machine's if that is all of them. */
static void find_place(struct links *l)
{
    const struct server_desc *d = l->desc;
    const char *bind = d->address && d->address[0] ? d->address : "127.0.0.1";
    char found[ADDRESSES_MAX][ADDRESS_TEXT], name[256];

    if (d->public_names && d->public_names[0]) {
        snprintf(name, sizeof(name), "%.*s", (int)strcspn(d->public_names, ","), d->public_names);
        set_place(l, name, d->behind_proxy ? 443 : d->port);
        return;
    }
    const bool all = strcmp(bind, "0.0.0.0") == 0 || strcmp(bind, "::") == 0;
    set_place(l, all && addresses_of_machine(found) > 0 ? found[0] : bind, d->port);
}

void links_page(const struct server_desc *desc, uint16_t port, char *out, size_t size)
{
    struct server_desc with_port = *desc;
    struct links l = { .desc = &with_port, .tls = desc->tls_cert || (desc->behind_proxy && desc->public_names) };

    with_port.port = port;
    find_place(&l);
    snprintf(out, size, "http%s://%s/", l.tls ? "s" : "", l.place);
}

static void print_page(const struct links *l, const char *role, const char *token)
{
    char encoded[TEXT], link[2 * TEXT];

    snprintf(link, sizeof(link), "http%s://%s/#role=%s%s%s", l->tls ? "s" : "", l->place, role, token ? "&token=" : "",
             token ? encode(token, encoded) : "");
    fprintf(l->out, "%-12s%s\n", role, link);
    if (l->codes)
        qr_print(l->out, link);
}

static void print_command(const struct links *l, const char *role, const char *token, const char *command)
{
    fprintf(l->out, "%-12s", role);
    if (token) {
        fputs("RELIGHT_TOKEN=", l->out);
        print_quoted(l->out, token);
        fputc(' ', l->out);
    }
    fprintf(l->out, command, l->tls ? "wss" : "ws", l->place);
    fputc('\n', l->out);
}

enum err links_print(const struct server_desc *desc, FILE *out, bool codes, struct reason *why)
{
    struct links l = { .desc = desc, .out = out, .codes = codes && qr_available() };
    const char *const *tokens = desc->tokens;
    char encoded[TEXT];

    l.tls = desc->tls_cert || (desc->behind_proxy && desc->public_names);
    if (desc->port == 0)
        return err_say(why, ERR_USAGE,
                       "--show-link: --port 0 takes any free port, so the link is unknown before the start");
    find_place(&l);
    print_page(&l, "viewer", tokens[SERVER_VIEWER]);
    const bool loopback = !desc->allow_remote;
    if (tokens[SERVER_CONTROLLER] || loopback)
        print_page(&l, "controller", tokens[SERVER_CONTROLLER]);
    fprintf(out, "%-12shttp%s://%s%s%s%s/snapshot.jpg\n", "image", l.tls ? "s" : "",
            tokens[SERVER_VIEWER] ? "viewer:" : "", tokens[SERVER_VIEWER] ? encode(tokens[SERVER_VIEWER], encoded) : "",
            tokens[SERVER_VIEWER] ? "@" : "", l.place);
    if (desc->push) {
        print_command(&l, "producer", tokens[SERVER_PRODUCER], "relight-feed --to %s://%s SOURCE");
        if (tokens[SERVER_RECORDER] || loopback)
            print_command(&l, "recorder", tokens[SERVER_RECORDER],
                          "relight-record --from %s://%s --recorder NAME --out PATTERN");
    }
    if (codes && !qr_available())
        fputs("no QR codes: this relightd was built without libqrencode\n", out);
    return ERR_OK;
}
