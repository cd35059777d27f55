//! Rays, and four of them at once.
//!
//! What can be computed for four rays by the same instructions is: `wide` has them for each machine, and where there are none a loop,
//! with the same results.

use wide::{f32x4, f64x4};

/// Rays of a packet.
pub(super) const LANES: usize = 4;

/// A number of each ray; as a mask, all bits or none.
pub(super) type Floats = f32x4;
/// As [`Floats`], where places in a reference system ask for more.
type Doubles = f64x4;

/// Least size of a direction's component, of about 1, so that none divides by 0.
const LEAST_DIRECTION: f64 = 1e-300;
/// Least size of a direction.
const LEAST_SCALE: f64 = 1e-300;

/// A half line in metres.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: [f64; 3],
    /// Where it goes; of any length above 0.
    pub direction: [f64; 3],
}

/// Rays with what all boxes ask of them. Directions are scaled by powers of two, exactly, to sizes of about 1.
pub(super) struct Beams {
    pub(super) origin: [Doubles; 3],
    pub(super) direction: [Doubles; 3],
    pub(super) inverse: [Doubles; 3],
    /// Lengths of the rays' own directions in one of the scaled ones'.
    lengths: Doubles,
    /// Whether any of them does not move along an axis.
    is_any_still: bool,
}

/// Where rays are in a box.
pub(super) struct Spans {
    /// From where on, in lengths of the scaled directions.
    pub(super) start: Doubles,
    /// To where.
    pub(super) end: Doubles,
    /// Whether they come in through a side; else from above, or they start inside.
    pub(super) is_side: Floats,
    /// Whether they are in it anywhere.
    pub(super) meets: Floats,
}

/// A square of the ground: its south-west corner and its edge, in metres.
pub(super) type Square = ([f64; 2], f64);

/// Rays in packets, and how many of each; the last packet is filled up with its first ray.
pub(super) fn packets(rays: &[Ray]) -> impl Iterator<Item = ([Ray; LANES], usize)> {
    rays.chunks(LANES).map(|rays| {
        let packet = std::array::from_fn(|lane| *rays.get(lane).unwrap_or(&rays[0]));
        (packet, rays.len())
    })
}

#[inline(always)]
pub(super) fn select(mask: Floats, one: Floats, other: Floats) -> Floats {
    mask.bitselect(one, other)
}

/// Without what comes after the point, of numbers that an `i32` holds.
#[inline(always)]
pub(super) fn whole(numbers: Floats) -> Floats {
    Floats::from_i32x4(numbers.fast_trunc_int())
}

/// To the nearest floats.
#[inline(always)]
pub(super) fn narrow(numbers: Doubles) -> Floats {
    Floats::from(numbers.to_array().map(|number| number as f32))
}

/// A mask's low halves, which are as its high ones.
#[inline(always)]
fn narrow_mask(mask: Doubles) -> Floats {
    Floats::from(
        mask.to_array()
            .map(|number| f32::from_bits(number.to_bits() as u32)),
    )
}

impl Beams {
    #[inline(always)]
    pub(super) fn new(rays: &[Ray; LANES]) -> Beams {
        let origin = |axis: usize| Doubles::from(rays.map(|ray| ray.origin[axis]));
        let direction = |axis: usize| Doubles::from(rays.map(|ray| ray.direction[axis]));
        let (x, y, z) = (direction(0), direction(1), direction(2));
        let size = x.abs().fast_max(y.abs()).fast_max(z.abs());
        // The bits of infinity are those of an exponent: they leave a power of two.
        let scale = size.fast_max(Doubles::splat(LEAST_SCALE)) & Doubles::splat(f64::INFINITY);
        let lengths = Doubles::splat(1.0) / scale;
        let inverse = |along: Doubles| {
            let size = along.abs().fast_max(Doubles::splat(LEAST_DIRECTION));
            Doubles::splat(1.0) / (size | (along & Doubles::splat(-0.0)))
        };
        let (x, y, z) = (x * lengths, y * lengths, z * lengths);
        let still = [x, y, z].map(|along| along.simd_eq(Doubles::ZERO).any());
        Beams {
            origin: [origin(0), origin(1), origin(2)],
            direction: [x, y, z],
            inverse: [inverse(x), inverse(y), inverse(z)],
            lengths,
            is_any_still: still.contains(&true),
        }
    }

    /// The number of the quarter of a square that each ray comes to before the others, if to all: 1 for east and 2 for north.
    #[inline(always)]
    pub(super) fn first_quarters(&self) -> Floats {
        let is_against = |axis: usize| narrow_mask(self.direction[axis].simd_lt(Doubles::ZERO));
        (is_against(0) & Floats::splat(1.0)) + (is_against(1) & Floats::splat(2.0))
    }

    /// A distance in lengths of a ray's own direction.
    pub(super) fn distance(&self, lane: usize, distance: f64) -> f64 {
        distance * self.lengths.to_array()[lane]
    }

    /// Where they are in a box over a square. Boxes that touch agree bit for bit on where a ray passes from one to the other.
    #[inline(always)]
    pub(super) fn spans(&self, (corner, side): Square, heights: [f64; 2]) -> Spans {
        let between = |axis: usize, low: f64, high: f64| {
            let one = (Doubles::splat(low) - self.origin[axis]) * self.inverse[axis];
            let other = (Doubles::splat(high) - self.origin[axis]) * self.inverse[axis];
            let mut leave = one.fast_max(other);
            if self.is_any_still {
                // Along a bound it is inside all the way.
                let is_still = self.direction[axis].simd_eq(Doubles::ZERO);
                let is_bound = one.simd_eq(Doubles::ZERO) | other.simd_eq(Doubles::ZERO);
                leave = (is_still & is_bound).bitselect(Doubles::splat(f64::INFINITY), leave);
            }
            (one.fast_min(other), leave)
        };
        let x = between(0, corner[0], corner[0] + side);
        let y = between(1, corner[1], corner[1] + side);
        let z = between(2, heights[0], heights[1]);
        let beside = x.0.fast_max(y.0);
        let start = beside.fast_max(z.0).fast_max(Doubles::ZERO);
        let end = x.1.fast_min(y.1).fast_min(z.1);
        Spans {
            is_side: narrow_mask(beside.simd_ge(z.0) & beside.simd_gt(Doubles::ZERO)),
            meets: narrow_mask(start.simd_le(end)),
            start,
            end,
        }
    }
}
