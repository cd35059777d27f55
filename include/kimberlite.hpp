// C++11 on top of kimberlite.h: objects that free themselves and can be moved but not copied, and exceptions
// in place of statuses. kimberlite.h is the manual; nothing is added here.
#ifndef KIMBERLITE_HPP
#define KIMBERLITE_HPP

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "kimberlite.h"

namespace kimberlite {

// A status other than KMB_OK, with the message of kmb_last_error.
class Error : public std::runtime_error {
public:
    explicit Error(kmb_status status)
        : std::runtime_error(std::string(kmb_status_name(status)) + ": " + kmb_last_error()), status_(status) {}

    kmb_status status() const noexcept { return status_; }

private:
    kmb_status status_;
};

inline void check(kmb_status status) {
    if (status != KMB_OK) throw Error(status);
}

// A struct of the interface, empty but for its size.
template <class T>
T sized() {
    T value{};
    value.struct_size = sizeof(T);
    return value;
}

// An array that belongs to a cut or to a visit.
template <class T>
class Span {
public:
    Span(const T *data, std::size_t size) : data_(data), size_(size) {}
    const T *begin() const noexcept { return data_; }
    const T *end() const noexcept { return data_ + size_; }
    const T *data() const noexcept { return data_; }
    std::size_t size() const noexcept { return size_; }
    const T &operator[](std::size_t index) const noexcept { return data_[index]; }

private:
    const T *data_;
    std::size_t size_;
};

namespace detail {
struct Free {
    void operator()(kmb_repository *repository) const noexcept { kmb_repository_close(repository); }
    void operator()(kmb_query *query) const noexcept { kmb_query_destroy(query); }
    void operator()(kmb_cut *cut) const noexcept { kmb_cut_destroy(cut); }
    void operator()(kmb_builder *builder) const noexcept { kmb_builder_destroy(builder); }
    void operator()(kmb_codec *codec) const noexcept { kmb_codec_destroy(codec); }
    void operator()(kmb_city *city) const noexcept { kmb_city_close(city); }
    void operator()(kmb_city_visit *visit) const noexcept { kmb_city_visit_destroy(visit); }
    void operator()(kmb_city_builder *builder) const noexcept { kmb_city_builder_destroy(builder); }
    void operator()(const kmb_patch *patch) const noexcept { kmb_patch_release(patch); }
};
}  // namespace detail

class Repository {
public:
    explicit Repository(const std::string &path, const kmb_open_options *options = nullptr) {
        kmb_repository *handle = nullptr;
        check(kmb_repository_open(path.c_str(), options, &handle));
        handle_.reset(handle);
    }

    const kmb_repository *get() const noexcept { return handle_.get(); }

    kmb_repository_info info() const {
        kmb_repository_info info = sized<kmb_repository_info>();
        check(kmb_repository_describe(get(), &info));
        return info;
    }

    /* Gives the count of samples whose detail is missing. */
    std::uint64_t read_window(std::uint32_t level, std::uint32_t column, std::uint32_t row, std::uint32_t width,
                              std::uint32_t height, double *samples, std::size_t capacity) const {
        std::uint64_t coarse_samples = 0;
        check(kmb_read_window(get(), level, column, row, width, height, samples, capacity, &coarse_samples));
        return coarse_samples;
    }

private:
    std::unique_ptr<kmb_repository, detail::Free> handle_;
};

class Query {
public:
    explicit Query(const Repository &repository, std::uint64_t byte_limit = KMB_UNLIMITED) {
        kmb_query *handle = nullptr;
        check(kmb_query_create(repository.get(), byte_limit, &handle));
        handle_.reset(handle);
    }

    kmb_query *get() noexcept { return handle_.get(); }

    // False outside the raster and in voids.
    bool height_at(double x, double y, kmb_height &height) {
        height.struct_size = sizeof height;
        kmb_status status = kmb_height_at(get(), x, y, &height);
        if (status != KMB_OUTSIDE) check(status);
        return status == KMB_OK;
    }

private:
    std::unique_ptr<kmb_query, detail::Free> handle_;
};

// A patch that is kept beyond its cut's next update.
class Patch {
public:
    explicit Patch(const kmb_patch *patch) {
        check(kmb_patch_retain(patch));
        handle_.reset(patch);
    }

    const kmb_patch *get() const noexcept { return handle_.get(); }

