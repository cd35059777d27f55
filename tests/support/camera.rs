//! Views.

use glam::{DMat4, DVec3, DVec4};
use kimberlite::cut::View;

/// Width and height of every picture.
pub const VIEWPORT: [f64; 2] = [1280.0, 1024.0];

/// Conventions of the depth range.
#[derive(Clone, Copy, Debug)]
pub enum Depth {
    /// -1 at the near plane, 1 at the far one.
    MinusOneToOne,
    /// 0 at the near plane, 1 at the far one.
    ZeroToOne,
    /// 1 at the near plane, 0 infinitely far away.
    Reversed,
}

/// A perspective view from `eye` towards `target`, 60 degrees high.
pub fn looking(eye: [f64; 3], target: [f64; 3], near: f64, tolerance: f64) -> View {
    looking_with(Depth::MinusOneToOne, eye, target, near, tolerance)
}

/// The same with a convention of depth.
pub fn looking_with(
    depth: Depth,
    eye: [f64; 3],
    target: [f64; 3],
    near: f64,
    tolerance: f64,
) -> View {
    let (position, ahead) = (DVec3::from(eye), DVec3::from(target) - DVec3::from(eye));
    let up = if ahead.truncate().length() > 0.01 * ahead.z.abs() {
        DVec3::Z
    } else {
        DVec3::Y
    };
    let far = 1000.0 * ahead.length() + near;
    let ahead = ahead.normalize();
    let right = ahead.cross(up).normalize();
    let camera = DMat4::from_cols(
        right.extend(-right.dot(position)),
        right.cross(ahead).extend(-right.cross(ahead).dot(position)),
        (-ahead).extend(ahead.dot(position)),
        DVec4::W,
    )
    .transpose();
    let focal = 1.0 / 30f64.to_radians().tan();
    let (a, b) = match depth {
        Depth::MinusOneToOne => ((far + near) / (near - far), 2.0 * far * near / (near - far)),
        Depth::ZeroToOne => (far / (near - far), far * near / (near - far)),
        Depth::Reversed => (0.0, near),
    };
    let lens = DMat4::from_cols(
        DVec4::new(focal * VIEWPORT[1] / VIEWPORT[0], 0.0, 0.0, 0.0),
        DVec4::new(0.0, focal, 0.0, 0.0),
        DVec4::new(0.0, 0.0, a, -1.0),
        DVec4::new(0.0, 0.0, b, 0.0),
    );
    let world_to_clip = (lens * camera).to_cols_array();
    View {
        eye,
        world_to_clip,
        viewport: VIEWPORT,
        tolerance,
    }
}

/// Pixel position of a world point and its w, by a view.
pub fn project(view: &View, point: [f64; 3]) -> ([f64; 2], f64) {
    let clip = DMat4::from_cols_array(&view.world_to_clip) * DVec3::from(point).extend(1.0);
    let pixel = |value: f64, size: f64| (value / clip.w + 1.0) / 2.0 * size;
    (
        [
            pixel(clip.x, view.viewport[0]),
            pixel(clip.y, view.viewport[1]),
        ],
        clip.w,
    )
}
