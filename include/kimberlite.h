/* Kimberlite: very large terrains in one compressed file, and for every frame of a viewer the
 * triangles that its view needs, without cracks and within a budget; and cities as blocks of fixed
 * size, within the same. Made from src/ffi/ by tests/header.rs; do not edit.
 *
 * CAVEATS
 *
 * - The interface is young: KMB_ABI_VERSION is 0, and may change without a new name of the library
 *   until it is 1.
 * - The library draws nothing, opens no window, and prints nothing, but for a line on stderr with a
 *   KMB_PANIC: see kmb_set_log_callback.
 * - A pointer that is NULL or misaligned where it must not be, and a struct of the wrong size, are
 *   found and refused. A pointer to memory that was freed, that is shorter than the documentation
 *   says, or that holds another kind of handle is not found: the behaviour is then undefined, as
 *   anywhere in C.
 * - Callbacks must return. An exception or longjmp out of one ends the process.
 * - Files from anywhere may be opened: bytes that are not a repository's give KMB_DAMAGED, or
 *   heights that are wrong, but no undefined behaviour. With KMB_ACCESS_MAP this holds only while
 *   nobody truncates the file or writes to it.
 * - Voids beyond the finest level: at coarse levels triangles may cover a void; they are refined
 *   before anything else.
 *
 * CONVENTIONS
 *
 * - A function that can fail returns a kmb_status. Its results come last, through pointers, and are
 *   written only with KMB_OK unless it says otherwise. kmb_last_error() then tells this thread the
 *   place and the cause.
 * - Every struct that crosses the boundary begins with struct_size, which the caller sets to its
 *   sizeof.
 * - An object is what a create or open gives and a destroy or close frees. Functions that take a
 *   pointer to a const object may run on it at the same time in several threads; those that take a
 *   pointer to an object that is not const need it for themselves. Different objects never disturb
 *   each other.
 * - KMB_PANIC is an error of the library, caught at its boundary; the object answers nothing but
 *   KMB_PANIC afterwards, and can only be destroyed.
 * - Lengths and counts of things in memory are size_t, all else has a fixed size. Flags are
 *   uint32_t, 0 or 1.
 * - Strings are UTF-8 and end with a 0. Angles are degrees.
 *
 * WORDS
 *
 * - Grid: column and row of the raster, from 0 at its first sample, row 0 on top; heights in height
 *   units, integers whose meaning kmb_cut_grid_to_world gives. A cut with detail beyond the heights
 *   or with finer colours counts finer columns, rows and units, which that function gives too.
 * - World: right-handed, x east, y north, z up. The coordinates of the reference system where that
 *   is projected and not rotated; metres from the raster's centre where it is longitude and
 *   latitude. z is the physical height, value_scale * sample + value_offset.
 * - Diamond: two right triangles that share their longest edge; the unit of refinement. Patch: one
 *   of them, as vertices. Level: 0 for the coarsest diamond, one more for each bisection. Cut: the
 *   patches that cover the terrain at this moment. Void: a sample without data.
 * - Block: a square of a city as an image of fixed size: heights on K x K texels, which stand for
 *   prisms down to the city's floor, and their colours. Node: a square of the city's quadtree, with
 *   its block. Visit: the blocks that are held and drawn at this moment. A city's coordinates are
 *   those of its reference system, which is metric, and the world of a terrain in the same one.
 */
#ifndef KIMBERLITE_H
#define KIMBERLITE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ================================================================================================
 * Version, errors, messages
 * ================================================================================================ */

// Number of this interface: it grows when a program that was compiled against an older header
// would no longer work.
#define KMB_ABI_VERSION 0

// What a function answers. Except where a function says otherwise, results are written only with
// KMB_OK.
typedef enum kmb_status {
    // Done.
    KMB_OK = 0,
    // A pointer is NULL or misaligned, a string is not UTF-8, or a value is outside what the
    // function accepts.
    KMB_INVALID_ARGUMENT = 1,
    // The struct_size of a struct is not that of this library's struct.
    KMB_INVALID_STRUCT_SIZE = 2,
    // The system refused an operation on a file.
    KMB_IO = 3,
    // The rows of a raster cannot be used, or the rows callback failed.
    KMB_INPUT = 4,
    // A repository's bytes are not what the format says.
    KMB_DAMAGED = 5,
    // A repository asks for another version of this library.
    KMB_UNSUPPORTED_VERSION = 6,
    // The progress callback asked to stop.
    KMB_CANCELLED = 7,
    // The position lies outside the raster or in a void.
    KMB_OUTSIDE = 8,
    // The budget does not even allow the coarsest patches; they are given all the same.
    KMB_BUDGET_TOO_SMALL = 9,
    // There is nothing under this index or key.
    KMB_NOT_FOUND = 10,
    // An internal error was caught. The handle answers nothing else from now on; destroy it.
    KMB_PANIC = 11,
    // The caller's memory does not hold the result.
    KMB_BUFFER_TOO_SMALL = 12,
} kmb_status;

// How much a message matters.
typedef enum kmb_log_level {
    // Progress, and choices that the library made.
    KMB_LOG_INFO = 0,
    // Something was odd in the input, and how it was read.
    KMB_LOG_WARNING = 1,
} kmb_log_level;

// Gets one message, a line without its end. `level` is a kmb_log_level. It may come from any
// thread, and from several at once; `message` lives until the callback returns. The callback must
// not call kmb_set_log_callback.
typedef void (*kmb_log_callback)(void *user, uint32_t level, const char *message);

// The version of the library as text, "major.minor.patch". The string is static.
//
// May be called from any thread at any time.
const char *kmb_version(void);

// The KMB_ABI_VERSION of the library that runs, which may differ from that of the header.
//
// May be called from any thread at any time.
uint32_t kmb_abi_version(void);

// The name of a status, such as "KMB_DAMAGED", or "unknown status" for any other number. The
// string is static.
//
// May be called from any thread at any time.
const char *kmb_status_name(int32_t status);

// The message of the latest call on this thread that did not answer KMB_OK: one line of UTF-8 with
// the place (file, row and column, or argument) and the cause; empty if there was none. The string
// belongs to the library and lives until the next such call on this thread, or the thread's end.
//
// May be called from any thread at any time.
const char *kmb_last_error(void);

// Sends all messages of the library to `callback` with `user`; NULL stops them. The library itself
// prints nothing. When this returns, the former callback runs nowhere and is called no more.
//
// May be called from any thread, but not from within the callback.
//
// Returns KMB_OK, KMB_PANIC.
enum kmb_status kmb_set_log_callback(kmb_log_callback callback, void *user);

/* ================================================================================================
 * Repositories: opening, what is known of them, coordinates
 * ================================================================================================ */

// What a repository holds.
typedef enum kmb_kind {
    // One height a sample.
    KMB_KIND_HEIGHTS = 0,
    // Three colour components a sample.
    KMB_KIND_COLOURS = 1,
    // City blocks.
    KMB_KIND_CITY = 2,
} kmb_kind;

// How a repository's bytes are read. Both ways give the same answers.
typedef enum kmb_access {
    // By a memory map. The file must not be truncated or written to while it is open, or the
    // system may end the process; replacing it by a rename is safe.
    KMB_ACCESS_MAP = 0,
    // By positioned reads; a file that is truncated meanwhile gives an error.
    KMB_ACCESS_POSITIONED = 1,
} kmb_access;

// The type of a raster's samples, as the input stored them.
typedef enum kmb_sample_type {
    // Unsigned 8-bit integer.
    KMB_SAMPLE_U8 = 0,
    // Signed 8-bit integer.
    KMB_SAMPLE_I8 = 1,
    // Unsigned 16-bit integer.
    KMB_SAMPLE_U16 = 2,
    // Signed 16-bit integer.
    KMB_SAMPLE_I16 = 3,
    // Unsigned 32-bit integer.
    KMB_SAMPLE_U32 = 4,
    // Signed 32-bit integer.
    KMB_SAMPLE_I32 = 5,
    // 32-bit float.
    KMB_SAMPLE_F32 = 6,
    // 64-bit float.
    KMB_SAMPLE_F64 = 7,
} kmb_sample_type;

// What a geotransform's origin is.
typedef enum kmb_registration {
    // The outer corner of the upper left sample, which stands for the cell around it.
    KMB_REGISTRATION_AREA = 0,
    // The upper left sample itself.
    KMB_REGISTRATION_POINT = 1,
} kmb_registration;

// An open repository of heights or of colours. Cuts and queries made from it share what they need of
// it, so that it may be closed before them.
typedef struct kmb_repository kmb_repository;

// How to open a repository.
typedef struct kmb_open_options {
    // sizeof(kmb_open_options).
    uint32_t struct_size;
    // A kmb_access.
    uint32_t access;
    // Bytes of decoded diamonds kept for all cuts and queries of the repository, beside what they hold themselves, so that
    // what one has decoded another need not. 0 keeps none; KMB_UNLIMITED all.
    uint64_t shared_bytes;
} kmb_open_options;

