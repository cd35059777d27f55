//! Which diamonds there are, and where.

/// Side of the root square in lattice units.
pub const ROOT_SIDE: i64 = 1 << 30;

/// (x, y) in lattice units; x along columns, y along rows.
pub type Point = (i64, i64);

/// Column i and row j in a diamond's matrix of vertices or of centres.
pub type Index = (i64, i64);

/// A diamond: its level and its centre. Level follows from the centre; it is here to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Diamond {
    pub level: u32,
    pub x: i64,
    pub y: i64,
}

/// The diamonds over a raster.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// N, cells along a diamond's side.
    pub cells: i64,
    /// K: the leaf level is 2K.
    pub depth: u32,
    pub width: i64,
    pub height: i64,
}

impl Lattice {
    pub fn new(width: usize, height: usize, cells_log2: u32) -> Lattice {
        let (width, height) = (width as i64, height as i64);
        let cells = 1 << cells_log2;
        let mut depth = 0;
        while cells << depth < width.max(height) - 1 {
            depth += 1;
        }
        Lattice {
            cells,
            depth,
            width,
            height,
        }
    }

    pub fn leaf_level(&self) -> u32 {
        2 * self.depth
    }

    pub fn root(&self) -> Diamond {
        Diamond {
            level: 0,
            x: ROOT_SIDE / 2,
            y: ROOT_SIDE / 2,
        }
    }

    /// Lattice units between two samples.
    pub fn spacing(&self) -> i64 {
        ROOT_SIDE / (self.cells << self.depth)
    }

    /// The sample at a point, as its index in the raster; `None` beyond the raster.
    pub fn sample(&self, point: Point) -> Option<usize> {
        let (column, row) = (point.0 / self.spacing(), point.1 / self.spacing());
        assert_eq!(point, self.point(column, row), "between the samples");
        let inside = (0..self.width).contains(&column) && (0..self.height).contains(&row);
        inside.then(|| (row * self.width + column) as usize)
    }

    /// Where a sample lies.
    pub fn point(&self, column: i64, row: i64) -> Point {
        (column * self.spacing(), row * self.spacing())
    }

    /// Corners of the domain.
    pub fn domain(&self) -> [Point; 4] {
        let (right, bottom) = self.point(self.width - 1, self.height - 1);
        [(0, 0), (right, 0), (right, bottom), (0, bottom)]
    }

    /// Level of the diamond with this centre, by the trailing zero bits of its coordinates.
    pub fn level_of((x, y): Point) -> Option<u32> {
        let (tx, ty) = (x.trailing_zeros(), y.trailing_zeros());
        let k = 29_u32.checked_sub(tx.min(ty))?;
        Some(if tx == ty { 2 * k } else { 2 * k + 1 })
    }

    /// All diamonds of a level, in Morton order of their centres.
    pub fn level(&self, level: u32) -> Vec<Diamond> {
        let a = ROOT_SIDE >> (level / 2);
        let squares = 1 << (level / 2);
        let mut centres = Vec::new();
        for m in 0..=squares {
            for half in 0..squares {
                if level % 2 == 1 {
                    centres.extend([(m * a, half * a + a / 2), (half * a + a / 2, m * a)]);
                } else if m < squares {
                    centres.push((m * a + a / 2, half * a + a / 2));
                }
            }
        }
        let diamonds = centres.into_iter().map(|(x, y)| Diamond { level, x, y });
        let mut diamonds: Vec<_> = diamonds.filter(|diamond| self.exists(*diamond)).collect();
        diamonds.sort_by_key(|diamond| morton(diamond.x, diamond.y));
        diamonds
    }

    /// All diamonds, coarse levels first, each level in Morton order: a diamond's rank is its place.
    pub fn diamonds(&self) -> Vec<Diamond> {
        (0..=self.leaf_level())
            .flat_map(|level| self.level(level))
            .collect()
    }

    pub fn exists(&self, diamond: Diamond) -> bool {
        overlap(&self.corners(diamond), &self.domain())
    }

    /// Origin and the steps ax, ay of the vertex matrix.
    fn frame(&self, diamond: Diamond) -> (Point, Point, Point) {
        let Diamond { level, x, y } = diamond;
        let a = ROOT_SIDE >> (level / 2);
        if level % 2 == 0 {
            let step = a / self.cells;
            ((x - a / 2, y - a / 2), (step, 0), (0, step))
        } else {
            let step = a / (2 * self.cells);
            ((x - a / 2, y), (step, -step), (step, step))
        }
    }

    pub fn vertex(&self, diamond: Diamond, (i, j): Index) -> Point {
        let (origin, ax, ay) = self.frame(diamond);
        (
            origin.0 + i * ax.0 + j * ay.0,
            origin.1 + i * ax.1 + j * ay.1,
        )
    }

    pub fn centre(&self, diamond: Diamond, (i, j): Index) -> Point {
        let ((x0, y0), (x1, y1)) = (
            self.vertex(diamond, (i, j)),
            self.vertex(diamond, (i + 1, j + 1)),
        );
        ((x0 + x1) / 2, (y0 + y1) / 2)
    }

    /// Indices of the vertex matrix, row by row.
    pub fn vertex_indices(&self) -> Vec<Index> {
        indices(self.cells + 1)
    }

    /// Indices of the centre matrix, row by row.
    pub fn centre_indices(&self) -> Vec<Index> {
        indices(self.cells)
    }

