//! The void mask of a matrix: exact, by adaptive binary coding in the context of what is known.

use crate::entropy::binary::{BinaryDecoder, BinaryEncoder, Probability};

/// One probability for each context: the validity of the four vertices around a centre and of three
/// neighbours that are coded before it (left, above, above right).
type Contexts = [Probability; 128];

/// Context of centre (i, j): one bit for each void vertex around it and each void neighbour before it.
fn context(cells: usize, vertices: Option<&[u8]>, voids: &[u8], index: usize) -> usize {
    let (i, j) = (index % cells, index / cells);
    let corner =
        |i: usize, j: usize| vertices.is_some_and(|valid| valid[j * (cells + 1) + i] == 0) as usize;
    let neighbour = |present: bool, back: usize| (present && voids[index - back] != 0) as usize;
    corner(i, j)
        | corner(i + 1, j) << 1
        | corner(i, j + 1) << 2
        | corner(i + 1, j + 1) << 3
        | neighbour(i > 0, 1) << 4
        | neighbour(j > 0, cells) << 5
        | neighbour(j > 0 && i + 1 < cells, cells.wrapping_sub(1)) << 6
}

/// Bytes for `voids` (N^2; 1 = void), of which only entries that are codable count.
pub(super) fn encode(
    cells: usize,
    vertices: Option<&[u8]>,
    codable: Option<&[u8]>,
    voids: &[u8],
) -> Vec<u8> {
    let mut contexts = Contexts::from([Probability::default(); 128]);
    let mut encoder = BinaryEncoder::new();
    for index in 0..cells * cells {
        if codable.is_none_or(|codable| codable[index] != 0) {
            let context = context(cells, vertices, voids, index);
            encoder.encode(voids[index] != 0, &mut contexts[context]);
        }
    }
    encoder.finish()
}

/// The inverse of [`encode`]; entries that are not codable are 0.
pub(super) fn decode(
    cells: usize,
    vertices: Option<&[u8]>,
    codable: Option<&[u8]>,
    bytes: &[u8],
) -> Box<[u8]> {
    let mut contexts = Contexts::from([Probability::default(); 128]);
    let mut decoder = BinaryDecoder::new(bytes);
    let mut voids = vec![0; cells * cells].into_boxed_slice();
    for index in 0..cells * cells {
        if codable.is_none_or(|codable| codable[index] != 0) {
            let context = context(cells, vertices, &voids, index);
            voids[index] = u8::from(decoder.decode(&mut contexts[context]));
        }
    }
    voids
}

/// Seven bits a byte, low ones first; the high bit says that another byte follows.
pub(super) fn write_length(mut length: usize, bytes: &mut Vec<u8>) {
    while length >= 128 {
        bytes.push(length as u8 | 128);
        length >>= 7;
    }
    bytes.push(length as u8);
}

/// A length of at most three bytes, and what follows it.
pub(super) fn read_length(bytes: &[u8]) -> Option<(usize, &[u8])> {
    let mut length = 0;
    for (index, &byte) in bytes.iter().take(3).enumerate() {
        length |= usize::from(byte & 127) << (7 * index);
        if byte & 128 == 0 {
            return Some((length, &bytes[index + 1..]));
        }
    }
    None
}
