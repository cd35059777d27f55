/* Cities are built from files and from a callback's ground; what no city can be built from is refused; damaged files are found. */
#include <math.h>
#include <string.h>

#include "check.h"

static const char OBJ[] = "v 0 0 0\nv 20 0 0\nv 20 20 0\nv 0 20 0\nv 0 0 9\nv 20 0 9\nv 20 20 9\nv 0 20 9\n"
                          "f 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

static void write_file(const char *path, const void *bytes, size_t length)
{
    FILE *file = fopen(path, "wb");
    CHECK(file && fwrite(bytes, 1, length, file) == length);
    CHECK(fclose(file) == 0);
}

static size_t read_file(const char *path, unsigned char *bytes, size_t most)
{
    FILE *file = fopen(path, "rb");
    CHECK(file);
    size_t length = fread(bytes, 1, most, file);
    CHECK(length < most && fclose(file) == 0);
    return length;
}

static const double TRIANGLE[9] = {0, 0, 0, 10, 0, 0, 0, 10, 3};

static void options_that_cannot_be_are_refused(void)
{
    kmb_city_builder *builder = (kmb_city_builder *)16;
    kmb_city_options good = {.struct_size = sizeof good}, bad = good;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&good, NULL));
    bad.struct_size = 12;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.side_texels = 48;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.views = 5000;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.height_bits = 12;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.leaf_side = NAN;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.leaf_side = 0.5;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.exposure = -1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.exposure = INFINITY;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    bad = good, bad.has_facades = 2;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_create(&bad, &builder));
    CHECK(builder == (kmb_city_builder *)16);
    kmb_city_builder_destroy(NULL);
}

static void triangles_that_cannot_be_are_refused(kmb_city_builder *builder)
{
    static const float PLACES[6] = {0, 0, 1, 0, 0, 1}, BAD_PLACES[6] = {0, 0, NAN, 0, 0, 1};
    double corners[9];
    uint8_t pixels[12] = {0};
    uint32_t texture = 9;
    kmb_city_paint paint = {.struct_size = sizeof paint, .kind = KMB_PAINT_TEXTURE, .coordinates = PLACES}, bad = paint;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_texture(NULL, 2, 2, pixels, &texture));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_texture(builder, 0, 2, pixels, &texture));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_texture(builder, 2, 2, NULL, &texture));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_texture(builder, 2, 2, pixels, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_texture(builder, 40000, 40000, pixels, &texture));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_texture(builder, UINT32_MAX, UINT32_MAX, pixels, &texture));
    CHECK(texture == 9);
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &paint));
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_texture(builder, 2, 2, pixels, &texture));
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &paint));
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, NULL));
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_triangles(builder, 0, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(NULL, 1, TRIANGLE, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, SIZE_MAX, TRIANGLE, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 10 << 20, TRIANGLE, NULL));
    bad.texture = 1;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &bad));
    bad = paint, bad.coordinates = NULL;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &bad));
    bad = paint, bad.coordinates = BAD_PLACES;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &bad));
    bad.kind = KMB_PAINT_FACADE;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &bad));
    bad = paint, bad.kind = 3;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &bad));
    bad = paint, bad.struct_size = 0;
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_builder_add_triangles(builder, 1, TRIANGLE, &bad));
    for (int number = 0; number < 9; number++) {
        static const double BAD[4] = {NAN, INFINITY, -INFINITY, 1e13};
        memcpy(corners, TRIANGLE, sizeof corners);
        corners[number] = BAD[number % 4];
        CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_triangles(builder, 1, corners, NULL));
    }
}

static int32_t ground(void *user, double x, double y, double *height)
{
    (void)user;
    *height = x + y;
    return 0;
}

static void the_ground_and_the_path_are_checked(kmb_city_builder *builder, const char *folder)
{
    kmb_city_report report = {.struct_size = 8};
    char path[4096];
    uint64_t warnings;
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_plane(builder, NAN));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_plane(builder, 1e12));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_plane(NULL, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_ground(builder, ground, NULL, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_ground(builder, ground, NULL, NAN));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_ground(builder, ground, NULL, INFINITY));
    CHECK_STATUS(KMB_OK, kmb_city_builder_set_ground(builder, NULL, NULL, 0));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_crs(builder, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_set_crs(builder, "\xff"));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_warnings(builder, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_warnings(NULL, &warnings));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_build(builder, NULL, NULL, NULL, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_build(NULL, "x.kmb", NULL, NULL, NULL));
    CHECK_STATUS(KMB_IO, kmb_city_builder_build(builder, "/absent/x.kmb", NULL, NULL, NULL));
    snprintf(path, sizeof path, "%s/refused_city.kmb", folder);
    CHECK_STATUS(KMB_INVALID_STRUCT_SIZE, kmb_city_builder_build(builder, path, NULL, NULL, &report));
    CHECK(!exists(path));
}

static void count_messages(void *user, uint32_t level, const char *message)
{
    *(int *)user += level == KMB_LOG_WARNING && message[0] != 0;
}

