// kimberlite.hpp: objects move, are not copied, free themselves, and throw.
#include <kimberlite.hpp>

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace {

void check(bool holds, const char *what) {
    if (holds) return;
    std::cerr << what << " does not hold\n";
    std::exit(1);
}

std::int32_t slope(void *, std::uint32_t first_row, std::uint32_t row_count, double *samples) {
    for (std::uint32_t row = 0; row < row_count; row++)
        for (std::uint32_t column = 0; column < 100; column++) *samples++ = first_row + row + 2 * column;
    return 0;
}

void build(const std::string &path) {
    kmb_builder_options options = kimberlite::sized<kmb_builder_options>();
    options.sample_type = KMB_SAMPLE_I16;
    options.width = 100;
    options.height = 80;
    kimberlite::Builder builder(options);
    kmb_build_report report = builder.write(slope, nullptr, path);
    check(report.samples == 8000 && report.max_error == 0, "the report is that of the build");
}

kmb_view view() {
    kmb_view view = kimberlite::sized<kmb_view>();
    view.eye[2] = 1000;
    view.world_to_clip[0] = view.world_to_clip[5] = 0.01;
    view.world_to_clip[10] = -1e-4;
    view.world_to_clip[15] = 1;
    view.viewport[0] = view.viewport[1] = 500;
    view.tolerance = 1;
    return view;
}

void draw(const kimberlite::Repository &repository) {
    kimberlite::Cut first(repository);
    kimberlite::Cut cut = std::move(first);
    check(first.get() == nullptr, "a cut that was moved from is empty");
    kmb_stats stats = cut.update(view());
    check(stats.patches == cut.patches().size() && stats.patches > 0, "patches are listed");
    check(cut.changes().added.size() >= stats.patches, "changes are listed");
    check(cut.triangle_list().size() % 3 == 0 && cut.triangle_strip().size() > 0, "triangles are listed");
    kimberlite::Patch kept(cut.patches()[0]);
    cut = kimberlite::Cut(repository);
    check(kept.info().vertices != nullptr, "a kept patch outlives its cut");
}

}  // namespace

static void pack() {
    kmb_raster_options options = kimberlite::sized<kmb_raster_options>();
    options.sample_type = KMB_SAMPLE_U8;
    options.width = options.height = 20;
    options.cells = 16;
    std::vector<std::uint8_t> samples(400), back(400);
    for (std::size_t i = 0; i < samples.size(); i++) samples[i] = static_cast<std::uint8_t>(i / 7);
    const std::vector<std::uint8_t> bytes = kimberlite::encode_raster(options, samples.data());
    kimberlite::check(kmb_codec_decode_raster(bytes.data(), bytes.size(), back.data(), back.size()));
    check(samples == back, "a raster comes back");
    kmb_codec_options diamonds = kimberlite::sized<kmb_codec_options>();
    diamonds.cells = 16;
    diamonds.maximum = 1000;
    kimberlite::Codec codec(diamonds);
    std::vector<std::int32_t> vertices(17 * 17, 400), centres(16 * 16, 404), decoded(16 * 16);
    codec.decode(vertices.data(), codec.encode(vertices.data(), centres.data()), decoded.data());
    check(centres == decoded, "a diamond comes back");
}

// A roof over a square, 12 above the ground.
static void city(const std::string &path) {
    const double roof[18] = {20, 20, 12, 40, 20, 12, 40, 40, 12, 20, 20, 12, 40, 40, 12, 20, 40, 12};
    kmb_city_options options = kimberlite::sized<kmb_city_options>();
    options.side_texels = 32;
    options.views = 4;
    options.leaf_side = 16;
    kimberlite::CityBuilder builder(&options);
    kimberlite::check(kmb_city_builder_add_triangles(builder.get(), 2, roof, nullptr));
    kimberlite::check(kmb_city_builder_set_plane(builder.get(), 0));
    check(builder.build(path).triangles == 2, "the report is that of the city");
    kimberlite::City opened(path);
    std::vector<std::uint8_t> image, low_heights;
    check(opened.read(0, image, low_heights).image == image.data() && low_heights.empty(), "a block is read");
    check(opened.node(1).parent == 0, "a node is described");
    kimberlite::CityVisit first(opened, 1);
    kimberlite::CityVisit visit = std::move(first);
    check(first.get() == nullptr, "a visit that was moved from is empty");
    opened = kimberlite::City(path);
    const kmb_city_stats stats = visit.update(view());
    check(stats.drawn == visit.drawn().size() && visit.added().size() > 0 && visit.removed().size() == 0, "blocks are listed");
    check(visit.block(0).image_bytes == opened.info().image_bytes, "a block is held");
    kmb_ray ray = kimberlite::sized<kmb_ray>();
    ray.origin[0] = ray.origin[1] = 30;
    ray.origin[2] = 100;
    ray.direction[2] = -1;
    ray.longest = 1000;
    const std::vector<kmb_city_hit> hits = visit.cast(std::vector<kmb_ray>(3, ray));
    check(hits.size() == 3 && std::abs(hits[2].distance - 88) < 0.1, "rays meet the roof");
}

int main(int count, char **words) {
    check(count == 2, "there is one argument");
    const std::string path = std::string(words[1]) + "/wrapper.kmb";
    static_assert(!std::is_copy_constructible<kimberlite::Cut>::value, "handles are not copied");
    static_assert(std::is_nothrow_move_constructible<kimberlite::Cut>::value, "handles are moved");
    build(path);
    kimberlite::Repository repository(path);
    check(repository.info().width == 100, "the repository is described");
    kimberlite::Query query(repository);
    kmb_height height;
    check(query.height_at(50, 40, height) && std::abs(height.height - 139) < 1e-9, "a height is found");
    check(!query.height_at(-1, 0, height), "there is no height outside");
    draw(repository);
    pack();
    city(std::string(words[1]) + "/wrapper_city.kmb");
    try {
        kimberlite::Repository absent(path + ".absent");
        check(false, "an absent file throws");
    } catch (const kimberlite::Error &error) {
        check(error.status() == KMB_IO, "the exception tells the status");
        check(std::string(error.what()).find("absent") != std::string::npos, "the exception tells the file");
    }
    return 0;
}
