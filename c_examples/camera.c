#include "camera.h"

#include <math.h>
#include <string.h>

#define FIELD_OF_VIEW 0.7853981633974483 /* radians from the bottom to the top of the picture */
#define TURN 6.283185307179586

static double least(double a, double b) { return a < b ? a : b; }
static double greatest(double a, double b) { return a > b ? a : b; }
static double mix(double a, double b, double t) { return a + (b - a) * t; }
static double smooth(double t) { return t <= 0 ? 0 : t >= 1 ? 1 : t * t * (3 - 2 * t); }

struct terrain terrain_of(const kmb_repository_info *info, kmb_query *query)
{
    struct terrain terrain;
    const double last[2] = {info->width - 1.0, info->height - 1.0};
    terrain.query = query;
    for (int axis = 0; axis < 2; axis++) {
        double first = info->world_origin[axis];
        double end = first + last[axis] * info->world_step[axis];
        terrain.low[axis] = least(first, end);
        terrain.high[axis] = greatest(first, end);
    }
    double a = info->value_scale * info->sample_min + info->value_offset;
    double b = info->value_scale * info->sample_max + info->value_offset;
    terrain.low[2] = least(a, b);
    terrain.high[2] = greatest(a, b);
    return terrain;
}

double ground(const struct terrain *terrain, double x, double y, double otherwise)
{
    kmb_height height = {.struct_size = sizeof height};
    return kmb_height_at(terrain->query, x, y, &height) == KMB_OK ? height.height : otherwise;
}

static double shorter_side(const struct terrain *terrain)
{
    return least(terrain->high[0] - terrain->low[0], terrain->high[1] - terrain->low[1]);
}

/* The low path: from the south edge to the north one in a double bend. */
static void low_path(const struct terrain *terrain, double s, double at[2])
{
    at[0] = mix(terrain->low[0], terrain->high[0], 0.5 + 0.22 * sin(TURN * s));
    at[1] = mix(terrain->low[1], terrain->high[1], 0.08 + 0.8 * s);
}

/* Highest ground near and ahead of a place of the low path, averaged along it so that the camera does not jump. */
static double clear_height(const struct terrain *terrain, double s)
{
    double sum = 0;
    for (int near = -8; near <= 8; near++) {
        double top = terrain->low[2];
        for (int ahead = -4; ahead <= 4; ahead++) {
            double at[2];
            low_path(terrain, s + 0.006 * near + 0.01 * ahead, at);
            top = greatest(top, ground(terrain, at[0], at[1], terrain->low[2]));
        }
        sum += top;
    }
    return sum / 17 + 0.02 * shorter_side(terrain);
}

struct camera flight_camera(const struct terrain *terrain, int frame, int count)
{
    const double overview = 0.3;
    double t = count > 1 ? (double)frame / (count - 1) : 0;
    double s = greatest(0, t - overview) / (1 - overview);
    double low = smooth(t / overview);
    double here[2], ahead[2];
    low_path(terrain, s, here);
    low_path(terrain, s + 0.12, ahead);

    double side = shorter_side(terrain);
    double far_eye[3] = {mix(terrain->low[0], terrain->high[0], 0.5), terrain->low[1] - 0.35 * side,
                         terrain->high[2] + 0.75 * side};
    double low_eye[3] = {here[0], here[1], clear_height(terrain, s)};
    double centre[3] = {far_eye[0], mix(terrain->low[1], terrain->high[1], 0.42), terrain->low[2]};
    double forward[3] = {ahead[0], ahead[1], clear_height(terrain, s + 0.12) - 0.025 * side};

    struct camera camera;
    for (int axis = 0; axis < 3; axis++) {
        camera.eye[axis] = mix(far_eye[axis], low_eye[axis], low);
        camera.target[axis] = mix(centre[axis], forward[axis], low);
    }
    return camera;
}

static void subtract(const double a[3], const double b[3], double out[3])
{
    for (int axis = 0; axis < 3; axis++) out[axis] = a[axis] - b[axis];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        out[axis] = a[next] * b[last] - a[last] * b[next];
    }
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void normalize(double v[3])
{
    double length = sqrt(dot(v, v));
    for (int axis = 0; axis < 3; axis++) v[axis] /= length;
}

/* The camera's axes: to the right, up and forward, as unit vectors. */
static void axes(const struct camera *camera, double right[3], double up[3], double forward[3])
{
    const double zenith[3] = {0, 0, 1}, north[3] = {0, 1, 0};
    subtract(camera->target, camera->eye, forward);
    normalize(forward);
    cross(forward, fabs(forward[2]) > 0.9999 ? north : zenith, right);
    normalize(right);
    cross(right, forward, up);
}

