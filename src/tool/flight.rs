//! The camera path of `fly`: the same for every run over a terrain.

use crate::Result;
use crate::cut::{Query, Terrain, View};
use crate::geo::Frame;
use glam::DVec3;
use glam::dcamera::rh::{proj::opengl, view};
use std::sync::Arc;

/// Vertical field of view in radians.
const FIELD_OF_VIEW: f64 = std::f64::consts::FRAC_PI_3;
/// Decoded data that the look-up of ground heights may hold.
const QUERY_BYTES: u64 = 64 << 20;
/// Frames to either side over which the ground's height is averaged.
const SMOOTHING: usize = 8;

/// A moment of the path. Lengths are shares of the terrain's longer side.
struct Keyframe {
    /// Share of the whole path.
    time: f64,
    /// Place over the terrain: shares of its width and depth from its lower left corner.
    place: [f64; 2],
    /// Height above the ground.
    clearance: f64,
    /// Direction in degrees, clockwise from north.
    heading: f64,
    /// Degrees below the horizon.
    dip: f64,
}

/// Overview, descent, low flight across, turns on the spot, and back up.
const PATH: [Keyframe; 7] = [
    Keyframe {
        time: 0.0,
        place: [0.5, -0.6],
        clearance: 0.7,
        heading: 0.0,
        dip: 35.0,
    },
    Keyframe {
        time: 0.2,
        place: [0.1, 0.0],
        clearance: 0.4,
        heading: 30.0,
        dip: 40.0,
    },
    Keyframe {
        time: 0.4,
        place: [0.15, 0.15],
        clearance: 0.01,
        heading: 45.0,
        dip: 12.0,
    },
    Keyframe {
        time: 0.7,
        place: [0.75, 0.7],
        clearance: 0.006,
        heading: 50.0,
        dip: 8.0,
    },
    Keyframe {
        time: 0.85,
        place: [0.78, 0.73],
        clearance: 0.01,
        heading: 320.0,
        dip: 10.0,
    },
    Keyframe {
        time: 0.92,
        place: [0.7, 0.75],
        clearance: 0.05,
        heading: 240.0,
        dip: 60.0,
    },
    Keyframe {
        time: 1.0,
        place: [0.6, 0.6],
        clearance: 0.6,
        heading: 225.0,
        dip: 89.0,
    },
];

/// The views of `frames` frames over a terrain.
pub(super) fn views(
    terrain: &Arc<Terrain>,
    frames: u32,
    viewport: [u32; 2],
    tolerance: f64,
) -> Result<Vec<View>> {
    let stage = Stage::new(terrain);
    let mut query = Query::new(terrain.clone(), QUERY_BYTES);
    let moments: Vec<Keyframe> = (0..frames)
        .map(|frame| moment(f64::from(frame) / f64::from(frames.max(2) - 1)))
        .collect();
    let mut grounds = Vec::with_capacity(moments.len());
    for moment in &moments {
        let [x, y] = stage.position(moment.place);
        let found = query.height_at_world(x, y)?;
        grounds.push(found.map_or(stage.middle_height, |found| found.height));
    }
    let viewport = viewport.map(f64::from);
    let view = |(frame, moment): (usize, &Keyframe)| {
        let around = frame.saturating_sub(SMOOTHING)..(frame + SMOOTHING + 1).min(grounds.len());
        let ground = grounds[around.clone()].iter().sum::<f64>() / around.len() as f64;
        stage.view(moment, ground, viewport, tolerance)
    };
    Ok(moments.iter().enumerate().map(view).collect())
}

/// Between the keyframes, with a smooth start and stop at each.
fn moment(time: f64) -> Keyframe {
    let next = PATH
        .iter()
        .position(|key| key.time >= time)
        .unwrap_or(PATH.len() - 1)
        .max(1);
    let (from, to) = (&PATH[next - 1], &PATH[next]);
    let share = ((time - from.time) / (to.time - from.time)).clamp(0.0, 1.0);
    let share = share * share * (3.0 - 2.0 * share);
    let mix = |a: f64, b: f64| a + (b - a) * share;
    Keyframe {
        time,
        place: [
            mix(from.place[0], to.place[0]),
            mix(from.place[1], to.place[1]),
        ],
        // Heights shrink and grow by the same share a frame.
        clearance: from.clearance * (to.clearance / from.clearance).powf(share),
        heading: mix(from.heading, to.heading),
        dip: mix(from.dip, to.dip),
    }
}

/// Where the terrain lies in the world.
struct Stage {
    low: [f64; 2],
    high: [f64; 2],
    middle_height: f64,
}

impl Stage {
    fn new(terrain: &Terrain) -> Stage {
        let header = terrain.header();
        let raster = &header.raster;
        let frame = Frame::of(raster);
        let first = frame.grid_to_world(0.0, 0.0);
        let last = [
            f64::from(raster.width) - 1.0,
            f64::from(raster.height) - 1.0,
        ];
        let last = frame.grid_to_world(last[0], last[1]);
        let middle = (header.sample_min + header.sample_max) / 2.0;
        Stage {
            low: [first[0].min(last[0]), first[1].min(last[1])],
            high: [first[0].max(last[0]), first[1].max(last[1])],
            middle_height: raster.value_scale * middle + raster.value_offset,
        }
    }

    fn position(&self, place: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| {
            self.low[axis] + place[axis] * (self.high[axis] - self.low[axis])
        })
    }

    fn view(&self, moment: &Keyframe, ground: f64, viewport: [f64; 2], tolerance: f64) -> View {
        let side = (self.high[0] - self.low[0]).max(self.high[1] - self.low[1]);
        let [x, y] = self.position(moment.place);
        let clearance = moment.clearance * side;
        let eye = DVec3::new(x, y, ground + clearance);
        let (heading, dip) = (moment.heading.to_radians(), moment.dip.to_radians());
        let ahead = DVec3::new(heading.sin(), heading.cos(), 0.0);
        let direction = ahead * dip.cos() - DVec3::Z * dip.sin();
        let up = ahead * dip.sin() + DVec3::Z * dip.cos();
        let aspect = viewport[0] / viewport[1];
        let (near, far) = (clearance / 20.0, 4.0 * side);
        let projection = opengl::perspective(FIELD_OF_VIEW, aspect, near, far);
        let world_to_clip = projection * view::look_to_mat4(eye, direction, up);
        View {
            eye: eye.to_array(),
            world_to_clip: world_to_clip.to_cols_array(),
            viewport,
            tolerance,
        }
    }
}
