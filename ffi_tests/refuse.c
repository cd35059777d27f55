/* Whatever is NULL, misaligned, or of the wrong size is refused, and no result is touched. */
#include <math.h>
#include <string.h>

#include "check.h"

/* Each struct with the right size is accepted elsewhere; here it is one byte short, one too long, and 0. */
static const uint32_t WRONG[] = {sizeof(uint32_t), 1, 0, 100000, UINT32_MAX};

static void refuse_repository(const kmb_repository *repository, const char *path)
{
    kmb_repository *opened = (kmb_repository *)16;
    kmb_repository_info info;
    const char *key;
    const uint8_t *value;
    size_t length;
    double x, y;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_open(NULL, NULL, &opened));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_open(path, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_open("", NULL, &opened));
    for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
        kmb_open_options options = {.struct_size = WRONG[i], .access = KMB_ACCESS_MAP};
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_repository_open(path, &options, &opened));
        info.struct_size = WRONG[i];
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_repository_describe(repository, &info));
    }
    kmb_open_options unknown = {.struct_size = sizeof unknown, .access = 7};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_open(path, &unknown, &opened));
    CHECK(opened == (kmb_repository *)16);

    info.struct_size = sizeof info;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_describe(NULL, &info));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_describe(repository, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_describe((const kmb_repository *)1, &info));
    CHECK(strstr(kmb_last_error(), "aligned"));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata_at(NULL, 0, &key, &value, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata_at(repository, 0, NULL, &value, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata_at(repository, 0, &key, NULL, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata_at(repository, 0, &key, &value, NULL));
    CHECK_STATUS(KMB_NOT_FOUND, kmb_repository_metadata_at(repository, UINT64_MAX, &key, &value, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata(NULL, "a", &value, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata(repository, NULL, &value, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_metadata(repository, "\xff", &value, &length));
    CHECK_STATUS(KMB_NOT_FOUND, kmb_repository_metadata(repository, "absent", &value, &length));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_world_to_crs(NULL, 0, 0, &x, &y));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_world_to_crs(repository, 0, 0, NULL, &y));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_world_to_crs(repository, 0, 0, &x, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_crs_to_world(NULL, 0, 0, &x, &y));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_crs_to_world(repository, 0, 0, NULL, &y));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_crs_to_world(repository, 0, 0, &x, NULL));
    kmb_repository_close(NULL);
}

static void refuse_query(const kmb_repository *repository)
{
    kmb_query *query = NULL;
    kmb_height height = {.struct_size = sizeof height};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_query_create(NULL, KMB_UNLIMITED, &query));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_query_create(repository, KMB_UNLIMITED, NULL));
    CHECK_STATUS(KMB_OK, kmb_query_create(repository, 0, &query));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_height_at(NULL, 2000, 4500, &height));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_height_at(query, 2000, 4500, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_height_at_crs(NULL, 2000, 4500, &height));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_height_at_crs(query, 2000, 4500, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_height_at(query, NAN, 4500, &height));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_height_at_crs(query, 2000, INFINITY, &height));
    CHECK_STATUS(KMB_OUTSIDE, kmb_height_at(query, 999, 4500, &height));
    CHECK_STATUS(KMB_OUTSIDE, kmb_height_at(query, -1e300, 1e300, &height));
    CHECK(height.height == 0 && height.level == 0);
    for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
        height.struct_size = WRONG[i];
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_height_at(query, 2000, 4500, &height));
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_height_at_crs(query, 2000, 4500, &height));
    }
    kmb_query_destroy(query);
    kmb_query_destroy(NULL);
}

static void refuse_window(const kmb_repository *repository)
{
    double samples[4] = {-1, -1, -1, -1};
    kmb_repository_info info = {.struct_size = sizeof info};
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(NULL, 0, 0, 0, 1, 1, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, 0, 0, 0, 1, 1, NULL, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, info.levels, 0, 0, 3, 2, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, info.levels, 0, 0, 0, 0, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, 1, 0, 0, 1, 1, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, info.levels + 2, 0, 0, 1, 1, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, info.levels, WIDTH, 0, 1, 1, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_read_window(repository, info.levels, UINT32_MAX, 0, 2, 1, samples, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT,
                 kmb_read_window(repository, info.levels, 0, 0, UINT32_MAX, UINT32_MAX, samples, SIZE_MAX, NULL));
    CHECK(samples[0] == -1 && samples[3] == -1);
}

static void refuse_arrays(kmb_cut *cut)
{
    const kmb_patch *const *patches;
    const uint64_t *removed;
    const uint16_t *indices;
    const float *grid;
    size_t count, other;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_patches(NULL, &patches, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_patches(cut, NULL, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_patches(cut, &patches, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_changes(NULL, &patches, &count, &removed, &other));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_changes(cut, NULL, &count, &removed, &other));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_changes(cut, &patches, NULL, &removed, &other));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_changes(cut, &patches, &count, NULL, &other));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_changes(cut, &patches, &count, &removed, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_triangle_list(NULL, &indices, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_triangle_list(cut, NULL, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_triangle_list(cut, &indices, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_triangle_strip(NULL, &indices, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_triangle_strip(cut, NULL, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_triangle_strip(cut, &indices, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_grid(NULL, &grid, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_grid(cut, NULL, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_grid(cut, &grid, NULL));
}

static void refuse_cut(const kmb_repository *repository)
{
    kmb_cut *cut = NULL;
    kmb_view view = view_from_above(1);
    kmb_budget budget = no_limits();
    kmb_stats stats = {.struct_size = sizeof stats};
    kmb_grid_to_world map = {.struct_size = sizeof map};
    kmb_cut_options options = {.struct_size = sizeof options, .vertex_form = 9};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(repository, &options, &cut));
    options.vertex_form = KMB_VERTEX_COMPACT;
    options.metric = 2;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(repository, &options, &cut));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(NULL, NULL, &cut));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(repository, NULL, NULL));
    CHECK_STATUS(KMB_OK, kmb_cut_create(repository, NULL, &cut));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_update(NULL, &view, &budget, &stats));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_update(cut, NULL, &budget, &stats));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_grid_to_world(NULL, &map));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_grid_to_world(cut, NULL));
    for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
        kmb_cut *other = NULL;
        options.struct_size = view.struct_size = budget.struct_size = stats.struct_size = map.struct_size = WRONG[i];
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_cut_create(repository, &options, &other));
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_cut_update(cut, &view, NULL, NULL));
        view.struct_size = sizeof view;
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_cut_update(cut, &view, &budget, NULL));
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_cut_update(cut, &view, NULL, &stats));
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_cut_grid_to_world(cut, &map));
        CHECK(other == NULL);
    }
    refuse_arrays(cut);
    kmb_cut_destroy(cut);
    kmb_cut_destroy(NULL);
}

