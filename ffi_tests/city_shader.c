/* The pictures that the shaders of c_examples draw of a city under OSMesa are those of the library's own rays.
 *
 * city_shader FOLDER CITY [VIEWS [SIZE [TEXELS]]]
 *
 * CITY is a city's .kmb, or a file to build one from, in FOLDER: with 8 and with 16 bits of height. Views lie on four rings, from far above to
 * the streets, with random mixes of coarse and fine blocks, some of which have not come yet. */
#include <math.h>
#include <string.h>

#include <GL/osmesa.h>

#include "check.h"
#include "../c_examples/city_drawing.h"

enum { RINGS = 4 };
/* No city of the tests has it. */
static const double BACKGROUND[3] = {255, 0, 255};

struct comparison {
    double psnr_mean, psnr_min;
    long views, pixels, holes, ghosts, near, partial;
    double largest_difference, differences;
};

struct bench {
    int size;
    unsigned char *pixels;
    float *depths;
    kmb_ray *rays;
    kmb_city_hit *hits;
    kmb_city *city;
    kmb_city_info info;
    kmb_city_visit *visit;
    struct city_drawing drawing;
    struct comparison found;
};

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

/* A perspective view from an eye to a target, 48 degrees high, without depths. */
static kmb_view look(const double eye[3], const double target[3], int size)
{
    const double zenith[3] = {0, 0, 1}, focus = 1 / 0.45;
    double forward[3], right[3], up[3];
    kmb_view view = {.struct_size = sizeof view, .viewport = {size, size}};
    for (int axis = 0; axis < 3; axis++) forward[axis] = target[axis] - eye[axis];
    normalize(forward);
    cross(forward, zenith, right);
    normalize(right);
    cross(right, forward, up);
    const double *rows[4] = {right, up, forward, forward}, scales[4] = {focus, focus, 0, 1};
    for (int row = 0; row < 4; row++) {
        for (int axis = 0; axis < 3; axis++) view.world_to_clip[4 * axis + row] = scales[row] * rows[row][axis];
        view.world_to_clip[12 + row] = -scales[row] * dot(rows[row], eye);
    }
    memcpy(view.eye, eye, sizeof view.eye);
    return view;
}

/* Depths from the nearest hit on: those of floats are coarse far behind the near plane. */
static void set_depths(kmb_view *view, const kmb_city_hit *hits, int count)
{
    double *m = view->world_to_clip, near = INFINITY;
    for (int i = 0; i < count; i++) near = fmin(near, hits[i].distance);
    /* An eye in a prism has met it. */
    near = isinf(near) ? 1 : fmax(0.01, 0.9 * near);
    double far = 1e6 * near, scale = (far + near) / (far - near);
    for (int column = 0; column < 4; column++) m[4 * column + 2] = scale * m[4 * column + 3];
    m[14] -= 2 * far * near / (far - near);
}

static kmb_view ring_view(const struct bench *bench, int number, int views)
{
    /* Radius, height, and how far the target lies beyond the middle, in sides of the city. */
    static const double RING[RINGS][3] = {{1.1, 0.6, 0}, {0.55, 0.25, 0.05}, {0.2, 0.06, 0.15}, {0.25, 0, 0.1}};
    const kmb_city_info *info = &bench->info;
    int each = (views + RINGS - 1) / RINGS;
    const double *ring = RING[number / each];
    double turn = 6.283185307179586 * (number % each / (double)each + 0.03), eye[3], target[3], side = info->side;
    double low = info->heights[0], high = info->heights[1], beyond = ring[2];
    const double around[2] = {cos(turn), sin(turn)};
    for (int axis = 0; axis < 2; axis++) {
        double middle = info->corner[axis] + side / 2;
        eye[axis] = middle + ring[0] * side * around[axis];
        target[axis] = middle - beyond * side * around[axis];
    }
    eye[2] = low + ring[1] * side + 0.5 * (high - low);
    target[2] = low;
    return look(eye, target, bench->size);
}

/* The same light as the shader's. */
static void shade(const kmb_ray *ray, const kmb_city_hit *hit, double colour[3])
{
    static const float LIGHT[3] = {0.45f, -0.35f, 0.82f};
    float toward = 0, facing = 0, share;
    if (hit->node == KMB_NO_NODE) {
        memcpy(colour, BACKGROUND, 3 * sizeof *colour);
        return;
    }
    for (int axis = 0; axis < 3; axis++) {
        toward += hit->normal[axis] * (float)ray->direction[axis];
        facing += hit->normal[axis] * LIGHT[axis];
    }
    if (toward > 0) facing = -facing;
    share = 0.45f * (float)hit->colour[3] / 255.0f + 0.55f * (facing > 0 ? facing : 0);
    for (int band = 0; band < 3; band++) colour[band] = fmin(255, floor((float)hit->colour[band] * share + 0.5));
}

