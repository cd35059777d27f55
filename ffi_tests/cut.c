/* A cut: the changes describe its patches, patches are whole and outlive it when retained, budgets and bad views are honoured, and
 * a still view settles, also where threads decode. */
#define _POSIX_C_SOURCE 200809L /* nanosleep */
#include <math.h>
#include <pthread.h>
#include <stddef.h>
#include <string.h>
#include <time.h>

#include "check.h"

enum { MOST = 20000, THREADS = 4 };

static kmb_cut *new_cut(const kmb_repository *repository, uint32_t form)
{
    kmb_cut_options options = {.struct_size = sizeof options, .vertex_form = form};
    kmb_cut *cut = NULL;
    CHECK_STATUS(KMB_OK, kmb_cut_create(repository, &options, &cut));
    return cut;
}

static kmb_stats update(kmb_cut *cut, const kmb_view *view, const kmb_budget *budget)
{
    kmb_stats stats = {.struct_size = sizeof stats};
    CHECK_STATUS(KMB_OK, kmb_cut_update(cut, view, budget, &stats));
    CHECK(stats.struct_size == sizeof stats && stats.late_refinements == 0);
    CHECK(stats.microseconds >= stats.fixed_microseconds);
    return stats;
}

static void settle(kmb_cut *cut, const kmb_view *view, const kmb_budget *budget)
{
    for (int i = 0; i < 200; i++) {
        kmb_stats stats = update(cut, view, budget);
        if (stats.added + stats.removed == 0 && stats.refined + stats.coarsened == 0) return;
    }
    CHECK(!"the cut settles");
}

static uint64_t handle_of(const kmb_patch *patch)
{
    kmb_patch_info info = {.struct_size = sizeof info};
    CHECK_STATUS(KMB_OK, kmb_patch_describe(patch, &info));
    return info.handle;
}

/* What a GPU cache would hold. */
static struct { uint64_t handles[MOST]; size_t count; } cache;

static int cached(uint64_t handle)
{
    for (size_t i = 0; i < cache.count; i++)
        if (cache.handles[i] == handle) return 1;
    return 0;
}

static void apply_changes(kmb_cut *cut)
{
    const kmb_patch *const *added;
    const uint64_t *removed;
    size_t added_count, removed_count;
    CHECK_STATUS(KMB_OK, kmb_cut_changes(cut, &added, &added_count, &removed, &removed_count));
    for (size_t i = 0; i < removed_count; i++) {
        CHECK(cached(removed[i]));
        for (size_t j = 0; j < cache.count; j++)
            if (cache.handles[j] == removed[i]) cache.handles[j--] = cache.handles[--cache.count];
    }
    for (size_t i = 0; i < added_count; i++) {
        uint64_t handle = handle_of(added[i]);
        CHECK(!cached(handle) && cache.count < MOST);
        cache.handles[cache.count++] = handle;
    }
}

static void changes_describe_the_patches(const kmb_repository *repository)
{
    kmb_cut *cut = new_cut(repository, KMB_VERTEX_EXPANDED);
    cache.count = 0;
    for (int frame = 0; frame < 40; frame++) {
        kmb_view view = view_from_above(1 + (frame < 20 ? frame : 40 - frame));
        kmb_budget budget = no_limits();
        budget.refinements = 5;
        kmb_stats stats = update(cut, &view, &budget);
        CHECK(stats.refined <= 5);
        if (frame % 3 == 0) continue; /* changes of several updates join */
        apply_changes(cut);
        const kmb_patch *const *patches;
        size_t count;
        CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
        CHECK(count == stats.patches && count > 0);
        for (size_t i = 0; i < count; i++) CHECK(cached(handle_of(patches[i])));
    }
    kmb_cut_destroy(cut);
}

static int close_to(double a, double b) { return fabs(a - b) <= 1e-6 * (1 + fabs(a)); }

/* Every vertex lies on the raster, and its world position within the patch's bounds. */
static void check_expanded(const kmb_patch_info *info, const kmb_grid_to_world *map, size_t vertex_count)
{
    CHECK(info->vertex_floats == 6 * vertex_count);
    for (size_t v = 0; v < vertex_count; v++) {
        const float *vertex = info->vertices + 6 * v;
        double grid[3];
        for (int axis = 0; axis < 3; axis++) {
            grid[axis] = info->origin[axis] + (double)vertex[axis];
            CHECK(grid[axis] == rint(grid[axis]));
            double world = map->origin[axis] + map->step[axis] * grid[axis];
            CHECK(world >= info->bounds[0][axis] - 1e-6 && world <= info->bounds[1][axis] + 1e-6);
        }
        if (grid[0] >= 0 && grid[0] < WIDTH && grid[1] >= 0 && grid[1] < HEIGHT)
            CHECK(close_to(map->origin[2] + map->step[2] * grid[2], rough_ground((uint32_t)grid[0], (uint32_t)grid[1])));
        double x = (double)vertex[3], y = (double)vertex[4], z = (double)vertex[5];
        CHECK(fabs(x * x + y * y + z * z - 1) < 1e-4 && z > 0);
    }
}