    kmb_patch_info info() const {
        kmb_patch_info info = sized<kmb_patch_info>();
        check(kmb_patch_describe(get(), &info));
        return info;
    }

private:
    std::unique_ptr<const kmb_patch, detail::Free> handle_;
};

class Cut {
public:
    struct Changes {
        Span<const kmb_patch *> added;
        Span<std::uint64_t> removed;
    };

    explicit Cut(const Repository &repository, const kmb_cut_options *options = nullptr) {
        kmb_cut *handle = nullptr;
        check(kmb_cut_create(repository.get(), options, &handle));
        handle_.reset(handle);
    }

    kmb_cut *get() noexcept { return handle_.get(); }
    const kmb_cut *get() const noexcept { return handle_.get(); }

    kmb_stats update(const kmb_view &view, const kmb_budget *budget = nullptr) {
        kmb_stats stats = sized<kmb_stats>();
        check(kmb_cut_update(get(), &view, budget, &stats));
        return stats;
    }

    Span<const kmb_patch *> patches() const {
        const kmb_patch *const *patches = nullptr;
        std::size_t count = 0;
        check(kmb_cut_patches(get(), &patches, &count));
        return {patches, count};
    }

    Changes changes() {
        const kmb_patch *const *added = nullptr;
        const std::uint64_t *removed = nullptr;
        std::size_t added_count = 0, removed_count = 0;
        check(kmb_cut_changes(get(), &added, &added_count, &removed, &removed_count));
        return {{added, added_count}, {removed, removed_count}};
    }

    Span<std::uint16_t> triangle_list() const {
        const std::uint16_t *indices = nullptr;
        std::size_t count = 0;
        check(kmb_cut_triangle_list(get(), &indices, &count));
        return {indices, count};
    }

    Span<std::uint16_t> triangle_strip() const {
        const std::uint16_t *indices = nullptr;
        std::size_t count = 0;
        check(kmb_cut_triangle_strip(get(), &indices, &count));
        return {indices, count};
    }

    kmb_grid_to_world grid_to_world() const {
        kmb_grid_to_world map = sized<kmb_grid_to_world>();
        check(kmb_cut_grid_to_world(get(), &map));
        return map;
    }

private:
    std::unique_ptr<kmb_cut, detail::Free> handle_;
};

class Builder {
public:
    explicit Builder(const kmb_builder_options &options) {
        kmb_builder *handle = nullptr;
        check(kmb_builder_create(&options, &handle));
        handle_.reset(handle);
    }

    // For the setters.
    kmb_builder *get() noexcept { return handle_.get(); }

    kmb_build_report write(kmb_rows_callback rows, void *rows_user, const std::string &path,
                           kmb_progress_callback progress = nullptr, void *progress_user = nullptr) {
        kmb_build_report report = sized<kmb_build_report>();
        check(kmb_builder_write(get(), rows, rows_user, progress, progress_user, path.c_str(), &report));
        return report;
    }

private:
    std::unique_ptr<kmb_builder, detail::Free> handle_;
};

class City {
public:
    explicit City(const std::string &path, kmb_access access = KMB_ACCESS_MAP) {
        kmb_city *handle = nullptr;
        check(kmb_city_open(path.c_str(), access, &handle));
        handle_.reset(handle);
    }

    const kmb_city *get() const noexcept { return handle_.get(); }

    kmb_city_info info() const {
        kmb_city_info info = sized<kmb_city_info>();
        check(kmb_city_describe(get(), &info));
        return info;
    }

    kmb_city_node node(std::uint32_t index) const {
        kmb_city_node node = sized<kmb_city_node>();
        check(kmb_city_node_at(get(), index, &node));
        return node;
    }

    // The vectors become as long as the block needs; its pointers are theirs.
    kmb_blockmap read(std::uint32_t node, std::vector<std::uint8_t> &image,
                      std::vector<std::uint8_t> &low_heights) const {
        const kmb_city_info known = info();
        image.resize(static_cast<std::size_t>(known.image_bytes));
        low_heights.resize(static_cast<std::size_t>(known.low_height_bytes));
        kmb_blockmap block = sized<kmb_blockmap>();
        check(kmb_city_read(get(), node, image.data(), image.size(), low_heights.empty() ? nullptr : low_heights.data(),
                            low_heights.size(), &block));
        return block;
    }

private:
    std::unique_ptr<kmb_city, detail::Free> handle_;
};

class CityVisit {
public:
    explicit CityVisit(const City &city, std::uint32_t threads = 0) {
        kmb_city_visit *handle = nullptr;
        check(kmb_city_visit_create(city.get(), threads, &handle));
        handle_.reset(handle);
    }

