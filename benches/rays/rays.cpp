// Rays a second of kmb_ray_intersect and of Embree on the same triangles, one thread each, and whether both find the same hits.
//
// rays FILE.kmb [--rays N] [--repeats N] [--scenes mesh,robust,compact,grid] [--csv FILE]
//
// Prints one line a scene and kind of rays; --csv writes them to a file. Ends with 1 if a ray that Embree stops, and whose triangle it meets
// in double precision too, goes on in ours, or if a hit of ours is not on the surface.

#include <embree3/rtcore.h>
#include <kimberlite.h>
#include <malloc.h>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr size_t kChecked = 100000;

[[noreturn]] void fail(const std::string &what) {
    std::fprintf(stderr, "rays: %s\n", what.c_str());
    std::exit(2);
}

void require(kmb_status status, const char *what) {
    if (status != KMB_OK) fail(std::string(what) + ": " + kmb_last_error());
}

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Numbers that are the same in every run (SplitMix64).
struct Random {
    uint64_t state;
    double operator()() {
        uint64_t z = state += 0x9e3779b97f4a7c15;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
        z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
        return double((z ^ (z >> 31)) >> 11) * 0x1p-53;
    }
};

struct Vec {
    double x, y, z;
    Vec operator-(const Vec &o) const { return {x - o.x, y - o.y, z - o.z}; }
    Vec operator+(const Vec &o) const { return {x + o.x, y + o.y, z + o.z}; }
    Vec operator*(double s) const { return {x * s, y * s, z * s}; }
};
double dot(const Vec &a, const Vec &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec cross(const Vec &a, const Vec &b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
Vec normal(const Vec &a) { return a * (1 / std::sqrt(dot(a, a))); }

/// The finest surface: samples in world units, relative to the raster's middle.
struct Land {
    kmb_repository *repository = nullptr;
    kmb_repository_info info{};
    double middle[2];
    std::vector<double> heights;

    explicit Land(const char *path) {
        require(kmb_repository_open(path, nullptr, &repository), "opening");
        info.struct_size = sizeof info;
        require(kmb_repository_describe(repository, &info), "describing");
        for (int axis = 0; axis < 2; axis++) {
            double last = (axis == 0 ? info.width : info.height) - 1.0;
            middle[axis] = info.world_origin[axis] + info.world_step[axis] * last / 2;
        }
        heights.resize(size_t(info.width) * info.height);
        require(kmb_read_window(repository, info.levels, 0, 0, info.width, info.height, heights.data(), heights.size(), nullptr), "reading");
        for (double &height : heights) height = info.value_offset + info.value_scale * height;
    }
    Vec vertex(uint32_t index) const {
        double column = index % info.width, row = index / info.width;
        return {(column - (info.width - 1.0) / 2) * info.world_step[0], (row - (info.height - 1.0) / 2) * info.world_step[1], heights[index]};
    }
    double height(double x, double y) const {
        auto near = [](double place, uint32_t count) { return uint32_t(std::min(std::max(std::round(place), 0.0), count - 1.0)); };
        uint32_t column = near(x / info.world_step[0] + (info.width - 1.0) / 2, info.width);
        uint32_t row = near(y / info.world_step[1] + (info.height - 1.0) / 2, info.height);
        double found = heights[size_t(row) * info.width + column];
        return std::isnan(found) ? 0 : found;
    }
    Vec half() const { return {std::fabs(info.world_step[0]) * (info.width - 1) / 2, std::fabs(info.world_step[1]) * (info.height - 1) / 2, 0}; }
};

/// Triangles as the finest level has them: the diagonals of the cells turn from leaf to leaf.
std::vector<uint32_t> triangles(const Land &land) {
    const uint32_t width = land.info.width, cells = land.info.cells;
    std::vector<uint32_t> corners;
    corners.reserve(size_t(width) * land.info.height * 6);
    for (uint32_t row = 0; row + 1 < land.info.height; row++) {
        for (uint32_t column = 0; column + 1 < width; column++) {
            uint32_t a = row * width + column, b = a + 1, c = a + width, d = c + 1;
            bool main = (column / cells + row / cells) % 2 == 0;
            uint32_t both[2][3] = {{a, b, main ? d : c}, {main ? a : b, d, c}};
            for (auto &triangle : both) {
                bool drawn = true;
                for (uint32_t corner : triangle) drawn &= !std::isnan(land.heights[corner]);
                if (drawn) corners.insert(corners.end(), triangle, triangle + 3);
            }
        }
    }
    corners.shrink_to_fit();
    return corners;
}

/// A ray in floats, which both get.
struct Ray {
    float origin[3], direction[3];
    Vec at(double t) const { return Vec{origin[0], origin[1], origin[2]} + Vec{direction[0], direction[1], direction[2]} * t; }
};

Ray ray_of(const Vec &o, const Vec &d) { return {{float(o.x), float(o.y), float(o.z)}, {float(d.x), float(d.y), float(d.z)}}; }

struct Kind {
    const char *name;
    bool coherent;
    std::vector<Ray> rays;
};

/// A picture of the land, row by row: from 12 km (or an eighth of the land) beside its highest sample, 500 m above the ground there, towards it.
std::vector<Ray> picture(const Land &land, size_t count) {
    const int width = 1280, height = 1024;
    uint32_t top = 0;
    for (uint32_t i = 0; i < land.heights.size(); i++)
        if (!(land.heights[i] <= land.heights[top])) top = std::isnan(land.heights[i]) ? top : i;
    Vec summit = land.vertex(top), half = land.half();
    double away = std::min(12000.0, half.x / 4);
    Vec eye = summit + Vec{summit.x > 0 ? -away : away, summit.y > 0 ? -away / 2 : away / 2, 0};
    eye.z = std::max(land.height(eye.x, eye.y) + 500, summit.z);
    Vec forward = normal(summit - Vec{0, 0, 600} - eye), right = normal(cross(forward, {0, 0, 1})), up = cross(right, forward);
    std::vector<Ray> rays;
    int rows = int(std::min<size_t>(height, (count + width - 1) / width));
    for (int row = (height - rows) / 2; row < (height + rows) / 2; row++)
        for (int column = 0; column < width; column++) {
            double x = (column + 0.5) / width * 2 - 1, y = 1 - (row + 0.5) / height * 2, zoom = std::tan(0.5);
            rays.push_back(ray_of(eye, normal(forward + right * (x * zoom) + up * (y * zoom * height / width))));
        }
    return rays;
}

/// From anywhere up to 2000 m above the ground, to anywhere, or within 5 degrees of the horizontal.
std::vector<Ray> scattered(const Land &land, size_t count, bool grazing) {
    Random random{grazing ? 7u : 5u};
    Vec half = land.half();
    std::vector<Ray> rays;
    for (size_t i = 0; i < count; i++) {
        double x = half.x * (2 * random() - 1), y = half.y * (2 * random() - 1), z = land.height(x, y) + 1 + 2000 * random();
        double turn = 2 * M_PI * random(), rise = 2 * random() - 1;
        double dz = grazing ? std::sin(rise * M_PI / 36) : rise, flat = std::sqrt(1 - dz * dz);
        rays.push_back(ray_of({x, y, z}, {flat * std::cos(turn), flat * std::sin(turn), dz}));
    }
    return rays;
}

/// Distance of the hit, infinite where there is none.
struct Ours {
    kmb_query *query = nullptr;
    double middle[2];
    double distance(const Ray &ray) const {
        kmb_ray own{};
        own.struct_size = sizeof own;
        for (int axis = 0; axis < 3; axis++) {
            own.origin[axis] = ray.origin[axis] + (axis < 2 ? middle[axis] : 0);
            own.direction[axis] = ray.direction[axis];
        }
        own.longest = kInfinity;
        kmb_hit hit;
        hit.struct_size = sizeof hit;
        kmb_status status = kmb_ray_intersect(query, &own, &hit);
        if (status == KMB_OK) return hit.distance;
        if (status != KMB_OUTSIDE) require(status, "a ray");
        return kInfinity;
    }
};

std::atomic<int64_t> embree_bytes{0}, embree_peak{0};

bool count_bytes(void *, ssize_t bytes, bool) {
    int64_t now = embree_bytes += bytes;
    if (now > embree_peak) embree_peak = now;
    return true;
}

struct Scene {
    RTCDevice device;
    RTCScene scene;
    int64_t buffer_bytes = 0;
    double build_seconds;

    Scene(const Land &land, const std::string &name, const std::vector<float> &vertices, const std::vector<uint32_t> &corners) {
        embree_bytes = embree_peak = 0;
        device = rtcNewDevice(nullptr);
        if (!device) fail("no Embree device");
        rtcSetDeviceMemoryMonitorFunction(device, count_bytes, nullptr);
        auto start = std::chrono::steady_clock::now();
        scene = rtcNewScene(device);
        rtcSetSceneFlags(scene, name == "robust" ? RTC_SCENE_FLAG_ROBUST : name == "compact" ? RTC_SCENE_FLAG_COMPACT : RTC_SCENE_FLAG_NONE);
        RTCGeometry geometry = rtcNewGeometry(device, name == "grid" ? RTC_GEOMETRY_TYPE_GRID : RTC_GEOMETRY_TYPE_TRIANGLE);
        size_t count = land.heights.size();
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, vertices.data(), 0, 12, count);
        buffer_bytes = int64_t(count) * 12;
        if (name == "grid") {
            add_grids(geometry, land);
        } else {
            rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, corners.data(), 0, 12, corners.size() / 3);
            buffer_bytes += int64_t(corners.size()) * 4;
        }
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene);
        build_seconds = seconds_since(start);
        if (rtcGetDeviceError(device) != RTC_ERROR_NONE) fail("Embree could not build the scene");
    }
    ~Scene() {
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
    static void add_grids(RTCGeometry geometry, const Land &land) {
        const uint32_t side = land.info.cells;
        std::vector<RTCGrid> grids;
        for (uint32_t row = 0; row + 1 < land.info.height; row += side)
            for (uint32_t column = 0; column + 1 < land.info.width; column += side) {
                auto samples = [&](uint32_t from, uint32_t end) { return uint16_t(std::min(side, end - 1 - from) + 1); };
                grids.push_back({row * land.info.width + column, land.info.width, samples(column, land.info.width), samples(row, land.info.height)});
            }
        void *own = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof(RTCGrid), grids.size());
        std::memcpy(own, grids.data(), grids.size() * sizeof(RTCGrid));
    }
    static RTCRayHit query_of(const Ray &ray) {
        RTCRayHit query;
        query.ray.org_x = ray.origin[0], query.ray.org_y = ray.origin[1], query.ray.org_z = ray.origin[2];
        query.ray.dir_x = ray.direction[0], query.ray.dir_y = ray.direction[1], query.ray.dir_z = ray.direction[2];
        query.ray.tnear = 0, query.ray.tfar = std::numeric_limits<float>::infinity();
        query.ray.time = 0, query.ray.mask = ~0u, query.ray.id = 0, query.ray.flags = 0;
        query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        return query;
    }
    RTCRayHit meet(const Ray &ray, RTCIntersectContext &context) const {
        RTCRayHit query = query_of(ray);
        rtcIntersect1(scene, &context, &query);
        return query;
    }
};

