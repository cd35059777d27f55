//! The stored error of each diamond: how far its own triangles are from the leaf surface.

use super::leaf::Tile;
use crate::codec::Matrix;
use crate::lattice::{Diamond, Lattice};
use crate::vectors::widened;

/// What part of the leaf surface shows of a diamond.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Finding {
    /// The largest |leaf height - height of the diamond's own triangles|, in units, over all components.
    distance: f64,
    any_void: bool,
    /// Triangles of the diamond, or of the leaf level in its square, are drawn.
    any_surface: bool,
}

impl Finding {
    /// Of a part without voids.
    pub(super) fn of_distance(distance: f64) -> Finding {
        Finding {
            distance,
            any_surface: true,
            any_void: false,
        }
    }

    /// Takes in what another part shows.
    pub(super) fn merge(&mut self, other: Finding) {
        self.distance = self.distance.max(other.distance);
        self.any_void |= other.any_void;
        self.any_surface |= other.any_surface;
    }

    /// Whether the part shows a void.
    pub(super) fn shows_void(&self) -> bool {
        self.any_void
    }

    /// The error: infinite where the diamond's triangles cover a void or leave ground bare.
    pub(super) fn error(&self) -> f64 {
        match (self.any_void, self.any_surface) {
            (true, true) => f64::INFINITY,
            (true, false) => 0.0,
            (false, _) => self.distance,
        }
    }
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
        Axes {
            origin: lattice.placement(diamond).origin,
            turned: diamond.level() % 2 == 1,
            extent: extent_of(lattice, diamond),
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

/// The longest side of a diamond's triangles along columns and rows, in samples.
pub(super) fn extent_of(lattice: &Lattice, diamond: Diamond) -> i64 {
    // On a turned square u = dx - dy and v = dx + dy, which advance by 2 a column of its diagonal.
    let turns = 1 + i64::from(diamond.level() % 2 == 1);
    turns * lattice.placement(diamond).ax[0]
}

/// A diamond over a part of the leaf level.
struct Place<'a> {
    lattice: &'a Lattice,
    diamond: Diamond,
    tile: &'a Tile,
    /// The least and greatest column and row of the diamond's box.
    corners: [[i64; 2]; 2],
}

/// The least and greatest column and row of a diamond's square.
pub(super) fn box_of(lattice: &Lattice, diamond: Diamond) -> [[i64; 2]; 2] {
    let (placement, cells) = (lattice.placement(diamond), lattice.cells());
    let ends = [placement.vertex(0, 0), placement.vertex(cells, cells)];
    let centre = [0, 1].map(|axis| (ends[0][axis] + ends[1][axis]) / 2);
    let half = (ends[1][0] - ends[0][0]) / 2;
    [-half, half].map(|offset| centre.map(|middle| middle + offset))
}

/// The largest distance between the triangles of a diamond and those of these points that lie over it.
pub(super) fn distance_to(
    lattice: &Lattice,
    (diamond, vertices): (Diamond, &Matrix),
    points: impl Iterator<Item = ([i64; 2], i32)>,
) -> f64 {
    let axes = Axes::of(lattice, diamond);
    let triangles = Triangles::of(lattice, diamond, &axes, &vertices.values);
    let inside = 0..=axes.extent * lattice.cells() as i64;
    let mut largest = 0;
    for ([column, row], height) in points {
        let [u, v] = axes.coordinates(column, row);
        if inside.contains(&u) && inside.contains(&v) {
            let surface = triangles.segment(u, v).start;
            largest = largest.max((axes.extent * i64::from(height) - surface).abs());
        }
    }
    largest as f64 / axes.extent as f64
}

/// What a tile shows of a diamond with these vertices; `has_voids` says whether any tile has.
pub(super) fn look_at(
    lattice: &Lattice,
    diamond: Diamond,
    vertices: &Matrix,
    tile: &Tile,
    has_voids: bool,
) -> Finding {
    let axes = Axes::of(lattice, diamond);
    let cells = lattice.cells();
    let own = vertices.values.chunks_exact((cells + 1) * (cells + 1));
    let triangles = own.map(|vertices| Triangles::of(lattice, diamond, &axes, vertices));
    let place = Place::new(lattice, diamond, tile);
    let (mut largest, mut any_void) = (0i64, false);
    for (component, triangles) in triangles.enumerate() {
        for row in place.rows() {
            let columns = place.columns(row);
            if columns.is_empty() {
                continue;
            }
            let (first, last) = (*columns.start(), *columns.end());
            if tile.any_void && columns.clone().any(|column| tile.is_void([column, row])) {
                any_void = true;
                continue;
            }
            let heights = tile.heights(component, row, [first, last]);
            let [u, v] = axes.coordinates(first, row);
            largest = largest.max(greatest_difference(&triangles, u, v, heights));
        }
    }
    Finding {
        distance: largest as f64 / axes.extent as f64,
        any_void,
        any_surface: any_void && draws_any(lattice, diamond, vertices)
            || has_voids && place.has_ground(),
    }
}

/// Whether any triangle of the diamond is drawn.
fn draws_any(lattice: &Lattice, diamond: Diamond, vertices: &Matrix) -> bool {
    if vertices.valid.is_none() {
        return true;
    }
    let (placement, cells) = (lattice.placement(diamond), lattice.cells());
    let main = lattice.has_main_hypotenuse(diamond);
    (0..cells * cells).any(|index| {
        let (i, j) = (index % cells, index / cells);
        split([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], main)
            .into_iter()
            .any(|triangle| {
                let places = triangle.map(|[i, j]| placement.vertex(i, j));
                let valid = triangle.map(|[i, j]| vertices.is_valid(j * (cells + 1) + i));
                lattice.draws(false, places, valid)
            })
    })
}

impl<'a> Place<'a> {
    fn new(lattice: &'a Lattice, diamond: Diamond, tile: &'a Tile) -> Place<'a> {
        Place {
            lattice,
            diamond,
            tile,
            corners: box_of(lattice, diamond),
        }
    }

