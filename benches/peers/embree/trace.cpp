// Times Embree, with one thread, on the rays of glasshouse's tracer in world space.
//
//   trace RAYS VERTICES NX NY [HITS] [--max-rays N]
//
// RAYS      f32 ox oy oz dx dy dz per ray, pixel by pixel, 256 rays per pixel
// VERTICES  f32 x y z per vertex of the NX x NY sheet, row by row; quads are split along the diagonal (i+1,j)-(i,j+1)
// HITS      f32 z of glasshouse's hit, per ray
//
// Prints one JSON object: Mrays per CPU second for each way to call Embree, the best of them, and the shares of rays
// that miss or disagree. The measurement favours Embree: packets are laid out before the clock starts, denormals are
// flushed, rays are flagged as coherent (up to 4 times as fast), triangles and quads and both build qualities are
// tried, and the fastest of three runs counts.

#include <embree3/rtcore.h>
#include <pmmintrin.h>
#include <time.h>
#include <xmmintrin.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

namespace {

constexpr size_t kPixel = 256;       // rays of one pixel
constexpr int kRuns = 3;
constexpr float kDiffers = 1e-3f;    // relative depth

[[noreturn]] void fail(const std::string& message) {
    std::fprintf(stderr, "error: %s\n", message.c_str());
    std::exit(1);
}

std::vector<float> read_floats(const char* path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) fail(std::string("cannot read ") + path);
    std::vector<float> values(static_cast<size_t>(file.tellg()) / sizeof(float));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(float)));
    return values;
}

