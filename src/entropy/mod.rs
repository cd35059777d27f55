//! Bits: a quadtree coder for sparse matrices of integers, a coder of symbols in contexts with static
//! tables, and an adaptive binary coder.

pub mod binary;
pub mod bits;
pub mod frequency;
pub mod gamma;
pub mod rans;
#[cfg(target_arch = "x86_64")]
pub(crate) mod rans_avx2;
pub mod token;

/// Why bytes cannot be what a coder of this room wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A code goes on after the last byte.
    #[error("the bits end too early")]
    Truncated,
    /// Bytes follow the last code, or the padding of the last byte is not zero.
    #[error("the bits go on after the last code, at bit {position}")]
    Surplus {
        /// First bit after the last code, from 0.
        position: usize,
    },
    /// A lane of an interleaved coder does not end where it must.
    #[error("its states do not end as they must")]
    Disagreement,
    /// An Elias gamma code stands for more than an `i32`.
    #[error("the code at bit {position} exceeds 32 bits")]
    Overlong {
        /// First bit of the code, from 0.
        position: usize,
    },
}
