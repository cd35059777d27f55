/* What was built comes back: samples at every level, description, metadata, heights; and what goes wrong leaves no file
 * and says why. */
#include <math.h>
#include <string.h>

#include "check.h"

static const double GEOTRANSFORM[6] = {1000, 10, 0, 5000, 0, -10};

static int32_t counted_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    CHECK(first_row == *(uint32_t *)user);
    *(uint32_t *)user += row_count;
    return rough_rows(NULL, first_row, row_count, samples);
}

/* A hole of NaN, and another of the nodata value. */
static int32_t holed_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    rough_rows(user, first_row, row_count, samples);
    for (uint32_t row = 0; row < row_count; row++, samples += WIDTH) {
        if (first_row + row == 50) samples[70] = NAN;
        if (first_row + row == 51) samples[71] = 65535;
    }
    return 0;
}

static int32_t failing_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    (void)user;
    rough_rows(NULL, first_row, row_count, samples);
    return first_row + row_count > 100 ? 42 : 0;
}

static int32_t wrong_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    rough_rows(NULL, first_row, row_count, samples);
    if (first_row == 0) samples[WIDTH - 1] = *(double *)user;
    return 0;
}

static int32_t cancelling(void *user, uint64_t done, uint64_t total)
{
    CHECK(done <= total);
    return ++*(int *)user > 3;
}

static int32_t counting(void *user, uint64_t done, uint64_t total)
{
    ((uint64_t *)user)[0] = done;
    ((uint64_t *)user)[1] = total;
    return 0;
}

static kmb_builder *described_builder(double max_error)
{
    kmb_builder_options options = rough_options(max_error);
    kmb_builder *builder = NULL;
    CHECK_STATUS(KMB_OK, kmb_builder_create(&options, &builder));
    CHECK_STATUS(KMB_OK, kmb_builder_set_geotransform(builder, GEOTRANSFORM, KMB_REGISTRATION_POINT, 0));
    CHECK_STATUS(KMB_OK, kmb_builder_set_crs(builder, "EPSG:32632"));
    CHECK_STATUS(KMB_OK, kmb_builder_set_units(builder, "decimetre"));
    CHECK_STATUS(KMB_OK, kmb_builder_set_value_scale(builder, 0.5, 100));
    CHECK_STATUS(KMB_OK, kmb_builder_set_nodata(builder, 65535));
    CHECK_STATUS(KMB_OK, kmb_builder_set_metadata(builder, "source", (const uint8_t *)"a\0b", 3));
    CHECK_STATUS(KMB_OK, kmb_builder_set_metadata(builder, "empty", NULL, 0));
    return builder;
}

static void description(const kmb_repository *repository)
{
    kmb_repository_info info = {.struct_size = sizeof info};
    const char *key;
    const uint8_t *value;
    size_t length;
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    CHECK(info.struct_size == sizeof info && info.kind == KMB_KIND_HEIGHTS);
    CHECK(info.width == WIDTH && info.height == HEIGHT && info.cells == 16 && info.levels % 2 == 0);
    CHECK(info.samples == WIDTH * HEIGHT && info.void_samples == 0 && info.diamonds > 0 && info.bytes > 0);
    CHECK(info.max_error == 0 && info.rms_error == 0 && info.lossless == 1);
    CHECK(info.sample_type == KMB_SAMPLE_U16 && info.sample_min >= 0 && info.sample_max <= 4000);
    CHECK(info.value_scale == 0.5 && info.value_offset == 100);
    CHECK(info.has_nodata == 1 && info.nodata == 65535);
    CHECK(info.georeferenced == 1 && info.geographic == 0 && info.registration == KMB_REGISTRATION_POINT);
    CHECK(memcmp(info.geotransform, GEOTRANSFORM, sizeof GEOTRANSFORM) == 0);
    CHECK(info.world_origin[0] == 1000 && info.world_origin[1] == 5000);
    CHECK(info.world_step[0] == 10 && info.world_step[1] == -10);
    CHECK(!strcmp(info.crs, "EPSG:32632") && !strcmp(info.units, "decimetre") && info.metadata_count == 2);
    CHECK_STATUS(KMB_OK, kmb_repository_metadata_at(repository, 1, &key, &value, &length));
    CHECK(!strcmp(key, "source") && length == 3 && memcmp(value, "a\0b", 3) == 0);
    CHECK_STATUS(KMB_OK, kmb_repository_metadata(repository, "empty", &value, &length));
    CHECK(length == 0);
}

