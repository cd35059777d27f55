//! A square matrix of heights, or of the components of colours, in units, with the validity of each entry.

use crate::lattice::{Diamond, Lattice, gather_half, reflect_absent_half};

/// Heights at a diamond's vertices, (N+1)^2, or centres, N^2; or colours, whose components follow each other,
/// as many entries each. Those that are not valid carry their own prediction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Matrix {
    /// Heights in units, row by row, or all of the first component and then those of the next.
    pub values: Box<[i32]>,
    /// For each entry of one component 1 where it is a sample's, 0 where it is void or outside; `None` when
    /// all are valid.
    pub valid: Option<Box<[u8]>>,
}

impl Matrix {
    /// A matrix with an explicit mask, which is dropped when it says nothing.
    pub fn new(values: Box<[i32]>, valid: Box<[u8]>) -> Matrix {
        let all = valid.iter().all(|&entry| entry != 0);
        Matrix {
            values,
            valid: if all { None } else { Some(valid) },
        }
    }

    /// Whether the entry is a sample's height.
    pub fn is_valid(&self, index: usize) -> bool {
        self.valid.as_ref().is_none_or(|valid| valid[index] != 0)
    }

    /// Whether any entry is a sample's height.
    pub fn any_valid(&self) -> bool {
        self.valid
            .as_ref()
            .is_none_or(|valid| valid.iter().any(|&entry| entry != 0))
    }
}

/// A matrix that lies elsewhere.
#[derive(Clone, Copy, Debug)]
pub struct MatrixView<'a> {
    /// As [`Matrix::values`].
    pub values: &'a [i32],
    /// As [`Matrix::valid`].
    pub valid: Option<&'a [u8]>,
}

impl<'a> From<&'a Matrix> for MatrixView<'a> {
    fn from(matrix: &'a Matrix) -> MatrixView<'a> {
        MatrixView {
            values: &matrix.values,
            valid: matrix.valid.as_deref(),
        }
    }
}

/// The vertex matrix of a diamond below the root, out of its parents' vertices and centres on its level
/// ([`Refined`](super::Refined)), in the order of [`Lattice::parents`]; an absent half is reflected.
pub fn child_vertices<'a, M: Into<MatrixView<'a>>>(
    lattice: &Lattice,
    child: Diamond,
    parents: [Option<(M, M)>; 2],
) -> Matrix {
    let parents: [Option<(MatrixView, MatrixView)>; 2] =
        parents.map(|both| both.map(|(vertices, centres)| (vertices.into(), centres.into())));
    let (cells, side) = (lattice.cells(), lattice.cells() + 1);
    let count = |matrix: &MatrixView| matrix.values.len() / (side * side);
    let components = parents.iter().flatten().map(|(v, _)| count(v)).max();
    let mut values = vec![0; components.unwrap_or(1) * side * side].into_boxed_slice();
    let masked = parents
        .iter()
        .flatten()
        .any(|(v, c)| v.valid.is_some() || c.valid.is_some());
    let mut valid = masked.then(|| vec![1u8; side * side].into_boxed_slice());
    let ids = lattice.parents(child);
    for half in 0..2 {
        let (Some(parent), Some((vertices, centres))) = (ids[half], parents[half]) else {
            continue;
        };
        let own = vertices.values.chunks_exact(side * side);
        let sources = own.zip(centres.values.chunks_exact(cells * cells));
        for (sources, values) in sources.zip(values.chunks_exact_mut(side * side)) {
            gather_half(lattice, parent, sources, child, half, values);
        }
        if let Some(valid) = &mut valid {
            let v = mask_or_ones(vertices, side * side);
            let c = mask_or_ones(centres, cells * cells);
            gather_half(lattice, parent, (&v, &c), child, half, valid);
        }
    }
    if let Some(absent) = ids.iter().position(|parent| parent.is_none()) {
        let apex = lattice.apexes(child)[absent];
        for values in values.chunks_exact_mut(side * side) {
            reflect_absent_half(cells, apex, values);
        }
        if let Some(valid) = &mut valid {
            reflect_absent_half(cells, apex, valid);
        }
    }
    match valid {
        Some(valid) => Matrix::new(values, valid),
        None => Matrix {
            values,
            valid: None,
        },
    }
}

fn mask_or_ones(matrix: MatrixView, length: usize) -> std::borrow::Cow<[u8]> {
    match matrix.valid {
        Some(valid) => valid.into(),
        None => vec![1; length].into(),
    }
}
