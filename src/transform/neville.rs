//! Neville predictors on the quincunx lattice (Kovacevic and Sweldens 2000).

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

/// Sum of columns i and i + 1 of two rows.
#[inline(always)]
fn nearest(a: &[i32], b: &[i32], i: usize) -> i64 {
    wide(a[i]) + wide(a[i + 1]) + wide(b[i]) + wide(b[i + 1])
}

#[inline(always)]
fn wide(value: i32) -> i64 {
    i64::from(value)
}
