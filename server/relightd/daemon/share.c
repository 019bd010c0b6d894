/* Access from other machines: what --share makes, and warnings about tokens that protect little. */
#include "relightd/daemon/config.h"

#include "base/file_store.h"
#include "base/log.h"
#include "net/access/site.h"

#include <errno.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#define GUESSABLE 16 /* shorter tokens are warned about */

/* ---- The folder of --share ---- */

enum err share_token(const char *dir, const char *name, bool make, char *path, size_t size, struct reason *why)
{
    uint8_t random[16];
    char text[2 * sizeof(random) + 2];

    const enum err e = make ? folder_make_own("--share", dir, why) : ERR_OK;
    if (e)
        return e;
    if ((size_t)snprintf(path, size, "%s/%s", dir, name) >= size)
        return err_say(why, ERR_USAGE, "--share %.200s...: the path is too long", dir);
    if (!make || access(path, F_OK) == 0)
        return ERR_OK;
    if (getrandom(random, sizeof(random), 0) != sizeof(random))
        return err_say(why, ERR_IO, "no random numbers: %s", strerror(errno));
    for (size_t i = 0; i < sizeof(random); i++)
        snprintf(text + 2 * i, 3, "%02x", random[i]);
    strcat(text, "\n");
    const mode_t before = umask(077);
    const enum err stored = file_store(path, text, strlen(text), why);
    umask(before);
    return stored;
}

/* ---- Warnings ---- */

static const char *const what_holders_do[SERVER_ROLES] = {
    [SERVER_VIEWER] = "watch",
    [SERVER_CONTROLLER] = "change settings for everybody",
    [SERVER_PRODUCER] = "send skies",
    [SERVER_RECORDER] = "take the images of lockstep sequences",
};

static void warn_role(const struct server_desc *d, int role)
{
    const char *token = d->tokens[role];

    if (!token)
        return;
    if (strlen(token) < GUESSABLE)
        log_warning(
            "the %ss' token has %zu characters: whoever reaches the port can guess it, and then %s; make one of "
            "%d or more (openssl rand -hex 16), or let --share DIR make them",
            server_role_names[role], strlen(token), what_holders_do[role], GUESSABLE);
    for (int other = 0; other < role; other++)
        if (d->tokens[other] && strcmp(d->tokens[other], token) == 0)
            log_warning("%ss and %ss have the same token: every %s can %s, and every %s can %s; give each role its own",
                        server_role_names[other], server_role_names[role], server_role_names[other],
                        what_holders_do[role], server_role_names[role], what_holders_do[other]);
}

void share_warn(const struct server_desc *d)
{
    if ((!d->address || !d->address[0] || address_is_loopback(d->address)) && !d->behind_proxy)
        return;
    for (int role = 0; role < SERVER_ROLES; role++)
        warn_role(d, role);
    if (!d->tls_cert && !d->behind_proxy)
        log_warning("without TLS everyone on the way can read tokens and images, and browsers show no H.264: use "
                    "--share DIR, --tls-self-signed DIR or --tls-cert");
}
