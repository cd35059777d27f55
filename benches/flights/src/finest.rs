//! The finest surface: the triangles of the leaf level.

use kimberlite::cut::{DiamondSource, Query, Terrain, Window, read_window};
use kimberlite::geo::Frame;

use crate::Result;

/// Places at which the surface is compared with the library's own heights.
const CHECKS: u64 = 2000;

/// All samples as decoded.
pub struct Finest {
    width: usize,
    height: usize,
    cells_log2: u32,
    /// World z, row by row; NaN where void.
    z: Vec<f64>,
    frame: Frame,
}

impl Finest {
    pub fn read(terrain: &Terrain) -> Result<Finest> {
        let (lattice, info) = (terrain.lattice(), terrain.raster_info());
        let window = Window {
            column: 0,
            row: 0,
            width: lattice.width(),
            height: lattice.height(),
        };
        let mut z = vec![0.0; lattice.width() as usize * lattice.height() as usize];
        read_window(terrain, lattice.levels(), window, &mut z)?;
        for z in &mut z {
            *z = info.value_offset + info.value_scale * *z;
        }
        Ok(Finest {
            width: lattice.width() as usize,
            height: lattice.height() as usize,
            cells_log2: lattice.cells_log2(),
            z,
            frame: *DiamondSource::frame(terrain),
        })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// World z of a sample; NaN where void.
    pub fn sample(&self, column: usize, row: usize) -> f64 {
        self.z[row * self.width + column]
    }

    /// World z at a fractional column and row; `None` outside and where void.
    pub fn height(&self, [column, row]: [f64; 2]) -> Option<f64> {
        let last = [self.width - 1, self.height - 1].map(|last| last as f64);
        if !(0.0..=last[0]).contains(&column) || !(0.0..=last[1]).contains(&row) {
            return None;
        }
        let (x, y) = (
            column.min(last[0] - 1.0) as usize,
            row.min(last[1] - 1.0) as usize,
        );
        let (a, b) = (column - x as f64, row - y as f64);
        let at = |i: usize, j: usize| self.sample(x + i, y + j);
        // Cells are split parallel to the hypotenuse of their leaf diamond.
        let main = ((x >> self.cells_log2) + (y >> self.cells_log2)).is_multiple_of(2);
        let z = match main {
            true if a >= b => (1.0 - a) * at(0, 0) + (a - b) * at(1, 0) + b * at(1, 1),
            true => (1.0 - b) * at(0, 0) + (b - a) * at(0, 1) + a * at(1, 1),
            false if a + b <= 1.0 => (1.0 - a - b) * at(0, 0) + a * at(1, 0) + b * at(0, 1),
            false => (a + b - 1.0) * at(1, 1) + (1.0 - a) * at(0, 1) + (1.0 - b) * at(1, 0),
        };
        (!z.is_nan()).then_some(z)
    }

    /// World z at world x and y.
    pub fn height_at_world(&self, [x, y]: [f64; 2]) -> Option<f64> {
        self.height(self.frame.world_to_grid(x, y))
    }

    /// An error where a query tells another height: then nothing measured against this surface is worth anything.
    pub fn agrees_with_queries(&self, terrain: &std::sync::Arc<Terrain>) -> Result<()> {
        let mut query = Query::new(terrain.clone(), 64 << 20);
        let mut random = Random(1);
        for _ in 0..CHECKS {
            let at = self.size().map(|side| random.share() * (side - 1) as f64);
            let told = query.height_at_grid(at[0], at[1])?.map(|told| told.height);
            let agrees = match (told, self.height(at)) {
                (Some(a), Some(b)) => (a - b).abs() <= 1e-9 * (1.0 + a.abs()),
                (a, b) => a == b,
            };
            if !agrees {
                return Err(
                    format!("the finest surface at {at:?} is not the one of queries").into(),
                );
            }
        }
        Ok(())
    }
}

/// SplitMix64 (Steele, Lea and Flood 2014).
pub struct Random(pub u64);

impl Random {
    /// From 0 to below 1.
    pub fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
