#include "meter.h"

#include <GL/gl.h>

static void fill(int x, int y, int width, int height, const float colour[3])
{
    if (width < 1 || height < 1) return;
    glScissor(x, y, width, height);
    glClearColor(colour[0], colour[1], colour[2], 1);
    glClear(GL_COLOR_BUFFER_BIT);
}

static double share(double used, uint64_t limit)
{
    double part = limit == KMB_UNLIMITED ? 0 : limit ? used / (double)limit : 1;
    return part < 1 ? part : 1;
}

void meter_draw(const kmb_stats *stats, const kmb_budget *budget, int width, int height)
{
    static const float GROUND[3] = {0.1f, 0.1f, 0.1f};
    static const float COLOURS[3][3] = {{0.9f, 0.2f, 0.2f}, {0.3f, 0.6f, 1}, {1, 0.8f, 0.2f}};
    const double shares[3] = {share((double)stats->awaited, 100), share((double)stats->bytes, budget->bytes),
                              share(stats->microseconds, budget->microseconds)};
    int length = width / 4, thickness = height / 80 + 2;
    glEnable(GL_SCISSOR_TEST);
    for (int i = 0; i < 3; i++) {
        int y = thickness + i * 2 * thickness;
        fill(thickness, y, length, thickness, GROUND);
        fill(thickness, y, (int)(shares[i] * length), thickness, COLOURS[i]);
    }
    glDisable(GL_SCISSOR_TEST);
}
