// Primary rays a second of kmb_city_visit_cast against BlockMaps and of Embree against the triangles that these were built from, one thread each.
//
// embree FOLDER [TRIANGLES.bin]
//
// Without a file of triangles (nine doubles each): one block of 64 m with more than a million of them.

#include <embree3/rtcore.h>
#include <kimberlite.h>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

namespace {

constexpr int kViews = 8, kPixels = 512, kRepeats = 3, kBatch = 8 * kPixels;

void require(kmb_status status, const char *what) {
    if (status == KMB_OK) return;
    std::fprintf(stderr, "embree: %s: %s\n", what, kmb_last_error());
    std::exit(2);
}

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// 24 boxes whose faces are divided into squares of two triangles.
std::vector<double> dense_block() {
    const int divisions = 68;
    std::vector<double> corners;
    for (int box = 0; box < 24; box++) {
        double low[3] = {1 + 10.4 * (box % 6), 2 + 15.5 * (box / 6), 0}, size[3] = {8, 12, 6.0 + (box * 7) % 24};
        for (int face = 0; face < 5; face++) {
            int fixed = face < 4 ? face / 2 : 2, u = fixed == 0 ? 1 : 0, v = fixed == 2 ? 1 : 2;
            double at = low[fixed] + (face == 4 || face % 2 ? size[fixed] : 0);
            auto add = [&](int i, int j) {
                double place[3];
                place[fixed] = at, place[u] = low[u] + size[u] * i / divisions, place[v] = low[v] + size[v] * j / divisions;
                corners.insert(corners.end(), place, place + 3);
            };
            for (int i = 0; i < divisions; i++)
                for (int j = 0; j < divisions; j++) {
                    add(i, j), add(i + 1, j), add(i + 1, j + 1);
                    add(i, j), add(i + 1, j + 1), add(i, j + 1);
                }
        }
    }
    return corners;
}

std::vector<double> read_corners(const char *path) {
    std::FILE *file = std::fopen(path, "rb");
    if (!file) std::perror(path), std::exit(2);
    std::fseek(file, 0, SEEK_END);
    std::vector<double> corners(size_t(std::ftell(file)) / sizeof(double));
    std::rewind(file);
    if (std::fread(corners.data(), sizeof(double), corners.size(), file) != corners.size()) std::exit(2);
    std::fclose(file);
    return corners;
}

/// Pictures from around the city, which fills most of them.
std::vector<kmb_ray> primary(const kmb_city_info &info) {
    std::vector<kmb_ray> rays;
    for (int view = 0; view < kViews; view++) {
        double turn = 0.3 + 2 * M_PI * view / kViews, rise = view % 3 == 0 ? 0.35 : view % 3 == 1 ? 0.6 : 1.2;
        double towards[3] = {std::cos(turn), std::sin(turn), rise}, length = std::sqrt(1 + rise * rise), eye[3];
        double middle[3] = {info.corner[0] + info.side / 2, info.corner[1] + info.side / 2, info.heights[0]};
        for (int axis = 0; axis < 3; axis++) eye[axis] = middle[axis] + (towards[axis] /= length) * 1.6 * info.side;
        double right[3] = {-std::sin(turn), std::cos(turn), 0};
        double up[3] = {towards[1] * right[2] - towards[2] * right[1], towards[2] * right[0] - towards[0] * right[2],
                        towards[0] * right[1] - towards[1] * right[0]};
        for (int pixel = 0; pixel < kPixels * kPixels; pixel++) {
            double x = ((pixel % kPixels + 0.5) / kPixels * 2 - 1) * 0.28, y = ((pixel / kPixels + 0.5) / kPixels * 2 - 1) * 0.28;
            kmb_ray ray{};
            ray.struct_size = sizeof ray, ray.longest = std::numeric_limits<double>::infinity();
            for (int axis = 0; axis < 3; axis++) {
                ray.origin[axis] = eye[axis];
                ray.direction[axis] = right[axis] * x + up[axis] * y - towards[axis];
            }
            rays.push_back(ray);
        }
    }
    return rays;
}

kmb_city *build(const std::vector<double> &corners, const std::string &path) {
    kmb_city_options options{};
    options.struct_size = sizeof options;
    kmb_city_paint paint{};
    paint.struct_size = sizeof paint, paint.kind = KMB_PAINT_PLAIN, paint.colour[0] = 200;
    kmb_city_builder *builder = nullptr;
    kmb_city *city = nullptr;
    require(kmb_city_builder_create(&options, &builder), "a builder");
    require(kmb_city_builder_add_triangles(builder, corners.size() / 9, corners.data(), &paint), "triangles");
    require(kmb_city_builder_build(builder, path.c_str(), nullptr, nullptr, nullptr), "a build");
    kmb_city_builder_destroy(builder);
    require(kmb_city_open(path.c_str(), KMB_ACCESS_MAP, &city), "opening");
    return city;
}

/// All finest blocks: no tolerance, from so far above that all is seen.
kmb_city_visit *visit_all(const kmb_city *city, const kmb_city_info &info) {
    kmb_city_visit *visit = nullptr;
    require(kmb_city_visit_create(city, 0, &visit), "a visit");
    double scale = 2 / info.side, x = info.corner[0] + info.side / 2, y = info.corner[1] + info.side / 2;
    kmb_view view{};
    view.struct_size = sizeof view, view.viewport[0] = view.viewport[1] = 1024;
    view.eye[0] = x, view.eye[1] = y, view.eye[2] = info.heights[1] + 1000;
    double matrix[16] = {scale * 0.9, 0, 0, 0, 0, scale * 0.9, 0, 0, 0, 0, 1e-6, 0, -scale * 0.9 * x, -scale * 0.9 * y, 0, 1};
    std::copy(matrix, matrix + 16, view.world_to_clip);
    require(kmb_city_visit_update(visit, &view, nullptr, nullptr), "an update");
    return visit;
}

/// With the ground that the BlockMaps have: a plane at their lowest height.
RTCScene scene_of(RTCDevice device, std::vector<double> corners, const kmb_city_info &info) {
    double x = info.corner[0], y = info.corner[1], z = info.heights[0], side = info.side;
    double ground[18] = {x, y, z, x + side, y, z, x + side, y + side, z, x, y, z, x + side, y + side, z, x, y + side, z};
    corners.insert(corners.end(), ground, ground + 18);
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    size_t triangles = corners.size() / 9;
    auto *vertices = static_cast<float *>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3 * triangles));
    auto *indices = static_cast<unsigned *>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles));
    for (size_t i = 0; i < corners.size(); i++) vertices[i] = float(corners[i] - (i % 3 < 2 ? info.corner[i % 3] : 0));
    for (unsigned i = 0; i < 3 * triangles; i++) indices[i] = i;
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

