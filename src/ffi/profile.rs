//! Profiles along lines, and statistics of polygons.

use super::boundary::{
    Failure, Outcome, SizedStruct, array, boundary, output, output_array, output_struct,
};
use super::query::kmb_query;
use super::status::kmb_status;
use crate::cut::ProfilePlace;

/// A place of a profile.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_profile_place {
    /// sizeof(kmb_profile_place).
    pub struct_size: u32,
    /// The level that the height was read at, 0 where there is none.
    pub level: u32,
    /// World units along the line from its start.
    pub distance: f64,
    /// World x and y.
    pub place: [f64; 2],
    /// Physical height; NaN where there is no surface: outside the raster and in voids.
    pub height: f64,
    /// As that of kmb_height; NaN where there is no height.
    pub error_bound: f64,
}

/// What the finest surface is like within a polygon.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_area {
    /// sizeof(kmb_area).
    pub struct_size: u32,
    /// The coarsest level that was read: the finest one, but where detail is missing.
    pub level: u32,
    /// Least physical height.
    pub minimum: f64,
    /// Greatest physical height.
    pub maximum: f64,
    /// Mean height over `area`: mean * area is the volume between the surface and height 0.
    pub mean: f64,
    /// World area, seen from above, of the part of the polygon that has a surface: in the raster and not
    /// void.
    pub area: f64,
    /// As that of kmb_height, of the whole surface within the polygon and so of the three heights.
    pub error_bound: f64,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_profile_place {
    const NAME: &'static str = "kmb_profile_place";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_area {
    const NAME: &'static str = "kmb_area";
}

/// Gives the exact profile of the finest surface along a line: `line` is `point_count` points, 2 or more, each
/// world x and y. Where detail is missing since a repair, it is that of the coarser surface that
/// remains.
///
/// The places are the line's points and all at which it crosses from one triangle to the next, in
/// order. Between two places with heights the surface is straight, and either's bound holds. Where it
/// ends or begins, at a void or the raster's edge, there are two places at the same distance, one with a
/// height and one with NaN.
///
/// `places` has room for `capacity` of them; the caller sets places[0].struct_size. *count becomes their
/// count, also when that is more than `capacity`; there are at most 6 for each point of the line and for
/// each sample of its length. With a capacity of 0 `places` may be NULL. A call whose capacity is too
/// small reads as much as one whose is not.
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`count` is the capacity that is needed, and nothing else is
/// written); KMB_INVALID_ARGUMENT (also for fewer than 2 points, or coordinates that are not finite
/// or too far apart); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_profile(
    query: *mut kmb_query,
    line: *const f64,
    point_count: usize,
    places: *mut kmb_profile_place,
    capacity: usize,
    count: *mut usize,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        // SAFETY: the caller passes pointers as the header asks.
        let (line, count) = unsafe { (points(line, point_count, "line")?, output(count, "count")?) };
        if capacity > 0 {
            // SAFETY: as above.
            unsafe { output_struct(places) }?;
        }
        let profile = query.query.profile(line)?;
        count.write(profile.len());
        if profile.len() > capacity {
            return Err(Failure::new(
                kmb_status::KMB_BUFFER_TOO_SMALL,
                format!("{capacity} places do not hold a profile of {}", profile.len()),
            ));
        }
        // SAFETY: as above.
        unsafe { write_places(&profile, places) }
    })
}

/// Gives the heights at `count` places along a line, evenly spaced from its start to its end; each is what
/// kmb_height_at gives. `line` is `point_count` points, 2 or more, each world x and y. `places` has
/// room for `count`; the caller sets places[0].struct_size. A count of 1 gives the start.
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a count of 0, fewer than 2 points, or coordinates that
/// are not finite or too far apart); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_profile_samples(
    query: *mut kmb_query,
    line: *const f64,
    point_count: usize,
    places: *mut kmb_profile_place,
    count: usize,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        if count == 0 {
            return Err(Failure::argument("a profile of 0 places"));
        }
        // SAFETY: the caller passes pointers as the header asks.
        let line = unsafe { points(line, point_count, "line") }?;
        // SAFETY: as above.
        unsafe { output_struct(places) }?;
        // SAFETY: as above; the memory is looked at before anything is read for it.
        unsafe { output_array(places, count, "places") }?;
        let profile = query.query.profile_samples(line, count)?;
        // SAFETY: as above.
        unsafe { write_places(&profile, places) }
    })
}

/// Gives the least, the greatest and the mean height of the finest surface within a polygon: `polygon` is
/// `point_count` points, 3 or more, each world x and y, in either direction; the last is joined to the
/// first. The caller sets statistics->struct_size. All is exact but for rounding errors: triangles are
/// clipped to the polygon. Where detail is missing since a repair, they are those of the coarser surface
/// that remains.
///
/// A polygon may touch itself, as one with a hole does that an edge there and back leads to, but not cross
/// itself. All samples within it are decoded, whatever its size, in the memory that the query has; time
/// also grows with the square of `point_count`.
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns KMB_OK; KMB_OUTSIDE (no surface lies within the polygon); KMB_INVALID_ARGUMENT (also for fewer
/// than 3 points, coordinates that are not finite or immensely large, and a polygon that crosses itself
/// or encloses no area); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_area_statistics(
    query: *mut kmb_query,
    polygon: *const f64,
    point_count: usize,
    statistics: *mut kmb_area,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        // SAFETY: the caller passes pointers as the header asks.
        let (polygon, out) =
            unsafe { (points(polygon, point_count, "polygon")?, output_struct(statistics)?) };
        let Some(found) = query.query.area_statistics(polygon)? else {
            let message = "no surface lies within the polygon";
            return Err(Failure::new(kmb_status::KMB_OUTSIDE, message));
        };
        out.write(kmb_area {
            struct_size: size_of::<kmb_area>() as u32,
            level: found.level,
            minimum: found.minimum,
            maximum: found.maximum,
            mean: found.mean,
            area: found.area,
            error_bound: found.error_bound,
        });
        Ok(())
    })
}

/// Points of two coordinates.
///
/// # Safety
///
/// The pointer is NULL, misaligned, or points to 2 * `count` doubles that live during `'a`.
unsafe fn points<'a>(
    pointer: *const f64,
    count: usize,
    name: &str,
) -> Result<&'a [[f64; 2]], Failure> {
    // SAFETY: as the caller promises; a pair is aligned as a double.
    unsafe { array(pointer.cast::<[f64; 2]>(), count, name) }
}

/// Writes all places of a profile.
///
/// # Safety
///
/// The pointer is NULL, misaligned, or points to memory for all of them, which nothing else uses.
unsafe fn write_places(profile: &[ProfilePlace], places: *mut kmb_profile_place) -> Outcome {
    // SAFETY: as the caller promises; any bits are a place.
    let places = unsafe { output_array(places, profile.len(), "places") }?;
    for (out, place) in places.iter_mut().zip(profile) {
        *out = kmb_profile_place {
            struct_size: size_of::<kmb_profile_place>() as u32,
            level: place.height.map_or(0, |height| height.level),
            distance: place.distance,
            place: place.place,
            height: place.height.map_or(f64::NAN, |height| height.height),
            error_bound: place.height.map_or(f64::NAN, |height| height.error_bound),
        };
    }
    Ok(())
}
