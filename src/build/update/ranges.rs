//! The stored ranges after a change. A range contains those of a diamond's children and is told in parts of its
//! first parent's, so that where that changes all that descends from it is told anew.

use super::Predecessor;
use super::changes::Changes;
use super::decoder::{Decoder, State, decode_chunks};
use crate::Result;
use crate::build::descent::{extremes, union};
use crate::codec::RangeCode;
use crate::lattice::Diamond;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// The range codes by rank, where `codes` are those before; from the root down.
pub(super) fn renewed(
    old: &Predecessor,
    changes: &Changes,
    threads: usize,
    codes: &[[u8; 3]],
) -> Result<Vec<RangeCode>> {
    let mut renewal = Renewal {
        old,
        changes,
        threads,
        former: codes
            .iter()
            .map(|&[_, low, high]| RangeCode { low, high })
            .collect(),
        changed: extremes_of_changes(old, changes),
        exact: HashMap::new(),
    };
    let mut codes = renewal.former.clone();
    let whole = old.units.range;
    // Ranges as they are decoded, before and after, of the level above.
    let mut above: BTreeMap<Diamond, [[i32; 2]; 2]> = BTreeMap::new();
    for level in 0..old.lattice.levels() {
        let mut concerned: BTreeSet<Diamond> = renewal
            .changed
            .keys()
            .filter(|diamond| diamond.level() == level)
            .copied()
            .collect();
        let moved = above.iter().filter(|(_, [before, after])| before != after);
        let children = moved.flat_map(|(&diamond, _)| renewal.first_children(diamond));
        concerned.extend(children);
        let mut own = BTreeMap::new();
        for diamond in concerned {
            let parent = old.lattice.parents(diamond).into_iter().flatten().next();
            let references = match parent {
                None => [whole; 2],
                Some(parent) => match above.get(&parent) {
                    Some(&ranges) => ranges,
                    None => [renewal.former_range(parent); 2],
                },
            };
            let rank = old.lattice.rank(diamond) as usize;
            let code = renewal.code(diamond, references)?;
            own.insert(
                diamond,
                [
                    renewal.former[rank].range(references[0]),
                    code.range(references[1]),
                ],
            );
            codes[rank] = code;
        }
        above = own;
    }
    Ok(codes)
}

struct Renewal<'a> {
    old: &'a Predecessor<'a>,
    changes: &'a Changes,
    threads: usize,
    former: Vec<RangeCode>,
    /// For what has changed descendants or has changed itself: the least range of all those, before and after.
    changed: BTreeMap<Diamond, [[i32; 2]; 2]>,
    /// Ranges of diamonds and all that descends from them, after.
    exact: HashMap<Diamond, [i32; 2]>,
}

