//! How fast blocks are read and decoded.

use super::random::Random;
use crate::codec::{Matrix, Outline, child_vertices};
use crate::cut::Layer;
use crate::lattice::Diamond;
use crate::{Error, Result};
use std::collections::{HashMap, HashSet};
use std::hint::black_box;
use std::time::Instant;

/// Diamonds that are decoded for the measurement.
const DECODED: usize = 2048;
/// How often they are, after a first time that is not measured; the median counts.
const PASSES: usize = 5;
/// Blocks that are looked up.
const LOOKED_UP: usize = 100_000;

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// Samples of the raster decoded a second, in millions, on one core: reading the block from the warm file, its
    /// mask and coefficients, and the prediction, from vertices in memory.
    pub decode_msamples_per_s: f64,
    /// Median time to get a random block by its rank, in nanoseconds.
    pub get_ns_p50: f64,
    /// The time that 99 in 100 do not exceed.
    pub get_ns_p99: f64,
}

/// Measures decoding of random diamonds of the finest level that has blocks, and random look-ups.
///
/// # Errors
///
/// [`Error::Argument`] for a repository of a root alone; those of reading.
pub fn bench(layer: &Layer) -> Result<Speed> {
    if layer.lattice().diamond_count() == 0 {
        return Err(nothing_to_measure());
    }
    let mut random = Random(1);
    let decode_msamples_per_s = measure_decoding(layer, &mut random)?;
    let mut nanoseconds = measure_look_ups(layer, &mut random)?;
    nanoseconds.sort_by(f64::total_cmp);
    Ok(Speed {
        decode_msamples_per_s,
        get_ns_p50: super::quantile(&nanoseconds, 0.5),
        get_ns_p99: super::quantile(&nanoseconds, 0.99),
    })
}

fn nothing_to_measure() -> Error {
    Error::Argument("it holds nothing but its root: nothing to measure".into())
}

fn measure_decoding(layer: &Layer, random: &mut Random) -> Result<f64> {
    let lattice = layer.lattice();
    let mut chosen = choose(layer, random);
    let vertices = prepare_vertices(layer, &chosen)?;
    chosen.retain(|diamond| vertices.contains_key(diamond));
    if chosen.is_empty() {
        return Err(nothing_to_measure());
    }
    let prepared = || {
        chosen
            .iter()
            .filter_map(|&diamond| Some((diamond, vertices.get(&diamond)?)))
    };
    // The first pass verifies checksums and warms the file.
    for (diamond, vertices) in prepared() {
        layer.refine(diamond, vertices)?;
    }
    let mut seconds = Vec::with_capacity(PASSES);
    for _ in 0..PASSES {
        let start = Instant::now();
        for (diamond, vertices) in prepared() {
            black_box(layer.refine(diamond, vertices)?);
        }
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    let inside = |&diamond: &Diamond| Outline::of(lattice, diamond).codable_count(lattice.cells());
    let samples: usize = chosen.iter().map(inside).sum();
    Ok(samples as f64 / super::quantile(&seconds, 0.5) / 1e6)
}

/// Diamonds of the finest level with blocks, without repetition, in random order.
fn choose(layer: &Layer, random: &mut Random) -> Vec<Diamond> {
    let lattice = layer.lattice();
    let ranks = lattice.level_ranks(lattice.levels() - 1);
    let count = ranks.end - ranks.start;
    let wanted = count.min(DECODED as u64) as usize;
    // Those of one in every so many ranks, then shuffled.
    let mut chosen: Vec<Diamond> = (0..wanted as u64)
        .map(|place| {
            let [first, end] = [place, place + 1].map(|place| place * count / wanted as u64);
            lattice.diamond(ranks.start + first + random.below(end - first))
        })
        .collect();
    for last in (1..chosen.len()).rev() {
        chosen.swap(last, random.below(last as u64 + 1) as usize);
    }
    chosen
}

/// The vertex matrices of some diamonds of one level, by decoding their ancestors from the root down. Those whose
/// detail is missing, or that of an ancestor, are left out.
fn prepare_vertices(layer: &Layer, chosen: &[Diamond]) -> Result<HashMap<Diamond, Matrix>> {
    let lattice = layer.lattice();
    let mut generations: Vec<Vec<Diamond>> = vec![chosen.to_vec()];
    while let Some(finer) = generations
        .last()
        .filter(|finer| finer.first() != Some(&lattice.root()))
    {
        let parents = finer
            .iter()
            .flat_map(|&diamond| lattice.parents(diamond))
            .flatten();
        let parents: HashSet<Diamond> = parents.collect();
        generations.push(parents.into_iter().collect());
    }
    generations.pop();
    let mut known = HashMap::from([(lattice.root(), layer.root().clone())]);
    while let Some(generation) = generations.pop() {
        let mut refined = HashMap::with_capacity(known.len());
        for (diamond, vertices) in known {
            match layer.refine(diamond, &vertices) {
                Ok(next) => refined.insert(diamond, next.into_matrices(vertices)),
                Err(Error::Missing { .. }) => None,
                Err(error) => return Err(error),
            };
        }
        let gather = |&diamond: &Diamond| {
            let parents = lattice.parents(diamond).map(|parent| {
                let (vertices, centres) = refined.get(&parent?)?;
                Some((vertices, centres))
            });
            let is_there = parents.map(|parent| parent.is_some()) == lattice.halves(diamond);
            is_there.then(|| (diamond, child_vertices(lattice, diamond, parents)))
        };
        known = generation.iter().filter_map(gather).collect();
    }
    let mut whole = HashMap::with_capacity(known.len());
    for (diamond, vertices) in known {
        if !layer.summary(diamond, [0, 0])?.is_missing {
            whole.insert(diamond, vertices);
        }
    }
    Ok(whole)
}

fn measure_look_ups(layer: &Layer, random: &mut Random) -> Result<Vec<f64>> {
    let (store, count) = (layer.store(), layer.lattice().diamond_count());
    let mut scratch = Vec::new();
    let mut ranks: Vec<u64> = (0..LOOKED_UP).map(|_| random.below(count)).collect();
    if store.has_missing() {
        ranks.retain(|&rank| store.record(rank).is_ok_and(|record| !record.is_missing));
    }
    for &rank in &ranks {
        store.block(rank, &mut scratch)?;
    }
    let look_up = |&rank: &u64| {
        let start = Instant::now();
        black_box(store.block(rank, &mut scratch)?);
        Ok(start.elapsed().as_nanos() as f64)
    };
    ranks.iter().map(look_up).collect()
}