static void files_are_added(const char *folder, const char *city)
{
    kmb_city_options options = {.struct_size = sizeof options, .side_texels = 32, .views = 4, .leaf_side = 16, .has_facades = 1,
                                .facades = 7, .threads = 1, .memory = 16, .ground_colour = {10, 200, 30}};
    kmb_city_report report = {.struct_size = sizeof report};
    kmb_city_builder *builder = NULL;
    uint64_t warnings = 0;
    int messages = 0;
    char path[4096];
    CHECK_STATUS(KMB_OK, kmb_city_builder_create(&options, &builder));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_build(builder, city, NULL, NULL, &report));
    snprintf(path, sizeof path, "%s/absent.obj", folder);
    CHECK_STATUS(KMB_IO, kmb_city_builder_add_file(builder, path));
    snprintf(path, sizeof path, "%s/box.txt", folder);
    write_file(path, OBJ, sizeof OBJ - 1);
    CHECK_STATUS(KMB_INPUT, kmb_city_builder_add_file(builder, path));
    snprintf(path, sizeof path, "%s/box.json", folder);
    write_file(path, OBJ, sizeof OBJ - 1);
    CHECK_STATUS(KMB_INPUT, kmb_city_builder_add_file(builder, path));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_file(builder, NULL));
    CHECK_STATUS(KMB_INVALID_ARGUMENT, kmb_city_builder_add_file(NULL, path));
    CHECK_STATUS(KMB_OK, kmb_set_log_callback(count_messages, &messages));
    snprintf(path, sizeof path, "%s/box.obj", folder);
    write_file(path, OBJ, sizeof OBJ - 1);
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_file(builder, path));
    CHECK_STATUS(KMB_OK, kmb_city_builder_warnings(builder, &warnings));
    CHECK(warnings == 0 && messages == 0);
    snprintf(path, sizeof path, "%s/missing_material.obj", folder);
    FILE *file = fopen(path, "w");
    CHECK(file && fprintf(file, "mtllib absent.mtl\n%s", OBJ) > 0 && fclose(file) == 0);
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_file(builder, path));
    CHECK_STATUS(KMB_OK, kmb_city_builder_warnings(builder, &warnings));
    CHECK(warnings > 0 && messages == (int)warnings);
    CHECK_STATUS(KMB_OK, kmb_set_log_callback(NULL, NULL));
    CHECK_STATUS(KMB_OK, kmb_city_builder_build(builder, city, NULL, NULL, &report));
    CHECK(report.triangles == 20 && report.leaves == 4 && report.wall_texels > 0);
    kmb_city_builder_destroy(builder);
}

/* Reads all that there is of a file that may be anything. */
static kmb_status use(const char *path, uint32_t access)
{
    kmb_city *city = NULL;
    kmb_city_visit *visit = NULL;
    kmb_city_info info = {.struct_size = sizeof info};
    kmb_status status = kmb_city_open(path, access, &city), worst = status;
    if (status != KMB_OK) return status;
    CHECK_STATUS(KMB_OK, kmb_city_describe(city, &info));
    uint8_t *image = malloc((size_t)info.image_bytes);
    CHECK(image);
    for (uint32_t node = 0; node < info.nodes; node++) {
        status = kmb_city_read(city, node, image, (size_t)info.image_bytes, NULL, 0, NULL);
        if (status != KMB_OK) worst = status;
    }
    if (kmb_city_visit_create(city, 0, &visit) == KMB_OK) {
        kmb_view view = {.struct_size = sizeof view, .viewport = {100, 100}};
        kmb_ray ray = {.struct_size = sizeof ray, .origin = {10, 10, 50}, .direction = {0, 0, -1}, .longest = INFINITY};
        kmb_city_hit hit = {.struct_size = sizeof hit};
        view.world_to_clip[0] = view.world_to_clip[5] = 0.01, view.world_to_clip[15] = 1;
        CHECK_STATUS(KMB_OK, kmb_city_visit_update(visit, &view, NULL, NULL));
        CHECK_STATUS(KMB_OK, kmb_city_visit_cast(visit, 1, &ray, &hit));
        CHECK(worst != KMB_OK || (hit.node != KMB_NO_NODE && fabs(hit.height - 9) < 0.1));
        kmb_city_visit_destroy(visit);
    }
    free(image);
    kmb_city_close(city);
    return worst;
}

static void damage_is_found(const char *folder, const char *city)
{
    static unsigned char bytes[1 << 20];
    size_t length = read_file(city, bytes, sizeof bytes), found = 0, tried = 0;
    char path[4096];
    snprintf(path, sizeof path, "%s/damaged_city.kmb", folder);
    CHECK_STATUS(KMB_OK, use(city, KMB_ACCESS_MAP));
    for (size_t part = 0; part < 40; part++) {
        write_file(path, bytes, length * part / 40);
        kmb_status status = use(path, part % 2 ? KMB_ACCESS_MAP : KMB_ACCESS_POSITIONED);
        CHECK(status == KMB_DAMAGED || status == KMB_UNSUPPORTED_VERSION);
    }
    for (size_t at = 0; at < length; at += length / 150 + 1, tried++) {
        bytes[at] ^= (unsigned char)(1 << at % 8);
        write_file(path, bytes, length);
        found += use(path, KMB_ACCESS_MAP) != KMB_OK;
        bytes[at] ^= (unsigned char)(1 << at % 8);
    }
    /* What is between the sections is not covered by a checksum. */
    CHECK(found > tried * 9 / 10);
}

int main(int count, char **words)
{
    CHECK(count == 2);
    char city[4096];
    snprintf(city, sizeof city, "%s/city_of_files.kmb", words[1]);
    kmb_city_builder *builder = NULL;
    kmb_city_options options = {.struct_size = sizeof options, .memory = 1};
    options_that_cannot_be_are_refused();
    CHECK_STATUS(KMB_OK, kmb_city_builder_create(&options, &builder));
    triangles_that_cannot_be_are_refused(builder);
    the_ground_and_the_path_are_checked(builder, words[1]);
    kmb_city_builder_destroy(builder);
    files_are_added(words[1], city);
    damage_is_found(words[1], city);
    return 0;
}
