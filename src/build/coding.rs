//! All levels to blocks: with gamma codes at once, in contexts after a model of each group of levels was
//! trained on it.

use super::descent::{Descent, Input};
use super::levels::Levels;
use crate::codec::{
    BlockCodec, Census, Draft, Fit, LevelModel, MatrixModel, Model, ROUNDS, RootCodec, Trainer,
};
use crate::transform::adaptive::Weights;
use crate::transform::{LONGEST_LIST, ListedHeights, TransformKind};
use crate::{Error, Result};

/// Samples that a level needs for a model of its own. The coarse levels up to the first with as many share one.
const OWN_MODEL_SAMPLES: u64 = 16_384;
/// Diamonds of a level that are looked at in each round of training.
const TRAINING_SAMPLES: usize = 1 << 18;

/// The blocks of all diamonds by rank, and what they were made with.
pub(super) struct Coded<'a> {
    pub(super) descent: Descent<'a>,
    pub(super) roots: Vec<u8>,
    pub(super) blocks: Vec<Vec<u8>>,
    /// `None` with gamma codes.
    pub(super) model: Option<Model>,
}

/// The share of the blocks' bytes above which the tables may cost more than they save.
const DEAR_TABLES: f64 = 0.005;

impl Coded<'_> {
    /// Bytes of the tables, and of the blocks.
    fn lengths(&self) -> [usize; 2] {
        let tables = self
            .model
            .as_ref()
            .map_or(0, |model| model.to_bytes().len());
        [tables, self.blocks.iter().map(Vec::len).sum()]
    }

    /// Bytes of the tables and the blocks.
    pub(super) fn bytes(&self) -> usize {
        self.lengths().iter().sum()
    }

    /// Whether the tables are long beside the blocks.
    pub(super) fn has_dear_tables(&self) -> bool {
        let [tables, blocks] = self.lengths();
        tables as f64 > DEAR_TABLES * blocks as f64
    }
}

/// What is coded, and by what.
pub(super) struct Coding<'a, 'b> {
    pub(super) levels: &'a Levels<'a>,
    pub(super) roots: &'b RootCodec<'b>,
    pub(super) blocks: &'b BlockCodec,
    pub(super) threads: usize,
}

