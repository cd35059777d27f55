#include "drawing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define GL_GLEXT_PROTOTYPES
#include <GL/gl.h>
#include <GL/glext.h>

#include "camera.h"

/* The patch's offset is added while all are integers, exact in floats; then comes one matrix for the whole frame. So a vertex that
 * patches share gets the same bits from each, and no pixel falls through between them. */
static const char *const VERTEX_SHADER =
    "#version 330 core\n"
    "layout(location = 0) in vec3 position;\n"
    "layout(location = 1) in vec3 normal;\n"
    "uniform mat4 clip_from_grid;\n"
    "uniform vec3 patch_offset;\n"
    "uniform vec2 height_to_colour;\n"
    "uniform float patch_base;\n"
    "uniform vec2 texture_origin;\n"
    "uniform mat2 texture_from_position;\n"
    "invariant gl_Position;\n"
    "out vec3 world_normal;\n"
    "out float relative_height;\n"
    "out vec2 texel;\n"
    "void main() {\n"
    "    texel = texture_origin + texture_from_position * position.xy;\n"
    "    gl_Position = clip_from_grid * vec4(position + patch_offset, 1.0);\n"
    "    world_normal = normal;\n"
    "    relative_height = height_to_colour.x + height_to_colour.y * (position.z + patch_base);\n"
    "}\n";

static const char *const FRAGMENT_SHADER =
    "#version 330 core\n"
    "in vec3 world_normal;\n"
    "in float relative_height;\n"
    "in vec2 texel;\n"
    "uniform int level;\n"
    "uniform bool has_colours;\n"
    "uniform sampler2D colours;\n"
    "uniform float sea_level;\n"
    "out vec4 colour;\n"
    "const vec3 ramp[6] = vec3[6](vec3(0.24, 0.42, 0.26), vec3(0.47, 0.58, 0.31), vec3(0.76, 0.72, 0.47),\n"
    "                             vec3(0.66, 0.51, 0.36), vec3(0.55, 0.50, 0.48), vec3(0.97, 0.97, 0.98));\n"
    "void main() {\n"
    "    float place = pow(clamp(relative_height, 0.0, 1.0), 0.7) * 5.0;\n"
    "    int step_below = min(int(place), 4);\n"
    "    vec3 base = mix(ramp[step_below], ramp[step_below + 1], place - float(step_below));\n"
    "    if (relative_height < sea_level) base = vec3(0.25, 0.42, 0.58);\n"
    "    if (has_colours) base = texture(colours, texel).rgb;\n"
    "    if (level >= 0) base = 0.55 + 0.4 * cos(vec3(0.0, 2.1, 4.2) + 2.4 * float(level));\n"
    "    vec3 sun = normalize(vec3(-0.55, 0.45, 0.7));\n"
    "    float light = 0.32 + 0.78 * max(dot(normalize(world_normal), sun), 0.0);\n"
    "    colour = vec4(base * light, 1.0);\n"
    "}\n";

struct patch_buffer {
    uint64_t handle;
    struct patch_buffer *next;
    GLuint array, vertices, indices, texture; /* `indices` is 0 where the shared ones are used, `texture` without colours */
    GLsizei index_count;
    uint32_t level;
    double origin[3];
    float texture_origin[2], texture_from_position[4]; /* the latter column by column */
};

static GLuint compile(GLenum kind, const char *text)
{
    GLuint shader = glCreateShader(kind);
    GLint compiled = 0;
    glShaderSource(shader, 1, &text, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (!compiled) {
        char log[1024];
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        fprintf(stderr, "shader: %s\n", log);
    }
    return shader;
}

static int make_program(struct drawing *drawing)
{
    GLuint vertex = compile(GL_VERTEX_SHADER, VERTEX_SHADER);
    GLuint fragment = compile(GL_FRAGMENT_SHADER, FRAGMENT_SHADER);
    GLint linked = 0;
    drawing->program = glCreateProgram();
    glAttachShader(drawing->program, vertex);
    glAttachShader(drawing->program, fragment);
    glLinkProgram(drawing->program);
    glGetProgramiv(drawing->program, GL_LINK_STATUS, &linked);
    glDeleteShader(vertex);
    glDeleteShader(fragment);
    return !linked;
}

int drawing_create(struct drawing *drawing, const kmb_cut *cut, double low, double high)
{
    const uint16_t *indices;
    size_t count;
    *drawing = (struct drawing){.map = {.struct_size = sizeof drawing->map}};
    if (kmb_cut_triangle_list(cut, &indices, &count) != KMB_OK
        || kmb_cut_grid_to_world(cut, &drawing->map) != KMB_OK) {
        fprintf(stderr, "%s\n", kmb_last_error());
        return 1;
    }
    if (make_program(drawing)) return 1;
    drawing->shared_count = (int)count;
    /* An element buffer belongs to the vertex array that is bound, so it is filled under another target. */
    glGenBuffers(1, &drawing->shared_indices);
    glBindBuffer(GL_ARRAY_BUFFER, drawing->shared_indices);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(count * sizeof *indices), indices, GL_STATIC_DRAW);

    double range = high > low ? high - low : 1;
    glUseProgram(drawing->program);
    glUniform2f(glGetUniformLocation(drawing->program, "height_to_colour"),
                (float)((drawing->map.origin[2] - low) / range), (float)(drawing->map.step[2] / range));
    /* Where the lowest height is 0, what lies on it is taken for the sea. */
    glUniform1f(glGetUniformLocation(drawing->program, "sea_level"), low == 0 ? 4e-4f : -1.0f);
    return 0;
}

