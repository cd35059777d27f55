/* Diamonds and rasters as bytes in memory: what comes back, exact sizes, and what is refused. */
#include <math.h>
#include <string.h>

#include "check.h"

enum { CELLS = 16, SIDE = CELLS + 1, VERTICES = SIDE * SIDE, CENTRES = CELLS * CELLS };

static uint32_t next_random(void)
{
    static uint32_t state = 1;
    state = state * 1664525u + 1013904223u;
    return state >> 8;
}

/* An array of exactly this size, so that a byte too far is seen by Valgrind and AddressSanitizer. */
static void *exactly(size_t bytes)
{
    void *memory = malloc(bytes ? bytes : 1);
    CHECK(memory);
    return memory;
}

static void fill_diamond(int32_t *vertices, int32_t *centres, uint8_t *vertex_valid, uint8_t *centre_valid)
{
    for (int i = 0; i < VERTICES; i++) {
        vertices[i] = (int32_t)rough_ground(2u * (uint32_t)(i % SIDE), 2u * (uint32_t)(i / SIDE));
        vertex_valid[i] = i % 11 != 0;
    }
    for (int i = 0; i < CENTRES; i++) {
        centres[i] = (int32_t)rough_ground(2u * (uint32_t)(i % CELLS) + 1, 2u * (uint32_t)(i / CELLS) + 1);
        centre_valid[i] = i % 7 != 0 ? 200 : 0;
    }
}

static kmb_codec *new_codec(uint32_t max_error, uint32_t entropy)
{
    kmb_codec_options options = {.struct_size = sizeof options, .cells = CELLS, .minimum = -10, .maximum = 5000,
                                 .max_error = max_error, .entropy = entropy};
    kmb_codec *codec = NULL;
    CHECK_STATUS(KMB_OK, kmb_codec_create(&options, &codec));
    return codec;
}

static void diamond(kmb_codec *codec, int32_t max_error, int with_voids)
{
    int32_t *vertices = exactly(VERTICES * sizeof *vertices), *centres = exactly(CENTRES * sizeof *centres);
    int32_t *back = exactly(CENTRES * sizeof *back);
    uint8_t *vertex_valid = exactly(VERTICES), *centre_valid = exactly(CENTRES), *back_valid = exactly(CENTRES);
    size_t bound = 0, size = 0, again = 0;
    fill_diamond(vertices, centres, vertex_valid, centre_valid);
    const uint8_t *vertex_mask = with_voids ? vertex_valid : NULL, *centre_mask = with_voids ? centre_valid : NULL;
    CHECK_STATUS(KMB_OK, kmb_codec_diamond_bound(codec, &bound));
    uint8_t *bytes = exactly(bound);
    CHECK_STATUS(KMB_OK,
                 kmb_codec_encode_diamond(codec, vertices, vertex_mask, centres, centre_mask, bytes, bound, &size));
    CHECK(size > 0 && size <= bound);
    uint8_t *exact = exactly(size), *small = exactly(size - 1);
    CHECK_STATUS(KMB_OK,
                 kmb_codec_encode_diamond(codec, vertices, vertex_mask, centres, centre_mask, exact, size, &again));
    CHECK(again == size && memcmp(bytes, exact, size) == 0);
    again = 0;
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_codec_encode_diamond(codec, vertices, vertex_mask, centres, centre_mask,
                                                                small, size - 1, &again));
    CHECK(again == size);
    CHECK_STATUS(KMB_OK, kmb_codec_decode_diamond(codec, vertices, vertex_mask, exact, size, back, back_valid));
    for (int i = 0; i < CENTRES; i++) {
        CHECK(back_valid[i] == (!with_voids || centre_valid[i] != 0));
        CHECK(!back_valid[i] || abs(back[i] - centres[i]) <= max_error);
    }
    CHECK_STATUS(KMB_OK, kmb_codec_decode_diamond(codec, vertices, vertex_mask, exact, size, back, NULL));
    for (int round = 0; round < 60; round++) {
        memcpy(exact, bytes, size);
        for (int damage = 0; damage <= round % 3; damage++) exact[next_random() % size] = (uint8_t)next_random();
        size_t length = round % 5 ? size : next_random() % size;
        kmb_status status = kmb_codec_decode_diamond(codec, vertices, vertex_mask, exact, length, back, back_valid);
        CHECK(status == KMB_OK || status == KMB_DAMAGED);
        for (int i = 0; i < CENTRES; i++) CHECK(back[i] >= -10 && back[i] <= 5000);
    }
    free(vertices), free(centres), free(back), free(vertex_valid), free(centre_valid), free(back_valid);
    free(bytes), free(exact), free(small);
}

