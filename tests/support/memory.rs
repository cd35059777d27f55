//! A source of diamonds straight out of a raster, without any codec.

use kimberlite::codec::{Matrix, Outline, Refined, child_vertices};
use kimberlite::cut::{DiamondSource, Summary};
use kimberlite::geo::Frame;
use kimberlite::lattice::{Diamond, Lattice, Placement};
use kimberlite::transform::predict;
use kimberlite::{Error, Result};
use std::collections::{HashMap, HashSet};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Heights by row and column; `None` is void.
#[derive(Clone)]
pub struct Raster {
    pub width: u32,
    pub height: u32,
    pub samples: Vec<Option<i32>>,
    /// Least and greatest sample.
    pub range: [i32; 2],
}

impl Raster {
    pub fn new(width: u32, height: u32, sample: impl Fn(i64, i64) -> Option<i32>) -> Raster {
        let at = |k: i64| sample(k % i64::from(width), k / i64::from(width));
        let samples: Vec<Option<i32>> = (0..i64::from(width) * i64::from(height)).map(at).collect();
        let valid = || samples.iter().flatten().copied();
        let range = [valid().min().unwrap_or(0), valid().max().unwrap_or(0)];
        Raster {
            width,
            height,
            samples,
            range,
        }
    }

    /// The sample there; `None` where void or outside.
    pub fn at(&self, [column, row]: [i64; 2]) -> Option<i32> {
        let inside = (0..i64::from(self.width)).contains(&column)
            && (0..i64::from(self.height)).contains(&row);
        inside
            .then(|| self.samples[(row * i64::from(self.width) + column) as usize])
            .flatten()
    }
}

/// Whose samples are a raster's, and whose errors are exact (infinite over voids).
pub struct MemorySource {
    pub raster: Raster,
    lattice: Lattice,
    frame: Frame,
    root: Matrix,
    /// By diamond; without it every error is `constant_error` and every range the whole.
    summaries: Option<HashMap<Diamond, Summary>>,
    constant_error: f64,
    /// Errors are random instead, by this seed.
    pub random_errors: Option<u64>,
    /// Diamonds whose centres cannot be had.
    pub broken: HashSet<Diamond>,
    /// Diamonds that say that their centres are missing.
    pub missing: HashSet<Diamond>,
    pub delay: Duration,
    /// Diamonds asked for, and when.
    pub asked: Mutex<Vec<(Diamond, Instant)>>,
}

impl MemorySource {
    /// A source with exact errors, for small rasters.
    pub fn exact(raster: Raster, cells_log2: u32) -> MemorySource {
        let mut source = MemorySource::rough(raster, cells_log2, 0.0);
        source.summaries = Some(Summaries::new(&source).find());
        source
    }

    /// A source with the same error for all diamonds.
    pub fn rough(raster: Raster, cells_log2: u32, error: f64) -> MemorySource {
        let lattice = Lattice::new(raster.width, raster.height, cells_log2).unwrap();
        let root = root_of(&lattice, &raster);
        MemorySource {
            frame: Frame {
                origin: [500_000.0, 4_000_000.0],
                step: [30.0, -30.0],
            },
            lattice,
            root,
            raster,
            summaries: None,
            constant_error: error,
            random_errors: None,
            broken: HashSet::new(),
            missing: HashSet::new(),
            delay: Duration::ZERO,
            asked: Mutex::default(),
        }
    }

    /// World position of a height over a sample.
    pub fn world(&self, [column, row]: [i64; 2], unit: f64) -> [f64; 3] {
        let [x, y] = self.frame.grid_to_world(column as f64, row as f64);
        let [offset, scale] = self.height_to_world();
        [x, y, offset + scale * unit]
    }

    fn centres_of(&self, diamond: Diamond, vertices: &Matrix) -> Matrix {
        let cells = self.lattice.cells();
        let mut values = vec![0; cells * cells].into_boxed_slice();
        let [low, high] = self.raster.range;
        predict(cells, &vertices.values, low, high, &mut values);
        let mut valid = vec![0; cells * cells].into_boxed_slice();
        let outline = Outline::of(&self.lattice, diamond);
        let placement = self.lattice.placement(diamond);
        for index in 0..cells * cells {
            if !outline.is_codable(index) {
                continue;
            }
            if let Some(sample) = self
                .raster
                .at(placement.centre(index % cells, index / cells))
            {
                (values[index], valid[index]) = (sample, 1);
            }
        }
        Matrix::new(values, valid)
    }
}