/* Whether all that the picture shows at and above the lowest ground lies well inside the terrain. */
static int sees_only_terrain(const struct terrain *terrain, const struct camera *camera, double aspect)
{
    double right[3], up[3], forward[3], half = tan(FIELD_OF_VIEW / 2);
    axes(camera, right, up, forward);
    for (int corner = 0; corner < 4; corner++) {
        double a = (corner & 1 ? 1 : -1) * half * aspect, b = (corner & 2 ? 1 : -1) * half;
        double ray[3];
        for (int axis = 0; axis < 3; axis++) ray[axis] = forward[axis] + a * right[axis] + b * up[axis];
        if (ray[2] >= 0) return 0;
        double distance = (terrain->low[2] - camera->eye[2]) / ray[2];
        for (int axis = 0; axis < 2; axis++) {
            double at = camera->eye[axis] + distance * ray[axis];
            double margin = 0.01 * (terrain->high[axis] - terrain->low[axis]);
            if (at < terrain->low[axis] + margin || at > terrain->high[axis] - margin) return 0;
        }
    }
    return 1;
}

/* The digits of n in a base, mirrored at the point: spread evenly over 0 .. 1. */
static double spread(int n, int base)
{
    double value = 0, digit = 1;
    for (; n > 0; n /= base) {
        digit /= base;
        value += digit * (n % base);
    }
    return value;
}

struct camera steep_camera(const struct terrain *terrain, int index, double aspect)
{
    int n = index + 1;
    double x = mix(terrain->low[0], terrain->high[0], 0.1 + 0.8 * spread(n, 2));
    double y = mix(terrain->low[1], terrain->high[1], 0.1 + 0.8 * spread(n, 3));
    double above = shorter_side(terrain) * exp(mix(log(0.01), log(0.6), spread(n, 5)));
    double heading = TURN * spread(n, 7), tilt = 0.5 * spread(n, 11);
    double base = ground(terrain, x, y, terrain->high[2]);
    struct camera camera;
    /* Lower and steeper until nothing but terrain is seen; right above the ground that always ends. */
    do {
        double eye[3] = {x, y, base + above};
        double target[3] = {x + sin(tilt) * cos(heading) * above, y + sin(tilt) * sin(heading) * above,
                            base + above - cos(tilt) * above};
        memcpy(camera.eye, eye, sizeof eye);
        memcpy(camera.target, target, sizeof target);
        above *= 0.8;
        tilt *= 0.8;
    } while (!sees_only_terrain(terrain, &camera, aspect) && above > 1e-6 * shorter_side(terrain));
    return camera;
}

static void multiply(const double a[16], const double b[16], double out[16])
{
    for (int column = 0; column < 4; column++) {
        for (int row = 0; row < 4; row++) {
            double sum = 0;
            for (int k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
            out[4 * column + row] = sum;
        }
    }
}

kmb_view view_of(const struct camera *camera, const struct terrain *terrain, int width, int height, double tolerance)
{
    double right[3], up[3], forward[3], diagonal[3], to_target[3];
    axes(camera, right, up, forward);
    subtract(terrain->high, terrain->low, diagonal);
    subtract(camera->target, camera->eye, to_target);
    const double *e = camera->eye;
    double reach = 3 * sqrt(dot(diagonal, diagonal)) + sqrt(dot(to_target, to_target));
    double near = least(1e-4 * reach, 0.05 * sqrt(dot(to_target, to_target)));
    double focus = 1 / tan(FIELD_OF_VIEW / 2);
    const double world_to_eye[16] = {
        right[0], up[0], -forward[0], 0, right[1], up[1], -forward[1], 0,
        right[2], up[2], -forward[2], 0, -dot(right, e), -dot(up, e), dot(forward, e), 1,
    };
    const double eye_to_clip[16] = {
        focus * height / width, 0, 0, 0, 0, focus, 0, 0,
        0, 0, -(reach + near) / (reach - near), -1, 0, 0, -2 * reach * near / (reach - near), 0,
    };
    kmb_view view = {.struct_size = sizeof view, .viewport = {width, height}, .tolerance = tolerance};
    memcpy(view.eye, camera->eye, sizeof view.eye);
    multiply(eye_to_clip, world_to_eye, view.world_to_clip);
    return view;
}

void clip_from_grid(const double world_to_clip[16], const kmb_grid_to_world *map, const double anchor[3], float out[16])
{
    double grid_to_world[16] = {0}, product[16];
    for (int axis = 0; axis < 3; axis++) {
        grid_to_world[5 * axis] = map->step[axis];
        grid_to_world[12 + axis] = map->origin[axis] + map->step[axis] * anchor[axis];
    }
    grid_to_world[15] = 1;
    multiply(world_to_clip, grid_to_world, product);
    for (int i = 0; i < 16; i++) out[i] = (float)product[i];
}
