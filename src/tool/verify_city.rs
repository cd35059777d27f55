//! The check of a whole city: checksums, then the decoding of every block.

use super::Progress;
use crate::blockmap::City;
use crate::{Error, Result};

/// What is damaged, one line each; blocks are decoded only where all checksums are right.
///
/// # Errors
///
/// [`Error::Cancelled`].
pub fn verify_city(city: &City, progress: Progress) -> Result<Vec<String>> {
    let found = city.store().verify();
    let mut damage: Vec<String> = found.damaged.iter().map(ToString::to_string).collect();
    if !damage.is_empty() {
        return Ok(damage);
    }
    let count = city.tree().nodes.len() as u32;
    for node in 0..count {
        match city.read(node) {
            Ok(_) | Err(Error::Missing { .. }) => {}
            Err(error) => damage.push(error.to_string()),
        }
        if !progress(u64::from(node) + 1, u64::from(count)) {
            return Err(Error::Cancelled);
        }
    }
    Ok(damage)
}
