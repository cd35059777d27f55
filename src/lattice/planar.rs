//! The diamonds of a planar domain: which exist, where they lie, who their parents are.

use super::diamond::Diamond;
use super::order;
use super::patch::Apex;
use crate::{Error, Result};

/// Side of the root square in lattice units.
pub const ROOT_SIDE: i32 = 1 << 30;

/// Where a diamond's matrices lie, in samples: vertex (i, j) at `origin + i * ax + j * ay`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Column and row of vertex (0, 0).
    pub origin: [i64; 2],
    /// Step from i to i + 1, in columns and rows.
    pub ax: [i64; 2],
    /// Step from j to j + 1.
    pub ay: [i64; 2],
}

impl Placement {
    /// Column and row of vertex (i, j).
    pub fn vertex(&self, i: usize, j: usize) -> [i64; 2] {
        let (i, j) = (i as i64, j as i64);
        [
            self.origin[0] + i * self.ax[0] + j * self.ay[0],
            self.origin[1] + i * self.ax[1] + j * self.ay[1],
        ]
    }

    /// Column and row of the centre of cell (i, j); integers below the leaf level.
    pub fn centre(&self, i: usize, j: usize) -> [i64; 2] {
        let [column, row] = self.vertex(i, j);
        [
            column + (self.ax[0] + self.ay[0]) / 2,
            row + (self.ax[1] + self.ay[1]) / 2,
        ]
    }
}

/// Where a sample is in a refined diamond, as an index of one of its matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// Of the (N+1)^2 vertices.
    Vertex(usize),
    /// Of the N^2 centres.
    Centre(usize),
}

/// The diamond graph over a raster of `width` x `height` samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lattice {
    width: u32,
    height: u32,
    cells_log2: u32,
    /// K: half the number of refinements from the root to the samples.
    depth: u32,
    /// Rank of the first diamond of each refinable level, and the count of all at the end.
    level_starts: Vec<u64>,
}

impl Lattice {
    /// The lattice of a raster, its diamonds having `2^cells_log2` cells a side (2..=7).
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for rasters with a side under 2 samples, or too large for the lattice.
    pub fn new(width: u32, height: u32, cells_log2: u32) -> Result<Lattice> {
        if !(2..=7).contains(&cells_log2) {
            return Err(Error::Argument(format!(
                "cells must be a power of two from 4 to 128, not 2^{cells_log2}"
            )));
        }
        if width < 2 || height < 2 {
            return Err(Error::Argument(format!(
                "a raster of {width} x {height} samples has no area: both sides need at least 2"
            )));
        }
        let longest = u64::from(width.max(height)) - 1;
        let depth = (0..=30 - cells_log2).find(|&depth| longest <= 1u64 << (cells_log2 + depth));
        let Some(depth) = depth else {
            return Err(Error::Argument(format!(
                "a raster of {width} x {height} samples is beyond the lattice's {ROOT_SIDE} cells"
            )));
        };
        Ok(Lattice::of_depth([width, height], cells_log2, depth))
    }

    fn of_depth([width, height]: [u32; 2], cells_log2: u32, depth: u32) -> Lattice {
        let mut lattice = Lattice {
            width,
            height,
            cells_log2,
            depth,
            level_starts: vec![0],
        };
        for level in 0..lattice.levels() {
            let next = lattice.level_starts[level as usize] + lattice.extent(level).count();
            lattice.level_starts.push(next);
        }
        lattice
    }

    /// The lattice over the same root square and domain with so many more levels, an even number: its diamonds up to this one's
    /// leaf level are the same, and its samples lie on these and `2^(more / 2) - 1` between two of them.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for an odd number, or more levels than a lattice can have.
    pub fn finer(&self, more: u32) -> Result<Lattice> {
        let halvings = more / 2;
        let depth = self.depth.saturating_add(halvings);
        if !more.is_multiple_of(2) || depth > 30 - self.cells_log2 {
            let (own, cells) = (self.levels(), self.cells());
            return Err(Error::Argument(format!(
                "{more} levels beyond {own} of {cells} cells: they must be even and at most {} in all",
                2 * (30 - self.cells_log2)
            )));
        }
        let finer = |side: u32| ((side - 1) << halvings) + 1;
        let sides = [self.width, self.height].map(finer);
        Ok(Lattice::of_depth(sides, self.cells_log2, depth))
    }

    /// Samples a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// N, the cells along a diamond's side.
    pub fn cells(&self) -> usize {
        1 << self.cells_log2
    }

    /// log2 of [`cells`](Self::cells).
    pub fn cells_log2(&self) -> u32 {
        self.cells_log2
    }

