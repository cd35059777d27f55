//! Interleaved range asymmetric numeral systems with static tables (Duda 2013; Giesen 2014).
//!
//! A state x in [2^11, 2^27) holds the future of one lane. Decoding a symbol of frequency f whose slots
//! begin at s: `x = f * (x >> 11) + (x & 2047) - s`; below 2^11 the state takes in a word of 16 bits.
//! The symbols go round the lanes; every lane ends at 2^11, which tells damaged bytes apart.
//!
//! A block is the states of its lanes, then words, then raw bits from its end backwards.

use super::Error;
use super::bits::{BitReader, BitWriter};
use super::frequency::{Frequencies, PRECISION, SLOTS};
use super::token::{self, Tokens};

#[cfg(target_arch = "x86_64")]
pub(crate) use super::rans_avx2::Lanes;

/// Most lanes of a block.
pub const LANES: usize = 8;
/// Lanes of blocks from so many bytes on. Lanes make decoding fast, but the end of each costs about 15 bits.
const LANES_FROM: [(usize, usize); 3] = [(448, LANES), (256, 4), (0, 2)];
/// Where every state ends, and the least that one is between two symbols.
pub(super) const LEAST: u32 = SLOTS as u32;
/// Where a slot's distance from the first one of its symbol is in its entry; below are 12 bits of frequency.
pub(super) const OFFSET_AT: u32 = 12;
/// Where the coefficient is.
pub(super) const COEFFICIENT_AT: u32 = 24;
/// Bits of a state's bit length, less those of [`LEAST`].
const LENGTH_BITS: u32 = 4;

/// The tables of some contexts, made for decoding and encoding. One more context than was given is
/// there: the last one, in which every symbol is 0 and costs nothing.
#[derive(Clone, Debug)]
pub struct Tables {
    /// For each context its 2048 slots: frequency, slot less first slot << 12, symbol as a small coefficient << 24.
    pub(super) slots: Vec<u32>,
    /// For each context the first slot and the frequency of each symbol.
    ranges: Vec<[(u16, u16); token::SYMBOLS]>,
}

impl Tables {
    /// Tables for contexts with these frequencies.
    pub fn new(contexts: &[&Frequencies]) -> Tables {
        let sure = Frequencies::certain(0);
        let mut tables = Tables {
            slots: Vec::with_capacity((contexts.len() + 1) * SLOTS),
            ranges: Vec::with_capacity(contexts.len() + 1),
        };
        for frequencies in contexts.iter().copied().chain([&sure]) {
            let mut ranges = [(0, 0); token::SYMBOLS];
            let mut first = 0u16;
            for (symbol, frequency) in frequencies.iter() {
                ranges[usize::from(symbol)] = (first, frequency);
                let coefficient = (token::small(symbol) as u32) << COEFFICIENT_AT;
                let entry = |slot| coefficient | slot << OFFSET_AT | u32::from(frequency);
                tables.slots.extend((0..u32::from(frequency)).map(entry));
                first += frequency;
            }
            tables.ranges.push(ranges);
        }
        tables
    }

    /// The context in which every symbol is 0 and costs nothing.
    pub fn sure_context(&self) -> u8 {
        (self.ranges.len() - 1) as u8
    }
}

/// Bytes of coefficients, each with the context that it is coded in; at least `least` of them.
///
/// # Panics
/// If a context has no table.
pub fn encode(tables: &Tables, contexts: &[u8], coefficients: &[i32], least: usize) -> Vec<u8> {
    let mut tokens = Tokens::default();
    tokens.extend(coefficients);
    encode_tokens(tables, contexts, &tokens, least)
}

