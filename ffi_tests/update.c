/* New samples in a part of a repository: readers of the old file go on with it, the new one has them, and a repository that is not
 * lossless wants its originals. */
#include <string.h>

#include "check.h"

enum { COLUMN = 120, ROW = 60, COLUMNS = 24, ROWS = 16 };

static double window[WIDTH * HEIGHT];

static int in_region(uint32_t column, uint32_t row)
{
    return column >= COLUMN && column < COLUMN + COLUMNS && row >= ROW && row < ROW + ROWS;
}

static double new_ground(uint32_t column, uint32_t row)
{
    double old = rough_ground(column, row);
    return in_region(column, row) && old < 2000 ? old + 7 : old;
}

/* Rows of the region, or of the whole raster where `user` says so. */
static int32_t new_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    int is_whole = *(int *)user;
    uint32_t left = is_whole ? 0 : COLUMN, top = is_whole ? 0 : ROW, width = is_whole ? WIDTH : COLUMNS;
    for (uint32_t row = first_row; row < first_row + row_count; row++)
        for (uint32_t column = 0; column < width; column++) *samples++ = new_ground(left + column, top + row);
    return 0;
}

static int32_t failing_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    (void)user, (void)first_row, (void)row_count, (void)samples;
    return 5;
}

static int32_t cancelling(void *user, uint64_t done, uint64_t total)
{
    (void)user, (void)done, (void)total;
    return 1;
}

static void has_ground(kmb_repository *repository, double (*ground)(uint32_t, uint32_t), double max_error)
{
    kmb_repository_info info = {.struct_size = sizeof info};
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    CHECK_STATUS(KMB_OK,
                 kmb_read_window(repository, info.levels, 0, 0, WIDTH, HEIGHT, window, WIDTH * HEIGHT, NULL));
    for (uint32_t row = 0; row < HEIGHT; row++) {
        for (uint32_t column = 0; column < WIDTH; column++) {
            double difference = window[row * WIDTH + column] - ground(column, row);
            CHECK(difference <= max_error && -difference <= max_error);
        }
    }
}

static void refuse(const char *path, kmb_update_options options)
{
    int part = 0;
    kmb_update_report report = {.struct_size = 5};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_update(NULL, &options, new_rows, &part, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_update(path, NULL, new_rows, &part, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_update(path, &options, NULL, NULL, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_repository_update(path, &options, new_rows, &part, NULL, NULL, &report));
    CHECK_STATUS(KMB_INPUT, kmb_repository_update(path, &options, failing_rows, NULL, NULL, NULL, NULL));
    CHECK_STATUS(KMB_CANCELLED, kmb_repository_update(path, &options, new_rows, &part, cancelling, NULL, NULL));
    options.column = WIDTH - 3;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_update(path, &options, new_rows, &part, NULL, NULL, NULL));
    CHECK(strstr(kmb_last_error(), "not inside the raster"));
    options.width = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_update(path, &options, new_rows, &part, NULL, NULL, NULL));
}

static void build_lossy(const char *path)
{
    kmb_builder_options options = rough_options(3);
    kmb_builder *builder = NULL;
    CHECK_STATUS(KMB_OK, kmb_builder_create(&options, &builder));
    CHECK_STATUS(KMB_OK, kmb_builder_write(builder, rough_rows, NULL, NULL, NULL, path, NULL));
    kmb_builder_destroy(builder);
}

int main(int count, char **words)
{
    char path[4096];
    int part = 0, whole = 1;
    kmb_update_options options = {.struct_size = sizeof options, .column = COLUMN, .row = ROW, .width = COLUMNS,
                                  .height = ROWS, .threads = 1};
    kmb_update_report report = {.struct_size = sizeof report};
    kmb_repository *old, *updated = NULL;
    CHECK(count == 2);
    snprintf(path, sizeof path, "%s", path_in(words, "update.kmb"));
    old = rough_repository(path);
    refuse(path, options);
    CHECK_STATUS(KMB_OK, kmb_repository_update(path, &options, new_rows, &part, NULL, NULL, &report));
    CHECK(report.diamonds_recomputed > 0 && report.diamonds_recomputed <= report.diamonds && report.bytes > 0);
    has_ground(old, rough_ground, 0);
    kmb_repository_close(old);
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &updated));
    has_ground(updated, new_ground, 0);
    kmb_repository_close(updated);

    build_lossy(path);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_update(path, &options, new_rows, &part, NULL, NULL, &report));
    CHECK(strstr(kmb_last_error(), "not lossless"));
    options.rows_are_whole = 1;
    CHECK_STATUS(KMB_OK, kmb_repository_update(path, &options, new_rows, &whole, NULL, NULL, &report));
    CHECK(report.diamonds_recomputed == report.diamonds);
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &updated));
    has_ground(updated, new_ground, 3);
    kmb_repository_close(updated);
    return 0;
}
