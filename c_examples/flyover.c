/* Flies over a repository without any display and leaves pictures: opens it, makes a cut, moves the cut towards each frame's view,
 * keeps the patches in OpenGL buffers, draws them with OSMesa, and writes PNGs and a summary.
 *
 * flyover FILE.kmb [--colour FILE.kmb] [--frames N] [--size WxH] [--tolerance PX] [--budget-us N] [--out DIR]
 *                  [--every K] [--wireframe] [--levels] [--meter] [--background R,G,B] [--steep N] [--still N]
 *                  [--threads N] [--budget-mib N] [--detail LEVELS] [--roughness PART]
 *
 * --colour FILE drapes the colours of another repository, which has the same domain. --detail LEVELS goes on beyond the finest
 * heights, --roughness PART with random ones: the most that a vertex is moved, as a part of its edge.
 * --steep N draws N views from above that see only the terrain's inside instead of a flight, and fails if a pixel of the
 * background shows. --still N then stays at the last view for N frames, in which the cut should settle.
 * --threads N decodes beside the flight; --meter shows time, bytes and what is awaited as bars. */
#include <errno.h>
#include <kimberlite.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <GL/osmesa.h>

#include "camera.h"
#include "drawing.h"
#include "meter.h"
#include "picture.h"

struct options {
    const char *file, *colour, *out;
    int frames, width, height, every, steep, still, wireframe, levels, meter, threads, detail;
    double tolerance, roughness;
    uint64_t budget_us, budget_bytes;
    int background[3];
};

struct summary {
    double triangles, patches, update_us, update_us_max, fixed_us;
    uint64_t added, removed, still_changes, late_refinements;
    long frames, pictures, background_pixels;
};

struct flight {
    struct options options;
    kmb_repository *repository, *colours;
    kmb_query *query;
    kmb_cut *cut;
    struct terrain terrain;
    struct drawing drawing;
    OSMesaContext context;
    unsigned char *pixels;
    struct summary summary;
};

static int library_error(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, kmb_last_error());
    return 1;
}

static int read_options(int count, char **words, struct options *options)
{
    *options = (struct options){.out = ".", .frames = 240, .width = 1280, .height = 1024, .every = 10,
                                .tolerance = 1, .budget_us = KMB_UNLIMITED, .budget_bytes = KMB_UNLIMITED,
                                .background = {166, 196, 226}};
    for (int i = 1; i < count; i++) {
        const char *name = words[i], *value = i + 1 < count ? words[i + 1] : "";
        int *colour = options->background, used = 1;
        if (!strcmp(name, "--wireframe")) options->wireframe = 1, used = 0;
        else if (!strcmp(name, "--levels")) options->levels = 1, used = 0;
        else if (!strcmp(name, "--meter")) options->meter = 1, used = 0;
        else if (!strcmp(name, "--threads")) options->threads = atoi(value);
        else if (!strcmp(name, "--colour")) options->colour = value;
        else if (!strcmp(name, "--detail")) options->detail = atoi(value);
        else if (!strcmp(name, "--roughness")) options->roughness = atof(value);
        else if (!strcmp(name, "--frames")) options->frames = atoi(value);
        else if (!strcmp(name, "--steep")) options->steep = atoi(value);
        else if (!strcmp(name, "--still")) options->still = atoi(value);
        else if (!strcmp(name, "--every")) options->every = atoi(value);
        else if (!strcmp(name, "--tolerance")) options->tolerance = atof(value);
        else if (!strcmp(name, "--budget-us")) options->budget_us = strtoull(value, NULL, 10);
        else if (!strcmp(name, "--budget-mib")) options->budget_bytes = strtoull(value, NULL, 10) << 20;
        else if (!strcmp(name, "--out")) options->out = value;
        else if (!strcmp(name, "--size") && sscanf(value, "%dx%d", &options->width, &options->height) == 2) {}
        else if (!strcmp(name, "--background") && sscanf(value, "%d,%d,%d", colour, colour + 1, colour + 2) == 3) {}
        else if (name[0] != '-' && !options->file) options->file = name, used = 0;
        else return 1;
        i += used;
    }
    return !options->file || options->frames < 1 || options->width < 1 || options->height < 1 || options->every < 1
        || options->steep < 0 || options->still < 0 || options->threads < 0 || options->detail < 0;
}