// What is known of a repository. Errors and ranges are in the raster's own units, those of its
// samples.
typedef struct kmb_repository_info {
    // sizeof(kmb_repository_info).
    uint32_t struct_size;
    // A kmb_kind.
    uint32_t kind;
    // Samples a row.
    uint32_t width;
    // Rows.
    uint32_t height;
    // Cells along a side of a diamond.
    uint32_t cells;
    // The finest level; an even number.
    uint32_t levels;
    // Diamonds that the file holds.
    uint64_t diamonds;
    // Samples, valid and void.
    uint64_t samples;
    // Samples without data.
    uint64_t void_samples;
    // Bytes of the file.
    uint64_t bytes;
    // Largest difference between a decoded sample of the finest level and the input, as measured.
    double max_error;
    // The largest difference that the build was allowed.
    double max_error_bound;
    // Root of the mean square difference, as measured.
    double rms_error;
    // 1 where the decoded samples equal the input's, else 0.
    uint32_t lossless;
    // The input's kmb_sample_type.
    uint32_t sample_type;
    // Least valid sample.
    double sample_min;
    // Greatest valid sample.
    double sample_max;
    // Physical height = value_scale * sample + value_offset. World z is the physical height.
    double value_scale;
    // See value_scale.
    double value_offset;
    // The value of a void in the input, where has_nodata is 1; else 0.
    double nodata;
    // 1 where the input had such a value, else 0.
    uint32_t has_nodata;
    // 1 where the input said where it lies, else 0.
    uint32_t georeferenced;
    // 1 where the reference system's coordinates are degrees of longitude and latitude, else 0.
    uint32_t geographic;
    // A kmb_registration.
    uint32_t registration;
    // X = g[0] + column g[1] + row g[2], Y = g[3] + column g[4] + row g[5], in the reference
    // system; for the sample itself, or for its outer corner, as registration says.
    double geotransform[6];
    // World x and y of the sample in column 0 of row 0.
    double world_origin[2];
    // World units of one column, along x, and of one row, along y (negative where row 0 is the
    // north).
    double world_step[2];
    // The coordinate reference system: WKT, "EPSG:n", or empty. Lives until the repository is
    // closed.
    const char *crs;
    // The unit of physical heights, or empty. Lives until the repository is closed.
    const char *units;
    // Count of metadata entries.
    uint64_t metadata_count;
    // Numbers of a sample: 1 for heights, 3 for colours (red, green, blue).
    uint32_t bands;
    // 1 where detail is missing since a repair, else 0. Errors of the samples there are larger than
    // those above.
    uint32_t missing_detail;
} kmb_repository_info;

// Opens the repository of heights or of colours at `path` (bytes as the system has them; UTF-8 on Windows) and
// gives a handle, which kmb_repository_close frees. `options` may be NULL: a memory map.
//
// Reads the header, the tables and the roots; blocks are read, and their checksums checked, when
// they are used. May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_IO, KMB_DAMAGED (the file is
// no repository, or its bytes are not as they were written), KMB_UNSUPPORTED_VERSION, KMB_PANIC.
kmb_status kmb_repository_open(const char *path,
                               const struct kmb_open_options *options,
                               struct kmb_repository **repository);

// Frees a repository. NULL is allowed. No other call may use the handle at the same time, or
// afterwards; cuts and queries made from it stay usable.
void kmb_repository_close(struct kmb_repository *repository);

// Says what is known of a repository. The caller sets info->struct_size; its strings belong to the
// repository and live until it is closed.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_repository_describe(const struct kmb_repository *repository,
                                   struct kmb_repository_info *info);

// Gives metadata entry `index`, counted from 0 in the order of the keys: its key, a string, and
// its value, `length` bytes of any kind. Both belong to the repository and live until it is
// closed.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_NOT_FOUND (`index` is not below metadata_count),
// KMB_PANIC.
kmb_status kmb_repository_metadata_at(const struct kmb_repository *repository,
                                      uint64_t index,
                                      const char **key,
                                      const uint8_t **value,
                                      size_t *length);

// Gives the value of a metadata key: `length` bytes of any kind, which belong to the repository
// and live until it is closed.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_NOT_FOUND, KMB_PANIC.
kmb_status kmb_repository_metadata(const struct kmb_repository *repository,
                                   const char *key,
                                   const uint8_t **value,
                                   size_t *length);

// Turns world x and y into coordinates of the raster's reference system (degrees where it is
// geographic).
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_world_to_crs(const struct kmb_repository *repository,
                            double x,
                            double y,
                            double *crs_x,
                            double *crs_y);

// Turns coordinates of the raster's reference system (degrees where it is geographic) into world x
// and y.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_OUTSIDE (the geotransform has no inverse), KMB_PANIC.
kmb_status kmb_crs_to_world(const struct kmb_repository *repository,
                            double crs_x,
                            double crs_y,
                            double *x,
                            double *y);

/* ================================================================================================
 * Queries: heights and windows of samples, without any view
 * ================================================================================================ */

// Lifts a limit: the bytes of a query, or any limit of a kmb_budget.
#define KMB_UNLIMITED UINT64_MAX

// Answers questions about a repository from a cache of its own.
typedef struct kmb_query kmb_query;

// A height of the finest level.
typedef struct kmb_height {
    // sizeof(kmb_height).
    uint32_t struct_size;
    // The level that the height was read at.
    uint32_t level;
    // Physical height: value_scale * sample + value_offset.
    double height;
    // The input's own surface is not farther from it than this, in physical units; infinite where
    // detail is missing that may have had a void.
    double error_bound;
} kmb_height;

// Makes a query of a repository and gives a handle, which kmb_query_destroy frees. It keeps at
// most about `byte_limit` bytes of decoded data (KMB_UNLIMITED: all that it meets). The repository
// may be closed before the query is destroyed. Make one query for each thread.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_query_create(const kmb_repository *repository,
                            uint64_t byte_limit,
                            struct kmb_query **query);

// Frees a query. NULL is allowed. No other call may use the handle at the same time, or
// afterwards.
void kmb_query_destroy(struct kmb_query *query);

// Gives the height of the finest surface at world x and y. The caller sets height->struct_size.
// Where detail is missing since a repair, it is that of the coarser surface that remains:
// height->level is then below the finest one, and the error bound that of this surface.
//
// Exclusive: no other call may use the query at the same time.
//
// Returns KMB_OK; KMB_OUTSIDE (outside the raster, or in a void); KMB_INVALID_ARGUMENT (also for a
// coordinate that is not finite); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_height_at(struct kmb_query *query, double x, double y, struct kmb_height *height);

// As kmb_height_at, with coordinates of the raster's reference system (degrees where it is
// geographic).
//
// Exclusive: no other call may use the query at the same time.
//
// Returns what kmb_height_at returns.
kmb_status kmb_height_at_crs(struct kmb_query *query,
                             double x,
                             double y,
                             struct kmb_height *height);

// Reads a rectangle of samples of one even level into an array that the caller owns: `height` rows
// of `width` samples from the top, sample values and not physical heights, NaN where there is a
// void; of colours red, green and blue of each sample follow each other. `capacity` is the count of
// doubles at `samples`, at least width * height, and three times that for colours. A level 2k has
// every 2^(K - k)-th column and row of the raster, where 2K is the finest level; `column` and
// `row` count those.
//
// Where detail is missing since a repair, samples are those of the coarser surface that remains;
// `coarse_samples`, which may be NULL, is their count.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for an odd or too fine level, a rectangle that is
// empty or not within the level, or too small a capacity); KMB_IO; KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_read_window(const kmb_repository *repository,
                           uint32_t level,
                           uint32_t column,
                           uint32_t row,
                           uint32_t width,
                           uint32_t height,
                           double *samples,
                           size_t capacity,
                           uint64_t *coarse_samples);

/* ================================================================================================
 * Rays and lines of sight
 * ================================================================================================ */

// A half line, or a part of one, in world coordinates.
typedef struct kmb_ray {
    // sizeof(kmb_ray).
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Where it begins.
    double origin[3];
    // Where it goes; of any length above 0.
    double direction[3];
    // It ends at origin + longest * direction; may be infinite.
    double longest;
} kmb_ray;

// Where a ray meets the surface.
typedef struct kmb_hit {
    // sizeof(kmb_hit).
    uint32_t struct_size;
    // Level of the triangle that is met.
    uint32_t level;
    // The place is origin + distance * direction.
    double distance;
    // World coordinates.
    double place[3];
} kmb_hit;

// Gives the nearest place at which a ray meets the finest surface, from above or from below; where detail
// is missing since a repair, the coarser one that remains. The caller sets hit->struct_size. Voids
// let rays through; between triangles none slips.
//
// Exclusive: no other call may use the query at the same time.
//
// Returns KMB_OK; KMB_OUTSIDE (it meets nothing); KMB_INVALID_ARGUMENT (also for numbers that are
// not finite but `longest`, no direction, or a `longest` below 0); KMB_INVALID_STRUCT_SIZE; KMB_IO;
// KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_ray_intersect(kmb_query *query,
                             const struct kmb_ray *ray,
                             struct kmb_hit *hit);

// Tells whether the straight line between two places in world coordinates, 3 doubles each, meets the
// finest surface nowhere but at its ends: *visible becomes 1, else 0.
//
// Exclusive: no other call may use the query at the same time.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for coordinates that are not finite); KMB_IO;
// KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_line_of_sight(kmb_query *query,
                             const double *from,
                             const double *to,
                             int32_t *visible);

/* ================================================================================================
 * Profiles along lines, statistics of polygons
 * ================================================================================================ */

// A place of a profile.
typedef struct kmb_profile_place {
    // sizeof(kmb_profile_place).
    uint32_t struct_size;
    // The level that the height was read at, 0 where there is none.
    uint32_t level;
    // World units along the line from its start.
    double distance;
    // World x and y.
    double place[2];
    // Physical height; NaN where there is no surface: outside the raster and in voids.
    double height;
    // As that of kmb_height; NaN where there is no height.
    double error_bound;
} kmb_profile_place;

// What the finest surface is like within a polygon.
typedef struct kmb_area {
    // sizeof(kmb_area).
    uint32_t struct_size;
    // The coarsest level that was read: the finest one, but where detail is missing.
    uint32_t level;
    // Least physical height.
    double minimum;
    // Greatest physical height.
    double maximum;
    // Mean height over `area`: mean * area is the volume between the surface and height 0.
    double mean;
    // World area, seen from above, of the part of the polygon that has a surface: in the raster and not
    // void.
    double area;
    // As that of kmb_height, of the whole surface within the polygon and so of the three heights.
    double error_bound;
} kmb_area;