static struct patch_buffer **place_of(struct drawing *drawing, uint64_t handle)
{
    struct patch_buffer **place = &drawing->buckets[handle % BUCKETS];
    while (*place && (*place)->handle != handle) place = &(*place)->next;
    return place;
}

static const struct patch_buffer *buffer_of(const struct drawing *drawing, uint64_t handle)
{
    const struct patch_buffer *buffer = drawing->buckets[handle % BUCKETS];
    while (buffer && buffer->handle != handle) buffer = buffer->next;
    return buffer;
}

static void drop(struct patch_buffer **place)
{
    struct patch_buffer *buffer = *place;
    if (!buffer) return;
    *place = buffer->next;
    glDeleteVertexArrays(1, &buffer->array);
    glDeleteBuffers(1, &buffer->vertices);
    if (buffer->indices) glDeleteBuffers(1, &buffer->indices);
    if (buffer->texture) glDeleteTextures(1, &buffer->texture);
    free(buffer);
}

/* The texture, and the map to its coordinates from positions: the ends of both legs have those of texture_corners. */
static void upload_texture(struct patch_buffer *buffer, const kmb_patch_info *info)
{
    const float (*corners)[2] = info->texture_corners, (*legs)[2] = info->legs;
    GLsizei side = (GLsizei)info->texture_side;
    double vertices = (double)info->vertex_floats / 6, cells = (sqrt(8 * vertices + 1) - 3) / 2;
    double area = cells * ((double)legs[0][0] * legs[1][1] - (double)legs[0][1] * legs[1][0]);
    for (int axis = 0; axis < 2; axis++) {
        double along[2] = {corners[1][axis] - corners[0][axis], corners[2][axis] - corners[0][axis]};
        buffer->texture_origin[axis] = corners[0][axis];
        buffer->texture_from_position[axis] = (float)((along[0] * legs[1][1] - along[1] * legs[0][1]) / area);
        buffer->texture_from_position[2 + axis] = (float)((along[1] * legs[0][0] - along[0] * legs[1][0]) / area);
    }
    glGenTextures(1, &buffer->texture);
    glBindTexture(GL_TEXTURE_2D, buffer->texture);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB8, side, side, 0, GL_RGB, GL_UNSIGNED_BYTE, info->colours);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

static void upload(struct drawing *drawing, const kmb_patch_info *info)
{
    struct patch_buffer *buffer = calloc(1, sizeof *buffer);
    if (!buffer) abort();
    buffer->handle = info->handle;
    buffer->level = info->level;
    buffer->index_count = info->complete ? drawing->shared_count : (GLsizei)info->index_count;
    for (int axis = 0; axis < 3; axis++) buffer->origin[axis] = info->origin[axis];

    glGenVertexArrays(1, &buffer->array);
    glBindVertexArray(buffer->array);
    glGenBuffers(1, &buffer->vertices);
    glBindBuffer(GL_ARRAY_BUFFER, buffer->vertices);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(info->vertex_floats * sizeof(float)), info->vertices, GL_STATIC_DRAW);
    for (GLuint attribute = 0; attribute < 2; attribute++) {
        const GLvoid *offset = (const GLvoid *)(attribute * 3 * sizeof(float));
        glVertexAttribPointer(attribute, 3, GL_FLOAT, GL_FALSE, 6 * sizeof(float), offset);
        glEnableVertexAttribArray(attribute);
    }
    if (info->complete) {
        glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, drawing->shared_indices);
    } else {
        glGenBuffers(1, &buffer->indices);
        glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffer->indices);
        glBufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)(info->index_count * sizeof *info->indices), info->indices,
                     GL_STATIC_DRAW);
    }
    glBindVertexArray(0);
    if (info->texture_side) upload_texture(buffer, info);

    struct patch_buffer **place = place_of(drawing, buffer->handle);
    buffer->next = *place;
    *place = buffer;
}

