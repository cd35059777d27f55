//! Sizes, offsets and numbers that C programs are compiled with, as 64-bit machines have them;
//! `ffi_tests/layout.c` asserts the same.

#![cfg(target_pointer_width = "64")]

use std::mem::offset_of;

use kimberlite::ffi::builder::{kmb_build_report, kmb_builder_options, kmb_entropy, kmb_transform};
use kimberlite::ffi::city::{KMB_NO_NODE, kmb_blockmap, kmb_city_info, kmb_city_node};
use kimberlite::ffi::city_builder::{
    kmb_city_options, kmb_city_paint, kmb_city_report, kmb_paint_kind,
};
use kimberlite::ffi::city_visit::{kmb_city_drawn, kmb_city_hit, kmb_city_stats};
use kimberlite::ffi::codec::kmb_codec_options;
use kimberlite::ffi::cut::{
    kmb_budget, kmb_colour_form, kmb_cut_options, kmb_grid_to_world, kmb_stats, kmb_vertex_form,
    kmb_view,
};
use kimberlite::ffi::patch::kmb_patch_info;
use kimberlite::ffi::profile::{kmb_area, kmb_profile_place};
use kimberlite::ffi::query::{KMB_UNLIMITED, kmb_height};
use kimberlite::ffi::raster::{kmb_raster_info, kmb_raster_options};
use kimberlite::ffi::ray::{kmb_hit, kmb_ray};
use kimberlite::ffi::repair::kmb_repair_report;
use kimberlite::ffi::repository::{
    kmb_access, kmb_kind, kmb_open_options, kmb_registration, kmb_repository_info, kmb_sample_type,
};
use kimberlite::ffi::status::{KMB_ABI_VERSION, kmb_log_level, kmb_status};
use kimberlite::ffi::update::{kmb_update_options, kmb_update_report};

macro_rules! layout {
    ($type:ident, $size:literal, $($member:ident $offset:literal),+) => {
        assert_eq!(size_of::<$type>(), $size, stringify!($type));
        $(assert_eq!(offset_of!($type, $member), $offset, stringify!($type.$member));)+
    };
}

#[test]
fn structs_lie_as_c_programs_were_compiled() {
    layout!(kmb_open_options, 16, struct_size 0, access 4, shared_bytes 8);
    layout!(
        kmb_repository_info, 256, struct_size 0, kind 4, width 8, height 12, cells 16, levels 20,
        diamonds 24, samples 32, void_samples 40, bytes 48, max_error 56, max_error_bound 64,
        rms_error 72, lossless 80, sample_type 84, sample_min 88, sample_max 96, value_scale 104,
        value_offset 112, nodata 120, has_nodata 128, georeferenced 132, geographic 136,
        registration 140, geotransform 144, world_origin 192, world_step 208, crs 224, units 232,
        metadata_count 240, bands 248, missing_detail 252
    );
    layout!(
        kmb_update_options, 40, struct_size 0, column 4, row 8, width 12, height 16, rows_are_whole 20,
        memory 24, threads 28, rms_error 32
    );
    layout!(
        kmb_update_report, 32, struct_size 0, reserved 4, diamonds_recomputed 8, diamonds 16, bytes 24
    );
    layout!(
        kmb_repair_report, 64, struct_size 0, coarsest_level 4, damaged_blocks 8, lost_blocks 16,
        missing_blocks 24, blocked_blocks 32, coarse_samples 40, coarse_percent 48, bytes 56
    );
    layout!(kmb_height, 24, struct_size 0, level 4, height 8, error_bound 16);
    layout!(
        kmb_patch_info, 288, struct_size 0, level 4, handle 8, diamond 16, half 28, complete 32,
        texture_side 36, origin 40, legs 64, corners 80, bounds 152, error 200, vertices 208,
        vertex_floats 216, indices 224, index_count 232, colours 240, colour_bytes 248,
        texture_corners 256, births 280
    );
    layout!(
        kmb_cut_options, 56, struct_size 0, vertex_form 4, metric 8, threads 12, colours 16,
        colour_form 24, births 28, texel_pixels 32, detail_levels 40, reserved 44, roughness 48
    );
    layout!(
        kmb_view, 184, struct_size 0, reserved 4, eye 8, world_to_clip 32, viewport 160, tolerance
        176
    );
    layout!(
        kmb_budget, 48, struct_size 0, reserved 4, microseconds 8, refinements 16, bytes 24,
        upload_bytes 32, patches 40
    );
    layout!(
        kmb_stats, 112, struct_size 0, cut_short 4, refined 8, coarsened 16, patches 24, triangles
        32, added 40, removed 48, bytes 56, late_refinements 64, largest_error 72,
        fixed_microseconds 80, microseconds 88, awaited 96, upload_bytes 104
    );
    layout!(kmb_ray, 64, struct_size 0, reserved 4, origin 8, direction 32, longest 56);
    layout!(kmb_hit, 40, struct_size 0, level 4, distance 8, place 16);
    layout!(
        kmb_profile_place, 48, struct_size 0, level 4, distance 8, place 16, height 32, error_bound 40
    );
    layout!(
        kmb_area, 48, struct_size 0, level 4, minimum 8, maximum 16, mean 24, area 32, error_bound 40
    );
    layout!(kmb_grid_to_world, 56, struct_size 0, reserved 4, origin 8, step 32);
    layout!(
        kmb_builder_options, 56, struct_size 0, sample_type 4, width 8, height 12, max_error 16,
        cells 24, threads 28, transform 32, entropy 36, rms_error 40,
        bands 48, memory 52
    );
    layout!(
        kmb_build_report, 48, struct_size 0, reserved 4, samples 8, void_samples 16, bytes 24,
        max_error 32, rms_error 40
    );
    layout!(
        kmb_codec_options, 24, struct_size 0, cells 4, minimum 8, maximum 12, max_error 16,
        entropy 20
    );
    layout!(
        kmb_raster_options, 64, struct_size 0, sample_type 4, width 8, height 12, max_error 16,
        rms_error 24, nodata 32, has_nodata 40, cells 44, transform 48, entropy 52, threads 56,
        reserved 60
    );
    layout!(
        kmb_raster_info, 104, struct_size 0, sample_type 4, width 8, height 12, samples 16,
        void_samples 24, sample_bytes 32, lossless 36, max_error 40, max_error_bound 48, rms_error
        56, sample_min 64, sample_max 72, nodata 80, has_nodata 88, cells 92, transform 96, entropy
        100
    );
}

