#include "scene/rays.h"

#include "base/log.h"
#include "base/mem.h"
#include "scene/coverage.h"

#include <embree3/rtcore.h>
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

/* What the filter functions of masked meshes need to know of a query. Every query has one. */
struct query {
    struct RTCIntersectContext context; /* first: Embree passes its address on */
    float angle;                        /* rays_see: between neighbouring rays, radians; else 0 */
    bool seen;                          /* by rays_see: fractional coverage is left to the caller */
    float varies;                       /* the nearest distance where a mask has holes and surface within `angle` */
};

struct rays {
    const struct scene *scene;
    struct mask *masks; /* [mesh_count]; filled for the meshes with holes */
    RTCDevice device;
    RTCScene bvh;
    int width;           /* lanes of the widest packets that Embree traces natively: 16, 8 or 4 */
    struct ray_log *log; /* NULL except in benchmarks */
};

static void log_embree_error(void *user, enum RTCError code, const char *text)
{
    (void)user;
    log_error("Embree: error %d: %s", (int)code, text);
}

/* Rows of Embree's packets of any width: [row * N + lane]. */
enum { RAY_ORG = 0, RAY_DIR = 4, RAY_TFAR = 8, HIT_NG = 0, HIT_U = 3, HIT_V = 4, HIT_TRIANGLE = 5 };

static float square(float x)
{
    return x * x;
}

/* The width on the surface, in m, of a ray of rays_see, whose direction is unit. */
static float width_at(const struct query *q, const float *ray, const float *hit)
{
    const float *d = ray + RAY_DIR, *n = hit + HIT_NG;
    const float along = fabsf(d[0] * n[0] + d[1] * n[1] + d[2] * n[2]);

    return ray[RAY_TFAR] * q->angle * sqrtf(square(n[0]) + square(n[1]) + square(n[2])) / along;
}

/* Whether there is surface where lane i of n meets a triangle. During the call tfar is the distance of the hit. */
static bool meets_surface(const struct mask *m, struct query *q, const float *ray, const float *hit, size_t n, size_t i)
{
    const float *o = ray + RAY_ORG * n + i, *d = ray + RAY_DIR * n + i;
    const float origin[3] = { o[0], o[n], o[2 * n] }, dir[3] = { d[0], d[n], d[2 * n] };
    const float u = hit[HIT_U * n + i], v = hit[HIT_V * n + i];
    uint32_t triangle;

    memcpy(&triangle, hit + HIT_TRIANGLE * n + i, sizeof(triangle));
    if (q->seen) { /* one ray: n is 1 */
        if (m->material->alpha_mode != ALPHA_MASK)
            return true;
        if (ray[RAY_TFAR] < q->varies && mask_varies(m, triangle, u, v, width_at(q, ray, hit)))
            q->varies = ray[RAY_TFAR];
        return mask_covers_seen(m, triangle, u, v);
    }
    return mask_covers(m, triangle, u, v, origin, dir);
}

/* Embree's filter function of meshes with holes: drops the hits that meet one. It may be called more than once for a
 * ray and a triangle. */
static void drop_holes(const struct RTCFilterFunctionNArguments *a)
{
    const float *ray = (const float *)a->ray, *hit = (const float *)a->hit;

    for (size_t i = 0; i < a->N; i++) {
        if (a->valid[i] == -1 && !meets_surface(a->geometryUserPtr, (struct query *)a->context, ray, hit, a->N, i))
            a->valid[i] = 0;
    }
}

/* Meshes without holes have no filter and cost nothing; meshes without surface are left out. */
static void attach_mask(struct rays *r, RTCGeometry g, uint32_t mesh)
{
    mask_init(&r->masks[mesh], r->scene, mesh);
    rtcSetGeometryUserData(g, &r->masks[mesh]);
    rtcSetGeometryIntersectFilterFunction(g, drop_holes);
    rtcSetGeometryOccludedFilterFunction(g, drop_holes);
}

static bool attach_mesh(struct rays *r, uint32_t id, enum coverage coverage)
{
    const struct mesh *m = &r->scene->meshes[id];
    RTCGeometry g = rtcNewGeometry(r->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!g)
        return false;
    rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, m->positions, 0, 3 * sizeof(float),
                               m->vertex_count);
    rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, m->indices, 0, 3 * sizeof(uint32_t),
                               m->triangle_count);
    rtcSetGeometryBuildQuality(g, RTC_BUILD_QUALITY_HIGH);
    if (coverage == COVERAGE_PARTIAL)
        attach_mask(r, g, id);
    rtcCommitGeometry(g);
    rtcAttachGeometryByID(r->bvh, g, id);
    rtcReleaseGeometry(g); /* the scene now holds it */
    return true;
}

