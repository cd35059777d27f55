/* Flies a ring around a city without any display and leaves pictures: opens it, makes a visit, moves the visit towards each frame's view, keeps
 * its blocks as OpenGL textures, draws them by rays with OSMesa, and writes PNGs and a summary.
 *
 * city CITY.kmb [--terrain FILE.kmb] [--frames N] [--size WxH] [--tolerance PX] [--budget-us N] [--budget-mib N] [--blocks N]
 *               [--threads N] [--out DIR] [--every K] [--plain] [--meter] [--raw] [--background R,G,B] [--shaders DIR]
 *
 * --terrain FILE draws a terrain under the city; the budget is then one for both. --blocks N lets N blocks come in a frame.
 * --plain leaves ambient occlusion away; --meter shows time, bytes and what is awaited as bars.
 * --raw writes beside each picture NAME.rgba, 4 bytes a pixel, and NAME.depth, a float a pixel: the depth buffer, 1 where nothing is. Both have the
 * lowest row first. NAME.view has the view, 24 doubles: eye, world_to_clip, viewport, tolerance, and two zeros. */
#include <errno.h>
#include <kimberlite.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <GL/osmesa.h>

#include "city_scene.h"
#include "meter.h"
#include "picture.h"

struct options {
    const char *city, *terrain, *out, *shaders;
    int frames, width, height, every, threads, plain, meter, raw;
    double tolerance;
    uint64_t budget_us, budget_bytes, blocks;
    int background[3];
};

struct summary {
    double drawn, partial, update_us, update_us_max;
    uint64_t loaded, dropped, awaited, failed;
    long frames, pictures;
};

struct flight {
    struct options options;
    struct scene scene;
    OSMesaContext context;
    unsigned char *pixels;
    struct summary summary;
};

static int read_options(int count, char **words, struct options *options)
{
    *options = (struct options){.out = ".", .shaders = KMB_SHADERS, .frames = 120, .width = 1280, .height = 1024, .every = 10,
                                .tolerance = 1, .budget_us = KMB_UNLIMITED, .budget_bytes = KMB_UNLIMITED,
                                .blocks = KMB_UNLIMITED, .background = {150, 190, 235}};
    for (int i = 1; i < count; i++) {
        const char *name = words[i], *value = i + 1 < count ? words[i + 1] : "";
        int *colour = options->background, used = 1;
        if (!strcmp(name, "--plain")) options->plain = 1, used = 0;
        else if (!strcmp(name, "--meter")) options->meter = 1, used = 0;
        else if (!strcmp(name, "--raw")) options->raw = 1, used = 0;
        else if (!strcmp(name, "--terrain")) options->terrain = value;
        else if (!strcmp(name, "--shaders")) options->shaders = value;
        else if (!strcmp(name, "--threads")) options->threads = atoi(value);
        else if (!strcmp(name, "--frames")) options->frames = atoi(value);
        else if (!strcmp(name, "--every")) options->every = atoi(value);
        else if (!strcmp(name, "--tolerance")) options->tolerance = atof(value);
        else if (!strcmp(name, "--budget-us")) options->budget_us = strtoull(value, NULL, 10);
        else if (!strcmp(name, "--budget-mib")) options->budget_bytes = strtoull(value, NULL, 10) << 20;
        else if (!strcmp(name, "--blocks")) options->blocks = strtoull(value, NULL, 10);
        else if (!strcmp(name, "--out")) options->out = value;
        else if (!strcmp(name, "--size") && sscanf(value, "%dx%d", &options->width, &options->height) == 2) {}
        else if (!strcmp(name, "--background") && sscanf(value, "%d,%d,%d", colour, colour + 1, colour + 2) == 3) {}
        else if (name[0] != '-' && !options->city) options->city = name, used = 0;
        else return 1;
        i += used;
    }
    return !options->city || options->frames < 1 || options->width < 1 || options->height < 1 || options->every < 1
        || options->threads < 0;
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
    if (scene_prepare(&flight->scene, options->shaders)) return 1;
    flight->scene.city_drawing.occlusion = !options->plain;
    return 0;
}

static int write_bytes(const struct flight *flight, const char *name, const char *ending, const void *bytes, size_t length)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.%s", flight->options.out, name, ending);
    FILE *file = fopen(path, "wb");
    int failed = !file || fwrite(bytes, 1, length, file) != length;
    if (file && fclose(file) != 0) failed = 1;
    if (failed) fprintf(stderr, "%s: %s\n", path, strerror(errno));
    return failed;
}

