//! All levels to blocks: with gamma codes at once, in contexts after a model of each group of levels was
//! trained on it.

use super::descent::{Descent, Input};
use super::levels::Levels;
use super::plane::Plane;
use super::workspace::{Records, Workspace};
use crate::codec::{
    BlockCodec, Census, Draft, Fit, LevelModel, MatrixModel, Model, ROUNDS, Refined, RootCodec,
    Trace, Trainer, Units,
};
use crate::schedule::{map_in_order, map_taken};

use crate::transform::adaptive::Weights;
use crate::transform::{LONGEST_LIST, ListedHeights, TransformKind};
use crate::{Error, Result};
use crossbeam::queue::SegQueue;
use std::ops::Range;

/// Samples that a level needs for a model of its own. The coarse levels up to the first with as many share one.
const OWN_MODEL_SAMPLES: u64 = 16_384;
/// Diamonds of a level that are looked at in each round of training.
const TRAINING_SAMPLES: usize = 1 << 18;

/// The blocks of all diamonds by rank, and what they were made with.
pub(super) struct Coded<'a> {
    pub(super) descent: Descent<'a>,
    pub(super) roots: Vec<u8>,
    pub(super) blocks: Records,
    /// `None` with gamma codes.
    pub(super) model: Option<Model>,
    /// Levels that were coded before this process began.
    pub(super) resumed_levels: u32,
}

/// What is told in a working store of what is coded.
const LEVELS: &str = "levels";
const BLOCKS: &str = "blocks";
const MODEL: &str = "model";
/// The share of the blocks' bytes above which the tables may cost more than they save.
const DEAR_TABLES: f64 = 0.005;

impl Coded<'_> {
    /// Bytes of the tables, and of the blocks.
    fn lengths(&self) -> [u64; 2] {
        let tables = self.model.as_ref().map(Model::to_bytes);
        let tables = tables.map_or(0, |tables| tables.len() as u64);
        [tables, self.blocks.bytes()]
    }

    /// Bytes of the tables and the blocks.
    pub(super) fn bytes(&self) -> u64 {
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
    pub(super) workspace: &'b Workspace,
    pub(super) threads: usize,
}

