//! The root's vertex matrix as bytes (`docs/format.md`): the void mask, then residuals against the
//! median of the left, upper and planar neighbours, as adaptive binary decisions.

use super::{BlockError, Matrix};
use crate::entropy::binary::{BinaryDecoder, BinaryEncoder, Probability};
use crate::lattice::Lattice;
use crate::transform::Quantiser;

/// Codes the (N+1)^2 vertices of a root.
pub struct RootCodec<'a> {
    lattice: &'a Lattice,
    quantiser: Quantiser,
    range: [i32; 2],
}

impl<'a> RootCodec<'a> {
    /// A codec for the root of `lattice`, with the quantiser's bound e and the range of
    /// heights that the repository's transform can make.
    pub fn new(lattice: &'a Lattice, bound: i32, range: [i32; 2]) -> RootCodec<'a> {
        let quantiser = Quantiser::new(bound, range[0], range[1]);
        RootCodec {
            lattice,
            quantiser,
            range,
        }
    }

    /// Bytes for the root's vertices; `samples` gives the unit of a sample by column and row, or `None`
    /// for a void.
    pub fn encode(&self, samples: impl Fn([i64; 2]) -> Option<i32>) -> Vec<u8> {
        let mut encoder = BinaryEncoder::new();
        let mut model = Model::new();
        self.scan(|at, void_context, prediction| {
            let sample = samples(at);
            encoder.encode(sample.is_none(), &mut model.void[void_context]);
            sample.map(|sample| {
                let coefficient = self.quantiser.quantise(sample, prediction);
                model.encode(&mut encoder, coefficient);
                self.quantiser.reconstruct(coefficient, prediction)
            })
        });
        encoder.finish()
    }

    /// The root's vertex matrix.
    pub fn decode(&self, bytes: &[u8]) -> Result<Matrix, BlockError> {
        let mut decoder = BinaryDecoder::new(bytes);
        let mut model = Model::new();
        let mut matrix = self.scan(|_, void_context, prediction| {
            let void = decoder.decode(&mut model.void[void_context]);
            (!void).then(|| {
                let coefficient = model.decode(&mut decoder);
                self.quantiser.reconstruct(coefficient, prediction)
            })
        });
        self.carry_nearest(&mut matrix);
        Ok(matrix)
    }

    fn middle(&self) -> i32 {
        ((i64::from(self.range[0]) + i64::from(self.range[1])) >> 1) as i32
    }

    /// Visits the vertices inside the raster row by row. `visit` gets the position, the number of void
    /// neighbours before it and the prediction, and returns the height unless void.
    fn scan(&self, mut visit: impl FnMut([i64; 2], usize, i32) -> Option<i32>) -> Matrix {
        let side = self.lattice.cells() + 1;
        let placement = self.lattice.placement(self.lattice.root());
        let middle = self.middle();
        let mut values = vec![middle; side * side].into_boxed_slice();
        let mut valid = vec![0u8; side * side].into_boxed_slice();
        for index in 0..side * side {
            let (i, j) = (index % side, index / side);
            let at = placement.vertex(i, j);
            if !self.lattice.in_raster(at) {
                continue;
            }
            let left = (i > 0).then(|| index - 1);
            let up = (j > 0).then(|| index - side);
            let prediction = match (left, up) {
                (Some(left), Some(up)) => median(values[left], values[up], values[up - 1]),
                (Some(only), None) | (None, Some(only)) => values[only],
                (None, None) => middle,
            };
            let prediction = prediction.clamp(self.range[0], self.range[1]);
            let voids = [left, up]
                .into_iter()
                .flatten()
                .filter(|&n| valid[n] == 0)
                .count();
            let height = visit(at, voids, prediction);
            valid[index] = u8::from(height.is_some());
            values[index] = height.unwrap_or(prediction);
        }
        Matrix::new(values, valid)
    }

    /// Gives each vertex that is not valid the height of the nearest valid one.
    fn carry_nearest(&self, matrix: &mut Matrix) {
        let Some(valid) = &matrix.valid else { return };
        let side = self.lattice.cells() + 1;
        let known: Vec<usize> = (0..side * side)
            .filter(|&index| valid[index] != 0)
            .collect();
        let middle = self.middle();
        let nearest = |index: usize| {
            let square = |other: usize| {
                let (di, dj) = (
                    (index % side).abs_diff(other % side),
                    (index / side).abs_diff(other / side),
                );
                di * di + dj * dj
            };
            known.iter().copied().min_by_key(|&other| square(other))
        };
        let carried: Vec<(usize, i32)> = (0..side * side)
            .filter(|&index| valid[index] == 0)
            .map(|index| {
                (
                    index,
                    nearest(index).map_or(middle, |other| matrix.values[other]),
                )
            })
            .collect();
        for (index, height) in carried {
            matrix.values[index] = height;
        }
    }
}

/// The median of left, up and left + up - corner: the edge detecting predictor of LOCO-I (Weinberger,
/// Seroussi and Sapiro 2000).
fn median(left: i32, up: i32, corner: i32) -> i32 {
    let plane = i64::from(left) + i64::from(up) - i64::from(corner);
    plane.clamp(i64::from(left.min(up)), i64::from(left.max(up))) as i32
}

/// Adaptive probabilities of a residual: its Elias-gamma code, the length bits in the context of the
/// residual before.
struct Model {
    void: [Probability; 3],
    length: Vec<[Probability; 34]>,
    leading: [Probability; 34],
    last_length: usize,
}

impl Model {
    fn new() -> Model {
        let half = Probability::default();
        Model {
            void: [half; 3],
            length: vec![[half; 34]; 34],
            leading: [half; 34],
            last_length: 0,
        }
    }

    fn encode(&mut self, encoder: &mut BinaryEncoder, coefficient: i32) {
        let code = (u64::from(((coefficient << 1) ^ (coefficient >> 31)) as u32)) + 1;
        let length = code.ilog2() as usize;
        for step in 0..=length.min(31) {
            encoder.encode(step < length, &mut self.length[self.last_length][step]);
        }
        for bit in (0..length).rev() {
            let value = code >> bit & 1 != 0;
            if bit + 1 == length {
                encoder.encode(value, &mut self.leading[length]);
            } else {
                encoder.encode(value, &mut Probability::default());
            }
        }
        self.last_length = length;
    }

    fn decode(&mut self, decoder: &mut BinaryDecoder) -> i32 {
        let mut length = 0;
        while length < 32 && decoder.decode(&mut self.length[self.last_length][length]) {
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
        self.last_length = length;
        let zigzag = (code - 1) as u32;
        (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
    }
}
