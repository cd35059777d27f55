//! What the coders promise: every matrix and every decision comes back, and no bytes whatever make
//! a decoder panic or go on without end.

use kimberlite::entropy::Error;
use kimberlite::entropy::binary::{BinaryDecoder, BinaryEncoder, Probability};
use kimberlite::entropy::bits::{BitReader, BitWriter};
use kimberlite::entropy::gamma;
use proptest::collection::vec;
use proptest::prelude::*;

/// A square matrix and perhaps a mask of the entries that are coded.
#[derive(Clone, Debug)]
struct Matrix {
    side: usize,
    coefficients: Vec<i32>,
    coded: Option<Vec<u8>>,
}

impl Matrix {
    fn encode(&self) -> Vec<u8> {
        let mut out = BitWriter::new();
        gamma::encode(
            &self.coefficients,
            self.side,
            self.coded.as_deref(),
            &mut out,
        );
        out.into_bytes()
    }

    /// The coefficients that a decoder should see: 0 where nothing is coded.
    fn seen(&self) -> Vec<i32> {
        let is_coded = |entry| self.coded.as_ref().is_none_or(|mask| mask[entry] != 0);
        let entries = self.coefficients.iter().enumerate();
        entries
            .map(|(entry, value)| if is_coded(entry) { *value } else { 0 })
            .collect()
    }

    /// Decodes `bytes` as a matrix of this shape; they must be used up.
    fn decode(&self, bytes: &[u8]) -> Result<Vec<i32>, Error> {
        let mut coefficients = vec![12345; self.side * self.side];
        let mut input = BitReader::new(bytes);
        gamma::decode(
            &mut input,
            self.side,
            self.coded.as_deref(),
            &mut coefficients,
        )?;
        input.finish()?;
        Ok(coefficients)
    }
}

fn coefficient() -> impl Strategy<Value = i32> {
    prop_oneof![
        6 => Just(0),
        6 => -4..=4_i32,
        2 => -2000..2000_i32,
        1 => any::<i32>(),
        1 => prop_oneof![Just(i32::MIN), Just(i32::MAX), Just(i32::MIN + 1)],
    ]
}

