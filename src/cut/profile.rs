//! The finest surface that there is along a line.

use super::drawn::{DrawnHalf, Facet};
use super::query::{EDGE_TOLERANCE, Height, Query};
use super::source::DiamondSource;
use super::terrain::Terrain;
use crate::{Error, Result};
use std::sync::Arc;

/// Least length, in samples, of a piece of a profile: shorter ones come of lines that cross at one place but for
/// rounding errors.
const LEAST_PIECE: f64 = 1e-9;

/// A place of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfilePlace {
    /// World units along the line from its start.
    pub distance: f64,
    /// World x and y.
    pub place: [f64; 2],
    /// `None` where there is no surface: outside the raster and in voids. Where two triangles meet, the greater bound
    /// and the coarser level of both.
    pub height: Option<Height>,
}

impl Query {
    /// The exact profile of the finest surface along a line of two points or more, in world coordinates; where detail is
    /// missing, of the triangles that the finest possible cut draws.
    ///
    /// The places are the line's points and all at which it crosses from one triangle to the next. Between two
    /// places with heights the surface is straight, and the bounds of both hold. Where it ends or begins, at a void or
    /// the raster's edge, there are two places at the same distance, one of them without a height.
    ///
    /// A line along the edge of what is drawn, or beside it by rounding errors, is on it.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for fewer than two points, and coordinates that are not finite or too far apart; those of
    /// reading and decoding blocks.
    pub fn profile(&mut self, line: &[[f64; 2]]) -> Result<Vec<ProfilePlace>> {
        let segments = segments(self.terrain(), line)?;
        let mut walk = Walk {
            terrain: self.terrain().clone(),
            query: self,
            half: None,
            places: Vec::new(),
        };
        for segment in &segments {
            walk.follow(segment)?;
        }
        Ok(walk.places)
    }

    /// Heights at `count` places along a line, evenly spaced from its start to its end; each is what
    /// [`height_at_world`](Self::height_at_world) gives. A count of 1 gives the start.
    ///
    /// # Errors
    ///
    /// Those of [`profile`](Self::profile).
    pub fn profile_samples(
        &mut self,
        line: &[[f64; 2]],
        count: usize,
    ) -> Result<Vec<ProfilePlace>> {
        let segments = segments(self.terrain(), line)?;
        let mut places = Vec::new();
        let Some(last) = segments.last() else {
            return Ok(places);
        };
        let total = last.start + last.length;
        let (mut at, step) = (0, total / (count.max(2) - 1) as f64);
        for index in 0..count {
            let is_end = index > 0 && index + 1 == count;
            let distance = if is_end {
                total
            } else {
                (step * index as f64).min(total)
            };
            while at + 1 < segments.len() && segments[at + 1].start <= distance {
                at += 1;
            }
            let segment = &segments[at];
            let share = if is_end {
                1.0
            } else if segment.length > 0.0 {
                ((distance - segment.start) / segment.length).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let place = segment.place(share);
            places.push(ProfilePlace {
                distance,
                place,
                height: self.height_at_world(place[0], place[1])?,
            });
        }
        Ok(places)
    }
}

/// A straight part of a line, in world coordinates.
struct Segment {
    from: [f64; 2],
    to: [f64; 2],
    /// Distance of `from`, and from it to `to`.
    start: f64,
    length: f64,
    /// Columns and rows of its ends.
    grid: [[f64; 2]; 2],
}

fn segments(terrain: &Terrain, line: &[[f64; 2]]) -> Result<Vec<Segment>> {
    if line.len() < 2 {
        return Err(Error::Argument(format!(
            "a line needs two points, not {}",
            line.len()
        )));
    }
    let (frame, lattice) = (terrain.frame(), terrain.lattice());
    let last = [lattice.width() - 1, lattice.height() - 1].map(f64::from);
    let mut start = 0.0;
    let mut segments = Vec::with_capacity(line.len() - 1);
    for ends in line.windows(2) {
        let [from, to] = [ends[0], ends[1]];
        let grid = [from, to].map(|[x, y]| {
            let [column, row] = frame.world_to_grid(x, y);
            [snapped(column, last[0]), snapped(row, last[1])]
        });
        let length = f64::hypot(to[0] - from[0], to[1] - from[1]);
        let samples = f64::hypot(grid[1][0] - grid[0][0], grid[1][1] - grid[0][1]);
        if !(start + length).is_finite() || !samples.is_finite() {
            return Err(Error::Argument(format!(
                "the line from {from:?} to {to:?} needs numbers that are finite and not too far apart"
            )));
        }
        segments.push(Segment {
            from,
            to,
            start,
            length,
            grid,
        });
        start += length;
    }
    Ok(segments)
}

/// To the raster's edge, if a column or row is beside it by no more than rounding errors.
fn snapped(along: f64, last: f64) -> f64 {
    let inside = along.clamp(0.0, last);
    if (along - inside).abs() <= EDGE_TOLERANCE {
        inside
    } else {
        along
    }
}

impl Segment {
    /// World x and y after a share of it.
    fn place(&self, share: f64) -> [f64; 2] {
        between(self.from, self.to, share)
    }