impl Renewal<'_> {
    /// The new code, given what the code refers to, before and after.
    fn code(&mut self, diamond: Diamond, [before, after]: [[i32; 2]; 2]) -> Result<RangeCode> {
        let former = self.former[self.old.lattice.rank(diamond) as usize];
        if let Some(range) = self.exact.get(&diamond) {
            return Ok(RangeCode::covering(*range, after));
        }
        if before == after
            && let Some(changed) = self.changed.get(&diamond)
        {
            let [was, is] = changed.map(|range| RangeCode::covering(range, after));
            let end = |former: u8, was: u8, is: u8| {
                // Smaller codes are wider; what has not changed was never wider than the former code.
                if is <= former {
                    Some(is)
                } else {
                    (was > former).then_some(former)
                }
            };
            let ends = (
                end(former.low, was.low, is.low),
                end(former.high, was.high, is.high),
            );
            if let (Some(low), Some(high)) = ends {
                return Ok(RangeCode { low, high });
            }
        }
        self.measure(diamond)?;
        Ok(RangeCode::covering(self.exact[&diamond], after))
    }

    /// The range that a diamond was told to have.
    fn former_range(&self, diamond: Diamond) -> [i32; 2] {
        let parent = self
            .old
            .lattice
            .parents(diamond)
            .into_iter()
            .flatten()
            .next();
        let reference = parent.map_or(self.old.units.range, |parent| self.former_range(parent));
        self.former[self.old.lattice.rank(diamond) as usize].range(reference)
    }

    /// Refinable children whose ranges refer to a diamond's.
    fn first_children(&self, diamond: Diamond) -> Vec<Diamond> {
        let lattice = self.old.lattice;
        let is_first =
            |child: &Diamond| lattice.parents(*child).into_iter().flatten().next() == Some(diamond);
        self.children(diamond).filter(is_first).collect()
    }

    fn children(&self, diamond: Diamond) -> impl Iterator<Item = Diamond> + use<> {
        let levels = self.old.lattice.levels();
        let children = self.old.lattice.children(diamond).into_iter().flatten();
        children.filter(move |child| child.level() < levels)
    }

    /// Finds the exact ranges of a diamond and of all that descends from it.
    fn measure(&mut self, diamond: Diamond) -> Result<()> {
        let (old, changes) = (self.old, self.changes);
        let mut family = vec![BTreeSet::from([diamond])];
        loop {
            let last = &family[family.len() - 1];
            let next: BTreeSet<Diamond> = last
                .iter()
                .flat_map(|&diamond| self.children(diamond))
                .collect();
            if next.is_empty() {
                break;
            }
            family.push(next);
        }
        let mut finest: Vec<Diamond> = family[family.len() - 1].iter().copied().collect();
        finest.sort_by_key(|&diamond| old.lattice.rank(diamond));
        let look = |decoder: &mut Decoder, diamonds: &[Diamond]| -> Result<Vec<_>> {
            for &diamond in diamonds {
                decoder.state(diamond)?;
            }
            let known = decoder.known();
            Ok(known
                .map(|(diamond, state)| (diamond, own_range(old, diamond, state)))
                .collect())
        };
        let mut own: HashMap<Diamond, [i32; 2]> = changes
            .all()
            .map(|(diamond, change)| (diamond, own_range(old, diamond, &change.after)))
            .collect();
        decode_chunks(
            || Decoder::after(old, changes),
            &finest,
            self.threads,
            look,
            |known| {
                own.extend(known?);
                Ok::<(), crate::Error>(())
            },
        )?;
        // Most others are ancestors of the finest ones and known by now; not those above changed ones alone, and some at
        // the raster's edge.
        let mut decoder = Decoder::after(old, changes);
        for &diamond in family.iter().flatten() {
            if let Entry::Vacant(unknown) = own.entry(diamond) {
                let state = decoder.state(diamond)?;
                unknown.insert(own_range(old, diamond, &state));
            }
        }
        for diamond in family.into_iter().rev().flatten() {
            let range = self.children(diamond).fold(own[&diamond], |range, child| {
                union(range, self.exact[&child])
            });
            self.exact.insert(diamond, range);
        }
        Ok(())
    }
}

/// What is decoded of a diamond: of the last refinable level with its leaf heights.
fn own_range(old: &Predecessor, diamond: Diamond, state: &State) -> [i32; 2] {
    let mut range = extremes(&state.vertices, 1);
    if diamond.level() + 1 == old.lattice.levels() {
        range = union(range, extremes(&state.refined.centres, 1));
    }
    range
}

/// For each changed diamond and all its ancestors, the least range of the changed ones that descend from it,
/// before and after.
fn extremes_of_changes(old: &Predecessor, changes: &Changes) -> BTreeMap<Diamond, [[i32; 2]; 2]> {
    let mut all: BTreeMap<Diamond, [[i32; 2]; 2]> = BTreeMap::new();
    for (diamond, change) in changes.all() {
        let states = [&change.before, &change.after];
        all.insert(diamond, states.map(|state| own_range(old, diamond, state)));
    }
    for level in (1..old.lattice.levels()).rev() {
        let own: Vec<_> = all
            .iter()
            .filter(|(diamond, _)| diamond.level() == level)
            .map(|(&diamond, &ranges)| (diamond, ranges))
            .collect();
        for (diamond, ranges) in own {
            for parent in old.lattice.parents(diamond).into_iter().flatten() {
                let known = all.entry(parent).or_insert(ranges);
                *known = [union(known[0], ranges[0]), union(known[1], ranges[1])];
            }
        }
    }
    all
}
