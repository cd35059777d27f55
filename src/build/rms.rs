//! The quantiser's bound for a root mean square error, by trial.

use crate::Result;

/// Largest bound of the quantiser: its step 2e + 1 stays within `i32`.
const GREATEST_BOUND: i64 = (1 << 30) - 1;

/// The largest bound e whose error, as `measure` finds it, is at most `limit`; `None` if that of 0 is
/// not. Takes the error to grow with e. `extent` is that of the heights in units, beyond which a larger bound
/// saves nothing.
pub(super) fn greatest_bound(
    limit: f64,
    scale: f64,
    extent: i64,
    mut measure: impl FnMut(i32) -> Result<f64>,
) -> Result<Option<i32>> {
    if measure(0)? > limit {
        return Ok(None);
    }
    let greatest = extent.min(GREATEST_BOUND) as i32;
    // The error of a uniform quantiser with step s is s / sqrt(12).
    let guess = (limit / scale * 3f64.sqrt()) as i32;
    let (mut good, mut tried) = (0, guess.clamp(1, greatest.max(1)));
    while good < greatest && measure(tried)? <= limit {
        good = tried;
        tried = tried.saturating_mul(2).min(greatest);
    }
    if good >= greatest {
        return Ok(Some(greatest));
    }
    let mut bad = tried;
    while bad - good > 1 {
        let middle = good + (bad - good) / 2;
        if measure(middle)? <= limit {
            good = middle;
        } else {
            bad = middle;
        }
    }
    Ok(Some(good))
}
