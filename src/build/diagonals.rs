//! The heights of a tile along its diagonals.

use crate::transform::adaptive::extremes;

/// The heights of a rectangle, those with the same sum of column and row together.
pub(super) struct Diagonals {
    first: [i64; 2],
    height: i64,
    /// Diagonal after diagonal, by column; component after component.
    heights: Vec<i32>,
    /// Where each diagonal of the first component begins, and the end of the last one.
    starts: Vec<usize>,
    /// Least and greatest height of any component.
    pub(super) range: [i32; 2],
}

impl Diagonals {
    /// Of heights row by row, component after component, the first of which are at `first`.
    pub(super) fn new(first: [i64; 2], [width, height]: [usize; 2], heights: &[i32]) -> Diagonals {
        let mut starts = vec![0];
        for sum in 0..width + height - 1 {
            let length = (width.min(sum + 1) - sum.saturating_sub(height - 1)).min(width);
            starts.push(starts[sum] + length);
        }
        let mut turned = vec![0; heights.len()];
        let components = heights.chunks_exact(width * height);
        for (own, turned) in components.zip(turned.chunks_exact_mut(width * height)) {
            for (row, own) in own.chunks_exact(width).enumerate() {
                for (column, &height_here) in own.iter().enumerate() {
                    let sum = row + column;
                    let place = column - sum.saturating_sub(height - 1);
                    turned[starts[sum] + place] = height_here;
                }
            }
        }
        Diagonals {
            first,
            height: height as i64,
            heights: turned,
            starts,
            range: extremes(heights),
        }
    }

    /// The heights of a component where column and row add up to `sum`, from one column to another, both
    /// included.
    pub(super) fn heights(&self, component: usize, sum: i64, columns: [i64; 2]) -> &[i32] {
        let count = self.starts[self.starts.len() - 1];
        let sum = sum - self.first[0] - self.first[1];
        let least = (sum - self.height + 1).max(0);
        let [start, end] = columns.map(|column| (column - self.first[0] - least) as usize);
        let own = component * count + self.starts[sum as usize];
        &self.heights[own + start..=own + end]
    }
}
