//! The filters of the lifted and the two-stage transform against their equations, written out one vertex
//! at a time.

use crate::rasters::{Raster, decode_diamonds};
use crate::transforms::{Limit, options};
use kimberlite::codec::{Matrix, Refined};
use kimberlite::cut::{DiamondSource, Terrain};
use kimberlite::geo::SampleType;
use kimberlite::lattice::{Diamond, Lattice};
use kimberlite::store::{Access, TransformKind};
use proptest::prelude::*;

/// A refined diamond of a lossless repository, by place in its matrices; `None` where not valid.
struct Places<'a> {
    cells: i64,
    own: &'a Matrix,
    next: &'a Matrix,
    centres: &'a Matrix,
    /// Maps a centre in an absent half to its reflection.
    mirror: Box<dyn Fn(i64, i64) -> (i64, i64) + 'a>,
}

impl<'a> Places<'a> {
    fn new(lattice: &'a Lattice, diamond: Diamond, own: &'a Matrix, refined: &'a Refined) -> Self {
        let (cells, apexes) = (lattice.cells() as i64, lattice.apexes(diamond));
        let absent = lattice.halves(diamond).iter().position(|present| !present);
        let main = lattice.has_main_hypotenuse(diamond);
        Places {
            cells,
            own,
            next: refined.vertices(own),
            centres: &refined.centres,
            mirror: Box::new(move |i, j| {
                let is_absent = absent.is_some_and(|half| {
                    apexes[half].holds_centre(cells as usize, i as usize, j as usize)
                });
                match (is_absent, main) {
                    (false, _) => (i, j),
                    (true, true) => (j, i),
                    (true, false) => (cells - 1 - j, cells - 1 - i),
                }
            }),
        }
    }

    fn vertex(&self, matrix: &Matrix, i: i64, j: i64) -> Option<i64> {
        let inside = (0..=self.cells).contains(&i) && (0..=self.cells).contains(&j);
        let index = (j * (self.cells + 1) + i) as usize;
        (inside && matrix.is_valid(index)).then(|| i64::from(matrix.values[index]))
    }

    fn centre(&self, i: i64, j: i64) -> Option<i64> {
        if !(0..self.cells).contains(&i) || !(0..self.cells).contains(&j) {
            return None;
        }
        let (i, j) = (self.mirror)(i, j);
        let index = (j * self.cells + i) as usize;
        self.centres
            .is_valid(index)
            .then(|| i64::from(self.centres.values[index]))
    }

    /// The 4 nearest and the 8 next of a point between (0, 0) and (1, 1) of a matrix.
    fn support(get: impl Fn(i64, i64) -> Option<i64>) -> ([Option<i64>; 4], [Option<i64>; 8]) {
        let near = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| get(i, j));
        let far = [
            (-1, 0),
            (-1, 1),
            (2, 0),
            (2, 1),
            (0, -1),
            (1, -1),
            (0, 2),
            (1, 2),
        ];
        (near, far.map(|(i, j)| get(i, j)))
    }

    /// The detail of eq. 1 at a centre: its difference from what valid vertices on the next level predict.
    fn detail(&self, i: i64, j: i64) -> Option<i64> {
        let (near, far) = Self::support(|di, dj| self.vertex(self.next, i + di, j + dj));
        let known: Vec<i64> = near.iter().flatten().copied().collect();
        let wide: Vec<i64> = far.iter().flatten().copied().collect();
        let prediction = if known.len() == 4 && wide.len() == 8 {
            (10 * known.iter().sum::<i64>() - wide.iter().sum::<i64>() + 16).div_euclid(32)
        } else if known.is_empty() {
            let all = (0..=self.cells).flat_map(|j| (0..=self.cells).map(move |i| (i, j)));
            let all: Vec<i64> = all
                .filter_map(|(i, j)| self.vertex(self.next, i, j))
                .collect();
            mean(&all).unwrap_or(0)
        } else {
            mean(&known)?
        };
        Some(self.centre(i, j)? - prediction)
    }

    /// Eq. 2: V' of an inner vertex.
    fn lifted(&self, i: i64, j: i64) -> Option<i64> {
        let details =
            [(-1, -1), (0, -1), (-1, 0), (0, 0)].map(|(di, dj)| self.detail(i + di, j + dj));
        let known: Vec<i64> = details.into_iter().flatten().collect();
        let count = known.len() as i64;
        let half = match count {
            0 => 0,
            _ => (known.iter().sum::<i64>() + count).div_euclid(2 * count),
        };
        Some(self.vertex(self.next, i, j)? + half)
    }

    /// P^(V)(C) at a valid inner vertex of weight 1/2; `None` at one of weight 1.
    fn predicted(&self, i: i64, j: i64, range: [i64; 2]) -> Option<i64> {
        self.vertex(self.own, i, j)?;
        let (near, far) = Self::support(|di, dj| self.centre(i - 1 + di, j - 1 + dj));
        let is_wide = (2..=self.cells - 2).contains(&i) && (2..=self.cells - 2).contains(&j);
        let sum = |points: &[Option<i64>]| points.iter().copied().sum::<Option<i64>>();
        let prediction = match (is_wide, sum(&near), sum(&far)) {
            (true, Some(near), Some(far)) => (10 * near - far + 16).div_euclid(32),
            (false, Some(near), _) => (near + 2).div_euclid(4),
            _ => return None,
        };
        Some(prediction.clamp(range[0], range[1]))
    }

    /// Eq. 3.1: P of an inner vertex, all heights within `range`.
    fn two_stage(&self, i: i64, j: i64, range: [i64; 2]) -> Option<i64> {
        let next = self.vertex(self.next, i, j)?;
        let prediction = self.predicted(i, j, range);
        Some(prediction.map_or(next, |prediction| (next + prediction + 1).div_euclid(2)))
    }

    /// Eq. 3.8: what the residual of an inner vertex was added to.
    fn unfiltered(&self, i: i64, j: i64, range: [i64; 2]) -> Option<i64> {
        let own = self.vertex(self.own, i, j)?;
        let prediction = self.predicted(i, j, range);
        Some(prediction.map_or(own, |prediction| {
            (2 * own - prediction).clamp(range[0], range[1])
        }))
    }
}

