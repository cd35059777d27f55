//! Moving values from a refined parent to its children.

use super::diamond::Diamond;
use super::patch::Apex;
use super::planar::Lattice;

/// Copies the half of `child` whose apex is `parent`'s centre out of `parent`'s matrices.
///
/// `vertices` is the parent's (N+1)^2 matrix, `centres` its N^2 one, `target` the child's (N+1)^2.
pub fn gather_half<T: Copy>(
    lattice: &Lattice,
    parent: Diamond,
    (vertices, centres): (&[T], &[T]),
    child: Diamond,
    half: usize,
    target: &mut [T],
) {
    let cells = lattice.cells() as i64;
    let side = cells + 1;
    let apex = lattice.apexes(child)[half];
    let map = DoubledMap::new(lattice, parent, child, apex);
    for j in 0..side {
        let (first, last) = apex.row(cells, j);
        let walk = |start: i64| {
            let [u, v] = map.at(start, j);
            // Two steps of i stay on the same matrix, since both doubled indices keep their parity.
            let (source, width) = if u % 2 == 0 {
                (vertices, side)
            } else {
                (centres, cells)
            };
            let index = (v / 2) * width + u / 2;
            (source, index, map.ax[1] * width + map.ax[0])
        };
        // The second begins in the row only where that has two entries.
        let ((one, mut from, stride), (other, mut next, other_stride)) =
            (walk(first), walk(first + 1));
        let row = &mut target[(j * side + first) as usize..=(j * side + last) as usize];
        let (pairs, rest) = row.as_chunks_mut::<2>();
        for pair in pairs {
            *pair = [one[from as usize], other[next as usize]];
            from += stride;
            next += other_stride;
        }
        if let [value] = rest {
            *value = one[from as usize];
        }
    }
}

/// Fills the half of a half diamond that is not present by reflection across the hypotenuse.
pub fn reflect_absent_half<T: Copy>(cells: usize, absent: Apex, matrix: &mut [T]) {
    let side = cells + 1;
    for j in 0..side {
        let (first, last) = absent.row(cells as i64, j as i64);
        for i in first as usize..=last as usize {
            let (a, b) = absent.mirrored(cells, i, j);
            matrix[j * side + i] = matrix[b * side + a];
        }
    }
}

/// Fills the centres (N^2) of the half of a half diamond that is not present by reflection across the
/// hypotenuse.
pub fn reflect_absent_centres<T: Copy>(cells: usize, absent: Apex, matrix: &mut [T]) {
    for j in 0..cells {
        for i in (0..cells).filter(|&i| absent.holds_centre(cells, i, j)) {
            let (a, b) = match absent {
                Apex::Right | Apex::Bottom => (j, i),
                Apex::Origin | Apex::Far => (cells - 1 - j, cells - 1 - i),
            };
            matrix[j * cells + i] = matrix[b * cells + a];
        }
    }
}

/// The child's index grid in the doubled index grid of its parent, where vertices have even indices
/// and centres odd ones.
struct DoubledMap {
    origin: [i64; 2],
    ax: [i64; 2],
    ay: [i64; 2],
}

impl DoubledMap {
    fn new(lattice: &Lattice, parent: Diamond, child: Diamond, apex: Apex) -> DoubledMap {
        let cells = lattice.cells() as i64;
        let (ax, ay) = if parent.level().is_multiple_of(2) {
            ([1, -1], [1, 1])
        } else {
            ([1, 1], [-1, 1])
        };
        // The apex is the parent's centre, (N, N) when doubled.
        let (i, j) = apex.corner(lattice.cells());
        let (i, j) = (i as i64, j as i64);
        debug_assert!(lattice.contains(child));
        DoubledMap {
            origin: [cells - i * ax[0] - j * ay[0], cells - i * ax[1] - j * ay[1]],
            ax,
            ay,
        }
    }

    fn at(&self, i: i64, j: i64) -> [i64; 2] {
        [
            self.origin[0] + i * self.ax[0] + j * self.ay[0],
            self.origin[1] + i * self.ax[1] + j * self.ay[1],
        ]
    }
}
