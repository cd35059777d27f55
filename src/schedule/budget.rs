//! What one frame may spend.

/// Limits of one update; [`Budget::NO_LIMIT`] in a field lifts that one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// No refinement begins when these have passed since the update began.
    pub microseconds: u64,
    /// Refinements of this update; 0 freezes what is held.
    pub refinements: u64,
    /// Bytes of decoded data held.
    pub bytes: u64,
    /// Bytes of vertex data newly handed out by this update.
    pub upload_bytes: u64,
    /// Patches drawn.
    pub patches: u64,
}

impl Budget {
    /// Lifts one limit.
    pub const NO_LIMIT: u64 = u64::MAX;

    /// No limits at all.
    pub const UNLIMITED: Budget = Budget {
        microseconds: Self::NO_LIMIT,
        refinements: Self::NO_LIMIT,
        bytes: Self::NO_LIMIT,
        upload_bytes: Self::NO_LIMIT,
        patches: Self::NO_LIMIT,
    };
}
