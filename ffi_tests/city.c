/* A city is built from triangles, opened, read, visited within budgets and met by rays; what is wrong is refused, and what is damaged
 * is found. */
#define _POSIX_C_SOURCE 200809L /* nanosleep */
#include <math.h>
#include <string.h>
#include <time.h>

#include "check.h"

enum { SIDE = 32, BOXES = 9 };
static const double WEST = 85000, SOUTH = 446000;

static double ground_height(double x, double y) { return 0.02 * (x - WEST) + 0.01 * (y - SOUTH); }

/* There is no ground in the north. */
static int32_t ground(void *user, double x, double y, double *height)
{
    ++*(int *)user;
    *height = ground_height(x, y);
    return y > SOUTH + 80;
}

/* The four walls and the roof of a box, two triangles each. */
static void box(double x, double y, double side, double low, double high, double triangles[10][9])
{
    const double at[4][2] = {{x, y}, {x + side, y}, {x + side, y + side}, {x, y + side}};
    for (int wall = 0; wall < 4; wall++) {
        const double *a = at[wall], *b = at[(wall + 1) % 4];
        double quad[2][9] = {{a[0], a[1], low, b[0], b[1], low, b[0], b[1], high},
                             {a[0], a[1], low, b[0], b[1], high, a[0], a[1], high}};
        memcpy(triangles + 2 * wall, quad, sizeof quad);
    }
    double roof[2][9] = {{x, y, high, x + side, y, high, x + side, y + side, high},
                         {x, y, high, x + side, y + side, high, x, y + side, high}};
    memcpy(triangles + 8, roof, sizeof roof);
}

static double roof_of(int number) { return 8 + 3 * number; }

/* Nine boxes, three of each kind of paint. */
static kmb_city_builder *builder_of(uint32_t height_bits)
{
    static const uint8_t CHEQUERS[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
    static const float PLACES[2][6] = {{0, 0, 3, 0, 3, 4}, {0, 0, 3, 4, 0, 4}};
    kmb_city_options options = {.struct_size = sizeof options, .side_texels = SIDE, .views = 6, .height_bits = height_bits,
                                .leaf_side = 32, .threads = 1, .memory = 64};
    kmb_city_builder *builder = NULL;
    uint32_t texture = 7;
    float coordinates[10][6];
    for (int triangle = 0; triangle < 10; triangle++) memcpy(coordinates[triangle], PLACES[triangle % 2], sizeof PLACES[0]);
    CHECK_STATUS(KMB_OK, kmb_city_builder_create(&options, &builder));
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_texture(builder, 2, 2, CHEQUERS, &texture));
    CHECK(texture == 0);
    for (int number = 0; number < BOXES; number++) {
        double triangles[10][9];
        kmb_city_paint paint = {.struct_size = sizeof paint, .kind = (uint32_t)number % 3, .colour = {200, 40, 40},
                                .texture = texture, .seed = (uint32_t)number, .coordinates = coordinates[0]};
        box(WEST + 10 + 32 * (number % 3), SOUTH + 10 + 32 * (number / 3), 16, -5, roof_of(number), triangles);
        CHECK_STATUS(KMB_OK, kmb_city_builder_add_triangles(builder, 10, triangles[0], &paint));
    }
    CHECK_STATUS(KMB_OK, kmb_city_builder_set_crs(builder, "EPSG:28992"));
    CHECK_STATUS(KMB_OK, kmb_city_builder_set_plane(builder, -2));
    return builder;
}

static int32_t count_steps(void *user, uint64_t done, uint64_t total)
{
    CHECK(done > 0 && done <= total);
    ++*(int *)user;
    return 0;
}

static int32_t stop(void *user, uint64_t done, uint64_t total)
{
    (void)user, (void)done, (void)total;
    return 1;
}

static void a_city_is_built(const char *path, uint32_t height_bits)
{
    int asked = 0, steps = 0;
    kmb_city_builder *builder = builder_of(height_bits);
    kmb_city_report report = {.struct_size = sizeof report};
    CHECK_STATUS(KMB_OK, kmb_city_builder_set_ground(builder, ground, &asked, 20));
    CHECK_STATUS(KMB_CANCELLED, kmb_city_builder_build(builder, path, stop, NULL, &report));
    CHECK(!exists(path) && report.blocks == 0);
    CHECK_STATUS(KMB_OK, kmb_city_builder_build(builder, path, count_steps, &steps, &report));
    CHECK(asked > 0 && steps == (int)report.leaves && report.leaves == 16 && report.blocks == 21 && report.levels == 3);
    CHECK(report.triangles == 10 * BOXES && report.wall_texels > 100 && report.bytes > 0);
    kmb_city_builder_destroy(builder);
}