/// As [`encode`], for coefficients that are split already.
///
/// # Panics
/// If a context has no table.
pub fn encode_tokens(tables: &Tables, contexts: &[u8], tokens: &Tokens, least: usize) -> Vec<u8> {
    let (mut raw, mut rest) = (BitWriter::new(), tokens.raw.iter());
    let both = contexts.iter().zip(&tokens.symbols);
    let ranges = both.map(|(&context, &symbol)| {
        let ranges = &tables.ranges[usize::from(context)];
        let range = ranges[usize::from(symbol)];
        if symbol < token::FIRST_RAW && range.1 > 0 {
            return range;
        }
        let bits = if symbol < token::FIRST_RAW {
            0
        } else {
            rest.next().copied().unwrap_or(0)
        };
        if range.1 > 0 {
            raw.put(u64::from(bits), token::raw_bits(symbol));
            return range;
        }
        raw.put(u64::from(token::join(symbol, bits) as u32), 32);
        ranges[usize::from(token::ESCAPE)]
    });
    let ranges: Vec<(u16, u16)> = ranges.collect();
    let mut raw = raw.into_bytes();
    raw.reverse();
    let mut longer: Option<(usize, Vec<u8>)> = None;
    for (from, lanes) in LANES_FROM {
        let bytes = match lanes {
            LANES => interleave::<LANES>(&ranges),
            4 => interleave::<4>(&ranges),
            _ => interleave::<2>(&ranges),
        };
        let length = least.max(bytes.len() + raw.len());
        if length < from {
            longer = Some((from, bytes));
            continue;
        }
        // Fewer lanes need fewer bytes; should roundings make them more, zeros lengthen what more lanes gave.
        let (length, mut bytes) = match longer {
            Some((limit, longer)) if length >= limit => (limit, longer),
            _ => (length, bytes),
        };
        bytes.resize(length - raw.len(), 0);
        bytes.extend(raw);
        return bytes;
    }
    unreachable!("every length is at least 0")
}

/// Bits after the binary point of a reciprocal.
const RECIPROCAL_BITS: u32 = 40;
/// For each frequency f the least multiple of 2^-40 above 1 / f. It is at most 2^-40 above, so that for a state
/// below 2^16 f, f being at most 2^11, the product with it has the quotient for its whole part.
static RECIPROCALS: [u64; SLOTS + 1] = {
    let mut all = [0; SLOTS + 1];
    let mut frequency = 1;
    while frequency <= SLOTS {
        all[frequency] = (1 << RECIPROCAL_BITS) / frequency as u64 + 1;
        frequency += 1;
    }
    all
};

/// States and words of the slot ranges of some symbols, in so many lanes.
fn interleave<const COUNT: usize>(ranges: &[(u16, u16)]) -> Vec<u8> {
    let mut states = [LEAST; COUNT];
    // From the end backwards, and one that is always written before it counts.
    let mut words = vec![0u16; ranges.len() + 1];
    let mut free = ranges.len();
    let mut take = |state: &mut u32, (first, frequency): (u16, u16)| {
        let (first, frequency) = (u32::from(first), u32::from(frequency));
        words[free] = *state as u16;
        let is_full = *state >= frequency << 16;
        free -= usize::from(is_full);
        *state >>= 16 * u32::from(is_full);
        let reciprocal = RECIPROCALS[frequency as usize];
        let quotient = ((u64::from(*state) * reciprocal) >> RECIPROCAL_BITS) as u32;
        *state += first + quotient * (SLOTS as u32 - frequency);
    };
    let (rounds, rest) = ranges.as_chunks::<COUNT>();
    for (state, &range) in states.iter_mut().zip(rest).rev() {
        take(state, range);
    }
    for round in rounds.iter().rev() {
        for (state, &range) in states.iter_mut().zip(round).rev() {
            take(state, range);
        }
    }
    let mut head = BitWriter::new();
    for &state in &states {
        let length = state.ilog2();
        head.put(u64::from(length - PRECISION), LENGTH_BITS);
        head.put(u64::from(state) & ((1 << length) - 1), length);
    }
    let mut bytes = head.into_bytes();
    bytes.reserve(2 * (ranges.len() - free));
    bytes.extend(words[free + 1..].iter().flat_map(|word| word.to_le_bytes()));
    bytes
}

