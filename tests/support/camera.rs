//! Views.

use glam::{DMat4, DVec3};
use kimberlite::cut::View;

/// A perspective view with OpenGL's depth from `eye` towards `target`, 60 degrees high.
pub fn looking(eye: [f64; 3], target: [f64; 3], near: f64, tolerance: f64) -> View {
    let viewport = [1280.0, 1024.0];
    let forward = DVec3::from(target) - DVec3::from(eye);
    let up = if forward.truncate().length() > 0.01 * forward.z.abs() { DVec3::Z } else { DVec3::Y };
    let camera = DMat4::look_at_rh(eye.into(), target.into(), up);
    let lens = DMat4::perspective_rh_gl(
        60f64.to_radians(),
        viewport[0] / viewport[1],
        near,
        1000.0 * forward.length() + near,
    );
    View { eye, world_to_clip: (lens * camera).to_cols_array(), viewport, tolerance }
}

/// Pixel position of a world point and its w, by a view.
pub fn project(view: &View, point: [f64; 3]) -> ([f64; 2], f64) {
    let clip = DMat4::from_cols_array(&view.world_to_clip) * DVec3::from(point).extend(1.0);
    let pixel = |value: f64, size: f64| (value / clip.w + 1.0) / 2.0 * size;
    ([pixel(clip.x, view.viewport[0]), pixel(clip.y, view.viewport[1])], clip.w)
}
