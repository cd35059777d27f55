//! Which frequencies each context of each plane has: contexts that are alike share them.

use super::rows::{NOWHERE, Predictor};
use crate::entropy::binary::{BinaryDecoder, BinaryEncoder, Probability};
use crate::entropy::frequency::{Counts, Decisions, Frequencies, TableModel, log2};
use crate::entropy::token::SYMBOLS;

/// Most tables of a block: as many as processors hold near.
const MOST_TABLES: usize = 24;
/// Bits of a table's number, and of a predictor's.
const NUMBER_BITS: u32 = 5;
const PREDICTOR_BITS: u32 = 3;
/// What a table takes, about, in bits: as it is, and for each symbol that it has.
const TABLE_BITS: u64 = 40;
const SYMBOL_BITS: u64 = 4;
/// Sums are in 2^-16 bits.
const BIT: u64 = 1 << 16;

/// What a decoder has to know of a block before its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Of each plane.
    pub predictors: Vec<Predictor>,
    /// For each plane the table of each context; beyond the last one where all errors are 0.
    pub maps: Vec<[u8; 256]>,
    pub tables: Vec<Frequencies>,
}

/// How often each symbol comes in each context of a plane.
pub type PlaneCounts = Vec<Counts>;

/// The contexts that share a table.
struct Group {
    counts: Counts,
    /// Plane and context.
    members: Vec<(usize, usize)>,
    cost: u64,
}

impl Group {
    fn joined(&self, other: &Group, logarithms: &[u64]) -> u64 {
        let mut sum = self.counts;
        for (count, more) in sum.iter_mut().zip(&other.counts) {
            *count += more;
        }
        cost(&sum, logarithms)
    }

    fn join(&mut self, other: Group, cost: u64) {
        for (count, more) in self.counts.iter_mut().zip(&other.counts) {
            *count += more;
        }
        self.members.extend(other.members);
        self.cost = cost;
    }
}

/// n log2 n for all small n.
fn logarithms() -> Vec<u64> {
    let all = 0..4096u32;
    all.map(|n| u64::from(n) * u64::from(log2(n.max(1))))
        .collect()
}

/// What symbols that come so often take with a table of their own, and the table.
fn cost(counts: &Counts, logarithms: &[u64]) -> u64 {
    let times_log = |n: u32| match logarithms.get(n as usize) {
        Some(known) => *known,
        None => u64::from(n) * u64::from(log2(n)),
    };
    let (mut total, mut kinds, mut sum) = (0, 0, 0);
    for &count in counts.iter().filter(|count| **count > 0) {
        total += count;
        kinds += 1;
        sum += times_log(count);
    }
    times_log(total).saturating_sub(sum) + BIT * (TABLE_BITS + SYMBOL_BITS * kinds)
}

impl Model {
    /// The tables that make a block smallest, about.
    pub fn new(predictors: Vec<Predictor>, counts: &[PlaneCounts]) -> Model {
        let groups = grouped(counts);
        let sure = groups.len() as u8;
        let mut maps = vec![[NOWHERE; 256]; counts.len()];
        for (map, contexts) in maps.iter_mut().zip(counts) {
            for (number, counts) in map.iter_mut().zip(contexts) {
                if is_sure(counts) {
                    *number = sure;
                }
            }
        }
        for (number, group) in groups.iter().enumerate() {
            for &(plane, context) in &group.members {
                maps[plane][context] = number as u8;
            }
        }
        let tables = groups
            .iter()
            .map(|group| Frequencies::like(&group.counts, true));
        let tables: Vec<Frequencies> = tables.collect();
        // Contexts that do not come have what the one before has, which is cheapest to say.
        let mut last = sure;
        for number in maps
            .iter_mut()
            .flat_map(|map| &mut map[..usize::from(NOWHERE)])
        {
            if *number == NOWHERE {
                *number = last;
            }
            last = *number;
        }
        maps.iter_mut()
            .for_each(|map| map[usize::from(NOWHERE)] = sure);
        Model {
            predictors,
            maps,
            tables,
        }
    }

    /// The bytes of a model whose planes have so many contexts each.
    pub fn encode(&self, contexts: &[usize]) -> Vec<u8> {
        let mut encoder = BinaryEncoder::new();
        self.pass(&mut encoder, contexts);
        let mut model = TableModel::default();
        for table in &self.tables {
            model.encode(&mut encoder, table);
        }
        encoder.finish()
    }