kmb_status drawing_update(struct drawing *drawing, kmb_cut *cut)
{
    const kmb_patch *const *added;
    const uint64_t *removed;
    size_t added_count, removed_count;
    kmb_status status = kmb_cut_changes(cut, &added, &added_count, &removed, &removed_count);
    if (status != KMB_OK) return status;
    for (size_t i = 0; i < removed_count; i++) drop(place_of(drawing, removed[i]));
    for (size_t i = 0; i < added_count; i++) {
        kmb_patch_info info = {.struct_size = sizeof info};
        status = kmb_patch_describe(added[i], &info);
        if (status != KMB_OK) return status;
        upload(drawing, &info);
    }
    return KMB_OK;
}

/* A grid position of integers near the eye, so that what is near the eye is small and exact in floats. */
static void choose_anchor(const struct drawing *drawing, const kmb_view *view, double base, double anchor[3])
{
    for (int axis = 0; axis < 2; axis++)
        anchor[axis] = rint((view->eye[axis] - drawing->map.origin[axis]) / drawing->map.step[axis]);
    anchor[2] = base;
}

kmb_status drawing_draw(const struct drawing *drawing, const kmb_cut *cut, const kmb_view *view, const int background[3])
{
    const kmb_patch *const *patches;
    size_t count;
    double anchor[3];
    float matrix[16];
    kmb_status status = kmb_cut_patches(cut, &patches, &count);
    if (status != KMB_OK) return status;

    glViewport(0, 0, (GLsizei)view->viewport[0], (GLsizei)view->viewport[1]);
    glClearColor(background[0] / 255.0f, background[1] / 255.0f, background[2] / 255.0f, 1.0f);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glEnable(GL_DEPTH_TEST);
    glPolygonMode(GL_FRONT_AND_BACK, drawing->wireframe ? GL_LINE : GL_FILL);
    glUseProgram(drawing->program);
    GLint offset = glGetUniformLocation(drawing->program, "patch_offset");
    GLint base = glGetUniformLocation(drawing->program, "patch_base");
    GLint level = glGetUniformLocation(drawing->program, "level");
    GLint has_colours = glGetUniformLocation(drawing->program, "has_colours");
    GLint texture_origin = glGetUniformLocation(drawing->program, "texture_origin");
    GLint texture_from_position = glGetUniformLocation(drawing->program, "texture_from_position");
    for (size_t i = 0; i < count; i++) {
        kmb_patch_info info = {.struct_size = sizeof info};
        status = kmb_patch_describe(patches[i], &info);
        if (status != KMB_OK) return status;
        const struct patch_buffer *buffer = buffer_of(drawing, info.handle);
        if (!buffer) continue;
        if (i == 0) {
            choose_anchor(drawing, view, buffer->origin[2], anchor);
            clip_from_grid(view->world_to_clip, &drawing->map, anchor, matrix);
            glUniformMatrix4fv(glGetUniformLocation(drawing->program, "clip_from_grid"), 1, GL_FALSE, matrix);
        }
        glUniform3f(offset, (float)(buffer->origin[0] - anchor[0]), (float)(buffer->origin[1] - anchor[1]),
                    (float)(buffer->origin[2] - anchor[2]));
        glUniform1f(base, (float)buffer->origin[2]);
        glUniform1i(level, drawing->by_level ? (GLint)buffer->level : -1);
        glUniform1i(has_colours, buffer->texture && !drawing->plain);
        glUniform2fv(texture_origin, 1, buffer->texture_origin);
        glUniformMatrix2fv(texture_from_position, 1, GL_FALSE, buffer->texture_from_position);
        glBindTexture(GL_TEXTURE_2D, buffer->texture);
        glBindVertexArray(buffer->array);
        glDrawElements(GL_TRIANGLES, buffer->index_count, GL_UNSIGNED_SHORT, NULL);
    }
    glBindVertexArray(0);
    return KMB_OK;
}

void drawing_destroy(struct drawing *drawing)
{
    for (int i = 0; i < BUCKETS; i++)
        while (drawing->buckets[i]) drop(&drawing->buckets[i]);
    glDeleteBuffers(1, &drawing->shared_indices);
    glDeleteProgram(drawing->program);
}
