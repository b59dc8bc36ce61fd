// Depth images by Embree 3, for measure.py: one ray at a time and in packets of 16, on one thread.
//
// The rays are those of nbp_env: through pixel centres, 1 along the optical axis, so that their parameter is the depth.

#include <embree3/rtcore.h>
#include <cstring>

struct Camera {
    int width, height;
    float focal, near, range;
};

struct Pose {
    float position[3], forward[3], right[3];
};

static const unsigned NONE = RTC_INVALID_GEOMETRY_ID;

struct Direction {
    float x, y, z;
    Direction(const Camera& camera, const Pose& pose, int col, int row) {
        float right = (col + 0.5f - camera.width / 2.0f) / camera.focal;
        float down = (row + 0.5f - camera.height / 2.0f) / camera.focal;
        x = pose.forward[0] + pose.right[0] * right;
        y = pose.forward[1] + pose.right[1] * right - down;
        z = pose.forward[2] + pose.right[2] * right;
    }
};

extern "C" {

// The scene of a mesh, built at the highest quality: the slowest to build and the fastest to trace.
RTCScene embree_open(const float* vertices, size_t vertex_count, const unsigned* triangles, size_t triangle_count) {
    RTCDevice device = rtcNewDevice("threads=1");
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    size_t corner = 3 * sizeof(float), triangle = 3 * sizeof(unsigned);
    void* v = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, corner, vertex_count);
    void* t = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, triangle, triangle_count);
    memcpy(v, vertices, corner * vertex_count);
    memcpy(t, triangles, triangle * triangle_count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcCommitScene(scene);
    return scene;
}

// Whether this machine and this build have packets of 16 in hardware.
int embree_has_packets() {
    RTCDevice device = rtcNewDevice("threads=1");
    int has = rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED);
    rtcReleaseDevice(device);
    return has;
}

void embree_single(RTCScene scene, const Camera* camera, const Pose* pose, float* depth) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    for (int row = 0; row < camera->height; row++)
        for (int col = 0; col < camera->width; col++) {
            Direction direction(*camera, *pose, col, row);
            RTCRayHit ray = {};
            ray.ray.org_x = pose->position[0], ray.ray.org_y = pose->position[1], ray.ray.org_z = pose->position[2];
            ray.ray.dir_x = direction.x, ray.ray.dir_y = direction.y, ray.ray.dir_z = direction.z;
            ray.ray.tnear = camera->near, ray.ray.tfar = camera->range;
            ray.ray.mask = ~0u;
            ray.hit.geomID = NONE;
            rtcIntersect1(scene, &context, &ray);
            depth[row * camera->width + col] = ray.hit.geomID == NONE ? 0.0f : ray.ray.tfar;
        }
}

// Packets of 4 by 4 pixels; width and height are multiples of 4.
void embree_packets(RTCScene scene, const Camera* camera, const Pose* pose, float* depth) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    alignas(64) int valid[16];
    for (int& lane : valid) lane = -1;
    for (int row = 0; row < camera->height; row += 4)
        for (int col = 0; col < camera->width; col += 4) {
            RTCRayHit16 rays;
            for (int n = 0; n < 16; n++) {
                Direction direction(*camera, *pose, col + n % 4, row + n / 4);
                rays.ray.org_x[n] = pose->position[0], rays.ray.org_y[n] = pose->position[1];
                rays.ray.org_z[n] = pose->position[2];
                rays.ray.dir_x[n] = direction.x, rays.ray.dir_y[n] = direction.y, rays.ray.dir_z[n] = direction.z;
                rays.ray.tnear[n] = camera->near, rays.ray.tfar[n] = camera->range;
                rays.ray.time[n] = 0.0f, rays.ray.mask[n] = ~0u, rays.ray.id[n] = n, rays.ray.flags[n] = 0;
                rays.hit.geomID[n] = NONE, rays.hit.instID[0][n] = NONE;
            }
            rtcIntersect16(valid, scene, &context, &rays);
            for (int n = 0; n < 16; n++)
                depth[(row + n / 4) * camera->width + col + n % 4] = rays.hit.geomID[n] == NONE ? 0.0f : rays.ray.tfar[n];
        }
}
}