static bool attach_meshes(struct rays *r)
{
    const struct scene *s = r->scene;
    enum coverage *of = mem_alloc(s->material_count, sizeof(*of));
    bool good = of != NULL;

    r->masks = mem_alloc(s->mesh_count, sizeof(*r->masks));
    good &= r->masks != NULL;
    for (size_t i = 0; i < s->material_count && good; i++)
        of[i] = material_coverage(s, &s->materials[i]);
    for (size_t i = 0; i < s->mesh_count && good; i++) {
        const enum coverage coverage = of[s->meshes[i].material];
        if (coverage != COVERAGE_NONE)
            good = attach_mesh(r, (uint32_t)i, coverage);
    }
    mem_free(of);
    return good;
}

/* The widest packets with instructions of their own. Wider ones Embree 3 answers through its streams, which do not look
 * at `valid`. */
static int native_width(RTCDevice device)
{
    if (rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED))
        return 16;
    return rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) ? 8 : 4;
}

struct rays *rays_create_for(const struct scene *scene, enum cpu_level level)
{
    static const char *const config[CPU_LEVELS] = {
        [CPU_BASELINE] = "verbose=0,isa=sse2",
        [CPU_V3] = "verbose=0,isa=avx2",
        [CPU_V4] = "verbose=0",
    };
    struct rays *r = mem_alloc(1, sizeof(*r));
    if (!r)
        return NULL;
    r->scene = scene;
    r->device = rtcNewDevice(config[level]);
    if (!r->device) {
        log_error("Embree: cannot create a device, error %d", (int)rtcGetDeviceError(NULL));
        goto failed;
    }
    rtcSetDeviceErrorFunction(r->device, log_embree_error, NULL);
    r->width = native_width(r->device);
    r->bvh = rtcNewScene(r->device);
    if (!r->bvh)
        goto failed;
    rtcSetSceneFlags(r->bvh, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(r->bvh, RTC_BUILD_QUALITY_HIGH);
    if (!attach_meshes(r))
        goto failed;
    rtcCommitScene(r->bvh);
    if (rtcGetDeviceError(r->device) != RTC_ERROR_NONE)
        goto failed;
    return r;
failed:
    rays_destroy(r);
    return NULL;
}

struct rays *rays_create(const struct scene *scene)
{
    return rays_create_for(scene, cpu_best());
}

void rays_destroy(struct rays *r)
{
    if (!r)
        return;
    if (r->bvh)
        rtcReleaseScene(r->bvh);
    if (r->device)
        rtcReleaseDevice(r->device);
    mem_free(r->masks);
    mem_free(r);
}

static void set_spread(struct query *q, enum ray_spread spread)
{
    q->context.flags =
        spread == RAYS_TOGETHER ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
}

static void query_init(struct query *q)
{
    rtcInitIntersectContext(&q->context);
    q->seen = false;
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
    struct RTCIntersectContext *context = &q->context;
    struct RTCRay8 eight;
    struct RTCRay4 four;

    if (r->width == 16) {
        rtcOccluded16(valid, r->bvh, context, (struct RTCRay16 *)packet);
        return;
    }
    for (int first = 0; first < PACKET; first += r->width) {
        void *narrow = r->width == 8 ? (void *)&eight : (void *)&four;

        narrow_to(packet, first, r->width, narrow);
        if (r->width == 8)
            rtcOccluded8(valid + first, r->bvh, context, &eight);
        else
            rtcOccluded4(valid + first, r->bvh, context, &four);
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
    query_init(&q);
    set_spread(&q, spread);
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

    query_init(&q);
    for (size_t i = first; i < last; i++) {
        struct ray16 packet = log->packets[i];
        set_spread(&q, log->spread[i]);
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

    rtcIntersect1(r->bvh, &q->context, &h);
    if (h.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    *out = (struct hit){ h.ray.tfar, h.hit.geomID, h.hit.primID, h.hit.u, h.hit.v };
    return true;
}

static bool is_blocked(const struct rays *r, struct query *q, struct RTCRay ray)
{
    rtcOccluded1(r->bvh, &q->context, &ray);
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
        query_init(&q);
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
    query_init(&q);
    return first_hit(r, &q, ray_from(origin, dir, tnear, INFINITY), out);
}

bool rays_see(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float angle, struct hit *out,
              bool *varies)
{
    struct query q;

    note_single(r, origin, dir, tnear, INFINITY, false);
    query_init(&q);
    q.seen = true;
    q.angle = angle;
    q.varies = INFINITY;
    const bool met = first_hit(r, &q, ray_from(origin, dir, tnear, INFINITY), out);
    /* Beyond the hit, how many candidates Embree has asked about depends on its tree. */
    *varies = q.varies < INFINITY && (!met || q.varies <= out->t);
    return met;
}

bool rays_blocked(const struct rays *r, struct vec3 origin, struct vec3 dir, float tnear, float tfar)
{
    struct query q;

    note_single(r, origin, dir, tnear, tfar, true);
    query_init(&q);
    return is_blocked(r, &q, ray_from(origin, dir, tnear, tfar));
}

/* Bounds the distance of a point, computed on a triangle and rounded to float, from the triangle's plane as a ray query
 * sees it, along the unit normal n: a running error bound [Higham 2002, section 3.3] with u = 2^-24 per rounding.
 *  - The point: each coordinate is rounded once when stored and once when offset: 2 u |n_i| |p_i|.
 *  - The query computes (v - o).N with N = e1 x e2 in float. Rounding v - o gives u |n_i| D_i, where D_i is the largest
 *    distance of a vertex along axis i; the dot product adds at most 3 u |n_i| D_i; each component of N has an error of
 *    at most 4 u A_i, A = |e1| x |e2| with plus instead of minus: 4 u A_i D_i / |N|.
 * The bound is doubled for triangles in the same plane whose vertices are further away. It vanishes with the point's
 * height for planes perpendicular to an axis, so that a huge ground plane does not need a huge offset. */
static double plane_doubt(const double v[3][3], const double p[3], const double n[3], double n_length)
{
    const double u = 0x1p-24;
    double doubt = 0.0;
    double e1[3], e2[3];

    for (int i = 0; i < 3; i++) {
        e1[i] = fabs(v[1][i] - v[0][i]);
        e2[i] = fabs(v[2][i] - v[0][i]);
    }
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double area = e1[j] * e2[k] + e1[k] * e2[j];
        const double reach = fmax(fabs(v[0][i] - p[i]), fmax(fabs(v[1][i] - p[i]), fabs(v[2][i] - p[i])));
        doubt += u * (2.0 * fabs(n[i]) * fabs(p[i]) + 4.0 * fabs(n[i]) * reach + 4.0 * area * reach / n_length);
    }
    return 2.0 * doubt;
}

/* The interpolated normal, or `geometric` if there is none. */
static struct vec3 shading_normal(const struct mesh *m, const uint32_t *t, const double weight[3],
                                  struct vec3 geometric)
{
    double n[3] = { 0.0, 0.0, 0.0 };

    if (!m->normals)
        return geometric;
    for (int k = 0; k < 3; k++) {
        const float *vn = m->normals + 3 * (size_t)t[k];
        for (int i = 0; i < 3; i++)
            n[i] += weight[k] * vn[i];
    }
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(length > 1e-3))
        return geometric;
    const struct vec3 s = vec3_make((float)(n[0] / length), (float)(n[1] / length), (float)(n[2] / length));
    return vec3_dot(s, geometric) < 0.0f ? vec3_scale(s, -1.0f) : s;
}

void rays_surface(const struct rays *r, const struct hit *h, struct vec3 towards, struct surface *out)
{
    const struct mesh *m = &r->scene->meshes[h->mesh];
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    const double weight[3] = { 1.0 - (double)h->u - (double)h->v, h->u, h->v };
    double v[3][3], p[3], n[3];

    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            v[k][i] = m->positions[3 * (size_t)t[k] + (size_t)i];
    }
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        p[i] = weight[0] * v[0][i] + weight[1] * v[1][i] + weight[2] * v[2][i];
        n[i] = (v[1][j] - v[0][j]) * (v[2][k] - v[0][k]) - (v[1][k] - v[0][k]) * (v[2][j] - v[0][j]);
    }
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int i = 0; i < 3; i++)
        n[i] /= length; /* > 0: meshes contain no degenerate triangles */
    const double side = n[0] * towards.x + n[1] * towards.y + n[2] * towards.z < 0.0 ? -1.0 : 1.0;

    out->position = vec3_make((float)p[0], (float)p[1], (float)p[2]);
    out->geometric = vec3_make((float)(side * n[0]), (float)(side * n[1]), (float)(side * n[2]));
    out->outside = side > 0.0;
    out->shading = shading_normal(m, t, weight, out->geometric);
    /* nonzero even if the bound is 0, so that the origin is off the plane and no product is denormal */
    out->offset = (float)(plane_doubt(v, p, n, length) + 1e-18);
    out->uv[0] = out->uv[1] = 0.0f;
    for (int k = 0; m->uvs && k < 3; k++) {
        out->uv[0] += (float)weight[k] * m->uvs[2 * (size_t)t[k]];
        out->uv[1] += (float)weight[k] * m->uvs[2 * (size_t)t[k] + 1];
    }
    out->colour = m->colours ? vec3_make(0.0f, 0.0f, 0.0f) : vec3_make(1.0f, 1.0f, 1.0f);
    for (int k = 0; m->colours && k < 3; k++) {
        const float *c = m->colours + 3 * (size_t)t[k];
        out->colour = vec3_add(out->colour, vec3_scale(vec3_make(c[0], c[1], c[2]), (float)weight[k]));
    }
}
