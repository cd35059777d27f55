/* Asks a repository without drawing it: what it is, heights at points, and a coarse window of samples.
 *
 * query FILE.kmb */
#include <kimberlite.h>
#include <stdio.h>

static void print_info(const kmb_repository_info *info)
{
    printf("%u x %u samples, %u levels of diamonds with %u cells, %llu bytes\n", info->width, info->height, info->levels,
           info->cells, (unsigned long long)info->bytes);
    printf("heights from %g to %g %s, largest error %g\n", info->sample_min, info->sample_max, info->units,
           info->max_error);
    printf("reference system: %s\n", info->crs[0] ? info->crs : "none");
}

/* Heights along the diagonal, in world coordinates. */
static kmb_status print_heights(const kmb_repository *repository, const kmb_repository_info *info)
{
    kmb_query *query = NULL;
    kmb_status status = kmb_query_create(repository, 16 << 20, &query);
    for (int i = 0; i <= 4 && (status == KMB_OK || status == KMB_OUTSIDE); i++) {
        double x = info->world_origin[0] + info->world_step[0] * (info->width - 1) * i / 4.0;
        double y = info->world_origin[1] + info->world_step[1] * (info->height - 1) * i / 4.0;
        kmb_height height = {.struct_size = sizeof height};
        status = kmb_height_at(query, x, y, &height);
        if (status == KMB_OK) printf("at %.1f, %.1f: %.2f +- %.2f\n", x, y, height.height, height.error_bound);
        if (status == KMB_OUTSIDE) printf("at %.1f, %.1f: no data\n", x, y);
    }
    kmb_query_destroy(query);
    return status == KMB_OUTSIDE ? KMB_OK : status;
}

/* The upper left corner of the coarsest level that has at least 4 x 4 samples. */
static kmb_status print_window(const kmb_repository *repository, const kmb_repository_info *info)
{
    double samples[16];
    uint32_t level = info->levels, step = 1;
    while (level > 0 && (info->width - 1) / (2 * step) >= 3 && (info->height - 1) / (2 * step) >= 3) {
        level -= 2;
        step *= 2;
    }
    uint32_t width = (info->width - 1) / step + 1, height = (info->height - 1) / step + 1;
    width = width < 4 ? width : 4;
    height = height < 4 ? height : 4;
    kmb_status status = kmb_read_window(repository, level, 0, 0, width, height, samples, 16, NULL);
    if (status != KMB_OK) return status;
    printf("level %u, every %u-th sample:\n", level, step);
    for (uint32_t row = 0; row < height; row++) {
        for (uint32_t column = 0; column < width; column++) printf(" %10.2f", samples[row * width + column]);
        printf("\n");
    }
    return KMB_OK;
}

int main(int count, char **words)
{
    if (count != 2) {
        fprintf(stderr, "usage: query FILE.kmb\n");
        return 2;
    }
    kmb_repository *repository = NULL;
    kmb_repository_info info = {.struct_size = sizeof info};
    kmb_status status = kmb_repository_open(words[1], NULL, &repository);
    if (status == KMB_OK) status = kmb_repository_describe(repository, &info);
    if (status == KMB_OK) {
        print_info(&info);
        status = print_heights(repository, &info);
    }
    if (status == KMB_OK) status = print_window(repository, &info);
    if (status != KMB_OK) fprintf(stderr, "%s\n", kmb_last_error());
    kmb_repository_close(repository);
    return status != KMB_OK;
}
