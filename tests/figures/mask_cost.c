/* What masks cost: shadow rays from surfaces with holes, traced through it as it is and as if its materials had no
 * holes, in turns, and first hits of rays from outside. For the scene files that are named. Processor time of one
 * thread, so that others at work disturb little. */
#include "base/clock.h"
#include "base/log.h"
#include "base/rng.h"
#include "import/reader/reader.h"
#include "scene/geometry/rays.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PAIRS 15
#define PACKETS 8192

struct load {
    struct ray16 *packets;
    struct ray_single *singles; /* the rays that found the packets' origins */
};

static double processor_s(void)
{
    struct timespec t;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *v)
{
    qsort(v, PAIRS, sizeof(*v), by_value);
    return v[PAIRS / 2];
}

static struct vec3 on_sphere(struct rng *r)
{
    const double z = 2.0 * rng_next(r) - 1.0, a = 2.0 * acos(-1.0) * rng_next(r), s = sqrt(1.0 - z * z);
    return vec3_make((float)(s * cos(a)), (float)(s * sin(a)), (float)z);
}

/* A ray through the scene's box from outside. */
static struct ray_single random_ray(const struct scene *s, struct rng *r)
{
    const struct vec3 half = vec3_scale(vec3_sub(s->high, s->low), 0.5f);
    const struct vec3 centre = vec3_add(s->low, half);
    const float radius = vec3_length(half);
    const struct vec3 origin = vec3_add(centre, vec3_scale(on_sphere(r), 1.5f * radius));
    const struct vec3 target =
        vec3_add(s->low, vec3_mul(vec3_scale(half, 2.0f),
                                  vec3_make((float)rng_next(r), (float)rng_next(r), (float)rng_next(r))));

    return (struct ray_single){ origin, vec3_normalize(vec3_sub(target, origin)), 0.0f, INFINITY, false };
}

/* Sixteen shadow rays, cosine-weighted, from a hit. */
static void shadow_rays(const struct surface *at, struct rng *r, struct ray16 *p)
{
    const struct vec3 from = vec3_add(at->position, vec3_scale(at->geometric, at->offset));

    memset(p, 0, sizeof(*p));
    for (int l = 0; l < PACKET; l++) {
        const struct vec3 d = vec3_normalize(vec3_add(at->geometric, vec3_scale(on_sphere(r), 0.999f)));
        p->org_x[l] = from.x;
        p->org_y[l] = from.y;
        p->org_z[l] = from.z;
        p->dir_x[l] = d.x;
        p->dir_y[l] = d.y;
        p->dir_z[l] = d.z;
        p->tfar[l] = INFINITY;
        p->mask[l] = UINT32_MAX;
    }
}

/* False: too few rays meet surfaces with holes. */
static bool make_load(const struct scene *s, const struct rays *r, struct load *load)
{
    struct rng random = { 1 };

    uint32_t i = 0;

    for (uint32_t tries = 0; i < PACKETS && tries < 1000 * PACKETS; tries++) {
        struct hit h;
        struct surface at;
        const struct ray_single ray = random_ray(s, &random);
        if (!rays_intersect(r, ray.origin, ray.dir, 0.0f, &h) ||
            s->materials[s->meshes[h.mesh].material].alpha_mode == ALPHA_OPAQUE)
            continue;
        rays_surface(r, &h, vec3_scale(ray.dir, -1.0f), &at);
        load->singles[i] = ray;
        shadow_rays(&at, &random, &load->packets[i++]);
    }
    return i == PACKETS;
}

/* Nanoseconds per ray; *stopped: the share that met something. */
static double time_packets(const struct rays *r, const struct load *load, double *stopped)
{
    static const int32_t all[PACKET] = { -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1 };
    uint64_t met = 0;
    const double from = processor_s();

    for (int i = 0; i < PACKETS; i++) {
        struct ray16 p = load->packets[i];
        rays_occluded16(r, RAYS_APART, all, &p);
        for (int l = 0; l < PACKET; l++)
            met += p.tfar[l] < 0.0f;
    }
    *stopped = (double)met / (PACKETS * PACKET);
    return 1e9 * (processor_s() - from) / (PACKETS * PACKET);
}

static double time_singles(const struct rays *r, const struct load *load)
{
    struct hit h;
    const double from = processor_s();

    for (int i = 0; i < PACKETS; i++)
        (void)rays_intersect(r, load->singles[i].origin, load->singles[i].dir, 0.0f, &h);
    return 1e9 * (processor_s() - from) / PACKETS;
}

static void compare(struct scene *s, const struct rays *masked, const struct rays *opaque, struct load *load)
{
    double shadow[2][PAIRS], first[2][PAIRS], stopped[2];

    if (!make_load(s, masked, load)) {
        printf("hardly any ray meets a surface with holes\n");
        return;
    }
    for (int i = 0; i < 2 * PAIRS; i++) {
        const struct rays *r = i % 2 ? masked : opaque;
        shadow[i % 2][i / 2] = time_packets(r, load, &stopped[i % 2]);
        first[i % 2][i / 2] = time_singles(r, load);
    }
    const double o = median(shadow[0]), m = median(shadow[1]), fo = median(first[0]), fm = median(first[1]);
    printf("shadow rays %.0f ns opaque (%.2f stopped), %.0f ns masked (%.2f stopped): %.2f; first hits %.0f and %.0f "
           "ns: %.2f\n",
           o, stopped[0], m, stopped[1], m / o, fo, fm, fm / fo);
}

static int measure(const char *path)
{
    struct reason why = { "" };
    struct scene *s[2] = { NULL };
    struct load load = { aligned_alloc(64, PACKETS * sizeof(struct ray16)),
                         malloc(PACKETS * sizeof(struct ray_single)) };

    for (int k = 0; k < 2; k++) {
        if (scene_load(path, NULL, &s[k], NULL, &why)) {
            fprintf(stderr, "%s\n", why.text);
            return 1;
        }
    }
    for (size_t i = 0; i < s[0]->material_count; i++) {
        s[0]->materials[i].alpha_mode = ALPHA_OPAQUE;
        s[0]->materials[i].thin = false;
    }
    const double from = clock_seconds();
    struct rays *opaque = rays_create_for(s[0], cpu_best());
    const double between = clock_seconds();
    struct rays *masked = rays_create_for(s[1], cpu_best());
    printf("%s: %llu triangles, built in %.2f and %.2f s; ", path, (unsigned long long)s[0]->triangle_count,
           between - from, clock_seconds() - between);
    if (opaque && masked && load.packets && load.singles)
        compare(s[1], masked, opaque, &load);
    rays_destroy(opaque);
    rays_destroy(masked);
    for (int k = 0; k < 2; k++)
        scene_destroy(s[k]);
    free(load.packets);
    free(load.singles);
    return 0;
}

int main(int argc, char **argv)
{
    log_init("mask_cost", LOG_ERROR);
    if (argc < 2) {
        fprintf(stderr, "usage: mask_cost SCENE...\n");
        return 2;
    }
    for (int i = 1; i < argc; i++) {
        if (measure(argv[i]))
            return 1;
    }
    return 0;
}
