//! The stored errors after a change. An error is the largest of a diamond's own and of its children's; of most
//! ancestors what lies outside the rectangle need not be looked at, because it cannot have made their error what
//! it is, or certainly has.

use super::changes::Changes;
use super::decoder::Decoder;
use super::search::Search;
use super::{Predecessor, Replacement};
use crate::Result;
use crate::build::leaf::Tile;
use crate::build::surface::{Finding, extent_of, look_at};
use crate::codec::{ErrorCode, Matrix};
use crate::lattice::Diamond;
use std::collections::{BTreeMap, BTreeSet};

/// The error codes by rank, where `codes` are those before; from the finest level up. `before` decodes the file as it
/// was.
pub(super) fn renewed(
    old: &Predecessor,
    new: &Replacement,
    changes: &Changes,
    mut before: Decoder,
    codes: &[[u8; 3]],
) -> Result<Vec<u8>> {
    let lattice = old.lattice;
    let surroundings = Surroundings::new(old, new, &mut before)?;
    // Samples on a diamond's edge count for it, so that it is of concern where a wider rectangle meets its inside.
    let [first, last] = new.corners();
    let [first, last] = [first.map(|start| start - 1), last.map(|end| end + 1)];
    let former: Vec<u8> = codes.iter().map(|code| code[0]).collect();
    let mut codes = former.clone();
    let mut changed: BTreeMap<u32, Vec<Diamond>> = BTreeMap::new();
    for (diamond, _) in changes.all() {
        changed.entry(diamond.level()).or_default().push(diamond);
    }
    let mut search = Search::new(old, changes);
    let mut finer: BTreeSet<Diamond> = BTreeSet::new();
    for level in (0..lattice.levels()).rev() {
        let mut concerned: BTreeSet<Diamond> =
            changed.remove(&level).into_iter().flatten().collect();
        concerned.extend(lattice.diamonds_around(level, first, last));
        let parents = finer.iter().flat_map(|&diamond| lattice.parents(diamond));
        concerned.extend(parents.flatten());
        let Some(&any) = concerned.first() else {
            continue;
        };
        let sight = surroundings.of(old, new, any);
        for &diamond in &concerned {
            let renewal = Renewal::new(old, diamond, &former, &codes);
            let decided = match changes.get(diamond) {
                Some(change) => {
                    let states = [&change.before.vertices, &change.after.vertices];
                    renewal.decide(old, new, &sight, states)
                }
                None => {
                    let state = before.state(diamond)?;
                    renewal.decide(old, new, &sight, [&state.vertices; 2])
                }
            };
            codes[lattice.rank(diamond) as usize] = match decided {
                Some(code) => code,
                None => search.largest(diamond, renewal.children, &codes)?,
            };
        }
        finer = concerned;
    }
    Ok(codes)
}

/// The leaf level around the rectangle, before and after.
struct Surroundings {
    tiles: [Tile; 2],
}

impl Surroundings {
    fn new(old: &Predecessor, new: &Replacement, decoder: &mut Decoder) -> Result<Surroundings> {
        // No triangle is longer than the root's legs.
        let widest = extent_of(old.lattice, old.lattice.root());
        let corners = around(old, new, widest);
        let before = decoder.tile(corners)?;
        let mut after = before.part(corners);
        for place in new.places() {
            after.set(place, new.height(old.units, place).flatten());
        }
        Ok(Surroundings {
            tiles: [before, after],
        })
    }

    /// All whose distance from a surface of such diamonds can have changed, before and after.
    fn of(&self, old: &Predecessor, new: &Replacement, diamond: Diamond) -> [Tile; 2] {
        let corners = around(old, new, extent_of(old.lattice, diamond));
        self.tiles.each_ref().map(|tile| tile.part(corners))
    }
}

/// The rectangle widened on all sides, inside the raster.
fn around(old: &Predecessor, new: &Replacement, reach: i64) -> [[i64; 2]; 2] {
    let ends = [old.lattice.width(), old.lattice.height()].map(|side| i64::from(side) - 1);
    let [first, last] = new.corners();
    [
        first.map(|start| (start - reach).max(0)),
        [0, 1].map(|axis| (last[axis] + reach).min(ends[axis])),
    ]
}

/// What decides a diamond's new code.
struct Renewal {
    diamond: Diamond,
    /// Its own code before.
    former: u8,
    /// The largest code of its children that is not what it was, before.
    former_children: u8,
    /// The largest code of its children.
    children: u8,
}

impl Renewal {
    fn new(old: &Predecessor, diamond: Diamond, former: &[u8], codes: &[u8]) -> Renewal {
        let lattice = old.lattice;
        let mut renewal = Renewal {
            diamond,
            former: former[lattice.rank(diamond) as usize],
            former_children: 0,
            children: 0,
        };
        let children = lattice.children(diamond).into_iter().flatten();
        for child in children.filter(|child| child.level() < lattice.levels()) {
            let rank = lattice.rank(child) as usize;
            renewal.children = renewal.children.max(codes[rank]);
            if former[rank] != codes[rank] {
                renewal.former_children = renewal.former_children.max(former[rank]);
            }
        }
        renewal
    }

    /// The new code, or `None` where all that the diamond covers must be looked at.
    fn decide(
        &self,
        old: &Predecessor,
        new: &Replacement,
        sight: &[Tile; 2],
        [before, after]: [&Matrix; 2],
    ) -> Option<u8> {
        if self.children == ErrorCode::UNBOUNDED.0 {
            return Some(self.children);
        }
        if has_changed_beyond(old, new, self.diamond, before, after) {
            return None;
        }
        let has_voids = old.store.header().void_samples > 0;
        let look = |vertices, tile| look_at(old.lattice, self.diamond, vertices, tile, has_voids);
        let findings = [look(before, &sight[0]), look(after, &sight[1])];
        if findings.iter().any(Finding::shows_void) {
            return None;
        }
        let [was, is] = findings.map(|finding| ErrorCode::covering(finding.error()).0);
        let least = is.max(self.children);
        if least >= self.former {
            // What lies outside was never more than the former code.
            return Some(least);
        }
        // Whatever made the former code is still there.
        (was.max(self.former_children) < self.former).then_some(self.former)
    }
}

/// Whether a vertex outside the rectangle has changed, as those of voids may.
fn has_changed_beyond(
    old: &Predecessor,
    new: &Replacement,
    diamond: Diamond,
    before: &Matrix,
    after: &Matrix,
) -> bool {
    if before == after {
        return false;
    }
    let (placement, side) = (old.lattice.placement(diamond), old.lattice.cells() + 1);
    (0..side * side).any(|index| {
        let is_same = before.values[index] == after.values[index]
            && before.is_valid(index) == after.is_valid(index);
        !is_same && !new.contains(placement.vertex(index % side, index / side))
    })
}
