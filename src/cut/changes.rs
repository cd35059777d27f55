//! What became drawn and what ceased to be, for the caches of the embedding program.

use super::patch::Patch;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Patches that began and ceased to be drawn since the changes were last taken. One that did both is
/// in neither list.
#[derive(Clone, Debug, Default)]
pub struct Changes {
    /// New patches, in the order of their handles.
    pub added: Vec<Arc<Patch>>,
    /// Handles of patches that are no longer drawn.
    pub removed: Vec<u64>,
}

/// Hands out handles and keeps the changes, those since they were taken and those of one update.
#[derive(Default)]
pub(super) struct ChangeLog {
    next_handle: u64,
    added: BTreeMap<u64, Arc<Patch>>,
    removed: Vec<u64>,
    /// First handle of this update.
    update_start: u64,
    update: UpdateChanges,
}

/// Changes of one update, those undone again not counted.
#[derive(Clone, Copy, Default)]
pub(super) struct UpdateChanges {
    pub added: u64,
    pub removed: u64,
    /// Bytes of the patches added.
    pub uploaded: u64,
}

impl ChangeLog {
    pub fn next_handle(&self) -> u64 {
        self.next_handle
    }

    /// Records a patch that was made with the next handle.
    pub fn add(&mut self, patch: &Arc<Patch>) {
        debug_assert_eq!(patch.handle, self.next_handle);
        self.next_handle += 1;
        self.update.added += 1;
        self.update.uploaded += patch.bytes();
        self.added.insert(patch.handle, patch.clone());
    }

    pub fn remove(&mut self, patch: &Patch) {
        if patch.handle >= self.update_start {
            self.update.added -= 1;
            self.update.uploaded -= patch.bytes();
        } else {
            self.update.removed += 1;
        }
        if self.added.remove(&patch.handle).is_none() {
            self.removed.push(patch.handle);
        }
    }

    /// Bytes of the patches that this update hands out so far.
    pub fn uploaded(&self) -> u64 {
        self.update.uploaded
    }

    /// Ends an update.
    pub fn close_update(&mut self) -> UpdateChanges {
        self.update_start = self.next_handle;
        std::mem::take(&mut self.update)
    }

    pub fn take(&mut self) -> Changes {
        let added = std::mem::take(&mut self.added);
        Changes {
            added: added.into_values().collect(),
            removed: std::mem::take(&mut self.removed),
        }
    }
}
