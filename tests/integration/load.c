/* relightd under load: one producer at up to 30 frames per second and 50 viewers, ten of which read a tenth of the
 * images. One single-threaded program plays all of them over plain sockets, and observes relightd from outside. No
 * times are asserted: the next frame is sent when all viewers that keep up have received the last, and not before a
 * thirtieth of a second. usage: load (RELIGHT_BIN names the folder of relightd) */
#define CLIENT_MESSAGE_MAX ((size_t)1 << 20)
#include "net/stream/client.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>

enum {
    VIEWERS = 50,
    SLOW = 10,  /* of these */
    TENTH = 10, /* share of the images that a slow viewer reads */
    WARM = 30,  /* frames: the first second */
    FRAMES = 180,
    GROWTH_KIB = 6144, /* allowed to relightd after the first second; its images alone would be more */
    SLOT_KIB = 1024,   /* more than this at once: a pipeline slot is used for the first time, */
    SLOTS = 4,         /* which happens when a frame arrives while another is shaded, and no more often than this */
    WIDTH = 64,
    HEIGHT = 32,
};

struct daemon {
    pid_t pid;
    int out; /* its standard error */
    uint16_t port;
};

struct watcher {
    struct test_client c;
    uint64_t first, last, got, gaps;
};

static void daemon_start(struct daemon *d)
{
    static const char *const argv[] = { "relightd", "--source",    "push:", "--port",   "0",       "--size",
                                        "320x180",  "--samples",   "1",     "--method", "uniform", "--paths",
                                        "direct",   "--edge-rays", "1",     "--fps",    "60",      NULL };
    const char *bin = getenv("RELIGHT_BIN");
    char path[4096], text[4096] = "";
    size_t size = 0;
    int ends[2];

    assert_non_null(bin);
    snprintf(path, sizeof(path), "%s/relightd", bin);
    assert_int_equal(pipe(ends), 0);
    d->pid = fork();
    assert_true(d->pid >= 0);
    if (d->pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL); /* a failing test leaves no process behind */
        dup2(ends[1], STDERR_FILENO);
        close(ends[0]);
        close(ends[1]);
        execv(path, (char *const *)argv);
        _exit(127);
    }
    close(ends[1]);
    d->out = ends[0];
    for (;;) {
        const char *at = strstr(text, "http://127.0.0.1:");
        if (at && strchr(at + 17, '/')) {
            d->port = (uint16_t)atoi(at + 17);
            return;
        }
        const ssize_t n = read(d->out, text + size, sizeof(text) - 1 - size);
        if (n <= 0)
            fail_msg("relightd did not start: %s", text);
        size += (size_t)n;
        text[size] = 0;
    }
}

