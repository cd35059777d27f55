/* Bars at the lower left of a picture: what share of each budget a frame used, and how much is awaited. */
#ifndef METER_H
#define METER_H

#include <kimberlite.h>

/* Draws over the frame, from below: time (yellow) and bytes (blue) as shares of the budget, where that has limits, and diamonds
 * awaited from decoding threads as shares of 100 (red). A full bar is as long as a quarter of the width. */
void meter_draw(const kmb_stats *stats, const kmb_budget *budget, int width, int height);

#endif
