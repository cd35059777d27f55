//! What was trained on a data set: the tables section of a file (`docs/format.md`).

use crate::entropy::binary::{BinaryDecoder, BinaryEncoder, Probability};
use crate::entropy::frequency::{Decisions, Frequencies, TableModel};
use crate::entropy::rans::Tables;
use crate::transform::adaptive::{CLASSES, COMPANIONS, CONTEXTS, FEATURES, Weights};
use crate::transform::{LONGEST_LIST, ListedHeights};
use std::sync::OnceLock;

/// Prediction weights are multiples of this: finer ones cost more bytes than they save.
pub(super) const WEIGHT_STEP: i16 = 8;

/// Trained weights and tables, level by level.
#[derive(Clone, Debug)]
pub struct Model {
    /// Whether centres are predicted by the trained weights, not by the transform's fixed rule.
    pub adaptive: bool,
    /// The heights that coefficients count in, where not all are.
    pub listed: Option<ListedHeights>,
    /// 1 of heights, 3 of colours, each with as many matrices.
    components: usize,
    /// Groups of consecutive levels that share a model, coarse to fine.
    groups: Vec<LevelModel>,
    /// For each refinable level its group.
    group_of: Vec<usize>,
}

/// What the diamonds of some levels are coded by.
#[derive(Clone, Debug)]
pub struct LevelModel {
    matrices: Vec<MatrixModel>,
    /// Made when first asked for, since most of a file's levels may never be.
    tables: OnceLock<Tables>,
}

/// What one of the matrices of a diamond is coded by.
#[derive(Clone, Debug)]
pub struct MatrixModel {
    /// Weights of prediction and activity.
    pub weights: Weights,
    /// For each context its frequencies; neighbours often share them.
    pub frequencies: Vec<Frequencies>,
}

impl LevelModel {
    /// A model of the matrices of a diamond.
    pub fn new(matrices: Vec<MatrixModel>) -> LevelModel {
        LevelModel {
            matrices,
            tables: OnceLock::new(),
        }
    }

    /// Weights of the matrix of this number.
    pub fn weights(&self, matrix: usize) -> &Weights {
        &self.matrices[matrix].weights
    }

    /// The frequencies of all contexts, matrix after matrix.
    pub fn frequencies(&self) -> impl Iterator<Item = &Frequencies> {
        self.matrices.iter().flat_map(|matrix| &matrix.frequencies)
    }

    /// The same as tables.
    pub fn tables(&self) -> &Tables {
        self.tables
            .get_or_init(|| Tables::new(&self.frequencies().collect::<Vec<_>>()))
    }
}

impl Model {
    /// A model of groups of levels, each with the first level after it, of samples with so many components.
    pub fn new(
        adaptive: bool,
        listed: Option<ListedHeights>,
        components: usize,
        groups: Vec<(LevelModel, u32)>,
    ) -> Model {
        let mut model = Model {
            adaptive,
            listed,
            components,
            groups: Vec::with_capacity(groups.len()),
            group_of: Vec::new(),
        };
        for (group, end) in groups {
            model.group_of.resize(end as usize, model.groups.len());
            model.groups.push(group);
        }
        model
    }

    /// The groups of levels, each with the first level after it.
    pub fn groups(&self) -> Vec<(LevelModel, u32)> {
        let groups = self.groups.iter().enumerate();
        let end = |group| self.group_of.partition_point(|&own| own <= group) as u32;
        groups
            .map(|(group, own)| (own.clone(), end(group)))
            .collect()
    }

    /// Refinable levels.
    pub fn levels(&self) -> u32 {
        self.group_of.len() as u32
    }

    /// Components of a sample.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Matrices of a diamond, of all components.
    pub fn matrices(&self) -> usize {
        self.groups.first().map_or(0, |group| group.matrices.len())
    }

    /// What the diamonds of a level are coded by.
    pub fn level(&self, level: u32) -> &LevelModel {
        &self.groups[self.group_of[level as usize]]
    }

