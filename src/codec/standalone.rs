//! Diamonds without any repository around them: the matrix of one diamond as bytes and back.
//!
//! A diamond's bytes are a block of `docs/format.md` whose level has voids, after one byte, the scale, where the
//! standard model codes it; no bytes at all stand for what the empty block stands for.

use super::{
    BlockCodec, Census, Draft, Fit, LevelModel, Matrix, MatrixModel, Model, Outline, ROUNDS,
    SymbolCoder, Trainer, longest_block, standard,
};
use crate::transform::adaptive::Weights;
use crate::transform::{Quantiser, Target, TransformKind};
use crate::{Error, Result};
use std::path::Path;

/// How diamonds are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiamondOptions {
    /// log2 of the cells along a side: 4 to 7.
    pub cells_log2: u32,
    /// The quantiser's bound e: a decoded centre is within e of the one that was given. 0 is lossless.
    pub bound: i32,
    /// Least and greatest height.
    pub range: [i32; 2],
    /// Whether centres are predicted by trained weights and coded in contexts; else they are predicted by the
    /// fixed rule and coded as a quadtree of gamma codes.
    pub in_contexts: bool,
}

/// Codes the centres of diamonds in the knowledge of their vertices, by the transform interpolating.
pub struct DiamondCodec {
    options: DiamondOptions,
    blocks: BlockCodec,
    coded_by: CodedBy,
}

enum CodedBy {
    Gamma,
    Standard,
    Trained,
}

/// A diamond: its vertices, decoded, and its centres.
#[derive(Clone, Copy, Debug)]
pub struct DiamondView<'a> {
    /// (N+1)^2 vertices.
    pub vertices: &'a Matrix,
    /// N^2 centres; without meaning where void.
    pub centres: &'a Matrix,
}

impl DiamondCodec {
    /// A codec; in contexts by the standard model, until another one is trained or set.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for options outside their range.
    pub fn new(options: DiamondOptions) -> Result<DiamondCodec> {
        let DiamondOptions {
            cells_log2,
            bound,
            range: [low, high],
            in_contexts,
        } = options;
        if !(4..=7).contains(&cells_log2) {
            return Err(Error::Argument(
                "cells must be 16, 32, 64 or 128".to_owned(),
            ));
        }
        if !(0..1 << 30).contains(&bound) {
            return Err(Error::Argument(format!(
                "a bound of {bound}: it must be from 0 to 2^30 - 1"
            )));
        }
        if low > high {
            return Err(Error::Argument(format!("heights from {low} to {high}")));
        }
        let cells = 1 << cells_log2;
        let transform = TransformKind::Interpolating.transform(cells, bound, [low, high]);
        let quantiser = Quantiser::new(bound, low, high);
        let mut blocks = BlockCodec::new(cells, true, vec![transform]);
        let mut coded_by = CodedBy::Gamma;
        if in_contexts {
            let model = standard::model(quantiser.step());
            let symbols = SymbolCoder::new(cells, quantiser, true, true);
            blocks = blocks.with_symbols(vec![symbols]).with_model(model);
            coded_by = CodedBy::Standard;
        }
        Ok(DiamondCodec {
            options,
            blocks,
            coded_by,
        })
    }

    /// The options that it was made with.
    pub fn options(&self) -> &DiamondOptions {
        &self.options
    }

    /// Cells along a side.
    pub fn cells(&self) -> usize {
        1 << self.options.cells_log2
    }

    /// Most bytes that a diamond can have.
    pub fn longest(&self) -> usize {
        1 + longest_block(self.cells(), 1, self.options.in_contexts)
    }

