/* A camera: matrices, and paths over a terrain. Matrices are 16 doubles, column by column, as OpenGL has them. */
#ifndef CAMERA_H
#define CAMERA_H

#include <kimberlite.h>

/* What a path needs to know of a terrain, in world coordinates. */
struct terrain {
    double low[3], high[3]; /* least and greatest x, y, z */
    kmb_query *query;       /* heights of the ground */
};

struct camera {
    double eye[3];
    double target[3];
};

/* The extent of a repository's terrain. */
struct terrain terrain_of(const kmb_repository_info *info, kmb_query *query);

/* Height of the ground, or `otherwise` where there is none. */
double ground(const struct terrain *terrain, double x, double y, double otherwise);

/* Camera `frame` of `count`: down from an overview in the south, then low over the terrain to the north. */
struct camera flight_camera(const struct terrain *terrain, int frame, int count);

/* Camera `index` of `count` that look steeply down and see nothing but the terrain's inside. */
struct camera steep_camera(const struct terrain *terrain, int index, double aspect);

/* The view of a camera whose picture is width x height pixels, 45 degrees high. */
kmb_view view_of(const struct camera *camera, const struct terrain *terrain, int width, int height, double tolerance);

/* world_to_clip * grid_to_world, with grid coordinates taken relative to `anchor`: computed in doubles, for floats. */
void clip_from_grid(const double world_to_clip[16], const kmb_grid_to_world *map, const double anchor[3], float out[16]);

#endif
