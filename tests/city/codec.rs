//! Blocks as bytes: without loss whatever they hold, and safe to read whatever the bytes are.

use kimberlite::blockmap::{BlockMap, decode, encode};
use proptest::prelude::*;

/// Numbers from a seed.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, limit: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % limit
    }

    pub fn byte(&mut self) -> u8 {
        self.below(256) as u8
    }
}

/// What images hold.
#[derive(Clone, Copy, Debug)]
pub enum Content {
    /// Houses with walls, as a bake makes them.
    Houses,
    /// The same, and a few bytes anywhere that are others.
    Spoiled,
    /// Any bytes.
    Noise,
    /// The least and the greatest bytes, and those around the middle.
    Extremes,
    /// One byte everywhere.
    Constant,
}

pub const CONTENTS: [Content; 5] = [
    Content::Houses,
    Content::Spoiled,
    Content::Noise,
    Content::Extremes,
    Content::Constant,
];

/// A block with a content.
pub fn block(
    side_texels: usize,
    slices: usize,
    has_16_bits: bool,
    content: Content,
    seed: u64,
) -> BlockMap {
    let mut random = Random(seed);
    let mut map = BlockMap::new(side_texels, [-3.5, 1e6 + 0.1], 64.0).unwrap();
    map.slices = slices;
    map.low_heights = has_16_bits.then(|| vec![0; side_texels * side_texels]);
    let low = random.below(9000) as f32 / 7.0 - 400.0;
    map.heights = [low, low + random.below(300) as f32 / 3.0];
    map.exposure = random.below(4) as f32;
    map.roof_slope = random.below(100) as f32 / 9.0;
    match content {
        Content::Houses | Content::Spoiled => houses(&mut map, &mut random),
        Content::Noise => map.image.iter_mut().for_each(|byte| *byte = random.byte()),
        Content::Extremes => {
            let bytes = [0, 1, 126, 127, 128, 254, 255];
            let mut any = || bytes[random.below(bytes.len())];
            map.image.iter_mut().for_each(|byte| *byte = any());
        }
        Content::Constant => {
            let byte = random.byte();
            map.image.fill(byte);
        }
    }
    if !matches!(content, Content::Houses) {
        for _ in 0..random.below(20) {
            let at = random.below(map.image.len());
            map.image[at] = random.byte();
        }
        if let Some(plane) = &mut map.low_heights {
            plane.iter_mut().for_each(|byte| *byte = random.byte());
        }
    }
    map
}

/// Boxes on flat ground, with walls around them.
fn houses(map: &mut BlockMap, random: &mut Random) {
    let side = map.side_texels;
    for _ in 0..4 {
        let [west, south] = [random.below(side - 8), random.below(side - 8)];
        let [height, red] = [random.byte(), random.byte()];
        for row in south..south + 3 + random.below(5) {
            for column in west..west + 6 {
                map.set(column, row, [height, 0, 127, 130]);
                map.set(side + column, row, [red, 90, 80, 200 + height % 50]);
            }
        }
    }
    let codes: Vec<u16> = (0..side * side)
        .map(|at| map.height_code(at % side, at / side))
        .collect();
    for slice in 0..map.slices {
        let mut next = 0u8;
        for row in slice * map.slice_rows()..(slice + 1) * map.slice_rows() {
            for column in 0..side {
                let own = codes[row * side + column];
                let stands = (column > 0 && own > codes[row * side + column - 1] + 5)
                    || (row > 0 && own > codes[(row - 1) * side + column] + 5);
                if stands && next < u8::MAX {
                    next += 1;
                    let [height, _, x, y] = map.at(column, row);
                    map.set(column, row, [height, next, x, y]);
                }
            }
        }
        for wall in 1..=usize::from(next) {
            for row in 0..map.slice_rows() {
                let texel = [160 + (row % 5) as u8, 100, random.byte() % 3, 250];
                map.set(2 * side + wall, slice * map.slice_rows() + row, texel);
            }
        }
    }
}

fn read(bytes: &[u8]) -> Result<BlockMap, String> {
    decode(bytes, ([-3.5, 1e6 + 0.1], 64.0))
}

#[test]
fn every_size_and_content_comes_back() {
    for side_log2 in 5..=7u32 {
        for slices_log2 in 0..side_log2 {
            for content in CONTENTS {
                let seed = (10 * side_log2 + slices_log2) as u64;
                let has_16_bits = slices_log2 % 2 == 1;
                let map = block(1 << side_log2, 1 << slices_log2, has_16_bits, content, seed);
                assert_eq!(read(&encode(&map).unwrap()).unwrap(), map, "{content:?}");
            }
        }
    }
}

/// Blocks of every size and content.
pub fn blocks() -> impl Strategy<Value = BlockMap> {
    let contents = prop::sample::select(&CONTENTS[..]);
    (5..=7u32, 0..7u32, any::<bool>(), contents, any::<u64>()).prop_map(
        |(side_log2, slices_log2, has_16_bits, content, seed)| {
            let slices = 1 << slices_log2.min(side_log2 - 1);
            block(1 << side_log2, slices, has_16_bits, content, seed)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_block_comes_back(map in blocks()) {
        prop_assert_eq!(read(&encode(&map).unwrap()).unwrap(), map);
    }

    #[test]
    fn any_bytes_are_read_or_refused(start in 0..4usize, bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let whole = encode(&block(32, 1, start % 2 == 1, Content::Houses, 3)).unwrap();
        let kept = [0, 4, 28, whole.len() / 2][start];
        let _ = read(&[&whole[..kept], &bytes].concat());
    }
}

#[test]
fn padding_is_passed_over() {
    let map = block(32, 2, false, Content::Houses, 5);
    let mut bytes = encode(&map).unwrap();
    bytes.extend([0; 3]);
    assert_eq!(read(&bytes).unwrap(), map);
}

#[test]
fn truncated_blocks_are_refused() {
    for has_16_bits in [false, true] {
        let bytes = encode(&block(32, 1, has_16_bits, Content::Houses, 8)).unwrap();
        for length in 0..bytes.len() {
            assert!(read(&bytes[..length]).is_err(), "{length} bytes");
        }
    }
}

#[test]
fn a_flipped_bit_gives_a_block_or_an_error() {
    for has_16_bits in [false, true] {
        let whole = encode(&block(32, 2, has_16_bits, Content::Houses, 9)).unwrap();
        for bit in 0..8 * whole.len() {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let Ok(map) = read(&bytes) else {
                continue;
            };
            let again = encode(&map).unwrap();
            assert!(bit % 64 != 0 || read(&again).unwrap() == map, "bit {bit}");
        }
    }
}

#[test]
fn impossible_blocks_are_not_written() {
    let whole = block(32, 1, true, Content::Houses, 1);
    let spoil: [fn(&mut BlockMap); 6] = [
        |map| map.heights = [2.0, 1.0],
        |map| map.exposure = f32::NAN,
        |map| map.slices = 32,
        |map| map.slices = 3,
        |map| map.low_heights = Some(vec![0; 5]),
        |map| map.image.truncate(100),
    ];
    for spoil in spoil {
        let mut map = whole.clone();
        spoil(&mut map);
        assert!(encode(&map).is_err());
    }
}

#[test]
fn houses_take_few_bytes() {
    let map = block(128, 4, false, Content::Houses, 2);
    let length = encode(&map).unwrap().len();
    assert!(length < 6000, "{length} bytes");
}