    /// Corners of the square, in a turn around it.
    pub fn corners(&self, diamond: Diamond) -> [Point; 4] {
        let n = self.cells;
        [(0, 0), (n, 0), (n, n), (0, n)].map(|index| self.vertex(diamond, index))
    }

    /// Whether the hypotenuse runs from (0, 0) to (N, N); otherwise from (N, 0) to (0, N).
    pub fn hypotenuse_is_main(&self, diamond: Diamond) -> bool {
        let first = self.vertex(diamond, (0, 0));
        diamond.level == 0 || Lattice::level_of(first) != Some(diamond.level - 1)
    }

    /// Vertex indices of the apexes of half 0 and half 1.
    pub fn apexes(&self, diamond: Diamond) -> [Index; 2] {
        let n = self.cells;
        if self.hypotenuse_is_main(diamond) {
            [(n, 0), (0, n)]
        } else {
            [(0, 0), (n, n)]
        }
    }

    /// The parents that exist, by half.
    pub fn parents(&self, diamond: Diamond) -> [Option<Diamond>; 2] {
        self.apexes(diamond).map(|apex| {
            let (x, y) = self.vertex(diamond, apex);
            let parent = Diamond {
                level: diamond.level.checked_sub(1)?,
                x,
                y,
            };
            self.exists(parent).then_some(parent)
        })
    }

    /// Which halves are present.
    pub fn present(&self, diamond: Diamond) -> [bool; 2] {
        self.parents(diamond)
            .map(|parent| diamond.level == 0 || parent.is_some())
    }

    /// The children that exist.
    pub fn children(&self, diamond: Diamond) -> Vec<Diamond> {
        let Diamond { level, x, y } = diamond;
        let a = ROOT_SIDE >> (level / 2);
        let steps = if level % 2 == 0 {
            [(a / 2, 0), (-a / 2, 0), (0, a / 2), (0, -a / 2)]
        } else {
            [
                (a / 4, a / 4),
                (-a / 4, a / 4),
                (a / 4, -a / 4),
                (-a / 4, -a / 4),
            ]
        };
        let children = steps.map(|(dx, dy)| Diamond {
            level: level + 1,
            x: x + dx,
            y: y + dy,
        });
        let deeper = level < self.leaf_level();
        children
            .into_iter()
            .filter(|child| deeper && self.exists(*child))
            .collect()
    }

    /// Whether a vertex lies in a half, its boundary included.
    pub fn half_has_vertex(&self, diamond: Diamond, half: usize, index: Index) -> bool {
        self.half_has(diamond, half, index, self.cells)
    }

    /// Whether a centre lies in a half, its hypotenuse included.
    pub fn half_has_centre(&self, diamond: Diamond, half: usize, index: Index) -> bool {
        self.half_has(diamond, half, index, self.cells - 1)
    }

    fn half_has(&self, diamond: Diamond, half: usize, (i, j): Index, last: i64) -> bool {
        match (self.hypotenuse_is_main(diamond), half) {
            (true, 0) => i >= j,
            (true, _) => i <= j,
            (false, 0) => i + j <= last,
            (false, _) => i + j >= last,
        }
    }

    /// The vertex mirrored across the hypotenuse.
    pub fn reflection(&self, diamond: Diamond, (i, j): Index) -> Index {
        let n = self.cells;
        if self.hypotenuse_is_main(diamond) {
            (j, i)
        } else {
            (n - j, n - i)
        }
    }

    /// The N^2 triangles of a half, drawn or not; the first two points bound the long edge.
    pub fn triangles(&self, diamond: Diamond, half: usize) -> Vec<[Point; 3]> {
        let mut triangles = Vec::new();
        for (i, j) in self.centre_indices() {
            let [from, to, third, fourth] = if self.hypotenuse_is_main(diamond) {
                [(i, j), (i + 1, j + 1), (i + 1, j), (i, j + 1)]
            } else {
                [(i + 1, j), (i, j + 1), (i, j), (i + 1, j + 1)]
            };
            for triangle in [[from, to, third], [from, to, fourth]] {
                if triangle
                    .iter()
                    .all(|index| self.half_has_vertex(diamond, half, *index))
                {
                    triangles.push(triangle.map(|index| self.vertex(diamond, index)));
                }
            }
        }
        triangles
    }
}

fn indices(side: i64) -> Vec<Index> {
    (0..side)
        .flat_map(|j| (0..side).map(move |i| (i, j)))
        .collect()
}

/// Bits of the coordinates in turns, y above x.
fn morton(x: i64, y: i64) -> u64 {
    (0..32)
        .map(|bit| ((x >> bit & 1) as u64 | ((y >> bit & 1) as u64) << 1) << (2 * bit))
        .sum()
}

/// Whether two open convex polygons meet whose edges are horizontal, vertical or diagonal: no line
/// of these four directions keeps them apart.
pub fn overlap(one: &[Point], other: &[Point]) -> bool {
    let measures: [fn(&Point) -> i64; 4] = [|p| p.0, |p| p.1, |p| p.0 + p.1, |p| p.0 - p.1];
    measures.into_iter().all(|measure| {
        let low = |points: &[Point]| points.iter().map(measure).min();
        let high = |points: &[Point]| points.iter().map(measure).max();
        high(one) > low(other) && high(other) > low(one)
    })
}
