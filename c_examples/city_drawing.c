#include "city_drawing.h"

#include <stdio.h>
#include <stdlib.h>

#define GL_GLEXT_PROTOTYPES
#include <GL/gl.h>
#include <GL/glext.h>

/* Sides of a block by which its box is larger on each side: rays are only looked for there, and none is to be lost. */
static const double MARGIN = 0.01;

struct block_texture {
    GLuint image, low_heights; /* the latter 0 for heights of 8 bits */
};

static char *text_of(const char *folder, const char *name)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "rb");
    char *text = calloc(1, 1 << 16);
    if (!file || !text || fread(text, 1, (1 << 16) - 1, file) == 0) fprintf(stderr, "%s: cannot be read\n", path);
    if (file) fclose(file);
    return text;
}

static GLuint compile(GLenum kind, const char *folder, const char *name)
{
    char *text = text_of(folder, name);
    const char *source = text ? text : "";
    GLuint shader = glCreateShader(kind);
    GLint compiled = 0;
    glShaderSource(shader, 1, &source, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (!compiled) {
        char log[1024];
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        fprintf(stderr, "%s: %s\n", name, log);
    }
    free(text);
    return shader;
}

static int make_program(struct city_drawing *drawing, const char *folder)
{
    GLuint vertex = compile(GL_VERTEX_SHADER, folder, "blockmap.vert");
    GLuint fragment = compile(GL_FRAGMENT_SHADER, folder, "blockmap.frag");
    GLint linked = 0;
    drawing->program = glCreateProgram();
    glAttachShader(drawing->program, vertex);
    glAttachShader(drawing->program, fragment);
    glBindAttribLocation(drawing->program, 0, "corner");
    glLinkProgram(drawing->program);
    glGetProgramiv(drawing->program, GL_LINK_STATUS, &linked);
    glDeleteShader(vertex);
    glDeleteShader(fragment);
    return !linked;
}

/* A box of 12 triangles, counterclockwise as seen from outside. */
static void make_box(struct city_drawing *drawing)
{
    static const GLubyte INDICES[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                        2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
    GLfloat corners[8][3];
    for (int corner = 0; corner < 8; corner++)
        for (int axis = 0; axis < 3; axis++) corners[corner][axis] = (GLfloat)(corner >> axis & 1);
    glGenVertexArrays(1, &drawing->array);
    glBindVertexArray(drawing->array);
    glGenBuffers(1, &drawing->corners);
    glBindBuffer(GL_ARRAY_BUFFER, drawing->corners);
    glBufferData(GL_ARRAY_BUFFER, sizeof corners, corners, GL_STATIC_DRAW);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    glEnableVertexAttribArray(0);
    glGenBuffers(1, &drawing->indices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, drawing->indices);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, sizeof INDICES, INDICES, GL_STATIC_DRAW);
    glBindVertexArray(0);
}

int city_drawing_create(struct city_drawing *drawing, const kmb_city *city, const char *shaders)
{
    kmb_city_info info = {.struct_size = sizeof info};
    *drawing = (struct city_drawing){.occlusion = 1};
    if (kmb_city_describe(city, &info) != KMB_OK) {
        fprintf(stderr, "%s\n", kmb_last_error());
        return 1;
    }
    drawing->nodes = info.nodes;
    drawing->floor = info.floor;
    drawing->textures = calloc(info.nodes, sizeof *drawing->textures);
    if (!drawing->textures || make_program(drawing, shaders)) return 1;
    make_box(drawing);
    return 0;
}

static GLuint texture_of(GLint form, GLenum channels, GLsizei width, GLsizei height, const void *texels)
{
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage2D(GL_TEXTURE_2D, 0, form, width, height, 0, channels, GL_UNSIGNED_BYTE, texels);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return texture;
}

static void drop(struct block_texture *texture)
{
    glDeleteTextures(1, &texture->image);
    glDeleteTextures(1, &texture->low_heights);
    *texture = (struct block_texture){0};
}

kmb_status city_drawing_update(struct city_drawing *drawing, const kmb_city_visit *visit)
{
    const uint32_t *added, *removed;
    size_t added_count, removed_count;
    kmb_status status = kmb_city_visit_added(visit, &added, &added_count);
    if (status == KMB_OK) status = kmb_city_visit_removed(visit, &removed, &removed_count);
    if (status != KMB_OK) return status;
    for (size_t i = 0; i < removed_count; i++) drop(drawing->textures + removed[i]);
    for (size_t i = 0; i < added_count; i++) {
        struct block_texture *texture = drawing->textures + added[i];
        kmb_blockmap block = {.struct_size = sizeof block};
        status = kmb_city_visit_block(visit, added[i], &block);
        if (status != KMB_OK) return status;
        GLsizei side = (GLsizei)block.side_texels;
        drop(texture);
        texture->image = texture_of(GL_RGBA8UI, GL_RGBA_INTEGER, 2 * side + 256, side, block.image);
        if (block.low_heights) texture->low_heights = texture_of(GL_R8UI, GL_RED_INTEGER, side, side, block.low_heights);
    }
    return KMB_OK;
}

/* Rays by pixel: direction = matrix * (x, y, 1), column by column, such that w grows by 1 along it. */
static void direction_from_pixel(const kmb_view *view, double matrix[9])
{
    const double *m = view->world_to_clip;
    double rows[3][3] = {{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[3], m[7], m[11]}}, columns[3][3], determinant = 0;
    for (int row = 0; row < 3; row++)
        for (int axis = 0; axis < 3; axis++) {
            const double *a = rows[(row + 1) % 3], *b = rows[(row + 2) % 3];
            int next = (axis + 1) % 3, last = (axis + 2) % 3;
            columns[row][axis] = a[next] * b[last] - a[last] * b[next];
        }
    for (int axis = 0; axis < 3; axis++) determinant += rows[0][axis] * columns[0][axis];
    for (int axis = 0; axis < 3; axis++) {
        double x = columns[0][axis] / determinant, y = columns[1][axis] / determinant;
        matrix[axis] = 2 * x / view->viewport[0];
        matrix[3 + axis] = 2 * y / view->viewport[1];
        matrix[6 + axis] = columns[2][axis] / determinant - x - y;
    }
}

kmb_ray city_ray(const kmb_view *view, double x, double y)
{
    kmb_ray ray = {.struct_size = sizeof ray, .longest = 1e30};
    double matrix[9];
    direction_from_pixel(view, matrix);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = view->eye[axis];
        ray.direction[axis] = matrix[axis] * x + matrix[3 + axis] * y + matrix[6 + axis];
    }
    return ray;
}