    /// The model's bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut encoder = BinaryEncoder::new();
        let mut numbers = Numbers::default();
        numbers.pass_flag(&mut encoder, self.adaptive);
        numbers.pass_flag(&mut encoder, self.listed.is_some());
        if let Some(listed) = &self.listed {
            numbers.pass_list(&mut encoder, listed.least(), &listed.present());
        }
        let mut last: Vec<Weights> = Vec::new();
        for (level, &group) in self.group_of.iter().enumerate() {
            let is_first = level == 0 || self.group_of[level - 1] != group;
            if level > 0 {
                numbers.pass_flag(&mut encoder, is_first);
            }
            if is_first {
                for (index, matrix) in self.groups[group].matrices.iter().enumerate() {
                    let known = last.get(index).cloned().unwrap_or_else(Weights::fixed);
                    let companions = companions(index, self.matrices(), self.components);
                    let numbers = &mut numbers;
                    numbers.pass_weights(&mut encoder, self.adaptive, &matrix.weights, &known);
                    numbers.pass_companions(&mut encoder, companions, &matrix.weights, &known);
                    numbers.encode_tables(&mut encoder, &matrix.frequencies);
                }
                last = self.groups[group]
                    .matrices
                    .iter()
                    .map(|matrix| matrix.weights.clone())
                    .collect();
            }
        }
        encoder.finish()
    }

    /// The model of `levels` refinable levels whose diamonds have `matrices` matrices of `components`
    /// components together; `None` where the bytes are none.
    pub fn from_bytes(
        bytes: &[u8],
        levels: u32,
        matrices: usize,
        components: usize,
    ) -> Option<Model> {
        let mut decoder = BinaryDecoder::new(bytes);
        let mut numbers = Numbers::default();
        let adaptive = numbers.pass_flag(&mut decoder, false);
        let has_list = numbers.pass_flag(&mut decoder, false);
        let listed = if has_list {
            let (least, present) = numbers.pass_list(&mut decoder, 0, &[]);
            Some(ListedHeights::new(least, &present)?)
        } else {
            None
        };
        let mut groups: Vec<(LevelModel, u32)> = Vec::new();
        for level in 0..levels {
            if level == 0 || numbers.pass_flag(&mut decoder, false) {
                let mut all = Vec::with_capacity(matrices);
                for index in 0..matrices {
                    let known = groups.last().map(|(group, _)| group.weights(index).clone());
                    let known = known.unwrap_or_else(Weights::fixed);
                    let companions = companions(index, matrices, components);
                    let mut weights = numbers.pass_weights(&mut decoder, adaptive, &known, &known);
                    weights.companions =
                        numbers.pass_companions(&mut decoder, companions, &known, &known);
                    let frequencies = numbers.decode_tables(&mut decoder)?;
                    all.push(MatrixModel {
                        weights,
                        frequencies,
                    });
                }
                groups.push((LevelModel::new(all), level + 1));
            } else if let Some((_, end)) = groups.last_mut() {
                *end = level + 1;
            }
        }
        Some(Model::new(adaptive, listed, components, groups))
    }
}

/// How many components before tell of a matrix.
fn companions(matrix: usize, matrices: usize, components: usize) -> usize {
    (matrix * components / matrices.max(1)).min(COMPANIONS)
}

/// Adaptive probabilities of all that is not a frequency. What passes through is written by an encoder,
/// which is told it, and read by a decoder, which tells it.
#[derive(Default)]
struct Numbers {
    tables: TableModel,
    flag: Probability,
    same_table: Probability,
    listed: Vec<Probability>,
    weight: Number,
    companion: Number,
    bits: Number,
}

/// Adaptive probabilities of numbers of one kind: the bit length in the context of the last one's.
struct Number {
    length: [[Probability; 34]; 34],
    leading: [Probability; 34],
    last: usize,
}

impl Default for Number {
    fn default() -> Number {
        let half = Probability::default();
        Number {
            length: [[half; 34]; 34],
            leading: [half; 34],
            last: 0,
        }
    }
}

impl Number {
    fn pass(&mut self, coder: &mut impl Decisions, told: i32) -> i32 {
        let told = u64::from(((told << 1) ^ (told >> 31)) as u32) + 1;
        let told_length = told.ilog2() as usize;
        let mut length = 0;
        while length < 32 && coder.decide(length < told_length, &mut self.length[self.last][length])
        {
            length += 1;
        }
        self.last = length;
        let mut number = 1;
        for bit in (0..length).rev() {
            let half = &mut Probability::default();
            let leading = &mut self.leading[length];
            let probability = if bit + 1 == length { leading } else { half };
            number = number << 1 | u64::from(coder.decide(told >> bit & 1 != 0, probability));
        }
        let zigzag = (number - 1) as u32;
        (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
    }
}

/// Neighbours that tell of a height whether it is listed.
const LIST_CONTEXT_BITS: u32 = 10;

impl Numbers {
    fn pass_flag(&mut self, coder: &mut impl Decisions, told: bool) -> bool {
        coder.decide(told, &mut self.flag)
    }