impl DiamondSource for MemorySource {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn height_to_world(&self) -> [f64; 2] {
        [100.0, 0.5]
    }

    fn root(&self) -> &Matrix {
        &self.root
    }

    fn range(&self) -> [i32; 2] {
        self.raster.range
    }

    fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary> {
        assert!(
            diamond.level() < self.lattice.levels(),
            "a leaf diamond has no summary"
        );
        Ok(match &self.summaries {
            Some(summaries) => Summary {
                is_missing: self.missing.contains(&diamond),
                ..summaries[&diamond]
            },
            None => Summary {
                error: match self.random_errors {
                    Some(seed) => random_error(diamond, seed),
                    None => self.constant_error,
                },
                range: parent_range,
                is_missing: self.missing.contains(&diamond),
            },
        })
    }

    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        self.asked.lock().unwrap().push((diamond, Instant::now()));
        std::thread::sleep(self.delay);
        if self.broken.contains(&diamond) {
            return Err(Error::Argument("a broken block".into()));
        }
        Ok(Refined {
            vertices: None,
            centres: self.centres_of(diamond, vertices),
        })
    }
}

/// Uniform in its logarithm, over four orders of magnitude.
fn random_error(diamond: Diamond, seed: u64) -> f64 {
    let mut hash = (diamond.x as u64) << 32 ^ diamond.y as u64 ^ seed;
    for _ in 0..3 {
        hash = (hash ^ (hash >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    10f64.powf((hash >> 32) as f64 / 2f64.powi(30))
}

fn root_of(lattice: &Lattice, raster: &Raster) -> Matrix {
    let side = lattice.cells() + 1;
    let placement = lattice.placement(lattice.root());
    let samples: Vec<Option<i32>> = (0..side * side)
        .map(|k| raster.at(placement.vertex(k % side, k / side)))
        .collect();
    let [low, high] = raster.range;
    let middle = ((i64::from(low) + i64::from(high)) / 2) as i32;
    let nearest = |k: usize| {
        let known = (0..side * side).filter(|&other| samples[other].is_some());
        known.min_by_key(|&other| {
            let (di, dj) = (
                (k % side).abs_diff(other % side),
                (k / side).abs_diff(other / side),
            );
            di * di + dj * dj
        })
    };
    let value = |k: usize| samples[k].or_else(|| nearest(k).and_then(|other| samples[other]));
    Matrix::new(
        (0..side * side)
            .map(|k| value(k).unwrap_or(middle))
            .collect(),
        samples
            .iter()
            .map(|sample| u8::from(sample.is_some()))
            .collect(),
    )
}

/// Errors and ranges by comparing every diamond with every sample in it.
struct Summaries<'a> {
    source: &'a MemorySource,
    matrices: HashMap<Diamond, (Matrix, Option<Matrix>)>,
}

impl<'a> Summaries<'a> {
    fn new(source: &'a MemorySource) -> Summaries<'a> {
        let lattice = &source.lattice;
        let mut matrices: HashMap<Diamond, (Matrix, Option<Matrix>)> = HashMap::new();
        for level in 0..=lattice.levels() {
            for diamond in lattice.diamonds(level) {
                let vertices = if level == 0 {
                    source.root.clone()
                } else {
                    let parents = lattice.parents(diamond).map(|parent| {
                        let (vertices, centres) = &matrices[&parent?];
                        Some((vertices, centres.as_ref().unwrap()))
                    });
                    child_vertices(lattice, diamond, parents)
                };
                let refinable = level < lattice.levels();
                let centres = refinable.then(|| source.centres_of(diamond, &vertices));
                matrices.insert(diamond, (vertices, centres));
            }
        }
        Summaries { source, matrices }
    }

    fn find(&self) -> HashMap<Diamond, Summary> {
        let lattice = &self.source.lattice;
        let mut summaries = HashMap::new();
        for level in (0..=lattice.levels()).rev() {
            for diamond in lattice.diamonds(level) {
                let vertices = &self.matrices[&diamond].0.values;
                let mut range = [
                    *vertices.iter().min().unwrap(),
                    *vertices.iter().max().unwrap(),
                ];
                let mut error = if level < lattice.levels() {
                    self.error(diamond)
                } else {
                    0.0
                };
                for child in lattice.children(diamond).into_iter().flatten() {
                    let below: &Summary = &summaries[&child];
                    range = [range[0].min(below.range[0]), range[1].max(below.range[1])];
                    error = error.max(below.error);
                }
                let is_missing = false;
                summaries.insert(
                    diamond,
                    Summary {
                        error,
                        range,
                        is_missing,
                    },
                );
            }
        }
        summaries
    }

    fn error(&self, diamond: Diamond) -> f64 {
        let lattice = &self.source.lattice;
        let placement = lattice.placement(diamond);
        let side = lattice.cells();
        let corners =
            [(0, 0), (side, 0), (side, side), (0, side)].map(|(i, j)| placement.vertex(i, j));
        let extent = |axis: usize, end: u32| {
            let places = corners.map(|corner| corner[axis]);
            let low = places.into_iter().min().unwrap().max(0);
            low..=places.into_iter().max().unwrap().min(i64::from(end) - 1)
        };
        let mut error = 0.0f64;
        for row in extent(1, lattice.height()) {
            for column in extent(0, lattice.width()) {
                error = error.max(self.middle_error(diamond, &placement, [column, row]));
                let at = [column as f64, row as f64];
                let Some(own) = self.interpolated(diamond, &placement, at) else {
                    continue;
                };
                let found = match (self.source.raster.at([column, row]), own) {
                    (Some(sample), Some(own)) => (f64::from(sample) - own).abs(),
                    _ => f64::INFINITY,
                };
                error = error.max(found);
            }
        }
        error
    }

    /// The distance in the middle of the leaf level's cell from this sample on, where edges may cross.
    fn middle_error(&self, diamond: Diamond, placement: &Placement, at: [i64; 2]) -> f64 {
        let [x, y] = at;
        let ends = match self.source.lattice.has_main_leaf_cell(at) {
            true => [[x, y], [x + 1, y + 1]],
            false => [[x + 1, y], [x, y + 1]],
        };
        let middle = [x as f64 + 0.5, y as f64 + 0.5];
        let own = self.interpolated(diamond, placement, middle).flatten();
        match (ends.map(|end| self.source.raster.at(end)), own) {
            ([Some(a), Some(b)], Some(own)) => ((f64::from(a) + f64::from(b)) / 2.0 - own).abs(),
            _ => 0.0,
        }
    }

    /// Height of the diamond's own triangles at a place in samples: the outer `None` where it is not in the
    /// square, the inner where no triangle is drawn.
    fn interpolated(
        &self,
        diamond: Diamond,
        at: &Placement,
        place: [f64; 2],
    ) -> Option<Option<f64>> {
        let (lattice, vertices) = (&self.source.lattice, &self.matrices[&diamond].0);
        let cells = lattice.cells();
        let offset = [0, 1].map(|axis| place[axis] - at.origin[axis] as f64);
        let square = (at.ax[0] * at.ax[0] + at.ax[1] * at.ax[1]) as f64;
        let along =
            |axis: [i64; 2]| (offset[0] * axis[0] as f64 + offset[1] * axis[1] as f64) / square;
        let (i, j) = (along(at.ax), along(at.ay));
        let end = cells as f64;
        if i < 0.0 || j < 0.0 || i > end || j > end {
            return None;
        }
        let (ci, cj) = (
            (i.floor() as usize).min(cells - 1),
            (j.floor() as usize).min(cells - 1),
        );
        let (s, t) = (i - ci as f64, j - cj as f64);
        let index = |di: usize, dj: usize| (cj + dj) * (cells + 1) + ci + di;
        let ends = [index(0, 0), index(1, 0), index(1, 1), index(0, 1)];
        let (triangle, weights) = if lattice.has_main_hypotenuse(diamond) {
            if s >= t {
                ([ends[0], ends[1], ends[2]], [1.0 - s, s - t, t])
            } else {
                ([ends[0], ends[3], ends[2]], [1.0 - t, t - s, s])
            }
        } else if s + t <= 1.0 {
            ([ends[0], ends[1], ends[3]], [1.0 - s - t, s, t])
        } else {
            ([ends[2], ends[3], ends[1]], [s + t - 1.0, 1.0 - s, 1.0 - t])
        };
        let drawn = triangle.iter().any(|&vertex| vertices.is_valid(vertex));
        let height = triangle
            .iter()
            .zip(weights)
            .map(|(&k, w)| f64::from(vertices.values[k]) * w);
        Some(drawn.then(|| height.sum()))
    }
}