static GLint place_of(const struct city_drawing *drawing, const char *name) { return glGetUniformLocation(drawing->program, name); }

/* world_to_clip of a box with this corner and these edges, where it goes from 0 to 1: in doubles, for floats. */
static void draw_box(const struct city_drawing *drawing, const kmb_view *view, const double corner[3], const double edges[3])
{
    const double *m = view->world_to_clip;
    GLfloat matrix[16];
    for (int row = 0; row < 4; row++) {
        double origin = m[12 + row];
        for (int axis = 0; axis < 3; axis++) {
            origin += m[4 * axis + row] * corner[axis];
            matrix[4 * axis + row] = (GLfloat)(m[4 * axis + row] * edges[axis]);
        }
        matrix[12 + row] = (GLfloat)origin;
    }
    glUniformMatrix4fv(place_of(drawing, "clip_from_box"), 1, GL_FALSE, matrix);
    glDrawElements(GL_TRIANGLES, 36, GL_UNSIGNED_BYTE, NULL);
}

/* The square of `share` sides at these shares from the block's corner. */
static void draw_square(const struct city_drawing *drawing, const kmb_view *view, const kmb_blockmap *block, double east,
                        double north, double share)
{
    double side = block->side, texels = block->side_texels, margin = MARGIN * side;
    double top = block->heights[1] > drawing->floor ? block->heights[1] : drawing->floor;
    const double corner[3] = {block->corner[0] + east * side - margin, block->corner[1] + north * side - margin,
                              drawing->floor - margin};
    const double edges[3] = {share * side + 2 * margin, share * side + 2 * margin, top - drawing->floor + 2 * margin};
    glUniform2f(place_of(drawing, "low"), (GLfloat)(east * texels), (GLfloat)(north * texels));
    glUniform2f(place_of(drawing, "high"), (GLfloat)((east + share) * texels), (GLfloat)((north + share) * texels));
    draw_box(drawing, view, corner, edges);
}