// Gives the exact profile of the finest surface along a line: `line` is `point_count` points, 2 or more, each
// world x and y. Where detail is missing since a repair, it is that of the coarser surface that
// remains.
//
// The places are the line's points and all at which it crosses from one triangle to the next, in
// order. Between two places with heights the surface is straight, and either's bound holds. Where it
// ends or begins, at a void or the raster's edge, there are two places at the same distance, one with a
// height and one with NaN.
//
// `places` has room for `capacity` of them; the caller sets places[0].struct_size. *count becomes their
// count, also when that is more than `capacity`; there are at most 6 for each point of the line and for
// each sample of its length. With a capacity of 0 `places` may be NULL. A call whose capacity is too
// small reads as much as one whose is not.
//
// Exclusive: no other call may use the query at the same time.
//
// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`count` is the capacity that is needed, and nothing else is
// written); KMB_INVALID_ARGUMENT (also for fewer than 2 points, or coordinates that are not finite
// or too far apart); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_profile(kmb_query *query,
                       const double *line,
                       size_t point_count,
                       struct kmb_profile_place *places,
                       size_t capacity,
                       size_t *count);

// Gives the heights at `count` places along a line, evenly spaced from its start to its end; each is what
// kmb_height_at gives. `line` is `point_count` points, 2 or more, each world x and y. `places` has
// room for `count`; the caller sets places[0].struct_size. A count of 1 gives the start.
//
// Exclusive: no other call may use the query at the same time.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a count of 0, fewer than 2 points, or coordinates that
// are not finite or too far apart); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_profile_samples(kmb_query *query,
                               const double *line,
                               size_t point_count,
                               struct kmb_profile_place *places,
                               size_t count);

// Gives the least, the greatest and the mean height of the finest surface within a polygon: `polygon` is
// `point_count` points, 3 or more, each world x and y, in either direction; the last is joined to the
// first. The caller sets statistics->struct_size. All is exact but for rounding errors: triangles are
// clipped to the polygon. Where detail is missing since a repair, they are those of the coarser surface
// that remains.
//
// A polygon may touch itself, as one with a hole does that an edge there and back leads to, but not cross
// itself. All samples within it are decoded, whatever its size, in the memory that the query has; time
// also grows with the square of `point_count`.
//
// Exclusive: no other call may use the query at the same time.
//
// Returns KMB_OK; KMB_OUTSIDE (no surface lies within the polygon); KMB_INVALID_ARGUMENT (also for fewer
// than 3 points, coordinates that are not finite or immensely large, and a polygon that crosses itself
// or encloses no area); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
kmb_status kmb_area_statistics(kmb_query *query,
                               const double *polygon,
                               size_t point_count,
                               struct kmb_area *statistics);

/* ================================================================================================
 * Patches: what is drawn
 * ================================================================================================ */

// One right triangle of terrain as vertices; it never changes.
typedef struct kmb_patch kmb_patch;

// What a patch consists of. The pointers live as long as the patch.
typedef struct kmb_patch_info {
    // sizeof(kmb_patch_info).
    uint32_t struct_size;
    // Level of its diamond: 0 for the coarsest, one more for each bisection.
    uint32_t level;
    // Number of this patch within its cut; never used again for another.
    uint64_t handle;
    // Centre of its diamond on the lattice (along columns, along rows, 0): its identifier in every
    // cut.
    int32_t diamond[3];
    // Which half of the diamond it is: 0 or 1.
    uint32_t half;
    // 1 where it uses the shared triangles of its cut, 0 where it has its own.
    uint32_t complete;
    // Texels along a side of its texture; 0 where it has none.
    uint32_t texture_side;
    // Grid coordinates (column, row, height unit) that its vertices are relative to: integers.
    double origin[3];
    // Grid steps (columns, rows) of p, in legs[0], and of q, in legs[1].
    float legs[2][2];
    // World positions of the right angle, of the end of p, and of the end of q.
    double corners[3][3];
    // Least and greatest world x, y, z of its vertices.
    double bounds[2][3];
    // Largest height difference to the finest surface, in world z units; may be infinite.
    double error;
    // Its vertices, in the form that the cut was made for.
    const float *vertices;
    // Floats at `vertices`.
    size_t vertex_floats;
    // Its own list of triangles, three vertex indices each, where `complete` is 0; else NULL.
    const uint16_t *indices;
    // Indices at `indices`; 0 where `complete` is 1, or where it has no triangle.
    size_t index_count;
    // Its colours in the form that the cut was made for; NULL without colours.
    const uint8_t *colours;
    // Bytes at `colours`.
    size_t colour_bytes;
    // Texture coordinates, 0 to 1, of the right angle, of the end of p and of the end of q, in the middles of their
    // texels: the first along a row of the texture. Those of vertices lie evenly between.
    float texture_corners[3][2];
    // Where its vertices came from, 2 floats each: the height, relative to the patch's origin in height units, of the
    // middle of the edge that the vertex divided when it came; and the level of the diamonds that first had it. All
    // patches that share a vertex tell the same of it, so that what blends from one height to the other by this level
    // and the vertex's place has no cracks. NULL where the cut was not made for it.
    const float *births;
} kmb_patch_info;

// Says what a patch consists of. The caller sets info->struct_size; the arrays belong to the patch
// and live as long.
//
// May be called from any thread while the patch lives.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_patch_describe(const struct kmb_patch *patch, struct kmb_patch_info *info);

// Keeps a patch alive until a kmb_patch_release, beyond its cut's next update and its cut's end.
// It must be alive when this is called.
//
// May be called from any thread.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_patch_retain(const struct kmb_patch *patch);

// Undoes one kmb_patch_retain; the patch may end with it. NULL is allowed.
//
// May be called from any thread.
void kmb_patch_release(const struct kmb_patch *patch);

/* ================================================================================================
 * Cuts: from views to patches
 * ================================================================================================ */

// What a vertex of a patch holds. All are floats without padding between them.
typedef enum kmb_vertex_form {
    // 3 floats: height relative to the patch's origin, in height units; then dz/dx and dz/dy of
    // the surface in world units. The place within the patch comes from kmb_cut_grid.
    KMB_VERTEX_COMPACT = 0,
    // 6 floats: column, row and height relative to the patch's origin, in columns, rows and height
    // units; then the unit normal in the world.
    KMB_VERTEX_EXPANDED = 1,
} kmb_vertex_form;

// What a cut's tolerance is about.
typedef enum kmb_metric {
    // How far a point of the finest surface may be, on the screen, from the drawn point at the same place. No more
    // than the scene needs: flat land stays coarse.
    KMB_METRIC_GEOMETRIC = 0,
    // How large the drawn triangles may be: the side of a square as large as the mean triangle of a half. It bounds no
    // error.
    KMB_METRIC_SAMPLING = 1,
} kmb_metric;

// What patches have of the colours of a cut.
typedef enum kmb_colour_form {
    // A square texture over the patch's whole diamond, texture_side texels a side, row by row without padding, 3 bytes
    // each: red, green, blue. What lies beyond the patch's long side only serves bilinear filters, which
    // agree along it with those of the next texture.
    KMB_COLOUR_TEXTURE = 0,
    // 4 bytes for each vertex: red, green, blue, 255.
    KMB_COLOUR_VERTICES = 1,
} kmb_colour_form;

// The patches that a viewer draws, kept from frame to frame.
typedef struct kmb_cut kmb_cut;

// How to make a cut. What is 0 stands for what no options stand for.
typedef struct kmb_cut_options {
    // sizeof(kmb_cut_options).
    uint32_t struct_size;
    // A kmb_vertex_form.
    uint32_t vertex_form;
    // A kmb_metric.
    uint32_t metric;
    // Threads that decode for the cut, at most 64. With 0, updates decode for themselves, within their budgets.
    uint32_t threads;
    // A repository of colours over the same domain (built with --domain-of), or NULL. Its diamonds may have other cells
    // and be deeper: then those of heights are divided further, and grid coordinates count finer steps. It may be
    // closed before the cut is destroyed.
    const kmb_repository *colours;
    // A kmb_colour_form.
    uint32_t colour_form;
    // 1 where patches are to tell where their vertices came from; else 0.
    uint32_t births;
    // How large texels may be on the screen, in pixels, before finer ones are taken; 0 for 1.
    double texel_pixels;
    // Levels beyond the finest heights, an even number.
    uint32_t detail_levels;
    // 0.
    uint32_t reserved;
    // Detail on these levels: the most that a new vertex is moved, up or down, as a part of the edge that it divides,
    // 0 to 0.3. The moves are random, by the vertex's place: the same everywhere.
    double roughness;
} kmb_cut_options;

// A camera, in world coordinates.
typedef struct kmb_view {
    // sizeof(kmb_view).
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // The eye.
    double eye[3];
    // From the world to clip space, column by column; any projection.
    double world_to_clip[16];
    // Width and height of the picture in pixels.
    double viewport[2];
    // Largest error on the screen, in pixels by the cut's metric, that need not be refined; above 0.
    double tolerance;
} kmb_view;

// Limits of one update. KMB_UNLIMITED lifts any of them.
typedef struct kmb_budget {
    // sizeof(kmb_budget).
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Time after which no refinement starts, in microseconds from the start of the update.
    uint64_t microseconds;
    // Refinements in this update; 0 leaves the cut as it is.
    uint64_t refinements;
    // Bytes of decoded data that the cut holds, with all masks and lists of triangles that voids and borders may
    // need, and up to an eighth of it for what its threads decode.
    uint64_t bytes;
    // Bytes of vertices handed out anew in this update.
    uint64_t upload_bytes;
    // Patches to draw; a half of a diamond counts as one even if it turns out to be void.
    uint64_t patches;
} kmb_budget;

