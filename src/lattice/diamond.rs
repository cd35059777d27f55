//! Identifiers of diamonds.

/// A diamond, identified by the lattice coordinates of its centre: integers on a root square of side
/// 2^30. Unique over all levels and the same whatever the depth of a repository.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Diamond {
    /// Along columns.
    pub x: i32,
    /// Along rows.
    pub y: i32,
    /// 0 on a planar domain.
    pub z: i32,
}

impl Diamond {
    /// The planar diamond with this centre.
    pub const fn planar(x: i32, y: i32) -> Diamond {
        Diamond { x, y, z: 0 }
    }

    /// Level of the diamond: 0 at the root, +1 per bisection, odd for turned squares.
    ///
    /// Meaningful for centres inside the root square, other than its corners.
    pub fn level(self) -> u32 {
        let (x, y) = (trailing_zeros(self.x), trailing_zeros(self.y));
        let finest = x.min(y).min(29);
        2 * (29 - finest) + u32::from(x != y)
    }
}

/// 32 for zero, which divides by every power of two.
fn trailing_zeros(coordinate: i32) -> u32 {
    coordinate.trailing_zeros()
}
