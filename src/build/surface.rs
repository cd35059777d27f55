//! The stored error of each diamond: how far its own triangles are from the leaf surface.

use super::plane::Plane;
use crate::codec::Matrix;
use crate::lattice::{Diamond, Lattice};

/// The leaf level as decoded, in units, with the voids of the raster.
pub(super) struct LeafSurface<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) plane: &'a Plane,
    /// One height a sample, row by row, component after component; meaningless at voids.
    pub(super) heights: &'a [i32],
}

/// Where the samples of a diamond lie on the axes of its matrix: cells are `extent` wide, and sample
/// (column, row) has coordinates `u = extent * i`, `v = extent * j` at vertex (i, j).
struct Axes {
    origin: [i64; 2],
    turned: bool,
    extent: i64,
}

impl Axes {
    fn of(lattice: &Lattice, diamond: Diamond) -> Axes {
        let placement = lattice.placement(diamond);
        let turned = diamond.level() % 2 == 1;
        // On a turned square u = dx - dy and v = dx + dy, which advance by 2 a column of its diagonal.
        let extent = if turned {
            2 * placement.ax[0]
        } else {
            placement.ax[0]
        };
        Axes {
            origin: placement.origin,
            turned,
            extent,
        }
    }

    fn coordinates(&self, column: i64, row: i64) -> [i64; 2] {
        let (dx, dy) = (column - self.origin[0], row - self.origin[1]);
        if self.turned {
            [dx - dy, dx + dy]
        } else {
            [dx, dy]
        }
    }
}

impl LeafSurface<'_> {
    /// The largest |leaf height - height of the diamond's own triangles|, in units, over all components of
    /// all valid samples in the closed square; infinite where its triangles cover a void or leave ground bare.
    pub(super) fn error_of(&self, diamond: Diamond, vertices: &Matrix) -> f64 {
        let axes = Axes::of(self.lattice, diamond);
        let cells = self.lattice.cells();
        let own = vertices.values.chunks_exact((cells + 1) * (cells + 1));
        let triangles = own.map(|vertices| Triangles {
            vertices,
            cells: cells as i64,
            shift: axes.extent.trailing_zeros(),
            main: self.lattice.has_main_hypotenuse(diamond),
        });
        let heights = self.heights.chunks_exact(self.plane.count());
        let components: Vec<_> = triangles.zip(heights).collect();
        let (mut largest, mut any_void) = (0i64, false);
        for row in self.rows(diamond) {
            for column in self.columns(diamond, row) {
                if self.plane.void_samples > 0 && self.plane.is_void([column, row]) {
                    any_void = true;
                    continue;
                }
                let index = self.plane.index([column, row]);
                let [u, v] = axes.coordinates(column, row);
                for (triangles, heights) in &components {
                    let difference = triangles.scaled_difference(u, v, heights[index]);
                    largest = largest.max(difference.abs());
                }
            }
        }
        if any_void {
            let has_surface = self.draws_any(diamond, vertices) || self.has_ground(diamond);
            return if has_surface { f64::INFINITY } else { 0.0 };
        }
        largest as f64 / axes.extent as f64
    }

    /// Rows of the raster that the closed square meets.
    fn rows(&self, diamond: Diamond) -> std::ops::RangeInclusive<i64> {
        let [_, low] = self.corner(diamond, -1);
        let [_, high] = self.corner(diamond, 1);
        low.max(0)..=high.min(self.plane.height as i64 - 1)
    }

    /// Columns of the raster in the closed square at `row`.
    fn columns(&self, diamond: Diamond, row: i64) -> std::ops::RangeInclusive<i64> {
        let ([left, top], [right, bottom]) = (self.corner(diamond, -1), self.corner(diamond, 1));
        // A turned square narrows by one column a row from its middle.
        let inset = if diamond.level() % 2 == 1 {
            (2 * row - top - bottom).abs() / 2
        } else {
            0
        };
        (left + inset).max(0)..=(right - inset).min(self.plane.width as i64 - 1)
    }

    /// A corner of the diamond's axis-aligned box, in samples.
    fn corner(&self, diamond: Diamond, sign: i64) -> [i64; 2] {
        let placement = self.lattice.placement(diamond);
        let cells = self.lattice.cells();
        let ends = [placement.vertex(0, 0), placement.vertex(cells, cells)];
        let centre = [(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2];
        let half = (ends[1][0] - ends[0][0]) / 2;
        [centre[0] + sign * half, centre[1] + sign * half]
    }

    /// Whether any triangle of the diamond is drawn.
    fn draws_any(&self, diamond: Diamond, vertices: &Matrix) -> bool {
        if vertices.valid.is_none() {
            return true;
        }
        let (placement, cells) = (self.lattice.placement(diamond), self.lattice.cells());
        let main = self.lattice.has_main_hypotenuse(diamond);
        (0..cells * cells).any(|index| {
            let (i, j) = (index % cells, index / cells);
            split([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], main)
                .into_iter()
                .any(|triangle| {
                    let places = triangle.map(|[i, j]| placement.vertex(i, j));
                    let valid = triangle.map(|[i, j]| vertices.is_valid(j * (cells + 1) + i));
                    self.lattice.draws(false, places, valid)
                })
        })
    }

    /// Whether any leaf triangle with three valid vertices lies in the closed square.
    fn has_ground(&self, diamond: Diamond) -> bool {
        let shift = self.lattice.cells_log2();
        let inside = |[column, row]: [i64; 2]| {
            self.rows(diamond).contains(&row) && self.columns(diamond, row).contains(&column)
        };
        let drawn = |triangle: [[i64; 2]; 3]| {
            triangle
                .into_iter()
                .all(|at| inside(at) && !self.plane.is_void(at))
        };
        self.rows(diamond).any(|row| {
            self.columns(diamond, row).any(|column| {
                // Around a sample of the square: the cells to the right, above and below.
                [(column, row), (column, row - 1)]
                    .into_iter()
                    .any(|(x, y)| {
                        let [a, b, c, d] = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
                        let main = ((x >> shift) + (y >> shift)) % 2 == 0;
                        let pair = if main {
                            [[a, b, c], [a, c, d]]
                        } else {
                            [[a, b, d], [b, c, d]]
                        };
                        pair.into_iter().any(drawn)
                    })
            })
        })
    }
}

