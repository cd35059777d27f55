/* Patches have the colours of the image at their vertices, as textures and as vertices' own; detail and births are told; options
 * that cannot be are refused. */
#include <math.h>
#include <string.h>

#include "check.h"

enum { FINER = 2, TEXELS = (WIDTH - 1) * FINER + 1, ROWS = (HEIGHT - 1) * FINER + 1 };

static void pixel(uint32_t column, uint32_t row, uint8_t colour[3])
{
    colour[0] = (uint8_t)(column * 5 + row);
    colour[1] = (uint8_t)(row * 3);
    colour[2] = (uint8_t)(column ^ row);
}

static int32_t pixels(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    (void)user;
    for (uint32_t row = first_row; row < first_row + row_count; row++)
        for (uint32_t column = 0; column < TEXELS; column++) {
            uint8_t colour[3];
            pixel(column, row, colour);
            for (int band = 0; band < 3; band++) *samples++ = colour[band];
        }
    return 0;
}

/* An image over rough ground, FINER texels from one of its samples to the next. */
static kmb_repository *image(const char *path, double west)
{
    const double geotransform[6] = {west, 10.0 / FINER, 0, 5000, 0, -10.0 / FINER};
    kmb_builder_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_U8, .width = TEXELS,
                                   .height = ROWS, .bands = 3, .transform = KMB_TRANSFORM_INTERPOLATING,
                                   .cells = 16, .threads = 1};
    return built(&options, geotransform, pixels, path);
}

/* Whether a place in the world has this colour; those outside have any. */
static void check_pixel(const double place[2], const uint8_t *found)
{
    uint8_t colour[3];
    double column = (place[0] - 1000) / 10 * FINER, row = (5000 - place[1]) / 10 * FINER;
    if (column > TEXELS - 1 || row > ROWS - 1) return;
    pixel((uint32_t)rint(column), (uint32_t)rint(row), colour);
    CHECK(!memcmp(colour, found, 3));
}

/* The texel of a vertex, which is in its middle. */
static const uint8_t *texel_of(const kmb_patch_info *info, const float *vertex)
{
    const float (*legs)[2] = info->legs, (*corners)[2] = info->texture_corners;
    double cells = (sqrt(8.0 * (double)info->vertex_floats / 6 + 1) - 3) / 2, texel[2];
    double area = cells * (legs[0][0] * legs[1][1] - legs[0][1] * legs[1][0]);
    double p = (vertex[0] * legs[1][1] - vertex[1] * legs[1][0]) / area;
    double q = (legs[0][0] * vertex[1] - legs[0][1] * vertex[0]) / area;
    for (int axis = 0; axis < 2; axis++) {
        double along = p * (corners[1][axis] - corners[0][axis]) + q * (corners[2][axis] - corners[0][axis]);
        texel[axis] = (corners[0][axis] + along) * info->texture_side - 0.5;
        CHECK(fabs(texel[axis] - rint(texel[axis])) < 1e-3);
    }
    return info->colours + 3 * ((size_t)rint(texel[1]) * info->texture_side + (size_t)rint(texel[0]));
}

/* Checks the colours of all vertices; gives the finest level. */
static uint32_t check_colours(const kmb_cut *cut, uint32_t form)
{
    const kmb_patch *const *patches;
    size_t count;
    uint32_t finest = 0;
    kmb_grid_to_world map = {.struct_size = sizeof map};
    CHECK_STATUS(KMB_OK, kmb_cut_grid_to_world(cut, &map));
    CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
    for (size_t i = 0; i < count; i++) {
        kmb_patch_info info = {.struct_size = sizeof info};
        CHECK_STATUS(KMB_OK, kmb_patch_describe(patches[i], &info));
        size_t vertices = info.vertex_floats / 6, texels = (size_t)info.texture_side * info.texture_side;
        CHECK(info.colour_bytes == (form == KMB_COLOUR_VERTICES ? 4 * vertices : 3 * texels) && info.colour_bytes > 0);
        if (info.level > finest) finest = info.level;
        for (size_t v = 0; v < vertices; v++) {
            const float *vertex = info.vertices + 6 * v;
            double place[2];
            for (int axis = 0; axis < 2; axis++)
                place[axis] = map.origin[axis] + map.step[axis] * (info.origin[axis] + vertex[axis]);
            check_pixel(place, form == KMB_COLOUR_VERTICES ? info.colours + 4 * v : texel_of(&info, vertex));
        }
    }
    return finest;
}