    /// The part of [0, 1] over the raster, whose last column and row are `last`.
    fn over_raster(&self, last: [f64; 2]) -> Option<[f64; 2]> {
        let [mut from, mut to] = [0.0f64, 1.0f64];
        for (axis, last) in last.into_iter().enumerate() {
            let [first, second] = self.grid.map(|end| end[axis]);
            let edges = [0.0, last];
            if first == second {
                if !(0.0..=last).contains(&first) {
                    return None;
                }
                continue;
            }
            let shares = edges.map(|edge| (edge - first) / (second - first));
            from = from.max(shares[0].min(shares[1]));
            to = to.min(shares[0].max(shares[1]));
        }
        (from <= to).then_some([from, to])
    }
}

/// From `a` to `b` by a share; exactly `b` for 1.
fn between(a: [f64; 2], b: [f64; 2], share: f64) -> [f64; 2] {
    if share == 1.0 {
        return b;
    }
    [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]))
}

/// A part of a segment over one triangle, or over none.
struct Piece {
    facet: Option<Facet>,
    /// Shares of the part of the segment over the raster.
    from: f64,
    to: f64,
}

struct Walk<'a> {
    terrain: Arc<Terrain>,
    query: &'a mut Query,
    /// Where the last place was.
    half: Option<DrawnHalf>,
    places: Vec<ProfilePlace>,
}

