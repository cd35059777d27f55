//! Vectors give what the portable functions give, to the bit.

use kimberlite::codec::{
    BlockCodec, Census, LevelModel, Matrix, MatrixModel, Model, Outline, SymbolCoder,
};
use kimberlite::transform::adaptive::{Outlook, Weights, Workspace};
use kimberlite::transform::{Quantiser, Target, TransformKind};
use proptest::prelude::*;

/// Rows of numbers up to about `2^bits`.
fn noise(seed: u64, count: usize, bits: u32) -> Vec<i32> {
    let mut state = seed | 1;
    let next = |_| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as u32 as i32) >> (31 - bits)
    };
    (0..count).map(next).collect()
}

fn any_weights(seed: u64, bits: u32) -> Weights {
    let numbers = noise(seed, 200, bits);
    let mut weights = Weights::fixed();
    let prediction = weights.prediction.as_flattened_mut().as_flattened_mut();
    let activity = weights.activity.as_flattened_mut();
    for (weight, number) in prediction.iter_mut().chain(activity).zip(&numbers) {
        *weight = *number as i16;
    }
    weights.first_context = numbers[199].rem_euclid(100);
    weights
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn vectors_foresee_what_the_portable_function_foresees(
        seed in any::<u64>(),
        cells_log2 in 4u32..8,
        vertex_bits in 0u32..14,
        centre_bits in 0u32..31,
        weight_bits in 1u32..14,
        base in any::<i32>(),
    ) {
        let cells = 1 << cells_log2;
        let base = base / 2;
        let side = cells + 1;
        let vertices: Vec<i32> = noise(seed, side * side, vertex_bits).iter().map(|v| v + base).collect();
        let weights = any_weights(seed ^ 1, weight_bits);
        let mut rooms = [Workspace::default(), Workspace::default()];
        let [portable, vectors] = &mut rooms;
        let mut pair = [
            portable.start(cells, &vertices, false),
            vectors.start(cells, &vertices, true),
        ];
        let rows = noise(seed ^ 2, cells * cells, centre_bits);
        for row in rows.chunks_exact(cells) {
            let centres: Vec<i32> = row.iter().map(|c| c.wrapping_add(base)).collect();
            let outlooks = pair.each_mut().map(|surroundings| {
                let mut outlook = Outlook::default();
                outlook.fit(cells);
                surroundings.foresee(&weights, &mut outlook);
                surroundings.complete(&centres);
                outlook
            });
            prop_assert_eq!(&outlooks[0].contexts, &outlooks[1].contexts);
            prop_assert_eq!(&outlooks[0].predictions, &outlooks[1].predictions);
        }
    }

    #[test]
    fn vectors_foresee_finely_what_the_portable_function_foresees(
        seed in any::<u64>(),
        cells_log2 in 4u32..8,
        vertex_bits in 0u32..14,
        centre_bits in 0u32..31,
        weight_bits in 1u32..14,
        details in any::<bool>(),
    ) {
        let cells = 1 << cells_log2;
        let side = cells + 1;
        let vertices = noise(seed, side * side, vertex_bits);
        let weights = any_weights(seed ^ 1, weight_bits);
        let mut rooms = [Workspace::default(), Workspace::default()];
        let [portable, vectors] = &mut rooms;
        let mut pair = [
            portable.start(cells, &vertices, false),
            vectors.start(cells, &vertices, true),
        ];
        let rows = noise(seed ^ 2, cells * cells, centre_bits);
        for row in rows.chunks_exact(cells) {
            let outlooks = pair.each_mut().map(|surroundings| {
                let mut outlook = Outlook::default();
                outlook.fit(cells);
                surroundings.foresee_finely(&weights, details, &mut outlook);
                surroundings.complete(row);
                outlook
            });
            prop_assert_eq!(&outlooks[0].contexts, &outlooks[1].contexts);
            prop_assert_eq!(&outlooks[0].predictions, &outlooks[1].predictions);
            prop_assert_eq!(&outlooks[0].fractions, &outlooks[1].fractions);
        }
    }

    #[test]
    fn vectors_know_of_centres_what_the_portable_function_knows(
        seed in any::<u64>(),
        cells_log2 in 4u32..8,
        vertex_bits in 0u32..14,
        centre_bits in 0u32..31,
        weight_bits in 1u32..14,
    ) {
        let cells = 1 << cells_log2;
        let side = cells + 1;
        let vertices = noise(seed, side * side, vertex_bits);
        let weights = any_weights(seed ^ 1, weight_bits);
        let mut rooms = [Workspace::default(), Workspace::default()];
        let [portable, vectors] = &mut rooms;
        let mut pair = [
            portable.start(cells, &vertices, false),
            vectors.start(cells, &vertices, true),
        ];
        let rows = noise(seed ^ 2, cells * cells, centre_bits);
        for row in rows.chunks_exact(cells) {
            let sights = pair.each_mut().map(|surroundings| {
                let (mut outlook, mut sights) = (Outlook::default(), vec![Default::default(); cells]);
                outlook.fit(cells);
                surroundings.accompany(row, 1);
                surroundings.foresee(&weights, &mut outlook);
                surroundings.look_around(&weights, &mut sights);
                surroundings.complete(row);
                sights
            });
            prop_assert_eq!(&sights[0], &sights[1]);
        }
    }

    #[test]
    fn a_row_is_quantised_as_its_samples_are(
        seed in any::<u64>(),
        bound in prop_oneof![0..5, 0..(1 << 30) - 1],
        bits in 1u32..32,
        cells in 1usize..40,
        masked in any::<bool>(),
    ) {
        let greatest = 1i32 << (bits - 1);
        let quantiser = Quantiser::new(bound, -greatest, greatest - 1);
        let [low, high] = quantiser.range();
        let samples: Vec<i32> = noise(seed, cells, bits).iter().map(|own| own - greatest).collect();
        let predictions: Vec<i32> = noise(seed ^ 1, cells, 31).iter().map(|own| own - (1 << 30)).collect();
        let coded: Vec<u8> = noise(seed ^ 2, cells, 1).iter().map(|&own| own as u8).collect();
        let coded = masked.then_some(&coded[..]);
        let mut row = vec![0; cells];
        quantiser.quantise_row(&samples, &predictions, coded, &mut row);
        for (i, &coefficient) in row.iter().enumerate() {
            let is_coded = coded.is_none_or(|coded| coded[i] != 0);
            let own = quantiser.quantise(samples[i], predictions[i].clamp(low, high));
            prop_assert_eq!(coefficient, if is_coded { own } else { 0 });
        }
    }

    #[test]
    fn vectors_find_the_contexts_of_coefficients_that_the_portable_function_finds(
        seed in any::<u64>(),
        cells_log2 in 4u32..8,
        vertex_bits in 0u32..14,
        coefficient_bits in 0u32..31,
        step in 1i32..2000,
    ) {
        let cells = 1 << cells_log2;
        let side = cells + 1;
        let vertices = noise(seed, side * side, vertex_bits);
        let weights = any_weights(seed ^ 1, 8);
        let mut rooms = [Workspace::default(), Workspace::default()];
        let [portable, vectors] = &mut rooms;
        let mut pair = [
            portable.start(cells, &vertices, false),
            vectors.start(cells, &vertices, true),
        ];
        let rows = noise(seed ^ 2, cells * cells, coefficient_bits);
        for row in rows.chunks_exact(cells) {
            let contexts = pair.each_mut().map(|surroundings| {
                let mut outlook = Outlook::default();
                outlook.fit(cells);
                surroundings.accompany(row, step);
                surroundings.foresee_contexts(&weights, &mut outlook);
                surroundings.complete_coefficients(row, step);
                outlook.contexts
            });
            prop_assert_eq!(&contexts[0], &contexts[1]);
        }
    }
}

