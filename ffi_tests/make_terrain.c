/* Builds a terrain of hills in all sizes, without voids, 1025 x 1025 samples 30 units apart, for the tests that draw. */
#include <math.h>
#include <string.h>

#include "check.h"

enum { SIDE = 1025 };

static double lattice_value(uint32_t column, uint32_t row, uint32_t size)
{
    uint32_t hash = column * 2654435761u ^ row * 2246822519u ^ size * 3266489917u;
    hash ^= hash >> 15;
    hash *= 2246822519u;
    hash ^= hash >> 13;
    return (double)(hash & 0xffff) / 65535 - 0.5;
}

static double smooth(double t) { return t * t * (3 - 2 * t); }

/* Smooth noise with knots `size` samples apart. */
static double noise(uint32_t column, uint32_t row, uint32_t size)
{
    uint32_t c = column / size, r = row / size;
    double a = smooth((double)(column % size) / size), b = smooth((double)(row % size) / size);
    double top = lattice_value(c, r, size) * (1 - a) + lattice_value(c + 1, r, size) * a;
    double bottom = lattice_value(c, r + 1, size) * (1 - a) + lattice_value(c + 1, r + 1, size) * a;
    return top * (1 - b) + bottom * b;
}

static int32_t rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    (void)user;
    for (uint32_t row = first_row; row < first_row + row_count; row++) {
        for (uint32_t column = 0; column < SIDE; column++) {
            double height = 2000;
            for (uint32_t size = 256; size >= 2; size /= 2) height += 14 * size * noise(column, row, size);
            *samples++ = rint(height);
        }
    }
    return 0;
}

int main(int count, char **words)
{
    const double geotransform[6] = {500000, 30, 0, 4000000, 0, -30};
    kmb_builder_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_I16, .width = SIDE,
                                   .height = SIDE, .max_error = 1, .cells = 32};
    kmb_builder *builder = NULL;
    CHECK(count == 2);
    CHECK_STATUS(KMB_OK, kmb_builder_create(&options, &builder));
    CHECK_STATUS(KMB_OK, kmb_builder_set_geotransform(builder, geotransform, KMB_REGISTRATION_AREA, 0));
    CHECK_STATUS(KMB_OK, kmb_builder_write(builder, rows, NULL, NULL, NULL, words[1], NULL));
    kmb_builder_destroy(builder);
    return 0;
}