impl<'a> Coding<'a, '_> {
    /// Codes with gamma codes. `step` is told of samples done.
    pub(super) fn gamma(&self, step: &mut dyn FnMut(u64) -> Result<()>) -> Result<Coded<'a>> {
        let (mut coded, mut level) = self.begin(step)?;
        while level < self.levels.lattice.levels() {
            let code = |input: Input| {
                let (draft, refined) = self.draft(&[], &input);
                Ok((self.blocks.finish(&draft, None), refined))
            };
            let blocks = &mut coded.blocks;
            coded.descent.code_level(code, |block, samples| {
                blocks.push(block)?;
                step(samples)
            })?;
            self.save(&mut coded, level..level + 1)?;
            level += 1;
        }
        Ok(coded)
    }

    /// Codes in contexts, by the weights and tables of `known` if there is one, else by trained ones.
    pub(super) fn in_contexts(
        &self,
        known: Option<&Model>,
        adaptive: bool,
        listed: Option<ListedHeights>,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Coded<'a>> {
        let (mut coded, mut start) = self.begin(step)?;
        let components = self.levels.components.count();
        let model_of = |groups| Model::new(adaptive, listed.clone(), components, groups);
        let mut groups = coded.model.as_ref().map_or_else(Vec::new, Model::groups);
        coded.model.get_or_insert_with(|| model_of(Vec::new()));
        while start < self.levels.lattice.levels() {
            let end = self.group_end(start);
            let weights = match known {
                Some(model) => self.weights_of(model.level(start)),
                None => self.train(&coded.descent, start..end, step)?,
            };
            let counts = Counts::new(weights.len());
            let mut drafts = Drafts::new(self.workspace)?;
            for _ in start..end {
                let code = |input: Input| {
                    let (draft, refined) = self.draft(&weights, &input);
                    draft
                        .trace()
                        .into_iter()
                        .for_each(|trace| counts.add(trace));
                    Ok((draft, refined))
                };
                coded.descent.code_level(code, |draft, samples| {
                    drafts.push(draft)?;
                    step(samples)
                })?;
            }
            let census = counts.into_census();
            let model = match known {
                Some(model) => model.level(start).clone(),
                None => tables(&census, weights),
            };
            self.finish(drafts, &model, &mut coded.blocks)?;
            groups.push((model, end));
            coded.model = Some(model_of(groups.clone()));
            self.save(&mut coded, start..end)?;
            start = end;
        }
        Ok(coded)
    }

    /// Nothing coded yet but the root; or what was saved, with the number of levels coded.
    fn begin(&self, step: &mut dyn FnMut(u64) -> Result<()>) -> Result<(Coded<'a>, u32)> {
        let mut descent = self.descent(self.workspace)?;
        let (mut blocks, mut model, mut levels) = (None, None, 0);
        if let Some(saved) = self.workspace.load(LEVELS)? {
            levels = saved.try_into().map_or(0, u32::from_ne_bytes);
            descent.0.restore(levels)?;
            let seal = self.workspace.load(BLOCKS)?.unwrap_or_default();
            blocks = Some(Records::restore(self.workspace, BLOCKS, &seal)?);
            let (matrices, count) = (self.blocks.matrices(), self.levels.components.count());
            if let Some(bytes) = self.workspace.load(MODEL)? {
                let restored = Model::from_bytes(&bytes, levels, matrices, count);
                let damaged = || self.workspace.damaged("its weights and tables");
                model = Some(restored.ok_or_else(damaged)?);
            }
            let samples = (0..levels).map(|level| self.samples(level));
            step(samples.sum())?;
        }
        let (descent, roots) = descent;
        let blocks = blocks.map_or_else(|| Records::new(self.workspace, BLOCKS), Ok)?;
        let coded = Coded {
            descent,
            roots,
            blocks,
            model,
            resumed_levels: levels,
        };
        Ok((coded, levels))
    }

    /// Keeps what is coded for a build that goes on after this one was killed. `levels` are new.
    fn save(&self, coded: &mut Coded, levels: Range<u32>) -> Result<()> {
        if !self.workspace.is_kept() {
            return Ok(());
        }
        let mut entries = vec![
            (LEVELS.to_owned(), levels.end.to_ne_bytes().to_vec()),
            (BLOCKS.to_owned(), coded.blocks.seal()?),
        ];
        if let Some(model) = &coded.model {
            entries.push((MODEL.to_owned(), model.to_bytes()));
        }
        for level in levels {
            entries.extend(coded.descent.seal(level)?);
        }
        self.workspace.save(entries)
    }

    fn descent(&self, workspace: &Workspace) -> Result<(Descent<'a>, Vec<u8>)> {
        Descent::new(self.levels, self.roots, workspace.clone(), self.threads)
    }

    /// Drafts to blocks.
    fn finish(&self, drafts: Drafts, model: &LevelModel, blocks: &mut Records) -> Result<()> {
        let mut push = |_: usize, block: Result<Vec<u8>>| {
            let mut block = block?;
            block.shrink_to_fit();
            blocks.push(block)
        };
        match drafts {
            Drafts::Memory(drafts) => {
                let finish = |_, draft: Draft| Ok(self.blocks.finish(&draft, Some(model)));
                map_taken(self.threads, drafts.into_iter(), finish, push)
            }
            Drafts::Spilled(records) => {
                let finish = |number: usize| {
                    let mut scratch = Vec::new();
                    let draft = Draft::from_bytes(records.get(number, &mut scratch)?);
                    Ok(self.blocks.finish(&draft, Some(model)))
                };
                map_in_order(self.threads, records.count(), finish, &mut push)
            }
        }
    }

    /// The level after the group that begins with `start`.
    fn group_end(&self, start: u32) -> u32 {
        let lattice = self.levels.lattice;
        if start > 0 {
            return start + 1;
        }
        let first = (0..lattice.levels()).find(|&level| self.samples(level) >= OWN_MODEL_SAMPLES);
        first.map_or(lattice.levels(), |level| level + 1)
    }

    fn weights_of(&self, model: &LevelModel) -> Vec<Weights> {
        let matrices = 0..self.blocks.matrices();
        matrices
            .map(|matrix| model.weights(matrix).clone())
            .collect()
    }

    /// Weights of each matrix for some levels, trained on the last of them. The ones before are coded on trial,
    /// by the fixed rule.
    fn train(
        &self,
        descent: &Descent<'a>,
        levels: Range<u32>,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Vec<Weights>> {
        let matrices = self.blocks.matrices();
        let mut trial = None;
        if levels.len() > 1 {
            // Coarse levels only, which are small.
            let (mut begun, _) = self.descent(&Workspace::Memory)?;
            let fixed = vec![Weights::fixed(); matrices];
            for _ in levels.start..levels.end - 1 {
                let code = |input: Input| Ok(((), self.draft(&fixed, &input).1));
                begun.code_level(code, |(), _| step(0))?;
            }
            trial = Some(begun);
        }
        let descent = trial.as_ref().unwrap_or(descent);
        let mut trainers: Vec<Trainer> = (0..matrices).map(|_| Trainer::new()).collect();
        let samples = self.samples(levels.end - 1) as usize;
        let every = samples.div_ceil(TRAINING_SAMPLES).max(1);
        for _ in 0..ROUNDS {
            let mut all = vec![Fit::new(); trainers.len()];
            let show = |input: Input| {
                let mut fits = vec![Fit::new(); trainers.len()];
                let (vertices, outline) = (input.vertices, input.outline);
                let (target, voids) = (input.target, input.voids);
                self.blocks
                    .show(&trainers, &mut fits, vertices, outline, target, voids);
                fits
            };
            descent.observe(every, show, |fits| {
                for (all, fit) in all.iter_mut().zip(&fits) {
                    all.merge(fit);
                }
                step(0)
            })?;
            for (trainer, fit) in trainers.iter_mut().zip(&all) {
                trainer.learn(fit);
            }
        }
        let weights = trainers.iter().map(|trainer| trainer.weights().clone());
        Ok(weights.collect())
    }

    /// Centres of the diamonds of a level.
    fn samples(&self, level: u32) -> u64 {
        let lattice = self.levels.lattice;
        let ranks = lattice.level_ranks(level);
        (ranks.end - ranks.start) * (lattice.cells() * lattice.cells()) as u64
    }

    fn draft(&self, weights: &[Weights], input: &Input) -> (Draft, Refined) {
        let (vertices, outline) = (input.vertices, input.outline);
        self.blocks
            .draft(weights, vertices, outline, input.target, input.voids)
    }
}