static void models(void)
{
    enum { COUNT = 8 };
    static int32_t vertices[COUNT][VERTICES], centres[COUNT][CENTRES];
    static uint8_t ignored[VERTICES], model[1 << 16];
    kmb_codec *codec = new_codec(2, KMB_ENTROPY_RANS), *other = new_codec(2, KMB_ENTROPY_RANS);
    kmb_codec *gamma = new_codec(2, KMB_ENTROPY_GAMMA);
    size_t size = 0, needed = 0;
    for (int i = 0; i < COUNT; i++) {
        fill_diamond(vertices[i], centres[i], ignored, ignored);
        for (int j = 0; j < CENTRES; j++) centres[i][j] += (int32_t)(next_random() % 9);
    }
    CHECK_STATUS(KMB_NOT_FOUND, kmb_codec_model(codec, model, sizeof model, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_train(codec, 0, vertices[0], centres[0]));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_train(codec, SIZE_MAX, vertices[0], centres[0]));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_train(codec, COUNT, NULL, centres[0]));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_train(gamma, COUNT, vertices[0], centres[0]));
    CHECK_STATUS(KMB_OK, kmb_codec_train(codec, COUNT, vertices[0], centres[0]));
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_codec_model(codec, NULL, 0, &needed));
    CHECK_STATUS(KMB_OK, kmb_codec_model(codec, model, needed, &size));
    CHECK(size == needed && size > 0);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_set_model(other, NULL, size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_set_model(gamma, model, size));
    CHECK_STATUS(KMB_OK, kmb_codec_set_model(other, model, size));
    diamond(codec, 2, 1);
    diamond(other, 2, 0);
    for (int round = 0; round < 40; round++) {
        uint8_t damaged[1 << 12];
        for (size_t i = 0; i < sizeof damaged; i++) damaged[i] = (uint8_t)next_random();
        kmb_status status = kmb_codec_set_model(other, damaged, round * sizeof damaged / 40);
        CHECK(status == KMB_OK || status == KMB_DAMAGED);
    }
    kmb_codec_destroy(codec), kmb_codec_destroy(other), kmb_codec_destroy(gamma);
}

static void refuse_codec(void)
{
    static int32_t vertices[VERTICES + 1], centres[CENTRES + 1];
    static uint8_t bytes[1 << 13];
    kmb_codec_options good = {.struct_size = sizeof good, .minimum = 0, .maximum = 9}, bad;
    kmb_codec *codec = NULL;
    size_t size = 77;
    const int32_t *misaligned = (const int32_t *)(const void *)((const char *)vertices + 1);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(NULL, &codec));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(&good, NULL));
    bad = good, bad.struct_size = 4;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_codec_create(&bad, &codec));
    bad = good, bad.cells = 17;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(&bad, &codec));
    bad = good, bad.minimum = 10;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(&bad, &codec));
    bad = good, bad.max_error = 1u << 30;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(&bad, &codec));
    bad = good, bad.max_error = UINT32_MAX;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(&bad, &codec));
    bad = good, bad.entropy = 2;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_create(&bad, &codec));
    CHECK(codec == NULL);
    kmb_codec_destroy(NULL);
    codec = new_codec(0, KMB_ENTROPY_RANS);
#define ENCODE(c, v, w, b, n, s) kmb_codec_encode_diamond(c, v, NULL, w, NULL, b, n, s)
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_diamond_bound(NULL, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_diamond_bound(codec, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(NULL, vertices, centres, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, NULL, centres, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, misaligned, centres, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, vertices, NULL, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, vertices, centres, NULL, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, vertices, centres, bytes, SIZE_MAX, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, vertices, centres, bytes, sizeof bytes, NULL));
    centres[5] = 5001;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, vertices, centres, bytes, sizeof bytes, &size));
    CHECK(strstr(kmb_last_error(), "5001"));
    centres[5] = 0, vertices[5] = -11;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, ENCODE(codec, vertices, centres, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_diamond(codec, vertices, NULL, bytes, 0, centres, NULL));
    vertices[5] = 0;
    CHECK(size == 77);
    CHECK_STATUS(KMB_OK, ENCODE(codec, vertices, centres, NULL, 0, &size));
    CHECK(size == 0);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_diamond(NULL, vertices, NULL, bytes, 0, centres, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_diamond(codec, NULL, NULL, bytes, 0, centres, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_diamond(codec, vertices, NULL, NULL, 9, centres, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_diamond(codec, vertices, NULL, bytes, 0, NULL, NULL));
    CHECK_STATUS(KMB_OK, kmb_codec_decode_diamond(codec, vertices, NULL, NULL, 0, centres, NULL));
    CHECK_STATUS(KMB_DAMAGED, kmb_codec_decode_diamond(codec, vertices, NULL, (const uint8_t *)"\xff", 1, centres, NULL));
    kmb_codec_destroy(codec);
}

static kmb_raster_options rough_raster(double max_error, uint32_t entropy)
{
    kmb_raster_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_U16, .width = WIDTH,
                                  .height = HEIGHT, .max_error = max_error, .nodata = 9999, .has_nodata = 1,
                                  .cells = CELLS, .entropy = entropy, .threads = 1};
    return options;
}

