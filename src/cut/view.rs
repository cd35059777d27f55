//! What a frame looks at, and what an error is.

/// A camera, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The eye.
    pub eye: [f64; 3],
    /// World to clip space, column-major, any projection.
    pub world_to_clip: [f64; 16],
    /// Width and height of the picture in pixels.
    pub viewport: [f64; 2],
    /// Largest error on screen that need not be refined, in pixels, by the cut's [`Metric`].
    pub tolerance: f64,
}

impl View {
    /// The view to come if the camera moves on so many times as it did from `before`; the same where that had another
    /// viewport.
    pub(super) fn after(&self, before: &View, times: f64) -> View {
        if self.viewport != before.viewport {
            return *self;
        }
        let on = |now: f64, before: f64| now + times * (now - before);
        View {
            eye: std::array::from_fn(|axis| on(self.eye[axis], before.eye[axis])),
            world_to_clip: std::array::from_fn(|entry| {
                on(self.world_to_clip[entry], before.world_to_clip[entry])
            }),
            ..*self
        }
    }
}

/// What is projected on the screen as a diamond's error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// The stored error: how far the screen position of a point of the finest surface is at most from that of the drawn
    /// point at the same place. Where a cut is not cut short, no measured error exceeds the tolerance.
    #[default]
    Geometric,
    /// The side of a square as large as a triangle in the mean: the root of a half's projected box over its triangles
    /// (thesis of Di Benedetto, View-Space and Object-Space Errors). A density; it bounds no error. The finest diamonds
    /// have 0.
    Sampling,
}
