//! What the lattice says of a diamond's matrices before any data.

use crate::lattice::{Apex, Diamond, Lattice};

/// Where a refinable diamond may hold samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outline {
    /// The diamond's level.
    pub level: u32,
    /// N^2: 1 for each centre that lies in the raster and in a present half; `None` when all do. Only
    /// these have coefficients and a place in the void mask.
    pub codable: Option<Box<[u8]>>,
    /// The apex of the half that is not present, if one is not.
    pub absent: Option<Apex>,
}

impl Outline {
    /// The outline of a diamond of `lattice`.
    pub fn of(lattice: &Lattice, diamond: Diamond) -> Outline {
        let (halves, apexes) = (lattice.halves(diamond), lattice.apexes(diamond));
        let absent = (0..2).find(|&half| !halves[half]);
        let outline = |codable| Outline {
            level: diamond.level(),
            codable,
            absent: absent.map(|half| apexes[half]),
        };
        if absent.is_none() && lattice.is_inside(diamond) {
            return outline(None);
        }
        let cells = lattice.cells();
        let placement = lattice.placement(diamond);
        let codable = |index: usize| {
            let (i, j) = (index % cells, index / cells);
            let present = (0..2).any(|half| halves[half] && apexes[half].holds_centre(cells, i, j));
            u8::from(present && lattice.in_raster(placement.centre(i, j)))
        };
        let mask: Box<[u8]> = (0..cells * cells).map(codable).collect();
        outline(mask.contains(&0).then_some(mask))
    }

    /// Whether a sample may be at the centre of this index.
    pub fn is_codable(&self, index: usize) -> bool {
        self.codable
            .as_ref()
            .is_none_or(|codable| codable[index] != 0)
    }

    /// Number of codable centres, of a diamond of `cells` cells.
    pub fn codable_count(&self, cells: usize) -> usize {
        let count = |mask: &[u8]| mask.iter().map(|&entry| usize::from(entry)).sum();
        self.codable.as_deref().map_or(cells * cells, count)
    }
}
