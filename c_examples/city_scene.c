#include "city_scene.h"

#include <math.h>
#include <stdio.h>

#define GL_GLEXT_PROTOTYPES
#include <GL/gl.h>
#include <GL/glext.h>

#define TURN 6.283185307179586

static int library_error(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, kmb_last_error());
    return 1;
}

static int open_terrain(struct scene *scene, const char *path, uint32_t threads)
{
    kmb_repository_info info = {.struct_size = sizeof info};
    kmb_cut_options options = {.struct_size = sizeof options, .vertex_form = KMB_VERTEX_EXPANDED,
                               .metric = KMB_METRIC_GEOMETRIC, .threads = threads};
    if (kmb_repository_open(path, NULL, &scene->repository) != KMB_OK
        || kmb_repository_describe(scene->repository, &info) != KMB_OK
        || kmb_query_create(scene->repository, 64 << 20, &scene->query) != KMB_OK
        || kmb_cut_create(scene->repository, &options, &scene->cut) != KMB_OK) {
        return library_error("cannot open the terrain");
    }
    struct terrain terrain = terrain_of(&info, scene->query);
    for (int axis = 0; axis < 3; axis++) {
        scene->extent.low[axis] = fmin(scene->extent.low[axis], terrain.low[axis]);
        scene->extent.high[axis] = fmax(scene->extent.high[axis], terrain.high[axis]);
    }
    scene->extent.query = scene->query;
    return 0;
}

int scene_open(struct scene *scene, const char *city, const char *terrain, uint32_t threads)
{
    *scene = (struct scene){.info = {.struct_size = sizeof scene->info}};
    if (kmb_city_open(city, KMB_ACCESS_MAP, &scene->city) != KMB_OK
        || kmb_city_describe(scene->city, &scene->info) != KMB_OK
        || kmb_city_visit_create(scene->city, threads, &scene->visit) != KMB_OK) {
        return library_error("cannot open the city");
    }
    for (int axis = 0; axis < 3; axis++) {
        scene->extent.low[axis] = axis < 2 ? scene->info.corner[axis] : scene->info.floor;
        scene->extent.high[axis] = axis < 2 ? scene->info.corner[axis] + scene->info.side : scene->info.heights[1];
    }
    return terrain ? open_terrain(scene, terrain, threads) : 0;
}

int scene_prepare(struct scene *scene, const char *shaders)
{
    if (scene->cut && drawing_create(&scene->drawing, scene->cut, scene->extent.low[2], scene->extent.high[2])) return 1;
    return city_drawing_create(&scene->city_drawing, scene->city, shaders);
}

struct camera ring_camera(const struct scene *scene, int frame, int count)
{
    const kmb_city_info *info = &scene->info;
    double turn = TURN * frame / count, down = 0.5 - 0.5 * cos(turn);
    double radius = info->side * (0.9 - 0.6 * down), rise = info->side * (0.55 - 0.49 * down);
    const double around[2] = {cos(turn - TURN / 4), sin(turn - TURN / 4)};
    struct camera camera;
    for (int axis = 0; axis < 2; axis++) {
        double middle = info->corner[axis] + 0.5 * info->side;
        camera.eye[axis] = middle + radius * around[axis];
        camera.target[axis] = middle - 0.1 * info->side * down * around[axis];
    }
    camera.eye[2] = info->heights[1] + rise;
    camera.target[2] = info->heights[0];
    return camera;
}

/* Where both have the ground, the city's is to be seen. */
static kmb_status draw_terrain(struct scene *scene, const kmb_view *view, const kmb_budget *budget, const int background[3],
                               kmb_stats *stats)
{
    kmb_status status = kmb_cut_update(scene->cut, view, budget, stats);
    if (status != KMB_OK && status != KMB_BUDGET_TOO_SMALL) return status;
    status = drawing_update(&scene->drawing, scene->cut);
    glEnable(GL_POLYGON_OFFSET_FILL);
    glPolygonOffset(4, 64);
    if (status == KMB_OK) status = drawing_draw(&scene->drawing, scene->cut, view, background);
    glDisable(GL_POLYGON_OFFSET_FILL);
    return status;
}

static void clear(const kmb_view *view, const int background[3])
{
    glViewport(0, 0, (GLsizei)view->viewport[0], (GLsizei)view->viewport[1]);
    glClearColor((GLfloat)background[0] / 255, (GLfloat)background[1] / 255, (GLfloat)background[2] / 255, 1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

int scene_draw(struct scene *scene, const kmb_view *view, const kmb_budget *budget, const int background[3],
               struct scene_stats *stats)
{
    *stats = (struct scene_stats){{.struct_size = sizeof stats->terrain}, {.struct_size = sizeof stats->city}};
    kmb_budget rest = *budget, first = *budget;
    /* At most half of the bytes, so that what the terrain needs from frame to frame does not drive out the city. */
    if (first.bytes != KMB_UNLIMITED) first.bytes /= 2;
    if (!scene->cut) clear(view, background);
    else if (draw_terrain(scene, view, &first, background, &stats->terrain) != KMB_OK
             || kmb_budget_rest(budget, &stats->terrain, &rest) != KMB_OK) {
        return library_error("cannot draw the terrain");
    }
    kmb_status status = kmb_city_visit_update(scene->visit, view, &rest, &stats->city);
    if ((status != KMB_OK && status != KMB_BUDGET_TOO_SMALL)
        || city_drawing_update(&scene->city_drawing, scene->visit) != KMB_OK
        || city_drawing_draw(&scene->city_drawing, scene->visit, view) != KMB_OK) {
        return library_error("cannot draw the city");
    }
    return 0;
}

kmb_stats scene_used(const struct scene_stats *stats)
{
    kmb_stats used = stats->terrain;
    used.bytes += stats->city.bytes;
    used.microseconds += stats->city.microseconds;
    used.awaited += stats->city.awaited;
    return used;
}

void scene_close(struct scene *scene)
{
    if (scene->drawing.program) drawing_destroy(&scene->drawing);
    if (scene->city_drawing.program) city_drawing_destroy(&scene->city_drawing);
    kmb_cut_destroy(scene->cut);
    kmb_query_destroy(scene->query);
    kmb_repository_close(scene->repository);
    kmb_city_visit_destroy(scene->visit);
    kmb_city_close(scene->city);
}
