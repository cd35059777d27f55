/* Rays meet the surface where its height says that it is, lines of sight end at it, and bad ones are refused. */
#include <math.h>

#include "check.h"

static kmb_ray downwards(const kmb_repository_info *info, double share)
{
    kmb_ray ray = {.struct_size = sizeof ray, .direction = {0, 0, -1}, .longest = INFINITY};
    ray.origin[0] = info->world_origin[0] + info->world_step[0] * (info->width - 1) * share;
    ray.origin[1] = info->world_origin[1] + info->world_step[1] * (info->height - 1) * (1 - share * share);
    ray.origin[2] = info->sample_max * 2 + 1e5;
    return ray;
}

static void rays_meet_the_height_there(kmb_query *query, const kmb_repository_info *info)
{
    for (int i = 1; i < 50; i++) {
        kmb_ray ray = downwards(info, i / 50.0);
        kmb_height height = {.struct_size = sizeof height};
        kmb_hit hit = {.struct_size = sizeof hit};
        CHECK_STATUS(KMB_OK, kmb_height_at(query, ray.origin[0], ray.origin[1], &height));
        CHECK_STATUS(KMB_OK, kmb_ray_intersect(query, &ray, &hit));
        CHECK(hit.struct_size == sizeof hit && hit.level == info->levels);
        CHECK(fabs(hit.place[2] - height.height) < 1e-6 && fabs(hit.distance - (ray.origin[2] - hit.place[2])) < 1e-6);
        /* From another side, towards a place just under the surface there. */
        for (int axis = 0; axis < 3; axis++) ray.direction[axis] = hit.place[axis] - ray.origin[axis];
        ray.origin[0] += 1000;
        ray.direction[0] -= 1000;
        ray.direction[2] -= 0.01;
        CHECK_STATUS(KMB_OK, kmb_ray_intersect(query, &ray, &hit));
        CHECK(hit.distance > 0 && hit.distance <= 1);
        ray.direction[2] = 1;
        ray.direction[0] = ray.direction[1] = 0;
        CHECK_STATUS(KMB_OUTSIDE, kmb_ray_intersect(query, &ray, &hit));
    }
}

static void the_ground_hides_what_is_under_it(kmb_query *query, const kmb_repository_info *info)
{
    kmb_ray ray = downwards(info, 0.5);
    kmb_hit hit = {.struct_size = sizeof hit};
    CHECK_STATUS(KMB_OK, kmb_ray_intersect(query, &ray, &hit));
    int32_t visible = -1;
    double over[3] = {hit.place[0], hit.place[1], hit.place[2] + 1}, under[3] = {hit.place[0], hit.place[1], hit.place[2] - 1};
    CHECK_STATUS(KMB_OK, kmb_line_of_sight(query, ray.origin, over, &visible));
    CHECK(visible == 1);
    CHECK_STATUS(KMB_OK, kmb_line_of_sight(query, ray.origin, hit.place, &visible));
    CHECK(visible == 1);
    CHECK_STATUS(KMB_OK, kmb_line_of_sight(query, under, over, &visible));
    CHECK(visible == 0);
}

static void bad_rays_are_refused(kmb_query *query, const kmb_repository_info *info)
{
    kmb_hit hit = {.struct_size = sizeof hit};
    kmb_ray good = downwards(info, 0.5);
    int32_t visible = -1;
    double nowhere[3] = {NAN, 0, 0};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_ray_intersect(NULL, &good, &hit));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_ray_intersect(query, NULL, &hit));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_ray_intersect(query, &good, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_line_of_sight(query, NULL, good.origin, &visible));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_line_of_sight(query, good.origin, NULL, &visible));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_line_of_sight(query, good.origin, nowhere, &visible));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_line_of_sight(query, good.origin, good.origin, NULL));
    kmb_ray bad = good;
    bad.origin[1] = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_ray_intersect(query, &bad, &hit));
    bad = good;
    bad.direction[2] = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_ray_intersect(query, &bad, &hit));
    bad = good;
    bad.longest = -1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_ray_intersect(query, &bad, &hit));
    bad.struct_size = 8;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_ray_intersect(query, &bad, &hit));
    hit.struct_size = 8;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_ray_intersect(query, &good, &hit));
    CHECK(visible == -1);
}

int main(int count, char **words)
{
    CHECK(count == 2);
    kmb_repository *repository = rough_repository(path_in(words, "rays.kmb"));
    kmb_repository_info info = {.struct_size = sizeof info};
    kmb_query *query = NULL;
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &info));
    CHECK_STATUS(KMB_OK, kmb_query_create(repository, 16 << 20, &query));
    rays_meet_the_height_there(query, &info);
    the_ground_hides_what_is_under_it(query, &info);
    bad_rays_are_refused(query, &info);
    kmb_query_destroy(query);
    kmb_repository_close(repository);
    return 0;
}
