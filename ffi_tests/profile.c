/* Profiles are straight between their places and have the heights there, statistics are those of boxes whose ground is known,
 * and bad lines and polygons are refused. */
#include <math.h>
#include <string.h>

#include "check.h"

enum { MOST = 4096 };

static double x_at(const kmb_repository_info *info, double column)
{
    return info->world_origin[0] + info->world_step[0] * column;
}

static double y_at(const kmb_repository_info *info, double row)
{
    return info->world_origin[1] + info->world_step[1] * row;
}

static void a_profile_has_the_heights_of_its_places(kmb_query *query, const kmb_repository_info *info)
{
    static kmb_profile_place places[MOST];
    const double line[] = {x_at(info, 3.25), y_at(info, 7.5), x_at(info, 250), y_at(info, 120.125), x_at(info, 250), y_at(info, 20)};
    size_t count = 0, same = 0;
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_profile(query, line, 3, NULL, 0, &count));
    CHECK(count > 600 && count <= MOST);
    places[0].struct_size = sizeof places[0];
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_profile(query, line, 3, places, count - 1, &same));
    CHECK(same == count && places[1].struct_size == 0);
    CHECK_STATUS(KMB_OK, kmb_profile(query, line, 3, places, count, &same));
    CHECK(same == count && places[0].distance == 0 && places[0].place[0] == line[0] && places[0].place[1] == line[1]);
    CHECK(places[count - 1].place[0] == line[4] && places[count - 1].place[1] == line[5]);
    for (size_t i = 0; i < count; i++) {
        kmb_height height = {.struct_size = sizeof height};
        CHECK(places[i].struct_size == sizeof places[i] && places[i].level == info->levels && places[i].error_bound == 0);
        CHECK_STATUS(KMB_OK, kmb_height_at(query, places[i].place[0], places[i].place[1], &height));
        CHECK(fabs(places[i].height - height.height) < 1e-5);
        if (i == 0) continue;
        CHECK(places[i].distance > places[i - 1].distance);
        double x = (places[i].place[0] + places[i - 1].place[0]) / 2, y = (places[i].place[1] + places[i - 1].place[1]) / 2;
        CHECK_STATUS(KMB_OK, kmb_height_at(query, x, y, &height));
        CHECK(fabs((places[i].height + places[i - 1].height) / 2 - height.height) < 1e-5);
    }
}

static void a_profile_ends_at_the_edge(kmb_query *query, const kmb_repository_info *info)
{
    kmb_profile_place places[64];
    const double line[] = {x_at(info, -5), y_at(info, 8), x_at(info, 4), y_at(info, 8)};
    size_t count = 0;
    places[0].struct_size = sizeof places[0];
    CHECK_STATUS(KMB_OK, kmb_profile(query, line, 2, places, 64, &count));
    CHECK(count == 7);
    CHECK(isnan(places[0].height) && isnan(places[1].height) && isnan(places[1].error_bound) && places[1].level == 0);
    CHECK(places[1].distance == places[2].distance && fabs(places[2].distance - 50) < 1e-9);
    for (int i = 2; i < 7; i++) CHECK(fabs(places[i].height - rough_ground(i - 2, 8)) < 1e-6);
    places[0].struct_size = sizeof places[0];
    CHECK_STATUS(KMB_OK, kmb_profile_samples(query, line, 2, places, 10));
    for (int i = 0; i < 10; i++) {
        CHECK(places[i].struct_size == sizeof places[i] && fabs(places[i].distance - 10 * i) < 1e-9);
        CHECK(i < 5 ? isnan(places[i].height) : fabs(places[i].height - rough_ground(i - 5, 8)) < 1e-6);
    }
}

