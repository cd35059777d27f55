//! Neville predictors on the quincunx lattice (Kovacevic and Sweldens 2000).

use std::ops::Range;

/// Predicts all N^2 centres of a diamond from its (N+1)^2 vertices.
///
/// Order 4, `(10 * sum of the 4 nearest - sum of the 8 next nearest + 16) >> 5`, where its 12 points lie
/// inside the matrix; order 2, `(sum of the 4 nearest + 2) >> 2`, along the border; both clamped to
/// `[minimum, maximum]`.
pub fn predict(
    cells: usize,
    vertices: &[i32],
    minimum: i32,
    maximum: i32,
    predictions: &mut [i32],
) {
    let side = cells + 1;
    let (low, high) = (i64::from(minimum), i64::from(maximum));
    let row = |j: usize| &vertices[j * side..(j + 1) * side];
    for (j, output) in predictions.chunks_exact_mut(cells).enumerate() {
        let (near, far) = (row(j), row(j + 1));
        for (i, prediction) in output.iter_mut().enumerate() {
            let sum = nearest(near, far, i);
            *prediction = ((sum + 2) >> 2).clamp(low, high) as i32;
        }
        if j == 0 || j + 1 == cells {
            continue;
        }
        let (before, after) = (row(j - 1), row(j + 2));
        for i in 1..cells - 1 {
            let eight = wide(near[i - 1])
                + wide(far[i - 1])
                + wide(near[i + 2])
                + wide(far[i + 2])
                + nearest(before, after, i);
            let value = (10 * nearest(near, far, i) - eight + 16) >> 5;
            output[i] = value.clamp(low, high) as i32;
        }
    }
}

/// Corrects predictions by [`predict`] at the centres that `at` names, where not all 12 or 4 points are valid
/// (not 0 in `valid`, (N+1)^2): the mean of the valid ones of the 4 nearest, else of all valid vertices of
/// the diamond, else 0. Means are rounded to the nearest, halves up.
pub(super) fn repredict_from_valid(
    cells: usize,
    vertices: &[i32],
    valid: &[u8],
    at: impl Fn(usize) -> bool,
    predictions: &mut [i32],
) {
    let side = cells + 1;
    let are_valid = |columns: Range<usize>, rows: Range<usize>| {
        rows.into_iter()
            .all(|j| !valid[j * side + columns.start..j * side + columns.end].contains(&0))
    };
    let mean = |places: &mut dyn Iterator<Item = usize>| {
        let (mut sum, mut count) = (0, 0);
        for place in places.filter(|&place| valid[place] != 0) {
            sum += wide(vertices[place]);
            count += 1;
        }
        (count > 0).then(|| (2 * sum + count).div_euclid(2 * count) as i32)
    };
    let mut mean_of_all = None;
    for (index, prediction) in predictions
        .iter_mut()
        .enumerate()
        .filter(|&(index, _)| at(index))
    {
        let (i, j) = (index % cells, index / cells);
        let is_wide = (1..cells - 1).contains(&i) && (1..cells - 1).contains(&j);
        // The 12 points are two crossed rectangles of 2 x 4.
        let is_supported = if is_wide {
            are_valid(i - 1..i + 3, j..j + 2) && are_valid(i..i + 2, j - 1..j + 3)
        } else {
            are_valid(i..i + 2, j..j + 2)
        };
        if is_supported {
            continue;
        }
        let first = j * side + i;
        let mut nearest = [first, first + 1, first + side, first + side + 1].into_iter();
        *prediction = mean(&mut nearest).unwrap_or_else(|| {
            *mean_of_all.get_or_insert_with(|| mean(&mut (0..side * side)).unwrap_or(0))
        });
    }
}

/// Sum of columns i and i + 1 of two rows.
#[inline(always)]
fn nearest(a: &[i32], b: &[i32], i: usize) -> i64 {
    wide(a[i]) + wide(a[i + 1]) + wide(b[i]) + wide(b[i + 1])
}

#[inline(always)]
fn wide(value: i32) -> i64 {
    i64::from(value)
}
