//! Diamonds of a repository, decoded when they are asked for.

use super::Predecessor;
use super::changes::Changes;
use crate::build::leaf::Tile;
use crate::codec::{Matrix, Outline, Refined, child_vertices};
use crate::lattice::Diamond;
use crate::schedule::map_in_order;
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::Arc;

/// What is decoded of a diamond: its vertices on its own level, and what refining it gives.
#[derive(PartialEq)]
pub(super) struct State {
    pub(super) vertices: Matrix,
    pub(super) refined: Refined,
}

/// Decodes diamonds and keeps them, and the ancestors that they need.
pub(super) struct Decoder<'a> {
    old: &'a Predecessor<'a>,
    /// What takes the place of what the file has.
    changes: Option<&'a Changes>,
    known: HashMap<Diamond, Arc<State>>,
}

impl<'a> Decoder<'a> {
    /// Of the file as it is.
    pub(super) fn before(old: &'a Predecessor<'a>) -> Decoder<'a> {
        Decoder {
            old,
            changes: None,
            known: HashMap::new(),
        }
    }

    /// Of the file with its changes.
    pub(super) fn after(old: &'a Predecessor<'a>, changes: &'a Changes) -> Decoder<'a> {
        Decoder {
            changes: Some(changes),
            ..Decoder::before(old)
        }
    }

    /// A refinable diamond.
    ///
    /// # Errors
    ///
    /// Those of reading and decoding it and its ancestors.
    pub(super) fn state(&mut self, diamond: Diamond) -> Result<Arc<State>> {
        if let Some(state) = self.changes.and_then(|changes| changes.after(diamond)) {
            return Ok(state.clone());
        }
        if let Some(state) = self.known.get(&diamond) {
            return Ok(state.clone());
        }
        let vertices = self.vertices(diamond)?;
        let mut scratch = Vec::new();
        let rank = self.old.lattice.rank(diamond);
        let block = self.old.store.block(rank, &mut scratch)?;
        let outline = Outline::of(self.old.lattice, diamond);
        let refined = self
            .old
            .codec
            .decode(&vertices, &outline, block)
            .map_err(|error| {
                Error::damaged(self.old.store.path(), format!("block {rank}: {error}"))
            })?;
        let state = Arc::new(State { vertices, refined });
        self.known.insert(diamond, state.clone());
        Ok(state)
    }

    fn vertices(&mut self, diamond: Diamond) -> Result<Matrix> {
        let lattice = self.old.lattice;
        if diamond == lattice.root() {
            return Ok(self.old.root.clone());
        }
        let mut parents = [None, None];
        for (known, parent) in parents.iter_mut().zip(lattice.parents(diamond)) {
            *known = parent.map(|parent| self.state(parent)).transpose()?;
        }
        Ok(vertices_from(self.old, diamond, &parents))
    }

    /// The leaf level in a rectangle of samples.
    pub(super) fn tile(&mut self, corners: [[i64; 2]; 2]) -> Result<Tile> {
        Tile::of_heights(self.old.lattice, corners, |diamond, put| {
            let state = self.state(diamond)?;
            put(
                state.refined.vertices(&state.vertices),
                &state.refined.centres,
            );
            Ok(())
        })
    }

    /// Forgets all if that is much.
    pub(super) fn forget_many(&mut self) {
        if self.known.len() > MOST_KNOWN {
            self.known.clear();
        }
    }

    /// All diamonds that it has decoded.
    pub(super) fn known(&self) -> impl Iterator<Item = (Diamond, &State)> {
        self.known
            .iter()
            .map(|(&diamond, state)| (diamond, &**state))
    }
}

/// Diamonds that a decoder keeps when it is asked to forget.
const MOST_KNOWN: usize = 4096;

/// Diamonds that one thread decodes at a time: so many that their common ancestors cost little.
const CHUNK: usize = 256;

/// Shows chunks of diamonds, each with a decoder of its own, to `look` on several threads, and what it makes of
/// them, in order, to `consume`, which ends the whole with an error.
pub(super) fn decode_chunks<'a, T: Send, E>(
    decoder: impl Fn() -> Decoder<'a> + Sync,
    diamonds: &[Diamond],
    threads: usize,
    look: impl Fn(&mut Decoder<'a>, &[Diamond]) -> T + Sync,
    mut consume: impl FnMut(T) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    let chunks: Vec<&[Diamond]> = diamonds.chunks(CHUNK).collect();
    let work = |index: usize| look(&mut decoder(), chunks[index]);
    map_in_order(threads, chunks.len(), work, |_, made| consume(made))
}

/// The vertices of a diamond below the root out of its parents.
pub(super) fn vertices_from(
    old: &Predecessor,
    diamond: Diamond,
    parents: &[Option<Arc<State>>; 2],
) -> Matrix {
    let parents = parents.each_ref().map(|parent| {
        let parent = parent.as_ref()?;
        let vertices = parent.refined.vertices(&parent.vertices);
        Some((vertices, &parent.refined.centres))
    });
    child_vertices(old.lattice, diamond, parents)
}