    /// The weights, as differences from those of the class before and of the group before.
    fn pass_weights(
        &mut self,
        coder: &mut impl Decisions,
        adaptive: bool,
        told: &Weights,
        known: &Weights,
    ) -> Weights {
        let mut weights = known.clone();
        for feature in 0..if adaptive { FEATURES } else { 0 } {
            let (pair, side) = (feature / 2, feature % 2);
            for class in 0..CLASSES {
                let near = match class {
                    0 => known.prediction[pair][0][side],
                    _ => weights.prediction[pair][class - 1][side],
                };
                let difference = told.prediction[pair][class][side].wrapping_sub(near);
                let passed = self.weight.pass(coder, i32::from(difference / WEIGHT_STEP));
                let passed = (passed as i16).wrapping_mul(WEIGHT_STEP);
                weights.prediction[pair][class][side] = near.wrapping_add(passed);
            }
        }
        let told_activity = told.activity.as_flattened();
        for (own, &told) in weights
            .activity
            .as_flattened_mut()
            .iter_mut()
            .zip(told_activity)
        {
            let passed = self.weight.pass(coder, i32::from(told.wrapping_sub(*own)));
            *own = own.wrapping_add(passed as i16);
        }
        let difference = told.first_context.wrapping_sub(known.first_context);
        let passed = self.bits.pass(coder, difference);
        weights.first_context = known.first_context.wrapping_add(passed).clamp(0, 128);
        weights
    }

    /// The weights of the components before, as differences from those of the class before and of the group
    /// before.
    fn pass_companions(
        &mut self,
        coder: &mut impl Decisions,
        companions: usize,
        told: &Weights,
        known: &Weights,
    ) -> [[i16; CLASSES]; COMPANIONS] {
        let mut weights = known.companions;
        for (companion, weights) in weights.iter_mut().enumerate().take(companions) {
            let mut near = weights[0];
            for (class, weight) in weights.iter_mut().enumerate() {
                let difference = told.companions[companion][class].wrapping_sub(near);
                let passed = self.companion.pass(coder, i32::from(difference));
                near = near.wrapping_add(passed as i16);
                *weight = near;
            }
        }
        weights
    }

    fn encode_tables(&mut self, encoder: &mut BinaryEncoder, tables: &[Frequencies]) {
        for (context, table) in tables.iter().enumerate() {
            let is_same = context > 0 && tables[context - 1] == *table;
            if context > 0 {
                encoder.encode(is_same, &mut self.same_table);
            }
            if !is_same {
                self.tables.encode(encoder, table);
            }
        }
    }

    fn decode_tables(&mut self, decoder: &mut BinaryDecoder) -> Option<Vec<Frequencies>> {
        let mut tables: Vec<Frequencies> = Vec::with_capacity(CONTEXTS);
        for _ in 0..CONTEXTS {
            let last = tables.last().cloned();
            let table = match last {
                Some(last) if decoder.decode(&mut self.same_table) => last,
                _ => self.tables.decode(decoder)?,
            };
            tables.push(table);
        }
        Some(tables)
    }

    /// The least listed height, and for it and all up to the greatest whether each is listed, in the context of
    /// those just below it.
    fn pass_list(
        &mut self,
        coder: &mut impl Decisions,
        least: i32,
        told: &[bool],
    ) -> (i32, Vec<bool>) {
        self.listed
            .resize(1 << LIST_CONTEXT_BITS, Probability::default());
        let least = self.bits.pass(coder, least);
        let length = self
            .bits
            .pass(coder, told.len() as i32)
            .clamp(0, LONGEST_LIST as i32);
        let mut context = 0;
        let present = (0..length as usize).map(|index| {
            let told = told.get(index).copied().unwrap_or(false);
            let present = coder.decide(told, &mut self.listed[context]);
            context = (context << 1 | usize::from(present)) % (1 << LIST_CONTEXT_BITS);
            present
        });
        let present = present.collect();
        (least, present)
    }
}