#[test]
fn structs_of_cities_lie_as_c_programs_were_compiled() {
    layout!(
        kmb_city_info, 104, struct_size 0, side_texels 4, nodes 8, leaves 12, levels 16, height_bits
        20, corner 24, side 40, floor 48, heights 56, image_bytes 72, low_height_bytes 80, bytes 88,
        crs 96
    );
    layout!(
        kmb_city_node, 88, struct_size 0, level 4, place 8, parent 16, first_child 20, corner 24,
        side 40, heights 48, error 64, height_error 72, colour_error 80
    );
    layout!(
        kmb_blockmap, 88, struct_size 0, side_texels 4, slices 8, height_bits 12, corner 16, side
        32, heights 40, exposure 48, roof_slope 52, image 56, image_bytes 64, low_heights 72,
        low_height_bytes 80
    );
    layout!(
        kmb_city_drawn, 24, struct_size 0, node 4, quarters 8, reserved 12, pixels 16
    );
    layout!(
        kmb_city_stats, 96, struct_size 0, cut_short 4, drawn 8, partial 16, resident 24, bytes 32,
        loaded 40, upload_bytes 48, dropped 56, awaited 64, failed 72, largest_error 80,
        microseconds 88
    );
    layout!(
        kmb_city_hit, 48, struct_size 0, node 4, distance 8, texel 16, height 24, is_wall 28, normal
        32, colour 44
    );
    layout!(
        kmb_city_options, 56, struct_size 0, side_texels 4, views 8, height_bits 12, leaf_side 16,
        exposure 24, threads 32, memory 36, has_facades 40, facades 44, ground_colour 48, reserved
        52
    );
    layout!(
        kmb_city_paint, 32, struct_size 0, kind 4, colour 8, texture 12, seed 16, reserved 20,
        coordinates 24
    );
    layout!(
        kmb_city_report, 72, struct_size 0, levels 4, blocks 8, leaves 16, triangles 24, bytes 32,
        wall_texels 40, unassigned_wall_texels 48, seen_pixels 56, hidden_pixels 64
    );
}

macro_rules! numbers {
    ($type:ident, $($name:ident $number:literal),+) => {
        $(assert_eq!($type::$name as u32, $number, stringify!($name));)+
    };
}

#[test]
fn constants_are_those_that_c_programs_were_compiled_with() {
    assert_eq!(size_of::<kmb_status>(), 4);
    assert_eq!(KMB_UNLIMITED, u64::MAX);
    assert_eq!(KMB_ABI_VERSION, 0);
    numbers!(
        kmb_status, KMB_OK 0, KMB_INVALID_ARGUMENT 1, KMB_INVALID_STRUCT_SIZE 2, KMB_IO 3, KMB_INPUT
        4, KMB_DAMAGED 5, KMB_UNSUPPORTED_VERSION 6, KMB_CANCELLED 7, KMB_OUTSIDE 8,
        KMB_BUDGET_TOO_SMALL 9, KMB_NOT_FOUND 10, KMB_PANIC 11,
        KMB_BUFFER_TOO_SMALL 12
    );
    numbers!(kmb_log_level, KMB_LOG_INFO 0, KMB_LOG_WARNING 1);
    numbers!(kmb_kind, KMB_KIND_HEIGHTS 0, KMB_KIND_COLOURS 1, KMB_KIND_CITY 2);
    numbers!(kmb_access, KMB_ACCESS_MAP 0, KMB_ACCESS_POSITIONED 1);
    numbers!(
        kmb_sample_type, KMB_SAMPLE_U8 0, KMB_SAMPLE_I8 1, KMB_SAMPLE_U16 2, KMB_SAMPLE_I16 3,
        KMB_SAMPLE_U32 4, KMB_SAMPLE_I32 5, KMB_SAMPLE_F32 6, KMB_SAMPLE_F64 7
    );
    numbers!(kmb_registration, KMB_REGISTRATION_AREA 0, KMB_REGISTRATION_POINT 1);
    numbers!(kmb_vertex_form, KMB_VERTEX_COMPACT 0, KMB_VERTEX_EXPANDED 1);
    numbers!(kmb_colour_form, KMB_COLOUR_TEXTURE 0, KMB_COLOUR_VERTICES 1);
    numbers!(
        kmb_transform, KMB_TRANSFORM_INTERPOLATING 0, KMB_TRANSFORM_LIFTED 1,
        KMB_TRANSFORM_TWO_STAGE 2
    );
    assert_eq!(KMB_NO_NODE, u32::MAX);
    numbers!(
        kmb_paint_kind, KMB_PAINT_PLAIN 0, KMB_PAINT_TEXTURE 1, KMB_PAINT_FACADE 2
    );
    numbers!(kmb_entropy, KMB_ENTROPY_RANS 0, KMB_ENTROPY_GAMMA 1);
}