/// A cell's two triangles, its corners given around it; `main` cells are split from the first to the third.
fn split<T: Copy>([a, b, c, d]: [T; 4], main: bool) -> [[T; 3]; 2] {
    if main {
        [[a, b, c], [a, c, d]]
    } else {
        [[a, b, d], [b, c, d]]
    }
}

/// The two halves of a diamond as a piecewise linear surface over (u, v).
struct Triangles<'a> {
    vertices: &'a [i32],
    cells: i64,
    /// log2 of the extent of a cell.
    shift: u32,
    /// Cells are split from (0, 0) to (1, 1), else from (1, 0) to (0, 1).
    main: bool,
}

impl Triangles<'_> {
    /// `extent * (height - surface at (u, v))`, exact.
    #[inline]
    fn scaled_difference(&self, u: i64, v: i64, height: i32) -> i64 {
        let extent = 1i64 << self.shift;
        let (i, j) = (
            (u >> self.shift).min(self.cells - 1),
            (v >> self.shift).min(self.cells - 1),
        );
        let (a, b) = (u - (i << self.shift), v - (j << self.shift));
        let index = (j * (self.cells + 1) + i) as usize;
        let below = index + self.cells as usize + 1;
        let at = |index: usize| i64::from(self.vertices[index]);
        let [v00, v10, v01, v11] = [at(index), at(index + 1), at(below), at(below + 1)];
        let scaled = if self.main {
            if a >= b {
                extent * v00 + a * (v10 - v00) + b * (v11 - v10)
            } else {
                extent * v00 + b * (v01 - v00) + a * (v11 - v01)
            }
        } else if a + b <= extent {
            extent * v00 + a * (v10 - v00) + b * (v01 - v00)
        } else {
            extent * v11 + (extent - a) * (v01 - v11) + (extent - b) * (v10 - v11)
        };
        extent * i64::from(height) - scaled
    }
}