    /// The inverse of [`encode`](Self::encode); `None` for what it cannot have written.
    pub fn decode(bytes: &[u8], contexts: &[usize]) -> Option<Model> {
        let mut decoder = BinaryDecoder::new(bytes);
        let blank = Model {
            predictors: vec![Predictor::Zero; contexts.len()],
            maps: vec![[0; 256]; contexts.len()],
            tables: Vec::new(),
        };
        let (predictors, maps, count) = blank.pass(&mut decoder, contexts)?;
        let mut model = TableModel::default();
        let tables = (0..count).map(|_| model.decode(&mut decoder));
        Some(Model {
            predictors,
            maps,
            tables: tables.collect::<Option<_>>()?,
        })
    }

    /// Predictors and maps in order, and how many tables there are.
    fn pass(
        &self,
        coder: &mut impl Decisions,
        contexts: &[usize],
    ) -> Option<(Vec<Predictor>, Vec<[u8; 256]>, usize)> {
        let count = coder.bits(self.tables.len() as u32, NUMBER_BITS) as usize;
        let mut same = Probability::default();
        let (mut predictors, mut maps) = (Vec::new(), Vec::new());
        let mut last = 0;
        for (plane, &contexts) in contexts.iter().enumerate() {
            let number = coder.bits(self.predictors[plane] as u32, PREDICTOR_BITS) as usize;
            predictors.push(*Predictor::ALL.get(number)?);
            let mut map = [0; 256];
            for (context, number) in map.iter_mut().enumerate().take(contexts) {
                let told = self.maps[plane][context];
                if !coder.decide(told == last, &mut same) {
                    last = coder.bits(u32::from(told), NUMBER_BITS) as u8;
                }
                *number = last;
            }
            if map.iter().any(|&number| usize::from(number) > count) {
                return None;
            }
            map[usize::from(NOWHERE)] = count as u8;
            maps.push(map);
        }
        Some((predictors, maps, count))
    }
}

/// Groups of contexts that are cheaper together than apart: first of neighbours in a plane, then of any.
fn grouped(counts: &[PlaneCounts]) -> Vec<Group> {
    let logarithms = logarithms();
    let mut groups: Vec<Group> = Vec::new();
    for (plane, contexts) in counts.iter().enumerate() {
        for (context, counts) in contexts.iter().enumerate() {
            if counts.iter().all(|&count| count == 0) || is_sure(counts) {
                continue;
            }
            let group = Group {
                counts: *counts,
                members: vec![(plane, context)],
                cost: cost(counts, &logarithms),
            };
            match groups.last_mut() {
                Some(last) if groups_gain(last, &group, &logarithms) => {
                    let joined = last.joined(&group, &logarithms);
                    last.join(group, joined);
                }
                _ => groups.push(group),
            }
        }
    }
    join_best(groups, &logarithms)
}

/// Whether there are errors and all are 0: they need no table.
fn is_sure(counts: &Counts) -> bool {
    counts[0] > 0 && counts[1..].iter().all(|&count| count == 0)
}

fn groups_gain(one: &Group, other: &Group, logarithms: &[u64]) -> bool {
    one.joined(other, logarithms) <= one.cost + other.cost
}

/// Joins the pair that gains most until none gains and the tables are few enough.
fn join_best(mut groups: Vec<Group>, logarithms: &[u64]) -> Vec<Group> {
    let price = |one: &Group, other: &Group| {
        one.joined(other, logarithms) as i64 - (one.cost + other.cost) as i64
    };
    let mut prices: Vec<Vec<i64>> = Vec::new();
    for (index, group) in groups.iter().enumerate() {
        prices.push(
            groups[..index]
                .iter()
                .map(|other| price(other, group))
                .collect(),
        );
    }
    loop {
        let pairs = prices.iter().enumerate();
        let pairs = pairs.flat_map(|(one, row)| {
            row.iter()
                .enumerate()
                .map(move |(other, price)| (*price, one, other))
        });
        let Some((best, one, other)) = pairs.min() else {
            return groups;
        };
        if best > 0 && groups.len() <= MOST_TABLES {
            return groups;
        }
        let gone = groups.swap_remove(one);
        let joined = groups[other].joined(&gone, logarithms);
        groups[other].join(gone, joined);
        // The last one took the place of the one that is gone.
        let last = groups.len();
        prices.truncate(last);
        for index in (0..last).filter(|index| *index == one || *index == other) {
            prices[index] = groups[..index]
                .iter()
                .map(|group| price(group, &groups[index]))
                .collect();
            for after in index + 1..last {
                prices[after][index] = price(&groups[index], &groups[after]);
            }
        }
    }
}

/// No symbol yet.
pub const NO_COUNTS: Counts = [0; SYMBOLS];