// What an update did, and what is drawn now.
typedef struct kmb_stats {
    // sizeof(kmb_stats).
    uint32_t struct_size;
    // 1 where a budget ended refinement while an error was above the tolerance, or details have yet to come; else 0.
    uint32_t cut_short;
    // Diamonds refined.
    uint64_t refined;
    // Diamonds coarsened.
    uint64_t coarsened;
    // Patches that kmb_cut_patches gives.
    uint64_t patches;
    // Their triangles.
    uint64_t triangles;
    // Patches that came into the cut.
    uint64_t added;
    // Patches that left the cut.
    uint64_t removed;
    // Bytes of decoded data that the cut holds, counted as its budget counts them.
    uint64_t bytes;
    // Refinements begun after the deadline; always 0.
    uint64_t late_refinements;
    // Largest error of a patch to draw, in pixels; may be infinite. Above the tolerance while cut_short
    // is 0: detail is missing or damaged there.
    double largest_error;
    // Time of the part whose cost does not depend on the budget, in microseconds.
    double fixed_microseconds;
    // Time of the whole update, in microseconds.
    double microseconds;
    // Diamonds whose details the cut's threads were asked for and have not given; updates go on without.
    uint64_t awaited;
    // Bytes of vertices of the patches that came into the cut, counted as its budget counts them.
    uint64_t upload_bytes;
} kmb_stats;

// From grid coordinates (column, row, height unit) to the world, axis by axis: world[i] =
// origin[i] + step[i] * grid[i].
typedef struct kmb_grid_to_world {
    // sizeof(kmb_grid_to_world).
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // World coordinates of column 0, row 0, height unit 0.
    double origin[3];
    // World units of a column (along x), of a row (along y) and of a height unit (along z).
    double step[3];
} kmb_grid_to_world;

// Makes a cut of a repository and gives a handle, which kmb_cut_destroy frees. It has no patches
// to draw until its first update. `options` may be NULL: KMB_VERTEX_EXPANDED, KMB_METRIC_GEOMETRIC,
// no threads.
// The repository may be closed before the cut is destroyed.
//
// May be called with the same repository from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_IO, KMB_DAMAGED, KMB_INPUT
// (the colours are not over the heights' domain, or have too few texels), KMB_PANIC.
kmb_status kmb_cut_create(const kmb_repository *repository,
                          const struct kmb_cut_options *options,
                          struct kmb_cut **cut);

// Frees a cut, and its patches but for those that kmb_patch_retain holds. NULL is allowed. No
// other call may use the handle at the same time, or afterwards.
void kmb_cut_destroy(struct kmb_cut *cut);

// Moves the cut towards a view: refines where the error on the screen is above the view's
// tolerance, and coarsens where it need not be so fine, within the budget. `budget` may be NULL:
// no limits. `stats` may be NULL; otherwise the caller sets stats->struct_size.
//
// The cut is whole and without cracks whatever ends the update. With a still view and the same
// budget it settles, and then changes nothing. Ends the life of what kmb_cut_patches and
// kmb_cut_changes gave before.
//
// Exclusive: no other call may use the cut at the same time. Patches that are retained may be
// used.
//
// Returns KMB_OK; KMB_BUDGET_TOO_SMALL (the budget is below the coarsest patches: they are shown
// all the same, and `stats` is written); KMB_INVALID_ARGUMENT (also for a view with a number that
// is not finite, with an empty viewport, or with a tolerance that is not above 0: the cut stays as
// it was); KMB_INVALID_STRUCT_SIZE; KMB_PANIC. A block that cannot be read or is damaged is no
// failure: the surface stays coarser there, and the log callback is told once.
kmb_status kmb_cut_update(struct kmb_cut *cut,
                          const struct kmb_view *view,
                          const struct kmb_budget *budget,
                          struct kmb_stats *stats);

// Gives the patches to draw, near to far: those of the cut that meet the view's frustum. The array
// and its patches belong to the cut and live until its next update or its end; a patch lives
// longer by kmb_patch_retain.
//
// May be called with the same cut from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_cut_patches(const struct kmb_cut *cut,
                           const kmb_patch *const **patches,
                           size_t *count);

// Gives what changed since the last call of this function, or since the cut was made: the patches
// that came into the cut, in the frustum or not, and the handles of those that left it. A patch
// that came and left in between is in neither. So a GPU cache is a map from handles to buffers.
//
// The arrays belong to the cut and live until the next call of this function, the next update, or
// the cut's end.
//
// Exclusive: no other call may use the cut at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_cut_changes(struct kmb_cut *cut,
                           const kmb_patch *const **added,
                           size_t *added_count,
                           const uint64_t **removed,
                           size_t *removed_count);

// Gives the triangles that all complete patches share, as a list: three vertex indices each, with
// the upper side counterclockwise. The array belongs to the cut and lives as long.
//
// May be called with the same cut from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_cut_triangle_list(const struct kmb_cut *cut,
                                 const uint16_t **indices,
                                 size_t *count);

// Gives the same triangles as one strip, whose rows are joined by triangles without area. The
// array belongs to the cut and lives as long.
//
// May be called with the same cut from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_cut_triangle_strip(const struct kmb_cut *cut,
                                  const uint16_t **indices,
                                  size_t *count);

// Gives the place (p, q) of every vertex within any patch, two floats each, for vertices of
// KMB_VERTEX_COMPACT: vertex (p, q) lies at origin + p legs[0] + q legs[1] of its patch.
// `vertex_count` is that of pairs. The array belongs to the cut and lives as long.
//
// May be called with the same cut from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_cut_grid(const struct kmb_cut *cut, const float **grid, size_t *vertex_count);

// Gives the map from grid coordinates to the world, one for all patches. The caller sets
// map->struct_size.
//
// To keep shared vertices of neighbours together to the last bit, add `origin - anchor` of a patch
// (integers, exact in floats) to its vertices first, and multiply with one matrix of the frame
// afterwards; never with a matrix for each patch.
//
// May be called with the same cut from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_cut_grid_to_world(const struct kmb_cut *cut, struct kmb_grid_to_world *map);

/* ================================================================================================
 * Builders: from rows to repositories
 * ================================================================================================ */

// How a raster becomes levels, and what its error is.
typedef enum kmb_transform {
    // Coarse levels are samples of the finest. No vertex of any level is off by more than the
    // maximum error.
    KMB_TRANSFORM_INTERPOLATING = 0,
    // Coarse levels are filtered. Lossless, or within a root mean square error.
    KMB_TRANSFORM_LIFTED = 1,
    // Coarse levels are filtered. No sample is off by more than the maximum error, nor any vertex
    // of a coarser level from the filtered one.
    KMB_TRANSFORM_TWO_STAGE = 2,
} kmb_transform;

// How coefficients become bytes.
typedef enum kmb_entropy {
    // In contexts, by tables that are trained on the raster.
    KMB_ENTROPY_RANS = 0,
    // A quadtree of Elias gamma codes: larger, and nothing is trained.
    KMB_ENTROPY_GAMMA = 1,
} kmb_entropy;

// What is to be built: a raster's description, and how to code it.
typedef struct kmb_builder kmb_builder;

// What to build.
typedef struct kmb_builder_options {
    // sizeof(kmb_builder_options).
    uint32_t struct_size;
    // A kmb_sample_type.
    uint32_t sample_type;
    // Samples a row; at least 2.
    uint32_t width;
    // Rows; at least 2.
    uint32_t height;
    // Largest allowed difference between a decoded sample and the input's, in sample units; 0 is
    // lossless for integers. KMB_TRANSFORM_LIFTED takes only 0.
    double max_error;
    // Cells along a side of a diamond: 16, 32, 64 or 128; 0 for 64.
    uint32_t cells;
    // Threads to use, or 0 for one a core. The file does not depend on it.
    uint32_t threads;
    // A kmb_transform.
    uint32_t transform;
    // A kmb_entropy.
    uint32_t entropy;
    // For KMB_TRANSFORM_LIFTED: largest allowed root mean square difference, in sample units, or 0
    // for lossless. The largest difference that comes with it is in the report and in the file.
    double rms_error;
    // Numbers of a sample: 0 or 1 for heights; 3 for colours (red, green, blue), which are of
    // KMB_SAMPLE_U8 or KMB_SAMPLE_U16. Errors are then those of each of the three.
    uint32_t bands;
    // Memory that the process may take, in MiB, about: what does not fit goes to temporary files in the folder of
    // the output. 0 for no limit. The file does not depend on it.
    uint32_t memory;
} kmb_builder_options;

// Fills `samples` with `row_count` rows of the raster from row `first_row` on, row by row: a
// double each (three for a colour: red, green, blue), NaN for a void (in all three), any other value a sample of the raster's type (it is rounded to a
// float for KMB_SAMPLE_F32). Rows are asked for from the top, each once. Calls come one after the
// other, from any thread. An answer other than 0 ends the build with KMB_INPUT. Nothing may unwind
// out of it.
typedef int32_t (*kmb_rows_callback)(void *user,
                                     uint32_t first_row,
                                     uint32_t row_count,
                                     double *samples);

// Learns how far a long call has come: `done` of `total` steps. Calls come one after the other,
// from any thread. An answer other than 0 asks to stop; the call then returns KMB_CANCELLED.
// Nothing may unwind out of it.
typedef int32_t (*kmb_progress_callback)(void *user, uint64_t done, uint64_t total);

// What a build made.
typedef struct kmb_build_report {
    // sizeof(kmb_build_report).
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Samples, valid and void.
    uint64_t samples;
    // Samples without data.
    uint64_t void_samples;
    // Bytes of the file.
    uint64_t bytes;
    // Largest difference between a decoded sample and the input's, as measured from the bytes
    // written.
    double max_error;
    // Root of the mean square difference.
    double rms_error;
} kmb_build_report;

// Makes a builder and gives a handle, which kmb_builder_destroy frees. The raster has no
// georeference until it gets one: its samples are one unit apart, north up, the lower left one at
// 0, 0.
//
// May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for errors that the transform cannot keep),
// KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_builder_create(const struct kmb_builder_options *options,
                              struct kmb_builder **builder);

