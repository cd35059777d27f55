//! The frustum, and how large a height error can look on the screen.

use super::{Metric, View};
use crate::{Error, Result};
use glam::{DMat4, DVec4};

/// A view made ready to judge prisms: triangles in the plane between two heights.
pub(super) struct Projection {
    /// For each column of the matrix its rows x, y and w. Row z is left out, because conventions of
    /// depth differ.
    columns: [[f64; 3]; 4],
    half_viewport: [f64; 2],
    /// Least w inside the frustum: nothing nearer is in front of the near plane.
    least_w: f64,
    guard: f64,
    scale: Scale,
    tolerance: f64,
}

/// What errors are measured by.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    pub metric: Metric,
    /// Cells along a diamond's side.
    pub cells: usize,
    /// Of colours: texels along a side, and how large they may be, in pixels.
    pub texels: Option<(usize, f64)>,
}

/// What a half is too coarse in, if it is near.
#[derive(Clone, Copy)]
pub(super) struct Lack {
    /// The vertical error; `None` where no heights are finer.
    pub error: Option<f64>,
    /// Finer colours are there.
    pub texels: bool,
}

/// How a prism looks.
#[derive(Clone, Copy)]
pub(super) struct Sight {
    /// It meets the frustum (or cannot be told to be outside).
    pub visible: bool,
    /// The error on the screen in pixels by the metric; 0 outside the guard band.
    pub pixels: f64,
}

impl Projection {
    /// `guard` (at least 1) is the size of the guard band in screens.
    pub fn new(view: &View, guard: f64, scale: Scale) -> Result<Projection> {
        let numbers = [
            &view.eye[..],
            &view.world_to_clip,
            &view.viewport,
            &[view.tolerance],
        ];
        if numbers
            .into_iter()
            .flatten()
            .any(|number| !number.is_finite())
        {
            return Err(Error::Argument(
                "a view has a number that is not finite".into(),
            ));
        }
        if view.viewport.iter().any(|&size| size <= 0.0) {
            let [width, height] = view.viewport;
            return Err(Error::Argument(format!(
                "a viewport of {width} x {height} has no area"
            )));
        }
        if view.tolerance <= 0.0 {
            let tolerance = view.tolerance;
            return Err(Error::Argument(format!(
                "a tolerance of {tolerance} pixels is not above 0"
            )));
        }
        let matrix = DMat4::from_cols_array(&view.world_to_clip);
        let least_w = least_w(&matrix)
            .ok_or_else(|| Error::Argument("a view's matrix is singular or sees nothing".into()))?;
        let m = &view.world_to_clip;
        Ok(Projection {
            columns: [0, 4, 8, 12].map(|at| [m[at], m[at + 1], m[at + 3]]),
            half_viewport: view.viewport.map(|size| size / 2.0),
            least_w,
            guard,
            scale,
            tolerance: view.tolerance,
        })
    }

    /// How the prism over `corners` between the heights `z` looks, and what its lack comes to. Texels reach the tolerance
    /// when they are as large as they may be.
    ///
    /// The geometric metric: with clip coordinates x, y, w, moving a point by d along z moves it on the screen by
    /// `d (m_xz - m_wz x/w) / w'` in x, w' being that of the moved point, and so in y. The bound takes
    /// the extremes of x/w over the part of the prism on the screen and the least w. It holds
    /// wherever one of the two points is on the screen and both are in front of the near plane.
    pub fn see(&self, corners: &[[f64; 2]; 3], z: [f64; 2], lack: Lack) -> Sight {
        let hull = self.hull(corners, z);
        let visible = hull.meets(1.0);
        if !visible && !hull.meets(self.guard) {
            return Sight {
                visible,
                pixels: 0.0,
            };
        }
        let limit = if visible { 1.0 } else { self.guard };
        let pixels = match (lack.error, self.scale.metric) {
            (None, _) => 0.0,
            (Some(error), Metric::Geometric) => self.shift(&hull, limit, error),
            (Some(_), Metric::Sampling) => self.spacing(&hull, limit, self.scale.cells),
        };
        let texels = match self.scale.texels.filter(|_| lack.texels) {
            Some((cells, most)) => self.spacing(&hull, limit, cells) / most * self.tolerance,
            None => 0.0,
        };
        Sight {
            visible,
            pixels: pixels.max(texels),
        }
    }