static void samples(const kmb_repository *repository)
{
    static double window[WIDTH * HEIGHT];
    kmb_repository_info info = {.struct_size = sizeof info};
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    uint32_t step = 1;
    for (int32_t level = (int32_t)info.levels; level >= 0; level -= 2, step *= 2) {
        uint32_t width = (WIDTH - 1) / step + 1, height = (HEIGHT - 1) / step + 1;
        CHECK_STATUS(KMB_OK,
                     kmb_read_window(repository, (uint32_t)level, 0, 0, width, height, window, WIDTH * HEIGHT, NULL));
        for (uint32_t row = 0; row < height; row++)
            for (uint32_t column = 0; column < width; column++)
                CHECK(window[row * width + column] == rough_ground(column * step, row * step));
    }
    CHECK_STATUS(KMB_OK, kmb_read_window(repository, info.levels, 123, 45, 67, 8, window, 67 * 8, NULL));
    CHECK(window[0] == rough_ground(123, 45) && window[67 * 8 - 1] == rough_ground(189, 52));
}

static void heights(kmb_repository *repository)
{
    kmb_query *query = NULL;
    kmb_height height = {.struct_size = sizeof height};
    double x, y;
    CHECK_STATUS(KMB_OK, kmb_query_create(repository, 1 << 20, &query));
    CHECK_STATUS(KMB_OK, kmb_world_to_crs(repository, 1230, 4550, &x, &y));
    CHECK(x == 1230 && y == 4550);
    CHECK_STATUS(KMB_OK, kmb_crs_to_world(repository, 1230, 4550, &x, &y));
    CHECK(x == 1230 && y == 4550);
    kmb_repository_close(repository);
    /* The query outlives the repository. */
    CHECK_STATUS(KMB_OK, kmb_height_at(query, 1230, 4550, &height));
    CHECK(height.height == 100 + 0.5 * rough_ground(23, 45) && height.error_bound == 0);
    height.height = 0;
    CHECK_STATUS(KMB_OK, kmb_height_at_crs(query, 1230, 4550, &height));
    CHECK(height.height == 100 + 0.5 * rough_ground(23, 45));
    kmb_query_destroy(query);
}

static void round_trip(const char *path)
{
    kmb_builder *builder = described_builder(0);
    kmb_build_report report = {.struct_size = sizeof report};
    kmb_open_options positioned = {.struct_size = sizeof positioned, .access = KMB_ACCESS_POSITIONED};
    kmb_repository *repository = NULL;
    uint32_t next_row = 0;
    uint64_t progress[2] = {0, 1};
    CHECK_STATUS(KMB_OK, kmb_builder_write(builder, counted_rows, &next_row, counting, progress, path, &report));
    CHECK(next_row == HEIGHT && progress[0] == progress[1]);
    CHECK(report.samples == WIDTH * HEIGHT && report.max_error == 0 && report.bytes > 0);
    kmb_builder_destroy(builder);

    CHECK_STATUS(KMB_OK, kmb_repository_open(path, &positioned, &repository));
    description(repository);
    samples(repository);
    kmb_repository_close(repository);
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &repository));
    samples(repository);
    heights(repository);
}

static void voids(const char *path)
{
    kmb_builder *builder = described_builder(3);
    kmb_build_report report = {.struct_size = sizeof report};
    kmb_repository *repository = NULL;
    kmb_repository_info info = {.struct_size = sizeof info};
    kmb_query *query = NULL;
    kmb_height height = {.struct_size = sizeof height};
    double window[4];
    CHECK_STATUS(KMB_OK, kmb_builder_write(builder, holed_rows, NULL, NULL, NULL, path, &report));
    kmb_builder_destroy(builder);
    CHECK(report.void_samples == 2 && report.max_error <= 3);
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &repository));
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    CHECK(info.void_samples == 2 && info.max_error_bound == 3 && info.lossless == 0);
    CHECK_STATUS(KMB_OK, kmb_read_window(repository, info.levels, 70, 50, 2, 2, window, 4, NULL));
    CHECK(isnan(window[0]) && isnan(window[3]) && fabs(window[1] - rough_ground(71, 50)) <= 3);
    CHECK_STATUS(KMB_OK, kmb_query_create(repository, KMB_UNLIMITED, &query));
    CHECK_STATUS(KMB_OUTSIDE, kmb_height_at(query, 1700, 4500, &height));
    CHECK_STATUS(KMB_OK, kmb_height_at(query, 1750, 4500, &height));
    CHECK(height.error_bound <= 1.5);
    kmb_query_destroy(query);
    kmb_repository_close(repository);
}

