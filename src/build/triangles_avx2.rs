//! The largest difference from a diamond's triangles in AVX2: eight samples at a time, in 32 bits, with the result
//! of the portable function.

use super::triangles::Surface;
use std::arch::x86_64::*;

/// Samples of a vector.
const LANES: usize = 8;
/// Greatest number of cells along a diamond's side.
const LONGEST: usize = 128;

/// At constant v the surface at the left edge of each cell, times the extent, and what it grows by with u in either
/// triangle of the cell; after the last one that counts come as many as a vector reads too far.
pub(super) struct Room {
    edges: [i32; LONGEST + 1 + LANES],
    slopes: [[i32; LONGEST + LANES]; 2],
}

impl Room {
    pub(super) fn new() -> Room {
        Room {
            edges: [0; LONGEST + 1 + LANES],
            slopes: [[0; LONGEST + LANES]; 2],
        }
    }
}

/// [`Surface::greatest_difference`] of numbers that fit 32 bits; `None` where the processor cannot.
pub(super) fn greatest_difference(
    surface: &mut Surface,
    at: [i64; 2],
    step: i64,
    heights: &[i32],
) -> Option<i32> {
    if !std::arch::is_x86_feature_detected!("avx2") || surface.cells > LONGEST {
        return None;
    }
    // SAFETY: the processor has AVX2.
    Some(unsafe { differences(surface, at, step, heights) })
}

/// A row of samples in the cells that it lies in.
struct Samples<'a> {
    edges: &'a [i32],
    slopes: [&'a [i32]; 2],
    cells: i32,
    shift: u32,
    /// log2 of what u grows by from one sample to the next.
    step_shift: u32,
    turn: i32,
    heights: &'a [i32],
}

#[target_feature(enable = "avx2")]
fn differences(surface: &mut Surface, [u, v]: [i64; 2], step: i64, heights: &[i32]) -> i32 {
    let (cells, shift) = (surface.cells as i64, surface.shift);
    let last = u + step * (heights.len() as i64 - 1);
    let [first, end] = [u, last].map(|u| (u >> shift).min(cells - 1) as usize);
    let (j, b) = surface.row(v);
    let turn = surface.turn(b) as i32;
    fill(surface, j, b as i32, first..end + 1);
    let (one, other) = (
        &surface.room.slopes[0][first..],
        &surface.room.slopes[1][first..],
    );
    let samples = Samples {
        edges: &surface.room.edges[first..],
        slopes: if surface.main {
            [other, one]
        } else {
            [one, other]
        },
        // From the first one on.
        cells: surface.cells as i32 - first as i32,
        shift,
        step_shift: step.trailing_zeros(),
        turn,
        heights,
    };
    let u = (u - ((first as i64) << shift)) as i32;
    if (LANES as i32) << samples.step_shift > 1 << shift {
        samples.in_short_cells(u)
    } else {
        samples.in_long_cells(u)
    }
}

/// Edges and slopes of some cells of a row, `b` below its upper edge; slopes above first. Sums wrap, and what they
/// lead to fits.
#[inline]
#[target_feature(enable = "avx2")]
fn fill(surface: &mut Surface, j: usize, b: i32, cells: std::ops::Range<usize>) {
    let side = surface.cells + 1;
    let above = &surface.vertices[j * side..][cells.start..=cells.end];
    let below = &surface.vertices[(j + 1) * side..][cells.start..=cells.end];
    let a = (1 << surface.shift) - b;
    let edges = surface.room.edges[cells.start..=cells.end].iter_mut();
    for (edge, (&above, &below)) in edges.zip(above.iter().zip(below)) {
        *edge = above.wrapping_mul(a).wrapping_add(below.wrapping_mul(b));
    }
    for (slopes, row) in surface.room.slopes.iter_mut().zip([above, below]) {
        let pairs = row.iter().zip(&row[1..]);
        for (slope, (&left, &right)) in slopes[cells.clone()].iter_mut().zip(pairs) {
            *slope = right.wrapping_sub(left);
        }
    }
}

/// Eight numbers.
///
/// # Safety
/// They may be read.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load(numbers: *const i32) -> __m256i {
    // SAFETY: the caller's.
    unsafe { _mm256_loadu_si256(numbers.cast()) }
}

