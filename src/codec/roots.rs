//! The root's vertex matrix as bytes (`docs/format.md`): one component after the other, the first with
//! the void mask, as residuals against the median of the left, upper and planar neighbours, in adaptive
//! binary decisions.

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
            self.scan(quantiser, |vertex, prediction| {
                let sample = samples(component, vertex.at);
                if component == 0 {
                    encoder.encode(sample.is_none(), &mut model.void[vertex.voids_before]);
                }
                sample.map(|sample| {
                    let coefficient = quantiser.quantise(sample, prediction);
                    model.encode(&mut encoder, coefficient);
                    quantiser.reconstruct(coefficient, prediction)
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
            let (mut own, own_valid) = self.scan(quantiser, |vertex, prediction| {
                let is_void = match &valid {
                    None => decoder.decode(&mut model.void[vertex.voids_before]),
                    Some(valid) => valid[vertex.index] == 0,
                };
                (!is_void).then(|| {
                    let coefficient = model.decode(&mut decoder);
                    quantiser.reconstruct(coefficient, prediction)
                })
            });
            self.carry_nearest(middle(quantiser), &own_valid, &mut own);
            values.extend(own);
            valid = Some(own_valid);
        }
        Ok(Matrix::new(values.into(), valid.unwrap_or_default()))
    }

    /// Visits the vertices inside the raster row by row. `visit` gets the vertex and the prediction, and
    /// returns the height unless void. Gives the heights and which are valid.
    fn scan(
        &self,
        quantiser: &Quantiser,
        mut visit: impl FnMut(Vertex, i32) -> Option<i32>,
    ) -> (Box<[i32]>, Box<[u8]>) {
        let side = self.lattice.cells() + 1;
        let placement = self.lattice.placement(self.lattice.root());
        let (middle, [low, high]) = (middle(quantiser), quantiser.range());
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
            let prediction = prediction.clamp(low, high);
            let before = [left, up].into_iter().flatten();
            let vertex = Vertex {
                index,
                at,
                voids_before: before.filter(|&n| valid[n] == 0).count(),
            };
            let height = visit(vertex, prediction);
            valid[index] = u8::from(height.is_some());
            values[index] = height.unwrap_or(prediction);
        }
        (values, valid)
    }

    /// Gives each vertex that is not valid the height of the nearest valid one.
    fn carry_nearest(&self, middle: i32, valid: &[u8], values: &mut [i32]) {
        let side = self.lattice.cells() + 1;
        let is_known = |index: &usize| valid[*index] != 0;
        let known: Vec<usize> = (0..side * side).filter(is_known).collect();
        if known.len() == side * side {
            return;
        }
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
        for index in (0..side * side).filter(|index| !is_known(index)) {
            values[index] = nearest(index).map_or(middle, |other| values[other]);
        }
    }
}

/// A vertex on the way over the root.
struct Vertex {
    index: usize,
    /// Column and row.
    at: [i64; 2],
    /// How many of its left and its upper neighbour are not valid.
    voids_before: usize,
}

/// The middle of a quantiser's range.
fn middle(quantiser: &Quantiser) -> i32 {
    let [low, high] = quantiser.range().map(i64::from);
    ((low + high) >> 1) as i32
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