static void daemon_stop(struct daemon *d)
{
    int status = 0;

    kill(d->pid, SIGTERM);
    assert_int_equal(waitpid(d->pid, &status, 0), d->pid);
    close(d->out);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

static long daemon_kib(const struct daemon *d)
{
    char path[64], line[256];
    long kib = 0;

    snprintf(path, sizeof(path), "/proc/%ld/status", (long)d->pid);
    FILE *in = fopen(path, "r");
    assert_non_null(in);
    while (fgets(line, sizeof(line), in))
        sscanf(line, "VmRSS: %ld", &kib);
    fclose(in);
    return kib;
}

/* The number of images that relightd has encoded and published. */
static uint64_t daemon_images(const struct daemon *d)
{
    struct test_client c;
    unsigned long long images = 0;

    client_open_port(&c, d->port);
    static const char request[] = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    client_write(&c, request, sizeof(request) - 1);
    const char *at = strstr(client_rest(&c), "\"pictures\":");
    assert_non_null(at);
    assert_int_equal(sscanf(at, "\"pictures\":%llu", &images), 1);
    client_shut(&c);
    return images;
}

static void greet(struct test_client *c, const struct daemon *d, const char *role)
{
    char text[120];

    client_open_port(c, d->port);
    assert_int_equal(client_handshake(c, NULL), 101);
    snprintf(text, sizeof(text), "{\"op\":\"hello\",\"role\":\"%s\",\"version\":{\"major\":1}}", role);
    client_say(c, text);
    client_expect(c, "welcome");
}

static void send_frame(struct test_client *c, uint64_t number)
{
    static uint8_t bytes[PROTOCOL_ENVIRONMENT_BYTES + WIDTH * HEIGHT * 6];
    const struct protocol_environment e = {
        .encoding = PROTOCOL_RAW_HALF,
        .layout = PROTOCOL_LATLONG,
        .channels = 3,
        .width = WIDTH,
        .height = HEIGHT,
        .payload = WIDTH * HEIGHT * 6,
        .frame = number,
    };

    protocol_environment_encode(&e, bytes);
    for (size_t i = 0; i < e.payload; i += 2) { /* halves from 0.5 to 2, a different pattern in each frame */
        bytes[PROTOCOL_ENVIRONMENT_BYTES + i] = (uint8_t)(i * 13 + number * 31);
        bytes[PROTOCOL_ENVIRONMENT_BYTES + i + 1] = (uint8_t)(0x38 + (i / 6 + number) % 8);
    }
    client_frame(c, OP_BINARY, true, bytes, sizeof(bytes));
}

/* Reads until an image of this frame or a later one; acknowledges each. */
static void watch_until(struct watcher *w, uint64_t frame)
{
    struct protocol_picture h = { 0 };

    while (h.frame < frame) {
        const uint64_t sequence = client_picture(&w->c, &h, CLIENT_WAIT_MS);
        if (!sequence)
            fail_msg("the image of frame %llu did not come; closed with %d", (unsigned long long)frame,
                     w->c.close_code);
        assert_true(sequence > w->last);
        w->gaps += w->last ? sequence - w->last - 1 : 0;
        w->first = w->first ? w->first : sequence;
        w->last = sequence;
        w->got++;
        client_ack(&w->c, sequence);
    }
}

/* The producer's messages for one frame: until its fate is known and there is credit for the next. */
static void await_used(struct test_client *producer, uint64_t number)
{
    json_t *m = client_await(producer, "frame");

    assert_non_null(m);
    assert_int_equal(json_integer_value(json_object_get(m, "number")), number);
    assert_string_equal(json_string_value(json_object_get(m, "fate")), "used");
    json_decref(m);
}

static double seconds(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void play(struct daemon *d, struct test_client *producer, struct watcher *watchers)
{
    long held = 0, growth = 0, slots = 0;
    const double begun = seconds();

    for (uint64_t number = 1; number <= FRAMES; number++) {
        const double due = begun + (double)(number - 1) / 30.0;
        if (seconds() < due)
            sleep_ms((long)(1e3 * (due - seconds())));
        send_frame(producer, number);
        await_used(producer, number);
        for (int i = SLOW; i < VIEWERS; i++)
            watch_until(&watchers[i], number);
        for (int i = 0; i < SLOW && number % TENTH == 0; i++) {
            struct protocol_picture h;
            const uint64_t sequence = client_picture(&watchers[i].c, &h, CLIENT_WAIT_MS);
            assert_true(sequence > watchers[i].last);
            watchers[i].last = sequence;
            watchers[i].got++;
            client_ack(&watchers[i].c, sequence);
        }
        const long now = daemon_kib(d), more = now - held;
        if (number > WARM && more > SLOT_KIB)
            slots++;
        else if (number > WARM)
            growth += more;
        held = now;
    }
    printf("%d frames in %.1f s; relightd holds %ld KiB, %+ld since the first second and %ld times a new place\n",
           FRAMES, seconds() - begun, held, growth, slots);
#ifndef __SANITIZE_ADDRESS__ /* AddressSanitizer keeps freed memory */
    assert_true(growth < GROWTH_KIB);
    assert_true(slots <= SLOTS);
#endif
}

static void fifty_viewers_get_every_image_though_ten_of_them_are_slow(void **state)
{
    (void)state;
    static struct watcher watchers[VIEWERS];
    struct test_client producer;
    struct daemon d;

    daemon_start(&d);
    greet(&producer, &d, "producer");
    for (int i = 0; i < VIEWERS; i++) {
        greet(&watchers[i].c, &d, "viewer");
        client_say(&watchers[i].c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
        client_expect(&watchers[i].c, "subscribed");
    }
    play(&d, &producer, watchers);
    for (int i = 0; i < VIEWERS; i++) {
        const struct watcher *w = &watchers[i];
        if (i >= SLOW)
            assert_true(w->got == FRAMES && w->gaps == 0 && w->last - w->first + 1 == FRAMES);
        else
            assert_int_equal(w->got, FRAMES / TENTH);
        client_shut(&watchers[i].c);
    }
    const uint64_t images = daemon_images(&d);
    printf("%d viewers, %d of them slow; %llu images encoded\n", VIEWERS, SLOW, (unsigned long long)images);
    assert_int_equal(images, FRAMES); /* each once, however many viewers */
    client_shut(&producer);
    daemon_stop(&d);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(fifty_viewers_get_every_image_though_ten_of_them_are_slow),
};
UNIT_MAIN(tests)