impl Samples<'_> {
    /// Cells of 1, 2 or 4 samples: a vector holds some.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn in_short_cells(&self, u: i32) -> i32 {
        let extent = 1 << self.shift;
        let period_shift = self.shift.saturating_sub(self.step_shift);
        let period = 1 << period_shift;
        // Samples of a cell that come before the first one.
        let skipped = (u & (extent - 1)) >> self.step_shift;
        let head = ((-skipped & (period - 1)) as usize).min(self.heights.len());
        let (before, rest) = self.heights.split_at(head);
        let largest = self.one_by_one(u, before);
        let u = u + ((head as i32) << self.step_shift);
        let start = (u >> self.shift) as usize;
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let cell_of = _mm256_srl_epi32(lanes, _mm_cvtsi32_si128(period_shift as i32));
        let within = _mm256_and_si256(lanes, _mm256_set1_epi32(period - 1));
        let a = _mm256_add_epi32(
            _mm256_set1_epi32(u & (extent - 1)),
            _mm256_sll_epi32(within, _mm_cvtsi32_si128(self.step_shift as i32)),
        );
        let (is_after, along) = self.sides(a);
        let cells_at_once = LANES >> period_shift;
        let (vectors, _) = rest.as_chunks::<LANES>();
        let whole = (self.cells as usize).saturating_sub(start) / cells_at_once;
        let whole = whole.min(vectors.len());
        let mut greatest = _mm256_setzero_si256();
        for (number, heights) in vectors[..whole].iter().enumerate() {
            let cell = start + number * cells_at_once;
            let (edges, next) = (
                &self.edges[cell..][..LANES],
                &self.edges[cell + 1..][..LANES],
            );
            let first = &self.slopes[0][cell..][..LANES];
            let second = &self.slopes[1][cell..][..LANES];
            // SAFETY: each slice has eight numbers.
            let (left, right, first, second) = unsafe {
                (
                    load(edges.as_ptr()),
                    load(next.as_ptr()),
                    load(first.as_ptr()),
                    load(second.as_ptr()),
                )
            };
            let left = _mm256_permutevar8x32_epi32(left, cell_of);
            let right = _mm256_permutevar8x32_epi32(right, cell_of);
            let first = _mm256_permutevar8x32_epi32(first, cell_of);
            let second = _mm256_permutevar8x32_epi32(second, cell_of);
            let base = _mm256_blendv_epi8(left, right, is_after);
            let slope = _mm256_blendv_epi8(first, second, is_after);
            // SAFETY: there are eight heights.
            let heights = unsafe { load(heights.as_ptr()) };
            greatest = _mm256_max_epi32(greatest, self.difference(base, slope, along, heights));
        }
        let done = whole * LANES;
        let after = self.one_by_one(u + ((done as i32) << self.step_shift), &rest[done..]);
        largest.max(greatest_of(greatest)).max(after)
    }

    /// Cells of eight samples or more: a vector lies in one.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn in_long_cells(&self, mut u: i32) -> i32 {
        let extent = 1 << self.shift;
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let steps = _mm256_sll_epi32(lanes, _mm_cvtsi32_si128(self.step_shift as i32));
        let (mut rest, mut greatest) = (self.heights, _mm256_setzero_si256());
        while !rest.is_empty() {
            let cell = (u >> self.shift).min(self.cells - 1);
            let first = u - (cell << self.shift);
            let last = extent - i32::from(cell + 1 < self.cells);
            let count = (((last - first) >> self.step_shift) + 1) as usize;
            let (own, others) = rest.split_at(count.min(rest.len()));
            let cell = cell as usize;
            let left = _mm256_set1_epi32(self.edges[cell]);
            let right = _mm256_set1_epi32(self.edges[cell + 1]);
            let one = _mm256_set1_epi32(self.slopes[0][cell]);
            let two = _mm256_set1_epi32(self.slopes[1][cell]);
            for (number, own) in own.chunks(LANES).enumerate() {
                let start = first + (((number * LANES) as i32) << self.step_shift);
                let a = _mm256_add_epi32(_mm256_set1_epi32(start), steps);
                let (is_after, along) = self.sides(a);
                let base = _mm256_blendv_epi8(left, right, is_after);
                let slope = _mm256_blendv_epi8(one, two, is_after);
                let mut padded = [0; LANES];
                let heights = if own.len() == LANES {
                    own.as_ptr()
                } else {
                    padded[..own.len()].copy_from_slice(own);
                    padded.as_ptr()
                };
                // SAFETY: there are eight heights, or the array's.
                let heights = unsafe { load(heights) };
                let all = self.difference(base, slope, along, heights);
                let counts = _mm256_cmpgt_epi32(_mm256_set1_epi32(own.len() as i32), lanes);
                greatest = _mm256_max_epi32(greatest, _mm256_and_si256(all, counts));
            }
            u += (own.len() as i32) << self.step_shift;
            rest = others;
        }
        greatest_of(greatest)
    }

    /// Which places of a cell lie after the turn, and how far each is from the edge that counts there.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn sides(&self, a: __m256i) -> (__m256i, __m256i) {
        let is_after = _mm256_cmpgt_epi32(a, _mm256_set1_epi32(self.turn));
        let extent = _mm256_set1_epi32(1 << self.shift);
        (
            is_after,
            _mm256_sub_epi32(a, _mm256_and_si256(is_after, extent)),
        )
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn difference(
        &self,
        base: __m256i,
        slope: __m256i,
        along: __m256i,
        heights: __m256i,
    ) -> __m256i {
        let surface = _mm256_add_epi32(base, _mm256_mullo_epi32(along, slope));
        let shift = _mm_cvtsi32_si128(self.shift as i32);
        _mm256_abs_epi32(_mm256_sub_epi32(_mm256_sll_epi32(heights, shift), surface))
    }

    /// Some samples from u on.
    fn one_by_one(&self, mut u: i32, heights: &[i32]) -> i32 {
        let (extent, mut largest) = (1 << self.shift, 0);
        for &height in heights {
            let cell = (u >> self.shift).min(self.cells - 1);
            let (a, cell) = (u - (cell << self.shift), cell as usize);
            let surface = if a <= self.turn {
                self.edges[cell].wrapping_add(a.wrapping_mul(self.slopes[0][cell]))
            } else {
                let back = (extent - a).wrapping_mul(self.slopes[1][cell]);
                self.edges[cell + 1].wrapping_sub(back)
            };
            largest = largest.max((height << self.shift).wrapping_sub(surface).abs());
            u += 1 << self.step_shift;
        }
        largest
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn greatest_of(numbers: __m256i) -> i32 {
    let mut all = [0; LANES];
    // SAFETY: eight numbers are 32 bytes.
    unsafe { _mm256_storeu_si256(all.as_mut_ptr().cast(), numbers) };
    all.into_iter().max().unwrap_or(0)
}
