//! The root's vertex matrix as bytes (`docs/format.md`): one component after the other, each from its corners
//! inwards, each vertex between those before it, as adaptive binary decisions.

use super::{BlockError, Matrix};
use crate::entropy::binary::{BinaryDecoder, BinaryEncoder, Probability};
use crate::lattice::Lattice;
use crate::transform::Quantiser;

/// Codes the (N+1)^2 vertices of a root.
pub struct RootCodec<'a> {
    lattice: &'a Lattice,
    /// Of each component.
    quantisers: Vec<Quantiser>,
}

impl<'a> RootCodec<'a> {
    /// A codec for the root of `lattice`, with the quantiser of each component, whose range is that which the
    /// repository's transform can make.
    pub fn new(lattice: &'a Lattice, quantisers: Vec<Quantiser>) -> RootCodec<'a> {
        RootCodec {
            lattice,
            quantisers,
        }
    }

    /// Bytes for the root's vertices; `samples` gives a component of a sample by its number and by column
    /// and row, in units, or `None` for a void.
    pub fn encode(&self, samples: impl Fn(usize, [i64; 2]) -> Option<i32>) -> Vec<u8> {
        let mut encoder = BinaryEncoder::new();
        for (component, quantiser) in self.quantisers.iter().enumerate() {
            let mut model = Model::new();
            self.scan(quantiser, |at, _, outlook| {
                let sample = samples(component, at);
                if component == 0 {
                    encoder.encode(sample.is_none(), &mut model.void[outlook.voids]);
                }
                sample.map(|sample| {
                    let coefficient = quantiser.quantise(sample, outlook.prediction);
                    model.encode(&mut encoder, outlook.context, coefficient);
                    quantiser.reconstruct(coefficient, outlook.prediction)
                })
            });
        }
        encoder.finish()
    }

    /// The root's vertex matrix.
    pub fn decode(&self, bytes: &[u8]) -> Result<Matrix, BlockError> {
        let mut decoder = BinaryDecoder::new(bytes);
        let mut values = Vec::new();
        let mut valid: Option<Box<[u8]>> = None;
        for quantiser in &self.quantisers {
            let mut model = Model::new();
            let mut grid = self.scan(quantiser, |_, index, outlook| {
                let is_void = match &valid {
                    None => decoder.decode(&mut model.void[outlook.voids]),
                    Some(valid) => valid[index] == 0,
                };
                (!is_void).then(|| {
                    let coefficient = model.decode(&mut decoder, outlook.context);
                    quantiser.reconstruct(coefficient, outlook.prediction)
                })
            });
            grid.carry_nearest(middle(quantiser));
            values.extend(grid.values);
            valid = Some(grid.valid);
        }
        Ok(Matrix::new(values.into(), valid.unwrap_or_default()))
    }

    /// Visits the vertices inside the raster, from the corners inwards. `visit` gets the position, the index
    /// and what is known of the vertex, and returns the height unless void.
    fn scan(
        &self,
        quantiser: &Quantiser,
        mut visit: impl FnMut([i64; 2], usize, Outlook) -> Option<i32>,
    ) -> Grid {
        let side = self.lattice.cells() + 1;
        let placement = self.lattice.placement(self.lattice.root());
        let (middle, [low, high]) = (middle(quantiser), quantiser.range());
        let mut grid = Grid {
            side: side as i64,
            values: vec![middle; side * side].into(),
            valid: vec![0; side * side].into(),
        };
        let mut last = middle;
        visit_inwards(self.lattice.cells() as i64, |i, j, around| {
            let at = placement.vertex(i as usize, j as usize);
            if !self.lattice.in_raster(at) {
                return;
            }
            let mut outlook = grid.look([i, j], around, last, quantiser.step());
            outlook.prediction = outlook.prediction.clamp(low, high);
            let index = (j * grid.side + i) as usize;
            let height = visit(at, index, outlook);
            grid.valid[index] = u8::from(height.is_some());
            grid.values[index] = height.unwrap_or(outlook.prediction);
            last = height.unwrap_or(last);
        });
        grid
    }
}

/// The middle of a quantiser's range.
fn middle(quantiser: &Quantiser) -> i32 {
    let [low, high] = quantiser.range().map(i64::from);
    ((low + high) >> 1) as i32
}

/// Offsets of four vertices around one: opposite ones follow each other.
type Cross = [[i64; 2]; 4];

/// Offsets of the vertices around one among those before it.
struct Around {
    /// The 4 nearest.
    near: Cross,
    /// The 8 next nearest.
    far: [Cross; 2],
}

const AROUND_CENTRE: Around = Around {
    near: [[-1, -1], [1, 1], [1, -1], [-1, 1]],
    far: [
        [[-1, -3], [1, 3], [-3, -1], [3, 1]],
        [[1, -3], [-1, 3], [3, -1], [-3, 1]],
    ],
};
const AROUND_MIDPOINT: Around = Around {
    near: [[-1, 0], [1, 0], [0, -1], [0, 1]],
    far: [
        [[-1, -2], [1, 2], [-2, -1], [2, 1]],
        [[1, -2], [-1, 2], [2, -1], [-2, 1]],
    ],
};

impl Around {
    fn times(&self, by: i64) -> Around {
        let scale = |cross: Cross| cross.map(|offset| offset.map(|along| along * by));
        Around {
            near: scale(self.near),
            far: self.far.map(scale),
        }
    }
}

/// Visits every vertex (i, j) of a root of `cells` cells once; the corners, which come first, have none around.
/// Step by step the distance between vertices is halved: centres of squares, then midpoints of their
/// sides, row by row.
fn visit_inwards(cells: i64, mut visit: impl FnMut(i64, i64, Option<&Around>)) {
    for [i, j] in [[0, 0], [cells, 0], [0, cells], [cells, cells]] {
        visit(i, j, None);
    }
    for half in (0..cells.ilog2()).rev().map(|bits| 1i64 << bits) {
        let along = |first: i64| (first..=cells).step_by(2 * half as usize);
        let around = AROUND_CENTRE.times(half);
        for j in along(half) {
            along(half).for_each(|i| visit(i, j, Some(&around)));
        }
        let around = AROUND_MIDPOINT.times(half);
        for j in (0..=cells).step_by(half as usize) {
            let first = half - j % (2 * half);
            along(first).for_each(|i| visit(i, j, Some(&around)));
        }
    }
}

/// What is known of a vertex before it is coded.
#[derive(Clone, Copy)]
struct Outlook {
    prediction: i32,
    /// How many of the 4 nearest are not valid.
    voids: usize,
    /// Bit length of twice the range of the nearest in steps of the quantiser; the last context without two.
    context: usize,
}

/// The vertices so far.
struct Grid {
    side: i64,
    values: Box<[i32]>,
    valid: Box<[u8]>,
}

impl Grid {
    /// Gives each vertex that is not valid the height of the nearest valid one, of several that of the first
    /// row by row; `middle` where none is valid.
    fn carry_nearest(&mut self, middle: i32) {
        let side = self.side as usize;
        let Some([least, greatest]) = self.bounds() else {
            self.values.fill(middle);
            return;
        };
        let mut in_row = None;
        for index in (0..side * side).filter(|&index| self.valid[index] == 0) {
            let at = [index % side, index / side];
            // Nothing in their bounds is nearer than this, where it is one of them: so for all outside.
            let [i, j] = [0, 1].map(|axis| at[axis].clamp(least[axis], greatest[axis]));
            let nearest = if self.valid[j * side + i] != 0 {
                j * side + i
            } else {
                nearest(
                    at,
                    side,
                    in_row.get_or_insert_with(|| self.nearest_in_row()),
                )
            };
            self.values[index] = self.values[nearest];
        }
    }