// Frees a builder. NULL is allowed. No other call may use the handle at the same time, or
// afterwards.
void kmb_builder_destroy(struct kmb_builder *builder);

// Says where the raster lies: six numbers, X = g[0] + column g[1] + row g[2] and Y = g[3] + column
// g[4] + row g[5], what its origin is (`registration`, a kmb_registration), and whether X and Y
// are degrees of longitude and latitude (`geographic`, 0 or 1). The numbers are copied.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for numbers that are not finite or have no inverse),
// KMB_PANIC.
kmb_status kmb_builder_set_geotransform(struct kmb_builder *builder,
                                        const double *geotransform,
                                        uint32_t registration,
                                        uint32_t geographic);

// Names the coordinate reference system: WKT, "EPSG:n", or empty for none. The string is copied.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_builder_set_crs(struct kmb_builder *builder, const char *crs);

// Names the unit of physical heights, or empty for none. The string is copied.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_builder_set_units(struct kmb_builder *builder, const char *units);

// Says how samples become physical heights: value_scale * sample + value_offset. They are 1 and 0
// until set.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for numbers that are not finite, or a scale of 0),
// KMB_PANIC.
kmb_status kmb_builder_set_value_scale(struct kmb_builder *builder,
                                       double value_scale,
                                       double value_offset);

// Says which sample value is a void, beside NaN. No valid sample is ever decoded to it.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_builder_set_nodata(struct kmb_builder *builder, double nodata);

// Keeps `length` bytes of any kind under a key, in place of what was there. Both are copied. Keys
// that begin with "tiff." are for GeoTIFF tags.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_builder_set_metadata(struct kmb_builder *builder,
                                    const char *key,
                                    const uint8_t *value,
                                    size_t length);

// Builds the repository at `path` from rows that `rows` gives, and reports what it made.
// `progress` may be NULL; so may `report`, otherwise the caller sets report->struct_size. The file
// appears under its name only when it is whole, in place of what was there; after any failure
// nothing is left of it. The builder may be used again.
//
// Exclusive: no other call may use the builder at the same time, the callbacks included.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a maximum error too small for the samples);
// KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_INPUT (`rows` failed, or gave an infinite sample or one
// that the sample type does not have); KMB_CANCELLED; KMB_PANIC.
kmb_status kmb_builder_write(struct kmb_builder *builder,
                             kmb_rows_callback rows,
                             void *rows_user,
                             kmb_progress_callback progress,
                             void *progress_user,
                             const char *path,
                             struct kmb_build_report *report);

/* ================================================================================================
 * Updates: other samples in a part of a repository
 * ================================================================================================ */

// Which samples get new values, and how.
typedef struct kmb_update_options {
    // sizeof(kmb_update_options).
    uint32_t struct_size;
    // The region: its first column in the raster.
    uint32_t column;
    // Its first row.
    uint32_t row;
    // Its columns.
    uint32_t width;
    // Its rows.
    uint32_t height;
    // 0 if the rows callback gives the region's rows; 1 if it gives all rows of the raster, as it
    // must where the repository is not lossless, or has missing detail.
    uint32_t rows_are_whole;
    // Most MiB of memory to take, about, where all must be built again; 0 for no limit.
    uint32_t memory;
    // Threads to use; 0 for as many as there are processors.
    uint32_t threads;
    // The RMS error that the repository was built with, or 0.
    double rms_error;
} kmb_update_options;

// What an update did.
typedef struct kmb_update_report {
    // sizeof(kmb_update_report).
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Diamonds that were coded again.
    uint64_t diamonds_recomputed;
    // All diamonds.
    uint64_t diamonds;
    // Bytes of the file.
    uint64_t bytes;
} kmb_update_report;

// Replaces the samples of a region of the repository at `repository_path` by those that `rows`
// gives. The bytes become those of a build of the whole raster with the same options and the old
// file's weights and tables. A lossless repository has all other samples itself, and of heights
// with KMB_TRANSFORM_INTERPOLATING only the diamonds that the region reaches are coded again, unless
// what holds for the whole raster changes: the range of its samples, or whether any is void. One
// that is not lossless is built again from all samples, those of the region and the originals of
// all others (rows_are_whole), which are compared with what the repository has. The new file appears
// under the name only when it is whole; handles that have the old one open go on with that.
// `progress` may be NULL; so may `report`, otherwise the caller sets report->struct_size.
//
// May be called from any thread at any time. Of two updates of one file at the same time one is
// lost.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also where originals are needed, or given samples are not
// the originals); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_INPUT (`rows` failed, or gave a sample that
// the type does not have); KMB_DAMAGED; KMB_UNSUPPORTED_VERSION (also for a file that a later version
// wrote); KMB_CANCELLED; KMB_PANIC.
kmb_status kmb_repository_update(const char *repository_path,
                                 const struct kmb_update_options *options,
                                 kmb_rows_callback rows,
                                 void *rows_user,
                                 kmb_progress_callback progress,
                                 void *progress_user,
                                 struct kmb_update_report *report);

/* ================================================================================================
 * Repairs: what is left of a damaged repository
 * ================================================================================================ */

// What a repair found and left.
typedef struct kmb_repair_report {
    // sizeof(kmb_repair_report).
    uint32_t struct_size;
    // The coarsest level of a diamond whose detail is missing; the finest level of all where none
    // is.
    uint32_t coarsest_level;
    // Blocks that were damaged, or whose place was not known any more.
    uint64_t damaged_blocks;
    // Those of them that are now missing; the others could be restored.
    uint64_t lost_blocks;
    // All blocks that are missing now, those of earlier repairs too.
    uint64_t missing_blocks;
    // Diamonds that cannot be refined any more: those, and all that descend from them.
    uint64_t blocked_blocks;
    // Samples that lie inside one of them.
    uint64_t coarse_samples;
    // The same in percent of all samples.
    double coarse_percent;
    // Bytes of the repaired file.
    uint64_t bytes;
} kmb_repair_report;

// Writes what is sound of the repository at `repository_path` to `output_path`, and marks the rest
// as missing: cuts, queries and windows give coarser ground there, never wrong ground. `output_path`
// may be NULL: the repaired file then takes the place of the damaged one. It appears under its name
// only when it is whole; handles that have the old file open go on with that. A file without damage
// is copied as it is. `progress` may be NULL; so may `report`, otherwise the caller sets
// report->struct_size.
//
// May be called from any thread at any time.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT; KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED (the header,
// the metadata, the roots or the tables are damaged, without which nothing can be repaired);
// KMB_UNSUPPORTED_VERSION (also for a file that a later version wrote); KMB_CANCELLED; KMB_PANIC.
kmb_status kmb_repository_repair(const char *repository_path,
                                 const char *output_path,
                                 kmb_progress_callback progress,
                                 void *progress_user,
                                 struct kmb_repair_report *report);

/* ================================================================================================
 * Rasters: samples to the bytes of a repository in memory, and back
 * ================================================================================================ */

// How a whole raster becomes bytes.
typedef struct kmb_raster_options {
    // sizeof(kmb_raster_options).
    uint32_t struct_size;
    // A kmb_sample_type, that of the samples in memory.
    uint32_t sample_type;
    // Samples a row; at least 2.
    uint32_t width;
    // Rows; at least 2.
    uint32_t height;
    // Largest allowed difference between a decoded sample and the one that was given, in sample units;
    // 0 is lossless for integers. KMB_TRANSFORM_LIFTED takes only 0.
    double max_error;
    // For KMB_TRANSFORM_LIFTED: largest allowed root mean square difference, in sample units, or 0
    // for lossless.
    double rms_error;
    // The sample value of a void, where has_nodata is 1. NaN is a void in any case.
    double nodata;
    // 1 where there is such a value, else 0.
    uint32_t has_nodata;
    // Cells along a side of a diamond: 16, 32, 64 or 128; 0 for 64.
    uint32_t cells;
    // A kmb_transform.
    uint32_t transform;
    // A kmb_entropy.
    uint32_t entropy;
    // Threads to use, or 0 for one a core. The bytes do not depend on it.
    uint32_t threads;
    // 0.
    uint32_t reserved;
} kmb_raster_options;

// What the bytes of a raster say of it. Errors and ranges are in sample units.
typedef struct kmb_raster_info {
    // sizeof(kmb_raster_info).
    uint32_t struct_size;
    // A kmb_sample_type.
    uint32_t sample_type;
    // Samples a row.
    uint32_t width;
    // Rows.
    uint32_t height;
    // Samples, valid and void.
    uint64_t samples;
    // Samples without data.
    uint64_t void_samples;
    // Bytes of one sample in memory.
    uint32_t sample_bytes;
    // 1 where the decoded samples equal those that were given, else 0.
    uint32_t lossless;
    // Largest difference between a decoded sample and the one that was given, as measured.
    double max_error;
    // The largest difference that was allowed.
    double max_error_bound;
    // Root of the mean square difference, as measured.
    double rms_error;
    // Least valid sample.
    double sample_min;
    // Greatest valid sample.
    double sample_max;
    // The sample value of a void, where has_nodata is 1; else 0.
    double nodata;
    // 1 where there is such a value, else 0.
    uint32_t has_nodata;
    // Cells along a side of a diamond.
    uint32_t cells;
    // A kmb_transform.
    uint32_t transform;
    // A kmb_entropy.
    uint32_t entropy;
} kmb_raster_info;

// Gives the most bytes that kmb_codec_encode_raster can need for a raster with these options,
// whatever its samples.
//
// May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for errors that the transform cannot keep),
// KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_codec_raster_bound(const struct kmb_raster_options *options, size_t *size);

