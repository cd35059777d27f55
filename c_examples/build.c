/* Makes a repository from a raster in memory: a round hill with a lake of voids beside it.
 *
 * build OUT.kmb */
#include <kimberlite.h>
#include <math.h>
#include <stdio.h>

enum { WIDTH = 1000, HEIGHT = 800 };

/* Height in metres of the sample at a column and row. */
static double hill(double column, double row)
{
    double across = (column - 500) / 300, down = (row - 400) / 250;
    double lake = hypot(column - 850, row - 650);
    return lake < 60 ? NAN : 900 * exp(-across * across - down * down) + 15 * sin(column / 20) * cos(row / 25);
}

static int32_t rows(void *user, uint32_t first_row, uint32_t row_count, double *samples)
{
    (void)user;
    for (uint32_t row = 0; row < row_count; row++)
        for (uint32_t column = 0; column < WIDTH; column++) *samples++ = hill(column, first_row + row);
    return 0;
}

static int32_t progress(void *user, uint64_t done, uint64_t total)
{
    (void)user;
    fprintf(stderr, "\r%3.0f %%", 100.0 * (double)done / (double)total);
    return 0; /* anything else cancels */
}

int main(int count, char **words)
{
    if (count != 2) {
        fprintf(stderr, "usage: build OUT.kmb\n");
        return 2;
    }
    kmb_builder_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_F32, .width = WIDTH,
                                   .height = HEIGHT, .max_error = 0.1};
    /* The upper left corner of the upper left sample, and samples 10 m apart. */
    const double geotransform[6] = {600000, 10, 0, 5200000, 0, -10};
    kmb_build_report report = {.struct_size = sizeof report};
    kmb_builder *builder = NULL;
    kmb_status status = kmb_builder_create(&options, &builder);
    if (status == KMB_OK) status = kmb_builder_set_geotransform(builder, geotransform, KMB_REGISTRATION_AREA, 0);
    if (status == KMB_OK) status = kmb_builder_set_crs(builder, "EPSG:32632");
    if (status == KMB_OK) status = kmb_builder_set_units(builder, "metre");
    if (status == KMB_OK) status = kmb_builder_write(builder, rows, NULL, progress, NULL, words[1], &report);
    kmb_builder_destroy(builder);
    if (status != KMB_OK) {
        fprintf(stderr, "\n%s: %s\n", kmb_status_name(status), kmb_last_error());
        return 1;
    }
    double valid = (double)(report.samples - report.void_samples);
    printf("\n%s: %llu bytes, %.2f bits a sample, largest error %.3f m\n", words[1], (unsigned long long)report.bytes,
           8 * (double)report.bytes / valid, report.max_error);
    return 0;
}
