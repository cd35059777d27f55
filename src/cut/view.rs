//! What a frame looks at.

/// A camera, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The eye.
    pub eye: [f64; 3],
    /// World to clip space, column-major, any projection.
    pub world_to_clip: [f64; 16],
    /// Width and height of the picture in pixels.
    pub viewport: [f64; 2],
    /// Largest error on screen that need not be refined, in pixels.
    pub tolerance: f64,
}
