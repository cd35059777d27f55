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
    /// Largest error on screen that need not be refined, in pixels, by the measure of what is drawn.
    pub tolerance: f64,
}

impl View {
    /// The view to come if the camera moves on so many times as it did from `before`; the same where that had another
    /// viewport.
    pub(crate) fn after(&self, before: &View, times: f64) -> View {
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
