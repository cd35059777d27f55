/* Looks at a repository in a window: GLFW and OpenGL 3.3. The title tells the time of a frame and the triangles drawn.
 *
 * viewer FILE.kmb [--colour FILE.kmb] [--tolerance PX] [--screenshot FILE.png] [--frames N]
 *
 * drag with the left button: look around      drag with the right button: go round what lies ahead
 * W A S D: move, Q E: down and up             wheel: speed
 * F: wire frame    L: colour by level         P: freeze the cut
 * C: the colours of --colour, or by height
 * B: bars of the time and bytes of a frame, and of the diamonds that threads are asked for
 * + -: tolerance   Escape: quit
 *
 * --frames N flies N frames by itself and quits; --screenshot FILE writes the last of them. */
#include <kimberlite.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GL_GLEXT_PROTOTYPES
#include <GLFW/glfw3.h>

#include "camera.h"
#include "drawing.h"
#include "meter.h"
#include "picture.h"

static const int SKY[3] = {166, 196, 226};

struct viewer {
    const char *file, *colour, *screenshot;
    long frames;
    double tolerance;
    GLFWwindow *window;
    kmb_repository *repository, *colours;
    kmb_query *query;
    kmb_cut *cut;
    struct terrain terrain;
    struct drawing drawing;
    struct camera camera;
    double heading, pitch; /* radians; heading from east to north */
    double speed;          /* world units a second */
    double cursor[2];
    int frozen, metered;
};

static struct viewer *viewer_of(GLFWwindow *window) { return glfwGetWindowUserPointer(window); }

static int library_error(void)
{
    fprintf(stderr, "%s\n", kmb_last_error());
    return 1;
}

static void direction(const struct viewer *viewer, double out[3])
{
    out[0] = cos(viewer->pitch) * cos(viewer->heading);
    out[1] = cos(viewer->pitch) * sin(viewer->heading);
    out[2] = sin(viewer->pitch);
}

/* Takes heading and pitch from a camera that looks at its target. */
static void take_direction(struct viewer *viewer)
{
    const double *eye = viewer->camera.eye, *target = viewer->camera.target;
    double x = target[0] - eye[0], y = target[1] - eye[1];
    viewer->heading = atan2(y, x);
    viewer->pitch = atan2(target[2] - eye[2], hypot(x, y));
}

static void turn(struct viewer *viewer, double dx, double dy)
{
    viewer->heading += 0.004 * dx;
    viewer->pitch = fmax(-1.55, fmin(1.55, viewer->pitch + 0.004 * dy));
}

/* Where the ray ahead meets the lowest ground, or a point at the terrain's size ahead. */
static double distance_ahead(const struct viewer *viewer, const double forward[3])
{
    double size = viewer->terrain.high[0] - viewer->terrain.low[0];
    double drop = viewer->camera.eye[2] - viewer->terrain.low[2];
    return forward[2] < -0.01 && drop > 0 ? fmin(drop / -forward[2], size) : size;
}

static void on_cursor(GLFWwindow *window, double x, double y)
{
    struct viewer *viewer = viewer_of(window);
    double dx = x - viewer->cursor[0], dy = y - viewer->cursor[1], forward[3];
    viewer->cursor[0] = x;
    viewer->cursor[1] = y;
    if (glfwGetMouseButton(window, GLFW_MOUSE_BUTTON_LEFT)) turn(viewer, dx, dy);
    if (glfwGetMouseButton(window, GLFW_MOUSE_BUTTON_RIGHT)) {
        direction(viewer, forward);
        double distance = distance_ahead(viewer, forward);
        for (int axis = 0; axis < 3; axis++) viewer->camera.eye[axis] += distance * forward[axis];
        turn(viewer, -dx, -dy);
        direction(viewer, forward);
        for (int axis = 0; axis < 3; axis++) viewer->camera.eye[axis] -= distance * forward[axis];
    }
}

static void on_wheel(GLFWwindow *window, double x, double y)
{
    (void)x;
    viewer_of(window)->speed *= pow(1.2, y);
}