/// A codec of whole diamonds in contexts, trained prediction first.
fn codec(cells: usize, bound: i32, range: [i32; 2], vectors: bool) -> BlockCodec {
    let quantiser = Quantiser::new(bound, range[0], range[1]);
    let transform = TransformKind::Interpolating.transform(cells, bound, range);
    let symbols = SymbolCoder::new(cells, quantiser, true, vectors);
    BlockCodec::new(cells, false, vec![transform]).with_symbols(vec![symbols])
}

/// Heights around the mean of the four vertices nearest to each centre.
fn centres_near(vertices: &[i32], cells: usize, noise: &[i32]) -> Vec<i32> {
    let side = cells + 1;
    let near = |index: usize| {
        let corner = index / cells * side + index % cells;
        let nearest = [corner, corner + 1, corner + side, corner + side + 1];
        nearest.iter().map(|&corner| vertices[corner]).sum::<i32>() / 4
    };
    (0..cells * cells)
        .map(|index| near(index) + noise[index])
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// From blocks of every number of lanes, sound and damaged ones.
    #[test]
    fn vectors_decode_a_diamond_to_what_the_portable_functions_decode_it_to(
        seed in any::<u64>(),
        cells_log2 in 4u32..8,
        vertex_bits in 0u32..15,
        (centre_bits, rare) in (0u32..12, 1u64..60),
        bound in 0i32..3,
        damage in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 0..3),
    ) {
        let (cells, range) = (1 << cells_log2, [-20_000, 20_000]);
        let values = noise(seed, (cells + 1) * (cells + 1), vertex_bits);
        let mut rough = noise(seed ^ 1, cells * cells, centre_bits);
        let chances = noise(seed ^ 2, cells * cells, 30);
        for (noise, chance) in rough.iter_mut().zip(chances) {
            *noise *= i32::from(u64::from(chance.unsigned_abs()).is_multiple_of(rare));
        }
        let centres = centres_near(&values, cells, &rough);
        let vertices = Matrix { values: values.clone().into(), valid: None };
        let outline = Outline { level: 0, codable: None, absent: None };
        let weights = any_weights(seed ^ 3, 8);
        let target = Target { vertices: &values, centres: &centres };
        let draft = |vectors: bool| {
            let codec = codec(cells, bound, range, vectors);
            codec.draft(std::slice::from_ref(&weights), &vertices, &outline, target, None)
        };
        let (draft, expected) = draft(false);
        let mut census = Census::new(1);
        draft.trace().into_iter().for_each(|trace| census.add(trace));
        let matrix = MatrixModel { weights: weights.clone(), frequencies: census.frequencies(0) };
        let level = LevelModel::new(vec![matrix]);
        let model = Model::new(true, None, 1, vec![(level, 1)]);
        let mut block = codec(cells, bound, range, true).finish(&draft, Some(model.level(0)));
        let decoded = |block: &[u8], vectors: bool| {
            let codec = codec(cells, bound, range, vectors).with_model(model.clone());
            codec.decode(&vertices, &outline, block)
        };
        prop_assert_eq!(decoded(&block, true), Ok(expected));
        for (place, change) in damage {
            if !block.is_empty() {
                let place = place.index(block.len());
                block[place] ^= change;
            }
        }
        prop_assert_eq!(decoded(&block, false), decoded(&block, true));
    }
}