RTCIntersectContext context_of(const Kind &kind) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = kind.coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    return context;
}

/// Seconds of all rays, and how many hit something, so that nothing is left out.
double time_ours(const Ours &ours, const Kind &kind, size_t &hits) {
    auto start = std::chrono::steady_clock::now();
    hits = 0;
    for (const Ray &ray : kind.rays) hits += ours.distance(ray) < kInfinity;
    return seconds_since(start);
}

double time_embree(const Scene &scene, const Kind &kind, size_t &hits) {
    RTCIntersectContext context = context_of(kind);
    auto start = std::chrono::steady_clock::now();
    hits = 0;
    for (const Ray &ray : kind.rays) hits += scene.meet(ray, context).hit.geomID != RTC_INVALID_GEOMETRY_ID;
    return seconds_since(start);
}

/// Eight rays at a time.
double time_packets(const Scene &scene, const Kind &kind) {
    RTCIntersectContext context = context_of(kind);
    alignas(32) int valid[8] = {-1, -1, -1, -1, -1, -1, -1, -1};
    auto start = std::chrono::steady_clock::now();
    for (size_t first = 0; first + 8 <= kind.rays.size(); first += 8) {
        alignas(32) RTCRayHit8 packet;
        for (int k = 0; k < 8; k++) {
            const Ray &ray = kind.rays[first + k];
            packet.ray.org_x[k] = ray.origin[0], packet.ray.org_y[k] = ray.origin[1], packet.ray.org_z[k] = ray.origin[2];
            packet.ray.dir_x[k] = ray.direction[0], packet.ray.dir_y[k] = ray.direction[1], packet.ray.dir_z[k] = ray.direction[2];
            packet.ray.tnear[k] = 0, packet.ray.tfar[k] = std::numeric_limits<float>::infinity();
            packet.ray.time[k] = 0, packet.ray.mask[k] = ~0u, packet.ray.id[k] = 0, packet.ray.flags[k] = 0;
            packet.hit.geomID[k] = packet.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
        }
        rtcIntersect8(valid, scene.scene, &context, &packet);
    }
    return seconds_since(start);
}