/* The distance of a pixel out of its depth. */
static double distance_of(const kmb_view *view, const kmb_ray *ray, float depth)
{
    const double *m = view->world_to_clip;
    double row = 0, at_eye = m[14];
    for (int axis = 0; axis < 3; axis++) {
        row += m[4 * axis + 2] * ray->direction[axis];
        at_eye += m[4 * axis + 2] * view->eye[axis];
    }
    return at_eye / (2 * (double)depth - 1 - row);
}

/* Whether a ray goes down to the city's floor inside its square. */
static int falls_inside(const kmb_city_info *info, const kmb_ray *ray)
{
    double distance = (info->floor - ray->origin[2]) / ray->direction[2];
    for (int axis = 0; axis < 2; axis++) {
        double along = ray->origin[axis] + distance * ray->direction[axis] - info->corner[axis];
        if (along <= 0 || along >= info->side) return 0;
    }
    return distance > 0;
}

static int is_background(const unsigned char *pixel)
{
    return pixel[0] == BACKGROUND[0] && pixel[1] == BACKGROUND[1] && pixel[2] == BACKGROUND[2];
}

/* Within one step of 8 bits of all the city's heights, or where the ray grazes the ground, within a texel along it. */
static int is_near(const struct bench *bench, const kmb_ray *ray, const kmb_city_hit *hit, double distance)
{
    kmb_city_node node = {.struct_size = sizeof node};
    CHECK_STATUS(KMB_OK, kmb_city_node_at(bench->city, hit->node, &node));
    double off = fabs(distance - hit->distance), along = hypot(ray->direction[0], ray->direction[1]);
    double down = fabs(ray->direction[2]), step = (bench->info.heights[1] - bench->info.heights[0]) / 255;
    return off * down <= step || (down < 0.1 * along && off * along <= node.side / bench->info.side_texels);
}

static void compare(struct bench *bench, const kmb_view *view)
{
    struct comparison *found = &bench->found;
    double squares = 0;
    long counted = 0;
    for (int i = 0; i < bench->size * bench->size; i++) {
        const kmb_ray *ray = bench->rays + i;
        const kmb_city_hit *hit = bench->hits + i;
        double colour[3];
        int is_drawn = bench->depths[i] < 1, is_met = hit->node != KMB_NO_NODE;
        found->holes += (!is_drawn || is_background(bench->pixels + 4 * i)) && (is_met || falls_inside(&bench->info, ray));
        if (!is_drawn && !is_met) continue;
        shade(ray, hit, colour);
        for (int band = 0; band < 3; band++) {
            double off = bench->pixels[4 * i + band] - colour[band];
            squares += off * off;
        }
        counted++;
        found->ghosts += is_drawn && !is_met;
        if (is_drawn && is_met) {
            double distance = distance_of(view, ray, bench->depths[i]);
            found->near += is_near(bench, ray, hit, distance);
            found->differences += fabs(distance - hit->distance);
            found->largest_difference = fmax(found->largest_difference, fabs(distance - hit->distance));
        }
    }
    double psnr = squares == 0 ? 99 : fmin(99, 10 * log10(255.0 * 255 * 3 * (double)counted / squares));
    found->psnr_mean += psnr;
    if (found->views == 0 || psnr < found->psnr_min) found->psnr_min = psnr;
    found->views++;
    found->pixels += counted;
}

