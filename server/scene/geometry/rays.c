#include "scene/geometry/embree.h"
#include "scene/geometry/mesh_read.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define SAME_PLACE(field)                                                                                              \
    _Static_assert(offsetof(struct ray16, field) == offsetof(struct RTCRay16, field) &&                                \
                       sizeof(((struct ray16 *)0)->field) == sizeof(((struct RTCRay16 *)0)->field),                    \
                   "ray16 and RTCRay16 differ in " #field)
SAME_PLACE(org_x);
SAME_PLACE(org_y);
SAME_PLACE(org_z);
SAME_PLACE(tnear);
SAME_PLACE(dir_x);
SAME_PLACE(dir_y);
SAME_PLACE(dir_z);
SAME_PLACE(time);
SAME_PLACE(tfar);
SAME_PLACE(mask);
SAME_PLACE(id);
SAME_PLACE(flags);
_Static_assert(sizeof(struct ray16) == sizeof(struct RTCRay16), "ray16 and RTCRay16 differ in size");
_Static_assert(_Alignof(struct ray16) == _Alignof(struct RTCRay16), "ray16 and RTCRay16 differ in alignment");

/* The data of a query for the filter functions of masked meshes. Every query has one. */
struct query {
    struct embree_query embree; /* first: Embree passes its address on */
    float angle;                /* rays_see: between neighbouring rays, radians; else 0 */
    bool seen;                  /* by rays_see: fractional coverage is left to the caller */
    float varies;               /* the nearest distance where a mask has holes and surface within `angle` */
    const struct rays *rays;
    float world[6][PACKET]; /* origin and direction of each ray, by its id, where a placed mesh has holes: within an
                               instance Embree turns them */
};

/* Rows of Embree's packets of any width: [row * N + lane]. */
enum { RAY_ORG = 0, RAY_DIR = 4, RAY_TFAR = 8, RAY_ID = 10, HIT_NG = 0, HIT_U = 3, HIT_V = 4, HIT_TRIANGLE = 5 };

static float square(float x)
{
    return x * x;
}

/* The width on the surface, in m, of a ray of rays_see, whose direction is unit, at distance t. n: normal, any length.
 */
static float width_at(const struct query *q, float t, const float d[3], struct vec3 n)
{
    const float along = fabsf(d[0] * n.x + d[1] * n.y + d[2] * n.z);

    return t * q->angle * sqrtf(square(n.x) + square(n.y) + square(n.z)) / along;
}

/* A hit that the filter function is asked about, in the world. */
struct candidate {
    float origin[3], dir[3], t; /* of the ray */
    uint32_t triangle;
    float u, v;
    struct vec3 normal; /* any length; only of rays_see */
};

static struct vec3 normal_of(const struct mesh *m, uint32_t triangle)
{
    struct vec3 p[3];

    mesh_corners_rounded(m, triangle, p);
    return vec3_cross(vec3_sub(p[1], p[0]), vec3_sub(p[2], p[0]));
}

/* Lane i of n. */
static void read_candidate(const struct mask *m, const struct query *q, const float *ray, const float *hit, size_t n,
                           size_t i, struct candidate *c)
{
    uint32_t id = 0;

    memcpy(&c->triangle, hit + HIT_TRIANGLE * n + i, sizeof(c->triangle));
    c->u = hit[HIT_U * n + i];
    c->v = hit[HIT_V * n + i];
    c->t = ray[RAY_TFAR * n + i]; /* during the call, the distance of the hit */
    if (m->mesh->placed)
        memcpy(&id, ray + RAY_ID * n + i, sizeof(id));
    for (size_t k = 0; k < 3; k++) {
        c->origin[k] = m->mesh->placed ? q->world[k][id] : ray[(RAY_ORG + k) * n + i];
        c->dir[k] = m->mesh->placed ? q->world[3 + k][id] : ray[(RAY_DIR + k) * n + i];
    }
    if (q->seen)
        c->normal = m->mesh->placed
                        ? normal_of(m->mesh, c->triangle)
                        : vec3_make(hit[(HIT_NG + 0) * n + i], hit[(HIT_NG + 1) * n + i], hit[(HIT_NG + 2) * n + i]);
}

static bool meets_surface(const struct mask *m, struct query *q, const struct candidate *c)
{
    if (q->seen) {
        if (m->material->alpha_mode != ALPHA_MASK)
            return true;
        if (c->t < q->varies && mask_varies(m, c->triangle, c->u, c->v, width_at(q, c->t, c->dir, c->normal)))
            q->varies = c->t;
        return mask_covers_seen(m, c->triangle, c->u, c->v);
    }
    return mask_covers(m, c->triangle, c->u, c->v, c->origin, c->dir);
}

void rays_drop_holes(const struct RTCFilterFunctionNArguments *a)
{
    const float *ray = (const float *)a->ray, *hit = (const float *)a->hit;
    struct query *q = (struct query *)a->context;
    const uint32_t instance = a->context->instID[0];
    const struct mask *m = instance == RTC_INVALID_GEOMETRY_ID ? a->geometryUserPtr : &q->rays->masks[instance];
    struct candidate c;

    for (size_t i = 0; i < a->N; i++) {
        if (a->valid[i] != -1)
            continue;
        read_candidate(m, q, ray, hit, a->N, i, &c);
        if (!meets_surface(m, q, &c))
            a->valid[i] = 0;
    }
}

/* Embree 3.13 never returns from some coherent packets that meet instances. */
static void set_spread(const struct rays *r, struct query *q, enum ray_spread spread)
{
    embree_query_spread(&q->embree, spread == RAYS_TOGETHER && !r->parts);
}

static void query_init(const struct rays *r, struct query *q)
{
    embree_query_init(&q->embree);
    q->seen = false;
    q->rays = r;
}

static void keep_packet(struct query *q, struct ray16 *packet)
{
    const float *const rows[6] = { packet->org_x, packet->org_y, packet->org_z,
                                   packet->dir_x, packet->dir_y, packet->dir_z };

    for (uint32_t l = 0; l < PACKET; l++)
        packet->id[l] = l;
    for (int k = 0; k < 6; k++)
        memcpy(q->world[k], rows[k], sizeof(q->world[k]));
}

static void keep_ray(struct query *q, const struct RTCRay *ray)
{
    const float rows[6] = { ray->org_x, ray->org_y, ray->org_z, ray->dir_x, ray->dir_y, ray->dir_z };

    for (int k = 0; k < 6; k++)
        q->world[k][ray->id] = rows[k];
}

/* Lanes first .. first + width - 1 of a packet as a packet of that width: both are plain rows of four-byte numbers. */
static void narrow_to(const struct ray16 *packet, int first, int width, void *out)
{
    const size_t row_bytes = (size_t)width * sizeof(float);

    for (size_t row = 0; row < sizeof(*packet) / sizeof(packet->org_x); row++)
        memcpy((char *)out + row * row_bytes, (const char *)packet + row * sizeof(packet->org_x) + (size_t)first * 4,
               row_bytes);
}

/* valid is aligned to 64 bytes, as Embree wants it. */
static void ask_packet(const struct rays *r, struct query *q, const int32_t *valid, struct ray16 *packet)
{
    struct RTCRay8 eight;
    struct RTCRay4 four;

    if (r->placed_masks)
        keep_packet(q, packet);
    if (r->width == 16) {
        embree_occluded16(valid, r->bvh, &q->embree, (struct RTCRay16 *)packet);
        return;
    }
    for (int first = 0; first < PACKET; first += r->width) {
        void *narrow = r->width == 8 ? (void *)&eight : (void *)&four;

        narrow_to(packet, first, r->width, narrow);
        if (r->width == 8)
            embree_occluded8(valid + first, r->bvh, &q->embree, &eight);
        else
            embree_occluded4(valid + first, r->bvh, &q->embree, &four);
        memcpy(packet->tfar + first, r->width == 8 ? eight.tfar : four.tfar, (size_t)r->width * sizeof(float));
    }
}

void rays_occluded16(const struct rays *r, enum ray_spread spread, const int32_t valid[PACKET], struct ray16 *packet)
{
    struct query q;
    _Alignas(64) int32_t lanes[PACKET]; /* Embree requires alignment; the caller's array may be unaligned */

    memcpy(lanes, valid, sizeof(lanes));
    if (r->log && r->log->count < r->log->capacity) {
        r->log->packets[r->log->count] = *packet;
        r->log->spread[r->log->count] = spread;
        memcpy(r->log->valid[r->log->count++], valid, sizeof(r->log->valid[0]));
    }
    query_init(r, &q);
    set_spread(r, &q, spread);
    ask_packet(r, &q, lanes, packet);
}

void rays_set_log(struct rays *r, struct ray_log *log)
{
    r->log = log;
}

uint64_t rays_replay(const struct rays *r, const struct ray_log *log, size_t first, size_t last)
{
    struct query q;
    uint64_t occluded = 0;

    query_init(r, &q);
    for (size_t i = first; i < last; i++) {
        struct ray16 packet = log->packets[i];
        set_spread(r, &q, log->spread[i]);
        ask_packet(r, &q, log->valid[i], &packet);
        for (int l = 0; l < PACKET; l++)
            occluded += packet.tfar[l] < 0.0f;
    }
    return occluded;
}

static struct RTCRay ray_from(struct vec3 origin, struct vec3 dir, float tnear, float tfar)
{
    return (struct RTCRay){
        .org_x = origin.x,
        .org_y = origin.y,
        .org_z = origin.z,
        .tnear = tnear,
        .dir_x = dir.x,
        .dir_y = dir.y,
        .dir_z = dir.z,
        .tfar = tfar,
        .mask = UINT32_MAX,
    };
}

/* rtcIntersect1 with a query that is ready. */
static bool first_hit(const struct rays *r, struct query *q, struct RTCRay ray, struct hit *out)
{
    struct RTCRayHit h = {
        .ray = ray,
        .hit = { .geomID = RTC_INVALID_GEOMETRY_ID, .instID = { RTC_INVALID_GEOMETRY_ID } },
    };

    if (r->placed_masks)
        keep_ray(q, &ray);
    embree_intersect1(r->bvh, &q->embree, &h);
    if (h.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    const uint32_t mesh = h.hit.instID[0] == RTC_INVALID_GEOMETRY_ID ? h.hit.geomID : h.hit.instID[0];
    *out = (struct hit){ h.ray.tfar, mesh, h.hit.primID, h.hit.u, h.hit.v };
    return true;
}

static bool is_blocked(const struct rays *r, struct query *q, struct RTCRay ray)
{
    if (r->placed_masks)
        keep_ray(q, &ray);
    embree_occluded1(r->bvh, &q->embree, &ray);
    return ray.tfar < 0.0f;
}

uint64_t rays_replay_singles(const struct rays *r, const struct ray_log *log, size_t first, size_t last)
{
    struct query q;
    struct hit hit;
    uint64_t met = 0;

    for (size_t i = first; i < last; i++) {
        const struct ray_single *s = &log->singles[i];
        const struct RTCRay ray = ray_from(s->origin, s->dir, s->tnear, s->tfar);
        query_init(r, &q);
        met += s->blocked ? is_blocked(r, &q, ray) : first_hit(r, &q, ray, &hit);
    }
    return met;
}

static void note_single(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float tfar,
                        bool blocked)
{
    if (r->log && r->log->single_count < r->log->single_capacity)
        r->log->singles[r->log->single_count++] = (struct ray_single){ origin, dir, tnear, tfar, blocked };
}

bool rays_intersect(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, struct hit *out)
{
    struct query q;

    note_single(r, origin, dir, tnear, INFINITY, false);
    query_init(r, &q);
    return first_hit(r, &q, ray_from(origin, dir, tnear, INFINITY), out);
}

bool rays_see(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float angle, struct hit *out,
              bool *varies)
{
    struct query q;

    note_single(r, origin, dir, tnear, INFINITY, false);
    query_init(r, &q);
    q.seen = true;
    q.angle = angle;
    q.varies = INFINITY;
    const bool met = first_hit(r, &q, ray_from(origin, dir, tnear, INFINITY), out);
    /* Beyond the hit, how many candidates Embree has asked about depends on its tree. */
    *varies = q.varies < INFINITY && (!met || q.varies <= out->t);
    return met;
}

bool rays_have_holes(const struct rays *r)
{
    return r->has_masks;
}

bool rays_blocked(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float tfar)
{
    struct query q;

    note_single(r, origin, dir, tnear, tfar, true);
    query_init(r, &q);
    return is_blocked(r, &q, ray_from(origin, dir, tnear, tfar));
}