/// Reads a block row by row.
pub struct Decoder<'a> {
    tables: &'a Tables,
    /// The block and some zeros.
    bytes: &'a [u8],
    /// Bytes of the block.
    length: usize,
    states: [u32; LANES],
    lanes: usize,
    /// Next word; may lie beyond the block, where words are 0.
    position: usize,
    /// Symbols decoded so far.
    decoded: usize,
    raw: RawBits,
    vectors: bool,
}

/// Raw bits from the end of a block, turned round when the first is asked for.
#[derive(Default)]
struct RawBits {
    reversed: Option<Vec<u8>>,
    position: usize,
}

/// Zeros that a block is followed by while it is decoded.
const PADDING: usize = 16;

impl<'a> Decoder<'a> {
    /// A decoder at the first symbol of a block; `scratch` holds it while it is decoded. `vectors`
    /// allows what the processor has; without it the portable code runs, to the same result.
    pub fn new(
        tables: &'a Tables,
        block: &[u8],
        scratch: &'a mut Vec<u8>,
        vectors: bool,
    ) -> Decoder<'a> {
        scratch.clear();
        scratch.extend_from_slice(block);
        scratch.resize(block.len() + PADDING, 0);
        let (_, lanes) = LANES_FROM[LANES_FROM.partition_point(|(from, _)| block.len() < *from)];
        let mut states = [LEAST; LANES];
        let mut head = BitReader::new(block);
        for state in &mut states[..lanes] {
            let length = head.get(LENGTH_BITS) as u32 + PRECISION;
            *state = 1 << length | head.get(length) as u32;
        }
        Decoder {
            tables,
            bytes: scratch,
            length: block.len(),
            states,
            lanes,
            position: head.position().div_ceil(8),
            decoded: 0,
            raw: RawBits::default(),
            vectors: vectors && simd::available(),
        }
    }

    /// The next coefficients, as many as there are contexts. Any bytes give some.
    ///
    /// # Panics
    /// If a context has no table, or `coefficients` is shorter than `contexts`.
    pub fn decode(&mut self, contexts: &[u8], coefficients: &mut [i32]) {
        assert!(contexts.len() <= coefficients.len());
        let whole = (contexts.len() | self.decoded).is_multiple_of(LANES);
        let has_raw = match self.lanes {
            LANES if self.vectors && whole => simd::decode(self, contexts, coefficients),
            2 if whole => self.decode_lanes::<2>(contexts, coefficients),
            4 if whole => self.decode_lanes::<4>(contexts, coefficients),
            LANES if whole => self.decode_lanes::<LANES>(contexts, coefficients),
            _ => self.decode_lanes::<1>(contexts, coefficients),
        };
        self.decoded += contexts.len();
        if has_raw {
            self.join_raw(&mut coefficients[..contexts.len()]);
        }
    }

    /// Gives the coefficients that raw bits belong to these.
    #[cold]
    pub(crate) fn join_raw(&mut self, coefficients: &mut [i32]) {
        let block = &self.bytes[..self.length];
        for coefficient in coefficients {
            let symbol = ((*coefficient << 1) ^ (*coefficient >> 31)) as u8;
            if symbol >= token::FIRST_RAW {
                *coefficient = self.raw.join(symbol, block);
            }
        }
    }

    /// Where the lanes are at the first symbol, if vectors may go on from there.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn lanes(&self) -> Option<Lanes<'a>> {
        let may = self.vectors && self.decoded == 0;
        may.then_some(Lanes {
            slots: &self.tables.slots,
            bytes: self.bytes,
            count: self.lanes,
            states: self.states,
            position: self.position,
        })
    }

    /// Goes on from where the lanes came to.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn set_lanes(&mut self, lanes: &Lanes, decoded: usize) {
        self.states = lanes.states;
        self.position = lanes.position;
        self.decoded += decoded;
    }

    /// Symbols of the next contexts, as the coefficients that they would be if all were small; returns
    /// whether some are not. `COUNT` is the number of lanes, whose turn begins; or 1, to look for the lane each
    /// time.
    fn decode_lanes<const COUNT: usize>(&mut self, contexts: &[u8], symbols: &mut [i32]) -> bool {
        let mut states: [u32; COUNT] = std::array::from_fn(|lane| self.states[lane]);
        let slots = self.tables.slots.as_slice();
        let (bytes, mut position, mut greatest) = (self.bytes, self.position, 0);
        let rounds = contexts
            .chunks_exact(COUNT)
            .zip(symbols.chunks_exact_mut(COUNT));
        for (round, (contexts, symbols)) in rounds.enumerate() {
            for lane in 0..COUNT {
                let mut state = states[lane];
                if COUNT == 1 {
                    state = self.states[(self.decoded + round) % self.lanes];
                }
                let slot = state as usize % SLOTS;
                let entry = slots[usize::from(contexts[lane]) * SLOTS + slot];
                let frequency = entry & (2 * SLOTS as u32 - 1);
                let offset = entry >> OFFSET_AT & (SLOTS as u32 - 1);
                state = frequency * (state >> PRECISION) + offset;
                if state < LEAST {
                    let word = bytes.get(position..).and_then(|rest| rest.first_chunk());
                    state =
                        state << 16 | u32::from(word.map_or(0, |word| u16::from_le_bytes(*word)));
                    position += 2;
                }
                symbols[lane] = entry as i32 >> COEFFICIENT_AT;
                greatest = greatest.max(symbols[lane].abs());
                if COUNT == 1 {
                    self.states[(self.decoded + round) % self.lanes] = state;
                }
                states[lane] = state;
            }
        }
        if COUNT > 1 {
            self.states[..COUNT].copy_from_slice(&states);
        }
        self.position = position;
        greatest > token::LARGEST_SMALL
    }

    /// Checks that the block held these symbols and nothing else.
    ///
    /// # Errors
    /// [`Error::Truncated`] or [`Error::Surplus`] where words and raw bits overlap or something lies between
    /// them; [`Error::Disagreement`] where a state does not end as it must.
    pub fn finish(self) -> Result<(), Error> {
        let raw = self.raw.position.div_ceil(8);
        let Some(gap) = self
            .length
            .checked_sub(raw)
            .filter(|&end| self.position <= end)
        else {
            return Err(Error::Truncated);
        };
        if self.bytes[self.position..gap].iter().any(|&byte| byte != 0) {
            return Err(Error::Surplus {
                position: 8 * self.position,
            });
        }
        if self.states.iter().any(|&state| state != LEAST) {
            return Err(Error::Disagreement);
        }
        Ok(())
    }
}