    /// The least and the greatest i and j of valid vertices.
    fn bounds(&self) -> Option<[[usize; 2]; 2]> {
        let side = self.side as usize;
        let mut bounds: Option<[[usize; 2]; 2]> = None;
        for (j, row) in self.valid.chunks(side).enumerate() {
            let is_valid = |valid: &u8| *valid != 0;
            let ends = row
                .iter()
                .position(is_valid)
                .zip(row.iter().rposition(is_valid));
            if let Some((first, last)) = ends {
                let [least, greatest] = bounds.unwrap_or([[first, j], [last, j]]);
                bounds = Some([[least[0].min(first), least[1]], [greatest[0].max(last), j]]);
            }
        }
        bounds
    }

    /// For each vertex the column of the nearest valid one in its row, the left one of two.
    fn nearest_in_row(&self) -> Vec<Option<u8>> {
        let side = self.side as usize;
        let mut nearest = vec![None; side * side];
        for (valid, nearest) in self.valid.chunks(side).zip(nearest.chunks_mut(side)) {
            let mut last: Option<usize> = None;
            for (i, nearest) in nearest.iter_mut().enumerate() {
                last = if valid[i] != 0 { Some(i) } else { last };
                *nearest = last.map(|last| last as u8);
            }
            let mut next: Option<usize> = None;
            for (i, nearest) in nearest.iter_mut().enumerate().rev() {
                next = if valid[i] != 0 { Some(i) } else { next };
                let is_nearer =
                    |next: usize| nearest.is_none_or(|last| next - i < i - usize::from(last));
                if let Some(next) = next.filter(|&next| is_nearer(next)) {
                    *nearest = Some(next as u8);
                }
            }
        }
        nearest
    }

