/* What the C tests share: a check that ends the program, and a terrain to test with. */
#ifndef CHECK_H
#define CHECK_H

#include <kimberlite.h>
#include <stdio.h>
#include <stdlib.h>

#define CHECK(condition)                                                                              \
    do {                                                                                              \
        if (!(condition)) {                                                                           \
            fprintf(stderr, "%s:%d: %s does not hold (last error: %s)\n", __FILE__, __LINE__, #condition, \
                    kmb_last_error());                                                                \
            exit(1);                                                                                  \
        }                                                                                             \
    } while (0)

#define CHECK_STATUS(expected, call)                                                                     \
    do {                                                                                                 \
        kmb_status status_ = (call);                                                                     \
        if (status_ != (expected)) {                                                                     \
            fprintf(stderr, "%s:%d: %s gave %s: %s\n", __FILE__, __LINE__, #call, kmb_status_name(status_), \
                    kmb_last_error());                                                                   \
            exit(1);                                                                                     \
        }                                                                                                \
    } while (0)

enum { WIDTH = 300, HEIGHT = 200 };

/* Rough ground, the same everywhere: a whole number from 0 to 4000. */
static inline double rough_ground(uint32_t column, uint32_t row)
{
    double height = 0;
    for (uint32_t size = 64, amplitude = 1000; size >= 1; size /= 2, amplitude /= 2) {
        uint32_t hash = (column / size) * 2654435761u ^ (row / size) * 2246822519u ^ size;
        hash ^= hash >> 15;
        hash *= 2246822519u;
        hash ^= hash >> 13;
        height += (double)(hash % (2 * amplitude + 1));
    }
    return height > 4000 ? 4000 : height;
}

/* A kmb_rows_callback of rough ground, WIDTH samples a row. */
static inline int32_t rough_rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    (void)user;
    for (uint32_t row = 0; row < row_count; row++)
        for (uint32_t column = 0; column < WIDTH; column++) *samples++ = rough_ground(column, first_row + row);
    return 0;
}

static inline kmb_builder_options rough_options(double max_error)
{
    kmb_builder_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_U16, .width = WIDTH,
                                   .height = HEIGHT, .max_error = max_error, .cells = 16, .threads = 1};
    return options;
}

/* Builds a raster at `path` and opens it. */
static inline kmb_repository *built(const kmb_builder_options *options, const double geotransform[6],
                                    kmb_rows_callback rows, const char *path)
{
    kmb_builder *builder = NULL;
    kmb_repository *repository = NULL;
    CHECK_STATUS(KMB_OK, kmb_builder_create(options, &builder));
    CHECK_STATUS(KMB_OK, kmb_builder_set_geotransform(builder, geotransform, KMB_REGISTRATION_POINT, 0));
    CHECK_STATUS(KMB_OK, kmb_builder_write(builder, rows, NULL, NULL, NULL, path, NULL));
    kmb_builder_destroy(builder);
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &repository));
    return repository;
}

/* Builds rough ground at `path` and opens it; its samples are 10 world units apart. */
static inline kmb_repository *rough_repository(const char *path)
{
    const double geotransform[6] = {1000, 10, 0, 5000, 0, -10};
    kmb_builder_options options = rough_options(0);
    return built(&options, geotransform, rough_rows, path);
}

/* Down on the whole of rough ground, or on a part of it for a larger `zoom`; x and y are that of its middle. */
static inline kmb_view view_from_above(double zoom)
{
    kmb_view view = {.struct_size = sizeof view, .viewport = {800, 600}, .tolerance = 1};
    double x = 1000 + 10 * (WIDTH - 1) / 2.0, y = 5000 - 10 * (HEIGHT - 1) / 2.0, side = 3000 / zoom;
    view.eye[0] = x;
    view.eye[1] = y;
    view.eye[2] = 4000 + side;
    /* A parallel projection: clip x = 2 (X - x) / side, and depth along -z; heights lean northwards, or their errors would not
     * be seen. */
    view.world_to_clip[0] = 2 / side;
    view.world_to_clip[5] = 2 / side;
    view.world_to_clip[9] = 1 / side;
    view.world_to_clip[10] = -1e-4;
    view.world_to_clip[12] = -2 * x / side;
    view.world_to_clip[13] = -(2 * y + 2000) / side;
    view.world_to_clip[15] = 1;
    return view;
}

static inline kmb_budget no_limits(void)
{
    kmb_budget budget = {.struct_size = sizeof budget, .microseconds = KMB_UNLIMITED, .refinements = KMB_UNLIMITED,
                         .bytes = KMB_UNLIMITED, .upload_bytes = KMB_UNLIMITED, .patches = KMB_UNLIMITED};
    return budget;
}

/* A path in the folder that is the program's first argument. */
static inline const char *path_in(char **words, const char *name)
{
    static char path[4096];
    snprintf(path, sizeof path, "%s/%s", words[1], name);
    return path;
}

static inline int exists(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (file) fclose(file);
    return file != NULL;
}

#endif