static void its_nodes_are_squares(const kmb_city *city, const kmb_city_info *info)
{
    for (uint32_t index = 0; index < info->nodes; index++) {
        kmb_city_node node = {.struct_size = sizeof node}, child = node;
        CHECK_STATUS(KMB_OK, kmb_city_node_at(city, index, &node));
        CHECK((node.parent == KMB_NO_NODE) == (index == 0) && (node.first_child == KMB_NO_NODE) == (node.level == 2));
        CHECK(node.side == info->side / (1 << node.level) && node.heights[0] <= node.heights[1]);
        CHECK((node.error == 0) == (node.level == 2) && node.error >= node.height_error);
        for (uint32_t quarter = 0; node.first_child != KMB_NO_NODE && quarter < 4; quarter++) {
            CHECK_STATUS(KMB_OK, kmb_city_node_at(city, node.first_child + quarter, &child));
            CHECK(child.parent == index && child.level == node.level + 1 && child.place[0] == 2 * node.place[0] + quarter % 2);
            CHECK(child.corner[1] == node.corner[1] + quarter / 2 * child.side);
        }
    }
}

static void its_blocks_are_read(const kmb_city *city, const kmb_city_info *info, uint32_t height_bits)
{
    uint8_t *image = malloc((size_t)info->image_bytes), low[SIDE * SIDE];
    kmb_blockmap block = {.struct_size = sizeof block};
    CHECK(image && info->image_bytes == (2 * SIDE + 256) * SIDE * 4);
    CHECK(info->low_height_bytes == (height_bits == 16 ? SIDE * SIDE : 0));
    for (uint32_t node = 0; node < info->nodes; node++) {
        CHECK_STATUS(KMB_OK, kmb_city_read(city, node, image, (size_t)info->image_bytes, low, sizeof low, &block));
        CHECK(block.image == image && block.side_texels == SIDE && block.height_bits == height_bits);
        CHECK(block.low_heights == (height_bits == 16 ? low : NULL) && block.exposure == 1.5f);
        CHECK_STATUS(KMB_OK, kmb_city_read(city, node, image, (size_t)info->image_bytes, NULL, 0, &block));
        CHECK(!block.low_heights && block.low_height_bytes == 0);
    }
    CHECK_STATUS(KMB_OK, kmb_city_read(city, 0, image, (size_t)info->image_bytes, NULL, 0, NULL));
    block.struct_size = 3;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_read(city, 0, image, (size_t)info->image_bytes, NULL, 0, &block));
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_city_read(city, 0, image, (size_t)info->image_bytes - 1, NULL, 0, NULL));
    if (height_bits == 16)
        CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_city_read(city, 0, image, (size_t)info->image_bytes, low, 1, NULL));
    CHECK_STATUS(KMB_NOT_FOUND, kmb_city_read(city, info->nodes, image, (size_t)info->image_bytes, NULL, 0, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_read(city, 0, NULL, (size_t)info->image_bytes, NULL, 0, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_read(NULL, 0, image, (size_t)info->image_bytes, NULL, 0, NULL));
    free(image);
}

/* Down on the whole city by a parallel projection; `pixels` of the picture are a metre. */
static kmb_view view_of(const kmb_city_info *info, double pixels, double tolerance)
{
    double x = info->corner[0] + info->side / 2, y = info->corner[1] + info->side / 2, half = 1000 / pixels / 2;
    kmb_view view = {.struct_size = sizeof view, .viewport = {1000, 1000}, .tolerance = tolerance, .eye = {x, y, 500}};
    view.world_to_clip[0] = view.world_to_clip[5] = 1 / half;
    view.world_to_clip[10] = -1e-3;
    view.world_to_clip[12] = -x / half;
    view.world_to_clip[13] = -y / half;
    view.world_to_clip[15] = 1;
    return view;
}

/* Whether all of the root's square is drawn, each part once. */
static void check_cover(const kmb_city *city, const kmb_city_visit *visit)
{
    const kmb_city_drawn *drawn;
    size_t count;
    double area = 0;
    kmb_city_node node = {.struct_size = sizeof node}, root = node;
    CHECK_STATUS(KMB_OK, kmb_city_node_at(city, 0, &root));
    CHECK_STATUS(KMB_OK, kmb_city_visit_drawn(visit, &drawn, &count));
    for (size_t i = 0; i < count; i++) {
        kmb_blockmap block = {.struct_size = sizeof block};
        CHECK(drawn[i].struct_size == sizeof *drawn && drawn[i].quarters > 0 && drawn[i].quarters < 16);
        CHECK_STATUS(KMB_OK, kmb_city_node_at(city, drawn[i].node, &node));
        CHECK_STATUS(KMB_OK, kmb_city_visit_block(visit, drawn[i].node, &block));
        CHECK(block.side == node.side && block.image && block.side_texels == SIDE);
        for (uint32_t quarter = 0; quarter < 4; quarter++) area += (drawn[i].quarters >> quarter & 1) * node.side * node.side / 4;
    }
    CHECK(area == root.side * root.side);
}

/* Lets threads decode, however slowly they run under a checker. */
static void await(uint32_t threads)
{
    struct timespec pause = {0, 10000000};
    if (threads > 0) nanosleep(&pause, NULL);
}

static void visits_keep_to_their_budgets(const kmb_city *city, const kmb_city_info *info, uint32_t threads)
{
    uint64_t each = info->image_bytes + info->low_height_bytes;
    kmb_city_visit *visit = NULL;
    kmb_city_stats stats = {.struct_size = sizeof stats};
    kmb_view view = view_of(info, 4, 0);
    kmb_budget budget = no_limits();
    const uint32_t *nodes;
    size_t count, held = 0;
    CHECK_STATUS(KMB_OK, kmb_city_visit_create(city, threads, &visit));
    budget.refinements = 3, budget.bytes = 9 * each;
    for (int frame = 0; frame < 2000 && (frame < 30 || held < 9); frame++) {
        CHECK_STATUS(KMB_OK, kmb_city_visit_update(visit, &view, &budget, &stats));
        CHECK_STATUS(KMB_OK, kmb_city_visit_added(visit, &nodes, &count));
        held += count;
        CHECK(stats.loaded <= 3 && count == stats.loaded + (frame == 0));
        CHECK_STATUS(KMB_OK, kmb_city_visit_removed(visit, &nodes, &count));
        held -= count;
        CHECK(count == stats.dropped && held == stats.resident && stats.bytes == held * each && held <= 9);
        CHECK(stats.failed == 0 && stats.microseconds > 0 && stats.upload_bytes == stats.loaded * each);
        check_cover(city, visit);
        await(threads);
    }
    CHECK(stats.cut_short && stats.drawn > 1);
    budget = no_limits(), budget.bytes = each - 1;
    CHECK_STATUS(KMB_BUDGET_TOO_SMALL, kmb_city_visit_update(visit, &view, &budget, &stats));
    CHECK(stats.drawn == 1 && stats.resident == 1);
    for (int frame = 0; frame < 2000 && (stats.cut_short || frame == 0); frame++) {
        CHECK_STATUS(KMB_OK, kmb_city_visit_update(visit, &view, NULL, &stats));
        await(threads);
    }
    CHECK(!stats.cut_short && stats.largest_error == 0);
    view.tolerance = 1e9;
    CHECK_STATUS(KMB_OK, kmb_city_visit_update(visit, &view, NULL, &stats));
    CHECK(stats.drawn == 1);
    kmb_city_visit_destroy(visit);
}

static void what_a_terrain_leaves_is_told(void)
{
    kmb_stats used = {.struct_size = sizeof used, .refined = 5, .patches = 10, .bytes = 700, .microseconds = 12.5, .upload_bytes = 90};
    kmb_budget budget = {.struct_size = sizeof budget, .microseconds = 100, .refinements = 4, .bytes = 1000,
                         .upload_bytes = KMB_UNLIMITED, .patches = 11}, rest = {.struct_size = sizeof rest};
    CHECK_STATUS(KMB_OK, kmb_budget_rest(&budget, &used, &rest));
    CHECK(rest.microseconds == 87 && rest.refinements == 0 && rest.bytes == 300 && rest.upload_bytes == KMB_UNLIMITED
          && rest.patches == 1 && rest.struct_size == sizeof rest);
    CHECK_STATUS(KMB_OK, kmb_budget_rest(&budget, &used, &budget));
    CHECK(!memcmp(&budget, &rest, sizeof rest));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_budget_rest(NULL, &used, &rest));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_budget_rest(&budget, NULL, &rest));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_budget_rest(&budget, &used, NULL));
    used.struct_size = 9;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_budget_rest(&budget, &used, &rest));
}