/// Batch by batch, so that hits stay as near to the processor as Embree's.
size_t cast(const kmb_city_visit *visit, const std::vector<kmb_ray> &rays) {
    static kmb_city_hit found[kBatch];
    size_t hits = 0;
    for (size_t first = 0; first < rays.size(); first += kBatch) {
        found[0].struct_size = sizeof found[0];
        require(kmb_city_visit_cast(visit, kBatch, rays.data() + first, found), "casting");
        hits += size_t(std::count_if(found, found + kBatch, [](const kmb_city_hit &hit) { return hit.node != KMB_NO_NODE; }));
    }
    return hits;
}

size_t intersect(RTCScene scene, const std::vector<kmb_ray> &rays, const kmb_city_info &info) {
    size_t hits = 0;
    for (const kmb_ray &ray : rays) {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        RTCRayHit query{};
        query.ray.org_x = float(ray.origin[0] - info.corner[0]), query.ray.org_y = float(ray.origin[1] - info.corner[1]);
        query.ray.org_z = float(ray.origin[2]), query.ray.dir_x = float(ray.direction[0]);
        query.ray.dir_y = float(ray.direction[1]), query.ray.dir_z = float(ray.direction[2]);
        query.ray.tfar = std::numeric_limits<float>::infinity(), query.ray.mask = ~0u;
        query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(scene, &context, &query);
        hits += query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
    return hits;
}

}  // namespace

int main(int count, char **words) {
    if (count < 2) return std::fprintf(stderr, "embree FOLDER [TRIANGLES.bin]\n"), 2;
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    std::vector<double> corners = count > 2 ? read_corners(words[2]) : dense_block();
    kmb_city *city = build(corners, std::string(words[1]) + "/embree.kmb");
    kmb_city_info info{};
    info.struct_size = sizeof info;
    require(kmb_city_describe(city, &info), "describing");
    kmb_city_visit *visit = visit_all(city, info);
    std::vector<kmb_ray> rays = primary(info);
    RTCDevice device = rtcNewDevice("threads=1,set_affinity=0");
    RTCScene scene = scene_of(device, corners, info);
    double ours = 1e9, theirs = 1e9;
    size_t hits = 0, met = 0;
    for (int repeat = 0; repeat < kRepeats; repeat++) {
        auto start = std::chrono::steady_clock::now();
        met = cast(visit, rays);
        ours = std::min(ours, seconds_since(start));
        start = std::chrono::steady_clock::now();
        hits = intersect(scene, rays, info);
        theirs = std::min(theirs, seconds_since(start));
    }
    double millions = double(rays.size()) / 1e6;
    std::printf("%zu triangles, %u blocks of %u texels, %.1f M primary rays: %zu meet BlockMaps, %zu triangles\n", corners.size() / 9, info.nodes,
                info.side_texels, millions, met, hits);
    std::printf("BlockMaps %.2f M rays/s, Embree %.2f M rays/s: %.2f\n", millions / ours, millions / theirs, theirs / ours);
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
    kmb_city_visit_destroy(visit);
    kmb_city_close(city);
}
