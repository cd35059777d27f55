/* Sizes, offsets and numbers that programs are compiled with, as 64-bit machines have them; tests/abi.rs asserts the same. */
#include <stddef.h>

#include "check.h"

#define SIZE(type, bytes) CHECK(sizeof(type) == (bytes))
#define AT(type, member, bytes) CHECK(offsetof(type, member) == (bytes))

static void structs(void)
{
    SIZE(kmb_open_options, 8);
    AT(kmb_open_options, struct_size, 0);
    AT(kmb_open_options, access, 4);
    SIZE(kmb_repository_info, 256);
    AT(kmb_repository_info, struct_size, 0);
    AT(kmb_repository_info, kind, 4);
    AT(kmb_repository_info, width, 8);
    AT(kmb_repository_info, height, 12);
    AT(kmb_repository_info, cells, 16);
    AT(kmb_repository_info, levels, 20);
    AT(kmb_repository_info, diamonds, 24);
    AT(kmb_repository_info, samples, 32);
    AT(kmb_repository_info, void_samples, 40);
    AT(kmb_repository_info, bytes, 48);
    AT(kmb_repository_info, max_error, 56);
    AT(kmb_repository_info, max_error_bound, 64);
    AT(kmb_repository_info, rms_error, 72);
    AT(kmb_repository_info, lossless, 80);
    AT(kmb_repository_info, sample_type, 84);
    AT(kmb_repository_info, sample_min, 88);
    AT(kmb_repository_info, sample_max, 96);
    AT(kmb_repository_info, value_scale, 104);
    AT(kmb_repository_info, value_offset, 112);
    AT(kmb_repository_info, nodata, 120);
    AT(kmb_repository_info, has_nodata, 128);
    AT(kmb_repository_info, georeferenced, 132);
    AT(kmb_repository_info, geographic, 136);
    AT(kmb_repository_info, registration, 140);
    AT(kmb_repository_info, geotransform, 144);
    AT(kmb_repository_info, world_origin, 192);
    AT(kmb_repository_info, world_step, 208);
    AT(kmb_repository_info, crs, 224);
    AT(kmb_repository_info, units, 232);
    AT(kmb_repository_info, metadata_count, 240);
    AT(kmb_repository_info, bands, 248);
    AT(kmb_repository_info, reserved, 252);
    SIZE(kmb_height, 24);
    AT(kmb_height, struct_size, 0);
    AT(kmb_height, level, 4);
    AT(kmb_height, height, 8);
    AT(kmb_height, error_bound, 16);
    SIZE(kmb_patch_info, 240);
    AT(kmb_patch_info, struct_size, 0);
    AT(kmb_patch_info, level, 4);
    AT(kmb_patch_info, handle, 8);
    AT(kmb_patch_info, diamond, 16);
    AT(kmb_patch_info, half, 28);
    AT(kmb_patch_info, complete, 32);
    AT(kmb_patch_info, reserved, 36);
    AT(kmb_patch_info, origin, 40);
    AT(kmb_patch_info, legs, 64);
    AT(kmb_patch_info, corners, 80);
    AT(kmb_patch_info, bounds, 152);
    AT(kmb_patch_info, error, 200);
    AT(kmb_patch_info, vertices, 208);
    AT(kmb_patch_info, vertex_floats, 216);
    AT(kmb_patch_info, indices, 224);
    AT(kmb_patch_info, index_count, 232);
    SIZE(kmb_cut_options, 8);
    AT(kmb_cut_options, struct_size, 0);
    AT(kmb_cut_options, vertex_form, 4);
    SIZE(kmb_view, 184);
    AT(kmb_view, struct_size, 0);
    AT(kmb_view, reserved, 4);
    AT(kmb_view, eye, 8);
    AT(kmb_view, world_to_clip, 32);
    AT(kmb_view, viewport, 160);
    AT(kmb_view, tolerance, 176);
    SIZE(kmb_budget, 48);
    AT(kmb_budget, struct_size, 0);
    AT(kmb_budget, reserved, 4);
    AT(kmb_budget, microseconds, 8);
    AT(kmb_budget, refinements, 16);
    AT(kmb_budget, bytes, 24);
    AT(kmb_budget, upload_bytes, 32);
    AT(kmb_budget, patches, 40);
    SIZE(kmb_stats, 96);
    AT(kmb_stats, struct_size, 0);
    AT(kmb_stats, cut_short, 4);
    AT(kmb_stats, refined, 8);
    AT(kmb_stats, coarsened, 16);
    AT(kmb_stats, patches, 24);
    AT(kmb_stats, triangles, 32);
    AT(kmb_stats, added, 40);
    AT(kmb_stats, removed, 48);
    AT(kmb_stats, bytes, 56);
    AT(kmb_stats, late_refinements, 64);
    AT(kmb_stats, largest_error, 72);
    AT(kmb_stats, fixed_microseconds, 80);
    AT(kmb_stats, microseconds, 88);
    SIZE(kmb_grid_to_world, 56);
    AT(kmb_grid_to_world, struct_size, 0);
    AT(kmb_grid_to_world, reserved, 4);
    AT(kmb_grid_to_world, origin, 8);
    AT(kmb_grid_to_world, step, 32);
    SIZE(kmb_builder_options, 56);
    AT(kmb_builder_options, struct_size, 0);
    AT(kmb_builder_options, sample_type, 4);
    AT(kmb_builder_options, width, 8);
    AT(kmb_builder_options, height, 12);
    AT(kmb_builder_options, max_error, 16);
    AT(kmb_builder_options, cells, 24);
    AT(kmb_builder_options, threads, 28);
    AT(kmb_builder_options, transform, 32);
    AT(kmb_builder_options, entropy, 36);
    AT(kmb_builder_options, rms_error, 40);
    AT(kmb_builder_options, bands, 48);
    AT(kmb_builder_options, reserved, 52);
    SIZE(kmb_build_report, 48);
    AT(kmb_build_report, struct_size, 0);
    AT(kmb_build_report, reserved, 4);
    AT(kmb_build_report, samples, 8);
    AT(kmb_build_report, void_samples, 16);
    AT(kmb_build_report, bytes, 24);
    AT(kmb_build_report, max_error, 32);
    AT(kmb_build_report, rms_error, 40);
}

