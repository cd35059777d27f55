//! Where vertices came from, for shaders that blend between levels.

use crate::lattice::{Diamond, Lattice};

/// The height, above a cut's base in units, of the middle of the edge that a vertex divided when it came, and the level of the
/// diamonds that first had it. The same in all patches that share the vertex, so that what is blended by it and by the
/// vertex's place has no cracks.
pub(super) type Birth = [f32; 2];

/// Of the centres of a diamond that is refined, given the heights of its vertices.
pub(super) fn births_of_centres(
    lattice: &Lattice,
    diamond: Diamond,
    vertices: &[i32],
    base: i32,
    births: &mut [Birth],
) {
    let (cells, side) = (lattice.cells(), lattice.cells() + 1);
    let level = (diamond.level() + 1) as f32;
    let ends = match lattice.has_main_hypotenuse(diamond) {
        true => [0, side + 1],
        false => [1, side],
    };
    for (j, births) in births.chunks_exact_mut(cells).enumerate() {
        for (i, birth) in births.iter_mut().enumerate() {
            let [a, b] = ends.map(|end| i64::from(vertices[j * side + i + end]));
            *birth = [(a + b - 2 * i64::from(base)) as f32 / 2.0, level];
        }
    }
}