    fn hull(&self, corners: &[[f64; 2]; 3], z: [f64; 2]) -> Hull {
        let [cx, cy, cz, c1] = &self.columns;
        let mut hull = Hull::default();
        for (corner, &[x, y]) in corners.iter().enumerate() {
            for (end, z) in z.into_iter().enumerate() {
                hull.points[2 * corner + end] =
                    std::array::from_fn(|row| cx[row] * x + cy[row] * y + cz[row] * z + c1[row]);
            }
        }
        hull
    }

    /// Side of a square as large as the mean triangle of a half, in pixels, its box taken from edge to edge.
    fn spacing(&self, hull: &Hull, limit: f64, cells: usize) -> f64 {
        let in_front = hull.least_w() > 0.0;
        let side = |axis: usize| {
            let [low, high] = hull.extent(axis, in_front, limit);
            (high - low) * self.half_viewport[axis]
        };
        (side(0) * side(1)).sqrt() / cells as f64
    }

    /// How far a vertical error moves a point on the screen at most, in pixels.
    fn shift(&self, hull: &Hull, limit: f64, error: f64) -> f64 {
        if error == 0.0 || error == f64::INFINITY {
            return error;
        }
        let least = hull.least_w();
        let rise = &self.columns[2];
        let shift = |axis: usize| {
            let [low, high] = hull.extent(axis, least > 0.0, limit);
            let worst = (rise[axis] - rise[2] * low)
                .abs()
                .max((rise[axis] - rise[2] * high).abs());
            self.half_viewport[axis] * worst
        };
        let [x, y] = [shift(0), shift(1)];
        error * (x * x + y * y).sqrt() / least.max(self.least_w)
    }
}

/// Corners of a prism in clip space: x, y, w.
#[derive(Default)]
struct Hull {
    points: [[f64; 3]; 6],
}

impl Hull {
    /// Whether no side plane of the frustum, widened by `factor`, nor the plane w = 0 separates it.
    fn meets(&self, factor: f64) -> bool {
        let mut inside = [false; 5];
        for [x, y, w] in &self.points {
            let reach = factor * w;
            inside[0] |= *w > 0.0;
            inside[1] |= *x <= reach;
            inside[2] |= -x <= reach;
            inside[3] |= *y <= reach;
            inside[4] |= -y <= reach;
        }
        inside == [true; 5]
    }

    fn least_w(&self) -> f64 {
        let least = |least: f64, point: &[f64; 3]| least.min(point[2]);
        self.points.iter().fold(f64::INFINITY, least)
    }

    /// Least and greatest x/w (or y/w) between -limit and limit.
    fn extent(&self, axis: usize, in_front: bool, limit: f64) -> [f64; 2] {
        if !in_front {
            return [-limit, limit];
        }
        let mut extent = [f64::INFINITY, f64::NEG_INFINITY];
        for point in &self.points {
            let ratio = point[axis] / point[2];
            extent = [extent[0].min(ratio), extent[1].max(ratio)];
        }
        extent.map(|end| end.clamp(-limit, limit))
    }
}

/// The least positive w at the corners of the frustum, its depth range being any of those in use.
fn least_w(matrix: &DMat4) -> Option<f64> {
    let determinant = matrix.determinant();
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    let inverse = matrix.inverse();
    let mut least: Option<f64> = None;
    for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        for z in [-1.0, 0.0, 1.0] {
            let w = 1.0 / (inverse * DVec4::new(x, y, z, 1.0)).w;
            if w > 0.0 && w.is_finite() {
                least = Some(least.map_or(w, |least| least.min(w)));
            }
        }
    }
    least
}