static void numbers(void)
{
    CHECK(sizeof(kmb_status) == 4);
    CHECK(KMB_UNLIMITED == UINT64_MAX);
    CHECK(KMB_ABI_VERSION == 0);
    CHECK(KMB_OK == 0);
    CHECK(KMB_INVALID_ARGUMENT == 1);
    CHECK(KMB_INVALID_STRUCT_SIZE == 2);
    CHECK(KMB_IO == 3);
    CHECK(KMB_INPUT == 4);
    CHECK(KMB_DAMAGED == 5);
    CHECK(KMB_UNSUPPORTED_VERSION == 6);
    CHECK(KMB_CANCELLED == 7);
    CHECK(KMB_OUTSIDE == 8);
    CHECK(KMB_BUDGET_TOO_SMALL == 9);
    CHECK(KMB_NOT_FOUND == 10);
    CHECK(KMB_PANIC == 11);
    CHECK(KMB_LOG_INFO == 0);
    CHECK(KMB_LOG_WARNING == 1);
    CHECK(KMB_KIND_HEIGHTS == 0);
    CHECK(KMB_KIND_COLOURS == 1);
    CHECK(KMB_KIND_CITY == 2);
    CHECK(KMB_ACCESS_MAP == 0);
    CHECK(KMB_ACCESS_POSITIONED == 1);
    CHECK(KMB_SAMPLE_U8 == 0);
    CHECK(KMB_SAMPLE_I8 == 1);
    CHECK(KMB_SAMPLE_U16 == 2);
    CHECK(KMB_SAMPLE_I16 == 3);
    CHECK(KMB_SAMPLE_U32 == 4);
    CHECK(KMB_SAMPLE_I32 == 5);
    CHECK(KMB_SAMPLE_F32 == 6);
    CHECK(KMB_SAMPLE_F64 == 7);
    CHECK(KMB_REGISTRATION_AREA == 0);
    CHECK(KMB_REGISTRATION_POINT == 1);
    CHECK(KMB_VERTEX_COMPACT == 0);
    CHECK(KMB_VERTEX_EXPANDED == 1);
    CHECK(KMB_TRANSFORM_INTERPOLATING == 0);
    CHECK(KMB_TRANSFORM_LIFTED == 1);
    CHECK(KMB_TRANSFORM_TWO_STAGE == 2);
}

int main(void)
{
    structs();
    numbers();
    CHECK(kmb_abi_version() == KMB_ABI_VERSION);
    return 0;
}
