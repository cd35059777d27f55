//! What an update of a cut or of a city's visit is asked.

use std::mem::MaybeUninit;

use super::boundary::{Failure, SizedStruct, input_struct, output_struct};
use super::cut::{kmb_budget, kmb_view};
use crate::geo::View;
use crate::schedule::Budget;

/// What an update is asked: a view, a budget, without which there are no limits, and where to tell what it did, if anywhere.
///
/// # Safety
///
/// As [`input_struct`] of the view, and where they are not NULL of the budget and [`output_struct`] of the statistics.
pub(super) unsafe fn frame<'a, S: SizedStruct>(
    view: *const kmb_view,
    budget: *const kmb_budget,
    stats: *mut S,
) -> Result<(View, Budget, Option<&'a mut MaybeUninit<S>>), Failure> {
    // SAFETY: as the caller promises.
    let view = unsafe { input_struct(view) }?;
    let budget = match budget.is_null() {
        true => Budget::UNLIMITED,
        // SAFETY: as above.
        false => limits(&unsafe { input_struct(budget) }?),
    };
    let out = match stats.is_null() {
        true => None,
        // SAFETY: as above.
        false => Some(unsafe { output_struct(stats) }?),
    };
    Ok((seen(&view), budget, out))
}

fn seen(view: &kmb_view) -> View {
    View {
        eye: view.eye,
        world_to_clip: view.world_to_clip,
        viewport: view.viewport,
        tolerance: view.tolerance,
    }
}

fn limits(budget: &kmb_budget) -> Budget {
    Budget {
        microseconds: budget.microseconds,
        refinements: budget.refinements,
        bytes: budget.bytes,
        upload_bytes: budget.upload_bytes,
        patches: budget.patches,
    }
}