static void vertices_have_the_colours_of_the_image(const kmb_repository *heights, const kmb_repository *colours,
                                                   uint32_t form)
{
    kmb_cut_options options = {.struct_size = sizeof options, .vertex_form = KMB_VERTEX_EXPANDED, .colours = colours,
                               .colour_form = form};
    kmb_view view = view_from_above(1), near = view_from_above(8);
    kmb_budget budget = no_limits();
    kmb_cut *cut = NULL;
    kmb_repository_info told = {.struct_size = sizeof told};
    CHECK_STATUS(KMB_OK, kmb_repository_describe(colours, &told));
    CHECK_STATUS(KMB_OK, kmb_cut_create(heights, &options, &cut));
    CHECK_STATUS(KMB_OK, kmb_cut_update(cut, &view, &budget, NULL));
    check_colours(cut, form);
    CHECK_STATUS(KMB_OK, kmb_cut_update(cut, &near, &budget, NULL));
    CHECK(check_colours(cut, form) == told.levels);
    kmb_cut_destroy(cut);
}

static void detail_goes_beyond_the_heights_and_births_are_told(const kmb_repository *heights)
{
    kmb_cut_options options = {.struct_size = sizeof options, .vertex_form = KMB_VERTEX_EXPANDED, .births = 1,
                               .detail_levels = 4, .roughness = 0.1};
    kmb_view view = view_from_above(20);
    kmb_budget budget = no_limits();
    kmb_repository_info told = {.struct_size = sizeof told};
    const kmb_patch *const *patches;
    size_t count;
    uint32_t finest = 0;
    kmb_cut *cut = NULL;
    CHECK_STATUS(KMB_OK, kmb_repository_describe(heights, &told));
    CHECK_STATUS(KMB_OK, kmb_cut_create(heights, &options, &cut));
    CHECK_STATUS(KMB_OK, kmb_cut_update(cut, &view, &budget, NULL));
    CHECK_STATUS(KMB_OK, kmb_cut_patches(cut, &patches, &count));
    for (size_t i = 0; i < count; i++) {
        kmb_patch_info info = {.struct_size = sizeof info};
        CHECK_STATUS(KMB_OK, kmb_patch_describe(patches[i], &info));
        CHECK(!info.colours && info.texture_side == 0 && info.births);
        for (size_t v = 0; v < info.vertex_floats / 6; v++) CHECK(info.births[2 * v + 1] <= (float)info.level);
        if (info.level > finest) finest = info.level;
    }
    CHECK(finest == told.levels + 4);
    kmb_cut_destroy(cut);
}

static void options_that_cannot_be_are_refused(const kmb_repository *heights, const kmb_repository *colours,
                                               const kmb_repository *elsewhere)
{
    kmb_cut *cut = NULL;
    kmb_cut_options good = {.struct_size = sizeof good, .colours = colours}, bad = good;
    bad.colours = elsewhere;
    CHECK_STATUS(KMB_INPUT, kmb_cut_create(heights, &bad, &cut));
    bad.colours = heights;
    CHECK_STATUS(KMB_INPUT, kmb_cut_create(heights, &bad, &cut));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(colours, &good, &cut));
    bad = good, bad.colour_form = 7;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(heights, &bad, &cut));
    bad = good, bad.texel_pixels = -1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(heights, &bad, &cut));
    bad = good, bad.detail_levels = 3;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(heights, &bad, &cut));
    bad = good, bad.detail_levels = 60;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(heights, &bad, &cut));
    bad = good, bad.detail_levels = 2, bad.roughness = 0.5;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(heights, &bad, &cut));
    bad.roughness = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_cut_create(heights, &bad, &cut));
    CHECK(cut == NULL);
}

int main(int count, char **words)
{
    CHECK(count == 2);
    kmb_repository *heights = rough_repository(path_in(words, "under_colours.kmb"));
    kmb_repository *colours = image(path_in(words, "colours.kmb"), 1000), *elsewhere = image(path_in(words, "elsewhere.kmb"), 1010);
    vertices_have_the_colours_of_the_image(heights, colours, KMB_COLOUR_TEXTURE);
    vertices_have_the_colours_of_the_image(heights, colours, KMB_COLOUR_VERTICES);
    detail_goes_beyond_the_heights_and_births_are_told(heights);
    options_that_cannot_be_are_refused(heights, colours, elsewhere);
    kmb_repository_close(heights);
    kmb_repository_close(colours);
    kmb_repository_close(elsewhere);
    return 0;
}