// Turns a whole raster into bytes, those of a repository: in a file they can be opened by
// kmb_repository_open. `samples` are options->height rows of options->width samples from the top,
// without gaps, in the machine's own form of options->sample_type and aligned to it; a void is NaN
// or the nodata value. `bytes` has room for `capacity` bytes; kmb_codec_raster_bound gives a capacity
// that is always enough. `size` is the count of bytes written. All memory is the caller's, and none
// of it is kept.
//
// May be called from any thread at any time.
//
// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`size` is the capacity that is needed, and nothing else is
// written); KMB_INVALID_ARGUMENT (also for a maximum error too small for the samples);
// KMB_INVALID_STRUCT_SIZE; KMB_INPUT (a sample is infinite); KMB_PANIC.
kmb_status kmb_codec_encode_raster(const struct kmb_raster_options *options,
                                   const void *samples,
                                   uint8_t *bytes,
                                   size_t capacity,
                                   size_t *size);

// Says what the bytes of a raster hold. The caller sets info->struct_size. Header and tables are
// checked, not yet what is decoded from them.
//
// May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_INPUT (the bytes are no
// repository), KMB_DAMAGED, KMB_UNSUPPORTED_VERSION, KMB_PANIC.
kmb_status kmb_codec_raster_describe(const uint8_t *bytes,
                                     size_t size,
                                     struct kmb_raster_info *info);

// Turns bytes back into the raster: all rows from the top, without gaps, in the machine's own form
// of the sample type that kmb_codec_raster_describe tells, and aligned to it. A void becomes the nodata
// value, or NaN where there is none. `capacity` is the count of samples that `samples` has room for, at
// least width * height. All memory is the caller's.
//
// Bytes from anywhere may be given: they are checked, or lead to other samples, and the memory
// that is used is bounded by `size` and `capacity`. `samples` hold anything after a failure.
//
// May be called from any thread at any time.
//
// Returns KMB_OK; KMB_BUFFER_TOO_SMALL; KMB_INVALID_ARGUMENT (also where integers have voids and no
// nodata value); KMB_INPUT (the bytes are no repository); KMB_DAMAGED (also where detail is missing
// since a repair, so that the error cannot be kept); KMB_UNSUPPORTED_VERSION;
// KMB_PANIC.
kmb_status kmb_codec_decode_raster(const uint8_t *bytes,
                                   size_t size,
                                   void *samples,
                                   size_t capacity);

/* ================================================================================================
 * Codecs: the heights of one diamond as bytes
 * ================================================================================================ */

// Codes diamonds: N^2 new heights, the centres of cells, in the knowledge of (N+1)^2 old ones, their
// corners, the vertices.
typedef struct kmb_codec kmb_codec;

// How a codec codes diamonds. Heights are integers in units that the caller chooses.
typedef struct kmb_codec_options {
    // sizeof(kmb_codec_options).
    uint32_t struct_size;
    // N, the cells along a side of a diamond: 16, 32, 64 or 128; 0 for 64.
    uint32_t cells;
    // Least height.
    int32_t minimum;
    // Greatest height.
    int32_t maximum;
    // Largest allowed difference between a decoded centre and the one that was given; 0 for lossless.
    // At most 2^30 - 1.
    uint32_t max_error;
    // A kmb_entropy.
    uint32_t entropy;
} kmb_codec_options;

// Makes a codec of diamonds and gives a handle, which kmb_codec_destroy frees. With KMB_ENTROPY_RANS it codes
// by a standard model, the same for ever in this version of the format, until it gets another one by
// kmb_codec_train or kmb_codec_set_model. Both ends need the same options and the same model.
//
// May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_codec_create(const struct kmb_codec_options *options,
                            struct kmb_codec **codec);

// Frees a codec. NULL is allowed. No other call may use the handle at the same time, or afterwards.
void kmb_codec_destroy(struct kmb_codec *codec);

// Gives the most bytes that kmb_codec_encode_diamond can need, whatever the heights.
//
// May be called with the same codec from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_codec_diamond_bound(const struct kmb_codec *codec, size_t *size);

// Turns the centres of one diamond into bytes, by a prediction from its vertices and the transform
// KMB_TRANSFORM_INTERPOLATING. `vertices` are (N+1)^2 heights, row by row, as the decoder will have
// them; `centres` are N^2 heights, of which that at column i and row j lies amid vertices (i, j) and
// (i + 1, j + 1). `vertex_valid` and `centre_valid` hold one byte for each, 0 for a void; NULL says that
// there is none. A void vertex has a height all the same, any one, which predictions use: the same for
// the decoder. That of a void centre means nothing. `bytes` has room for `capacity` bytes, and `size`
// is the count of bytes written, which may be 0. All memory is the caller's, and none of it is kept.
//
// May be called with the same codec from several threads at once.
//
// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`size` is the capacity that is needed, and nothing else is
// written); KMB_INVALID_ARGUMENT (also for a height outside the codec's range); KMB_PANIC.
kmb_status kmb_codec_encode_diamond(const struct kmb_codec *codec,
                                    const int32_t *vertices,
                                    const uint8_t *vertex_valid,
                                    const int32_t *centres,
                                    const uint8_t *centre_valid,
                                    uint8_t *bytes,
                                    size_t capacity,
                                    size_t *size);

// Turns bytes back into the N^2 centres of a diamond, given its vertices as kmb_codec_encode_diamond
// got them. `centres` has room for N^2 heights. `centre_valid` has room for N^2 bytes, 1 for each centre
// that is valid and 0 for a void, whose height is then its own prediction; or NULL. All memory is the
// caller's.
//
// Bytes from anywhere may be given: they are refused, or lead to other heights within the range.
// `centres` and `centre_valid` are written only with KMB_OK.
//
// May be called with the same codec from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for a vertex outside the codec's range), KMB_DAMAGED,
// KMB_PANIC.
kmb_status kmb_codec_decode_diamond(const struct kmb_codec *codec,
                                    const int32_t *vertices,
                                    const uint8_t *vertex_valid,
                                    const uint8_t *bytes,
                                    size_t size,
                                    int32_t *centres,
                                    uint8_t *centre_valid);

// Trains a model on `count` diamonds, which the codec uses from now on: fewer bytes for diamonds like
// these. `vertices` and `centres` are those of kmb_codec_encode_diamond, one diamond after the other, all
// valid. kmb_codec_model gives the model for a decoder.
//
// Exclusive: no other call may use the codec at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for no diamond, for a height outside the codec's range, and
// for KMB_ENTROPY_GAMMA), KMB_PANIC.
kmb_status kmb_codec_train(struct kmb_codec *codec,
                           size_t count,
                           const int32_t *vertices,
                           const int32_t *centres);

// Gives the codec's trained model as bytes, for kmb_codec_set_model of a codec with the same options.
// `bytes` has room for `capacity` bytes, and may be NULL where that is 0; `size` is the count of bytes
// written.
//
// May be called with the same codec from several threads at once.
//
// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`size` is the capacity that is needed, and nothing else is
// written); KMB_NOT_FOUND (nothing was trained or set); KMB_INVALID_ARGUMENT; KMB_PANIC.
kmb_status kmb_codec_model(const struct kmb_codec *codec,
                           uint8_t *bytes,
                           size_t capacity,
                           size_t *size);

// Makes the codec use a trained model, which kmb_codec_model gave. The bytes are copied.
//
// Exclusive: no other call may use the codec at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for KMB_ENTROPY_GAMMA), KMB_DAMAGED (the bytes are no
// model), KMB_PANIC.
kmb_status kmb_codec_set_model(struct kmb_codec *codec, const uint8_t *bytes, size_t size);

/* ================================================================================================
 * Cities: opening, what is known of them, single blocks
 * ================================================================================================ */

// Stands for no node: the parent of the root, the first child of a leaf, the node of a ray that met
// nothing.
#define KMB_NO_NODE UINT32_MAX

// An open city. Visits made from it share what they need of it, so that it may be closed before
// them.
typedef struct kmb_city kmb_city;

// What is known of a city. Lengths are in the units of its reference system.
typedef struct kmb_city_info {
    // sizeof(kmb_city_info).
    uint32_t struct_size;
    // Texels along a block, K: 32, 64 or 128.
    uint32_t side_texels;
    // Nodes of its quadtree, each with a block. Node 0 is the root.
    uint32_t nodes;
    // Nodes without children.
    uint32_t leaves;
    // Levels of nodes; the root is of level 0.
    uint32_t levels;
    // Bits of its blocks' heights: 8 or 16.
    uint32_t height_bits;
    // West and south edge of its square.
    double corner[2];
    // Length of an edge of it.
    double side;
    // Down to where the prisms over all texels reach: z.
    double floor;
    // Least and greatest height: z.
    double heights[2];
    // Bytes of a block's image: (2 K + 256) K 4.
    uint64_t image_bytes;
    // Bytes of the low halves of a block's heights of 16 bits, K K; 0 where they have 8.
    uint64_t low_height_bytes;
    // Bytes of the file.
    uint64_t bytes;
    // The coordinate reference system: WKT, "EPSG:n", or empty. Lives until the city is closed.
    const char *crs;
} kmb_city_info;

// A square of a city.
typedef struct kmb_city_node {
    // sizeof(kmb_city_node).
    uint32_t struct_size;
    // 0 for the root.
    uint32_t level;
    // Column and row among the squares of its level, from the south-west.
    uint32_t place[2];
    // KMB_NO_NODE for the root.
    uint32_t parent;
    // The first of its four children, which follow each other: south-west, south-east, north-west,
    // north-east. KMB_NO_NODE for a leaf.
    uint32_t first_child;
    // West and south edge.
    double corner[2];
    // Length of an edge. Squares that touch have the same edges, bit for bit.
    double side;
    // Least and greatest height of its block and of all blocks below it: z.
    double heights[2];
    // How far it is from the leaves, as a length that kmb_city_visit_update compares with the tolerance: height_error, or a texel where
    // its colours are wrong.
    double error;
    // Largest difference of its heights from those of its children, at most a texel; at least theirs.
    double height_error;
    // Root of the mean square difference of its roofs' colours from those of its children, of 255; at least theirs.
    double colour_error;
} kmb_city_node;

