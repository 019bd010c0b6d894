/* Publishes a moving pattern whose every pixel is known, to verify a browser's canvas without rendering. Commands on
 * standard input: "go", "stop" (images), "state waiting|live|paused|ended", "fail REASON", "size WxH", "passes N"
 * (of a still image; 0: none), "done" (converged), "dump FILE" (the last image as drawn, then as decoded by
 * libjpeg-turbo, both RGB); it exits on "quit", end of input, SIGTERM or SIGINT. */
#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/setting_table.h"
#include "image/video/h264.h"
#include "net/stream/server.h"

#include <turbojpeg.h>

#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static volatile sig_atomic_t ended;

static void end(int signal_number)
{
    (void)signal_number;
    ended = 1;
}

struct pattern {
    struct server *server;
    tjhandle jpeg, back;
    struct h264_encoder *h264; /* NULL: not offered */
    double key_s;              /* time of the last keyframe */
    uint8_t *rgb, *decoded;
    bool rough; /* every pixel differs from the next */
    uint64_t passes;
    bool done;
    uint32_t width, height;
    uint64_t frame;
    double fps;
    int quality;
    bool going;
    struct protocol_picture last;
    enum server_source source;
    char detail[256];
};

/* Four different quarters, so that flips and swapped channels are detected; a white bar that moves 8 pixels per
 * frame; along the bottom the frame number in 16 cells of 16 x 16, least significant first, white is 1. */
static void draw(struct pattern *p)
{
    static const uint8_t quarters[4][3] = { { 200, 40, 40 }, { 40, 170, 60 }, { 50, 70, 200 }, { 220, 190, 40 } };
    const uint32_t bar = (uint32_t)(p->frame * 8 % p->width);

    for (uint32_t y = 0; y < p->height; y++) {
        for (uint32_t x = 0; x < p->width; x++) {
            uint8_t *out = p->rgb + ((size_t)y * p->width + x) * 3;
            const int q = (y >= p->height / 2) * 2 + (x >= p->width / 2);
            memcpy(out, quarters[q], 3);
            if ((x + p->width - bar) % p->width < 16)
                memset(out, 255, 3);
            if (p->rough) /* as noisy as an image of few samples, and static */
                for (int c = 0; c < 3; c++)
                    out[c] = (uint8_t)(out[c] + (x * 7919u + y * 104729u + (unsigned)c * 31u) % 29u - 14u);
            if (y >= p->height - 16 && x < 256)
                memset(out, p->frame >> x / 16 & 1 ? 255 : 0, 3);
        }
    }
}

static int publish_bytes(struct pattern *p, const struct protocol_picture *header, const uint8_t *bytes, size_t size)
{
    struct sent_image *image = image_create(header, bytes, size);

    if (!image)
        return -1;
    server_publish(p->server, image);
    return 0;
}

/* Publishes the drawn frame as H.264 if watched: only at full size and rate. */
static int publish_h264(struct pattern *p, struct protocol_picture header, bool again)
{
    struct server_demand demand;
    struct h264_output out;

    server_demand(p->server, &demand);
    const bool key = demand.h264_keys & 1 && clock_seconds() - p->key_s >= 0.25;
    if (!p->h264 || !(demand.h264 & 1) || (again && !key))
        return 0;
    const double begun = clock_seconds();
    const struct h264_desc desc = {
        .width = p->width, .height = p->height, .quality = p->quality, .time_us = (int64_t)(1e6 * begun), .key = key
    };
    if (h264_encode(p->h264, p->rgb, &desc, &out))
        return -1;
    if (out.key)
        p->key_s = clock_seconds();
    header.format = PROTOCOL_H264;
    header.flags |= (out.key ? PROTOCOL_PICTURE_KEY : 0) | (again ? PROTOCOL_PICTURE_REPEAT : 0);
    header.encoded_us = (uint32_t)((clock_seconds() - begun) * 1e6);
    return publish_bytes(p, &header, out.bytes, out.size);
}

/* Writes what decoders should make of the last JPEG, beside its source. */
static void dump(struct pattern *p, const char *path)
{
    const size_t size = (size_t)p->width * p->height * 3;
    FILE *out = fopen(path, "wb");

    if (!out || fwrite(p->rgb, 1, size, out) != size || fwrite(p->decoded, 1, size, out) != size || fclose(out))
        log_error("%s cannot be written", path);
    else
        log_info("dumped frame %llu", (unsigned long long)(p->frame - 1));
}

