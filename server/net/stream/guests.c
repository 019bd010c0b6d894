#include "net/stream/guests.h"

#include "base/mem.h"
#include "net/stream/internal.h"

#include <stdio.h>

#define BESIDE_CLIENTS 16 /* connections of an address beside its clients: a browser opens six for a page */

struct guest *guest_of(struct lws *wsi)
{
    return lws_get_opaque_user_data(wsi); /* libwebsockets keeps it with the connection */
}

/* Local connections may all come through a proxy. */
static bool is_limited(const struct server *s, const struct visitor *v)
{
    return s->max_per_address_given || !v->loopback;
}

static void list(struct guests *all, struct guest *g)
{
    g->state = GUEST_ARRIVING;
    g->previous = all->last;
    g->next = NULL;
    *(all->last ? &all->last->next : &all->first) = g;
    all->last = g;
    all->arriving++;
    g->visitor->arriving++;
}

static void unlist(struct guests *all, struct guest *g)
{
    *(g->previous ? &g->previous->next : &all->first) = g->next;
    *(g->next ? &g->next->previous : &all->last) = g->previous;
    all->arriving--;
    g->visitor->arriving--;
}

/* Gives up the guest's place, whatever it is. */
static void give_up(struct guests *all, struct guest *g)
{
    if (g->state == GUEST_ARRIVING)
        unlist(all, g);
    if (g->state == GUEST_CLIENT) {
        all->clients--;
        g->visitor->clients--;
    }
    g->state = GUEST_LEAVING;
}

/* Closes the oldest arriving guest of the address that has most. */
static void evict(struct server *s)
{
    struct guest *out = s->guests.first;

    for (struct guest *g = out; g; g = g->next)
        if (g->visitor->arriving > out->visitor->arriving)
            out = g;
    limit_reached(s, LIMIT_ARRIVALS, out->visitor);
    give_up(&s->guests, out);
    /* Not in this call: libwebsockets may be about to service it. */
    lws_set_timeout(out->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
}

int guest_arrive(struct server *s, struct lws *wsi)
{
    struct visitor *v = admission_peer(s, wsi);

    lws_set_opaque_user_data(wsi, NULL);
    if (!v || (is_limited(s, v) && v->connections >= s->max_per_address + BESIDE_CLIENTS)) {
        atomic_fetch_add(&s->counts.refused, 1);
        atomic_fetch_add(&s->counts.crowded, 1);
        limit_reached(s, LIMIT_ADDRESS, v);
        return -1;
    }
    struct guest *g = mem_alloc(1, sizeof(*g));
    if (!g)
        return -1;
    *g = (struct guest){ .wsi = wsi, .visitor = v };
    v->connections++;
    list(&s->guests, g);
    lws_set_opaque_user_data(wsi, g);
    if (s->guests.arriving > s->guests.most_arriving)
        evict(s);
    return 0;
}

void guest_leave(struct server *s, struct lws *wsi)
{
    struct guest *g = guest_of(wsi);

    if (!g)
        return;
    watcher_destroy(g->watcher);
    give_up(&s->guests, g);
    g->visitor->connections--;
    lws_set_opaque_user_data(wsi, NULL);
    mem_free(g);
}

void guest_move(struct guest *g, struct visitor *to)
{
    const uint32_t arriving = g->state == GUEST_ARRIVING;

    g->visitor->connections--;
    g->visitor->arriving -= arriving;
    to->connections++;
    to->arriving += arriving;
    g->visitor = to;
}

/* Producers and recorders have work to finish. */
static bool may_give_way(const struct viewer *v)
{
    return v->guest && v->guest->state == GUEST_CLIENT && !v->producing && !v->recorder && !v->close_code;
}

/* The newest of the address with most clients, if that has at least two more than g's: first requests of plain HTTP,
 * then viewers. Both lists begin with the newest. NULL: nobody. */
static struct guest *who_gives_way(const struct server *s, const struct guest *g)
{
    const uint32_t least = g->visitor->clients + 2;
    struct guest *out = NULL;

    for (struct watcher *w = s->watchers; w; w = w->next)
        if (w->guest->state == GUEST_CLIENT && w->guest->visitor->clients >= least &&
            (!out || w->guest->visitor->clients > out->visitor->clients))
            out = w->guest;
    for (struct viewer *v = s->viewers; v; v = v->next)
        if (may_give_way(v) && v->guest->visitor->clients >= least &&
            (!out || v->guest->visitor->clients > out->visitor->clients))
            out = v->guest;
    return out;
}

enum guest_room guest_room(const struct server *s, const struct guest *g)
{
    if (is_limited(s, g->visitor) && g->visitor->clients >= s->max_per_address)
        return GUEST_CROWDED;
    return s->guests.clients < s->max_connections || who_gives_way(s, g) ? GUEST_ROOM : GUEST_FULL;
}

const char *guest_refusal(struct server *s, const struct guest *g, char *text, size_t size)
{
    const enum guest_room room = guest_room(s, g);

    if (room == GUEST_ROOM)
        return NULL;
    if (room == GUEST_FULL)
        snprintf(text, size, "all %u connections are taken", s->max_connections);
    else
        snprintf(text, size, "one address has at most %u connections", s->max_per_address);
    if (room == GUEST_CROWDED)
        atomic_fetch_add(&s->counts.crowded, 1);
    limit_reached(s, room == GUEST_FULL ? LIMIT_CLIENTS : LIMIT_ADDRESS, g->visitor);
    return text;
}

/* Closes a client that gives way. */
static void show_out(struct server *s, struct guest *out)
{
    struct viewer *v = s->viewers;
    struct fault fault;

    limit_reached(s, LIMIT_CLIENTS, out->visitor);
    give_up(&s->guests, out);
    list(&s->guests, out); /* until it has gone */
    if (out->watcher) {
        watcher_close(out->watcher);
        return;
    }
    while (v->guest != out)
        v = v->next;
    fault_say(&fault, FAULT_FULL, "2.4", "all %u connections are taken, and its address had most of them",
              s->max_connections);
    viewer_send_error(v, &fault);
}

bool guest_admit(struct server *s, struct guest *g)
{
    if (g->state != GUEST_ARRIVING)
        return false;
    if (s->guests.clients >= s->max_connections)
        show_out(s, who_gives_way(s, g));
    unlist(&s->guests, g);
    g->state = GUEST_CLIENT;
    s->guests.clients++;
    g->visitor->clients++;
    return true;
}

void guest_dismiss(struct server *s, struct guest *g)
{
    if (g->state != GUEST_CLIENT)
        return;
    give_up(&s->guests, g);
    list(&s->guests, g);
}
