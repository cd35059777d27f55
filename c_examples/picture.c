#include "picture.h"

#include <png.h>
#include <stdio.h>

int picture_write(const char *path, int width, int height, const unsigned char *pixels)
{
    png_image image = {.version = PNG_IMAGE_VERSION};
    image.width = (png_uint_32)width;
    image.height = (png_uint_32)height;
    image.format = PNG_FORMAT_RGBA;
    /* Alpha as drawn is 255 everywhere; a negative stride starts at the lowest row. */
    if (!png_image_write_to_file(&image, path, 0, pixels, -4 * width, NULL)) {
        fprintf(stderr, "%s: %s\n", path, image.message);
        return 1;
    }
    return 0;
}
