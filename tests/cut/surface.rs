//! The finest surface of a raster, triangle by triangle, as simply as it can be said.

use kimberlite::cut::{DiamondSource, Terrain};

/// Samples as triangles, in the world's heights.
pub struct Ground {
    pub size: [usize; 2],
    /// NaN where void.
    pub heights: Vec<f64>,
    cells_log2: u32,
}

/// Column, row, height.
pub type Corner = [f64; 3];

impl Ground {
    pub fn new(terrain: &Terrain, samples: &[f64]) -> Ground {
        let (lattice, info) = (terrain.lattice(), terrain.raster_info());
        let physical = |sample: &f64| info.value_offset + info.value_scale * sample;
        Ground {
            size: [lattice.width() as usize, lattice.height() as usize],
            heights: samples.iter().map(physical).collect(),
            cells_log2: lattice.cells_log2(),
        }
    }

    /// Both triangles of the cell from a sample to the next column and row; `None` where a corner is void.
    pub fn triangles(&self, cell: [usize; 2]) -> [Option<[Corner; 3]>; 2] {
        let blocks = (cell[0] >> self.cells_log2) + (cell[1] >> self.cells_log2);
        let is_main = blocks.is_multiple_of(2);
        let halves = match is_main {
            true => [[[0, 0], [1, 0], [1, 1]], [[0, 0], [0, 1], [1, 1]]],
            false => [[[0, 0], [1, 0], [0, 1]], [[1, 0], [0, 1], [1, 1]]],
        };
        halves.map(|half| {
            let corners = half.map(|[i, j]| {
                let (column, row) = (cell[0] + i, cell[1] + j);
                let height = self.heights[row * self.size[0] + column];
                [column as f64, row as f64, height]
            });
            corners
                .iter()
                .all(|corner| !corner[2].is_nan())
                .then_some(corners)
        })
    }

    /// Height at a column and row between samples; `None` in voids and outside.
    pub fn height(&self, [column, row]: [f64; 2]) -> Option<f64> {
        let last = self.size.map(|side| side as f64 - 1.0);
        if !(0.0..=last[0]).contains(&column) || !(0.0..=last[1]).contains(&row) {
            return None;
        }
        let cell = [
            column.min(last[0] - 1.0) as usize,
            row.min(last[1] - 1.0) as usize,
        ];
        let weights = |[a, b, c]: [Corner; 3]| {
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            let second = ((column - a[0]) * (c[1] - a[1]) - (row - a[1]) * (c[0] - a[0])) / area;
            let third = ((b[0] - a[0]) * (row - a[1]) - (b[1] - a[1]) * (column - a[0])) / area;
            [1.0 - second - third, second, third]
        };
        let mut triangles = self.triangles(cell).into_iter().flatten();
        triangles.find_map(|triangle| {
            let weights = weights(triangle);
            let is_in = weights.iter().all(|weight| *weight >= 0.0);
            is_in.then(|| {
                (0..3)
                    .map(|corner| weights[corner] * triangle[corner][2])
                    .sum()
            })
        })
    }

    /// Heights at a place and at some around it.
    pub fn heights_near(&self, [column, row]: [f64; 2], reach: f64) -> Vec<Option<f64>> {
        let offsets = [0.0, -reach, reach];
        let around = offsets
            .into_iter()
            .flat_map(|x| offsets.map(|y| [column + x, row + y]));
        around.map(|at| self.height(at)).collect()
    }
}