    /// The bytes of a diamond's centres. Voids come back exactly, other centres within the bound.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for matrices of another size and for heights outside the range; void vertices count,
    /// void centres do not.
    pub fn encode(&self, diamond: DiamondView) -> Result<Vec<u8>> {
        self.check(&diamond)?;
        let Some(model) = self.blocks.model() else {
            return Ok(self.blocks.finish(&self.draft(&[], diamond), None));
        };
        let first = model.level(0);
        let mut draft = self.draft(std::slice::from_ref(first.weights(0)), diamond);
        if matches!(self.coded_by, CodedBy::Trained) {
            return Ok(self.blocks.finish(&draft, Some(first)));
        }
        let Some((sum, count)) = draft.trace().map(|trace| {
            trace
                .coded()
                .fold((0, 0), |(sum, count), (_, coefficient)| {
                    (sum + u64::from(coefficient.unsigned_abs()), count + 1)
                })
        }) else {
            return Ok(Vec::new());
        };
        let window = standard::window(sum, count);
        if window > 0 {
            let weights = standard::weights(window, self.step());
            draft = self.draft(&[weights], diamond);
        }
        let mut census = Census::new(1);
        draft
            .trace()
            .into_iter()
            .for_each(|trace| census.add(trace));
        let scales = (0..standard::CORRECTIONS).map(|by| standard::scale(window, by));
        let best = scales.min_by_key(|&scale| census.cost(model.level(scale)));
        let scale = best.unwrap_or(0);
        let block = self.blocks.finish(&draft, Some(model.level(scale)));
        if block.is_empty() {
            return Ok(block);
        }
        let mut bytes = vec![scale as u8];
        bytes.extend(block);
        Ok(bytes)
    }

    /// The centres that a diamond's bytes lead to from the same vertices, and which are valid.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for vertices of another size or outside the range; [`Error::Damaged`] for bytes that
    /// are no diamond of this codec. Bytes that are damaged in another way give other heights within the range.
    pub fn decode(&self, vertices: &Matrix, bytes: &[u8]) -> Result<Matrix> {
        self.check_vertices(vertices)?;
        let damaged = |message: &str| Error::damaged(Path::new("(diamond)"), message);
        let (level, block) = match (&self.coded_by, bytes.split_first()) {
            (CodedBy::Standard, Some((&scale, block))) => {
                let scale = u32::from(scale);
                if scale >= standard::scale(standard::WINDOWS, 0) || block.is_empty() {
                    return Err(damaged("it has no scale"));
                }
                (scale, block)
            }
            _ => (0, bytes),
        };
        let decoded = self.blocks.decode(vertices, &whole(level), block);
        decoded
            .map(|refined| refined.centres)
            .map_err(|error| damaged(&error.to_string()))
    }

    /// Replaces the model by one that is trained on these diamonds.
    ///
    /// # Errors
    ///
    /// As [`encode`](Self::encode); [`Error::Argument`] for a codec with gamma codes.
    pub fn train(&mut self, diamonds: &[DiamondView]) -> Result<()> {
        if matches!(self.coded_by, CodedBy::Gamma) {
            return Err(Error::Argument("gamma codes have no model".to_owned()));
        }
        for diamond in diamonds {
            self.check(diamond)?;
        }
        let mut trainers = [Trainer::new()];
        for _ in 0..ROUNDS {
            let mut fits = [Fit::new()];
            for diamond in diamonds {
                self.show(&trainers, &mut fits, *diamond);
            }
            trainers[0].learn(&fits[0]);
        }
        let weights = trainers[0].weights().clone();
        let mut census = Census::new(1);
        for diamond in diamonds {
            let draft = self.draft(std::slice::from_ref(&weights), *diamond);
            draft
                .trace()
                .into_iter()
                .for_each(|trace| census.add(trace));
        }
        let frequencies = census.frequencies(0);
        let matrix = MatrixModel {
            weights,
            frequencies,
        };
        let groups = vec![(LevelModel::new(vec![matrix]), 1)];
        self.use_model(Model::new(true, None, 1, groups));
        Ok(())
    }