impl RawBits {
    fn join(&mut self, symbol: u8, block: &[u8]) -> i32 {
        let count = token::raw_bits(symbol);
        if count == 0 {
            return token::small(symbol);
        }
        let bytes = self
            .reversed
            .get_or_insert_with(|| block.iter().rev().copied().collect());
        let mut reader = BitReader::at(bytes, self.position);
        let raw = reader.get(count) as u32;
        self.position = reader.position();
        token::join(symbol, raw)
    }
}

/// Eight lanes at once, where the processor can.
mod simd {
    use super::Decoder;

    #[cfg(target_arch = "x86_64")]
    pub(super) fn available() -> bool {
        super::super::rans_avx2::available()
    }

    #[cfg(not(target_arch = "x86_64"))]
    pub(super) fn available() -> bool {
        false
    }

    #[cfg(target_arch = "x86_64")]
    pub(super) fn decode(decoder: &mut Decoder, contexts: &[u8], symbols: &mut [i32]) -> bool {
        use super::super::rans_avx2::{Lanes, decode};
        let mut lanes = Lanes {
            slots: &decoder.tables.slots,
            bytes: decoder.bytes,
            count: decoder.lanes,
            states: decoder.states,
            position: decoder.position,
        };
        let has_raw = decode(&mut lanes, contexts, &mut symbols[..contexts.len()]);
        decoder.set_lanes(&lanes, 0);
        has_raw
    }

    #[cfg(not(target_arch = "x86_64"))]
    pub(super) fn decode(decoder: &mut Decoder, contexts: &[u8], symbols: &mut [i32]) -> bool {
        decoder.decode_lanes::<LANES>(contexts, symbols)
    }
}
