//! Views, and points on them.

use glam::dcamera::rh::{proj::opengl, view};
use glam::{DMat3, DVec3};
use kimberlite::cut::View;

/// Width and height of the picture in pixels.
pub const VIEWPORT: [f64; 2] = [1280.0, 1024.0];
/// Vertical field of view in radians.
const FIELD_OF_VIEW: f64 = std::f64::consts::FRAC_PI_3;

/// A view, and its near plane.
#[derive(Clone, Copy)]
pub struct Shot {
    pub view: View,
    /// Distance of the near plane, which is the w of what lies on it.
    pub near: f64,
}

impl Shot {
    /// From `eye` in a direction over the ground, `dip` degrees below the horizon.
    pub fn new(eye: [f64; 3], [east, north]: [f64; 2], dip: f64, [near, far]: [f64; 2]) -> Shot {
        let ahead = DVec3::new(east, north, 0.0).normalize();
        let dip = dip.to_radians();
        let direction = ahead * dip.cos() - DVec3::Z * dip.sin();
        let up = ahead * dip.sin() + DVec3::Z * dip.cos();
        let lens = opengl::perspective(FIELD_OF_VIEW, VIEWPORT[0] / VIEWPORT[1], near, far);
        let matrix = lens * view::look_to_mat4(DVec3::from(eye), direction, up);
        let view = View {
            eye,
            world_to_clip: matrix.to_cols_array(),
            viewport: VIEWPORT,
            tolerance: 1.0,
        };
        Shot { view, near }
    }

    pub fn with_tolerance(&self, tolerance: f64) -> View {
        View {
            tolerance,
            ..self.view
        }
    }
}

/// From the world to pixels and back.
pub struct Lens {
    /// Rows x, y and w of the matrix, and what they add.
    rows: DMat3,
    shift: DVec3,
    inverse: DMat3,
    pub near: f64,
}

impl Lens {
    pub fn new(shot: &Shot) -> Lens {
        let m = &shot.view.world_to_clip;
        let column = |at: usize| DVec3::new(m[at], m[at + 1], m[at + 3]);
        let rows = DMat3::from_cols(column(0), column(4), column(8));
        Lens {
            rows,
            shift: column(12),
            inverse: rows.inverse(),
            near: shot.near,
        }
    }

    /// Clip x, y and w of a world point.
    pub fn clip(&self, point: DVec3) -> DVec3 {
        self.rows * point + self.shift
    }

    /// Pixels of clip x, y and w.
    pub fn pixel(clip: DVec3) -> [f64; 2] {
        [
            (clip.x / clip.z + 1.0) / 2.0 * VIEWPORT[0],
            (clip.y / clip.z + 1.0) / 2.0 * VIEWPORT[1],
        ]
    }

    /// Pixels of a world point in front of the near plane.
    pub fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        let clip = self.clip(point);
        (clip.z >= self.near).then(|| Lens::pixel(clip))
    }

    /// The world point under a pixel at distance w.
    pub fn place(&self, pixel: [f64; 2], w: f64) -> DVec3 {
        let ratio = |axis: usize| (2.0 * pixel[axis] / VIEWPORT[axis] - 1.0) * w;
        self.inverse * (DVec3::new(ratio(0), ratio(1), w) - self.shift)
    }
}

/// Whether a pixel lies in the picture.
pub fn in_picture(pixel: [f64; 2]) -> bool {
    (0.0..=VIEWPORT[0]).contains(&pixel[0]) && (0.0..=VIEWPORT[1]).contains(&pixel[1])
}
