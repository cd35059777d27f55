//! Symbols in contexts: what goes in comes out, by any path, and damage never does harm.

use kimberlite::entropy::binary::{BinaryDecoder, BinaryEncoder};
use kimberlite::entropy::frequency::{Counts, Frequencies, SLOTS, TableModel};
use kimberlite::entropy::rans::{Decoder, Tables, encode};
use kimberlite::entropy::token;
use proptest::prelude::*;

const CELLS: usize = 64;

/// Coefficients whose spread grows with the context, with some far out.
fn coefficients() -> impl Strategy<Value = (Vec<u8>, Vec<i32>)> {
    let entry =
        (0u8..9, any::<i32>(), 0u32..12, 0u32..200).prop_map(|(context, bits, down, far)| {
            let shift = if far == 0 {
                down
            } else {
                31 - u32::from(context).min(6)
            };
            (context, if context == 8 { 0 } else { bits >> shift })
        });
    let rows = prop_oneof![Just(1usize), Just(5), Just(CELLS)];
    rows.prop_flat_map(move |rows| {
        prop::collection::vec(entry.clone(), rows * CELLS)
            .prop_map(|entries| entries.into_iter().unzip())
    })
}

fn tables_for(contexts: &[u8], coefficients: &[i32], coarse: bool) -> Vec<Frequencies> {
    let mut counts: Vec<Counts> = vec![[0; token::SYMBOLS]; 8];
    for (&context, &coefficient) in contexts.iter().zip(coefficients) {
        if let Some(counts) = counts.get_mut(usize::from(context)) {
            counts[usize::from(token::split(coefficient).0)] += 1;
        }
    }
    counts
        .iter()
        .map(|counts| Frequencies::like(counts, coarse))
        .collect()
}

fn decode(tables: &Tables, block: &[u8], contexts: &[u8], vectors: bool) -> (Vec<i32>, bool) {
    let (mut scratch, mut out) = (Vec::new(), vec![0; contexts.len()]);
    let mut decoder = Decoder::new(tables, block, &mut scratch, vectors);
    for (contexts, out) in contexts.chunks(CELLS).zip(out.chunks_mut(CELLS)) {
        decoder.decode(contexts, out);
    }
    let sound = decoder.finish().is_ok();
    (out, sound)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn coefficients_come_back_with_their_own_tables_and_with_foreign_ones(
        (contexts, coefficients) in coefficients(),
        coarse in any::<bool>(),
        foreign in any::<bool>(),
        least in 0usize..3000,
    ) {
        let other: Vec<i32> = coefficients.iter().map(|c| c / 2 + 1).collect();
        let frequencies = tables_for(&contexts, if foreign { &other } else { &coefficients }, coarse);
        let tables = Tables::new(&frequencies.iter().collect::<Vec<_>>());
        let block = encode(&tables, &contexts, &coefficients, least);
        prop_assert!(block.len() >= least);
        for vectors in [false, true] {
            let (out, sound) = decode(&tables, &block, &contexts, vectors);
            prop_assert!(sound);
            prop_assert_eq!(&out, &coefficients);
        }
    }

    #[test]
    fn damaged_blocks_decode_alike_with_and_without_vectors(
        (contexts, coefficients) in coefficients(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..4),
        cut in any::<prop::sample::Index>(),
    ) {
        let frequencies = tables_for(&contexts, &coefficients, true);
        let tables = Tables::new(&frequencies.iter().collect::<Vec<_>>());
        let mut block = encode(&tables, &contexts, &coefficients, 0);
        for (place, change) in damage {
            let place = place.index(block.len());
            block[place] ^= change;
        }
        block.truncate(1 + cut.index(block.len()));
        let [portable, vectors] = [false, true].map(|vectors| decode(&tables, &block, &contexts, vectors));
        prop_assert_eq!(portable, vectors);
    }

    #[test]
    fn tables_come_back_from_their_bytes(
        counts in prop::collection::vec(prop::collection::vec((0usize..256, 0u32..100_000), 0..60), 1..20),
        coarse in any::<bool>(),
    ) {
        let tables: Vec<Frequencies> = counts.iter().map(|sparse| {
            let mut counts = [0; token::SYMBOLS];
            sparse.iter().for_each(|&(symbol, count)| counts[symbol] += count);
            Frequencies::like(&counts, coarse)
        }).collect();
        let (mut encoder, mut model) = (BinaryEncoder::new(), TableModel::default());
        tables.iter().for_each(|table| model.encode(&mut encoder, table));
        let bytes = encoder.finish();
        let (mut decoder, mut model) = (BinaryDecoder::new(&bytes), TableModel::default());
        for table in &tables {
            let total: usize = table.iter().map(|(_, frequency)| usize::from(frequency)).sum();
            prop_assert_eq!(total, SLOTS);
            prop_assert_eq!(model.decode(&mut decoder), Some(table.clone()));
        }
    }

    #[test]
    fn any_bytes_are_a_table_or_none(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let (mut decoder, mut model) = (BinaryDecoder::new(&bytes), TableModel::default());
        if let Some(table) = model.decode(&mut decoder) {
            let total: usize = table.iter().map(|(_, frequency)| usize::from(frequency)).sum();
            prop_assert_eq!(total, SLOTS);
        }
    }
}
