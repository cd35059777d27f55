//! What a query keeps of decoded diamonds, within a limit of bytes.

use super::query::Matrices;
use super::tile::Tile;
use crate::lattice::Diamond;
use std::collections::HashMap;
use std::sync::Arc;

/// What is kept of a diamond.
pub(super) enum Kept {
    /// Of one that can be refined: its heights on the next level.
    Refined(Arc<Matrices>),
    /// Of a leaf: its surface.
    Tile(Tile),
}

impl Kept {
    fn bytes(&self) -> u64 {
        match self {
            Kept::Refined(matrices) => matrices.bytes(),
            Kept::Tile(tile) => tile.bytes(),
        }
    }
}

struct Entry {
    diamond: Diamond,
    kept: Kept,
    /// Since the hand came by.
    is_used: bool,
}

/// Decoded diamonds. Those leave first that were not used since a hand, which goes around them, came by
/// (the clock algorithm): a use costs no more than to note it.
pub(super) struct Cache {
    limit: u64,
    bytes: u64,
    entries: Vec<Option<Entry>>,
    free: Vec<usize>,
    places: HashMap<Diamond, usize>,
    hand: usize,
}

impl Cache {
    pub(super) fn new(limit: u64) -> Cache {
        Cache {
            limit,
            bytes: 0,
            entries: Vec::new(),
            free: Vec::new(),
            places: HashMap::new(),
            hand: 0,
        }
    }

    pub(super) fn refined(&mut self, diamond: Diamond) -> Option<Arc<Matrices>> {
        let place = *self.places.get(&diamond)?;
        let entry = self.entries[place].as_mut()?;
        entry.is_used = true;
        match &entry.kept {
            Kept::Refined(matrices) => Some(matrices.clone()),
            Kept::Tile(_) => None,
        }
    }

    /// The place of a leaf, which it has until [`trim`](Self::trim) is called.
    pub(super) fn place(&self, leaf: Diamond) -> Option<usize> {
        self.places.get(&leaf).copied()
    }

    /// The surface of a leaf that is expected at a place.
    pub(super) fn tile(&mut self, place: usize, leaf: Diamond) -> Option<&Tile> {
        let entry = self.entries.get_mut(place)?.as_mut()?;
        if entry.diamond != leaf {
            return None;
        }
        entry.is_used = true;
        match &entry.kept {
            Kept::Tile(tile) => Some(tile),
            Kept::Refined(_) => None,
        }
    }

    /// Keeps what was not there yet; returns its place.
    pub(super) fn put(&mut self, diamond: Diamond, kept: Kept) -> usize {
        self.bytes += kept.bytes();
        let entry = Some(Entry {
            diamond,
            kept,
            is_used: true,
        });
        let place = match self.free.pop() {
            Some(place) => {
                self.entries[place] = entry;
                place
            }
            None => {
                self.entries.push(entry);
                self.entries.len() - 1
            }
        };
        self.places.insert(diamond, place);
        place
    }

    /// Forgets entries until the limit holds.
    pub(super) fn trim(&mut self) {
        while self.bytes > self.limit && !self.places.is_empty() {
            self.hand %= self.entries.len();
            let slot = &mut self.entries[self.hand];
            match slot {
                Some(entry) if entry.is_used => entry.is_used = false,
                Some(entry) => {
                    self.bytes -= entry.kept.bytes();
                    self.places.remove(&entry.diamond);
                    self.free.push(self.hand);
                    *slot = None;
                }
                None => {}
            }
            self.hand += 1;
        }
    }
}