/* All lengths across the ground become texels of the block, relative to its corner. */
static void use_block(const struct city_drawing *drawing, const kmb_view *view, const kmb_blockmap *block,
                      const struct block_texture *texture)
{
    const double *m = view->world_to_clip, *eye = view->eye;
    double texel = block->side / block->side_texels, matrix[9];
    GLfloat directions[9];
    direction_from_pixel(view, matrix);
    for (int i = 0; i < 9; i++) directions[i] = (GLfloat)(i % 3 < 2 ? matrix[i] / texel : matrix[i]);
    glUniformMatrix3fv(place_of(drawing, "direction_from_pixel"), 1, GL_FALSE, directions);
    glUniform3f(place_of(drawing, "eye"), (GLfloat)((eye[0] - block->corner[0]) / texel),
                (GLfloat)((eye[1] - block->corner[1]) / texel), (GLfloat)eye[2]);
    glUniform3f(place_of(drawing, "depth_row"), (GLfloat)(m[2] * texel), (GLfloat)(m[6] * texel), (GLfloat)m[10]);
    glUniform1f(place_of(drawing, "depth_at_eye"), (GLfloat)(m[2] * eye[0] + m[6] * eye[1] + m[10] * eye[2] + m[14]));
    glUniform1i(place_of(drawing, "side"), (GLint)block->side_texels);
    glUniform1i(place_of(drawing, "slices"), (GLint)block->slices);
    glUniform2f(place_of(drawing, "heights"), block->heights[0], block->heights[1]);
    glUniform1f(place_of(drawing, "steepest_step"), block->roof_slope * (GLfloat)texel);
    glUniform1f(place_of(drawing, "texel_size"), (GLfloat)texel);
    glUniform1i(place_of(drawing, "has_16_bits"), texture->low_heights != 0);
    glActiveTexture(GL_TEXTURE1);
    glBindTexture(GL_TEXTURE_2D, texture->low_heights ? texture->low_heights : texture->image);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, texture->image);
}

static void begin(const struct city_drawing *drawing)
{
    glEnable(GL_DEPTH_TEST);
    glEnable(GL_DEPTH_CLAMP);
    glEnable(GL_CULL_FACE);
    glCullFace(GL_FRONT);
    glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
    glUseProgram(drawing->program);
    glBindVertexArray(drawing->array);
    glUniform1i(place_of(drawing, "image"), 0);
    glUniform1i(place_of(drawing, "low_heights"), 1);
    glUniform1f(place_of(drawing, "city_floor"), (GLfloat)drawing->floor);
    glUniform1i(place_of(drawing, "has_occlusion"), drawing->occlusion);
}

static void end(void)
{
    glBindVertexArray(0);
    glCullFace(GL_BACK);
    glDisable(GL_CULL_FACE);
    glDisable(GL_DEPTH_CLAMP);
}

kmb_status city_drawing_draw(const struct city_drawing *drawing, const kmb_city_visit *visit, const kmb_view *view)
{
    const kmb_city_drawn *drawn;
    size_t count;
    kmb_status status = kmb_city_visit_drawn(visit, &drawn, &count);
    if (status != KMB_OK) return status;
    begin(drawing);
    for (size_t i = 0; i < count && status == KMB_OK; i++) {
        kmb_blockmap block = {.struct_size = sizeof block};
        status = kmb_city_visit_block(visit, drawn[i].node, &block);
        const struct block_texture *texture = drawing->textures + drawn[i].node;
        if (status != KMB_OK || !texture->image) continue;
        use_block(drawing, view, &block, texture);
        if (drawn[i].quarters == 15) {
            draw_square(drawing, view, &block, 0, 0, 1);
            continue;
        }
        for (uint32_t quarter = 0; quarter < 4; quarter++)
            if (drawn[i].quarters >> quarter & 1)
                draw_square(drawing, view, &block, 0.5 * (quarter & 1), 0.5 * (quarter >> 1), 0.5);
    }
    end();
    return status;
}

void city_drawing_destroy(struct city_drawing *drawing)
{
    for (uint32_t node = 0; drawing->textures && node < drawing->nodes; node++) drop(drawing->textures + node);
    free(drawing->textures);
    glDeleteBuffers(1, &drawing->corners);
    glDeleteBuffers(1, &drawing->indices);
    glDeleteVertexArrays(1, &drawing->array);
    glDeleteProgram(drawing->program);
    *drawing = (struct city_drawing){0};
}