impl<'a> Coding<'a, '_> {
    /// Codes with gamma codes. `step` is told of samples done.
    pub(super) fn gamma(&self, step: &mut dyn FnMut(u64) -> Result<()>) -> Result<Coded<'a>> {
        let (mut descent, roots) = Descent::new(self.levels, self.roots, self.threads)?;
        let mut blocks = Vec::new();
        for level in 0..self.levels.lattice.levels() {
            let drafts = self.draft(&mut descent, level, &[], step)?;
            blocks.extend(drafts.iter().map(|draft| self.blocks.finish(draft, None)));
        }
        Ok(Coded {
            descent,
            roots,
            blocks,
            model: None,
        })
    }

    /// Codes in contexts, by the weights and tables of `known` if there is one, else by trained ones.
    pub(super) fn in_contexts(
        &self,
        known: Option<&Model>,
        adaptive: bool,
        listed: Option<ListedHeights>,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Coded<'a>> {
        let (mut descent, roots) = Descent::new(self.levels, self.roots, self.threads)?;
        let mut blocks = Vec::new();
        let mut groups: Vec<(LevelModel, u32)> = Vec::new();
        let levels = self.levels.lattice.levels();
        let mut start = 0;
        while start < levels {
            let end = self.group_end(start);
            let weights = match known {
                Some(model) => self.weights_of(model.level(start)),
                None => self.train(&descent, start, end, step)?,
            };
            let mut drafts = Vec::new();
            for level in start..end {
                drafts.extend(self.draft(&mut descent, level, &weights, step)?);
            }
            let model = match known {
                Some(model) => model.level(start).clone(),
                None => tables(&drafts, weights),
            };
            let finish = |draft| self.blocks.finish(draft, Some(&model));
            blocks.extend(drafts.iter().map(finish));
            groups.push((model, end));
            start = end;
        }
        Ok(Coded {
            descent,
            roots,
            blocks,
            model: Some(Model::new(adaptive, listed, self.levels.components, groups)),
        })
    }

    /// The level after the group that begins with `start`.
    fn group_end(&self, start: u32) -> u32 {
        let lattice = self.levels.lattice;
        if start > 0 {
            return start + 1;
        }
        let samples = |level: u32| {
            let ranks = lattice.level_ranks(level);
            (ranks.end - ranks.start) * (lattice.cells() * lattice.cells()) as u64
        };
        let first = (0..lattice.levels()).find(|&level| samples(level) >= OWN_MODEL_SAMPLES);
        first.map_or(lattice.levels(), |level| level + 1)
    }

    fn weights_of(&self, model: &LevelModel) -> Vec<Weights> {
        let matrices = 0..self.blocks.matrices();
        matrices
            .map(|matrix| model.weights(matrix).clone())
            .collect()
    }

    /// Weights of each matrix for the levels from `start` to `end`, trained on the last of them. The ones
    /// before are coded on trial, by the fixed rule.
    fn train(
        &self,
        descent: &Descent,
        start: u32,
        end: u32,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Vec<Weights>> {
        let matrices = self.blocks.matrices();
        let mut trainers: Vec<Trainer> = (0..matrices).map(|_| Trainer::new()).collect();
        if start + 1 < end {
            let (mut trial, _) = Descent::new(self.levels, self.roots, self.threads)?;
            let fixed = vec![Weights::fixed(); matrices];
            for level in start..end - 1 {
                self.draft(&mut trial, level, &fixed, &mut |_| step(0))?;
            }
            self.train_on(&trial, end - 1, &mut trainers, step)?;
        } else {
            self.train_on(descent, end - 1, &mut trainers, step)?;
        }
        Ok(trainers
            .iter()
            .map(|trainer| trainer.weights().clone())
            .collect())
    }

    fn train_on(
        &self,
        descent: &Descent,
        level: u32,
        trainers: &mut [Trainer],
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        let lattice = self.levels.lattice;
        let diamonds = lattice.level_ranks(level);
        let cells = lattice.cells();
        let samples = (diamonds.end - diamonds.start) as usize * cells * cells;
        let every = samples.div_ceil(TRAINING_SAMPLES).max(1);
        for _ in 0..ROUNDS {
            let mut all = vec![Fit::new(); trainers.len()];
            let show = |input: Input| {
                let mut fits = vec![Fit::new(); trainers.len()];
                let (vertices, outline) = (input.vertices, input.outline);
                let blocks = self.blocks;
                blocks.show(
                    trainers,
                    &mut fits,
                    vertices,
                    outline,
                    input.target,
                    input.voids,
                );
                fits
            };
            descent.observe(level, every, show, |fits| {
                for (all, fit) in all.iter_mut().zip(&fits) {
                    all.merge(fit);
                }
                step(0)
            })?;
            for (trainer, fit) in trainers.iter_mut().zip(&all) {
                trainer.learn(fit);
            }
        }
        Ok(())
    }

    fn draft(
        &self,
        descent: &mut Descent,
        level: u32,
        weights: &[Weights],
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Vec<Draft>> {
        let draft = |input: Input| {
            let (vertices, outline) = (input.vertices, input.outline);
            let blocks = self.blocks;
            Ok(blocks.draft(weights, vertices, outline, input.target, input.voids))
        };
        let mut drafts = Vec::new();
        descent.code_level(level, draft, |draft, samples| {
            drafts.push(draft);
            step(samples)
        })?;
        Ok(drafts)
    }
}

/// The model of some levels from what there is to code.
fn tables(drafts: &[Draft], weights: Vec<Weights>) -> LevelModel {
    let mut census = Census::new(weights.len());
    for trace in drafts.iter().filter_map(Draft::trace) {
        census.add(trace);
    }
    let matrices = weights.into_iter().enumerate();
    let model = matrices.map(|(matrix, weights)| MatrixModel {
        weights,
        frequencies: census.frequencies(matrix),
    });
    LevelModel::new(model.collect())
}

/// The heights of a raster, where coefficients should count in those instead of units: where it is
/// lossless and has few of the heights in its range, which some unit conversions leave.
pub(super) fn list_heights(levels: &Levels, range: [i32; 2], bound: i32) -> Option<ListedHeights> {
    let length = i64::from(range[1]) - i64::from(range[0]) + 1;
    if bound != 0 || length > LONGEST_LIST as i64 {
        return None;
    }
    let mut present = vec![false; length as usize];
    levels.for_each_height(|height| {
        present[(i64::from(height) - i64::from(range[0])) as usize] = true
    });
    let listed = present.iter().filter(|&&present| present).count() as u64;
    let length = length as u64;
    // The list costs about a bit for each height of the range, and saves one or more for each sample.
    let samples = levels.plane.count() as u64 - levels.plane.void_samples;
    if 2 * listed > length || samples < 2 * length {
        return None;
    }
    ListedHeights::new(range[0], &present)
}

/// Refuses a model that was trained on data of another shape.
pub(super) fn check_model(
    model: &Model,
    levels: u32,
    kind: TransformKind,
    components: usize,
) -> Result<()> {
    let refuse = |message: String| Err(Error::Argument(message));
    if model.levels() != levels {
        return refuse(format!(
            "the tables to use are those of {} levels, and this raster has {levels}",
            model.levels()
        ));
    }
    if levels > 0 && model.components() != components {
        let name = |components: usize| {
            if components == 1 {
                "heights"
            } else {
                "colours"
            }
        };
        return refuse(format!(
            "the tables to use are those of {}, not of {}",
            name(model.components()),
            name(components)
        ));
    }
    let own = 1 + usize::from(kind == TransformKind::TwoStage);
    let matrices = own * components;
    // Without levels a model has no matrices to tell of.
    let has_others = levels > 0 && model.matrices() != matrices;
    if has_others {
        return refuse("the tables to use are those of another transform".into());
    }
    Ok(())
}