static void check_hit(const kmb_ray *ray, const kmb_city_hit *hit, double height, uint32_t is_wall)
{
    CHECK(hit->struct_size == sizeof *hit && hit->node != KMB_NO_NODE && hit->is_wall == is_wall);
    CHECK(fabs(hit->height - height) < 0.6 && fabs(ray->origin[2] + hit->distance * ray->direction[2] - height) < 0.6);
    CHECK(hit->texel[0] < SIDE && hit->texel[1] < SIDE);
}

static void rays_meet_what_is_drawn(const kmb_city *city, const kmb_city_info *info)
{
    kmb_city_visit *visit = NULL;
    kmb_view view = view_of(info, 4, 0);
    kmb_ray rays[2 * BOXES + 4];
    kmb_city_hit hits[2 * BOXES + 4] = {{.struct_size = sizeof *hits}};
    size_t count = sizeof rays / sizeof *rays;
    for (int i = 0; i < (int)count; i++) {
        double x = WEST + 18 + 32 * (i % 3), y = SOUTH + 18 + 32 * (i / 3 % 3), z = roof_of(i % BOXES) - 4;
        kmb_ray down = {.struct_size = sizeof down, .origin = {x, y, 400}, .direction = {0, 0, -3}, .longest = INFINITY};
        kmb_ray along = {.struct_size = sizeof along, .origin = {x, y - 11, z}, .direction = {0, 1e-3, 0}, .longest = INFINITY};
        rays[i] = i < BOXES ? down : along;
    }
    for (int i = 2 * BOXES; i < (int)count; i++) rays[i].origin[2] = 1000;
    rays[count - 1].origin[2] = 400, rays[count - 1].direction[2] = -1, rays[count - 1].longest = 10;
    CHECK_STATUS(KMB_OK, kmb_city_visit_create(city, 0, &visit));
    CHECK_STATUS(KMB_OK, kmb_city_visit_cast(visit, count, rays, hits));
    for (size_t i = 0; i < count; i++) CHECK(hits[i].node == KMB_NO_NODE && isinf(hits[i].distance));
    CHECK_STATUS(KMB_OK, kmb_city_visit_update(visit, &view, NULL, NULL));
    CHECK_STATUS(KMB_OK, kmb_city_visit_cast(visit, count, rays, hits));
    for (int i = 0; i < BOXES; i++) check_hit(rays + i, hits + i, roof_of(i), 0);
    for (int i = 0; i < BOXES; i++) check_hit(rays + BOXES + i, hits + BOXES + i, roof_of(i) - 4, 1);
    CHECK(fabs(hits[BOXES].distance - 3000) < 1100 && hits[0].normal[2] > 0.9f && hits[BOXES].normal[1] < -0.5f);
    CHECK(hits[0].colour[0] > 150 && hits[0].colour[1] < 80 && hits[BOXES].colour[0] > hits[BOXES].colour[1] + 50);
    for (size_t i = 2 * BOXES; i < count; i++) CHECK(hits[i].node == KMB_NO_NODE && isinf(hits[i].distance));
    CHECK_STATUS(KMB_OK, kmb_city_visit_cast(visit, 0, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(NULL, count, rays, hits));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(visit, count, NULL, hits));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(visit, count, rays, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(visit, SIZE_MAX / 2, rays, hits));
    kmb_ray bad[3] = {rays[0], rays[0], rays[0]};
    bad[1].struct_size = 8;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_visit_cast(visit, 3, bad, hits));
    bad[1] = rays[0], bad[1].origin[0] = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(visit, 3, bad, hits));
    CHECK(strstr(kmb_last_error(), "ray 1"));
    bad[1] = rays[0], bad[1].longest = -1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(visit, 3, bad, hits));
    bad[1] = rays[0], bad[1].direction[2] = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_cast(visit, 3, bad, hits));
    hits[0].struct_size = 1;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_visit_cast(visit, count, rays, hits));
    hits[0].struct_size = sizeof *hits;
    for (int i = 0; i < 3; i++)
        for (int axis = 0; axis < 3; axis++) bad[i] = rays[0], bad[i].origin[axis] = 1e300, bad[i].direction[axis] = -1e-300;
    CHECK_STATUS(KMB_OK, kmb_city_visit_cast(visit, 3, bad, hits));
    kmb_city_visit_destroy(visit);
}

