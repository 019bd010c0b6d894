/* A client's text message: its values are within limits, or a fault names clause and reason. */
#include "harness.h"

#include "net/message/message.h"
#include "relightd/settings/settings.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check_fault(const struct fault *f)
{
    char reason[FAULT_REASON];
    char *error = message_error(f);

    require(f->clause[0] == '3' || f->clause[0] == '4', "a fault names its clause");
    require(f->text[0] != 0, "a fault has a reason");
    require(strlen(fault_reason(f, reason)) <= 123, "a reason fits a close frame");
    require(error && strstr(error, fault_name(f->code)), "a fault can be told");
    message_free(error);
}

static void check_control(const struct server_control *c)
{
    struct settings s;

    memcpy(&s, c->values, sizeof(s));
    for (uint32_t k = 0; settings_table[k].key; k++) {
        const struct setting *row = &settings_table[k];
        if (!(c->asked >> k & 1) || setting_is_null(row, &s))
            continue;
        const bool real = row->type == SETTING_REAL, whole = row->type == SETTING_WHOLE;
        const double v = real ? setting_real(row, &s) : whole ? (double)setting_whole(row, &s) : 0.0;
        require(!(real || whole) || (v >= row->least && v <= row->most), row->key);
        if (row->type == SETTING_CHOICE)
            require(choice_name(row->choices, (int)setting_whole(row, &s))[0] != 0, row->key);
    }
    require(memchr(s.camera, 0, sizeof(s.camera)) != NULL, "words end");
    require(c->request <= PROTOCOL_NUMBER_MAX, "request");
}

static void check_message(const struct message *m)
{
    switch (m->op) {
    case MESSAGE_HELLO:
        require(m->hello.role < SERVER_ROLES, "role");
        require(memchr(m->hello.token, 0, sizeof(m->hello.token)) != NULL, "a token ends");
        require(memchr(m->hello.sequence, 0, sizeof(m->hello.sequence)) != NULL, "a name ends");
        require(memchr(m->hello.recorder, 0, sizeof(m->hello.recorder)) != NULL, "a name ends");
        require(m->hello.role != SERVER_PRODUCER || !m->hello.lockstep || m->hello.sequence[0], "a name is there");
        break;
    case MESSAGE_SUBSCRIBE:
        require(m->subscribe.format >= PROTOCOL_JPEG && m->subscribe.format <= PROTOCOL_H264, "format");
        require(m->subscribe.quality >= 0 && m->subscribe.quality <= 100, "quality");
        require(m->subscribe.max_rate >= 0.0 && m->subscribe.max_rate <= 1000.0, "rate");
        break;
    case MESSAGE_ACK: require(m->ack.sequence >= 1 && m->ack.sequence <= PROTOCOL_NUMBER_MAX, "sequence"); break;
    case MESSAGE_PING: require(m->ping.id <= PROTOCOL_NUMBER_MAX, "id"); break;
    case MESSAGE_END: break;
    case MESSAGE_CONTROL: check_control(&m->control); break;
    case MESSAGE_PROBE:
        require(m->inspection.question.x < PROTOCOL_SIDE_MAX && m->inspection.question.y < PROTOCOL_SIDE_MAX, "pixel");
        require(m->inspection.question.samples <= MESSAGE_PROBE_SAMPLES_MAX, "samples");
        require(m->inspection.question.request <= PROTOCOL_NUMBER_MAX, "request");
        require(m->inspection.asks || (m->inspection.has_follow && !m->inspection.follow), "nothing is asked");
        break;
    default: require(0, "a known message");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct message m;
    struct fault fault;
    const enum fault_code code = message_parse((const char *)bytes, size, settings_table, &m, &fault);

    require(code == fault.code && code < FAULT_CODES, "one fault");
    if (code)
        check_fault(&fault);
    else
        check_message(&m);
    return 0;
}