fn mean(of: &[i64]) -> Option<i64> {
    let count = of.len() as i64;
    (count > 0).then(|| (2 * of.iter().sum::<i64>() + count).div_euclid(2 * count))
}

fn rasters() -> impl Strategy<Value = Raster> {
    (2u32..90, 2u32..90, any::<u32>(), 0u32..4).prop_map(|(width, height, seed, voids)| {
        let samples = (0..width * height).map(|index| {
            let (column, row) = (index % width, index / width);
            let noise =
                ((column * 7919) ^ (row * 104_729) ^ seed).wrapping_mul(2_654_435_761) >> 20;
            let is_void = match voids {
                0 => false,
                1 => noise % 11 == 0,
                2 => noise % 3 != 0,
                _ => (column / 9 + row / 14) % 3 == 1,
            };
            if is_void {
                f64::NAN
            } else {
                f64::from(column * row % 300 + noise % 40)
            }
        });
        Raster::new(width, height, SampleType::I16, samples.collect())
    })
}

fn inner(cells: i64) -> impl Iterator<Item = (i64, i64)> {
    (1..cells).flat_map(move |j| (1..cells).map(move |i| (i, j)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn coarse_levels_are_what_the_equations_make_of_finer_ones(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for transform in [TransformKind::Lifted, TransformKind::TwoStage] {
            raster.build_with(&path, &options(transform, Limit::Max(0.0), 4)).unwrap();
            let terrain = Terrain::open(&path, Access::Map).unwrap();
            let range = terrain.range().map(i64::from);
            for (diamond, (own, refined)) in &decode_diamonds(&terrain) {
                let Some(refined) = refined else { continue };
                let places = Places::new(terrain.lattice(), *diamond, own, refined);
                for (i, j) in inner(places.cells) {
                    let expected = match transform {
                        TransformKind::Lifted => places.lifted(i, j),
                        _ => places.two_stage(i, j, range),
                    };
                    prop_assert_eq!(
                        places.vertex(places.own, i, j), expected,
                        "{:?}, {:?} of level {}, ({}, {})", transform, diamond, diamond.level(), i, j
                    );
                }
            }
        }
    }

    #[test]
    fn a_decoder_adds_multiples_of_the_step_to_what_the_equations_predict(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for (transform, limit) in [
            (TransformKind::Lifted, Limit::Rms(6.0)),
            (TransformKind::TwoStage, Limit::Max(5.0)),
        ] {
            raster.build_with(&path, &options(transform, limit, 4)).unwrap();
            let terrain = Terrain::open(&path, Access::Map).unwrap();
            let (range, step) = (terrain.range().map(i64::from), 2 * i64::from(terrain.header().bound_units) + 1);
            for (diamond, (own, refined)) in &decode_diamonds(&terrain) {
                let Some(refined) = refined else { continue };
                let places = Places::new(terrain.lattice(), *diamond, own, refined);
                for (i, j) in inner(places.cells) {
                    if transform == TransformKind::Lifted {
                        // Eq. 3 is eq. 2 with the details that were decoded.
                        prop_assert_eq!(places.vertex(places.own, i, j), places.lifted(i, j));
                        let detail = places.detail(i, j).unwrap_or(0);
                        prop_assert_eq!(detail % step, 0, "a detail of level {}", diamond.level());
                        continue;
                    }
                    let next = places.vertex(places.next, i, j);
                    let pair = next.zip(places.unfiltered(i, j, range));
                    let Some((next, predicted)) = pair else { continue };
                    let is_clamped = range.contains(&next);
                    prop_assert!(
                        is_clamped || (next - predicted) % step == 0,
                        "{:?} of level {}, ({}, {})", diamond, diamond.level(), i, j
                    );
                }
            }
        }
    }
}