static void bad_visits_are_refused(const kmb_city *city, const kmb_city_info *info)
{
    kmb_city_visit *visit = NULL, *none = (kmb_city_visit *)16;
    kmb_view view = view_of(info, 4, 1), bad = view;
    kmb_budget budget = no_limits();
    kmb_city_stats stats = {.struct_size = 5};
    kmb_blockmap block = {.struct_size = sizeof block};
    const kmb_city_drawn *drawn;
    const uint32_t *nodes;
    size_t count;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_create(NULL, 0, &none));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_create(city, 0, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_create(city, 65, &none));
    CHECK(none == (kmb_city_visit *)16);
    CHECK_STATUS(KMB_OK, kmb_city_visit_create(city, 0, &visit));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_update(NULL, &view, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_update(visit, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_visit_update(visit, &view, NULL, &stats));
    budget.struct_size = 1;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_visit_update(visit, &view, &budget, NULL));
    bad.struct_size = 0;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_visit_update(visit, &bad, NULL, NULL));
    bad = view, bad.tolerance = -1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_update(visit, &bad, NULL, NULL));
    bad = view, bad.world_to_clip[3] = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_update(visit, &bad, NULL, NULL));
    bad = view, bad.viewport[0] = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_update(visit, &bad, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_drawn(NULL, &drawn, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_drawn(visit, NULL, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_drawn(visit, &drawn, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_added(NULL, &nodes, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_added(visit, NULL, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_removed(NULL, &nodes, &count));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_removed(visit, &nodes, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_block(NULL, 0, &block));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_visit_block(visit, 0, NULL));
    CHECK_STATUS(KMB_NOT_FOUND, kmb_city_visit_block(visit, 20, &block));
    CHECK_STATUS(KMB_OK, kmb_city_visit_block(visit, 0, &block));
    block.struct_size = 2;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_visit_block(visit, 0, &block));
    kmb_city_visit_destroy(visit);
    kmb_city_visit_destroy(NULL);
}

static void bad_openings_are_refused(const kmb_city *city, const char *path, const char *terrain)
{
    kmb_city *opened = NULL;
    kmb_city_info info = {.struct_size = 4};
    kmb_city_node node = {.struct_size = sizeof node};
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_open(NULL, KMB_ACCESS_MAP, &opened));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_open(path, KMB_ACCESS_MAP, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_open(path, 7, &opened));
    CHECK_STATUS(KMB_IO, kmb_city_open("/absent/city.kmb", KMB_ACCESS_MAP, &opened));
    CHECK_STATUS(KMB_INPUT, kmb_city_open(terrain, KMB_ACCESS_MAP, &opened));
    CHECK(opened == NULL);
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_describe(city, &info));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_describe(city, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_describe(NULL, &info));
    CHECK_STATUS(KMB_NOT_FOUND, kmb_city_node_at(city, KMB_NO_NODE, &node));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_node_at(city, 0, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_node_at(NULL, 0, &node));
    node.struct_size = 0;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_node_at(city, 0, &node));
    kmb_city_close(NULL);
}

