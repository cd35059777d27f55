/* Goes round a city in a window: GLFW and OpenGL 3.3. The title tells the time of a frame and the blocks drawn.
 *
 * city_window CITY.kmb [--terrain FILE.kmb] [--tolerance PX] [--screenshot FILE.png] [--frames N] [--shaders DIR]
 *
 * drag with a button or left, right, up, down: go round, and higher or lower      wheel, or W and S: nearer, farther
 * O: ambient occlusion                                                          P: freeze what is drawn
 * B: bars of the time and bytes of a frame, and of what threads are asked for     + -: tolerance   Escape: quit
 *
 * --terrain FILE draws a terrain under the city. --frames N flies N frames of a ring by itself and quits; --screenshot FILE writes the last of
 * them. */
#include <kimberlite.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GL_GLEXT_PROTOTYPES
#include <GLFW/glfw3.h>

#include "city_scene.h"
#include "meter.h"
#include "picture.h"

static const int SKY[3] = {150, 190, 235};

struct window {
    const char *city, *terrain, *screenshot, *shaders;
    long frames;
    double tolerance;
    GLFWwindow *handle;
    struct scene scene;
    double turn, rise; /* radians: around the city, and above the horizon */
    double distance;   /* from the eye to the city's middle, in sides of the city */
    double cursor[2];
    int frozen, metered;
};

static struct window *window_of(GLFWwindow *handle) { return glfwGetWindowUserPointer(handle); }

static void go_round(struct window *window, double turn, double rise)
{
    window->turn += turn;
    window->rise = fmax(0.02, fmin(1.5, window->rise + rise));
}

static void on_cursor(GLFWwindow *handle, double x, double y)
{
    struct window *window = window_of(handle);
    double dx = x - window->cursor[0], dy = y - window->cursor[1];
    window->cursor[0] = x;
    window->cursor[1] = y;
    if (glfwGetMouseButton(handle, GLFW_MOUSE_BUTTON_LEFT) || glfwGetMouseButton(handle, GLFW_MOUSE_BUTTON_RIGHT))
        go_round(window, -0.004 * dx, 0.004 * dy);
}

static void on_wheel(GLFWwindow *handle, double x, double y)
{
    (void)x;
    window_of(handle)->distance *= pow(0.9, y);
}

static void on_key(GLFWwindow *handle, int key, int code, int action, int modifiers)
{
    struct window *window = window_of(handle);
    (void)code, (void)modifiers;
    if (action != GLFW_PRESS) return;
    if (key == GLFW_KEY_ESCAPE) glfwSetWindowShouldClose(handle, 1);
    if (key == GLFW_KEY_O) window->scene.city_drawing.occlusion ^= 1;
    if (key == GLFW_KEY_B) window->metered ^= 1;
    if (key == GLFW_KEY_P) window->frozen ^= 1;
    if (key == GLFW_KEY_EQUAL || key == GLFW_KEY_KP_ADD) window->tolerance *= 1.25;
    if (key == GLFW_KEY_MINUS || key == GLFW_KEY_KP_SUBTRACT) window->tolerance /= 1.25;
}

static int held(const struct window *window, int key) { return glfwGetKey(window->handle, key) == GLFW_PRESS; }

static struct camera moved(struct window *window, double seconds)
{
    const kmb_city_info *info = &window->scene.info;
    struct camera camera;
    go_round(window, seconds * (held(window, GLFW_KEY_RIGHT) - held(window, GLFW_KEY_LEFT)),
             seconds * (held(window, GLFW_KEY_UP) - held(window, GLFW_KEY_DOWN)));
    window->distance *= exp(seconds * (held(window, GLFW_KEY_S) - held(window, GLFW_KEY_W)));
    window->distance = fmax(0.02, fmin(5, window->distance));
    double far = window->distance * info->side;
    const double away[3] = {cos(window->rise) * cos(window->turn), cos(window->rise) * sin(window->turn), sin(window->rise)};
    for (int axis = 0; axis < 3; axis++) {
        camera.target[axis] = axis < 2 ? info->corner[axis] + 0.5 * info->side : info->heights[0];
        camera.eye[axis] = camera.target[axis] + far * away[axis];
    }
    return camera;
}