// A block of a city as an image of (2 K + 256) x K texels, four bytes each, row by row without padding. Row 0 is the
// southernmost, column 0 the westernmost.
//
// Columns 0 to K - 1: height (the high byte of 16 bits), wall column (0 for no wall), and x and y of the roof's unit normal.
// Columns K to 2 K - 1: red, green and blue of the roof or of the ground, and ambient occlusion (255: sees all of the sky).
// Columns 2 K to 2 K + 255: the same of the walls. A component of a normal is (byte - 127) / 127.
//
// The rows are parted into `slices` equal slices of R = K / slices rows. The wall of a texel in row r whose wall column is w has its
// colours in column 2 K + w, upwards from row first = r / R R: at height z in row
// first + min(floor((z - heights[0]) / (heights[1] - heights[0]) (R - 1)), R - 2). In row first + R - 1 it has its mean normal, three bytes.
typedef struct kmb_blockmap {
    // sizeof(kmb_blockmap).
    uint32_t struct_size;
    // Texels along it, K.
    uint32_t side_texels;
    // Slices of its walls: a power of two.
    uint32_t slices;
    // Bits of its heights: 8 or 16.
    uint32_t height_bits;
    // West and south edge.
    double corner[2];
    // Length of an edge.
    double side;
    // Heights of code 0 and of the greatest code, 255 or 65535; codes between are evenly spaced.
    float heights[2];
    // A texel has a wall where it stands more than so much above one of its four neighbours.
    float exposure;
    // Steepest roof, as rise over run: a ray that comes over the edge of a texel with a wall meets it if the step there is
    // higher than roof_slope side / K, and meets a roof otherwise.
    float roof_slope;
    // The image.
    const uint8_t *image;
    // Bytes at `image`.
    size_t image_bytes;
    // The low bytes of 16-bit heights, one a texel, K x K, row by row; NULL where they are not there.
    const uint8_t *low_heights;
    // Bytes at `low_heights`.
    size_t low_height_bytes;
} kmb_blockmap;

// Opens the city at `path` (bytes as the system has them; UTF-8 on Windows) and gives a handle,
// which kmb_city_close frees. `access` is a kmb_access.
//
// Reads the header, the tables and the tree; blocks are read, and their checksums checked, when
// they are used. May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_IO, KMB_INPUT (the repository holds something else),
// KMB_DAMAGED (the file is no repository, or its bytes are not as they were written),
// KMB_UNSUPPORTED_VERSION, KMB_PANIC.
kmb_status kmb_city_open(const char *path, uint32_t access, struct kmb_city **city);

// Frees a city. NULL is allowed. No other call may use the handle at the same time, or afterwards;
// visits made from it stay usable.
void kmb_city_close(struct kmb_city *city);

// Says what is known of a city. The caller sets info->struct_size; its string belongs to the city
// and lives until it is closed.
//
// May be called with the same city from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_city_describe(const struct kmb_city *city, struct kmb_city_info *info);

// Says what is known of node `index`. Children have higher numbers than their parents. The caller
// sets node->struct_size.
//
// May be called with the same city from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_NOT_FOUND (there are not so
// many nodes), KMB_PANIC.
kmb_status kmb_city_node_at(const struct kmb_city *city,
                            uint32_t index,
                            struct kmb_city_node *node);

// Reads and decodes the block of a node into the caller's memory, in one call. `image` has room for `image_length` bytes;
// image_bytes of kmb_city_info are needed. `low_heights` has room for `low_height_length`; low_height_bytes of
// kmb_city_info are needed, or it is NULL: heights of 16 bits are then only as good as their high bytes. `block` may be
// NULL; otherwise the caller sets block->struct_size, and its pointers become those that were passed, low_heights NULL for 8
// bits.
//
// May be called with the same city from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_BUFFER_TOO_SMALL, KMB_NOT_FOUND (there are not so many
// nodes), KMB_IO, KMB_DAMAGED, KMB_PANIC.
kmb_status kmb_city_read(const struct kmb_city *city,
                         uint32_t node,
                         uint8_t *image,
                         size_t image_length,
                         uint8_t *low_heights,
                         size_t low_height_length,
                         struct kmb_blockmap *block);

/* ================================================================================================
 * Visits of a city: from views to blocks, and rays against them
 * ================================================================================================ */

// The blocks that a viewer draws, kept from frame to frame.
typedef struct kmb_city_visit kmb_city_visit;

// What an update did, and what is drawn now.
typedef struct kmb_city_stats {
    // sizeof(kmb_city_stats).
    uint32_t struct_size;
    // 1 where a budget kept out what the tolerance asks for, or blocks have yet to come; else 0.
    uint32_t cut_short;
    // Entries that kmb_city_visit_drawn gives.
    uint64_t drawn;
    // Of these, blocks of which only some quarters are drawn.
    uint64_t partial;
    // Blocks held.
    uint64_t resident;
    // Bytes of these.
    uint64_t bytes;
    // Blocks that came.
    uint64_t loaded;
    // Bytes of these.
    uint64_t upload_bytes;
    // Blocks that went.
    uint64_t dropped;
    // Blocks that should be drawn and have not come.
    uint64_t awaited;
    // Blocks that cannot be read, since the visit was made; the log callback was told each once.
    uint64_t failed;
    // Largest error on the screen of what is drawn, in pixels; may be infinite.
    double largest_error;
    // Time of the update, in microseconds.
    double microseconds;
} kmb_city_stats;

// A block to draw.
typedef struct kmb_city_drawn {
    // sizeof(kmb_city_drawn).
    uint32_t struct_size;
    // Which node's.
    uint32_t node;
    // Which quarters of it: 1 south-west, 2 south-east, 4 north-west, 8 north-east, or their sum. In the
    // others finer blocks are drawn.
    uint32_t quarters;
    // 0.
    uint32_t reserved;
    // Its error on the screen, in pixels; may be infinite.
    double pixels;
} kmb_city_drawn;

// Where a ray meets a city.
typedef struct kmb_city_hit {
    // sizeof(kmb_city_hit).
    uint32_t struct_size;
    // Whose block; KMB_NO_NODE where the ray meets nothing, and then all that follows is 0 but the distance, which is infinite.
    uint32_t node;
    // The place is origin + distance * direction.
    double distance;
    // Column and row of the texel in the block.
    uint32_t texel[2];
    // z of the place.
    float height;
    // 1 for a wall, 0 for a roof or the ground.
    uint32_t is_wall;
    // Unit normal there, about.
    float normal[3];
    // Red, green, blue, and ambient occlusion: 255 sees all of the sky.
    uint8_t colour[4];
} kmb_city_hit;

// Makes a visit of a city and gives a handle, which kmb_city_visit_destroy frees. It holds the root's block from the start, and has
// nothing to draw until its first update. `threads` decode for it, at most 64; with 0, updates decode for themselves, within
// their budgets. The city may be closed before the visit is destroyed.
//
// May be called with the same city from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_IO, KMB_DAMAGED (the root's block), KMB_PANIC.
kmb_status kmb_city_visit_create(const kmb_city *city,
                                 uint32_t threads,
                                 struct kmb_city_visit **visit);

// Frees a visit with its blocks. NULL is allowed. No other call may use the handle at the same
// time, or afterwards.
void kmb_city_visit_destroy(struct kmb_city_visit *visit);

// Finds what to draw of a view, whose world is the city's reference system, and loads what is missing for it within the budget:
// `refinements` limits the blocks that come in this update, `bytes` those held, `upload_bytes` those that come, `patches` the
// entries to draw. `budget` may be NULL: no limits. `stats` may be NULL; otherwise the caller sets stats->struct_size. The view's
// tolerance may be 0 here: the finest blocks.
//
// What is drawn covers all that the frustum meets of the city, each place once, whatever ends the update: where blocks have not
// come, coarser ones are drawn. With a still view and the same budget it settles. Ends the life of what kmb_city_visit_drawn,
// kmb_city_visit_added, kmb_city_visit_removed and kmb_city_visit_block gave before.
//
// A terrain and a city are drawn under one budget by kmb_cut_update with the budget, kmb_budget_rest, and kmb_city_visit_update with the
// rest.
//
// Exclusive: no other call may use the visit at the same time.
//
// Returns KMB_OK; KMB_BUDGET_TOO_SMALL (the budget does not hold the root's block: it is drawn all the same, and `stats` is
// written); KMB_INVALID_ARGUMENT (also for a view with a number that is not finite, with an empty viewport, or with a tolerance
// below 0: the visit stays as it was); KMB_INVALID_STRUCT_SIZE; KMB_PANIC. A block that cannot be read is no failure: coarser ones
// are drawn there, and the log callback is told once.
kmb_status kmb_city_visit_update(struct kmb_city_visit *visit,
                                 const kmb_view *view,
                                 const kmb_budget *budget,
                                 struct kmb_city_stats *stats);

// Gives what an update of a cut left of a budget, for an update of a visit in the same frame: each limit less what `used` tells of it,
// at least 0; KMB_UNLIMITED stays. With a `bytes` of 0 left the city's coarsest block is still drawn. The caller sets
// rest->struct_size; `rest` may be `budget`.
//
// May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_budget_rest(const kmb_budget *budget,
                           const kmb_stats *used,
                           kmb_budget *rest);

// Gives what to draw, front to back. The array belongs to the visit and lives until its next update or its end.
//
// May be called with the same visit from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_city_visit_drawn(const struct kmb_city_visit *visit,
                                const struct kmb_city_drawn **drawn,
                                size_t *count);