    /// The trained model's bytes, for [`set_model`](Self::set_model) of a codec with the same options; `None`
    /// where the standard one is used, or none at all.
    pub fn model_bytes(&self) -> Option<Vec<u8>> {
        match (&self.coded_by, self.blocks.model()) {
            (CodedBy::Trained, Some(model)) => Some(model.to_bytes()),
            _ => None,
        }
    }

    /// Replaces the model by a trained one.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a codec with gamma codes; [`Error::Damaged`] for bytes that are no model.
    pub fn set_model(&mut self, bytes: &[u8]) -> Result<()> {
        if matches!(self.coded_by, CodedBy::Gamma) {
            return Err(Error::Argument("gamma codes have no model".to_owned()));
        }
        let model = Model::from_bytes(bytes, 1, 1, 1)
            .filter(|model| model.adaptive && model.listed.is_none())
            .ok_or_else(|| Error::damaged(Path::new("(model)"), "no trained model"))?;
        self.use_model(model);
        Ok(())
    }

    fn use_model(&mut self, model: Model) {
        self.blocks.set_model(model);
        self.coded_by = CodedBy::Trained;
    }

    fn step(&self) -> i32 {
        2 * self.options.bound + 1
    }

    fn draft(&self, weights: &[Weights], diamond: DiamondView) -> Draft {
        let (vertices, voids) = (diamond.vertices, voids(diamond.centres));
        let target = target(&diamond);
        let (draft, _) = self
            .blocks
            .draft(weights, vertices, &whole(0), target, voids.as_deref());
        draft
    }

    fn show(&self, trainers: &[Trainer], fits: &mut [Fit], diamond: DiamondView) {
        let (vertices, voids) = (diamond.vertices, voids(diamond.centres));
        let target = target(&diamond);
        self.blocks.show(
            trainers,
            fits,
            vertices,
            &whole(0),
            target,
            voids.as_deref(),
        );
    }

    fn check(&self, diamond: &DiamondView) -> Result<()> {
        self.check_vertices(diamond.vertices)?;
        let centres = diamond.centres;
        self.check_size("centres", centres, self.cells())?;
        let valid = (0..centres.values.len()).filter(|&index| centres.is_valid(index));
        self.check_range("centre", self.cells(), centres, valid)
    }

    fn check_vertices(&self, vertices: &Matrix) -> Result<()> {
        let side = self.cells() + 1;
        self.check_size("vertices", vertices, side)?;
        self.check_range("vertex", side, vertices, 0..vertices.values.len())
    }

    fn check_size(&self, what: &str, matrix: &Matrix, side: usize) -> Result<()> {
        let count = side * side;
        let masked = matrix.valid.as_ref().map_or(count, |valid| valid.len());
        if matrix.values.len() == count && masked == count {
            return Ok(());
        }
        let found = matrix.values.len();
        Err(Error::Argument(format!(
            "{found} {what} instead of {count}"
        )))
    }

    fn check_range(
        &self,
        what: &str,
        side: usize,
        matrix: &Matrix,
        mut indices: impl Iterator<Item = usize>,
    ) -> Result<()> {
        let [low, high] = self.options.range;
        match indices.find(|&index| !(low..=high).contains(&matrix.values[index])) {
            None => Ok(()),
            Some(index) => Err(Error::Argument(format!(
                "the {what} at column {}, row {} is {}, not from {low} to {high}",
                index % side,
                index / side,
                matrix.values[index]
            ))),
        }
    }
}

/// The outline of a whole diamond.
fn whole(level: u32) -> Outline {
    Outline {
        level,
        codable: None,
        absent: None,
    }
}

/// 1 where a centre is void; `None` where none is.
fn voids(centres: &Matrix) -> Option<Box<[u8]>> {
    let valid = centres.valid.as_deref()?;
    Some(valid.iter().map(|&valid| 1 - valid).collect())
}

fn target<'a>(diamond: &DiamondView<'a>) -> Target<'a> {
    Target {
        vertices: &diamond.vertices.values,
        centres: &diamond.centres.values,
    }
}
