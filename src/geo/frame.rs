//! The world frame of a planar repository.

use super::RasterInfo;

/// Metres of one degree of latitude on a sphere of the Earth's mean radius (6 371 008.8 m).
const METRES_PER_DEGREE: f64 = 6_371_008.8 * std::f64::consts::PI / 180.0;

/// Affine, axis-aligned map from grid coordinates (column, row, height in physical units) to the
/// right-handed world frame of a view: x east, y north, z up.
///
/// A projected or unreferenced, unrotated raster's world coordinates are those of its reference
/// system. A geographic raster's are metres from its centre on the plane that touches there; a rotated
/// raster's are distances along its rows and columns from its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// World x and y of the sample at column 0, row 0.
    pub origin: [f64; 2],
    /// World units a column, along x, and a row, along y (negative for north-up rasters).
    pub step: [f64; 2],
}

impl Frame {
    /// The frame of a raster.
    pub fn of(info: &RasterInfo) -> Frame {
        let g = &info.geotransform;
        let centre = [
            f64::from(info.width - 1) / 2.0,
            f64::from(info.height - 1) / 2.0,
        ];
        let centred = |step: [f64; 2]| Frame {
            origin: [-step[0] * centre[0], -step[1] * centre[1]],
            step,
        };
        if info.geographic {
            let latitude = info.sample_to_crs(centre[0], centre[1])[1];
            let metres_east = METRES_PER_DEGREE * latitude.to_radians().cos();
            return centred([g[1] * metres_east, g[5] * METRES_PER_DEGREE]);
        }
        if g[2] != 0.0 || g[4] != 0.0 {
            let handedness = (g[1] * g[5] - g[2] * g[4]).signum();
            return centred([g[1].hypot(g[4]), handedness * g[2].hypot(g[5])]);
        }
        Frame {
            origin: info.sample_to_crs(0.0, 0.0),
            step: [g[1], g[5]],
        }
    }

    /// World x and y of a grid position.
    pub fn grid_to_world(&self, column: f64, row: f64) -> [f64; 2] {
        [
            self.origin[0] + self.step[0] * column,
            self.origin[1] + self.step[1] * row,
        ]
    }

    /// Grid position of world x and y.
    pub fn world_to_grid(&self, x: f64, y: f64) -> [f64; 2] {
        [
            (x - self.origin[0]) / self.step[0],
            (y - self.origin[1]) / self.step[1],
        ]
    }
}
