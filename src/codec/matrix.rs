//! A square matrix of heights in units with the validity of each.

use crate::lattice::{Diamond, Lattice, gather_half, reflect_absent_half};

/// Heights at a diamond's vertices, (N+1)^2, or centres, N^2. Those that are not valid carry their own
/// prediction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Matrix {
    /// Heights in units, row by row.
    pub values: Box<[i32]>,
    /// 1 where the height is a sample's, 0 where it is void or outside; `None` when all are valid.
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

/// The vertex matrix of a diamond below the root, out of its parents' vertices and centres on its level
/// ([`Refined`](super::Refined)), in the order of [`Lattice::parents`]; an absent half is reflected.
pub fn child_vertices(
    lattice: &Lattice,
    child: Diamond,
    parents: [Option<(&Matrix, &Matrix)>; 2],
) -> Matrix {
    let side = lattice.cells() + 1;
    let mut values = vec![0; side * side].into_boxed_slice();
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
        let sources = (&vertices.values[..], &centres.values[..]);
        gather_half(lattice, parent, sources, child, half, &mut values);
        if let Some(valid) = &mut valid {
            let (v, c) = (mask_or_ones(vertices), mask_or_ones(centres));
            gather_half(lattice, parent, (&v, &c), child, half, valid);
        }
    }
    if let Some(absent) = ids.iter().position(|parent| parent.is_none()) {
        let apex = lattice.apexes(child)[absent];
        reflect_absent_half(lattice.cells(), apex, &mut values);
        if let Some(valid) = &mut valid {
            reflect_absent_half(lattice.cells(), apex, valid);
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

fn mask_or_ones(matrix: &Matrix) -> std::borrow::Cow<'_, [u8]> {
    match &matrix.valid {
        Some(valid) => valid.as_ref().into(),
        None => vec![1; matrix.values.len()].into(),
    }
}