    kmb_city_visit *get() noexcept { return handle_.get(); }
    const kmb_city_visit *get() const noexcept { return handle_.get(); }

    kmb_city_stats update(const kmb_view &view, const kmb_budget *budget = nullptr) {
        kmb_city_stats stats = sized<kmb_city_stats>();
        check(kmb_city_visit_update(get(), &view, budget, &stats));
        return stats;
    }

    Span<kmb_city_drawn> drawn() const {
        const kmb_city_drawn *drawn = nullptr;
        std::size_t count = 0;
        check(kmb_city_visit_drawn(get(), &drawn, &count));
        return {drawn, count};
    }

    Span<std::uint32_t> added() const {
        const std::uint32_t *nodes = nullptr;
        std::size_t count = 0;
        check(kmb_city_visit_added(get(), &nodes, &count));
        return {nodes, count};
    }

    Span<std::uint32_t> removed() const {
        const std::uint32_t *nodes = nullptr;
        std::size_t count = 0;
        check(kmb_city_visit_removed(get(), &nodes, &count));
        return {nodes, count};
    }

    kmb_blockmap block(std::uint32_t node) const {
        kmb_blockmap block = sized<kmb_blockmap>();
        check(kmb_city_visit_block(get(), node, &block));
        return block;
    }

    std::vector<kmb_city_hit> cast(const std::vector<kmb_ray> &rays) const {
        std::vector<kmb_city_hit> hits(rays.size(), sized<kmb_city_hit>());
        check(kmb_city_visit_cast(get(), rays.size(), rays.data(), hits.data()));
        return hits;
    }

private:
    std::unique_ptr<kmb_city_visit, detail::Free> handle_;
};

class CityBuilder {
public:
    explicit CityBuilder(const kmb_city_options *options = nullptr) {
        kmb_city_builder *handle = nullptr;
        check(kmb_city_builder_create(options, &handle));
        handle_.reset(handle);
    }

    // For what is added and set.
    kmb_city_builder *get() noexcept { return handle_.get(); }

    kmb_city_report build(const std::string &path, kmb_progress_callback progress = nullptr,
                          void *progress_user = nullptr) {
        kmb_city_report report = sized<kmb_city_report>();
        check(kmb_city_builder_build(get(), path.c_str(), progress, progress_user, &report));
        return report;
    }

private:
    std::unique_ptr<kmb_city_builder, detail::Free> handle_;
};

// Diamonds as bytes; their sizes are those of the options' cells.
class Codec {
public:
    explicit Codec(const kmb_codec_options &options) {
        kmb_codec *handle = nullptr;
        check(kmb_codec_create(&options, &handle));
        handle_.reset(handle);
    }

    // For kmb_codec_train and kmb_codec_set_model.
    kmb_codec *get() noexcept { return handle_.get(); }

    std::vector<std::uint8_t> encode(const std::int32_t *vertices, const std::int32_t *centres,
                                     const std::uint8_t *vertex_valid = nullptr,
                                     const std::uint8_t *centre_valid = nullptr) const {
        std::size_t size = 0;
        check(kmb_codec_diamond_bound(handle_.get(), &size));
        std::vector<std::uint8_t> bytes(size);
        check(kmb_codec_encode_diamond(handle_.get(), vertices, vertex_valid, centres, centre_valid, bytes.data(),
                                       bytes.size(), &size));
        bytes.resize(size);
        return bytes;
    }

    void decode(const std::int32_t *vertices, const std::vector<std::uint8_t> &bytes, std::int32_t *centres,
                const std::uint8_t *vertex_valid = nullptr, std::uint8_t *centre_valid = nullptr) const {
        check(kmb_codec_decode_diamond(handle_.get(), vertices, vertex_valid, bytes.data(), bytes.size(), centres,
                                       centre_valid));
    }

private:
    std::unique_ptr<kmb_codec, detail::Free> handle_;
};

// The bytes of a raster: options.height rows of options.width samples of options.sample_type.
inline std::vector<std::uint8_t> encode_raster(const kmb_raster_options &options, const void *samples) {
    std::size_t size = 0;
    check(kmb_codec_raster_bound(&options, &size));
    std::vector<std::uint8_t> bytes(size);
    check(kmb_codec_encode_raster(&options, samples, bytes.data(), bytes.size(), &size));
    bytes.resize(size);
    return bytes;
}

}  // namespace kimberlite

#endif