static int open_window(struct window *window)
{
    if (!glfwInit()) {
        fprintf(stderr, "there is no display\n");
        return 1;
    }
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
    window->handle = glfwCreateWindow(1280, 800, window->city, NULL, NULL);
    if (!window->handle) {
        fprintf(stderr, "there is no window with OpenGL 3.3\n");
        return 1;
    }
    glfwMakeContextCurrent(window->handle);
    glfwSwapInterval(1);
    glfwSetWindowUserPointer(window->handle, window);
    glfwSetCursorPosCallback(window->handle, on_cursor);
    glfwSetScrollCallback(window->handle, on_wheel);
    glfwSetKeyCallback(window->handle, on_key);
    return scene_prepare(&window->scene, window->shaders);
}

static int take_picture(const struct window *window, int width, int height)
{
    unsigned char *pixels = malloc((size_t)width * (size_t)height * 4);
    if (!pixels) return 1;
    glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, pixels);
    int failed = picture_write(window->screenshot, width, height, pixels);
    free(pixels);
    return failed;
}

static int show(struct window *window, const struct camera *camera, struct scene_stats *stats, int last)
{
    int width, height;
    glfwGetFramebufferSize(window->handle, &width, &height);
    if (width < 1 || height < 1) return 0;
    kmb_view view = view_of(camera, &window->scene.extent, width, height, window->tolerance);
    /* 8 ms leave the rest of a 60th of a second to the drawing. */
    kmb_budget budget = {.struct_size = sizeof budget, .microseconds = 8000,
                         .refinements = window->frozen ? 0 : KMB_UNLIMITED, .bytes = 512 << 20,
                         .upload_bytes = 32 << 20, .patches = KMB_UNLIMITED};
    if (scene_draw(&window->scene, &view, &budget, SKY, stats)) return 1;
    kmb_stats used = scene_used(stats);
    if (window->metered) meter_draw(&used, &budget, width, height);
    if (last && window->screenshot && take_picture(window, width, height)) return 1;
    glfwSwapBuffers(window->handle);
    return 0;
}

static int run(struct window *window)
{
    double before = glfwGetTime(), told = before, milliseconds = 0;
    for (long frame = 0; !glfwWindowShouldClose(window->handle); frame++) {
        struct scene_stats stats = {.city = {.struct_size = sizeof stats.city}};
        int last = window->frames > 0 && frame + 1 == window->frames;
        glfwPollEvents();
        double now = glfwGetTime();
        struct camera camera = window->frames > 0 ? ring_camera(&window->scene, (int)frame, (int)window->frames)
                                                  : moved(window, now - before);
        if (show(window, &camera, &stats, last)) return 1;
        milliseconds += 0.1 * (1e3 * (now - before) - milliseconds);
        before = now;
        if (now - told > 0.25 || last) {
            char title[256];
            snprintf(title, sizeof title, "%.150s - %.1f ms a frame, %llu of %u blocks, tolerance %.2f px", window->city,
                     milliseconds, (unsigned long long)stats.city.drawn, window->scene.info.nodes, window->tolerance);
            glfwSetWindowTitle(window->handle, title);
            told = now;
        }
        if (last) {
            printf("%ld frames, %llu blocks in the last\n", window->frames, (unsigned long long)stats.city.drawn);
            return 0;
        }
    }
    return 0;
}

static int read_options(int count, char **words, struct window *window)
{
    *window = (struct window){.shaders = KMB_SHADERS, .tolerance = 1, .metered = 1, .turn = -1.6, .rise = 0.5, .distance = 1};
    for (int i = 1; i < count; i++) {
        const char *value = i + 1 < count ? words[i + 1] : "";
        if (words[i][0] != '-' && !window->city) window->city = words[i];
        else if (!strcmp(words[i], "--terrain")) window->terrain = value, i++;
        else if (!strcmp(words[i], "--tolerance")) window->tolerance = atof(value), i++;
        else if (!strcmp(words[i], "--frames")) window->frames = atol(value), i++;
        else if (!strcmp(words[i], "--screenshot")) window->screenshot = value, i++;
        else if (!strcmp(words[i], "--shaders")) window->shaders = value, i++;
        else return 1;
    }
    return !window->city;
}

int main(int count, char **words)
{
    static struct window window;
    if (read_options(count, words, &window)) {
        fprintf(stderr, "usage: city_window CITY.kmb [--terrain FILE.kmb] [--tolerance PX] [--screenshot FILE.png] [--frames N]"
                        " [--shaders DIR]\n");
        return 2;
    }
    /* One thread decodes for each, so that no frame waits for it. */
    int failed = scene_open(&window.scene, window.city, window.terrain, 1) || open_window(&window) || run(&window);
    scene_close(&window.scene);
    glfwTerminate();
    return failed;
}