static void on_key(GLFWwindow *window, int key, int code, int action, int modifiers)
{
    struct viewer *viewer = viewer_of(window);
    (void)code, (void)modifiers;
    if (action != GLFW_PRESS) return;
    if (key == GLFW_KEY_ESCAPE) glfwSetWindowShouldClose(window, 1);
    if (key == GLFW_KEY_F) viewer->drawing.wireframe ^= 1;
    if (key == GLFW_KEY_L) viewer->drawing.by_level ^= 1;
    if (key == GLFW_KEY_C) viewer->drawing.plain ^= 1;
    if (key == GLFW_KEY_B) viewer->metered ^= 1;
    if (key == GLFW_KEY_P) viewer->frozen ^= 1;
    if (key == GLFW_KEY_EQUAL || key == GLFW_KEY_KP_ADD) viewer->tolerance *= 1.25;
    if (key == GLFW_KEY_MINUS || key == GLFW_KEY_KP_SUBTRACT) viewer->tolerance /= 1.25;
}

static int held(const struct viewer *viewer, int key) { return glfwGetKey(viewer->window, key) == GLFW_PRESS; }

static void move(struct viewer *viewer, double seconds)
{
    double forward[3], *eye = viewer->camera.eye, step = viewer->speed * seconds;
    direction(viewer, forward);
    double ahead = held(viewer, GLFW_KEY_W) - held(viewer, GLFW_KEY_S);
    double right = held(viewer, GLFW_KEY_D) - held(viewer, GLFW_KEY_A);
    double up = held(viewer, GLFW_KEY_E) - held(viewer, GLFW_KEY_Q);
    eye[0] += step * (ahead * forward[0] + right * sin(viewer->heading));
    eye[1] += step * (ahead * forward[1] - right * cos(viewer->heading));
    eye[2] += step * (ahead * forward[2] + up);
    double floor = ground(&viewer->terrain, eye[0], eye[1], viewer->terrain.low[2]);
    eye[2] = fmax(eye[2], floor + 0.002 * (viewer->terrain.high[0] - viewer->terrain.low[0]));
    for (int axis = 0; axis < 3; axis++)
        viewer->camera.target[axis] = eye[axis] + forward[axis] * distance_ahead(viewer, forward);
}

static int open_terrain(struct viewer *viewer)
{
    kmb_repository_info info = {.struct_size = sizeof info};
    if (viewer->colour && kmb_repository_open(viewer->colour, NULL, &viewer->colours) != KMB_OK) return library_error();
    /* One thread decodes, so that no frame waits for it. */
    kmb_cut_options cut = {.struct_size = sizeof cut, .vertex_form = KMB_VERTEX_EXPANDED,
                           .metric = KMB_METRIC_GEOMETRIC, .threads = 1, .colours = viewer->colours};
    if (kmb_repository_open(viewer->file, NULL, &viewer->repository) != KMB_OK
        || kmb_repository_describe(viewer->repository, &info) != KMB_OK
        || kmb_query_create(viewer->repository, 64 << 20, &viewer->query) != KMB_OK
        || kmb_cut_create(viewer->repository, &cut, &viewer->cut) != KMB_OK) {
        return library_error();
    }
    viewer->terrain = terrain_of(&info, viewer->query);
    viewer->camera = flight_camera(&viewer->terrain, 0, 2);
    viewer->speed = 0.1 * (viewer->terrain.high[0] - viewer->terrain.low[0]);
    take_direction(viewer);
    return 0;
}

static int open_window(struct viewer *viewer)
{
    if (!glfwInit()) {
        fprintf(stderr, "there is no display\n");
        return 1;
    }
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
    viewer->window = glfwCreateWindow(1280, 800, viewer->file, NULL, NULL);
    if (!viewer->window) {
        fprintf(stderr, "there is no window with OpenGL 3.3\n");
        return 1;
    }
    glfwMakeContextCurrent(viewer->window);
    glfwSwapInterval(1);
    glfwSetWindowUserPointer(viewer->window, viewer);
    glfwSetCursorPosCallback(viewer->window, on_cursor);
    glfwSetScrollCallback(viewer->window, on_wheel);
    glfwSetKeyCallback(viewer->window, on_key);
    return drawing_create(&viewer->drawing, viewer->cut, viewer->terrain.low[2], viewer->terrain.high[2]);
}

