/* Pictures as PNG files. */
#ifndef PICTURE_H
#define PICTURE_H

/* Writes width x height pixels of four bytes (red, green, blue, ignored), the lowest row first. Answers 0, or 1 with a message
 * on stderr. */
int picture_write(const char *path, int width, int height, const unsigned char *pixels);

#endif