static void raster(const char *path, double max_error, uint32_t entropy)
{
    uint16_t *samples = exactly(WIDTH * HEIGHT * sizeof *samples), *back = exactly(WIDTH * HEIGHT * sizeof *back);
    static double window[WIDTH * HEIGHT];
    kmb_raster_options options = rough_raster(max_error, entropy);
    kmb_raster_info info = {.struct_size = sizeof info};
    kmb_repository *repository = NULL;
    size_t bound = 0, size = 0, again = 0;
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
        samples[i] = i % 1001 == 7 ? 9999 : (uint16_t)rough_ground(i % WIDTH, i / WIDTH);
    CHECK_STATUS(KMB_OK, kmb_codec_raster_bound(&options, &bound));
    uint8_t *bytes = exactly(bound);
    CHECK_STATUS(KMB_OK, kmb_codec_encode_raster(&options, samples, bytes, bound, &size));
    CHECK(size > 304 && size <= bound);
    uint8_t *exact = exactly(size), *small = exactly(size - 1);
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_codec_encode_raster(&options, samples, small, size - 1, &again));
    CHECK(again == size);
    CHECK_STATUS(KMB_OK, kmb_codec_encode_raster(&options, samples, exact, size, &again));
    CHECK(again == size && memcmp(exact, bytes, size) == 0);
    CHECK_STATUS(KMB_OK, kmb_codec_raster_describe(exact, size, &info));
    CHECK(info.width == WIDTH && info.height == HEIGHT && info.sample_type == KMB_SAMPLE_U16 && info.sample_bytes == 2);
    CHECK(info.max_error <= max_error && info.max_error_bound == max_error && info.lossless == (max_error == 0));
    CHECK(info.has_nodata == 1 && info.nodata == 9999 && info.void_samples == (WIDTH * HEIGHT - 8) / 1001 + 1);
    CHECK(info.cells == CELLS && info.entropy == entropy && info.transform == KMB_TRANSFORM_INTERPOLATING);
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_codec_decode_raster(exact, size, back, WIDTH * HEIGHT - 1));
    CHECK_STATUS(KMB_OK, kmb_codec_decode_raster(exact, size, back, WIDTH * HEIGHT));
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
        CHECK(samples[i] == 9999 ? back[i] == 9999 : back[i] != 9999 && fabs((double)samples[i] - back[i]) <= max_error);
    FILE *file = fopen(path, "wb");
    CHECK(file && fwrite(exact, 1, size, file) == size && fclose(file) == 0);
    CHECK_STATUS(KMB_OK, kmb_repository_open(path, NULL, &repository));
    kmb_repository_info whole = {.struct_size = sizeof whole};
    CHECK_STATUS(KMB_OK, kmb_repository_describe(repository, &whole));
    CHECK_STATUS(KMB_OK, kmb_read_window(repository, whole.levels, 0, 0, WIDTH, HEIGHT, window, WIDTH * HEIGHT, NULL));
    CHECK(window[0] == back[0] && isnan(window[7]));
    kmb_repository_close(repository);
    for (int round = 0; round < 12; round++) {
        memcpy(exact, bytes, size);
        /* Most damage meets a checksum; that of the header and the index is made as well as that of blocks. */
        size_t range = round % 2 ? size : size < 2000 ? size : 2000;
        exact[next_random() % range] ^= (uint8_t)(1 + next_random() % 255);
        size_t length = round % 4 ? size : next_random() % size;
        kmb_status status = kmb_codec_decode_raster(exact, length, back, WIDTH * HEIGHT);
        CHECK(status == KMB_OK || status == KMB_DAMAGED || status == KMB_INPUT || status == KMB_UNSUPPORTED_VERSION);
    }
    free(samples), free(back), free(bytes), free(exact), free(small);
}