static void refuse_patch(const kmb_repository *repository)
{
    kmb_cut *cut = NULL;
    kmb_view view = view_from_above(1);
    const kmb_patch *const *patches;
    size_t count;
    kmb_patch_info info = {.struct_size = sizeof info};
    CHECK_STATUS(KMB_OK, kmb_cut_create(repository, NULL, &cut));
    CHECK_STATUS(KMB_OK, kmb_cut_update(cut, &view, NULL, NULL));
    CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
    CHECK(count > 0);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_patch_describe(NULL, &info));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_patch_describe(patches[0], NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_patch_retain(NULL));
    kmb_patch_release(NULL);
    for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
        info.struct_size = WRONG[i];
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_patch_describe(patches[0], &info));
    }
    kmb_cut_destroy(cut);
}

static void refuse_options(void)
{
    kmb_builder *builder = NULL;
    kmb_builder_options good = rough_options(0), bad;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(NULL, &builder));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&good, NULL));
    bad = good, bad.sample_type = 8;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.sample_type = 256;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.width = 1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.height = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.max_error = -1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.max_error = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.cells = 48;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.transform = 3;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.transform = KMB_TRANSFORM_LIFTED, bad.max_error = 1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.transform = KMB_TRANSFORM_TWO_STAGE, bad.rms_error = 1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    bad = good, bad.transform = KMB_TRANSFORM_LIFTED, bad.rms_error = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_create(&bad, &builder));
    for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
        bad = good, bad.struct_size = WRONG[i];
        CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_builder_create(&bad, &builder));
    }
    CHECK(builder == NULL);
    kmb_builder_destroy(NULL);
}

static void refuse_builder(const char *path)
{
    kmb_builder *builder = NULL;
    kmb_builder_options options = rough_options(0);
    kmb_build_report report = {.struct_size = 3};
    const double good[6] = {0, 1, 0, 0, 0, -1}, flat[6] = {0, 1, 1, 0, 1, 1}, wild[6] = {NAN, 1, 0, 0, 0, -1};
    CHECK_STATUS(KMB_OK, kmb_builder_create(&options, &builder));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_geotransform(NULL, good, 0, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_geotransform(builder, NULL, 0, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_geotransform(builder, flat, 0, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_geotransform(builder, wild, 0, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_geotransform(builder, good, 2, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_geotransform(builder, good, 0, 2));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_crs(NULL, ""));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_crs(builder, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_crs(builder, "\xff"));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_units(NULL, ""));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_units(builder, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_value_scale(NULL, 1, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_value_scale(builder, 0, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_value_scale(builder, 1, INFINITY));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_nodata(NULL, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_metadata(NULL, "a", NULL, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_metadata(builder, NULL, NULL, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_set_metadata(builder, "a", NULL, 1));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_write(NULL, rough_rows, NULL, NULL, NULL, path, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_write(builder, NULL, NULL, NULL, NULL, path, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_builder_write(builder, rough_rows, NULL, NULL, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_builder_write(builder, rough_rows, NULL, NULL, NULL, path, &report));
    CHECK(!exists(path));
    kmb_builder_destroy(builder);
}

int main(int count, char **words)
{
    CHECK(count == 2);
    refuse_options();
    refuse_builder(path_in(words, "refuse_none.kmb"));
    const char *path = path_in(words, "refuse.kmb");
    kmb_repository *repository = rough_repository(path);
    refuse_repository(repository, path);
    refuse_query(repository);
    refuse_window(repository);
    refuse_cut(repository);
    refuse_patch(repository);
    kmb_repository_close(repository);
    return 0;
}
