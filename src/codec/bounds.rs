//! How a diamond's stored error and height range are rounded outwards into three bytes.

/// An error bound in units as one byte: 0 is exact zero, 255 unbounded, and 1..=254 a geometric
/// scale of six steps an octave from 2^-6, so that rounding up adds less than 12.3 %.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ErrorCode(pub u8);

/// 2^(k/6) for k in 0..6, written out so that every machine has the same bits.
const SIXTH_OCTAVES: [f64; 6] = [
    1.0,
    1.122_462_048_309_373,
    1.259_921_049_894_873_2,
    std::f64::consts::SQRT_2,
    1.587_401_051_968_199_4,
    1.781_797_436_280_678_5,
];

impl ErrorCode {
    /// The code of an unbounded error.
    pub const UNBOUNDED: ErrorCode = ErrorCode(255);

    /// The least code whose value is at least `error` (units, not negative; NaN counts as unbounded).
    pub fn covering(error: f64) -> ErrorCode {
        (0..=255)
            .map(ErrorCode)
            .find(|code| code.value() >= error)
            .unwrap_or(Self::UNBOUNDED)
    }

    /// The bound in units; infinite where unbounded.
    pub fn value(self) -> f64 {
        match self.0 {
            0 => 0.0,
            255 => f64::INFINITY,
            code => {
                let step = i32::from(code) - 1;
                SIXTH_OCTAVES[(step % 6) as usize] * f64::powi(2.0, step / 6 - 6)
            }
        }
    }
}

/// A height range inside that of a parent, in 255ths of the parent's extent from either end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RangeCode {
    /// Distance of the low end from the parent's.
    pub low: u8,
    /// Distance of the high end from the parent's.
    pub high: u8,
}

impl RangeCode {
    /// The narrowest code whose range contains `range`, given the parent's range, which contains it too.
    pub fn covering(range: [i32; 2], parent: [i32; 2]) -> RangeCode {
        let extent = i64::from(parent[1]) - i64::from(parent[0]);
        if extent <= 0 {
            return RangeCode { low: 0, high: 0 };
        }
        let code = |distance: i64| (distance.max(0) * 255 / extent).min(255) as u8;
        RangeCode {
            low: code(i64::from(range[0]) - i64::from(parent[0])),
            high: code(i64::from(parent[1]) - i64::from(range[1])),
        }
    }

    /// The range for a parent's range; never wider than it. Ends that damaged bytes cross are swapped.
    pub fn range(self, parent: [i32; 2]) -> [i32; 2] {
        let extent = i64::from(parent[1]) - i64::from(parent[0]);
        let inset = |code: u8| i64::from(code) * extent / 255;
        let low = (i64::from(parent[0]) + inset(self.low)) as i32;
        let high = (i64::from(parent[1]) - inset(self.high)) as i32;
        [low.min(high), low.max(high)]
    }
}