static int open_terrain(struct flight *flight)
{
    kmb_repository_info info = {.struct_size = sizeof info};
    const struct options *options = &flight->options;
    if (options->colour && kmb_repository_open(options->colour, NULL, &flight->colours) != KMB_OK)
        return library_error("cannot open");
    kmb_cut_options cut = {.struct_size = sizeof cut, .vertex_form = KMB_VERTEX_EXPANDED, .metric = KMB_METRIC_GEOMETRIC,
                           .threads = (uint32_t)options->threads, .colours = flight->colours,
                           .detail_levels = (uint32_t)options->detail, .roughness = options->roughness};
    if (kmb_repository_open(options->file, NULL, &flight->repository) != KMB_OK
        || kmb_repository_describe(flight->repository, &info) != KMB_OK
        || kmb_query_create(flight->repository, 64 << 20, &flight->query) != KMB_OK
        || kmb_cut_create(flight->repository, &cut, &flight->cut) != KMB_OK) {
        return library_error("cannot open");
    }
    flight->terrain = terrain_of(&info, flight->query);
    if (options->steep && info.void_samples)
        fprintf(stderr, "note: the terrain has voids, which show the background\n");
    return 0;
}

static int open_picture(struct flight *flight)
{
    const int attributes[] = {OSMESA_FORMAT, OSMESA_RGBA, OSMESA_DEPTH_BITS, 24, OSMESA_PROFILE, OSMESA_CORE_PROFILE,
                              OSMESA_CONTEXT_MAJOR_VERSION, 3, OSMESA_CONTEXT_MINOR_VERSION, 3, 0};
    const struct options *options = &flight->options;
    flight->pixels = malloc((size_t)options->width * (size_t)options->height * 4);
    flight->context = OSMesaCreateContextAttribs(attributes, NULL);
    if (!flight->pixels || !flight->context
        || !OSMesaMakeCurrent(flight->context, flight->pixels, GL_UNSIGNED_BYTE, options->width, options->height)) {
        fprintf(stderr, "OSMesa gives no OpenGL 3.3\n");
        return 1;
    }
    if (mkdir(options->out, 0777) != 0 && errno != EEXIST) {
        fprintf(stderr, "%s: %s\n", options->out, strerror(errno));
        return 1;
    }
    if (drawing_create(&flight->drawing, flight->cut, flight->terrain.low[2], flight->terrain.high[2])) return 1;
    flight->drawing.wireframe = options->wireframe;
    flight->drawing.by_level = options->levels;
    return 0;
}

static long background_pixels(const struct flight *flight)
{
    const int *colour = flight->options.background;
    long count = 0, total = (long)flight->options.width * flight->options.height;
    for (const unsigned char *pixel = flight->pixels; total-- > 0; pixel += 4)
        count += pixel[0] == colour[0] && pixel[1] == colour[1] && pixel[2] == colour[2];
    return count;
}

static void count(struct summary *summary, const kmb_stats *stats)
{
    summary->frames++;
    summary->triangles += (double)stats->triangles;
    summary->patches += (double)stats->patches;
    summary->update_us += stats->microseconds;
    summary->fixed_us += stats->fixed_microseconds;
    if (stats->microseconds > summary->update_us_max) summary->update_us_max = stats->microseconds;
    summary->added += stats->added;
    summary->removed += stats->removed;
    summary->late_refinements += stats->late_refinements;
}

/* One frame: update the cut, upload, draw, and write a picture where `name` is not NULL. */
static int show(struct flight *flight, const struct camera *camera, const char *name, kmb_stats *stats)
{
    const struct options *options = &flight->options;
    kmb_view view = view_of(camera, &flight->terrain, options->width, options->height, options->tolerance);
    kmb_budget budget = {.struct_size = sizeof budget, .microseconds = options->budget_us,
                         .refinements = KMB_UNLIMITED, .bytes = options->budget_bytes, .upload_bytes = KMB_UNLIMITED,
                         .patches = KMB_UNLIMITED};
    *stats = (kmb_stats){.struct_size = sizeof *stats};
    if (kmb_cut_update(flight->cut, &view, &budget, stats) != KMB_OK
        || drawing_update(&flight->drawing, flight->cut) != KMB_OK
        || drawing_draw(&flight->drawing, flight->cut, &view, options->background) != KMB_OK) {
        return library_error("cannot draw");
    }
    if (options->meter) meter_draw(stats, &budget, options->width, options->height);
    glFinish();
    count(&flight->summary, stats);
    if (!name) return 0;
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.png", options->out, name);
    flight->summary.pictures++;
    return picture_write(path, options->width, options->height, flight->pixels);
}