static void a_city_is_opened_and_seen(const char *path, uint32_t height_bits, const char *terrain)
{
    kmb_city *city = NULL;
    kmb_city_visit *visit = NULL;
    kmb_city_info info = {.struct_size = sizeof info};
    kmb_view view;
    CHECK_STATUS(KMB_OK, kmb_city_open(path, height_bits == 8 ? KMB_ACCESS_MAP : KMB_ACCESS_POSITIONED, &city));
    CHECK_STATUS(KMB_OK, kmb_city_describe(city, &info));
    CHECK(info.side_texels == SIDE && info.nodes == 21 && info.leaves == 16 && info.levels == 3);
    CHECK(info.height_bits == height_bits && !strcmp(info.crs, "EPSG:28992"));
    CHECK(info.corner[0] < WEST + 10 && info.corner[0] + info.side > WEST + 90 && info.floor < info.heights[0]);
    CHECK(fabs(info.heights[1] - roof_of(BOXES - 1)) < 0.01);
    its_nodes_are_squares(city, &info);
    its_blocks_are_read(city, &info, height_bits);
    visits_keep_to_their_budgets(city, &info, 0);
    visits_keep_to_their_budgets(city, &info, 2);
    rays_meet_what_is_drawn(city, &info);
    bad_visits_are_refused(city, &info);
    bad_openings_are_refused(city, path, terrain);
    view = view_of(&info, 4, 0);
    CHECK_STATUS(KMB_OK, kmb_city_visit_create(city, 1, &visit));
    kmb_city_close(city);
    CHECK_STATUS(KMB_OK, kmb_city_visit_update(visit, &view, NULL, NULL));
    kmb_city_visit_destroy(visit);
}

int main(int count, char **words)
{
    CHECK(count == 2);
    char terrain[4096], path[4096];
    snprintf(terrain, sizeof terrain, "%s/under_city.kmb", words[1]);
    kmb_repository_close(rough_repository(terrain));
    for (uint32_t height_bits = 8; height_bits <= 16; height_bits += 8) {
        snprintf(path, sizeof path, "%s/city_%u.kmb", words[1], height_bits);
        remove(path);
        a_city_is_built(path, height_bits);
        a_city_is_opened_and_seen(path, height_bits, terrain);
    }
    what_a_terrain_leaves_is_told();
    return 0;
}
