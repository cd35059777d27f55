//! Heights and windows of samples, without any view.

use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, Outcome, SizedStruct, boundary, output, output_array, output_struct,
};
use super::repository::kmb_repository;
use super::status::kmb_status;
use crate::cut::{Height, Query, Window, read_window};

/// Lifts a limit: the bytes of a query, or any limit of a kmb_budget.
pub const KMB_UNLIMITED: u64 = u64::MAX;

/// A height of the finest level.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_height {
    /// sizeof(kmb_height).
    pub struct_size: u32,
    /// The level that the height was read at.
    pub level: u32,
    /// Physical height: value_scale * sample + value_offset.
    pub height: f64,
    /// The input's own surface is not farther from it than this, in physical units; infinite where
    /// detail is missing that may have had a void.
    pub error_bound: f64,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_height {
    const NAME: &'static str = "kmb_height";
}

/// Answers questions about a repository from a cache of its own.
pub struct kmb_query {
    broken: AtomicBool,
    pub(super) query: Query,
}

impl Handle for kmb_query {
    const NAME: &'static str = "query";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Makes a query of a repository and gives a handle, which kmb_query_destroy frees. It keeps at
/// most about `byte_limit` bytes of decoded data (KMB_UNLIMITED: all that it meets). The repository
/// may be closed before the query is destroyed. Make one query for each thread.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_query_create(
    repository: *const kmb_repository,
    byte_limit: u64,
    query: *mut *mut kmb_query,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output(query, "query") }?;
        let made = kmb_query {
            broken: AtomicBool::new(false),
            query: Query::new(repository.terrain()?, byte_limit),
        };
        out.write(Box::into_raw(Box::new(made)));
        Ok(())
    })
}

/// Frees a query. NULL is allowed. No other call may use the handle at the same time, or
/// afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_query_destroy(query: *mut kmb_query) {
    let _ = boundary!({
        if !query.is_null() {
            // SAFETY: the caller gives back what kmb_query_create gave, once.
            drop(unsafe { Box::from_raw(query) });
        }
        Ok(())
    });
}

/// Gives the height of the finest surface at world x and y. The caller sets height->struct_size.
/// Where detail is missing since a repair, it is that of the coarser surface that remains:
/// height->level is then below the finest one, and the error bound that of this surface.
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns KMB_OK; KMB_OUTSIDE (outside the raster, or in a void); KMB_INVALID_ARGUMENT (also for a
/// coordinate that is not finite); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_height_at(
    query: *mut kmb_query,
    x: f64,
    y: f64,
    height: *mut kmb_height,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(height) }?;
        check_position(x, y)?;
        let height = query.query.height_at_world(x, y)?;
        out.write(told(height, x, y)?);
        Ok(())
    })
}

/// As kmb_height_at, with coordinates of the raster's reference system (degrees where it is
/// geographic).
///
/// Exclusive: no other call may use the query at the same time.
///
/// Returns what kmb_height_at returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_height_at_crs(
    query: *mut kmb_query,
    x: f64,
    y: f64,
    height: *mut kmb_height,
) -> kmb_status {
    boundary!(exclusive query: kmb_query, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(height) }?;
        check_position(x, y)?;
        let height = query.query.height_at_crs(x, y)?;
        out.write(told(height, x, y)?);
        Ok(())
    })
}

fn check_position(x: f64, y: f64) -> Outcome {
    if x.is_finite() && y.is_finite() {
        return Ok(());
    }
    Err(Failure::argument(format!(
        "the position {x}, {y} is not finite"
    )))
}

fn told(height: Option<Height>, x: f64, y: f64) -> Result<kmb_height, Failure> {
    let Some(height) = height else {
        let message = format!("there is no height at {x}, {y}");
        return Err(Failure::new(kmb_status::KMB_OUTSIDE, message));
    };
    Ok(kmb_height {
        struct_size: size_of::<kmb_height>() as u32,
        level: height.level,
        height: height.height,
        error_bound: height.error_bound,
    })
}

/// Reads a rectangle of samples of one even level into an array that the caller owns: `height` rows
/// of `width` samples from the top, sample values and not physical heights, NaN where there is a
/// void; of colours red, green and blue of each sample follow each other. `capacity` is the count of
/// doubles at `samples`, at least width * height, and three times that for colours. A level 2k has
/// every 2^(K - k)-th column and row of the raster, where 2K is the finest level; `column` and
/// `row` count those.
///
/// Where detail is missing since a repair, samples are those of the coarser surface that remains;
/// `coarse_samples`, which may be NULL, is their count.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for an odd or too fine level, a rectangle that is
/// empty or not within the level, or too small a capacity); KMB_IO; KMB_DAMAGED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_read_window(
    repository: *const kmb_repository,
    level: u32,
    column: u32,
    row: u32,
    width: u32,
    height: u32,
    samples: *mut f64,
    capacity: usize,
    coarse_samples: *mut u64,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        let bands = u64::from(repository.layer.raster_info().bands);
        let needed = (u64::from(width) * u64::from(height)).saturating_mul(bands);
        let count = usize::try_from(needed).ok().filter(|count| *count <= capacity);
        let count = count.ok_or_else(|| {
            Failure::argument(format!(
                "{capacity} numbers do not hold a window of {width} x {height}"
            ))
        })?;
        // SAFETY: the caller passes pointers as the header asks.
        let samples = unsafe { output_array(samples, count, "samples") }?;
        let out = match coarse_samples.is_null() {
            true => None,
            // SAFETY: as above.
            false => Some(unsafe { output(coarse_samples, "coarse_samples") }?),
        };
        let window = Window { column, row, width, height };
        let coarse = read_window(&repository.layer, level, window, samples)?;
        if let Some(out) = out {
            out.write(coarse.count());
        }
        Ok(())
    })
}