    /// Rows of the tile that the closed square meets.
    fn rows(&self) -> std::ops::RangeInclusive<i64> {
        let [low, high] = self.corners;
        low[1].max(self.tile.first[1])..=high[1].min(self.tile.last[1])
    }

    /// Columns of the tile in the closed square at `row`.
    fn columns(&self, row: i64) -> std::ops::RangeInclusive<i64> {
        let [[left, top], [right, bottom]] = self.corners;
        // A turned square narrows by one column a row from its middle.
        let inset = if self.diamond.level() % 2 == 1 {
            (2 * row - top - bottom).abs() / 2
        } else {
            0
        };
        (left + inset).max(self.tile.first[0])..=(right - inset).min(self.tile.last[0])
    }

    /// Whether any leaf triangle with three valid vertices lies in the closed square and the tile.
    fn has_ground(&self) -> bool {
        let shift = self.lattice.cells_log2();
        let inside = |[column, row]: [i64; 2]| {
            self.rows().contains(&row) && self.columns(row).contains(&column)
        };
        let drawn = |triangle: [[i64; 2]; 3]| {
            triangle
                .into_iter()
                .all(|at| inside(at) && !self.tile.is_void(at))
        };
        self.rows().any(|row| {
            self.columns(row).any(|column| {
                // Around a sample of the square: the cells to the right, above and below.
                [(column, row), (column, row - 1)]
                    .into_iter()
                    .any(|(x, y)| {
                        let main = ((x >> shift) + (y >> shift)) % 2 == 0;
                        split([[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]], main)
                            .into_iter()
                            .any(drawn)
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

/// Largest extent of a cell whose samples are taken period by period.
const LONGEST_PERIOD: usize = 8;

/// The two halves of a diamond as a piecewise linear surface over (u, v).
struct Triangles<'a> {
    vertices: &'a [i32],
    cells: i64,
    /// log2 of the extent of a cell.
    shift: u32,
    /// Cells are split from (0, 0) to (1, 1), else from (1, 0) to (0, 1).
    main: bool,
    /// What (u, v) grows by from one sample of a row to the next.
    step: [i64; 2],
}

/// A surface along a row of samples that one triangle covers: `start + k * slope` at the k-th, times the extent.
struct Segment {
    start: i64,
    slope: i64,
    count: usize,
}

widened! {
    /// The largest `extent * |height - surface|` in a row of samples that begins at (u, v), exact.
    fn greatest_difference(triangles: &Triangles<'_>, u: i64, v: i64, heights: &[i32]) -> i64 {
        if 1 << triangles.shift <= LONGEST_PERIOD {
            triangles.greatest_by_period(u, v, heights)
        } else {
            triangles.greatest_by_segment(u, v, heights)
        }
    }
}

impl<'a> Triangles<'a> {
    /// The surface of a diamond with these vertices, (N+1)^2.
    fn of(lattice: &Lattice, diamond: Diamond, axes: &Axes, vertices: &'a [i32]) -> Triangles<'a> {
        Triangles {
            vertices,
            cells: lattice.cells() as i64,
            shift: axes.extent.trailing_zeros(),
            main: lattice.has_main_hypotenuse(diamond),
            step: [1, i64::from(axes.turned)],
        }
    }

    /// Samples one extent apart lie alike in their cells, so that they have the same weights.
    #[inline(always)]
    fn greatest_by_period(&self, u: i64, v: i64, heights: &[i32]) -> i64 {
        let extent = 1usize << self.shift;
        let side = self.cells as usize + 1;
        let advance = self.step[0] as usize + self.step[1] as usize * side;
        let mut largest = 0;
        for first in 0..extent.min(heights.len()) {
            let (u, v) = (u + first as i64, v + first as i64 * self.step[1]);
            let mut cell = (v >> self.shift) as usize * side + (u >> self.shift) as usize;
            let [(at_p, p), (at_q, q), (at_r, r)] = self.weights(u, v);
            for &height in heights[first..].iter().step_by(extent) {
                let at = |offset: usize| i64::from(self.vertices[cell + offset]);
                let surface = p * at(at_p) + q * at(at_q) + r * at(at_r);
                largest = largest.max(((i64::from(height) << self.shift) - surface).abs());
                cell += advance;
            }
        }
        largest
    }

    /// The vertices, as offsets from that of the cell's origin, of the triangle around (u, v), with their
    /// weights, which add up to the extent. A vertex without weight may not exist; the origin is told instead.
    fn weights(&self, u: i64, v: i64) -> [(usize, i64); 3] {
        let extent = 1i64 << self.shift;
        let (a, b) = (u & (extent - 1), v & (extent - 1));
        let side = self.cells as usize + 1;
        let [v00, v10, v01, v11] = [0, 1, side, side + 1];
        let weights = if self.main && a >= b {
            [(v00, extent - a), (v10, a - b), (v11, b)]
        } else if self.main {
            [(v00, extent - b), (v01, b - a), (v11, a)]
        } else if a + b <= extent {
            [(v00, extent - a - b), (v10, a), (v01, b)]
        } else {
            [(v11, a + b - extent), (v01, extent - a), (v10, extent - b)]
        };
        weights.map(|(offset, weight)| (if weight == 0 { 0 } else { offset }, weight))
    }

    /// Samples in the same triangle follow each other.
    #[inline(always)]
    fn greatest_by_segment(&self, mut u: i64, mut v: i64, mut heights: &[i32]) -> i64 {
        let mut largest = 0;
        while !heights.is_empty() {
            let segment = self.segment(u, v);
            let count = segment.count.min(heights.len());
            let mut surface = segment.start;
            for &height in &heights[..count] {
                largest = largest.max(((i64::from(height) << self.shift) - surface).abs());
                surface += segment.slope;
            }
            u += count as i64 * self.step[0];
            v += count as i64 * self.step[1];
            heights = &heights[count..];
        }
        largest
    }

    /// The surface from (u, v) on.
    #[inline]
    fn segment(&self, u: i64, v: i64) -> Segment {
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
        // To the cell's end, and to where its two triangles meet.
        let to_end = match self.step {
            [_, 0] => extent - a,
            _ => extent - a.max(b),
        };
        let (start, along, across, left) = if self.main && a >= b {
            let (along, across) = (v10 - v00, v11 - v10);
            (extent * v00 + a * along + b * across, along, across, to_end)
        } else if self.main {
            let (along, across) = (v11 - v01, v01 - v00);
            let left = if self.step[1] == 0 { b - a } else { to_end };
            (extent * v00 + b * across + a * along, along, across, left)
        } else if a + b <= extent {
            let (along, across) = (v10 - v00, v01 - v00);
            let left = (extent - a - b) >> self.step[1];
            (extent * v00 + a * along + b * across, along, across, left)
        } else {
            let (along, across) = (v11 - v01, v11 - v10);
            let start = extent * v11 - (extent - a) * along - (extent - b) * across;
            (start, along, across, to_end)
        };
        Segment {
            start,
            slope: along + self.step[1] * across,
            count: left as usize + 1,
        }
    }
}