/// The drafts of some levels, until their tables are known.
enum Drafts {
    Memory(Vec<Draft>),
    /// As bytes.
    Spilled(Records),
}

impl Drafts {
    fn new(workspace: &Workspace) -> Result<Drafts> {
        Ok(match workspace {
            Workspace::Memory => Drafts::Memory(Vec::new()),
            _ => Drafts::Spilled(Records::new(workspace, "drafts")?),
        })
    }

    fn push(&mut self, draft: Draft) -> Result<()> {
        match self {
            Drafts::Memory(drafts) => drafts.push(draft),
            Drafts::Spilled(records) => records.push(draft.to_bytes())?,
        }
        Ok(())
    }
}

/// Symbols counted by several threads, each of which takes a census that no other has.
struct Counts {
    matrices: usize,
    idle: SegQueue<Census>,
}

impl Counts {
    fn new(matrices: usize) -> Counts {
        Counts {
            matrices,
            idle: SegQueue::new(),
        }
    }

    fn add(&self, trace: &Trace) {
        let idle = self.idle.pop();
        let mut own = idle.unwrap_or_else(|| Census::new(self.matrices));
        own.add(trace);
        self.idle.push(own);
    }

    /// The symbols of all: sums of integers, whoever counted what.
    fn into_census(self) -> Census {
        let mut all = Census::new(self.matrices);
        self.idle.into_iter().for_each(|own| all.merge(&own));
        all
    }
}

/// The model of some levels from what there is to code.
fn tables(census: &Census, weights: Vec<Weights>) -> LevelModel {
    let matrices = weights.into_iter().enumerate();
    let model = matrices.map(|(matrix, weights)| MatrixModel {
        weights,
        frequencies: census.frequencies(matrix),
    });
    LevelModel::new(model.collect())
}

/// The heights of a raster, where coefficients should count in those instead of units: where it is
/// lossless and has few of the heights in its range, which some unit conversions leave.
pub(super) fn list_heights(plane: &Plane, units: &Units) -> Result<Option<ListedHeights>> {
    let [least, greatest] = units.range.map(i64::from);
    let length = greatest - least + 1;
    if units.bound != 0 || length > LONGEST_LIST as i64 {
        return Ok(None);
    }
    let mut present = vec![false; length as usize];
    plane.all_rows(|row| {
        for &height in row.iter().filter(|height| !height.is_nan()) {
            present[(i64::from(units.to_unit(height)) - least) as usize] = true;
        }
        true
    })?;
    let listed = present.iter().filter(|&&present| present).count() as u64;
    let length = length as u64;
    // The list costs about a bit for each height of the range, and saves one or more for each sample.
    let samples = plane.count() as u64 - plane.void_samples;
    if 2 * listed > length || samples < 2 * length {
        return Ok(None);
    }
    Ok(ListedHeights::new(units.range[0], &present))
}

/// The list that comes with tables, where a raster is lossless and has no other heights; then it goes without.
pub(super) fn list_of_tables(
    model: &Model,
    plane: &Plane,
    units: &Units,
) -> Result<Option<ListedHeights>> {
    let Some(listed) = model.listed.as_ref().filter(|_| units.bound == 0) else {
        return Ok(None);
    };
    let is_listed = |height: &f64| height.is_nan() || listed.contains(units.to_unit(*height));
    let has_others = !plane.all_rows(|row| row.iter().all(is_listed))?;
    Ok((!has_others).then(|| listed.clone()))
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
