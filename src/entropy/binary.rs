//! An adaptive binary range coder for small data: no header, and the end costs about a byte.
//!
//! An interval of numbers, 32 bits of it in view, is split at each decision in the ratio of the
//! two probabilities; the output is the number of the last interval that needs the fewest bytes.
//! Zero bytes at the end are dropped, because the decoder reads zeros there anyway.

/// How likely a decision is, learned from those before it in the same context: fast at first,
/// then as a moving average over about 64 decisions.
#[derive(Clone, Copy, Debug)]
pub struct Probability {
    /// Of `true`, in units of 2^-16; never 0.
    of_true: u16,
    /// Decisions seen, as far as they change the rate.
    seen: u8,
}

impl Default for Probability {
    fn default() -> Probability {
        Probability {
            of_true: 1 << 15,
            seen: 0,
        }
    }
}

impl Probability {
    const SLOWEST: u32 = 6;
    const LAST: u8 = (1 << Self::SLOWEST) - 2;

    /// The part of `range` that stands for `true`: at least 1 and less than `range`, which is 2^24
    /// or more.
    #[inline]
    fn split(self, range: u32) -> u32 {
        ((u64::from(range) * u64::from(self.of_true)) >> 16) as u32
    }

    #[inline]
    fn learn(&mut self, decision: bool) {
        let rate = (u32::from(self.seen) + 2).ilog2();
        if decision {
            self.of_true += (self.of_true.wrapping_neg()) >> rate;
        } else {
            self.of_true -= self.of_true >> rate;
        }
        self.seen = (self.seen + 1).min(Self::LAST);
    }
}

/// An interval narrower than this is widened by a byte.
const NARROW: u32 = 1 << 24;

/// Writes decisions.
#[derive(Debug)]
pub struct BinaryEncoder {
    bytes: Vec<u8>,
    low: u32,
    range: u32,
}

impl Default for BinaryEncoder {
    fn default() -> BinaryEncoder {
        BinaryEncoder {
            bytes: Vec::new(),
            low: 0,
            range: u32::MAX,
        }
    }
}

impl BinaryEncoder {
    /// An encoder without decisions.
    pub fn new() -> BinaryEncoder {
        BinaryEncoder::default()
    }

    /// Appends a decision and lets its context learn from it.
    #[inline]
    pub fn encode(&mut self, decision: bool, probability: &mut Probability) {
        let split = probability.split(self.range);
        if decision {
            self.range = split;
        } else {
            self.raise(u64::from(self.low) + u64::from(split));
            self.range -= split;
        }
        probability.learn(decision);
        while self.range < NARROW {
            self.bytes.push((self.low >> 24) as u8);
            self.low <<= 8;
            self.range <<= 8;
        }
    }

    /// The bytes of all decisions; none at all if zeros stand for them.
    pub fn finish(mut self) -> Vec<u8> {
        let low = u64::from(self.low);
        let end = low + u64::from(self.range);
        let roundest = (0..=32).rev().map(|bits| low.next_multiple_of(1 << bits));
        // Rounded to one, `low` stays itself: some number always lies inside.
        self.raise(
            roundest
                .into_iter()
                .find(|number| *number < end)
                .unwrap_or(low),
        );
        self.bytes.extend_from_slice(&self.low.to_be_bytes());
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        self.bytes
    }

    /// Sets the lower end; its bit 32 is carried into the bytes already out.
    #[inline]
    fn raise(&mut self, low: u64) {
        self.low = low as u32;
        if low > u64::from(u32::MAX) {
            for byte in self.bytes.iter_mut().rev() {
                *byte = byte.wrapping_add(1);
                if *byte != 0 {
                    break;
                }
            }
        }
    }
}

/// Reads decisions. After the last byte it reads zeros, so that any bytes give decisions for as
/// long as one asks.
#[derive(Clone, Debug)]
pub struct BinaryDecoder<'a> {
    bytes: std::slice::Iter<'a, u8>,
    /// Where the number lies above the interval's lower end.
    offset: u32,
    range: u32,
}

impl<'a> BinaryDecoder<'a> {
    /// Starts at the first decision of what [`BinaryEncoder::finish`] gave.
    pub fn new(bytes: &'a [u8]) -> BinaryDecoder<'a> {
        let mut decoder = BinaryDecoder {
            bytes: bytes.iter(),
            offset: 0,
            range: u32::MAX,
        };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    /// The next decision; its context learns from it as the encoder's did.
    #[inline]
    pub fn decode(&mut self, probability: &mut Probability) -> bool {
        let split = probability.split(self.range);
        let decision = self.offset < split;
        if decision {
            self.range = split;
        } else {
            self.offset -= split;
            self.range -= split;
        }
        probability.learn(decision);
        while self.range < NARROW {
            self.range <<= 8;
            self.shift();
        }
        decision
    }

    #[inline]
    fn shift(&mut self) {
        self.offset = (self.offset << 8) | u32::from(self.bytes.next().copied().unwrap_or(0));
    }
}