    /// 2K: the leaf level, and the number of levels whose diamonds can be refined.
    pub fn levels(&self) -> u32 {
        2 * self.depth
    }

    /// Lattice units from one sample to the next.
    pub fn sample_step(&self) -> i64 {
        i64::from(ROOT_SIDE) >> (self.cells_log2 + self.depth)
    }

    /// The diamond of level 0.
    pub fn root(&self) -> Diamond {
        Diamond::planar(ROOT_SIDE / 2, ROOT_SIDE / 2)
    }

    /// The last sample's lattice coordinates: the domain is (0, 0) to here.
    fn far_corner(&self) -> [i64; 2] {
        let step = self.sample_step();
        [
            (i64::from(self.width) - 1) * step,
            (i64::from(self.height) - 1) * step,
        ]
    }

    /// Whether its domain covers the same part of the root square as another's, whose samples may be closer or farther apart:
    /// then both have the same diamonds down to the leaf level of one of them.
    pub fn has_domain_of(&self, other: &Lattice) -> bool {
        self.far_corner() == other.far_corner()
    }

    /// Whether `diamond` is one of this lattice: its open square meets the open domain.
    pub fn contains(&self, diamond: Diamond) -> bool {
        let (x, y) = (i64::from(diamond.x), i64::from(diamond.y));
        let root = i64::from(ROOT_SIDE);
        if diamond.z != 0 || !(0..=root).contains(&x) || !(0..=root).contains(&y) {
            return false;
        }
        let level = diamond.level();
        if level > self.levels() {
            return false;
        }
        let half = half_extent(level);
        let [right, bottom] = self.far_corner();
        let (beyond_x, beyond_y) = ((x - right).max(0), (y - bottom).max(0));
        if level % 2 == 1 {
            // Coordinates 0 and 2^30 in both would be a corner of the root, not an edge's midpoint.
            return beyond_x + beyond_y < half && (x % root != 0 || y % root != 0);
        }
        beyond_x < half && beyond_y < half
    }

    /// Whether the hypotenuse runs from matrix corner (0, 0) to (N, N); else from (N, 0) to (0, N).
    pub fn has_main_hypotenuse(&self, diamond: Diamond) -> bool {
        let level = diamond.level();
        let half = half_extent(level);
        if level % 2 == 1 {
            return i64::from(diamond.y) % (2 * half) == 0;
        }
        let corner = |centre: i32| (i64::from(centre) - half) / (2 * half);
        (corner(diamond.x) + corner(diamond.y)) % 2 == 0
    }

    /// The same of the leaf level's cell from this sample to the next column and row.
    pub fn has_main_leaf_cell(&self, [column, row]: [i64; 2]) -> bool {
        let shift = self.cells_log2();
        ((column >> shift) + (row >> shift)) % 2 == 0
    }

    /// The matrix corner that is the apex of each half.
    pub fn apexes(&self, diamond: Diamond) -> [Apex; 2] {
        if self.has_main_hypotenuse(diamond) {
            [Apex::Right, Apex::Bottom]
        } else {
            [Apex::Origin, Apex::Far]
        }
    }

    /// The parents at the apexes of both halves; `None` where none exists. The root has none.
    pub fn parents(&self, diamond: Diamond) -> [Option<Diamond>; 2] {
        if diamond == self.root() {
            return [None, None];
        }
        let placement = self.unit_placement(diamond);
        self.apexes(diamond).map(|apex| {
            let (i, j) = apex.corner(1);
            let [x, y] = placement.vertex(i, j);
            let parent = Diamond::planar(x as i32, y as i32);
            self.contains(parent).then_some(parent)
        })
    }

    /// Which halves are present.
    pub fn halves(&self, diamond: Diamond) -> [bool; 2] {
        if diamond == self.root() {
            return [true, true];
        }
        self.parents(diamond).map(|parent| parent.is_some())
    }

