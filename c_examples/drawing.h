/* Draws a cut with OpenGL 3.3: a buffer for every patch, kept under the patch's handle. */
#ifndef DRAWING_H
#define DRAWING_H

#include <kimberlite.h>

enum { BUCKETS = 4096 };

struct patch_buffer;

struct drawing {
    unsigned program, shared_indices;
    int shared_count;
    struct patch_buffer *buckets[BUCKETS];
    kmb_grid_to_world map;
    int wireframe, by_level, plain; /* `plain`: without the colours that patches have */
};

/* Makes the program and the shared index buffer; heights from low to high are coloured. Answers 0, or 1 with a message on
 * stderr. */
int drawing_create(struct drawing *drawing, const kmb_cut *cut, double low, double high);

/* Uploads the patches that came into the cut and drops those that left it. */
kmb_status drawing_update(struct drawing *drawing, kmb_cut *cut);

/* Draws the cut's patches over a background of three components from 0 to 255. */
kmb_status drawing_draw(const struct drawing *drawing, const kmb_cut *cut, const kmb_view *view, const int background[3]);

void drawing_destroy(struct drawing *drawing);

#endif
