/* Compresses a raster in memory, and decompresses it: no file, no view.
 *
 * codec [MAX_ERROR] */
#include <kimberlite.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { WIDTH = 800, HEIGHT = 600 };

static float samples[HEIGHT][WIDTH], back[HEIGHT][WIDTH];

/* Hills with gullies, in metres. */
static void make_hills(void)
{
    for (int row = 0; row < HEIGHT; row++)
        for (int column = 0; column < WIDTH; column++) {
            double gully = fabs(sin(column / 23.0 + sin(row / 31.0)));
            samples[row][column] = (float)(400 * sin(column / 170.0) * cos(row / 130.0) + 25 * gully);
        }
}

int main(int count, char **words)
{
    kmb_raster_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_F32, .width = WIDTH,
                                  .height = HEIGHT, .max_error = count > 1 ? atof(words[1]) : 0.1};
    size_t capacity = 0, size = 0;
    unsigned char *bytes = NULL;
    make_hills();
    kmb_status status = kmb_codec_raster_bound(&options, &capacity);
    if (status == KMB_OK && !(bytes = malloc(capacity))) return fprintf(stderr, "out of memory\n"), 1;
    if (status == KMB_OK) status = kmb_codec_encode_raster(&options, samples, bytes, capacity, &size);
    if (status == KMB_OK) status = kmb_codec_decode_raster(bytes, size, back, WIDTH * HEIGHT);
    free(bytes);
    if (status != KMB_OK) {
        fprintf(stderr, "%s: %s\n", kmb_status_name(status), kmb_last_error());
        return 1;
    }
    double largest = 0;
    for (int row = 0; row < HEIGHT; row++)
        for (int column = 0; column < WIDTH; column++)
            largest = fmax(largest, fabs((double)samples[row][column] - back[row][column]));
    printf("%.3f bits a sample, largest error %.4f of %g\n", 8.0 * (double)size / (WIDTH * HEIGHT), largest,
           options.max_error);
    return largest > options.max_error;
}