static void check_compact(const kmb_patch_info *info, const kmb_grid_to_world *map, const float *grid, size_t vertex_count)
{
    CHECK(info->vertex_floats == 3 * vertex_count);
    for (size_t v = 0; v < vertex_count; v++) {
        double at[2];
        for (int axis = 0; axis < 2; axis++)
            at[axis] = info->origin[axis] + (double)(grid[2 * v] * info->legs[0][axis] + grid[2 * v + 1] * info->legs[1][axis]);
        if (at[0] >= 0 && at[0] < WIDTH && at[1] >= 0 && at[1] < HEIGHT)
            CHECK(close_to(map->origin[2] + map->step[2] * (info->origin[2] + (double)info->vertices[3 * v]),
                           rough_ground((uint32_t)at[0], (uint32_t)at[1])));
    }
}

static void check_indices(const uint16_t *indices, size_t count, size_t vertex_count)
{
    for (size_t i = 0; i < count; i++) CHECK(indices[i] < vertex_count);
}

static void patches_are_whole(const kmb_repository *repository, uint32_t form)
{
    kmb_cut *cut = new_cut(repository, form);
    kmb_view view = view_from_above(2);
    kmb_grid_to_world map = {.struct_size = sizeof map};
    const kmb_patch *const *patches;
    const uint16_t *list, *strip;
    const float *grid;
    size_t count, list_count, strip_count, vertex_count;
    CHECK_STATUS(KMB_OK, kmb_cut_triangle_list(cut, &list, &list_count));
    CHECK_STATUS(KMB_OK, kmb_cut_triangle_strip(cut, &strip, &strip_count));
    CHECK_STATUS(KMB_OK, kmb_cut_grid(cut, &grid, &vertex_count));
    CHECK_STATUS(KMB_OK, kmb_cut_grid_to_world(cut, &map));
    CHECK(list_count == 3 * 16 * 16 && strip_count >= 16 * 16 + 2 && vertex_count == 17 * 18 / 2);
    check_indices(list, list_count, vertex_count);
    check_indices(strip, strip_count, vertex_count);
    update(cut, &view, NULL);
    CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
    size_t incomplete = 0;
    for (size_t i = 0; i < count; i++) {
        kmb_patch_info info = {.struct_size = sizeof info};
        CHECK_STATUS(KMB_OK, kmb_patch_describe(patches[i], &info));
        CHECK(info.half < 2 && info.complete < 2 && (info.indices == NULL || !info.complete));
        check_indices(info.indices, info.index_count, vertex_count);
        incomplete += !info.complete;
        if (form == KMB_VERTEX_EXPANDED) check_expanded(&info, &map, vertex_count);
        else check_compact(&info, &map, grid, vertex_count);
    }
    CHECK(count > 10 && incomplete < count);
    kmb_cut_destroy(cut);
}

/* An upload thread: reads patches that are retained for it while the cut goes on, and releases them. */
static void *read_patches(void *list)
{
    const kmb_patch **patches = list;
    double *sum = malloc(sizeof *sum);
    CHECK(sum);
    *sum = 0;
    for (; *patches; patches++) {
        kmb_patch_info info = {.struct_size = sizeof info};
        CHECK_STATUS(KMB_OK, kmb_patch_describe(*patches, &info));
        CHECK_STATUS(KMB_OK, kmb_patch_retain(*patches));
        for (size_t i = 0; i < info.vertex_floats; i++) *sum += (double)info.vertices[i];
        kmb_patch_release(*patches);
        kmb_patch_release(*patches);
    }
    return sum;
}

static void retained_patches_outlive_their_cut(const char *path)
{
    static const kmb_patch *kept[THREADS][MOST];
    pthread_t threads[THREADS];
    kmb_repository *repository = rough_repository(path);
    kmb_cut *cut = new_cut(repository, KMB_VERTEX_EXPANDED);
    kmb_repository_close(repository);
    kmb_view view = view_from_above(2);
    const kmb_patch *const *patches;
    size_t count;
    update(cut, &view, NULL);
    CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
    CHECK(count > 0 && count < MOST);
    for (int thread = 0; thread < THREADS; thread++) {
        for (size_t i = 0; i < count; i++) {
            CHECK_STATUS(KMB_OK, kmb_patch_retain(patches[i]));
            kept[thread][i] = patches[i];
        }
    }
    for (int thread = 0; thread < THREADS; thread++)
        CHECK(pthread_create(&threads[thread], NULL, read_patches, kept[thread]) == 0);
    for (int zoom = 1; zoom < 8; zoom++) {
        view = view_from_above(zoom);
        update(cut, &view, NULL);
    }
    kmb_cut_destroy(cut);
    double first = 0;
    for (int thread = 0; thread < THREADS; thread++) {
        void *sum;
        CHECK(pthread_join(threads[thread], &sum) == 0);
        if (thread == 0) first = *(double *)sum;
        CHECK(*(double *)sum == first);
        free(sum);
    }
}