static void a_box_has_the_statistics_of_its_ground(kmb_query *query, const kmb_repository_info *info)
{
    /* From sample to sample, so that the extremes are at samples; whole cells, whose triangles weigh the same. */
    double least = INFINITY, greatest = -INFINITY, left = x_at(info, 30), right = x_at(info, 130), top = y_at(info, 40), bottom = y_at(info, 99);
    for (uint32_t row = 40; row <= 99; row++) {
        for (uint32_t column = 30; column <= 130; column++) {
            least = fmin(least, rough_ground(column, row));
            greatest = fmax(greatest, rough_ground(column, row));
        }
    }
    const double box[] = {left, top, right, top, right, bottom, left, bottom};
    kmb_area area = {.struct_size = sizeof area};
    CHECK_STATUS(KMB_OK, kmb_area_statistics(query, box, 4, &area));
    CHECK(area.struct_size == sizeof area && area.level == info->levels && area.error_bound == 0);
    CHECK(fabs(area.minimum - least) < 1e-6 && fabs(area.maximum - greatest) < 1e-6);
    CHECK(fabs(area.area - 1000.0 * 590.0) < 1e-3 && area.mean > least && area.mean < greatest);
    /* Both triangles of the box together. */
    kmb_area first = area, second = area;
    const double other[] = {left, top, right, bottom, left, bottom};
    CHECK_STATUS(KMB_OK, kmb_area_statistics(query, box, 3, &first));
    CHECK_STATUS(KMB_OK, kmb_area_statistics(query, other, 3, &second));
    CHECK(fabs(first.area + second.area - area.area) < 1e-3);
    CHECK(fabs(first.mean * first.area + second.mean * second.area - area.mean * area.area) < 1e-6 * area.mean * area.area);
}

static void bad_lines_are_refused(kmb_query *query, const kmb_repository_info *info)
{
    kmb_profile_place places[64];
    size_t count = 77;
    double line[] = {x_at(info, 5), y_at(info, 8), x_at(info, 9), y_at(info, 8)};
    places[0].struct_size = sizeof places[0];
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(NULL, line, 2, places, 64, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(query, NULL, 2, places, 64, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(query, line, 1, places, 64, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(query, line, 0, places, 64, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(query, line, 2, NULL, 64, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(query, line, 2, places, 64, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(NULL, line, 2, places, 3));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(query, NULL, 2, places, 3));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(query, line, 1, places, 3));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(query, line, 2, NULL, 3));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(query, line, 2, places, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(query, line, 2, places, SIZE_MAX / 2));
    places[0].struct_size = 8;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_profile(query, line, 2, places, 64, &count));
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_profile_samples(query, line, 2, places, 3));
    places[0].struct_size = sizeof places[0];
    line[3] = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile(query, line, 2, places, 64, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_profile_samples(query, line, 2, places, 3));
    CHECK(count == 77);
}

static void bad_polygons_are_refused(kmb_query *query, const kmb_repository_info *info)
{
    kmb_area area = {.struct_size = sizeof area};
    double left = x_at(info, 5), right = x_at(info, 9), top = y_at(info, 5), bottom = y_at(info, 9);
    const double good[] = {left, top, right, top, right, bottom, left, bottom};
    const double crossed[] = {left, top, right, bottom, right, top, left, bottom};
    const double flat[] = {left, top, right, bottom, left, top};
    const double endless[] = {left, top, INFINITY, top, right, bottom};
    const double beside[] = {left - 1000, top, left - 900, top, left - 900, bottom};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(NULL, good, 4, &area));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(query, NULL, 4, &area));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(query, good, 4, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(query, good, 2, &area));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(query, crossed, 4, &area));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(query, flat, 3, &area));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_area_statistics(query, endless, 3, &area));
    CHECK_STATUS(KMB_OUTSIDE, kmb_area_statistics(query, beside, 3, &area));
    area.struct_size = 8;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_area_statistics(query, good, 4, &area));
}

int main(int count, char **words)
{
    CHECK(count == 2);
    kmb_repository *repository = rough_repository(path_in(words, "profile.kmb"));
    kmb_repository_info info = {.struct_size = sizeof info};
    kmb_query *query = NULL;
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    CHECK_STATUS(KMB_OK, kmb_query_create(repository, 16 << 20, &query));
    a_profile_has_the_heights_of_its_places(query, &info);
    a_profile_ends_at_the_edge(query, &info);
    a_box_has_the_statistics_of_its_ground(query, &info);
    bad_lines_are_refused(query, &info);
    bad_polygons_are_refused(query, &info);
    kmb_query_destroy(query);
    kmb_repository_close(repository);
    return 0;
}