impl Walk<'_> {
    fn follow(&mut self, segment: &Segment) -> Result<()> {
        let lattice = self.terrain.lattice();
        let last = [lattice.width() - 1, lattice.height() - 1].map(f64::from);
        let Some([from, to]) = segment.over_raster(last) else {
            self.put(segment, 0.0, None);
            self.put(segment, 1.0, None);
            return Ok(());
        };
        if from > 0.0 {
            self.put(segment, 0.0, None);
            self.put(segment, from, None);
        }
        let ends = [from, to].map(|share| {
            let [column, row] = between(segment.grid[0], segment.grid[1], share);
            [column.clamp(0.0, last[0]), row.clamp(0.0, last[1])]
        });
        let share = |part: f64| {
            if part == 1.0 {
                to
            } else {
                from + part * (to - from)
            }
        };
        let mut piece: Option<Piece> = None;
        let mut before = 0.0;
        for part in cuts(ends) {
            let facet = self.facet(ends, (before + part) / 2.0, last)?;
            match &mut piece {
                Some(piece) if is_same(&piece.facet, &facet) => piece.to = part,
                _ => {
                    let next = Piece {
                        facet,
                        from: before,
                        to: part,
                    };
                    if let Some(done) = piece.replace(next) {
                        self.put_piece(segment, &done, ends, share);
                    }
                }
            }
            before = part;
        }
        if let Some(done) = &piece {
            self.put_piece(segment, done, ends, share);
        }
        if to < 1.0 {
            self.put(segment, to, None);
            self.put(segment, 1.0, None);
        }
        Ok(())
    }

    /// The triangle over a place between two others, or beside it by less than rounding errors may come to.
    fn facet(&mut self, ends: [[f64; 2]; 2], part: f64, last: [f64; 2]) -> Result<Option<Facet>> {
        let middle = between(ends[0], ends[1], part);
        let along = [0, 1].map(|axis| ends[1][axis] - ends[0][axis]);
        let length = f64::hypot(along[0], along[1]).max(f64::MIN_POSITIVE);
        for beside in [0.0, EDGE_TOLERANCE, -EDGE_TOLERANCE] {
            let across = [-along[1], along[0]].map(|across| beside * (across / length));
            let at = [0, 1].map(|axis| (middle[axis] + across[axis]).clamp(0.0, last[axis]));
            let half = match self.half.take() {
                Some(half) if half.contains(&self.terrain, at) => half,
                _ => self.query.drawn_around(at)?,
            };
            let facet = half.facet(&self.terrain, at);
            self.half = Some(half);
            if facet.is_some() {
                return Ok(facet);
            }
        }
        Ok(None)
    }

    fn put_piece(
        &mut self,
        segment: &Segment,
        piece: &Piece,
        ends: [[f64; 2]; 2],
        share: impl Fn(f64) -> f64,
    ) {
        for part in [piece.from, piece.to] {
            let at = between(ends[0], ends[1], part);
            let height = piece.facet.as_ref().map(|facet| facet.height(at));
            self.put(segment, share(part), height);
        }
    }

    /// Adds a place, or joins it with the last one if that is the same.
    fn put(&mut self, segment: &Segment, share: f64, height: Option<Height>) {
        let distance = segment.start + share * segment.length;
        let last = self.places.last_mut();
        let last = last.filter(|last| last.distance == distance);
        match (last, height) {
            (Some(ProfilePlace { height: None, .. }), None) => {}
            (
                Some(ProfilePlace {
                    height: Some(last), ..
                }),
                Some(height),
            ) => {
                last.error_bound = last.error_bound.max(height.error_bound);
                last.level = last.level.min(height.level);
            }
            _ => self.places.push(ProfilePlace {
                distance,
                place: segment.place(share),
                height,
            }),
        }
    }
}

fn is_same(a: &Option<Facet>, b: &Option<Facet>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => a.is_same(b),
        (None, None) => true,
        _ => false,
    }
}

/// Where a line between two places crosses columns, rows and diagonals of samples, on which all edges of triangles lie:
/// shares of it, in order, the last one 1.
fn cuts(ends: [[f64; 2]; 2]) -> impl Iterator<Item = f64> {
    let along = |end: [f64; 2]| [end[0], end[1], end[0] - end[1], end[0] + end[1]];
    let [first, last] = ends.map(along);
    let length = f64::hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]);
    // The next line of each kind, and where it is crossed.
    let mut lines: [f64; 4] = std::array::from_fn(|kind| {
        if last[kind] > first[kind] {
            first[kind].floor() + 1.0
        } else {
            first[kind].ceil() - 1.0
        }
    });
    let crossing = move |kind: usize, line: f64| {
        let is_before = (line - last[kind]) * (last[kind] - first[kind]) < 0.0;
        let share = (line - first[kind]) / (last[kind] - first[kind]);
        if is_before { share } else { 1.0 }
    };
    let mut before = Some(0.0f64);
    std::iter::from_fn(move || {
        let since = before?;
        loop {
            let shares: [f64; 4] = std::array::from_fn(|kind| crossing(kind, lines[kind]));
            let mut next = 0;
            for kind in 1..4 {
                if shares[kind] < shares[next] {
                    next = kind;
                }
            }
            let share = shares[next];
            if share >= 1.0 {
                before = None;
                return Some(1.0);
            }
            lines[next] += (last[next] - first[next]).signum();
            if (share - since).min(1.0 - share) * length >= LEAST_PIECE {
                before = Some(share);
                return Some(share);
            }
        }
    })
}