static void budgets_are_kept(const kmb_repository *repository)
{
    kmb_cut *cut = new_cut(repository, KMB_VERTEX_EXPANDED);
    kmb_view view = view_from_above(1);
    kmb_budget budget = no_limits();
    kmb_stats stats = {.struct_size = sizeof stats};
    const kmb_patch *const *patches;
    size_t count;
    budget.patches = 1;
    CHECK_STATUS(KMB_BUDGET_TOO_SMALL, kmb_cut_update(cut, &view, &budget, &stats));
    CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
    CHECK(count == 2 && stats.patches == 2);
    budget.patches = 40;
    settle(cut, &view, &budget);
    stats = update(cut, &view, &budget);
    CHECK(stats.patches <= 40 && stats.cut_short == 1 && stats.largest_error > view.tolerance);
    budget = no_limits();
    budget.refinements = 0;
    kmb_stats frozen = update(cut, &view, &budget);
    CHECK(frozen.refined == 0 && frozen.patches == stats.patches);
    budget.refinements = 1;
    CHECK(update(cut, &view, &budget).refined == 1);
    budget = no_limits();
    budget.microseconds = 0;
    CHECK(update(cut, &view, &budget).refined == 0);
    settle(cut, &view, NULL);
    stats = update(cut, &view, NULL);
    CHECK(stats.cut_short == 0 && stats.largest_error <= view.tolerance && stats.patches > 40);
    kmb_cut_destroy(cut);
}

/* Frames go on while threads decode, and in the end show what a cut without threads shows. */
static void threads_decode_between_frames(const kmb_repository *repository)
{
    kmb_cut_options options = {.struct_size = sizeof options, .vertex_form = KMB_VERTEX_COMPACT, .threads = 2};
    kmb_cut *cut = NULL, *alone = new_cut(repository, KMB_VERTEX_COMPACT);
    kmb_view view = view_from_above(1);
    CHECK_STATUS(KMB_OK, kmb_cut_create(repository, &options, &cut));
    settle(alone, &view, NULL);
    uint64_t patches = update(alone, &view, NULL).patches;
    kmb_stats stats = update(cut, &view, NULL);
    CHECK(stats.refined == 0 && stats.awaited > 0 && stats.cut_short == 1 && stats.patches == 2);
    for (int i = 0; i < 100000 && stats.awaited + stats.refined + stats.coarsened > 0; i++) {
        struct timespec pause = {.tv_nsec = 200000};
        nanosleep(&pause, NULL);
        stats = update(cut, &view, NULL);
    }
    CHECK(stats.awaited == 0 && stats.cut_short == 0 && stats.patches == patches);
    kmb_cut_destroy(cut);
    kmb_cut_destroy(alone);
    options.threads = 65;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(repository, &options, &cut));
}

static void bad_views_change_nothing(const kmb_repository *repository)
{
    kmb_cut *cut = new_cut(repository, KMB_VERTEX_EXPANDED);
    kmb_view good = view_from_above(1);
    kmb_stats before = update(cut, &good, NULL), stats = {.struct_size = sizeof stats};
    const double bad[] = {NAN, INFINITY, -INFINITY};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        for (int at = 0; at < 22; at++) {
            kmb_view view = good;
            /* Eye, matrix, viewport and tolerance lie one after the other. */
            memcpy((char *)&view + offsetof(kmb_view, eye) + (size_t)at * sizeof(double), &bad[i], sizeof(double));
            CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_update(cut, &view, NULL, &stats));
        }
    }
    kmb_view view = good;
    view.tolerance = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_update(cut, &view, NULL, &stats));
    view = good;
    view.viewport[1] = 0;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_update(cut, &view, NULL, &stats));
    CHECK(stats.patches == 0 && stats.microseconds == 0);
    stats = update(cut, &good, NULL);
    CHECK(stats.patches == before.patches && stats.added == 0 && stats.removed == 0);
    kmb_cut_destroy(cut);
}

int main(int count, char **words)
{
    CHECK(count == 2);
    const char *path = path_in(words, "cut.kmb");
    kmb_repository *repository = rough_repository(path);
    changes_describe_the_patches(repository);
    patches_are_whole(repository, KMB_VERTEX_EXPANDED);
    patches_are_whole(repository, KMB_VERTEX_COMPACT);
    budgets_are_kept(repository);
    bad_views_change_nothing(repository);
    threads_decode_between_frames(repository);
    kmb_repository_close(repository);
    retained_patches_outlive_their_cut(path);
    return 0;
}