    fn get(&self, i: i64, j: i64) -> Option<i64> {
        let inside = (0..self.side).contains(&i) && (0..self.side).contains(&j);
        let index = (j * self.side + i) as usize;
        (inside && self.valid[index] != 0).then(|| i64::from(self.values[index]))
    }

    /// The sum of four vertices, where all are valid.
    fn sum(&self, [i, j]: [i64; 2], cross: &Cross) -> Option<i64> {
        let mut sum = 0;
        for [di, dj] in cross {
            sum += self.get(i + di, j + dj)?;
        }
        Some(sum)
    }

    /// Order 4 where its 12 vertices are valid, else order 2; else the mean of the opposite nearest that are
    /// valid, else of all nearest that are; else `last`.
    fn look(&self, at: [i64; 2], around: Option<&Around>, last: i32, step: i32) -> Outlook {
        let mut near = [None; 4];
        let (mut count, mut sum) = (0, 0);
        let (mut least, mut greatest) = (i64::MAX, i64::MIN);
        if let Some(around) = around {
            for (height, [di, dj]) in near.iter_mut().zip(around.near) {
                *height = self.get(at[0] + di, at[1] + dj);
                if let Some(height) = *height {
                    count += 1;
                    sum += height;
                    (least, greatest) = (least.min(height), greatest.max(height));
                }
            }
        }
        let prediction = match (around, count) {
            (_, 0) => i64::from(last),
            (Some(Around { far, .. }), 4) => {
                let next = self.sum(at, &far[0]).zip(self.sum(at, &far[1]));
                next.map_or((sum + 2) >> 2, |(one, other)| {
                    (10 * sum - one - other + 16) >> 5
                })
            }
            _ => {
                let opposite = |first: usize| Some((near[first]? + near[first + 1]? + 1) >> 1);
                let mean = || (sum + count / 2).div_euclid(count);
                opposite(0).or_else(|| opposite(2)).unwrap_or_else(mean)
            }
        };
        let context = if count < 2 {
            CONTEXTS - 1
        } else {
            let range = 2 * (greatest - least) / i64::from(step);
            ((i64::BITS - range.leading_zeros()) as usize).min(CONTEXTS - 2)
        };
        Outlook {
            prediction: prediction.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32,
            voids: 4 - count as usize,
            context,
        }
    }
}

/// The index of the valid vertex that is nearest to (i, j), of several the lowest, given those of [`Grid::nearest_in_row`].
fn nearest([i, j]: [usize; 2], side: usize, in_row: &[Option<u8>]) -> usize {
    // Square of the distance, and the index that decides among equal ones.
    let mut nearest = (usize::MAX, 0);
    let mut away = 0;
    while away < side && away * away <= nearest.0 {
        for row in [j.checked_sub(away), Some(j + away)].into_iter().flatten() {
            if let Some(&Some(column)) = in_row.get(row * side + i) {
                let along = usize::from(column).abs_diff(i);
                let found = row * side + usize::from(column);
                nearest = nearest.min((along * along + away * away, found));
            }
        }
        away += 1;
    }
    nearest.1
}

/// Contexts of a residual.
const CONTEXTS: usize = 36;

/// Adaptive probabilities of a residual: its Elias-gamma code, the length bits in the context of the vertices
/// around.
struct Model {
    void: [Probability; 5],
    length: Vec<[Probability; 34]>,
    leading: [Probability; 34],
}

impl Model {
    fn new() -> Model {
        let half = Probability::default();
        Model {
            void: [half; 5],
            length: vec![[half; 34]; CONTEXTS],
            leading: [half; 34],
        }
    }

    fn encode(&mut self, encoder: &mut BinaryEncoder, context: usize, coefficient: i32) {
        let code = (u64::from(((coefficient << 1) ^ (coefficient >> 31)) as u32)) + 1;
        let length = code.ilog2() as usize;
        for step in 0..=length.min(31) {
            encoder.encode(step < length, &mut self.length[context][step]);
        }
        for bit in (0..length).rev() {
            let value = code >> bit & 1 != 0;
            if bit + 1 == length {
                encoder.encode(value, &mut self.leading[length]);
            } else {
                encoder.encode(value, &mut Probability::default());
            }
        }
    }

    fn decode(&mut self, decoder: &mut BinaryDecoder, context: usize) -> i32 {
        let mut length = 0;
        while length < 32 && decoder.decode(&mut self.length[context][length]) {
            length += 1;
        }
        let mut code = 1u64;
        for bit in (0..length).rev() {
            let value = if bit + 1 == length {
                decoder.decode(&mut self.leading[length])
            } else {
                decoder.decode(&mut Probability::default())
            };
            code = code << 1 | u64::from(value);
        }
        let zigzag = (code - 1) as u32;
        (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
    }
}
