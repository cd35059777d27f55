//! The triangles in and around a block, by its own coordinates.

use super::scene::Scene;
use glam::Vec3;

/// Cells that a triangle may lie in, in the mean, and entries that any grid may have.
const CELLS_OF_A_TRIANGLE: usize = 8;
const LEAST_ENTRIES: usize = 1 << 20;

/// Triangles of a scene by the squares of a grid that they lie in or touch.
pub struct Grid {
    corner: [f64; 2],
    cell: f64,
    size: [usize; 2],
    /// The triangles of each cell, row by row, one after the other.
    numbers: Vec<u32>,
    /// Where each cell's begin; one more at the end.
    starts: Vec<usize>,
}

/// A triangle relative to the middle of its block.
#[derive(Clone, Copy)]
pub struct Local {
    /// In metres: x and y from the block's middle, z from the base.
    pub corners: [Vec3; 3],
    /// Unit, or 0 without an area.
    pub normal: Vec3,
    /// Into the scene's triangles.
    pub number: u32,
}

impl Grid {
    /// Of all triangles, in square cells over a rectangle that may be smaller than the scene.
    pub fn new(scene: &Scene, corner: [f64; 2], cell: f64, size: [usize; 2]) -> Grid {
        let boxes: Vec<_> = scene
            .triangles
            .iter()
            .map(|triangle| bounds(&triangle.corners))
            .collect();
        Grid::of_boxes(&boxes, corner, cell, size)
    }

    /// Over a square, in at most 2^`levels` cells along it: fewer where large triangles lie in very many cells.
    pub fn over_square(scene: &Scene, (corner, side): ([f64; 2], f64), levels: u32) -> Grid {
        let triangles = scene.triangles.iter();
        let boxes: Vec<_> = triangles
            .map(|triangle| bounds(&triangle.corners))
            .collect();
        let mut cells = 1usize << levels;
        let most = CELLS_OF_A_TRIANGLE * boxes.len() + LEAST_ENTRIES;
        loop {
            let empty = Grid::empty(corner, side / cells as f64, [cells, cells]);
            let entries = boxes.iter().map(|bounds| {
                let [columns, rows] = empty.cells(*bounds);
                columns.len() * rows.len()
            });
            if cells == 1 || entries.sum::<usize>() <= most {
                return Grid::of_boxes(&boxes, corner, side / cells as f64, [cells, cells]);
            }
            cells /= 2;
        }
    }

    fn empty(corner: [f64; 2], cell: f64, size: [usize; 2]) -> Grid {
        Grid {
            corner,
            cell,
            size,
            numbers: Vec::new(),
            starts: Vec::new(),
        }
    }

    fn of_boxes(boxes: &[[[f64; 2]; 2]], corner: [f64; 2], cell: f64, size: [usize; 2]) -> Grid {
        let mut grid = Grid::empty(corner, cell, size);
        grid.starts = vec![0; size[0] * size[1] + 1];
        for bounds in boxes {
            grid.for_cells(*bounds, |cell, starts, _| starts[cell + 1] += 1);
        }
        for cell in 0..size[0] * size[1] {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        grid.numbers = vec![0; grid.starts[size[0] * size[1]]];
        let mut next = grid.starts.clone();
        for (number, bounds) in boxes.iter().enumerate() {
            grid.for_cells(*bounds, |cell, _, numbers| {
                numbers[next[cell]] = number as u32;
                next[cell] += 1;
            });
        }
        grid
    }

    fn for_cells(
        &mut self,
        bounds: [[f64; 2]; 2],
        mut visit: impl FnMut(usize, &mut [usize], &mut [u32]),
    ) {
        let [columns, rows] = self.cells(bounds);
        for row in rows {
            for column in columns.clone() {
                visit(
                    row * self.size[0] + column,
                    &mut self.starts,
                    &mut self.numbers,
                );
            }
        }
    }

    /// Columns and rows of the cells that a box touches.
    fn cells(&self, [low, high]: [[f64; 2]; 2]) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|axis| {
            let place = |at: f64| (at - self.corner[axis]) / self.cell;
            let end = self.size[axis] as f64;
            let first = place(low[axis]).floor().clamp(0.0, end);
            let last = (place(high[axis]).floor() + 1.0).clamp(first, end);
            first as usize..last as usize
        })
    }

    /// The triangles that touch a box, in ascending order, each once.
    pub fn touching(&self, scene: &Scene, low: [f64; 2], high: [f64; 2]) -> Vec<u32> {
        let [columns, rows] = self.cells([low, high]);
        let mut found = Vec::new();
        for row in rows {
            let cells = row * self.size[0];
            let all = self.starts[cells + columns.start]..self.starts[cells + columns.end];
            found.extend(self.numbers[all].iter().copied().filter(|number| {
                let [least, most] = bounds(&scene.triangles[*number as usize].corners);
                (0..2).all(|axis| least[axis] <= high[axis] && most[axis] >= low[axis])
            }));
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

fn bounds(corners: &[[f64; 3]; 3]) -> [[f64; 2]; 2] {
    let fold = |pick: fn(f64, f64) -> f64| {
        [0, 1].map(|axis| pick(pick(corners[0][axis], corners[1][axis]), corners[2][axis]))
    };
    [fold(f64::min), fold(f64::max)]
}

/// A scene's triangles relative to a place.
pub fn local(scene: &Scene, numbers: &[u32], middle: [f64; 3]) -> Vec<Local> {
    let relative =
        |corner: [f64; 3]| Vec3::from([0, 1, 2].map(|axis| (corner[axis] - middle[axis]) as f32));
    numbers
        .iter()
        .map(|&number| {
            let triangle = &scene.triangles[number as usize];
            let normal = triangle.normal().unwrap_or([0.0; 3]);
            Local {
                corners: triangle.corners.map(relative),
                normal: Vec3::from(normal.map(|along| along as f32)),
                number,
            }
        })
        .collect()
}

impl Local {
    /// Distance along a ray to the triangle's plane, and the weights of its corners there; `None` for a ray beside it or
    /// along it.
    pub fn meet(&self, origin: Vec3, direction: Vec3) -> Option<(f32, [f32; 3])> {
        let [a, b, c] = self.corners;
        let (first, second) = (b - a, c - a);
        let across = direction.cross(second);
        let determinant = first.dot(across);
        if determinant == 0.0 {
            return None;
        }
        let from = origin - a;
        let one = from.dot(across) / determinant;
        let turned = from.cross(first);
        let two = direction.dot(turned) / determinant;
        let distance = second.dot(turned) / determinant;
        distance
            .is_finite()
            .then_some((distance, [1.0 - one - two, one, two]))
    }
}
