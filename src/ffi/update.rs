//! Updates: other samples in a part of a repository.

use std::ffi::{c_char, c_void};

use super::boundary::{Failure, SizedStruct, boundary, input_struct, output_struct, path};
use super::builder::{kmb_progress_callback, kmb_rows_callback, row_source};
use super::status::kmb_status;
use crate::cut::{Layer, Window};
use crate::geo::RasterInfo;
use crate::store::Access;
use crate::tool::{Placed, Update, UpdateReport, update};

/// Which samples get new values, and how.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_update_options {
    /// sizeof(kmb_update_options).
    pub struct_size: u32,
    /// The region: its first column in the raster.
    pub column: u32,
    /// Its first row.
    pub row: u32,
    /// Its columns.
    pub width: u32,
    /// Its rows.
    pub height: u32,
    /// 0 if the rows callback gives the region's rows; 1 if it gives all rows of the raster, as it
    /// must where the repository is not lossless, or has missing detail.
    pub rows_are_whole: u32,
    /// Most MiB of memory to take, about, where all must be built again; 0 for no limit.
    pub memory: u32,
    /// Threads to use; 0 for as many as there are processors.
    pub threads: u32,
    /// The RMS error that the repository was built with, or 0.
    pub rms_error: f64,
}

/// What an update did.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_update_report {
    /// sizeof(kmb_update_report).
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Diamonds that were coded again.
    pub diamonds_recomputed: u64,
    /// All diamonds.
    pub diamonds: u64,
    /// Bytes of the file.
    pub bytes: u64,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_update_options {
    const NAME: &'static str = "kmb_update_options";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_update_report {
    const NAME: &'static str = "kmb_update_report";
}

/// Replaces the samples of a region of the repository at `repository_path` by those that `rows`
/// gives. The bytes become those of a build of the whole raster with the same options and the old
/// file's weights and tables. A lossless repository has all other samples itself, and of heights
/// with KMB_TRANSFORM_INTERPOLATING only the diamonds that the region reaches are coded again, unless
/// what holds for the whole raster changes: the range of its samples, or whether any is void. One
/// that is not lossless is built again from all samples, those of the region and the originals of
/// all others (rows_are_whole), which are compared with what the repository has. The new file appears
/// under the name only when it is whole; handles that have the old one open go on with that.
/// `progress` may be NULL; so may `report`, otherwise the caller sets report->struct_size.
///
/// May be called from any thread at any time. Of two updates of one file at the same time one is
/// lost.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also where originals are needed, or given samples are not
/// the originals); KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_INPUT (`rows` failed, or gave a sample that
/// the type does not have); KMB_DAMAGED; KMB_UNSUPPORTED_VERSION (also for a file that a later version
/// wrote); KMB_CANCELLED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_update(
    repository_path: *const c_char,
    options: *const kmb_update_options,
    rows: kmb_rows_callback,
    rows_user: *mut c_void,
    progress: kmb_progress_callback,
    progress_user: *mut c_void,
    report: *mut kmb_update_report,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (file, options) = unsafe { (path(repository_path)?, input_struct(options)?) };
        let out = match report.is_null() {
            true => None,
            // SAFETY: as above.
            false => Some(unsafe { output_struct(report) }?),
        };
        if options.rows_are_whole > 1 {
            let message = format!("rows_are_whole is {}, not 0 or 1", options.rows_are_whole);
            return Err(Failure::argument(message));
        }
        let region = Window {
            column: options.column,
            row: options.row,
            width: options.width,
            height: options.height,
        };
        let whole = Layer::open(&file, Access::Map)?.raster_info().clone();
        let (given, at) = match options.rows_are_whole {
            1 => (whole, [0, 0]),
            _ => {
                let given = RasterInfo {
                    width: region.width,
                    height: region.height,
                    ..whole
                };
                (given, [region.column, region.row].map(i64::from))
            }
        };
        // SAFETY: the caller gave a function that may be called with this `user`.
        let mut source = unsafe { row_source(given, rows, rows_user) }?;
        let mut go_on = |done: u64, total: u64| {
            // SAFETY: the caller gave a function that may be called so, with this `user`.
            progress.is_none_or(|progress| unsafe { progress(progress_user, done, total) } == 0)
        };
        let what = Update {
            region,
            rms_error: (options.rms_error != 0.0).then_some(options.rms_error),
            memory: (options.memory != 0).then_some(u64::from(options.memory) << 20),
            threads: options.threads as usize,
        };
        let new = Placed {
            source: &mut source,
            at,
        };
        let updated = update(&file, new, &what, &mut go_on)?;
        if let Some(out) = out {
            out.write(told(&updated));
        }
        Ok(())
    })
}

fn told(updated: &UpdateReport) -> kmb_update_report {
    kmb_update_report {
        struct_size: size_of::<kmb_update_report>() as u32,
        reserved: 0,
        diamonds_recomputed: updated.diamonds_recomputed,
        diamonds: updated.diamonds,
        bytes: updated.bytes,
    }
}
