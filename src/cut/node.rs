//! One diamond that a cut holds.

use super::patch::Patch;
use super::projection::Projection;
use super::slopes::Slope;
use super::{DiamondSource, Summary};
use crate::codec::Matrix;
use crate::lattice::{Apex, Diamond, Lattice, Placement};
use std::sync::Arc;

/// A diamond at least one of whose halves came from a refined parent (or the root).
pub(super) struct Node {
    pub diamond: Diamond,
    pub level: u32,
    pub placement: Placement,
    /// Vertex matrix; only halves that have arrived mean anything, and an absent half mirrors them.
    pub vertices: Matrix,
    pub slopes: Box<[Slope]>,
    pub bounds: Bounds,
    /// Its detail is missing, so that it is never refined.
    pub is_missing: bool,
    pub halves: [Half; 2],
    pub refined: bool,
    pub refined_children: u8,
    /// The update in which it was last refined.
    pub refined_at: u64,
    /// Projected error in pixels; 0 where no half that has arrived is visible.
    pub priority: f64,
    /// The same, but 0 only outside the guard band.
    pub keep: f64,
}

/// What bounds a diamond and all that descends from it.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    /// World units.
    pub error: f64,
    /// Units, as the source decoded it.
    pub range: [i32; 2],
    /// World z, low to high.
    pub z: [f64; 2],
}

/// What a node is made with.
#[derive(Clone, Copy)]
pub(super) struct Outlook {
    pub bounds: Bounds,
    pub is_missing: bool,
}

impl Outlook {
    /// Of a refinable diamond.
    pub fn of(source: &dyn DiamondSource, summary: Summary) -> Outlook {
        Outlook {
            bounds: Bounds::new(source, summary.error, summary.range),
            is_missing: summary.is_missing,
        }
    }

    /// Of a diamond of the leaf level, whose heights lie in `range`.
    pub fn of_leaf(source: &dyn DiamondSource, range: [i32; 2]) -> Outlook {
        Outlook {
            bounds: Bounds::new(source, 0.0, range),
            is_missing: false,
        }
    }
}

/// One half of a diamond.
pub(super) struct Half {
    pub apex: Apex,
    pub is_present: bool,
    /// It came from its parent, which is refined.
    pub has_arrived: bool,
    pub visible: bool,
    /// World x and y: right angle, end of the first leg, end of the second.
    pub corners: [[f64; 2]; 3],
    /// World z of all that may be drawn over it, low to high.
    pub z: [f64; 2],
    /// What is drawn for it; `None` where refined, not arrived, or all void or outside.
    pub patch: Option<Arc<Patch>>,
}

impl Bounds {
    /// Bounds from units.
    pub fn new(source: &dyn DiamondSource, error: f64, range: [i32; 2]) -> Bounds {
        let [offset, scale] = source.height_to_world();
        let ends = range.map(|unit| offset + scale * f64::from(unit));
        Bounds {
            error: if error.is_nan() {
                f64::INFINITY
            } else {
                error * scale.abs()
            },
            range,
            z: [ends[0].min(ends[1]), ends[0].max(ends[1])],
        }
    }
}

impl Node {
    /// A node without any heights yet.
    pub fn new(source: &dyn DiamondSource, diamond: Diamond, outlook: Outlook) -> Node {
        let bounds = outlook.bounds;
        let lattice = source.lattice();
        let (cells, placement) = (lattice.cells(), lattice.placement(diamond));
        let entries = (cells + 1) * (cells + 1);
        let (apexes, present) = (lattice.apexes(diamond), lattice.halves(diamond));
        let corner = |(i, j): (usize, usize)| {
            let [column, row] = placement.vertex(i, j);
            source.frame().grid_to_world(column as f64, row as f64)
        };
        let half = |half: usize| {
            let apex: Apex = apexes[half];
            let ends = [(0, 0), (cells, 0), (0, cells)];
            Half {
                apex,
                is_present: present[half],
                has_arrived: false,
                visible: false,
                corners: ends.map(|(p, q)| corner(apex.vertex(cells, p, q))),
                z: bounds.z,
                patch: None,
            }
        };
        Node {
            diamond,
            level: diamond.level(),
            placement,
            vertices: Matrix {
                values: vec![0; entries].into(),
                valid: None,
            },
            slopes: vec![[0.0; 2]; entries].into(),
            bounds,
            is_missing: outlook.is_missing,
            halves: [half(0), half(1)],
            refined: false,
            refined_children: 0,
            refined_at: 0,
            priority: 0.0,
            keep: 0.0,
        }
    }

    /// Most bytes that a node of `lattice` can hold beside its patches.
    pub fn most_bytes(lattice: &Lattice) -> u64 {
        let side = lattice.cells() as u64 + 1;
        side * side * (size_of::<i32>() + size_of::<Slope>() + size_of::<u8>()) as u64
    }

    /// Bytes held, patches included.
    pub fn bytes(&self) -> u64 {
        let valid = self.vertices.valid.as_ref().map_or(0, |valid| valid.len());
        let own = size_of_val(&*self.vertices.values) + size_of_val(&*self.slopes) + valid;
        own as u64 + self.patches().map(|patch| patch.bytes()).sum::<u64>()
    }

    /// What is drawn for it.
    pub fn patches(&self) -> impl Iterator<Item = &Arc<Patch>> {
        self.halves.iter().filter_map(|half| half.patch.as_ref())
    }

    /// Number of patches drawn that meet the frustum.
    pub fn visible_patches(&self) -> u64 {
        let visible = |half: &&Half| half.visible && half.patch.is_some();
        self.halves.iter().filter(visible).count() as u64
    }

    /// Whether all present halves have arrived: all parents are refined.
    pub fn is_complete(&self) -> bool {
        self.halves
            .iter()
            .all(|half| half.has_arrived == half.is_present)
    }

    /// Judges the halves that have arrived by a view.
    pub fn look(&mut self, projection: &Projection) {
        (self.priority, self.keep) = (0.0, 0.0);
        for half in self.halves.iter_mut().filter(|half| half.has_arrived) {
            let sight = projection.see(&half.corners, half.z, self.bounds.error);
            half.visible = sight.visible;
            self.keep = self.keep.max(sight.pixels);
            if sight.visible {
                self.priority = self.priority.max(sight.pixels);
            }
        }
    }
}