/// Coefficients in a run of rows, zeros elsewhere, so that there are quadrants of both kinds; masks
/// likewise.
fn matrix() -> impl Strategy<Value = Matrix> {
    prop_oneof![9 => 1..=5_u32, 1 => 6..=7_u32].prop_flat_map(|log2| {
        let side = 1_usize << log2;
        let size = side * side;
        let rows = (0..side, 0..side).prop_map(|(a, b)| (a.min(b), a.max(b)));
        let mask = (
            0..side,
            vec(
                prop_oneof![3 => Just(1_u8), 1 => Just(0), 1 => any::<u8>()],
                size,
            ),
        )
            .prop_map(move |(from, mut mask)| {
                mask[..from * side].fill(0);
                mask
            });
        (vec(coefficient(), size), rows, proptest::option::of(mask)).prop_map(
            move |(mut coefficients, (from, to), coded)| {
                coefficients[..from * side].fill(0);
                coefficients[(to + 1) * side..].fill(0);
                Matrix {
                    side,
                    coefficients,
                    coded,
                }
            },
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn a_matrix_comes_back_and_always_as_the_same_bytes(matrix in matrix()) {
        let bytes = matrix.encode();
        prop_assert_eq!(&bytes, &matrix.encode());
        prop_assert_eq!(matrix.decode(&bytes), Ok(matrix.seen()));
    }

    #[test]
    fn entries_that_are_not_coded_leave_no_trace(matrix in matrix(), noise in any::<i32>()) {
        let mut other = matrix.clone();
        if let Some(mask) = &matrix.coded {
            for (value, mask) in other.coefficients.iter_mut().zip(mask) {
                if *mask == 0 {
                    *value = noise;
                }
            }
        }
        prop_assert_eq!(matrix.encode(), other.encode());
    }

    #[test]
    fn a_matrix_cut_short_is_an_error(matrix in matrix(), at in any::<proptest::sample::Index>()) {
        let bytes = matrix.encode();
        if !bytes.is_empty() {
            prop_assert!(matrix.decode(&bytes[..at.index(bytes.len())]).is_err());
        }
    }

    #[test]
    fn bytes_after_a_matrix_are_an_error(matrix in matrix(), extra in vec(any::<u8>(), 1..9)) {
        let mut bytes = matrix.encode();
        bytes.extend(extra);
        let surplus = matches!(matrix.decode(&bytes), Err(Error::Surplus { .. }));
        prop_assert!(surplus);
    }

    #[test]
    fn any_bytes_end_a_matrix(matrix in matrix(), bytes in vec(any::<u8>(), 0..2000)) {
        // Whatever it gives, it must be what those bytes' own matrix gives again.
        if let Ok(coefficients) = matrix.decode(&bytes) {
            let again = Matrix { coefficients, ..matrix };
            prop_assert_eq!(again.decode(&again.encode()), Ok(again.seen()));
        }
    }

    #[test]
    fn bits_come_back(fields in vec((any::<u64>(), 0..=57_u32), 0..200)) {
        let low = |value: u64, count: u32| value & ((1 << count) - 1);
        let mut out = BitWriter::new();
        for &(value, count) in &fields {
            out.put(low(value, count), count);
        }
        let bytes = out.into_bytes();
        let bits: usize = fields.iter().map(|(_, count)| *count as usize).sum();
        prop_assert_eq!(bytes.len(), bits.div_ceil(8));
        let mut input = BitReader::new(&bytes);
        for &(value, count) in &fields {
            prop_assert_eq!(input.get(count), low(value, count));
        }
        prop_assert_eq!(input.position(), bits);
        prop_assert_eq!(input.finish(), Ok(()));
    }

    #[test]
    fn decisions_come_back(
        decisions in vec((prop_oneof![1 => Just(5_u8), 3 => 0..5_u8], any::<u8>()), 0..3000),
    ) {
        // Context c is true about once in 2^c: from even odds to very skewed ones.
        let decisions: Vec<(usize, bool)> = decisions
            .into_iter()
            .map(|(context, noise)| (usize::from(context), u32::from(noise) >> (8 - context) == 0))
            .collect();
        let bytes = encode_decisions(&decisions);
        prop_assert_eq!(&bytes, &encode_decisions(&decisions));
        prop_assert_ne!(bytes.last(), Some(&0));
        prop_assert_eq!(decode_decisions(&bytes, &decisions), decisions);
    }

    #[test]
    fn any_bytes_give_decisions(bytes in vec(any::<u8>(), 0..20), high in any::<bool>()) {
        let bytes = if high { vec![255; bytes.len()] } else { bytes };
        let mut decoder = BinaryDecoder::new(&bytes);
        let mut contexts = [Probability::default(); 3];
        for step in 0..5000 {
            decoder.decode(&mut contexts[step % 3]);
        }
    }

    #[test]
    fn even_decisions_cost_one_bit_and_the_end_one_byte(decisions in vec(any::<bool>(), 0..400)) {
        let mut encoder = BinaryEncoder::new();
        for decision in &decisions {
            encoder.encode(*decision, &mut Probability::default());
        }
        prop_assert!(encoder.finish().len() <= decisions.len().div_ceil(8) + 1);
    }
}

fn encode_decisions(decisions: &[(usize, bool)]) -> Vec<u8> {
    let mut contexts = [Probability::default(); 6];
    let mut encoder = BinaryEncoder::new();
    for &(context, decision) in decisions {
        encoder.encode(decision, &mut contexts[context]);
    }
    encoder.finish()
}

/// As many decisions as `shape` has, in its contexts.
fn decode_decisions(bytes: &[u8], shape: &[(usize, bool)]) -> Vec<(usize, bool)> {
    let mut contexts = [Probability::default(); 6];
    let mut decoder = BinaryDecoder::new(bytes);
    shape
        .iter()
        .map(|&(context, _)| (context, decoder.decode(&mut contexts[context])))
        .collect()
}

#[test]
fn every_short_run_of_decisions_comes_back() {
    for length in 0..=12 {
        for pattern in 0..1_u32 << length {
            let decisions: Vec<_> = (0..length)
                .map(|bit| ((pattern >> bit) as usize % 2, pattern >> bit & 1 == 1))
                .collect();
            let bytes = encode_decisions(&decisions);
            assert!(
                bytes.len() <= 3,
                "{length} decisions, {pattern:b}: {bytes:?}"
            );
            assert_eq!(decode_decisions(&bytes, &decisions), decisions);
        }
    }
}

#[test]
fn equal_decisions_cost_almost_nothing() {
    for decision in [false, true] {
        assert!(encode_decisions(&vec![(0, decision); 4096]).len() <= 3);
    }
    assert!(
        encode_decisions(&[(0, true); 100]).is_empty(),
        "zeros stand for them"
    );
}

#[test]
fn a_small_matrix_has_the_bits_written_by_hand() {
    #[rustfmt::skip]
    let coefficients = vec![
        0, 0,  1,  0,
        0, 0,  0, -1,
        0, 0,  0,  0,
        0, 0,  0,  0,
    ];
    // 1 matrix, 0 upper left, 1 upper right: 011 1 1 010, 0 lower left, 0 lower right.
    let whole = Matrix {
        side: 4,
        coefficients: coefficients.clone(),
        coded: None,
    };
    assert_eq!(whole.encode(), [0b1010_1111, 0b0100_0000]);
    // Without the upper left quadrant, the -1 and its left neighbour: 1, 1 011 1, 0, 0.
    let coded = vec![0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1];
    let part = Matrix {
        side: 4,
        coefficients,
        coded: Some(coded),
    };
    assert_eq!(part.encode(), [0b1101_1100]);
}

#[test]
fn a_matrix_without_coded_entries_has_no_bits() {
    let nothing = Matrix {
        side: 8,
        coefficients: vec![7; 64],
        coded: Some(vec![0; 64]),
    };
    assert!(nothing.encode().is_empty());
    assert_eq!(nothing.decode(&[]), Ok(vec![0; 64]));
    let zeros = Matrix {
        side: 128,
        coefficients: vec![0; 128 * 128],
        coded: None,
    };
    assert_eq!(zeros.encode(), [0]);
}

#[test]
fn a_code_beyond_32_bits_is_refused() {
    let matrix = Matrix {
        side: 2,
        coefficients: vec![0; 4],
        coded: None,
    };
    let write = |zeros: u32, number: u64| {
        let mut out = BitWriter::new();
        out.put(1, 1);
        out.put(0, zeros);
        out.put(number, zeros + 1);
        out.put(0b111, 3);
        out.into_bytes()
    };
    assert_eq!(
        matrix.decode(&write(32, 1 << 32)),
        Ok(vec![i32::MIN, 0, 0, 0])
    );
    let overlong = Err(Error::Overlong { position: 1 });
    assert_eq!(matrix.decode(&write(32, (1 << 32) + 1)), overlong);
    assert_eq!(matrix.decode(&write(33, 1 << 33)), overlong);
    assert_eq!(matrix.decode(&write(50, 1 << 50)), overlong);
}

#[test]
fn padding_that_is_not_zero_is_refused() {
    let zeros = Matrix {
        side: 2,
        coefficients: vec![0; 4],
        coded: None,
    };
    assert_eq!(zeros.decode(&[0]), Ok(vec![0; 4]));
    assert_eq!(zeros.decode(&[1]), Err(Error::Surplus { position: 1 }));
    assert_eq!(zeros.decode(&[]), Err(Error::Truncated));
}
