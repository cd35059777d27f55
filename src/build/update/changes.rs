//! The diamonds that other samples in a rectangle reach, coded again.

use super::decoder::{Decoder, State, vertices_from};
use super::{Predecessor, Replacement};
use crate::codec::{Components, Matrix, Outline, RootCodec};
use crate::lattice::Diamond;
use crate::transform::Target;
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// What becomes of the diamonds whose vertices or detail are not what they were. Of all others even the bytes
/// stay.
#[derive(Default)]
pub(super) struct Changes {
    /// Bytes of the root's vertices, if those have changed.
    roots: Option<Vec<u8>>,
    diamonds: BTreeMap<Diamond, Change>,
}

/// A diamond before and after.
pub(super) struct Change {
    pub(super) before: Arc<State>,
    pub(super) after: Arc<State>,
    block: Vec<u8>,
}

impl Changes {
    /// Codes what a rectangle reaches, level by level; `None` if that is more than `most` diamonds. `before` decodes
    /// the file as it is.
    pub(super) fn find(
        old: &Predecessor,
        new: &Replacement,
        before: &mut Decoder,
        most: u64,
    ) -> Result<Option<Changes>> {
        let lattice = old.lattice;
        let [first, last] = new.corners();
        let (root, roots) = root_after(old, new)?;
        let mut changes = Changes {
            roots,
            diamonds: BTreeMap::new(),
        };
        let mut reached: Vec<Diamond> = Vec::new();
        for level in 0..lattice.levels() {
            let mut candidates: BTreeSet<Diamond> = lattice
                .diamonds_around(level, first, last)
                .into_iter()
                .collect();
            if level == 0 {
                // Its vertices may be all that changes.
                candidates.insert(lattice.root());
            }
            let children = reached.iter().flat_map(|&parent| lattice.children(parent));
            candidates.extend(children.flatten());
            reached.clear();
            for diamond in candidates {
                let vertices = if diamond == lattice.root() {
                    root.clone()
                } else {
                    changes.vertices_after(old, diamond, before)?
                };
                let state = before.state(diamond)?;
                if let Some(change) = code(old, new, diamond, vertices, state)? {
                    changes.diamonds.insert(diamond, change);
                    reached.push(diamond);
                }
                if changes.len() as u64 > most {
                    return Ok(None);
                }
            }
        }
        Ok(Some(changes))
    }

    fn vertices_after(
        &self,
        old: &Predecessor,
        diamond: Diamond,
        before: &mut Decoder,
    ) -> Result<Matrix> {
        let mut parents = [None, None];
        for (known, parent) in parents.iter_mut().zip(old.lattice.parents(diamond)) {
            let Some(parent) = parent else { continue };
            *known = Some(match self.after(parent) {
                Some(state) => state.clone(),
                None => before.state(parent)?,
            });
        }
        Ok(vertices_from(old, diamond, &parents))
    }

    /// How many diamonds there are.
    pub(super) fn len(&self) -> usize {
        self.diamonds.len()
    }

    /// All of them, and what becomes of them.
    pub(super) fn all(&self) -> impl DoubleEndedIterator<Item = (Diamond, &Change)> {
        self.diamonds
            .iter()
            .map(|(&diamond, change)| (diamond, change))
    }

    pub(super) fn get(&self, diamond: Diamond) -> Option<&Change> {
        self.diamonds.get(&diamond)
    }

    /// A diamond that has changed.
    pub(super) fn after(&self, diamond: Diamond) -> Option<&Arc<State>> {
        self.get(diamond).map(|change| &change.after)
    }

    /// The block of a diamond that has changed.
    pub(super) fn block(&self, diamond: Diamond) -> Option<&[u8]> {
        self.get(diamond).map(|change| &change.block[..])
    }

    /// Bytes of the root's vertices.
    pub(super) fn roots<'a>(&'a self, old: &'a Predecessor) -> &'a [u8] {
        self.roots.as_deref().unwrap_or(old.store.roots())
    }
}

/// The root's vertices, and their bytes if they are others than before.
fn root_after(old: &Predecessor, new: &Replacement) -> Result<(Matrix, Option<Vec<u8>>)> {
    let lattice = old.lattice;
    let (placement, side) = (lattice.placement(lattice.root()), lattice.cells() + 1);
    let mut is_other = false;
    let mut heights = BTreeMap::new();
    for index in 0..side * side {
        let at = placement.vertex(index % side, index / side);
        let before = old.root.is_valid(index).then(|| old.root.values[index]);
        let after = new.height(old.units, at).filter(|_| lattice.in_raster(at));
        is_other |= after.is_some_and(|after| after != before);
        heights.insert(at, after.unwrap_or(before));
    }
    if !is_other {
        return Ok((old.root.clone(), None));
    }
    let components = Components::Height(old.units.clone());
    let transforms = components.transforms(old.store.header().transform, lattice.cells());
    let codec = RootCodec::new(lattice, components.quantisers(&transforms, None));
    let bytes = codec.encode(|_, at| heights.get(&at).copied().flatten());
    let root = codec.decode(&bytes).map_err(|error| {
        Error::Argument(format!(
            "internal error: a root just written does not decode: {error}"
        ))
    })?;
    Ok((root, Some(bytes)))
}

/// A diamond with these vertices and the new samples at its centres; `None` where that is what it was.
fn code(
    old: &Predecessor,
    new: &Replacement,
    diamond: Diamond,
    vertices: Matrix,
    before: Arc<State>,
) -> Result<Option<Change>> {
    let lattice = old.lattice;
    let (placement, cells) = (lattice.placement(diamond), lattice.cells());
    let outline = Outline::of(lattice, diamond);
    let centres = &before.refined.centres;
    let mut heights = vec![0; cells * cells];
    let mut voids = vec![0; cells * cells];
    let mut is_other = vertices != before.vertices;
    for index in (0..cells * cells).filter(|&index| outline.is_codable(index)) {
        let was = centres.is_valid(index).then(|| centres.values[index]);
        let at = placement.centre(index % cells, index / cells);
        let is = new.height(old.units, at).unwrap_or(was);
        is_other |= is != was;
        voids[index] = u8::from(is.is_none());
        heights[index] = is.unwrap_or_default();
    }
    if !is_other {
        return Ok(None);
    }
    let model = old.codec.model().map(|model| model.level(diamond.level()));
    let matrices = 0..old.codec.matrices();
    let weights: Vec<_> = model.map_or_else(Vec::new, |model| {
        matrices
            .map(|matrix| model.weights(matrix).clone())
            .collect()
    });
    let target = Target {
        vertices: &vertices.values,
        centres: &heights,
    };
    let voids = (old.store.header().void_samples > 0).then_some(&voids[..]);
    let (draft, refined) = old
        .codec
        .draft(&weights, &vertices, &outline, target, voids);
    let block = old.codec.finish(&draft, model);
    Ok(Some(Change {
        before,
        after: Arc::new(State { vertices, refined }),
        block,
    }))
}
