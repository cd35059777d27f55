//! Decoded details that all cuts and queries of a layer share.

use crate::codec::{Matrix, Refined};
use crate::lattice::Diamond;
use crate::{Error, Result};
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};
use std::sync::Arc;

/// Details by their diamonds, as many as fit a number of bytes; those that are used again stay the longest.
pub(super) struct Shared(Cache<Diamond, Arc<Refined>, Bytes>);

#[derive(Clone)]
struct Bytes;

impl Weighter<Diamond, Arc<Refined>> for Bytes {
    fn weight(&self, _: &Diamond, refined: &Arc<Refined>) -> u64 {
        let bytes = |matrix: &Matrix| {
            let mask = matrix.valid.as_deref().map_or(0, <[u8]>::len);
            (size_of_val(&*matrix.values) + mask) as u64
        };
        bytes(&refined.centres) + refined.vertices.as_ref().map_or(0, bytes)
    }
}

impl Shared {
    /// Room for so many bytes; `each` is what a detail takes, about.
    pub fn new(bytes: u64, each: u64) -> Result<Shared> {
        let options = OptionsBuilder::new()
            .estimated_items_capacity((bytes / each).try_into().unwrap_or(usize::MAX).min(1 << 12))
            .weight_capacity(bytes)
            .shards(1)
            .build()
            .map_err(|error| Error::Argument(format!("shared details: {error}")))?;
        Ok(Shared(Cache::with_options(
            options,
            Bytes,
            DefaultHashBuilder::default(),
            DefaultLifecycle::default(),
        )))
    }

    /// A detail, decoded once by whoever asks first; others who ask meanwhile wait for it.
    pub fn get(
        &self,
        diamond: Diamond,
        decode: impl FnOnce() -> Result<Refined>,
    ) -> Result<Refined> {
        let found = self
            .0
            .get_or_insert_with(&diamond, || decode().map(Arc::new))?;
        Ok(Refined::clone(&found))
    }
}
