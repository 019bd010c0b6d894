/* Limits the bytes that a client sends outside messages: pings, pongs and empty frames. libwebsockets handles these
 * itself and reports few of them, so this file counts bytes: those that TCP has delivered, minus those of messages. */
#include "net/stream/internal.h"

#include <linux/tcp.h> /* not netinet/tcp.h, whose tcp_info ends before tcpi_bytes_received */
#include <netinet/in.h>
#include <stddef.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#define FLOOD_BURST (256 << 10) /* bytes at once: a token bucket, */
#define FLOOD_RATE (64 << 10)   /* refilled at this rate per second */

/* Bytes that were received and read; fewer if some arrive between the two calls. Negative: this kernel does not say. */
static int64_t bytes_read(struct lws *wsi)
{
    struct tcp_info info;
    socklen_t size = sizeof(info);
    const int fd = lws_get_socket_fd(wsi);
    int unread = 0;

    if (getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0 ||
        size < offsetof(struct tcp_info, tcpi_bytes_received) + sizeof(info.tcpi_bytes_received) ||
        ioctl(fd, FIONREAD, &unread) != 0)
        return -1;
    return (int64_t)info.tcpi_bytes_received - unread;
}

void flood_begin(struct viewer *v)
{
    v->flood.read = bytes_read(v->wsi);
    v->flood.left = FLOOD_BURST;
    v->flood.refilled_us = viewer_now_us();
}

void flood_add(struct viewer *v, size_t length)
{
    v->flood.messages += (int64_t)(length + length / 64 + 64); /* headers of WebSocket and TLS, generously */
}

void flood_check(struct viewer *v)
{
    struct flood *f = &v->flood;
    const int64_t now = viewer_now_us(), read = bytes_read(v->wsi);
    struct fault fault;

    if (read < 0 || f->read < 0 || v->close_code)
        return;
    /* Compare totals: what was taken for something else may turn out to be a message of which a piece is still to come,
     * and is then not counted again. */
    const int64_t beside = read - f->read - f->messages;
    f->left += (double)(now - f->refilled_us) * 1e-6 * FLOOD_RATE;
    f->left = f->left < FLOOD_BURST ? f->left : FLOOD_BURST;
    f->refilled_us = now;
    if (beside > f->beside) {
        f->left -= (double)(beside - f->beside);
        f->beside = beside;
    }
    if (f->left >= 0.0)
        return;
    atomic_fetch_add(&v->server->counts.too_fast, 1);
    fault_say(&fault, FAULT_TOO_FAST, "2.5", "more than %d bytes a second besides messages", FLOOD_RATE);
    viewer_send_error(v, &fault);
    lws_rx_flow_control(v->wsi, 0); /* else it would cost until it is gone */
}
