/* Memory runs out in messages, images, frames of producers and metrics, and while connections are served. */
#include "support/nomem.h"

#include "net/stream/internal.h"

#include "base/mem.h"
#include "net/stream/producing.h"
#include "relightd/settings/settings.h"

static enum err texts(void *context, struct reason *why)
{
    static const char hello[] = "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1,\"minor\":0}}";
    static const char *const cameras[] = { "one", "two", NULL };
    const struct server_figures status = {
        .scene = "a scene", .cameras = cameras, .publish = { { .to = "hls:x" }, { .to = "hls:y" } }, .publish_count = 2
    };
    static const char control[] = "{\"op\":\"control\",\"method\":\"mis\",\"camera\":\"one\",\"fps\":5}";
    const struct settings settings = { .method = METHOD_MIS, .classes = PATH_ALL };
    struct message m;
    struct fault fault = { .code = FAULT_NONE };
    (void)context;
    (void)why;

    const bool parsed = message_parse(hello, strlen(hello), NULL, &m, &fault) == FAULT_NONE &&
                        message_parse(control, strlen(control), settings_table, &m, &fault) == FAULT_NONE;
    char *made[] = { message_status_shared(&status, settings_table),
                     message_control_shared(settings_table, &settings),
                     message_pong(1, 2),
                     message_credit(3),
                     message_fate(4, SERVER_USED, 5, NULL),
                     message_sequence("day", 6),
                     message_welcome(&(struct welcome){
                         .session = "s", .controls = settings_table, .producer = true, .recorder = true }) };
    bool all = parsed;
    for (size_t k = 0; k < sizeof(made) / sizeof(made[0]); k++) {
        all = all && made[k];
        message_free(made[k]);
    }
    return all ? ERR_OK : ERR_NOMEM;
}

static void texts_are_made_and_read(void **state)
{
    (void)state;
    nomem_each("texts", texts, NULL);
}

static enum err figures(void *context, struct reason *why)
{
    size_t size;
    char *text = metrics_text(context, &size);
    (void)why;

    mem_free(text);
    return text ? ERR_OK : ERR_NOMEM;
}

static void metrics_are_written(void **state)
{
    struct server *s = server_start(NULL);
    (void)state;

    sleep_ms(100); /* its own thread has begun */
    nomem_each("metrics", figures, s);
    server_destroy(s);
}

static enum err begin(void *context, struct reason *why)
{
    const struct server_desc desc = { .push = true, .tokens = { "a", "b", "c" }, .token_metrics = "d" };
    struct server *s;
    const enum err e = server_create(&desc, &s, why);
    (void)context;

    if (!e)
        server_destroy(s);
    return e;
}

static void a_server_is_started(void **state)
{
    (void)state;
    nomem_most = 20; /* each that is started takes its time to end */
    nomem_each("start", begin, NULL);
}

/* A producer's frame, an image of it and a viewer that gets that, while now and then an allocation of the server's
 * fails. Connections may be lost for it; the server stays, and serves whoever comes when there is memory again. */
static void it_serves_on_whatever_fails(void **state)
{
    struct server *s = push_server();
    struct protocol_picture h;
    (void)state;

    nomem_spares = true; /* the client's own */
    nomem_spared = pthread_self();
    for (unsigned n = 1; n <= 60; n++) {
        struct test_client c;
        client_open(&c, s);
        nomem_arm(n, n % 4 == 0);
        if (client_handshake(&c, NULL) == 101) {
            client_say(&c, "{\"op\":\"hello\",\"role\":\"controller\",\"version\":{\"major\":1,\"minor\":0}}");
            client_say(&c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
            client_say(&c, "{\"op\":\"control\",\"method\":\"mis\"}");
            client_say(&c, "{\"op\":\"ping\",\"id\":1}");
            client_next(&c, 20);
        }
        nomem_disarm();
        client_shut(&c);
    }
    nomem_spares = false;
    struct test_client c;
    client_watch(&c, s);
    publish(s, 1, 1000);
    assert_int_equal(client_picture(&c, &h, CLIENT_WAIT_MS), 1);
    client_shut(&c);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(texts_are_made_and_read),
    cmocka_unit_test(metrics_are_written),
    cmocka_unit_test(a_server_is_started),
    cmocka_unit_test(it_serves_on_whatever_fails),
};

int main(int argc, char **argv)
{
    json_set_alloc_funcs(malloc, free); /* of this program, which may fail */
    return unit_main(argc, argv, tests, sizeof(tests) / sizeof(tests[0]));
}
