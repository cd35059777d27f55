/* The smallest program that draws: opens a repository, makes a cut for an oblique view from the south, draws its patches with
 * OSMesa, and writes the picture. usage: first FILE.kmb OUT.ppm */
#include <GL/osmesa.h>
#include <kimberlite.h>
#include <stdio.h>

static unsigned char pixels[600 * 600][4];

static void draw(const kmb_patch *patch, const uint16_t *indices, size_t count)
{
    kmb_patch_info info = {.struct_size = sizeof info};
    kmb_patch_describe(patch, &info);
    if (!info.complete) indices = info.indices, count = info.index_count;
    glBegin(GL_TRIANGLES);
    for (size_t i = 0; i < count; i++) {
        const float *v = info.vertices + 6 * indices[i]; /* column, row, height; normal */
        float light = 0.5f * v[5] - 0.5f * v[3] + 0.5f * v[4];
        glColor3f(0.2f + light, 0.25f + light, 0.1f + light);
        glVertex3d(info.origin[0] + v[0], info.origin[1] + v[1], info.origin[2] + v[2]);
    }
    glEnd();
}

int main(int argc, char **argv)
{
    kmb_repository *repository = NULL;
    kmb_cut *cut = NULL;
    kmb_repository_info info = {.struct_size = sizeof info};
    kmb_grid_to_world map = {.struct_size = sizeof map};
    if (argc < 3 || kmb_repository_open(argv[1], NULL, &repository) || kmb_cut_create(repository, NULL, &cut)
        || kmb_repository_describe(repository, &info) || kmb_cut_grid_to_world(cut, &map))
        return fprintf(stderr, "%s\n", kmb_last_error()), 1;
    double *o = map.origin, *s = map.step, x = 1.9 / (s[0] * info.width), y = -1.4 / (s[1] * info.height);
    kmb_view view = {.struct_size = sizeof view, .viewport = {600, 600}, .tolerance = 1, .eye = {o[0], o[1], 1e6},
                     .world_to_clip = {x, 0, 0, 0, 0, y, y, 0, 0, x, -x, 0, -x * o[0] - 0.95, -y * o[1] + 0.6, -y * o[1] + 0.7, 1}};
    const kmb_patch *const *patches;
    const uint16_t *indices;
    size_t patch_count, count;
    if (kmb_cut_update(cut, &view, NULL, NULL) || kmb_cut_patches(cut, &patches, &patch_count)
        || kmb_cut_triangle_list(cut, &indices, &count))
        return fprintf(stderr, "%s\n", kmb_last_error()), 1;
    OSMesaContext context = OSMesaCreateContextExt(OSMESA_RGBA, 24, 0, 0, NULL);
    OSMesaMakeCurrent(context, pixels, GL_UNSIGNED_BYTE, 600, 600);
    OSMesaPixelStore(OSMESA_Y_UP, 0);
    glEnable(GL_DEPTH_TEST);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glLoadMatrixd(view.world_to_clip);
    glTranslated(o[0], o[1], o[2]);
    glScaled(s[0], s[1], s[2]); /* one matrix for all patches: neighbours share vertices to the bit */
    for (size_t i = 0; i < patch_count; i++) draw(patches[i], indices, count);
    glFinish();
    FILE *file = fopen(argv[2], "wb");
    if (file) fprintf(file, "P6 600 600 255\n");
    for (size_t i = 0; file && i < 600 * 600; i++) fwrite(pixels[i], 1, 3, file);
    if (file) fclose(file);
    OSMesaDestroyContext(context);
    kmb_cut_destroy(cut);
    kmb_repository_close(repository);
    return printf("%zu patches: %s\n", patch_count, argv[2]) < 0;
}