static void transforms(const char *path)
{
    const uint32_t kinds[3] = {KMB_TRANSFORM_LIFTED, KMB_TRANSFORM_LIFTED, KMB_TRANSFORM_TWO_STAGE};
    const double max_errors[3] = {0, 0, 3}, rms_errors[3] = {0, 2, 0};
    for (int i = 0; i < 3; i++) {
        kmb_builder_options options = rough_options(max_errors[i]);
        kmb_builder *builder = NULL;
        kmb_build_report report = {.struct_size = sizeof report};
        kmb_repository *repository = NULL;
        kmb_repository_info info = {.struct_size = sizeof info};
        options.transform = kinds[i];
        options.rms_error = rms_errors[i];
        CHECK_STATUS(KMB_OK, kmb_builder_create(&options, &builder));
        CHECK_STATUS(KMB_OK, kmb_builder_write(builder, rough_rows, NULL, NULL, NULL, path, &report));
        kmb_builder_destroy(builder);
        CHECK(rms_errors[i] > 0 ? report.rms_error <= rms_errors[i] : report.max_error <= max_errors[i]);
        CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &repository));
        CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
        CHECK(info.max_error == report.max_error && info.max_error <= info.max_error_bound);
        CHECK(info.lossless == (i == 0));
        kmb_repository_close(repository);
    }
}

static void failures(char **words)
{
    const char *path = path_in(words, "never.kmb");
    kmb_builder *builder = described_builder(0);
    double value = INFINITY;
    int calls = 0;
    remove(path);
    CHECK_STATUS(KMB_CANCELLED, kmb_builder_write(builder, rough_rows, NULL, cancelling, &calls, path, NULL));
    CHECK(!exists(path));
    CHECK_STATUS(KMB_INPUT, kmb_builder_write(builder, failing_rows, NULL, NULL, NULL, path, NULL));
    CHECK(strstr(kmb_last_error(), "answered 42"));
    CHECK_STATUS(KMB_INPUT, kmb_builder_write(builder, wrong_rows, &value, NULL, NULL, path, NULL));
    CHECK(strstr(kmb_last_error(), "column 299, row 0"));
    value = 70000;
    CHECK_STATUS(KMB_INPUT, kmb_builder_write(builder, wrong_rows, &value, NULL, NULL, path, NULL));
    CHECK(strstr(kmb_last_error(), "70000") && strstr(kmb_last_error(), "column 299, row 0"));
    value = 0.5;
    CHECK_STATUS(KMB_INPUT, kmb_builder_write(builder, wrong_rows, &value, NULL, NULL, path, NULL));
    CHECK(!exists(path));
    path = path_in(words, "absent/never.kmb");
    CHECK_STATUS(KMB_IO, kmb_builder_write(builder, rough_rows, NULL, NULL, NULL, path, NULL));
    CHECK(strstr(kmb_last_error(), "absent"));
    kmb_builder_destroy(builder);
}

static void damage(char **words)
{
    static unsigned char bytes[1 << 20];
    char path[4096];
    kmb_repository *repository = NULL;
    snprintf(path, sizeof path, "%s", path_in(words, "absent.kmb"));
    remove(path);
    CHECK_STATUS(KMB_IO, kmb_repository_open(path, NULL, &repository));
    CHECK(strstr(kmb_last_error(), "absent.kmb"));

    FILE *whole = fopen(path_in(words, "round_trip.kmb"), "rb");
    CHECK(whole);
    size_t length = fread(bytes, 1, sizeof bytes, whole);
    fclose(whole);
    CHECK(length > 1000 && length < sizeof bytes);
    snprintf(path, sizeof path, "%s", path_in(words, "damaged.kmb"));
    for (int part = 0; part < 3; part++) {
        size_t kept = part == 0 ? length / 2 : part == 1 ? 5 : length;
        if (part == 2) bytes[100] ^= 1;
        FILE *file = fopen(path, "wb");
        CHECK(file && fwrite(bytes, 1, kept, file) == kept && fclose(file) == 0);
        CHECK_STATUS(KMB_DAMAGED, kmb_repository_open(path, NULL, &repository));
        CHECK(strstr(kmb_last_error(), "damaged.kmb"));
    }
    CHECK(repository == NULL);
}

static void log_message(void *user, uint32_t level, const char *message)
{
    (void)level, (void)message;
    ++*(int *)user;
}

int main(int count, char **words)
{
    int messages = 0;
    CHECK(count == 2);
    CHECK(!strcmp(kmb_status_name(KMB_DAMAGED), "KMB_DAMAGED") && !strcmp(kmb_status_name(-1), "unknown status"));
    CHECK(!strcmp(kmb_status_name(KMB_PANIC), "KMB_PANIC") && !strcmp(kmb_status_name(13), "unknown status"));
    CHECK(kmb_version()[0] != 0 && kmb_last_error()[0] == 0);
    CHECK_STATUS(KMB_OK, kmb_set_log_callback(log_message, &messages));
    round_trip(path_in(words, "round_trip.kmb"));
    voids(path_in(words, "voids.kmb"));
    transforms(path_in(words, "transforms.kmb"));
    failures(words);
    damage(words);
    CHECK_STATUS(KMB_OK, kmb_set_log_callback(NULL, NULL));
    return 0;
}