    /// The existing children: over the matrix edges j = 0, i = N, j = N, i = 0, in this order.
    pub fn children(&self, diamond: Diamond) -> [Option<Diamond>; 4] {
        if diamond.level() >= self.levels() {
            return [None; 4];
        }
        let placement = self.unit_placement(diamond);
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| placement.vertex(i, j));
        std::array::from_fn(|edge| {
            let (p, q) = (corners[edge], corners[(edge + 1) % 4]);
            let middle = [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2];
            let child = Diamond::planar(middle[0] as i32, middle[1] as i32);
            self.contains(child).then_some(child)
        })
    }

    /// The existing halves, and which of their diamonds', that refining splits a half into: those over its two legs.
    pub fn split_half(&self, diamond: Diamond, half: usize) -> [Option<(Diamond, usize)>; 2] {
        let children = self.children(diamond);
        // Children lie over the edges from corner to corner, in the order of the apexes.
        let apex = self.apexes(diamond)[half] as usize;
        [apex, (apex + 3) % 4].map(|edge| {
            let child = children[edge]?;
            let half = usize::from(self.parents(child)[1] == Some(diamond));
            Some((child, half))
        })
    }

    /// Corners of the square as a matrix of one cell, in lattice units.
    fn unit_placement(&self, diamond: Diamond) -> Placement {
        let (x, y) = (i64::from(diamond.x), i64::from(diamond.y));
        let half = half_extent(diamond.level());
        if diamond.level().is_multiple_of(2) {
            return Placement {
                origin: [x - half, y - half],
                ax: [2 * half, 0],
                ay: [0, 2 * half],
            };
        }
        Placement {
            origin: [x - half, y],
            ax: [half, -half],
            ay: [half, half],
        }
    }

    /// Where the diamond's vertex and centre matrices lie, in samples.
    pub fn placement(&self, diamond: Diamond) -> Placement {
        let unit = self.unit_placement(diamond);
        let scale = |v: [i64; 2], by: i64| [v[0] / by, v[1] / by];
        let step = self.sample_step();
        Placement {
            origin: scale(unit.origin, step),
            ax: scale(unit.ax, step << self.cells_log2),
            ay: scale(unit.ay, step << self.cells_log2),
        }
    }

    /// Whether a position in samples lies in the raster.
    pub fn in_raster(&self, position: [i64; 2]) -> bool {
        (0..i64::from(self.width)).contains(&position[0])
            && (0..i64::from(self.height)).contains(&position[1])
    }

    /// Whether the open triangle of a half or of part of one, its corners in samples, meets the open domain.
    pub fn meets_domain(&self, triangle: [[i64; 2]; 3]) -> bool {
        let last = [i64::from(self.width) - 1, i64::from(self.height) - 1];
        let any = |holds: &dyn Fn([i64; 2]) -> bool| triangle.into_iter().any(holds);
        // Of the domain's corners only the far one can lie within the root square, so that of all turned
        // lines only one through it can keep a triangle apart from the domain.
        any(&|[column, _]| column > 0)
            && any(&|[_, row]| row > 0)
            && any(&|[column, _]| column < last[0])
            && any(&|[_, row]| row < last[1])
            && any(&|[column, row]| column + row < last[0] + last[1])
    }

    /// Whether a triangle of a patch is drawn, given its vertices in samples and which of them are valid.
    ///
    /// None wholly outside the open domain is. At the leaf level all three must be valid; at coarser
    /// ones any, or all three be outside, as where only the triangle's middle covers the domain's corner.
    pub fn draws(&self, is_leaf: bool, triangle: [[i64; 2]; 3], valid: [bool; 3]) -> bool {
        let has_ground = if is_leaf {
            valid == [true; 3]
        } else {
            valid.contains(&true) || triangle.into_iter().all(|vertex| !self.in_raster(vertex))
        };
        self.meets_domain(triangle) && has_ground
    }

    /// Whether the whole square lies in the closed domain, so that no vertex is outside.
    pub fn is_inside(&self, diamond: Diamond) -> bool {
        let half = half_extent(diamond.level());
        let [right, bottom] = self.far_corner();
        let within = |centre: i32, end: i64| {
            i64::from(centre) - half >= 0 && i64::from(centre) + half <= end
        };
        within(diamond.x, right) && within(diamond.y, bottom)
    }

    /// The finest refinable diamond that has a sample strictly inside, so that nothing finer changes its
    /// height, and where the sample is in it. `None` for samples that no such diamond has inside: corners
    /// of the root, and all where the root is the leaf level.
    pub fn finest_around(&self, at: [i64; 2]) -> Option<(Diamond, Site)> {
        let around = |level: u32| self.diamonds_around(level, at, at).into_iter().next();
        let diamond = (0..self.levels()).rev().find_map(around)?;
        let placement = self.placement(diamond);
        let (dx, dy) = (at[0] - placement.origin[0], at[1] - placement.origin[1]);
        let step = placement.ax[0];
        // In the doubled index grid, where vertices have even indices and centres odd ones.
        let [u, v] = if diamond.level().is_multiple_of(2) {
            [2 * dx / step, 2 * dy / step]
        } else {
            [(dx - dy) / step, (dx + dy) / step]
        };
        let (i, j, cells) = ((u / 2) as usize, (v / 2) as usize, self.cells());
        let site = if u % 2 == 0 {
            Site::Vertex(j * (cells + 1) + i)
        } else {
            Site::Centre(j * cells + i)
        };
        Some((diamond, site))
    }

    /// Number of refinable diamonds: those of levels 0..2K, which have blocks.
    pub fn diamond_count(&self) -> u64 {
        self.level_starts.last().copied().unwrap_or(0)
    }

    /// Ranks of the diamonds of a refinable level.
    pub fn level_ranks(&self, level: u32) -> std::ops::Range<u64> {
        self.level_starts[level as usize]..self.level_starts[level as usize + 1]
    }

    /// Position in the file of a refinable diamond that this lattice contains.
    pub fn rank(&self, diamond: Diamond) -> u64 {
        let level = diamond.level();
        self.level_starts[level as usize] + self.extent(level).rank(position(diamond, level))
    }

    /// The diamond of a rank under [`diamond_count`](Self::diamond_count).
    pub fn diamond(&self, rank: u64) -> Diamond {
        let level = self.level_starts.partition_point(|&start| start <= rank) as u32 - 1;
        let at = self
            .extent(level)
            .position(rank - self.level_starts[level as usize]);
        at_position(at, level)
    }

    /// All diamonds of a level (0..=2K) in their order.
    pub fn diamonds(&self, level: u32) -> Vec<Diamond> {
        self.extent(level)
            .positions()
            .into_iter()
            .map(|at| at_position(at, level))
            .collect()
    }

    /// The diamonds of a level whose open squares meet the closed rectangle from sample `first` to
    /// sample `last`, row by row.
    pub fn diamonds_around(&self, level: u32, first: [i64; 2], last: [i64; 2]) -> Vec<Diamond> {
        let step = self.sample_step();
        let half = half_extent(level);
        let unit = if level.is_multiple_of(2) {
            2 * half
        } else {
            half
        };
        let distance = |centre: i32, axis: usize| {
            let centre = i64::from(centre);
            (centre - centre.clamp(first[axis] * step, last[axis] * step)).abs()
        };
        let meets = |diamond: Diamond| {
            let (x, y) = (distance(diamond.x, 0), distance(diamond.y, 1));
            if level.is_multiple_of(2) {
                x < half && y < half
            } else {
                x + y < half
            }
        };
        let range = |axis: usize| {
            let near = ((first[axis] * step - half) / unit).max(0) as u64;
            near..=((last[axis] * step + half) / unit).max(0) as u64
        };
        let columns = range(0);
        range(1)
            .flat_map(|y| columns.clone().map(move |x| [x, y]))
            .filter(|at| level.is_multiple_of(2) || (at[0] + at[1]) % 2 == 1)
            .map(|at| at_position(at, level))
            .filter(|&diamond| self.contains(diamond) && meets(diamond))
            .collect()
    }

    /// The lattice positions of a level's diamonds: the squares of an even level that meet the
    /// domain; on an odd level the points of odd parity, in half diagonals.
    fn extent(&self, level: u32) -> order::Extent {
        let half = half_extent(level);
        let [right, bottom] = self.far_corner();
        if level.is_multiple_of(2) {
            let count = |end: i64| (end as u64).div_ceil(2 * half as u64);
            return order::Extent::full(count(right), count(bottom));
        }
        let last = [
            (right as u64).div_ceil(half as u64),
            (bottom as u64).div_ceil(half as u64),
        ];
        let corner = at_position(last, level);
        let without_corner = (last[0] + last[1]) % 2 == 1 && !self.contains(corner);
        order::Extent::checkered(last[0] + 1, last[1] + 1, without_corner)
    }
}

/// Half the diamond's extent along x: half the side of an even square, half the diagonal of a turned one.
fn half_extent(level: u32) -> i64 {
    i64::from(ROOT_SIDE) >> (level / 2 + 1)
}

fn position(diamond: Diamond, level: u32) -> [u64; 2] {
    let half = half_extent(level);
    // Even centres are odd multiples of `half`; odd levels count in `half` itself.
    let unit = if level.is_multiple_of(2) {
        2 * half
    } else {
        half
    };
    [
        (i64::from(diamond.x) / unit) as u64,
        (i64::from(diamond.y) / unit) as u64,
    ]
}

fn at_position(at: [u64; 2], level: u32) -> Diamond {
    let half = half_extent(level);
    let coordinate = |value: u64| {
        let value = value as i64;
        (if level.is_multiple_of(2) {
            (2 * value + 1) * half
        } else {
            value * half
        }) as i32
    };
    Diamond::planar(coordinate(at[0]), coordinate(at[1]))
}
