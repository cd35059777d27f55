//! Repairs: what is left of a damaged repository.

use std::ffi::{c_char, c_void};

use super::boundary::{SizedStruct, boundary, output_struct, path};
use super::builder::kmb_progress_callback;
use super::status::kmb_status;
use crate::tool::{RepairReport, repair};

/// What a repair found and left.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_repair_report {
    /// sizeof(kmb_repair_report).
    pub struct_size: u32,
    /// The coarsest level of a diamond whose detail is missing; the finest level of all where none
    /// is.
    pub coarsest_level: u32,
    /// Blocks that were damaged, or whose place was not known any more.
    pub damaged_blocks: u64,
    /// Those of them that are now missing; the others could be restored.
    pub lost_blocks: u64,
    /// All blocks that are missing now, those of earlier repairs too.
    pub missing_blocks: u64,
    /// Diamonds that cannot be refined any more: those, and all that descend from them.
    pub blocked_blocks: u64,
    /// Samples that lie inside one of them.
    pub coarse_samples: u64,
    /// The same in percent of all samples.
    pub coarse_percent: f64,
    /// Bytes of the repaired file.
    pub bytes: u64,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_repair_report {
    const NAME: &'static str = "kmb_repair_report";
}

/// Writes what is sound of the repository at `repository_path` to `output_path`, and marks the rest
/// as missing: cuts, queries and windows give coarser ground there, never wrong ground. `output_path`
/// may be NULL: the repaired file then takes the place of the damaged one. It appears under its name
/// only when it is whole; handles that have the old file open go on with that. A file without damage
/// is copied as it is. `progress` may be NULL; so may `report`, otherwise the caller sets
/// report->struct_size.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT; KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_DAMAGED (the header,
/// the metadata, the roots or the tables are damaged, without which nothing can be repaired);
/// KMB_UNSUPPORTED_VERSION (also for a file that a later version wrote); KMB_CANCELLED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_repair(
    repository_path: *const c_char,
    output_path: *const c_char,
    progress: kmb_progress_callback,
    progress_user: *mut c_void,
    report: *mut kmb_repair_report,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let file = unsafe { path(repository_path) }?;
        let output = match output_path.is_null() {
            true => file.clone(),
            // SAFETY: as above.
            false => unsafe { path(output_path) }?,
        };
        let out = match report.is_null() {
            true => None,
            // SAFETY: as above.
            false => Some(unsafe { output_struct(report) }?),
        };
        let mut go_on = |done: u64, total: u64| {
            // SAFETY: the caller gave a function that may be called so, with this `user`.
            progress.is_none_or(|progress| unsafe { progress(progress_user, done, total) } == 0)
        };
        let repaired = repair(&file, &output, &mut go_on)?;
        if let Some(out) = out {
            out.write(told(&repaired));
        }
        Ok(())
    })
}

fn told(repaired: &RepairReport) -> kmb_repair_report {
    kmb_repair_report {
        struct_size: size_of::<kmb_repair_report>() as u32,
        coarsest_level: repaired.coarsest_level.unwrap_or(repaired.levels),
        damaged_blocks: repaired.damaged_blocks,
        lost_blocks: repaired.lost_blocks,
        missing_blocks: repaired.missing_blocks,
        blocked_blocks: repaired.blocked_blocks,
        coarse_samples: repaired.coarse_samples,
        coarse_percent: repaired.coarse_percent,
        bytes: repaired.bytes,
    }
}
