//! Patches of a cut.

use std::sync::Arc;

use super::boundary::{SizedStruct, boundary, output_struct, required};
use super::status::kmb_status;
use crate::cut::Patch;

/// One right triangle of terrain as vertices; it never changes.
// C's name for a `Patch` in an `Arc`; only pointers to it exist.
pub struct kmb_patch {
    _only_behind_pointers: (),
}

impl kmb_patch {
    /// The patch as C sees it; it counts no reference.
    pub(super) fn shown(patch: &Arc<Patch>) -> *const kmb_patch {
        Arc::as_ptr(patch).cast()
    }
}

/// What a patch consists of. The pointers live as long as the patch.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_patch_info {
    /// sizeof(kmb_patch_info).
    pub struct_size: u32,
    /// Level of its diamond: 0 for the coarsest, one more for each bisection.
    pub level: u32,
    /// Number of this patch within its cut; never used again for another.
    pub handle: u64,
    /// Centre of its diamond on the lattice (along columns, along rows, 0): its identifier in every
    /// cut.
    pub diamond: [i32; 3],
    /// Which half of the diamond it is: 0 or 1.
    pub half: u32,
    /// 1 where it uses the shared triangles of its cut, 0 where it has its own.
    pub complete: u32,
    /// Texels along a side of its texture; 0 where it has none.
    pub texture_side: u32,
    /// Grid coordinates (column, row, height unit) that its vertices are relative to: integers.
    pub origin: [f64; 3],
    /// Grid steps (columns, rows) of p, in legs[0], and of q, in legs[1].
    pub legs: [[f32; 2]; 2],
    /// World positions of the right angle, of the end of p, and of the end of q.
    pub corners: [[f64; 3]; 3],
    /// Least and greatest world x, y, z of its vertices.
    pub bounds: [[f64; 3]; 2],
    /// Largest height difference to the finest surface, in world z units; may be infinite.
    pub error: f64,
    /// Its vertices, in the form that the cut was made for.
    pub vertices: *const f32,
    /// Floats at `vertices`.
    pub vertex_floats: usize,
    /// Its own list of triangles, three vertex indices each, where `complete` is 0; else NULL.
    pub indices: *const u16,
    /// Indices at `indices`; 0 where `complete` is 1, or where it has no triangle.
    pub index_count: usize,
    /// Its colours in the form that the cut was made for; NULL without colours.
    pub colours: *const u8,
    /// Bytes at `colours`.
    pub colour_bytes: usize,
    /// Texture coordinates, 0 to 1, of the right angle, of the end of p and of the end of q, in the middles of their
    /// texels: the first along a row of the texture. Those of vertices lie evenly between.
    pub texture_corners: [[f32; 2]; 3],
    /// Where its vertices came from, 2 floats each: the height, relative to the patch's origin in height units, of the
    /// middle of the edge that the vertex divided when it came; and the level of the diamonds that first had it. All
    /// patches that share a vertex tell the same of it, so that what blends from one height to the other by this level
    /// and the vertex's place has no cracks. NULL where the cut was not made for it.
    pub births: *const f32,
}

// SAFETY: repr(C) with struct_size first, and integers, floats and raw pointers only.
unsafe impl SizedStruct for kmb_patch_info {
    const NAME: &'static str = "kmb_patch_info";
}

/// Says what a patch consists of. The caller sets info->struct_size; the arrays belong to the patch
/// and live as long.
///
/// May be called from any thread while the patch lives.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_patch_describe(
    patch: *const kmb_patch,
    info: *mut kmb_patch_info,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (patch, out) = unsafe {
            (
                required(patch.cast::<Patch>(), "patch")?,
                output_struct(info)?,
            )
        };
        let indices = patch.indices.as_deref();
        let colours = patch.colours.as_ref();
        let births = patch.births.as_deref();
        out.write(kmb_patch_info {
            struct_size: size_of::<kmb_patch_info>() as u32,
            level: patch.level,
            handle: patch.handle,
            diamond: [patch.diamond.x, patch.diamond.y, patch.diamond.z],
            half: u32::from(patch.half),
            complete: u32::from(indices.is_none()),
            texture_side: colours.map_or(0, |colours| colours.texture_side as u32),
            origin: patch.origin,
            legs: patch.legs,
            corners: patch.corners,
            bounds: patch.bounds,
            error: patch.error,
            vertices: patch.vertices.as_ptr(),
            vertex_floats: patch.vertices.len(),
            indices: indices.map_or(std::ptr::null(), <[u16]>::as_ptr),
            index_count: indices.map_or(0, <[u16]>::len),
            colours: colours.map_or(std::ptr::null(), |colours| colours.bytes.as_ptr()),
            colour_bytes: colours.map_or(0, |colours| colours.bytes.len()),
            texture_corners: colours.map_or([[0.0; 2]; 3], |colours| colours.texture_corners),
            births: births.map_or(std::ptr::null(), |births| births.as_ptr().cast()),
        });
        Ok(())
    })
}

/// Keeps a patch alive until a kmb_patch_release, beyond its cut's next update and its cut's end.
/// It must be alive when this is called.
///
/// May be called from any thread.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_patch_retain(patch: *const kmb_patch) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes NULL or a patch that lives.
        unsafe { required(patch.cast::<Patch>(), "patch") }?;
        // SAFETY: a patch that C sees is that of an `Arc`, which lives.
        unsafe { Arc::increment_strong_count(patch.cast::<Patch>()) };
        Ok(())
    })
}

/// Undoes one kmb_patch_retain; the patch may end with it. NULL is allowed.
///
/// May be called from any thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_patch_release(patch: *const kmb_patch) {
    let _ = boundary!({
        if !patch.is_null() {
            // SAFETY: the caller undoes one kmb_patch_retain, which counted a reference.
            unsafe { Arc::decrement_strong_count(patch.cast::<Patch>()) };
        }
        Ok(())
    });
}