double cpu_seconds() {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Chooses whole pixels, evenly spread, so that bundles stay complete.
std::vector<size_t> chosen_rays(size_t count, size_t most) {
    const size_t pixels = count / kPixel, wanted = std::max<size_t>(1, std::min(pixels, most / kPixel));
    std::vector<size_t> chosen;
    for (size_t k = 0; k < wanted; ++k)
        for (size_t s = 0; s < kPixel; ++s) chosen.push_back(k * pixels / wanted * kPixel + s);
    return chosen;
}

/// One way to build the sheet.
struct Way {
    bool quads, robust, high;
};

RTCScene build(RTCDevice device, const std::vector<float>& vertices, uint32_t nx, uint32_t ny, Way way) {
    const RTCBuildQuality quality = way.high ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM;
    RTCGeometry sheet = rtcNewGeometry(device, way.quads ? RTC_GEOMETRY_TYPE_QUAD : RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* points = rtcSetNewGeometryBuffer(sheet, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, size_t{nx} * ny);
    std::memcpy(points, vertices.data(), vertices.size() * sizeof(float));
    const size_t count = size_t{nx - 1} * (ny - 1);
    auto* corners = static_cast<uint32_t*>(
        way.quads ? rtcSetNewGeometryBuffer(sheet, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4, 16, count)
                  : rtcSetNewGeometryBuffer(sheet, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 2 * count));
    for (uint32_t j = 0; j + 1 < ny; ++j)
        for (uint32_t i = 0; i + 1 < nx; ++i) {
            const uint32_t a = j * nx + i, b = a + 1, c = a + nx, d = c + 1;
            // Embree splits a quad between its second and fourth corner, as the triangles do.
            const std::vector<uint32_t> order = way.quads ? std::vector<uint32_t>{a, b, d, c} : std::vector<uint32_t>{a, b, c, b, d, c};
            corners = std::copy(order.begin(), order.end(), corners);
        }
    rtcSetGeometryBuildQuality(sheet, quality);
    rtcCommitGeometry(sheet);
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, way.robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
    rtcSetSceneBuildQuality(scene, quality);
    rtcAttachGeometry(scene, sheet);
    rtcReleaseGeometry(sheet);
    rtcCommitScene(scene);
    return scene;
}

/// All rays, and the indices of those to trace.
struct Rays {
    const float* all;
    std::vector<size_t> chosen;
};

void intersect(RTCScene scene, RTCIntersectContext* context, RTCRayHit4* packet) {
    alignas(16) static const int valid[4] = {-1, -1, -1, -1};
    rtcIntersect4(valid, scene, context, packet);
}
void intersect(RTCScene scene, RTCIntersectContext* context, RTCRayHit8* packet) {
    alignas(32) static const int valid[8] = {-1, -1, -1, -1, -1, -1, -1, -1};
    rtcIntersect8(valid, scene, context, packet);
}
void intersect(RTCScene scene, RTCIntersectContext* context, RTCRayHit16* packet) {
    alignas(64) static const int valid[16] = {-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1};
    rtcIntersect16(valid, scene, context, packet);
}

template <class Ray>
void set_ray(Ray& ray, const float* r) {
    ray.org_x = r[0], ray.org_y = r[1], ray.org_z = r[2], ray.dir_x = r[3], ray.dir_y = r[4], ray.dir_z = r[5];
    ray.tnear = 0.0f, ray.tfar = INFINITY, ray.time = 0.0f, ray.mask = ~0u, ray.id = 0, ray.flags = 0;
}

/// Returns Mrays/s of packets of N; fills `depth` with each ray's z.
template <class Packet, size_t N>
double packets(RTCScene scene, const Rays& rays, std::vector<float>& depth) {
    std::vector<Packet> fresh(rays.chosen.size() / N);
    for (size_t p = 0; p < fresh.size(); ++p)
        for (size_t lane = 0; lane < N; ++lane) {
            const float* r = rays.all + 6 * rays.chosen[p * N + lane];
            auto& v = fresh[p].ray;
            v.org_x[lane] = r[0], v.org_y[lane] = r[1], v.org_z[lane] = r[2];
            v.dir_x[lane] = r[3], v.dir_y[lane] = r[4], v.dir_z[lane] = r[5];
            v.tnear[lane] = 0.0f, v.tfar[lane] = INFINITY, v.time[lane] = 0.0f, v.mask[lane] = ~0u, v.id[lane] = 0, v.flags[lane] = 0;
            fresh[p].hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
            fresh[p].hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
        }
    double best = INFINITY;
    std::vector<Packet> work;
    for (int run = 0; run < kRuns; ++run) {
        work = fresh;
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        const double start = cpu_seconds();
        for (Packet& packet : work) intersect(scene, &context, &packet);
        best = std::min(best, cpu_seconds() - start);
    }
    for (size_t p = 0; p < work.size(); ++p)
        for (size_t lane = 0; lane < N; ++lane) {
            const auto& v = work[p].ray;
            depth[p * N + lane] = v.org_z[lane] + v.tfar[lane] * v.dir_z[lane];
        }
    return static_cast<double>(rays.chosen.size()) / best * 1e-6;
}

/// Returns Mrays/s of single rays, or of streams of one pixel's rays; fills `depth` with each ray's z.
double singles(RTCScene scene, const Rays& rays, bool streams, std::vector<float>& depth) {
    std::vector<RTCRayHit> fresh(rays.chosen.size());
    for (size_t k = 0; k < fresh.size(); ++k) {
        set_ray(fresh[k].ray, rays.all + 6 * rays.chosen[k]);
        fresh[k].hit.geomID = RTC_INVALID_GEOMETRY_ID;
        fresh[k].hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    }
    double best = INFINITY;
    std::vector<RTCRayHit> work;
    for (int run = 0; run < kRuns; ++run) {
        work = fresh;
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        const double start = cpu_seconds();
        if (streams)
            for (size_t k = 0; k < work.size(); k += kPixel) rtcIntersect1M(scene, &context, &work[k], kPixel, sizeof(RTCRayHit));
        else
            for (RTCRayHit& ray : work) rtcIntersect1(scene, &context, &ray);
        best = std::min(best, cpu_seconds() - start);
    }
    for (size_t k = 0; k < work.size(); ++k) depth[k] = work[k].ray.org_z + work[k].ray.tfar * work[k].ray.dir_z;
    return static_cast<double>(rays.chosen.size()) / best * 1e-6;
}

/// Compares Embree's depths with glasshouse's, as JSON. A miss is not a difference: only glasshouse extends sheets.
std::string compare(const std::vector<float>& depth, const std::vector<float>& hits, const Rays& rays) {
    size_t missed = 0, differ = 0;
    for (size_t k = 0; k < depth.size(); ++k) {
        const float ours = hits.empty() ? NAN : hits[rays.chosen[k]];
        if (!std::isfinite(depth[k])) ++missed;
        else if (!hits.empty() && !(std::fabs(depth[k] - ours) <= kDiffers * ours)) ++differ;
    }
    const double n = static_cast<double>(depth.size());
    std::string text = ",\"missed_share\":" + std::to_string(static_cast<double>(missed) / n);
    if (!hits.empty()) {
        char share[40];
        std::snprintf(share, sizeof share, "%.3e", static_cast<double>(differ) / n);
        text += std::string(",\"differing_share\":") + share;
    }
    return text;
}

}  // namespace

int main(int argc, char** argv) {
    std::vector<const char*> files;
    size_t most = SIZE_MAX;
    for (int k = 1; k < argc; ++k) {
        if (!std::strcmp(argv[k], "--max-rays") && k + 1 < argc) most = std::strtoull(argv[++k], nullptr, 10);
        else files.push_back(argv[k]);
    }
    if (files.size() < 4) fail("usage: trace RAYS VERTICES NX NY [HITS] [--max-rays N]");
    const std::vector<float> all = read_floats(files[0]), vertices = read_floats(files[1]);
    const auto nx = static_cast<uint32_t>(std::atoi(files[2])), ny = static_cast<uint32_t>(std::atoi(files[3]));
    const std::vector<float> hits = files.size() > 4 ? read_floats(files[4]) : std::vector<float>();
    if (vertices.size() != size_t{nx} * ny * 3) fail("VERTICES does not hold NX * NY points");
    if (all.size() < 6 * kPixel || all.size() % (6 * kPixel)) fail("RAYS does not hold whole pixels of 256 rays");
    if (!hits.empty() && hits.size() != all.size() / 6) fail("HITS does not hold one depth per ray");
    const Rays rays{all.data(), chosen_rays(all.size() / 6, most)};

    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    RTCDevice device = rtcNewDevice("threads=1");
    std::printf("{\"program\":\"Embree %s\",\"rays\":%zu,\"ways\":[", RTC_VERSION_STRING, rays.chosen.size());
    double best = 0.0;
    std::vector<float> depth(rays.chosen.size());
    bool first = true;
    for (const Way way : {Way{false, false, false}, Way{false, false, true}, Way{true, false, false}, Way{true, false, true},
                          Way{false, true, false}, Way{false, true, true}, Way{true, true, false}, Way{true, true, true}}) {
        const double start = cpu_seconds();
        RTCScene scene = build(device, vertices, nx, ny, way);
        const double build_s = cpu_seconds() - start;
        for (const char* call : {"1", "4", "8", "16", "1M"}) {
            const std::string name = call;
            const double speed = name == "4"    ? packets<RTCRayHit4, 4>(scene, rays, depth)
                                 : name == "8"  ? packets<RTCRayHit8, 8>(scene, rays, depth)
                                 : name == "16" ? packets<RTCRayHit16, 16>(scene, rays, depth)
                                                : singles(scene, rays, name == "1M", depth);
            std::printf("%s{\"rays_a_call\":\"%s\",\"shape\":\"%s\",\"robust\":%s,\"quality\":\"%s\",\"build_cpu_s\":%.4f,"
                        "\"mrays_per_s\":%.4f%s}",
                        first ? "" : ",", call, way.quads ? "quads" : "triangles", way.robust ? "true" : "false",
                        way.high ? "high" : "medium", build_s, speed, compare(depth, hits, rays).c_str());
            std::fflush(stdout);
            best = std::max(best, speed);
            first = false;
        }
        rtcReleaseScene(scene);
    }
    std::printf("],\"best_mrays_per_s\":%.4f}\n", best);
    rtcReleaseDevice(device);
}
