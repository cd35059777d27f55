//! The stored error of each diamond: how far its own triangles are from the leaf surface.

use super::crossings::greatest_distance;
use super::leaf::Tile;
use super::triangles::Surface;
use crate::codec::Matrix;
use crate::lattice::{Diamond, Lattice};

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

/// Where a sample is on the axes of a diamond's matrix: cells are an extent wide.
fn coordinates(lattice: &Lattice, diamond: Diamond, [column, row]: [i64; 2]) -> [i64; 2] {
    let origin = lattice.placement(diamond).origin;
    let (dx, dy) = (column - origin[0], row - origin[1]);
    if diamond.level() % 2 == 1 {
        [dx - dy, dx + dy]
    } else {
        [dx, dy]
    }
}

/// The largest distance between the triangles of a diamond and those of these points that lie over it.
pub(super) fn distance_to(
    lattice: &Lattice,
    (diamond, vertices): (Diamond, &Matrix),
    points: impl Iterator<Item = ([i64; 2], i32)>,
) -> f64 {
    let (cells, extent) = (lattice.cells(), extent_of(lattice, diamond));
    let main = lattice.has_main_hypotenuse(diamond);
    let surface = Surface::new(&vertices.values, cells, extent, main);
    let inside = 0..=extent * cells as i64;
    let mut largest = 0;
    for (at, height) in points {
        let at = coordinates(lattice, diamond, at);
        if at.iter().all(|along| inside.contains(along)) {
            largest = largest.max((extent * i64::from(height) - surface.at(at)).abs());
        }
    }
    largest as f64 / extent as f64
}

/// What a tile shows of a diamond with these vertices; `has_voids` says whether any tile has.
pub(super) fn look_at(
    lattice: &Lattice,
    diamond: Diamond,
    vertices: &Matrix,
    tile: &Tile,
    has_voids: bool,
) -> Finding {
    let (cells, extent) = (lattice.cells(), extent_of(lattice, diamond));
    let place = Place::new(lattice, diamond, tile);
    let (mut largest, mut any_void, mut crossings) = (0i64, false, 0f64);
    let own = vertices.values.chunks_exact((cells + 1) * (cells + 1));
    for (component, vertices) in own.enumerate() {
        let mut surface = Surface::new(
            vertices,
            cells,
            extent,
            lattice.has_main_hypotenuse(diamond),
        );
        surface.fit(tile.diagonals().range);
        for line in place.lines() {
            if tile.any_void && line.places().any(|at| tile.is_void(at)) {
                any_void = true;
                continue;
            }
            let heights = line.heights(tile, component);
            let [u, v] = coordinates(lattice, diamond, line.first());
            largest = largest.max(surface.greatest_difference([u, v], line.step(), heights));
        }
        let part = (tile, component);
        crossings = crossings.max(greatest_distance(lattice, diamond, vertices, part));
    }
    Finding {
        distance: crossings.max(largest as f64 / extent as f64),
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

/// Samples of a tile that follow each other along the u of a diamond.
enum Line {
    Row {
        row: i64,
        columns: [i64; 2],
    },
    /// Where column and row have this sum.
    Diagonal {
        sum: i64,
        columns: [i64; 2],
    },
}

impl Line {
    fn columns(&self) -> [i64; 2] {
        match self {
            Line::Row { columns, .. } | Line::Diagonal { columns, .. } => *columns,
        }
    }

    fn place(&self, column: i64) -> [i64; 2] {
        match self {
            Line::Row { row, .. } => [column, *row],
            Line::Diagonal { sum, .. } => [column, sum - column],
        }
    }

    fn first(&self) -> [i64; 2] {
        self.place(self.columns()[0])
    }

    fn places(&self) -> impl Iterator<Item = [i64; 2]> + '_ {
        let [first, last] = self.columns();
        (first..=last).map(|column| self.place(column))
    }

    /// What u grows by from one sample to the next.
    fn step(&self) -> i64 {
        match self {
            Line::Row { .. } => 1,
            Line::Diagonal { .. } => 2,
        }
    }

    fn heights<'t>(&self, tile: &'t Tile, component: usize) -> &'t [i32] {
        match *self {
            Line::Row { row, columns } => tile.heights(component, row, columns),
            Line::Diagonal { sum, columns } => tile.diagonals().heights(component, sum, columns),
        }
    }
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

    /// All samples of the tile in the closed square, v by v.
    fn lines(&self) -> Vec<Line> {
        if self.diamond.level().is_multiple_of(2) {
            let row = |row: i64| {
                let columns = self.columns(row);
                let line = Line::Row {
                    row,
                    columns: [*columns.start(), *columns.end()],
                };
                (!columns.is_empty()).then_some(line)
            };
            return self.rows().filter_map(row).collect();
        }
        let [x, y] = self.lattice.placement(self.diamond).origin;
        let side = self.lattice.cells() as i64 * extent_of(self.lattice, self.diamond);
        let (first, last) = (self.tile.first, self.tile.last);
        let sums = (x + y).max(first[0] + first[1])..=(x + y + side).min(last[0] + last[1]);
        let diagonal = |sum: i64| {
            // u is 2 column - sum - x + y.
            let least = (sum + x - y + 1).div_euclid(2);
            let most = (sum + x - y + side).div_euclid(2);
            let columns = [
                least.max(first[0]).max(sum - last[1]),
                most.min(last[0]).min(sum - first[1]),
            ];
            (columns[0] <= columns[1]).then_some(Line::Diagonal { sum, columns })
        };
        sums.filter_map(diagonal).collect()
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
                        let main = self.lattice.has_main_leaf_cell([x, y]);
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
