//! One diamond that a cut holds, as its summary tells it.

use super::projection::{Lack, Projection};
use super::{DiamondSource, Summary};
use crate::lattice::{Apex, Diamond, Lattice};

/// A diamond at least one of whose halves came from a refined parent (or the root).
#[derive(Clone)]
pub(super) struct Node {
    pub diamond: Diamond,
    pub level: u32,
    pub is_leaf: bool,
    /// Its vertices are the samples, or between them.
    pub has_all_samples: bool,
    pub bounds: Bounds,
    /// Its detail is missing, so that it is never refined.
    pub is_missing: bool,
    pub halves: [Half; 2],
    pub refined: bool,
    pub refined_children: u8,
    /// The update in which it was last refined.
    pub refined_at: u64,
    /// Projected error in pixels; 0 where no half that has arrived is visible. Like `keep` and what is visible it is
    /// that of the last look, which leaves out nodes with refined children.
    pub priority: f64,
    /// The same, but 0 only outside the guard band.
    pub keep: f64,
    pub room: Room,
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
    /// The colours of the next level are other ones.
    pub has_finer_texels: bool,
}

/// Bytes set aside for a diamond, enough whatever its samples are.
#[derive(Clone, Copy)]
pub(super) struct Room {
    /// Heights and slopes.
    pub own: u64,
    /// Each half that is drawn.
    pub patch: u64,
}

/// What a node is made with.
#[derive(Clone, Copy)]
pub(super) struct Outlook {
    pub bounds: Bounds,
    pub is_missing: bool,
}

impl Outlook {
    /// Of a refinable diamond, and whether there are finer colours.
    pub fn of(source: &dyn DiamondSource, summary: Summary, has_finer_texels: bool) -> Outlook {
        Outlook {
            bounds: Bounds {
                has_finer_texels,
                ..Bounds::new(source, summary.error, summary.range)
            },
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
#[derive(Clone)]
pub(super) struct Half {
    pub is_present: bool,
    /// Some of it lies in the domain, so that there may be something to draw.
    pub in_domain: bool,
    /// It came from its parent, which is refined.
    pub has_arrived: bool,
    /// It has arrived, and some of it may be on the screen.
    pub visible: bool,
    /// World x and y: right angle, end of the first leg, end of the second.
    pub corners: [[f64; 2]; 3],
    /// World z of all that may be drawn over it, low to high.
    pub z: [f64; 2],
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
            has_finer_texels: false,
        }
    }
}

impl Node {
    /// A node none of whose halves has arrived.
    pub fn new(source: &dyn DiamondSource, room: Room, diamond: Diamond, outlook: Outlook) -> Node {
        let bounds = outlook.bounds;
        let lattice = source.lattice();
        let (cells, placement) = (lattice.cells(), lattice.placement(diamond));
        let (apexes, present) = (lattice.apexes(diamond), lattice.halves(diamond));
        let half = |half: usize| {
            let ends = [(0, 0), (cells, 0), (0, cells)];
            let places = ends.map(|(p, q)| {
                let (i, j) = apexes[half].vertex(cells, p, q);
                placement.vertex(i, j)
            });
            Half {
                is_present: present[half],
                in_domain: present[half] && lattice.meets_domain(places),
                has_arrived: false,
                visible: false,
                corners: places
                    .map(|[column, row]| source.frame().grid_to_world(column as f64, row as f64)),
                z: bounds.z,
            }
        };
        Node {
            diamond,
            level: diamond.level(),
            is_leaf: diamond.level() == lattice.levels(),
            has_all_samples: diamond.level() >= source.data_levels(),
            bounds,
            is_missing: outlook.is_missing,
            halves: [half(0), half(1)],
            refined: false,
            refined_children: 0,
            refined_at: 0,
            priority: 0.0,
            keep: 0.0,
            room,
        }
    }

    /// Bytes set aside, patches included.
    pub fn bytes(&self) -> u64 {
        self.room.own + self.drawn_halves() * self.room.patch
    }

    /// Number of halves drawn, but for those whose samples turn out to be void.
    pub fn drawn_halves(&self) -> u64 {
        self.count_unrefined(|half| half.in_domain && half.has_arrived)
    }

    /// The same of those that meet the frustum.
    pub fn visible_patches(&self) -> u64 {
        self.count_unrefined(|half| half.visible)
    }

    fn count_unrefined(&self, holds: impl Fn(&Half) -> bool) -> u64 {
        let halves = self.halves.iter().filter(|half| holds(half));
        if self.refined {
            0
        } else {
            halves.count() as u64
        }
    }

    /// Whether all present halves have arrived: all parents are refined.
    pub fn is_complete(&self) -> bool {
        self.halves
            .iter()
            .all(|half| half.has_arrived == half.is_present)
    }

    /// Lets a half arrive from a parent all of whose half around it lies between the heights `above`.
    pub fn receive(&mut self, half: usize, above: [f64; 2]) {
        let own = self.bounds.z;
        let half = &mut self.halves[half];
        // Within the bounds of both, though neither need contain the other. Those of halves nest.
        half.z = [own[0].max(above[0]), own[1].min(above[1])];
        half.has_arrived = true;
    }

    /// Takes a half back.
    pub fn lose(&mut self, half: usize) {
        self.halves[half].has_arrived = false;
        self.halves[half].visible = false;
    }

    /// Whether how it looks matters for what may be refined or coarsened next, and for what is drawn.
    pub fn is_on_the_cut(&self) -> bool {
        self.refined_children == 0
    }

    /// Projected error by a view that is not the last looked through, 0 only outside its guard band.
    pub fn error_seen_by(&self, projection: &Projection) -> f64 {
        let halves = self.halves.iter();
        let seen = halves.filter(|half| half.has_arrived && half.in_domain);
        let lack = self.lack();
        let errors = seen.map(|half| projection.see(&half.corners, half.z, lack).pixels);
        errors.fold(0.0, f64::max)
    }

    fn lack(&self) -> Lack {
        let Bounds {
            error,
            has_finer_texels,
            ..
        } = self.bounds;
        Lack {
            error: (!self.has_all_samples || error > 0.0).then_some(error),
            texels: has_finer_texels,
        }
    }

    /// Judges the halves that have arrived by a view.
    pub fn look(&mut self, projection: &Projection) {
        (self.priority, self.keep) = (0.0, 0.0);
        let lack = self.lack();
        for half in self.halves.iter_mut() {
            if !half.has_arrived || !half.in_domain {
                continue;
            }
            let sight = projection.see(&half.corners, half.z, lack);
            half.visible = sight.visible;
            self.keep = self.keep.max(sight.pixels);
            if sight.visible {
                self.priority = self.priority.max(sight.pixels);
            }
        }
    }
}

/// The half of `child` that comes from `parent`.
pub(super) fn half_from(lattice: &Lattice, child: Diamond, parent: Diamond) -> Option<usize> {
    let parents = lattice.parents(child);
    parents.iter().position(|&other| other == Some(parent))
}

/// The half of a diamond with these apexes that has the matrix edge over which its child number `edge` lies.
pub(super) fn half_at_edge(apexes: [Apex; 2], edge: usize) -> usize {
    let corners = [(0, 0), (1, 0), (1, 1), (0, 1)];
    let apex = apexes[0].corner(1);
    usize::from(apex != corners[edge] && apex != corners[(edge + 1) % 4])
}