/// Where a ray meets a triangle in double precision, edges included; infinite where it does not.
double meets(const Land &land, const uint32_t *corners, const Ray &ray) {
    Vec a = land.vertex(corners[0]), u = land.vertex(corners[1]) - a, v = land.vertex(corners[2]) - a;
    Vec origin = ray.at(0), direction = ray.at(1) - origin, p = cross(direction, v), s = origin - a, q = cross(s, u);
    double area = dot(u, p);
    if (area == 0) return kInfinity;
    double b = dot(s, p) / area, c = dot(direction, q) / area, t = dot(v, q) / area;
    return b >= 0 && c >= 0 && b + c <= 1 && t >= 0 ? t : kInfinity;
}

/// How hits compare. Embree's places are rounded to floats, and so are its vertices.
struct Agreement {
    size_t rays = 0, same = 0, float_only = 0, embree_slips = 0, ours_slip = 0, ours_wrong = 0;
};

/// How high a ray that Embree stops and ours does not is above the surface around Embree's place.
void report(const Land &land, const Ours &ours, const Ray &ray, double own, double other) {
    std::fprintf(stderr, "a ray from %.9g %.9g %.9g along %.9g %.9g %.9g: ours at %.9g, Embree's at %.9g; above the surface:", ray.origin[0], ray.origin[1], ray.origin[2],
                 ray.direction[0], ray.direction[1], ray.direction[2], own, other);
    for (int step = -5; step <= 5; step++) {
        Vec place = ray.at(other + step * 0.2);
        kmb_height height{};
        height.struct_size = sizeof height;
        if (kmb_height_at(ours.query, place.x + land.middle[0], place.y + land.middle[1], &height) == KMB_OK) std::fprintf(stderr, " %.3g", place.z - height.height);
    }
    std::fprintf(stderr, "\n");
}

