//! A polygon as trapezoids between rows.

use crate::{Error, Result};
use std::collections::BTreeMap;

/// By what part of their columns edges that touch may cross each other: rounding errors.
const TOUCH: f64 = 1e-9;

/// An edge that is not along a row, from its least row.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    top: [f64; 2],
    bottom: [f64; 2],
}

/// A part of a polygon between two rows and two edges: columns at the upper row and at the lower one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trapezoid {
    rows: [f64; 2],
    left: [f64; 2],
    right: [f64; 2],
}

impl Edge {
    fn of(a: [f64; 2], b: [f64; 2]) -> Option<Edge> {
        if a[1] == b[1] {
            return None;
        }
        let (top, bottom) = if a[1] < b[1] { (a, b) } else { (b, a) };
        Some(Edge { top, bottom })
    }

    /// Its column at a row that it has.
    fn at(&self, row: f64) -> f64 {
        if row == self.bottom[1] {
            return self.bottom[0];
        }
        let share = (row - self.top[1]) / (self.bottom[1] - self.top[1]);
        self.top[0] + share * (self.bottom[0] - self.top[0])
    }
}

impl Trapezoid {
    fn between(left: &Edge, right: &Edge, rows: [f64; 2]) -> Trapezoid {
        let [left, right] = [left, right].map(|edge| rows.map(|row| edge.at(row)));
        Trapezoid { rows, left, right }
    }

    /// From column 0 and row 0 to the last ones.
    pub(super) fn rectangle([column, row]: [f64; 2]) -> Trapezoid {
        Trapezoid {
            rows: [0.0, row],
            left: [0.0; 2],
            right: [column; 2],
        }
    }

    /// In order around it.
    pub(super) fn corners(&self) -> [[f64; 2]; 4] {
        let [top, bottom] = self.rows;
        [
            [self.left[0], top],
            [self.right[0], top],
            [self.right[1], bottom],
            [self.left[1], bottom],
        ]
    }

    /// How far a place is inside each side, in no common measure.
    fn inside(&self, side: usize, [column, row]: [f64; 2]) -> f64 {
        let [top, bottom] = self.rows;
        let right_of = |[upper, lower]: [f64; 2]| {
            (column - upper) * (bottom - top) - (row - top) * (lower - upper)
        };
        match side {
            0 => row - top,
            1 => bottom - row,
            2 => right_of(self.left),
            _ => -right_of(self.right),
        }
    }

    /// Whether all of a triangle is in it.
    pub(super) fn has(&self, triangle: &[[f64; 2]; 3]) -> bool {
        (0..4).all(|side| {
            triangle
                .iter()
                .all(|&corner| self.inside(side, corner) >= 0.0)
        })
    }

    /// Leaves of a ring of places and heights what is in it; `room` is used in between.
    pub(super) fn clip(&self, ring: &mut Vec<[f64; 3]>, room: &mut Vec<[f64; 3]>) {
        for side in 0..4 {
            let inside = |[column, row, _]: [f64; 3]| self.inside(side, [column, row]);
            if ring.iter().all(|&corner| inside(corner) >= 0.0) {
                continue;
            }
            room.clear();
            for (index, &corner) in ring.iter().enumerate() {
                let next = ring[(index + 1) % ring.len()];
                let (here, there) = (inside(corner), inside(next));
                if here >= 0.0 {
                    room.push(corner);
                }
                if here * there < 0.0 {
                    let share = here / (here - there);
                    room.push([0, 1, 2].map(|k| corner[k] + share * (next[k] - corner[k])));
                }
            }
            std::mem::swap(ring, room);
        }
    }
}

/// The inside of a polygon, which does not cross itself: between every first and second of its edges along a row.
/// Neighbours between the same two edges are one.
///
/// # Errors
///
/// [`Error::Argument`] for a polygon that crosses itself or encloses no area.
pub(super) fn trapezoids(polygon: &[[f64; 2]]) -> Result<Vec<Trapezoid>> {
    let next = |index: usize| polygon[(index + 1) % polygon.len()];
    let edges = polygon.iter().enumerate();
    let edges: Vec<Edge> = edges
        .filter_map(|(index, &point)| Edge::of(point, next(index)))
        .collect();
    let mut rows: Vec<f64> = polygon.iter().map(|point| point[1]).collect();
    rows.sort_unstable_by(f64::total_cmp);
    rows.dedup();
    let mut parts = Vec::new();
    let mut close = |pairs: BTreeMap<[usize; 2], f64>, row: f64| {
        let trapezoid = |([left, right], top): ([usize; 2], f64)| {
            Trapezoid::between(&edges[left], &edges[right], [top, row])
        };
        parts.extend(pairs.into_iter().map(trapezoid));
    };
    // Pairs of edges that have the inside between them, and since which row.
    let mut open = BTreeMap::new();
    for slab in rows.windows(2) {
        let pairs = pairs_between(&edges, [slab[0], slab[1]])?.into_iter();
        let going_on = pairs
            .map(|pair| (pair, open.remove(&pair).unwrap_or(slab[0])))
            .collect();
        close(open, slab[0]);
        open = going_on;
    }
    if let Some(&last) = rows.last() {
        close(open, last);
    }
    parts.retain(|part| part.left != part.right);
    if parts.is_empty() {
        return Err(Error::Argument("the polygon encloses no area".into()));
    }
    Ok(parts)
}

/// Edges that have the inside of a polygon between them, from one row to the next that any edge begins or ends at.
fn pairs_between(edges: &[Edge], [top, bottom]: [f64; 2]) -> Result<Vec<[usize; 2]>> {
    let mut across: Vec<(f64, usize)> = edges
        .iter()
        .enumerate()
        .filter(|(_, edge)| edge.top[1] <= top && edge.bottom[1] >= bottom)
        .map(|(index, edge)| (edge.at(top) + edge.at(bottom), index))
        .collect();
    across.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let crosses = across.windows(2).any(|pair| {
        let [left, right] = [pair[0], pair[1]].map(|(_, index)| &edges[index]);
        [top, bottom]
            .into_iter()
            .map(|row| [left.at(row), right.at(row)])
            .any(|[left, right]| left - right > TOUCH * (1.0 + left.abs()))
    });
    if crosses {
        return Err(Error::Argument("the polygon crosses itself".into()));
    }
    Ok(across
        .chunks_exact(2)
        .map(|pair| [pair[0].1, pair[1].1])
        .collect())
}