static int publish(struct pattern *p)
{
    unsigned char *bytes = NULL;
    unsigned long size = 0;
    const int64_t captured = clock_wall_us();
    const double begun = clock_seconds();

    draw(p);
    const double drawn = clock_seconds();
    if (tjCompress2(p->jpeg, p->rgb, (int)p->width, 0, (int)p->height, TJPF_RGB, &bytes, &size,
                    p->quality >= 90 ? TJSAMP_444 : TJSAMP_420, p->quality, TJFLAG_ACCURATEDCT) != 0 ||
        tjDecompress2(p->back, bytes, size, p->decoded, (int)p->width, 0, (int)p->height, TJPF_RGB,
                      TJFLAG_ACCURATEDCT) != 0) {
        log_error("%s", tjGetErrorStr2(p->jpeg));
        return -1;
    }
    const struct protocol_picture header = {
        .format = PROTOCOL_JPEG,
        .frame = p->frame,
        .capture_us = captured,
        .queued_us = 400,
        .decoded_us = 1500,
        .shaded_us = (uint32_t)((drawn - begun) * 1e6),
        .encoded_us = (uint32_t)((clock_seconds() - drawn) * 1e6),
        .width = p->width,
        .height = p->height,
        .gain = 1.0f,
        .samples = 64,
    };
    int failed = publish_h264(p, header, false); /* first: its own time should not include the other's */
    if (!failed)
        failed = publish_bytes(p, &header, bytes, size);
    tjFree(bytes);
    p->last = header;
    p->frame++;
    return failed;
}

static void tell(const struct pattern *p)
{
    struct server_figures figures = {
        .scene = "a test pattern",
        .sky = "no sky at all",
        .method = "mis",
        .samples = 64,
        .width = p->width,
        .height = p->height,
        .source = p->source,
        .frame = p->frame,
        .fps = p->going ? p->fps : 0.0,
        .queued_ms = 0.4,
        .decoded_ms = 1.5,
        .shaded_ms = 12.0,
        .encoded_ms = 0.7,
        .received = p->frame,
        .used = p->frame,
        .refused = p->source == SERVER_FAILED,
        .has_sun = true,
        .sun_elevation = 40.0 * sin((double)p->frame * 0.01),
        .sun_azimuth = fmod((double)p->frame * 0.5, 360.0),
        .sky_time = "14:35",
        .paths = "none at all",
        .passes = p->passes,
        .converged = p->done,
    };
    snprintf(figures.detail, sizeof(figures.detail), "%s", p->detail);
    snprintf(figures.last_refusal, sizeof(figures.last_refusal), "%s", p->source == SERVER_FAILED ? p->detail : "");
    server_set_figures(p->server, &figures);
}

static int resize(struct pattern *p, uint32_t width, uint32_t height)
{
    mem_free(p->rgb);
    mem_free(p->decoded);
    p->rgb = mem_alloc((size_t)width * height, 3);
    p->decoded = mem_alloc((size_t)width * height, 3);
    p->width = width;
    p->height = height;
    p->last.width = 0; /* there is no image of this size yet */
    return p->rgb && p->decoded ? 0 : -1;
}

static void obey(struct pattern *p, char *line)
{
    static const char *const states[] = { "waiting", "live", "paused", "ended" };
    unsigned width, height;

    line[strcspn(line, "\n")] = 0;
    if (strcmp(line, "go") == 0 || strcmp(line, "stop") == 0) {
        p->going = line[0] == 'g';
    } else if (strncmp(line, "fail ", 5) == 0) {
        p->source = SERVER_FAILED;
        snprintf(p->detail, sizeof(p->detail), "%s", line + 5);
    } else if (sscanf(line, "size %ux%u", &width, &height) == 2 && width && height && width <= 4096 && height <= 4096) {
        if (resize(p, width, height))
            ended = 1;
    } else if (strncmp(line, "passes ", 7) == 0) {
        p->passes = strtoull(line + 7, NULL, 10);
        p->done = false;
    } else if (strcmp(line, "done") == 0) {
        p->done = true;
    } else if (strncmp(line, "dump ", 5) == 0) {
        dump(p, line + 5);
    } else if (strcmp(line, "quit") == 0) {
        ended = 1;
    }
    for (size_t i = 0; strncmp(line, "state ", 6) == 0 && i < sizeof(states) / sizeof(states[0]); i++) {
        if (strncmp(line + 6, states[i], strlen(states[i])) == 0) {
            p->source = (enum server_source)i;
            p->detail[0] = 0;
        }
    }
    tell(p);
}