static int take_picture(const struct viewer *viewer, int width, int height)
{
    unsigned char *pixels = malloc((size_t)width * (size_t)height * 4);
    if (!pixels) return 1;
    glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, pixels);
    int failed = picture_write(viewer->screenshot, width, height, pixels);
    free(pixels);
    return failed;
}

static int show_frame(struct viewer *viewer, kmb_stats *stats, int last)
{
    int width, height;
    glfwGetFramebufferSize(viewer->window, &width, &height);
    if (width < 1 || height < 1) return 0;
    kmb_view view = view_of(&viewer->camera, &viewer->terrain, width, height, viewer->tolerance);
    /* 8 ms leave the rest of a 60th of a second to the drawing. */
    kmb_budget budget = {.struct_size = sizeof budget, .microseconds = 8000,
                         .refinements = viewer->frozen ? 0 : KMB_UNLIMITED, .bytes = 512 << 20,
                         .upload_bytes = 32 << 20, .patches = KMB_UNLIMITED};
    if (kmb_cut_update(viewer->cut, &view, &budget, stats) != KMB_OK
        || drawing_update(&viewer->drawing, viewer->cut) != KMB_OK
        || drawing_draw(&viewer->drawing, viewer->cut, &view, SKY) != KMB_OK) {
        return library_error();
    }
    if (viewer->metered) meter_draw(stats, &budget, width, height);
    if (last && viewer->screenshot && take_picture(viewer, width, height)) return 1;
    glfwSwapBuffers(viewer->window);
    return 0;
}

static int run(struct viewer *viewer)
{
    double before = glfwGetTime(), told = before, milliseconds = 0;
    for (long frame = 0; !glfwWindowShouldClose(viewer->window); frame++) {
        kmb_stats stats = {.struct_size = sizeof stats};
        int last = viewer->frames > 0 && frame + 1 == viewer->frames;
        glfwPollEvents();
        double now = glfwGetTime();
        if (viewer->frames > 0) viewer->camera = flight_camera(&viewer->terrain, (int)frame, (int)viewer->frames);
        else move(viewer, now - before);
        if (show_frame(viewer, &stats, last)) return 1;
        milliseconds += 0.1 * (1e3 * (now - before) - milliseconds);
        before = now;
        if (now - told > 0.25 || last) {
            char title[256];
            snprintf(title, sizeof title, "%s - %.1f ms a frame, %llu triangles in %llu patches, tolerance %.2f px",
                     viewer->file, milliseconds, (unsigned long long)stats.triangles,
                     (unsigned long long)stats.patches, viewer->tolerance);
            glfwSetWindowTitle(viewer->window, title);
            told = now;
        }
        if (last) {
            printf("%ld frames, %llu triangles in the last\n", viewer->frames, (unsigned long long)stats.triangles);
            return 0;
        }
    }
    return 0;
}

static int read_options(int count, char **words, struct viewer *viewer)
{
    viewer->tolerance = 1;
    viewer->metered = 1;
    for (int i = 1; i < count; i++) {
        const char *value = i + 1 < count ? words[i + 1] : "";
        if (words[i][0] != '-' && !viewer->file) viewer->file = words[i];
        else if (!strcmp(words[i], "--colour")) viewer->colour = value, i++;
        else if (!strcmp(words[i], "--tolerance")) viewer->tolerance = atof(value), i++;
        else if (!strcmp(words[i], "--frames")) viewer->frames = atol(value), i++;
        else if (!strcmp(words[i], "--screenshot")) viewer->screenshot = value, i++;
        else return 1;
    }
    return !viewer->file;
}

int main(int count, char **words)
{
    static struct viewer viewer;
    if (read_options(count, words, &viewer)) {
        fprintf(stderr, "usage: viewer FILE.kmb [--colour FILE.kmb] [--tolerance PX] [--screenshot FILE.png] [--frames N]\n");
        return 2;
    }
    int failed = open_terrain(&viewer) || open_window(&viewer) || run(&viewer);
    if (viewer.drawing.program) drawing_destroy(&viewer.drawing);
    glfwTerminate();
    kmb_cut_destroy(viewer.cut);
    kmb_query_destroy(viewer.query);
    kmb_repository_close(viewer.repository);
    kmb_repository_close(viewer.colours);
    return failed;
}
