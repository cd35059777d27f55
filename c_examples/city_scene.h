/* A city, and the terrain that it stands on if there is one, drawn together under one budget. */
#ifndef CITY_SCENE_H
#define CITY_SCENE_H

#include <kimberlite.h>

#include "camera.h"
#include "city_drawing.h"
#include "drawing.h"

struct scene {
    kmb_city *city;
    kmb_city_info info;
    kmb_city_visit *visit;
    struct city_drawing city_drawing;
    kmb_repository *repository; /* NULL without a terrain, as are its query and its cut */
    kmb_query *query;
    kmb_cut *cut;
    struct drawing drawing;
    struct terrain extent; /* of the city and of the terrain */
};

/* What a frame did; the terrain's is 0 without one. */
struct scene_stats {
    kmb_stats terrain;
    kmb_city_stats city;
};

/* Opens a city, and a terrain in the same reference system unless `terrain` is NULL; so many threads decode for each. Answers 0, or 1 with a
 * message on stderr. */
int scene_open(struct scene *scene, const char *city, const char *terrain, uint32_t threads);

/* Makes what OpenGL needs; the shaders of the city are in a folder. Answers as scene_open. */
int scene_prepare(struct scene *scene, const char *shaders);

/* Camera `frame` of `count` on a ring around the city that comes down over it and rises again. */
struct camera ring_camera(const struct scene *scene, int frame, int count);

/* One frame: updates the cut, gives what it leaves of the budget to the visit, and draws both. Answers as scene_open. */
int scene_draw(struct scene *scene, const kmb_view *view, const kmb_budget *budget, const int background[3],
               struct scene_stats *stats);

/* What both used of the budget, for the meter. */
kmb_stats scene_used(const struct scene_stats *stats);

void scene_close(struct scene *scene);

#endif