// Gives the nodes whose blocks came with the last update; that of the root came with
// the first. With
// kmb_city_visit_removed, a GPU cache is a map from nodes to textures. The array belongs to the
// visit and lives until its next update or its end.
//
// May be called with the same visit from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_city_visit_added(const struct kmb_city_visit *visit,
                                const uint32_t **nodes,
                                size_t *count);

// Gives the nodes whose blocks went with the last update: those that came in one before. The array
// belongs to the visit and lives until its next update or its end.
//
// May be called with the same visit from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_city_visit_removed(const struct kmb_city_visit *visit,
                                  const uint32_t **nodes,
                                  size_t *count);

// Gives the block of a node that the visit holds: all that are drawn, and others. The caller sets
// block->struct_size; the image and the low heights belong to the visit and live until its next
// update or its end.
//
// May be called with the same visit from several threads at once, not during an update.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_NOT_FOUND (it is not held),
// KMB_PANIC.
kmb_status kmb_city_visit_block(const struct kmb_city_visit *visit,
                                uint32_t node,
                                kmb_blockmap *block);

// Gives the nearest place at which each of `count` rays, in the city's reference system, meets what the visit draws. `rays` has `count`
// rays, all with their struct_size; `hits` has room for as many, and the caller sets hits[0].struct_size. A ray from outside
// does not slip between two blocks, of whatever levels; outside the view's frustum it may meet nothing. After an update with a tolerance of 0, without limits, and with a view of
// the whole city, these are the finest blocks of all of it.
//
// The first ray that comes to a block makes it ready, which takes as long as some thousand rays, for all that come before the next update; until
// then it holds 4 more bytes a texel of its heights, which no budget counts. Neighbours in `rays` that go almost the same way, as the pixels of
// a row do, are cast several times as fast as others.
//
// May be called with the same visit from several threads at once, not during an update.
//
// Returns KMB_OK (also where rays meet nothing); KMB_INVALID_ARGUMENT (also for numbers that are not finite but `longest`, no
// direction, or a `longest` below 0); KMB_INVALID_STRUCT_SIZE; KMB_PANIC.
kmb_status kmb_city_visit_cast(const struct kmb_city_visit *visit,
                               size_t count,
                               const kmb_ray *rays,
                               struct kmb_city_hit *hits);

/* ================================================================================================
 * City builders: from triangles and files to cities
 * ================================================================================================ */

// What is painted on triangles.
typedef enum kmb_paint_kind {
    // One colour.
    KMB_PAINT_PLAIN = 0,
    // A texture of the builder, which repeats. Its coordinates are 0, 0 at the image's lower left corner and 1, 1 at
    // its upper right one.
    KMB_PAINT_TEXTURE = 1,
    // A facade that is made up. Its coordinates count windows along the wall, and storeys above the ground.
    KMB_PAINT_FACADE = 2,
} kmb_paint_kind;

// A city in the making: triangles, textures, the ground, and how to build it.
typedef struct kmb_city_builder kmb_city_builder;

// How to build a city. What is 0 stands for what no options stand for.
typedef struct kmb_city_options {
    // sizeof(kmb_city_options).
    uint32_t struct_size;
    // Texels along a block: 32, 64 or 128; 0 for 128.
    uint32_t side_texels;
    // Views of a block from which its walls are taken, 1 to 4096; 0 for 64.
    uint32_t views;
    // Bits of heights: 8 or 16; 0 for 8.
    uint32_t height_bits;
    // Edge of the finest blocks, at most, 1 to 4096 metres; 0 for 64.
    double leaf_side;
    // Steps higher than this, in metres, are walls; 0 for 1.5.
    double exposure;
    // Threads to use, or 0 for one a core. The file does not depend on it.
    uint32_t threads;
    // Memory that triangles and textures may take, in MiB; 0 for no limit.
    uint32_t memory;
    // 1 where buildings of files without textures and colours get facades that are made up; else 0: they are plain.
    uint32_t has_facades;
    // The seed of these facades.
    uint32_t facades;
    // Red, green, blue of bare ground; 0, 0, 0 for a grey. The fourth is 0.
    uint8_t ground_colour[4];
    // 0.
    uint32_t reserved;
} kmb_city_options;

// Paint for triangles.
typedef struct kmb_city_paint {
    // sizeof(kmb_city_paint).
    uint32_t struct_size;
    // A kmb_paint_kind.
    uint32_t kind;
    // For KMB_PAINT_PLAIN: red, green, blue. The fourth is 0.
    uint8_t colour[4];
    // For KMB_PAINT_TEXTURE: what kmb_city_builder_add_texture gave.
    uint32_t texture;
    // For KMB_PAINT_FACADE: tells the facade of one building from that of another.
    uint32_t seed;
    // 0.
    uint32_t reserved;
    // But for KMB_PAINT_PLAIN: 6 floats for each triangle, two for each corner.
    const float *coordinates;
} kmb_city_paint;

// Gives the height z of the ground at x, y, in the city's reference system, and answers 0; or answers anything else where there is
// none, so that the plane's is taken. Calls come one after the other, from any thread. Nothing may unwind out of it.
typedef int32_t (*kmb_ground_callback)(void *user, double x, double y, double *height);

// What was built.
typedef struct kmb_city_report {
    // sizeof(kmb_city_report).
    uint32_t struct_size;
    // Levels of blocks.
    uint32_t levels;
    // Blocks.
    uint64_t blocks;
    // Those made from triangles; the others are made from four finer ones.
    uint64_t leaves;
    // Triangles that it was built from.
    uint64_t triangles;
    // Bytes of the file.
    uint64_t bytes;
    // Texels of walls in the leaves.
    uint64_t wall_texels;
    // Of these, those that share another's wall column, as there are no more.
    uint64_t unassigned_wall_texels;
    // Pixels of all views that see the leaves' triangles.
    uint64_t seen_pixels;
    // Of these, those whose surface lies more than 2.5 texels behind the prisms: under bridges and overhangs.
    uint64_t hidden_pixels;
} kmb_city_report;

// Makes a builder of a city and gives a handle, which kmb_city_builder_destroy frees. `options` may be NULL. It begins without
// triangles, and on a plane through the lowest of their corners.
//
// May be called from any thread at any time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for options out of range), KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_city_builder_create(const struct kmb_city_options *options,
                                   struct kmb_city_builder **builder);

// Frees a builder of a city. NULL is allowed. No other call may use the handle at the same time, or
// afterwards.
void kmb_city_builder_destroy(struct kmb_city_builder *builder);

// Adds an image of width x height pixels, 3 bytes each (red, green, blue), row by row without padding, the uppermost first, and
// gives its number. The bytes are copied.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for an image without pixels, or one beyond the memory), KMB_PANIC.
kmb_status kmb_city_builder_add_texture(struct kmb_city_builder *builder,
                                        uint32_t width,
                                        uint32_t height,
                                        const uint8_t *rgb,
                                        uint32_t *texture);

// Adds `count` triangles, 9 doubles each: x, y, z of three corners, in metres, x east, y north, z up. `paint` may be NULL: a light
// grey. They may be open, overlap, repeat and have no area; both their sides are seen. All is copied.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for coordinates that are not finite or immensely large, an unknown texture, and more
// triangles than the memory holds; none is added then), KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
kmb_status kmb_city_builder_add_triangles(struct kmb_city_builder *builder,
                                          size_t count,
                                          const double *corners,
                                          const struct kmb_city_paint *paint);

// Adds the triangles of a file, with their textures: CityJSON (.json, .jsonl), OBJ (.obj) or glTF (.gltf, .glb), as its extension
// says; and its reference system, if the builder has none. What can be left out, such as an image that is not there, is: the log
// callback is told, and kmb_city_builder_warnings counts it.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a file of more triangles than the memory holds); KMB_IO; KMB_INPUT (the file is not
// what its extension says, has no triangle, or another reference system than the builder); KMB_PANIC. Nothing is added then.
kmb_status kmb_city_builder_add_file(struct kmb_city_builder *builder,
                                     const char *path);

// Tells how many warnings the files that were added gave.
//
// May be called with the same builder from several threads at once.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_city_builder_warnings(const struct kmb_city_builder *builder, uint64_t *count);

// Names the coordinate reference system, which is metric: WKT, "EPSG:n", or empty for none. The string is copied.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
kmb_status kmb_city_builder_set_crs(struct kmb_city_builder *builder,
                                    const char *crs);

// Puts the city on a plane of this height; squares without triangles then stay coarse. Where there is a callback too, the plane is where
// it gives no height.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for a height that is not finite or immense), KMB_PANIC.
kmb_status kmb_city_builder_set_plane(struct kmb_city_builder *builder,
                                      double height);

// Puts the city on a ground that `ground` tells with `user`, for as long as the builder builds; NULL takes it away. `spacing` is about the
// distance, in metres, from one of its samples to the next; in between it is interpolated.
//
// Exclusive: no other call may use the builder at the same time.
//
// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for a spacing that is not finite or not above 0), KMB_PANIC.
kmb_status kmb_city_builder_set_ground(struct kmb_city_builder *builder,
                                       kmb_ground_callback ground,
                                       void *user,
                                       double spacing);

// Builds the city at `path`, and reports what it made. `progress` may be NULL; so may `report`, otherwise the caller sets
// report->struct_size. The file appears under its name only when it is whole, in place of what was there; after any failure
// nothing is left of it. The builder may be used again.
//
// Exclusive: no other call may use the builder at the same time, the callbacks included.
//
// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a builder without triangles, and a city of too many blocks);
// KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_CANCELLED; KMB_PANIC.
kmb_status kmb_city_builder_build(struct kmb_city_builder *builder,
                                  const char *path,
                                  kmb_progress_callback progress,
                                  void *progress_user,
                                  struct kmb_city_report *report);
#ifdef __cplusplus
}
#endif

#endif /* KIMBERLITE_H */
