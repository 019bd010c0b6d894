#include "base/log.h"
#include "base/mem.h"
#include "scene/geometry/embree.h"

static void log_embree_error(void *user, enum RTCError code, const char *text)
{
    (void)user;
    log_error("Embree: error %d: %s", (int)code, text);
}

/* Meshes without holes have no filter and no cost; meshes without surface are omitted. */
static void attach_mask(struct rays *r, RTCGeometry g, uint32_t mesh)
{
    rtcSetGeometryUserData(g, &r->masks[mesh]);
    rtcSetGeometryIntersectFilterFunction(g, rays_drop_holes);
    rtcSetGeometryOccludedFilterFunction(g, rays_drop_holes);
}

/* A mesh's own arrays, as geometry `id` of a BVH. */
static bool attach_triangles(struct rays *r, RTCScene bvh, uint32_t id, uint32_t mesh, enum coverage coverage)
{
    const struct mesh *m = &r->scene->meshes[mesh];
    RTCGeometry g = rtcNewGeometry(r->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!g)
        return false;
    rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, m->positions, 0, 3 * sizeof(float),
                               m->vertex_count);
    rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, m->indices, 0, 3 * sizeof(uint32_t),
                               m->triangle_count);
    rtcSetGeometryBuildQuality(g, RTC_BUILD_QUALITY_HIGH);
    if (coverage == COVERAGE_PARTIAL)
        attach_mask(r, g, mesh);
    rtcCommitGeometry(g);
    rtcAttachGeometryByID(bvh, g, id);
    rtcReleaseGeometry(g); /* the scene now holds it */
    return true;
}

static RTCScene new_bvh(RTCDevice device)
{
    RTCScene bvh = rtcNewScene(device);

    if (bvh) {
        rtcSetSceneFlags(bvh, RTC_SCENE_FLAG_ROBUST);
        rtcSetSceneBuildQuality(bvh, RTC_BUILD_QUALITY_HIGH);
    }
    return bvh;
}

/* The BVH of a placed mesh with arrays of its own, for its instances. */
static bool build_part(struct rays *r, uint32_t mesh, enum coverage coverage)
{
    if (!r->parts)
        r->parts = mem_alloc(r->scene->mesh_count, sizeof(*r->parts));
    if (!r->parts)
        return false;
    r->parts[mesh] = new_bvh(r->device);
    if (!r->parts[mesh] || !attach_triangles(r, r->parts[mesh], 0, mesh, coverage))
        return false;
    rtcCommitScene(r->parts[mesh]);
    return true;
}

static bool attach_instance(struct rays *r, uint32_t mesh)
{
    const struct mesh *m = &r->scene->meshes[mesh];
    RTCGeometry g = rtcNewGeometry(r->device, RTC_GEOMETRY_TYPE_INSTANCE);
    if (!g)
        return false;
    rtcSetGeometryInstancedScene(g, r->parts[m->source ? m->source - 1 : mesh]);
    rtcSetGeometryTransform(g, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, m->place.matrix);
    rtcCommitGeometry(g);
    rtcAttachGeometryByID(r->bvh, g, mesh);
    rtcReleaseGeometry(g);
    return true;
}

static bool attach_mesh(struct rays *r, uint32_t mesh, enum coverage coverage)
{
    const struct mesh *m = &r->scene->meshes[mesh];

    if (coverage == COVERAGE_NONE)
        return true;
    if (coverage == COVERAGE_PARTIAL) {
        mask_init(&r->masks[mesh], r->scene, mesh);
        r->has_masks = true;
        r->placed_masks |= m->placed;
    }
    if (!m->placed)
        return attach_triangles(r, r->bvh, mesh, mesh, coverage);
    return (m->source != 0 || build_part(r, mesh, coverage)) && attach_instance(r, mesh);
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
    for (size_t i = 0; i < s->mesh_count && good; i++)
        good = attach_mesh(r, (uint32_t)i, mesh_coverage(s, &s->meshes[i], of[s->meshes[i].material]));
    mem_free(of);
    return good;
}

/* The widest packets with native traversal. Embree 3 routes wider ones through its streams, which ignore `valid`. */
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
    r->bvh = new_bvh(r->device);
    if (!r->bvh || !attach_meshes(r))
        goto failed;
    rtcCommitScene(r->bvh);
    if (rtcGetDeviceError(r->device) != RTC_ERROR_NONE)
        goto failed;
    return r;
failed:
    rays_destroy(r);
    return NULL;
}

void rays_destroy(struct rays *r)
{
    if (!r)
        return;
    if (r->bvh)
        rtcReleaseScene(r->bvh);
    for (size_t i = 0; r->parts && i < r->scene->mesh_count; i++) {
        if (r->parts[i])
            rtcReleaseScene(r->parts[i]);
    }
    if (r->device)
        rtcReleaseDevice(r->device);
    mem_free(r->parts);
    mem_free(r->masks);
    mem_free(r);
}