Agreement compare(const Land &land, const Ours &ours, const Scene &scene, const Kind &kind, const std::vector<uint32_t> &corners) {
    Agreement found;
    RTCIntersectContext context = context_of(kind);
    size_t every = std::max<size_t>(1, kind.rays.size() / kChecked);
    for (size_t i = 0; i < kind.rays.size() && found.rays < kChecked; i += every, found.rays++) {
        const Ray &ray = kind.rays[i];
        RTCRayHit query = scene.meet(ray, context);
        bool stopped = query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
        double own = ours.distance(ray), other = stopped ? query.ray.tfar : kInfinity;
        // Embree's distances are floats; that to its triangle in doubles tells more.
        double exact = stopped && !corners.empty() ? meets(land, &corners[3 * size_t(query.hit.primID)], ray) : kInfinity;
        auto is_near = [own](double distance) { return own == distance || std::fabs(own - distance) < 1e-6 * (1 + own); };
        if (is_near(other) || is_near(exact) || std::fabs(own - other) < 0.1 + 1e-5 * own) {
            found.same++;
        } else if (other < own) {
            ++(exact < own ? found.ours_slip : found.float_only);
            if (exact < own) report(land, ours, ray, own, other);
        } else {
            Vec place = ray.at(own);
            kmb_height height{};
            height.struct_size = sizeof height;
            kmb_status status = kmb_height_at(ours.query, place.x + land.middle[0], place.y + land.middle[1], &height);
            bool is_on_surface = status == KMB_OK && std::fabs(height.height - place.z) < 1e-5;
            ++(is_on_surface ? found.embree_slips : found.ours_wrong);
        }
    }
    return found;
}

/// Decodes all that there is: a slanting ray into each leaf.
double decode_all(const Land &land, const Ours &ours) {
    auto start = std::chrono::steady_clock::now();
    const double side = land.info.cells;
    for (double row = side / 2; row - side / 2 < land.info.height - 1; row += side)
        for (double column = side / 2; column - side / 2 < land.info.width - 1; column += side) {
            double at[2] = {std::min(column, land.info.width - 1.5), std::min(row, land.info.height - 1.5)};
            Vec place = {(at[0] - (land.info.width - 1.0) / 2) * land.info.world_step[0], (at[1] - (land.info.height - 1.0) / 2) * land.info.world_step[1], 0};
            place.z = land.height(place.x, place.y) + std::fabs(land.info.world_step[0]);
            ours.distance(ray_of(place, {0.1, 0.1, -1}));
        }
    return seconds_since(start);
}

