/* A damaged repository says so, and after a repair it serves all that is sound: coarser ground where detail is missing, within the
 * bound that comes with it, and never an error. */
#include <math.h>
#include <string.h>

#include "check.h"

static unsigned char bytes[1 << 21];
static double window[WIDTH * HEIGHT];

static size_t read_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    CHECK(file);
    size_t length = fread(bytes, 1, sizeof bytes, file);
    CHECK(length < sizeof bytes && fclose(file) == 0);
    return length;
}

static void write_file(const char *path, size_t length)
{
    FILE *file = fopen(path, "wb");
    CHECK(file && fwrite(bytes, 1, length, file) == length && fclose(file) == 0);
}

static kmb_repository *open_file(const char *path, kmb_repository_info *info)
{
    kmb_repository *repository = NULL;
    *info = (kmb_repository_info){.struct_size = sizeof *info};
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &repository));
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, info));
    return repository;
}

static int32_t counting(void *user, uint64_t done, uint64_t total)
{
    CHECK(done <= total);
    ++*(int *)user;
    return 0;
}

static int32_t cancelling(void *user, uint64_t done, uint64_t total)
{
    (void)user, (void)done, (void)total;
    return 1;
}

static void damaged(const char *path)
{
    kmb_repository_info info;
    kmb_repository *repository = open_file(path, &info);
    uint64_t coarse = 7;
    CHECK(info.missing_detail == 0);
    CHECK_STATUS(KMB_DAMAGED,
                 kmb_read_window(repository, info.levels, 0, 0, WIDTH, HEIGHT, window, WIDTH * HEIGHT, &coarse));
    CHECK(coarse == 7 && strstr(kmb_last_error(), "checksum mismatch"));
    kmb_repository_close(repository);
}

static void heights(kmb_repository *repository, uint32_t levels)
{
    kmb_query *query = NULL;
    uint32_t coarse = 0;
    CHECK_STATUS(KMB_OK, kmb_query_create(repository, 1 << 20, &query));
    for (uint32_t row = 0; row < HEIGHT; row += 3) {
        for (uint32_t column = 0; column < WIDTH; column += 3) {
            kmb_height height = {.struct_size = sizeof height};
            CHECK_STATUS(KMB_OK, kmb_height_at(query, 1000 + 10.0 * column, 5000 - 10.0 * row, &height));
            CHECK(fabs(height.height - rough_ground(column, row)) <= height.error_bound + 1e-9);
            CHECK(height.level == levels ? height.error_bound == 0 : height.error_bound > 0);
            coarse += height.level < levels;
        }
    }
    CHECK(coarse > 0);
    kmb_query_destroy(query);
}

static void views(const kmb_repository *repository)
{
    kmb_cut *cut = NULL;
    kmb_view view = view_from_above(1);
    kmb_stats stats = {.struct_size = sizeof stats};
    view.tolerance = 1e-3;
    CHECK_STATUS(KMB_OK, kmb_cut_create(repository, NULL, &cut));
    for (int i = 0; i < 3; i++) CHECK_STATUS(KMB_OK, kmb_cut_update(cut, &view, NULL, &stats));
    /* What cannot be refined is over the tolerance, and no budget is the cause. */
    CHECK(stats.refined == 0 && stats.added == 0 && stats.cut_short == 0 && stats.largest_error > view.tolerance);
    kmb_cut_destroy(cut);
}

static void repaired(const char *path, const kmb_repair_report *report)
{
    kmb_repository_info info;
    kmb_repository *repository = open_file(path, &info);
    uint64_t coarse = 0, different = 0;
    CHECK(info.missing_detail == 1 && info.bytes == report->bytes);
    CHECK_STATUS(KMB_OK,
                 kmb_read_window(repository, info.levels, 0, 0, WIDTH, HEIGHT, window, WIDTH * HEIGHT, &coarse));
    for (uint32_t row = 0; row < HEIGHT; row++)
        for (uint32_t column = 0; column < WIDTH; column++)
            different += window[row * WIDTH + column] != rough_ground(column, row);
    CHECK(coarse == report->coarse_samples && different > 0 && different <= coarse);
    heights(repository, info.levels);
    views(repository);
    kmb_repository_close(repository);
}

static void refuse(const char *path, size_t length)
{
    kmb_repair_report report = {.struct_size = 3};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_repair(NULL, NULL, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_repository_repair("", NULL, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_repository_repair(path, NULL, NULL, NULL, &report));
    CHECK_STATUS(KMB_CANCELLED, kmb_repository_repair(path, NULL, cancelling, NULL, NULL));
    CHECK(read_file(path) == length);
    /* The roots. */
    uint64_t roots;
    memcpy(&roots, bytes + 224, sizeof roots);
    bytes[roots] ^= 1;
    write_file(path, length);
    CHECK_STATUS(KMB_DAMAGED, kmb_repository_repair(path, NULL, NULL, NULL, NULL));
    CHECK(strstr(kmb_last_error(), "roots"));
    bytes[roots] ^= 1;
    write_file(path, length);
}

int main(int count, char **words)
{
    char path[4096], output[4096];
    kmb_repair_report report = {.struct_size = sizeof report};
    kmb_repository_info info;
    int calls = 0;
    CHECK(count == 2);
    snprintf(path, sizeof path, "%s", path_in(words, "repair.kmb"));
    snprintf(output, sizeof output, "%s", path_in(words, "repaired.kmb"));
    kmb_repository_close(rough_repository(path));
    size_t length = read_file(path);
    bytes[length - 5] ^= 0x40;
    write_file(path, length);
    damaged(path);
    refuse(path, length);

    CHECK_STATUS(KMB_OK, kmb_repository_repair(path, output, counting, &calls, &report));
    CHECK(calls > 0 && report.damaged_blocks > 0 && report.damaged_blocks <= 8);
    CHECK(report.lost_blocks == report.damaged_blocks && report.missing_blocks == report.lost_blocks);
    CHECK(report.blocked_blocks == report.lost_blocks && report.coarse_samples > 0 && report.coarse_percent < 10);
    repaired(output, &report);
    damaged(path);

    /* In place, under a repository that is open. */
    kmb_repository *old = open_file(path, &info);
    CHECK(report.coarsest_level == info.levels - 1);
    CHECK_STATUS(KMB_OK, kmb_repository_repair(path, NULL, NULL, NULL, &report));
    repaired(path, &report);
    CHECK_STATUS(KMB_OK, kmb_read_window(old, info.levels, 0, 0, 9, 9, window, 81, NULL));
    CHECK(window[80] == rough_ground(8, 8));
    kmb_repository_close(old);
    CHECK_STATUS(KMB_OK, kmb_repository_repair(path, NULL, NULL, NULL, &report));
    CHECK(report.damaged_blocks == 0 && report.missing_blocks > 0);
    return 0;
}