/* Reads commands from standard input until the next image is due. */
static void attend(struct pattern *p, double until)
{
    char line[256];

    while (!ended) {
        const double left = until - clock_seconds();
        struct pollfd in = { .fd = STDIN_FILENO, .events = POLLIN };
        if (poll(&in, 1, left > 0.0 ? (int)ceil(left * 1000.0) : 0) > 0) {
            if (!fgets(line, sizeof(line), stdin))
                ended = 1;
            else
                obey(p, line);
        } else if (left <= 0.0) {
            return; /* not before all commands are read, even where every image is late */
        }
    }
}

static enum err run(struct pattern *p)
{
    double due = clock_seconds(), told = 0.0;

    while (!ended) {
        if (p->going ? publish(p) : p->last.width > 0 && publish_h264(p, p->last, true))
            return ERR_NOMEM;
        if (clock_seconds() - told > 0.25) {
            told = clock_seconds();
            tell(p);
        }
        due += 1.0 / p->fps;
        if (due < clock_seconds())
            due = clock_seconds();
        attend(p, due);
    }
    return ERR_OK;
}

struct flags {
    uint16_t port;
    uint32_t quality, size[2];
    double fps;
    bool quiet, rough, h264;
};

#define ALL .section = "Flags"
#define AT(field) SETTING_AT(flags, field)

static const struct setting rows[] = {
    { "port", "P", "the port; 0 takes any free one", "0", ALL, WHOLE(0, 65535), AT(port) },
    { "fps", "N", "pictures a second", "12", ALL, REAL(0.1, 1000.0), AT(fps) },
    { "size", "WxH", "their size", "320x180", ALL, .type = SETTING_SIZE, AT(size) },
    { "quality", "Q", "of the JPEG", "95", ALL, WHOLE(1, 100), AT(quality) },
    { "quiet", NULL, "publishes nothing until told to", NULL, ALL, SWITCH, AT(quiet) },
    { "rough", NULL, "an image with grain", NULL, ALL, SWITCH, AT(rough) },
    { "h264", NULL, "offers H.264 too, where it is built in", NULL, ALL, SWITCH, AT(h264) },
    { .name = NULL },
};

int main(int argc, char **argv)
{
    struct flags f;
    struct command command = {
        .name = "pattern_server", .synopsis = "[--port P]", .about = "A test.", .lists = { { rows, &f } }
    };
    struct pattern p = { .going = true, .source = SERVER_LIVE };
    struct reason why = { { 0 } };
    bool done = false;
    const struct sigaction action = { .sa_handler = end };

    log_init("pattern_server", LOG_DEBUG);
    setvbuf(stdin, NULL, _IONBF, 0); /* poll must see what fgets has not read */
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    command_begin(&command);
    enum err e = command_parse(&command, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = command_read(&command, &why);
    if (e)
        goto failed;
    p.fps = f.fps;
    p.quality = (int)f.quality;
    p.jpeg = tjInitCompress();
    p.back = tjInitDecompress();
    p.rough = f.rough;
    p.h264 = f.h264 ? h264_encoder_create() : NULL;
    if (f.quiet) {
        p.going = false;
        p.source = SERVER_WAITING;
    }
    if (!p.jpeg || !p.back || resize(&p, f.size[0], f.size[1])) {
        e = err_say(&why, ERR_NOMEM, "out of memory");
        goto failed;
    }
    const struct server_desc desc = { .port = f.port, .h264 = p.h264 != NULL };
    e = server_create(&desc, &p.server, &why);
    if (e)
        goto failed;
    tell(&p);
    log_info("listening on %s", server_url(p.server));
    e = run(&p);
failed:
    if (e)
        log_error("%s", why.text);
    server_destroy(p.server);
    if (p.jpeg)
        tjDestroy(p.jpeg);
    if (p.back)
        tjDestroy(p.back);
    h264_encoder_destroy(p.h264);
    mem_free(p.rgb);
    mem_free(p.decoded);
    return err_exit_code(e);
}
