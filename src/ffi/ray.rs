//! Rays and lines of sight.

use super::boundary::{Failure, SizedStruct, array, boundary, input_struct, output, output_struct};
use super::query::kmb_query;
use super::status::kmb_status;
use crate::cut::Ray;

/// A half line, or a part of one, in world coordinates.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_ray {
    /// sizeof(kmb_ray).
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Where it begins.
    pub origin: [f64; 3],
    /// Where it goes; of any length above 0.
    pub direction: [f64; 3],
    /// It ends at origin + longest * direction; may be infinite.
    pub longest: f64,
}

/// Where a ray meets the surface.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_hit {
    /// sizeof(kmb_hit).
    pub struct_size: u32,
    /// Level of the triangle that is met.
    pub level: u32,
    /// The place is origin + distance * direction.
    pub distance: f64,
    /// World coordinates.
    pub place: [f64; 3],
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_ray {
    const NAME: &'static str = "kmb_ray";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_hit {
    const NAME: &'static str = "kmb_hit";
}

/// Gives the nearest place at which a ray meets the finest surface, from above or from below; where detail
/// is missing since a repair, the coarser one that remains. The caller sets hit->struct_size. Voids
/// let rays through; between triangles none slips.
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns KMB_OK; KMB_OUTSIDE (it meets nothing); KMB_INVALID_ARGUMENT (also for numbers that are
/// not finite but `longest`, no direction, or a `longest` below 0); KMB_INVALID_STRUCT_SIZE; KMB_IO;
/// KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_ray_intersect(
    query: *mut kmb_query,
    ray: *const kmb_ray,
    hit: *mut kmb_hit,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        // SAFETY: the caller passes pointers as the header asks.
        let (ray, out) = unsafe { (input_struct(ray)?, output_struct(hit)?) };
        let ray = Ray { origin: ray.origin, direction: ray.direction, longest: ray.longest };
        let Some(hit) = query.query.ray_intersect(&ray)? else {
            return Err(Failure::new(kmb_status::KMB_OUTSIDE, "the ray meets no surface"));
        };
        out.write(kmb_hit {
            struct_size: size_of::<kmb_hit>() as u32,
            level: hit.level,
            distance: hit.distance,
            place: hit.place,
        });
        Ok(())
    })
}

/// Tells whether the straight line between two places in world coordinates, 3 doubles each, meets the
/// finest surface nowhere but at its ends: *visible becomes 1, else 0.
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for coordinates that are not finite); KMB_IO;
/// KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_line_of_sight(
    query: *mut kmb_query,
    from: *const f64,
    to: *const f64,
    visible: *mut i32,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        // SAFETY: the caller passes pointers as the header asks.
        let (from, to) = unsafe { (place(from, "from")?, place(to, "to")?) };
        // SAFETY: as above.
        let out = unsafe { output(visible, "visible") }?;
        out.write(i32::from(query.query.is_in_sight(from, to)?));
        Ok(())
    })
}

/// Three coordinates.
///
/// # Safety
///
/// The pointer is NULL or points to three doubles.
unsafe fn place(pointer: *const f64, name: &str) -> Result<[f64; 3], Failure> {
    // SAFETY: as the caller promises.
    let numbers = unsafe { array(pointer, 3, name) }?;
    Ok([numbers[0], numbers[1], numbers[2]])
}
