//! The stored errors after a change. An error is the largest of a diamond's own and of its children's; of most
//! ancestors what lies outside the rectangle need not be looked at, because it cannot have made their error what
//! it is, or certainly has.

use super::changes::{Change, Changes};
use super::decoder::Decoder;
use super::search::Search;
use super::{Predecessor, Replacement};
use crate::Result;
use crate::build::leaf::Tile;
use crate::build::surface::{Finding, extent_of, look_at};
use crate::codec::{ErrorCode, Matrix};
use crate::lattice::Diamond;
use std::collections::{BTreeMap, BTreeSet};

/// Samples around changes that are looked at; where there are more, a search is quicker.
const MOST_LOOKED_AT: i64 = 1 << 20;

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
    // No triangle is longer than the root's legs.
    let widest = around(old, new.corners(), extent_of(lattice, lattice.root()));
    let surroundings = tiles(old, new, &mut before, widest)?;
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
        let extent = extent_of(lattice, any);
        let boxes = |diamond: &Diamond| {
            let change = changes.get(*diamond);
            let own = change.map(|change| box_of_changes(old, new, *diamond, change));
            around(old, own.unwrap_or(new.corners()), extent)
        };
        let boxes: Vec<_> = concerned.iter().map(boxes).collect();
        let usual = around(old, new.corners(), extent);
        let corners = hull_if_small(usual, &boxes);
        let sight = if hull_of(corners, widest) == widest {
            surroundings.each_ref().map(|tile| tile.part(corners))
        } else {
            tiles(old, new, &mut before, corners)?
        };
        for (&diamond, own) in concerned.iter().zip(boxes) {
            let renewal = Renewal::new(old, diamond, &former, &codes);
            let decided = match changes.get(diamond) {
                _ if hull_of(corners, own) != corners => None,
                Some(change) => {
                    let states = [&change.before.vertices, &change.after.vertices];
                    renewal.decide(old, &sight, states)
                }
                None => {
                    let state = before.state(diamond)?;
                    renewal.decide(old, &sight, [&state.vertices; 2])
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

/// The leaf level in a box that has the rectangle, before and after.
fn tiles(
    old: &Predecessor,
    new: &Replacement,
    decoder: &mut Decoder,
    corners: [[i64; 2]; 2],
) -> Result<[Tile; 2]> {
    let before = decoder.tile(corners)?;
    let mut after = before.part(corners);
    for place in new.places() {
        after.set(place, new.height(old.units, place).flatten());
    }
    Ok([before, after])
}

/// A box widened on all sides, inside the raster.
fn around(old: &Predecessor, [first, last]: [[i64; 2]; 2], reach: i64) -> [[i64; 2]; 2] {
    let ends = [old.lattice.width(), old.lattice.height()].map(|side| i64::from(side) - 1);
    [
        first.map(|start| (start - reach).max(0)),
        [0, 1].map(|axis| (last[axis] + reach).min(ends[axis])),
    ]
}

/// The least box with all of these, or the first one where that is too large to be looked at.
fn hull_if_small(first: [[i64; 2]; 2], others: &[[[i64; 2]; 2]]) -> [[i64; 2]; 2] {
    let hull = others.iter().fold(first, |hull, own| hull_of(hull, *own));
    match area(hull) <= MOST_LOOKED_AT {
        true => hull,
        false => first,
    }
}

/// The least box with two others.
fn hull_of(one: [[i64; 2]; 2], other: [[i64; 2]; 2]) -> [[i64; 2]; 2] {
    let fold = |end: usize, pick: fn(i64, i64) -> i64| {
        [0, 1].map(|axis| pick(one[end][axis], other[end][axis]))
    };
    [fold(0, i64::min), fold(1, i64::max)]
}

fn area([first, last]: [[i64; 2]; 2]) -> i64 {
    (last[0] - first[0] + 1) * (last[1] - first[1] + 1)
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

    /// The new code by all whose distance from the diamond can have changed, or `None` where all that it covers must be
    /// looked at.
    fn decide(
        &self,
        old: &Predecessor,
        sight: &[Tile; 2],
        [before, after]: [&Matrix; 2],
    ) -> Option<u8> {
        if self.children == ErrorCode::UNBOUNDED.0 {
            return Some(self.children);
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

/// The box of the rectangle and of all vertices of present halves that are not what they were, as those of voids and
/// beyond the raster's edge may.
fn box_of_changes(
    old: &Predecessor,
    new: &Replacement,
    diamond: Diamond,
    change: &Change,
) -> [[i64; 2]; 2] {
    let mut corners = new.corners();
    let [before, after] = [&change.before.vertices, &change.after.vertices];
    if before == after {
        return corners;
    }
    let (lattice, placement) = (old.lattice, old.lattice.placement(diamond));
    let (apexes, present) = (lattice.apexes(diamond), lattice.halves(diamond));
    let side = lattice.cells() + 1;
    // What mirrors a change across the hypotenuse is drawn nowhere.
    for half in (0..2).filter(|&half| present[half]) {
        for j in 0..side {
            let (first, last) = apexes[half].row(lattice.cells() as i64, j as i64);
            for i in first as usize..=last as usize {
                let index = j * side + i;
                let is_same = before.values[index] == after.values[index]
                    && before.is_valid(index) == after.is_valid(index);
                if !is_same {
                    corners = hull_of(corners, [placement.vertex(i, j); 2]);
                }
            }
        }
    }
    corners
}
