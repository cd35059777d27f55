/* Can A see B? Both stand so many world units over the ground.
 *
 * sightline FILE.kmb AX AY A_OVER_GROUND BX BY B_OVER_GROUND
 *
 * x and y are world coordinates: those of the reference system where it is projected, else metres from the raster's centre. */
#include <kimberlite.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* x, y and height over the ground become a place. */
static kmb_status stand(kmb_query *query, char **words, double place[3])
{
    kmb_height ground = {.struct_size = sizeof ground};
    place[0] = strtod(words[0], NULL);
    place[1] = strtod(words[1], NULL);
    kmb_status status = kmb_height_at(query, place[0], place[1], &ground);
    place[2] = ground.height + strtod(words[2], NULL);
    return status;
}

static kmb_status look(kmb_query *query, const double from[3], const double to[3])
{
    int32_t visible = 0;
    kmb_status status = kmb_line_of_sight(query, from, to, &visible);
    if (status != KMB_OK) return status;
    double length = sqrt(pow(to[0] - from[0], 2) + pow(to[1] - from[1], 2) + pow(to[2] - from[2], 2));
    if (visible) {
        printf("yes: nothing lies between them over %.1f\n", length);
        return KMB_OK;
    }
    /* Begins a little ahead: the ends may lie on the ground. */
    kmb_ray ray = {.struct_size = sizeof ray, .longest = 1 - 2e-9};
    kmb_hit hit = {.struct_size = sizeof hit};
    for (int axis = 0; axis < 3; axis++) {
        ray.direction[axis] = to[axis] - from[axis];
        ray.origin[axis] = from[axis] + 1e-9 * ray.direction[axis];
    }
    status = kmb_ray_intersect(query, &ray, &hit);
    if (status == KMB_OK)
        printf("no: after %.1f of %.1f the ground is in between, at %.1f, %.1f, height %.2f\n", hit.distance * length,
               length, hit.place[0], hit.place[1], hit.place[2]);
    return status;
}

int main(int count, char **words)
{
    if (count != 8) {
        fprintf(stderr, "usage: sightline FILE.kmb AX AY A_OVER_GROUND BX BY B_OVER_GROUND\n");
        return 2;
    }
    kmb_repository *repository = NULL;
    kmb_query *query = NULL;
    double from[3], to[3];
    kmb_status status = kmb_repository_open(words[1], NULL, &repository);
    if (status == KMB_OK) status = kmb_query_create(repository, 64 << 20, &query);
    if (status == KMB_OK) status = stand(query, words + 2, from);
    if (status == KMB_OK) status = stand(query, words + 5, to);
    if (status == KMB_OK) status = look(query, from, to);
    if (status != KMB_OK) fprintf(stderr, "%s\n", kmb_last_error());
    kmb_query_destroy(query);
    kmb_repository_close(repository);
    return status != KMB_OK;
}