static void floats(void)
{
    static float samples[40 * 30], back[40 * 30];
    kmb_raster_options options = {.struct_size = sizeof options, .sample_type = KMB_SAMPLE_F32, .width = 40,
                                  .height = 30, .max_error = 0.01};
    static uint8_t bytes[1 << 16];
    size_t size = 0;
    for (int i = 0; i < 40 * 30; i++) samples[i] = i == 100 ? NAN : sinf((float)i * 0.01f) * 50;
    CHECK_STATUS(KMB_OK, kmb_codec_encode_raster(&options, samples, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_OK, kmb_codec_decode_raster(bytes, size, back, 40 * 30));
    for (int i = 0; i < 40 * 30; i++) CHECK(i == 100 ? isnan(back[i]) : fabsf(samples[i] - back[i]) <= 0.01f);
    samples[3] = INFINITY;
    CHECK_STATUS(KMB_INPUT, kmb_codec_encode_raster(&options, samples, bytes, sizeof bytes, &size));
}

static void refuse_raster(void)
{
    static int32_t samples[16 * 16 + 1];
    static uint8_t bytes[1 << 18];
    kmb_raster_options good = {.struct_size = sizeof good, .sample_type = KMB_SAMPLE_I32, .width = 16, .height = 16}, bad;
    kmb_raster_info info = {.struct_size = sizeof info};
    size_t size = 77;
    const void *misaligned = (const char *)samples + 1;
#define REFUSED(status, change)                                                                          \
    do {                                                                                                 \
        bad = good, bad.change;                                                                          \
        CHECK_STATUS(status, kmb_codec_raster_bound(&bad, &size));                                       \
        CHECK_STATUS(status, kmb_codec_encode_raster(&bad, samples, bytes, sizeof bytes, &size));        \
    } while (0)
    REFUSED(KMB_INVALID_STRUCT_SIZE, struct_size = 1);
    REFUSED(KMB_INVALID_ARGUMENT, sample_type = 8);
    REFUSED(KMB_INVALID_ARGUMENT, width = 1);
    REFUSED(KMB_INVALID_ARGUMENT, height = 0);
    REFUSED(KMB_INVALID_ARGUMENT, cells = 48);
    REFUSED(KMB_INVALID_ARGUMENT, max_error = -1);
    REFUSED(KMB_INVALID_ARGUMENT, max_error = NAN);
    REFUSED(KMB_INVALID_ARGUMENT, rms_error = 1);
    REFUSED(KMB_INVALID_ARGUMENT, has_nodata = 2);
    REFUSED(KMB_INVALID_ARGUMENT, transform = 3);
    REFUSED(KMB_INVALID_ARGUMENT, entropy = 2);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_raster_bound(NULL, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_raster_bound(&good, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_encode_raster(NULL, samples, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_encode_raster(&good, NULL, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_encode_raster(&good, misaligned, bytes, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_encode_raster(&good, samples, NULL, sizeof bytes, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_encode_raster(&good, samples, bytes, sizeof bytes, NULL));
    CHECK(size == 77);
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_codec_encode_raster(&good, samples, NULL, 0, &size));
    CHECK_STATUS(KMB_OK, kmb_codec_encode_raster(&good, samples, bytes, size, &size));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_raster_describe(NULL, size, &info));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_raster_describe(bytes, size, NULL));
    CHECK_STATUS(KMB_INPUT, kmb_codec_raster_describe((const uint8_t *)"no repository", 13, &info));
    CHECK_STATUS(KMB_DAMAGED, kmb_codec_raster_describe(bytes, size - 1, &info));
    info.struct_size = 1;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_codec_raster_describe(bytes, size, &info));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_raster(NULL, size, samples, 256));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_raster(bytes, size, NULL, 256));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_codec_decode_raster(bytes, size, (char *)samples + 1, 256));
    CHECK_STATUS(KMB_BUFFER_TOO_SMALL, kmb_codec_decode_raster(bytes, size, samples, 255));
}

int main(int count, char **words)
{
    CHECK(count == 2);
    const uint32_t coders[] = {KMB_ENTROPY_RANS, KMB_ENTROPY_GAMMA};
    for (size_t i = 0; i < 2; i++) {
        for (uint32_t max_error = 0; max_error < 40; max_error += 20) {
            kmb_codec *codec = new_codec(max_error, coders[i]);
            diamond(codec, (int32_t)max_error, 0);
            diamond(codec, (int32_t)max_error, 1);
            kmb_codec_destroy(codec);
        }
        raster(path_in(words, "codec.kmb"), 0, coders[i]);
        raster(path_in(words, "codec.kmb"), 20, coders[i]);
    }
    models();
    floats();
    refuse_codec();
    refuse_raster();
    return 0;
}