static void draw(struct bench *bench, const kmb_view *view)
{
    glViewport(0, 0, bench->size, bench->size);
    glClearColor((float)BACKGROUND[0] / 255, (float)BACKGROUND[1] / 255, (float)BACKGROUND[2] / 255, 1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    CHECK_STATUS(KMB_OK, city_drawing_draw(&bench->drawing, bench->visit, view));
    glFinish();
    glReadPixels(0, 0, bench->size, bench->size, GL_DEPTH_COMPONENT, GL_FLOAT, bench->depths);
    CHECK(glGetError() == GL_NO_ERROR);
}

static void begin(struct bench *bench)
{
    CHECK_STATUS(KMB_OK, kmb_city_visit_create(bench->city, 0, &bench->visit));
    CHECK(city_drawing_create(&bench->drawing, bench->city, KMB_SHADERS) == 0);
}

static void end(struct bench *bench)
{
    city_drawing_destroy(&bench->drawing);
    kmb_city_visit_destroy(bench->visit);
}

/* A number below `end`, any for each picture (splitmix64). */
static uint64_t random_below(uint64_t picture, uint64_t end)
{
    uint64_t bits = (picture + 1) * 0x9E3779B97F4A7C15u;
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9u;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBu;
    return (bits ^ (bits >> 31)) % end;
}

static void see(struct bench *bench, int number, int views)
{
    static const double TOLERANCES[4] = {0, 1, 4, 16};
    kmb_view view = ring_view(bench, number, views);
    kmb_budget budget = no_limits();
    kmb_city_stats stats = {.struct_size = sizeof stats};
    view.tolerance = TOLERANCES[random_below(2 * (uint64_t)number, 4)];
    /* Every second view begins anew, and waits for blocks. */
    if (number % 2) {
        end(bench);
        begin(bench);
        budget.refinements = 1 + random_below(2 * (uint64_t)number + 1, bench->info.nodes);
    }
    CHECK_STATUS(KMB_OK, kmb_city_visit_update(bench->visit, &view, &budget, &stats));
    CHECK_STATUS(KMB_OK, city_drawing_update(&bench->drawing, bench->visit));
    bench->found.partial += (long)stats.partial;
    int count = bench->size * bench->size;
    for (int i = 0; i < count; i++) bench->rays[i] = city_ray(&view, i % bench->size + 0.5, i / bench->size + 0.5);
    bench->hits[0].struct_size = sizeof *bench->hits;
    CHECK_STATUS(KMB_OK, kmb_city_visit_cast(bench->visit, (size_t)count, bench->rays, bench->hits));
    set_depths(&view, bench->hits, count);
    draw(bench, &view);
    compare(bench, &view);
}

static void compare_city(const char *path, int views, int size)
{
    struct bench bench = {.size = size, .info = {.struct_size = sizeof bench.info}};
    const int attributes[] = {OSMESA_FORMAT, OSMESA_RGBA, OSMESA_DEPTH_BITS, 32, OSMESA_PROFILE, OSMESA_CORE_PROFILE,
                              OSMESA_CONTEXT_MAJOR_VERSION, 3, OSMESA_CONTEXT_MINOR_VERSION, 3, 0};
    size_t count = (size_t)size * (size_t)size;
    OSMesaContext context = OSMesaCreateContextAttribs(attributes, NULL);
    bench.pixels = malloc(count * 4);
    bench.depths = malloc(count * sizeof *bench.depths);
    bench.rays = malloc(count * sizeof *bench.rays);
    bench.hits = malloc(count * sizeof *bench.hits);
    CHECK(bench.pixels && bench.depths && bench.rays && bench.hits);
    CHECK(context && OSMesaMakeCurrent(context, bench.pixels, GL_UNSIGNED_BYTE, size, size));
    CHECK_STATUS(KMB_OK, kmb_city_open(path, KMB_ACCESS_MAP, &bench.city));
    CHECK_STATUS(KMB_OK, kmb_city_describe(bench.city, &bench.info));
    begin(&bench);
    for (int number = 0; number < views; number++) see(&bench, number, views);
    struct comparison *found = &bench.found;
    double compared = (double)(found->pixels - found->ghosts);
    printf("%s: %ld views, %ld pixels, PSNR %.1f dB (least %.1f), depths within a step %.4f %%, mean difference %.5f, "
           "largest %.3f, holes %ld, ghosts %ld, partial blocks %ld\n", path, found->views, found->pixels, found->psnr_mean / views,
           found->psnr_min, 100 * (double)found->near / compared, found->differences / compared, found->largest_difference,
           found->holes, found->ghosts, found->partial);
    CHECK(found->psnr_min >= 40 && (double)found->near >= 0.999 * compared);
    CHECK(found->holes == 0 && (double)found->ghosts <= 1e-3 * compared && (views < 8 || found->partial > 0));
    end(&bench);
    kmb_city_close(bench.city);
    OSMesaDestroyContext(context);
    free(bench.pixels), free(bench.depths), free(bench.rays), free(bench.hits);
}

static void build(const char *source, const char *path, uint32_t texels, uint32_t height_bits)
{
    kmb_city_options options = {.struct_size = sizeof options, .side_texels = texels, .views = 8, .height_bits = height_bits,
                                .leaf_side = 128, .has_facades = 1, .facades = 1};
    kmb_city_builder *builder = NULL;
    CHECK_STATUS(KMB_OK, kmb_city_builder_create(&options, &builder));
    CHECK_STATUS(KMB_OK, kmb_city_builder_add_file(builder, source));
    CHECK_STATUS(KMB_OK, kmb_city_builder_build(builder, path, NULL, NULL, NULL));
    kmb_city_builder_destroy(builder);
}

int main(int count, char **words)
{
    CHECK(count >= 3);
    int views = count > 3 ? atoi(words[3]) : 8, size = count > 4 ? atoi(words[4]) : 96;
    uint32_t texels = count > 5 ? (uint32_t)atoi(words[5]) : 64;
    CHECK(views > 0 && size > 0 && size <= 4096);
    if (strstr(words[2], ".kmb")) {
        compare_city(words[2], views, size);
        return 0;
    }
    for (uint32_t height_bits = 8; height_bits <= 16; height_bits += 8) {
        char path[4096];
        snprintf(path, sizeof path, "%s/shader_city_%u.kmb", words[1], height_bits);
        build(words[2], path, texels, height_bits);
        compare_city(path, views, size);
    }
    return 0;
}
