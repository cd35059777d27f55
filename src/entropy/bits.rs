//! Bit strings in bytes, most significant bit first, the last byte padded with zeros.

use super::Error;

/// Appends bits to a byte vector.
#[derive(Debug, Default)]
pub struct BitWriter {
    bytes: Vec<u8>,
    /// The last `filled` bits written, in its low bits; above them nothing is promised.
    pending: u64,
    /// Always less than 64.
    filled: u32,
}

impl BitWriter {
    /// An empty bit string.
    pub fn new() -> BitWriter {
        BitWriter::default()
    }

    /// Appends the low `count` bits of `value`; `count` is at most 64 and the bits above are zero.
    #[inline]
    pub fn put(&mut self, value: u64, count: u32) {
        debug_assert!(count <= 64 && value.checked_shr(count).unwrap_or(0) == 0);
        let free = 64 - self.filled;
        if count < free {
            self.pending = (self.pending << count) | value;
            self.filled += count;
        } else {
            let rest = count - free;
            let word = self.pending.checked_shl(free).unwrap_or(0) | (value >> rest);
            self.bytes.extend_from_slice(&word.to_be_bytes());
            self.pending = value;
            self.filled = rest;
        }
    }

    /// The bytes of all bits so far.
    pub fn into_bytes(mut self) -> Vec<u8> {
        if self.filled > 0 {
            let word = (self.pending << (64 - self.filled)).to_be_bytes();
            self.bytes
                .extend(word.iter().take(self.filled.div_ceil(8) as usize));
        }
        self.bytes
    }
}

/// Reads bits from a slice. After its end come zeros without end, so that a decoder whose number
/// of reads is bounded needs no check but one of [`BitReader::finish`] at the end.
#[derive(Clone, Debug)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> BitReader<'a> {
    /// How many bits of [`BitReader::peek`] are sure to be there.
    pub const PEEKED: u32 = 57;

    /// Starts at the first bit of `bytes`.
    pub fn new(bytes: &'a [u8]) -> BitReader<'a> {
        BitReader { bytes, position: 0 }
    }

    /// Starts at a bit of `bytes`.
    pub fn at(bytes: &'a [u8], position: usize) -> BitReader<'a> {
        BitReader { bytes, position }
    }

    /// Bits read or skipped so far; may lie after the end.
    #[inline]
    pub fn position(&self) -> usize {
        self.position
    }

    /// Whether more bits were read than there are.
    #[inline]
    pub fn exhausted(&self) -> bool {
        self.position.div_ceil(8) > self.bytes.len()
    }

    /// The next bits from the top of the word downwards: at least [`BitReader::PEEKED`] of them,
    /// then zeros.
    #[inline]
    pub fn peek(&self) -> u64 {
        let rest = self.bytes.get(self.position / 8..).unwrap_or_default();
        let word = match rest.first_chunk() {
            Some(chunk) => u64::from_be_bytes(*chunk),
            None => last_word(rest),
        };
        word << (self.position % 8)
    }

    /// Moves on by `count` bits.
    #[inline]
    pub fn skip(&mut self, count: u32) {
        self.position += count as usize;
    }

    /// The next `count` bits, at most [`BitReader::PEEKED`].
    #[inline]
    pub fn get(&mut self, count: u32) -> u64 {
        debug_assert!(count <= Self::PEEKED);
        let value = self.peek().checked_shr(64 - count).unwrap_or(0);
        self.skip(count);
        value
    }

    /// Checks that the bits read were all that there are, up to zero padding in the last byte.
    ///
    /// # Errors
    /// [`Error::Truncated`] or [`Error::Surplus`].
    pub fn finish(self) -> Result<(), Error> {
        if self.exhausted() {
            return Err(Error::Truncated);
        }
        if self.position.div_ceil(8) < self.bytes.len() || self.peek() != 0 {
            return Err(Error::Surplus {
                position: self.position,
            });
        }
        Ok(())
    }
}

/// Fewer than eight bytes as the upper bytes of a word.
#[cold]
fn last_word(rest: &[u8]) -> u64 {
    let mut word = [0; 8];
    for (to, from) in word.iter_mut().zip(rest) {
        *to = *from;
    }
    u64::from_be_bytes(word)
}