static int fly(struct flight *flight)
{
    const struct options *options = &flight->options;
    kmb_stats stats;
    char name[64];
    struct camera camera = {{0}, {0}};
    for (int frame = 0; frame < options->frames && !options->steep; frame++) {
        camera = flight_camera(&flight->terrain, frame, options->frames);
        snprintf(name, sizeof name, "frame_%04d", frame);
        int last = frame == options->frames - 1;
        if (show(flight, &camera, frame % options->every == 0 || last ? name : NULL, &stats)) return 1;
    }
    for (int index = 0; index < options->steep; index++) {
        camera = steep_camera(&flight->terrain, index, (double)options->width / options->height);
        snprintf(name, sizeof name, "steep_%04d", index);
        if (show(flight, &camera, index % options->every == 0 ? name : NULL, &stats)) return 1;
        long pixels = background_pixels(flight);
        if (pixels) fprintf(stderr, "view %d: %ld pixels of the background\n", index, pixels);
        flight->summary.background_pixels += pixels;
    }
    for (int frame = 0; frame < options->still; frame++) {
        if (show(flight, &camera, NULL, &stats)) return 1;
        flight->summary.still_changes = stats.added + stats.removed;
    }
    return 0;
}

static int report(const struct flight *flight)
{
    const struct summary *summary = &flight->summary;
    double frames = (double)summary->frames;
    char path[4096];
    snprintf(path, sizeof path, "%s/summary.json", flight->options.out);
    FILE *file = fopen(path, "w");
    if (!file) {
        fprintf(stderr, "%s: %s\n", path, strerror(errno));
        return 1;
    }
    fprintf(file,
            "{\"frames\": %ld, \"pictures\": %ld, \"triangles_mean\": %.0f, \"patches_mean\": %.1f,\n"
            " \"update_us_mean\": %.1f, \"update_us_max\": %.1f, \"fixed_us_mean\": %.1f,\n"
            " \"patches_added\": %llu, \"patches_removed\": %llu, \"still_changes\": %llu,\n"
            " \"late_refinements\": %llu, \"background_pixels\": %ld}\n",
            summary->frames, summary->pictures, summary->triangles / frames, summary->patches / frames,
            summary->update_us / frames, summary->update_us_max, summary->fixed_us / frames,
            (unsigned long long)summary->added, (unsigned long long)summary->removed,
            (unsigned long long)summary->still_changes, (unsigned long long)summary->late_refinements,
            flight->options.steep ? summary->background_pixels : 0);
    int failed = fclose(file) != 0;
    printf("%ld frames, %.0f triangles in %.0f patches, update %.0f us (most %.0f us): %s\n", summary->frames,
           summary->triangles / frames, summary->patches / frames, summary->update_us / frames,
           summary->update_us_max, path);
    return failed || summary->background_pixels > 0;
}

int main(int count, char **words)
{
    static struct flight flight;
    if (read_options(count, words, &flight.options)) {
        fprintf(stderr, "usage: flyover FILE.kmb [--colour FILE.kmb] [--frames N] [--size WxH] [--tolerance PX]"
                        " [--budget-us N] [--out DIR] [--every K] [--wireframe] [--levels] [--meter]"
                        " [--background R,G,B] [--steep N] [--still N] [--threads N] [--budget-mib N]"
                        " [--detail LEVELS] [--roughness PART]\n");
        return 2;
    }
    int failed = open_terrain(&flight) || open_picture(&flight) || fly(&flight) || report(&flight);
    if (flight.context) {
        drawing_destroy(&flight.drawing);
        OSMesaDestroyContext(flight.context);
    }
    free(flight.pixels);
    kmb_cut_destroy(flight.cut);
    kmb_query_destroy(flight.query);
    kmb_repository_close(flight.repository);
    kmb_repository_close(flight.colours);
    return failed;
}
