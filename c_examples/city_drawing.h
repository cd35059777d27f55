/* Draws what a visit of a city draws with OpenGL 3.2: a texture for every block, kept under its node, and a box whose pixels follow their
 * rays through it (shaders/blockmap.vert, blockmap.frag). */
#ifndef CITY_DRAWING_H
#define CITY_DRAWING_H

#include <kimberlite.h>

struct block_texture;

struct city_drawing {
    unsigned program, array, corners, indices;
    uint32_t nodes;
    double floor;
    struct block_texture *textures; /* one a node, without a texture where the visit holds no block */
    int occlusion;                  /* whether ambient occlusion darkens the picture */
};

/* Makes the program from the shaders in a folder. Answers 0, or 1 with a message on stderr. */
int city_drawing_create(struct city_drawing *drawing, const kmb_city *city, const char *shaders);

/* Uploads the blocks that came with the visit's last update and drops those that went. */
kmb_status city_drawing_update(struct city_drawing *drawing, const kmb_city_visit *visit);

/* Draws over what is there, with its depths; the view is a perspective one. */
kmb_status city_drawing_draw(const struct city_drawing *drawing, const kmb_city_visit *visit, const kmb_view *view);

/* The ray of a pixel of a perspective view, x and y from 0 at the picture's lower left corner; distances along it are w in clip space. */
kmb_ray city_ray(const kmb_view *view, double x, double y);

void city_drawing_destroy(struct city_drawing *drawing);

#endif