static int write_raw(const struct flight *flight, const char *name, const kmb_view *view)
{
    const struct options *options = &flight->options;
    size_t count = (size_t)options->width * (size_t)options->height;
    double numbers[24] = {0};
    float *depths = malloc(count * sizeof *depths);
    if (!depths) return 1;
    memcpy(numbers, view->eye, sizeof view->eye);
    memcpy(numbers + 3, view->world_to_clip, sizeof view->world_to_clip);
    memcpy(numbers + 19, view->viewport, sizeof view->viewport);
    numbers[21] = view->tolerance;
    glReadPixels(0, 0, options->width, options->height, GL_DEPTH_COMPONENT, GL_FLOAT, depths);
    int failed = write_bytes(flight, name, "rgba", flight->pixels, 4 * count)
        || write_bytes(flight, name, "depth", depths, count * sizeof *depths)
        || write_bytes(flight, name, "view", numbers, sizeof numbers);
    free(depths);
    return failed;
}

static void count(struct summary *summary, const struct scene_stats *stats)
{
    double update = stats->terrain.microseconds + stats->city.microseconds;
    summary->frames++;
    summary->drawn += (double)stats->city.drawn;
    summary->partial += (double)stats->city.partial;
    summary->update_us += update;
    if (update > summary->update_us_max) summary->update_us_max = update;
    summary->loaded += stats->city.loaded;
    summary->dropped += stats->city.dropped;
    summary->awaited += stats->city.awaited;
    summary->failed = stats->city.failed;
}

static int show(struct flight *flight, int frame)
{
    const struct options *options = &flight->options;
    struct camera camera = ring_camera(&flight->scene, frame, options->frames);
    kmb_view view = view_of(&camera, &flight->scene.extent, options->width, options->height, options->tolerance);
    kmb_budget budget = {.struct_size = sizeof budget, .microseconds = options->budget_us, .refinements = options->blocks,
                         .bytes = options->budget_bytes, .upload_bytes = KMB_UNLIMITED, .patches = KMB_UNLIMITED};
    struct scene_stats stats;
    char name[64], path[4096];
    if (scene_draw(&flight->scene, &view, &budget, options->background, &stats)) return 1;
    glFinish();
    count(&flight->summary, &stats);
    if (frame % options->every != 0 && frame != options->frames - 1) return 0;
    snprintf(name, sizeof name, "city_%04d", frame);
    if (options->raw && write_raw(flight, name, &view)) return 1;
    if (options->meter) {
        kmb_stats used = scene_used(&stats);
        meter_draw(&used, &budget, options->width, options->height);
        glFinish();
    }
    snprintf(path, sizeof path, "%s/%s.png", options->out, name);
    flight->summary.pictures++;
    return picture_write(path, options->width, options->height, flight->pixels);
}

static int report(const struct flight *flight)
{
    const struct summary *summary = &flight->summary;
    const kmb_city_info *info = &flight->scene.info;
    double frames = (double)summary->frames;
    char path[4096];
    snprintf(path, sizeof path, "%s/summary.json", flight->options.out);
    FILE *file = fopen(path, "w");
    if (!file) {
        fprintf(stderr, "%s: %s\n", path, strerror(errno));
        return 1;
    }
    fprintf(file,
            "{\"frames\": %ld, \"pictures\": %ld, \"blocks\": %u, \"leaves\": %u, \"drawn_mean\": %.1f, \"partial_mean\": %.1f,\n"
            " \"update_us_mean\": %.1f, \"update_us_max\": %.1f,\n"
            " \"blocks_loaded\": %llu, \"blocks_dropped\": %llu, \"awaited_mean\": %.1f, \"blocks_failed\": %llu}\n",
            summary->frames, summary->pictures, info->nodes, info->leaves, summary->drawn / frames, summary->partial / frames,
            summary->update_us / frames, summary->update_us_max, (unsigned long long)summary->loaded,
            (unsigned long long)summary->dropped, (double)summary->awaited / frames, (unsigned long long)summary->failed);
    int failed = fclose(file) != 0;
    printf("%ld frames, %.1f of %u blocks drawn, update %.0f us (most %.0f us): %s\n", summary->frames,
           summary->drawn / frames, info->nodes, summary->update_us / frames, summary->update_us_max, path);
    return failed || summary->failed > 0;
}

int main(int count, char **words)
{
    static struct flight flight;
    struct options *options = &flight.options;
    if (read_options(count, words, options)) {
        fprintf(stderr, "usage: city CITY.kmb [--terrain FILE.kmb] [--frames N] [--size WxH] [--tolerance PX] [--budget-us N]"
                        " [--budget-mib N] [--blocks N] [--threads N] [--out DIR] [--every K] [--plain] [--meter] [--raw]"
                        " [--background R,G,B] [--shaders DIR]\n");
        return 2;
    }
    int failed = scene_open(&flight.scene, options->city, options->terrain, (uint32_t)options->threads)
        || open_picture(&flight);
    for (int frame = 0; frame < options->frames && !failed; frame++) failed = show(&flight, frame);
    failed = failed || report(&flight);
    scene_close(&flight.scene);
    if (flight.context) OSMesaDestroyContext(flight.context);
    free(flight.pixels);
    return failed;
}