size_t heap_bytes() {
    struct mallinfo2 heap = mallinfo2();
    return heap.uordblks + heap.hblkhd;
}

}  // namespace

int main(int count, char **words) {
    std::string path, scenes = "mesh,robust,compact,grid", csv;
    size_t ray_count = 1000000, repeats = 5;
    for (int i = 1; i < count; i++) {
        std::string word = words[i];
        bool has_value = i + 1 < count;
        if (word == "--rays" && has_value) ray_count = std::strtoull(words[++i], nullptr, 10);
        else if (word == "--repeats" && has_value) repeats = std::strtoull(words[++i], nullptr, 10);
        else if (word == "--scenes" && has_value) scenes = words[++i];
        else if (word == "--csv" && has_value) csv = words[++i];
        else if (path.empty()) path = word;
        else fail("what is " + word + "?");
    }
    if (path.empty()) fail("give a FILE.kmb");
    // As Embree asks.
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    Land land(path.c_str());
    std::vector<uint32_t> corners = triangles(land);
    std::vector<float> vertices;
    vertices.reserve(land.heights.size() * 3 + 1);
    for (uint32_t i = 0; i < land.heights.size(); i++) {
        Vec place = land.vertex(i);
        for (double along : {place.x, place.y, std::isnan(place.z) ? 0 : place.z}) vertices.push_back(float(along));
    }
    // Embree may read 16 bytes where the last vertex begins.
    vertices.push_back(0);
    Kind kinds[] = {{"picture", true, picture(land, ray_count * 5 / 4 + 1000)}, {"random", false, scattered(land, ray_count, false)}, {"grazing", false, scattered(land, ray_count, true)}};

    Ours ours;
    std::copy(land.middle, land.middle + 2, ours.middle);
    require(kmb_query_create(land.repository, KMB_UNLIMITED, &ours.query), "a query");
    size_t before = heap_bytes();
    double decode_seconds = decode_all(land, ours);
    for (const Kind &kind : kinds) {
        size_t hits;
        time_ours(ours, kind, hits);
    }
    size_t own_bytes = heap_bytes() - before;
    std::FILE *table = csv.empty() ? nullptr : std::fopen(csv.c_str(), "w");
    if (!csv.empty() && !table) fail("cannot write " + csv);
    std::string header = "scene,rays,count,hits,ours_mrays_per_s,embree_mrays_per_s,embree_packets_mrays_per_s,ours_bytes,embree_bytes,embree_peak_bytes,"
                         "ours_decode_s,embree_build_s,compared,same,float_only,embree_slips,ours_slip,ours_wrong";
    std::printf("%s\n", header.c_str());
    if (table) std::fprintf(table, "%s\n", header.c_str());
    bool is_wrong = false;
    for (size_t from = 0; from < scenes.size();) {
        std::string name = scenes.substr(from, scenes.find(',', from) - from);
        from += name.size() + 1;
        Scene scene(land, name, vertices, corners);
        for (const Kind &kind : kinds) {
            double own = kInfinity, other = kInfinity, packets = kInfinity;
            size_t hits = 0, other_hits = 0;
            for (size_t repeat = 0; repeat < repeats; repeat++) {
                own = std::min(own, time_ours(ours, kind, hits));
                other = std::min(other, time_embree(scene, kind, other_hits));
                packets = std::min(packets, time_packets(scene, kind));
            }
            // The grid's quads are all split along one diagonal: another surface.
            Agreement same = name == "grid" ? Agreement() : compare(land, ours, scene, kind, corners);
            is_wrong |= same.ours_slip + same.ours_wrong > 0;
            double millions = double(kind.rays.size()) * 1e-6;
            char line[512];
            std::snprintf(line, sizeof line, "%s,%s,%zu,%zu,%.3f,%.3f,%.3f,%zu,%lld,%lld,%.2f,%.2f,%zu,%zu,%zu,%zu,%zu,%zu", name.c_str(), kind.name, kind.rays.size(),
                          hits, millions / own, millions / other, millions / packets, own_bytes, (long long)(embree_bytes + scene.buffer_bytes),
                          (long long)(embree_peak + scene.buffer_bytes), decode_seconds, scene.build_seconds, same.rays, same.same, same.float_only,
                          same.embree_slips, same.ours_slip, same.ours_wrong);
            std::printf("%s\n", line);
            std::fflush(stdout);
            if (table) std::fprintf(table, "%s\n", line);
        }
    }
    if (table) std::fclose(table);
    kmb_query_destroy(ours.query);
    kmb_repository_close(land.repository);
    return is_wrong;
}
