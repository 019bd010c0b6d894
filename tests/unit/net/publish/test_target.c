#include "net/publish/publish.h"

#include "support/unit.h"

static struct publish_target parsed(const char *url)
{
    struct publish_target t;
    struct reason why = { "" };

    if (publish_target_parse(url, &t, &why))
        fail_msg("%s is refused: %s", url, why.text);
    return t;
}

static void names_hold_scheme_and_host_and_no_keys(void **state)
{
    static const struct {
        const char *url, *name;
        enum publish_kind kind;
    } rows[] = {
        { "rtmp://a.example/live/key", "rtmp://a.example", PUBLISH_RTMP },
        { "rtmp://user:key@a.example:1936/live/key?key=key", "rtmp://a.example:1936", PUBLISH_RTMP },
        { "rtsp://user:key@[::1]:8554/key", "rtsp://[::1]:8554", PUBLISH_RTSP },
        { "rtsp://user:k@ey@a.example/x@key", "rtsp://a.example", PUBLISH_RTSP },
        { "srt://a.example:9000?passphrase=key", "srt://a.example:9000", PUBLISH_SRT },
        { "srt://key@a.example:9000?streamid=key@key", "srt://a.example:9000", PUBLISH_SRT },
        { "hls:/srv/hls/", "hls:/srv/hls", PUBLISH_HLS },
        { "hls:/", "hls:/", PUBLISH_HLS },
        { "hls:a \"b\"\\c\nd", "hls:a ?b??c?d", PUBLISH_HLS },
        { "hls:\xc3\xa4\xff\xe4\xc0\xaf\xed\xa0\x80\xf0\x9f\x98\x80\xe2\x82",
          "hls:\xc3\xa4???????\xf0\x9f\x98\x80??", PUBLISH_HLS },
        { "record:films?minutes=5", "record:films", PUBLISH_RECORD },
    };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        const struct publish_target t = parsed(rows[i].url);
        assert_string_equal(t.name, rows[i].name);
        assert_int_equal(t.kind, rows[i].kind);
        assert_ptr_equal(t.url, rows[i].url);
    }
}

static void what_is_no_target_is_refused_with_what_would_be_right(void **state)
{
    static const struct {
        const char *url, *says;
    } rows[] = {
        { "", "--publish needs rtmp://HOST" },
        { "films", "--publish needs rtmp://HOST" },
        { "http://a.example/key", "does not know 'http:'; it needs rtmp://HOST" },
        { "rtmp:a.example", "does not know 'rtmp:'; it needs rtmp://HOST" },
        { "RTMP://a.example/live/key", "does not know 'RTMP:'" },
        { "rtmp:///live/key", "names no host" },
        { "rtmp://user:key@/live/key", "names no host" },
        { "rtmp://a.example", "names no stream; RTMP needs rtmp://HOST/APP/STREAM" },
        { "rtmp://a.example/?key", "names no stream" },
        { "rtsp://a.example:554/", "names no stream; RTSP needs rtsp://HOST/PATH" },
        { "srt://a.example?passphrase=key", "names no port; SRT needs srt://HOST:PORT" },
        { "srt://a.example:", "names no port" },
        { "srt://:9000", "names no host" },
        { "hls:", "it needs hls:DIR" },
        { "record:", "it needs record:DIR" },
        { "record:?minutes=5", "it needs record:DIR" },
        { "record:films?minutes=", "'minutes=' is not a number from 0.05 to 1440" },
        { "record:films?minutes=0", "'minutes=0' is not a number" },
        { "record:films?minutes=nan", "is not a number" },
        { "record:films?minutes=5x", "is not a number" },
        { "record:films?minutes=1441", "is not a number" },
    };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct publish_target t;
        struct reason why = { "" };
        const enum err e = publish_target_parse(rows[i].url, &t, &why);
        if (e != ERR_USAGE || !strstr(why.text, rows[i].says))
            fail_msg("%s: says '%s'", rows[i].url, why.text);
        if (strstr(why.text, "key"))
            fail_msg("%s: tells the key: '%s'", rows[i].url, why.text);
    }
}

static void recordings_and_listeners_have_options(void **state)
{
    (void)state;
    assert_true(parsed("record:films").file_s == 600.0);
    assert_true(parsed("record:films?minutes=0.5").file_s == 30.0);
    assert_string_equal(parsed("record:what?/films?minutes=5").folder, "what?/films");
    assert_string_equal(parsed("hls:a?minutes=5").folder, "a?minutes=5");
    assert_true(parsed("srt://0.0.0.0:9000?mode=listener").listens);
    assert_true(parsed("srt://0.0.0.0:9000?latency=5&mode=listener&x=1").listens);
    assert_false(parsed("srt://a.example:9000?mode=listeners").listens);
    assert_false(parsed("srt://a.example:9000").listens);
}

static void long_names_are_cut_and_long_paths_refused(void **state)
{
    static char url[2 * PUBLISH_PATH];
    struct publish_target t;
    struct reason why;
    (void)state;

    memset(url, 'x', sizeof(url) - 1);
    memcpy(url, "hls:", 4);
    assert_int_equal(publish_target_parse(url, &t, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "exceeds 1023 bytes"));
    url[PUBLISH_PATH + 3] = '\0'; /* the longest */
    assert_int_equal(publish_target_parse(url, &t, &why), ERR_OK);
    assert_int_equal(strlen(t.folder), PUBLISH_PATH - 1);
    assert_true(strlen(t.name) < PUBLISH_NAME);
    memcpy(url, "rtmp://", 7);
    url[PUBLISH_PATH] = '/';
    assert_int_equal(publish_target_parse(url, &t, &why), ERR_OK);
    assert_int_equal(strlen(t.name), PUBLISH_NAME - 1);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(names_hold_scheme_and_host_and_no_keys),
    cmocka_unit_test(what_is_no_target_is_refused_with_what_would_be_right),
    cmocka_unit_test(recordings_and_listeners_have_options),
    cmocka_unit_test(long_names_are_cut_and_long_paths_refused),
};
UNIT_MAIN(tests)
