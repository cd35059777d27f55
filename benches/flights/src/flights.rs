//! Three flights, chosen from where the land is flat and where it is steep.

use kimberlite::cut::Terrain;

use crate::Result;
use crate::camera::Shot;
use crate::finest::Finest;

/// Blocks along each side whose relief (highest less lowest sample) is compared.
const BLOCKS: usize = 16;
/// Directions in which the low flight is tried.
const DIRECTIONS: usize = 16;
/// Frames to either side of which the highest ground, and then the mean, gives the height of an eye that follows the ground.
const SMOOTHING: usize = 15;
/// Height of the mixed and of the low flight above the ground, in spacings of samples.
const CLEARANCE: [f64; 2] = [30.0, 5.0];
/// Degrees below the horizon at which the flights look.
const DIPS: [f64; 3] = [15.0, 6.0, 40.0];

/// A camera path.
pub struct Flight {
    pub name: &'static str,
    pub shots: Vec<Shot>,
}

/// A block of samples.
#[derive(Clone, Copy)]
struct Block {
    at: [usize; 2],
    /// World units.
    relief: f64,
}

/// The land, as the flights see it.
pub struct Stage<'a> {
    finest: &'a Finest,
    blocks: Vec<Block>,
    /// World units from one sample to the next, in the mean of both axes.
    spacing: f64,
    /// Along the world's axes.
    sides: [f64; 2],
    middle_height: f64,
}

impl Stage<'_> {
    /// # Errors
    ///
    /// Where all land is void.
    pub fn new<'a>(terrain: &Terrain, finest: &'a Finest) -> Result<Stage<'a>> {
        let step = finest.frame().step.map(f64::abs);
        let [width, height] = finest.size();
        let info = terrain.raster_info();
        let middle = (terrain.header().sample_min + terrain.header().sample_max) / 2.0;
        let cells = (0..BLOCKS * BLOCKS).map(|index| [index % BLOCKS, index / BLOCKS]);
        let blocks: Vec<Block> = cells
            .filter_map(|at| {
                Some(Block {
                    at,
                    relief: relief(finest, at)?,
                })
            })
            .collect();
        if blocks.is_empty() {
            return Err("there is no block of land without voids to fly over".into());
        }
        Ok(Stage {
            finest,
            blocks,
            spacing: (step[0] * step[1]).sqrt(),
            sides: [(width - 1) as f64 * step[0], (height - 1) as f64 * step[1]],
            middle_height: info.value_offset + info.value_scale * middle,
        })
    }

    /// The three flights.
    pub fn flights(&self, frames: u32) -> Vec<Flight> {
        let flattest = self
            .blocks
            .iter()
            .min_by(|a, b| a.relief.total_cmp(&b.relief));
        let steepest = self
            .blocks
            .iter()
            .max_by(|a, b| a.relief.total_cmp(&b.relief));
        let ends = [flattest, steepest].map(|block| self.centre(block.map_or([0; 2], |b| b.at)));
        let low = self.steepest_line(ends[1]);
        vec![
            self.line("mixed", frames, ends, CLEARANCE[0], DIPS[0]),
            self.line("low", frames, low, CLEARANCE[1], DIPS[1]),
            self.circle("overview", frames),
        ]
    }

    fn longest_side(&self) -> f64 {
        self.sides[0].max(self.sides[1])
    }

    /// World x and y of a block's middle.
    fn centre(&self, at: [usize; 2]) -> [f64; 2] {
        let size = self.finest.size();
        let [column, row] =
            [0, 1].map(|axis| (at[axis] as f64 + 0.5) / BLOCKS as f64 * (size[axis] - 1) as f64);
        self.finest.frame().grid_to_world(column, row)
    }

    /// The line of three blocks' length through a place over which the mean relief of blocks is greatest.
    fn steepest_line(&self, middle: [f64; 2]) -> [[f64; 2]; 2] {
        let half = 1.5 * self.sides[0].min(self.sides[1]) / BLOCKS as f64;
        let lines = (0..DIRECTIONS).map(|direction| {
            let turn = direction as f64 * std::f64::consts::TAU / DIRECTIONS as f64;
            let along = [turn.sin() * half, turn.cos() * half];
            [-1.0, 1.0].map(|sign| [middle[0] + sign * along[0], middle[1] + sign * along[1]])
        });
        let steepness = |line: &[[f64; 2]; 2]| -> f64 {
            let places = (0..=30).map(|k| between(*line, f64::from(k) / 30.0));
            places.map(|place| self.relief_at(place)).sum()
        };
        lines
            .max_by(|a, b| steepness(a).total_cmp(&steepness(b)))
            .unwrap_or([middle; 2])
    }

    /// Relief of the block at a place; 0 outside.
    fn relief_at(&self, [x, y]: [f64; 2]) -> f64 {
        let grid = self.finest.frame().world_to_grid(x, y);
        let size = self.finest.size();
        let at = [0, 1].map(|axis| (grid[axis] / (size[axis] - 1) as f64 * BLOCKS as f64).floor());
        let found = self
            .blocks
            .iter()
            .find(|block| block.at.map(|k| k as f64) == at);
        found.map_or(0.0, |block| block.relief)
    }

    /// A straight flight that follows the ground.
    fn line(
        &self,
        name: &'static str,
        frames: u32,
        ends: [[f64; 2]; 2],
        clearance: f64,
        dip: f64,
    ) -> Flight {
        let share = |frame: u32| f64::from(frame) / f64::from(frames - 1);
        let places: Vec<[f64; 2]> = (0..frames)
            .map(|frame| between(ends, share(frame)))
            .collect();
        let ground = |&place: &[f64; 2]| self.finest.height_at_world(place).unwrap_or(f64::NAN);
        let grounds: Vec<f64> = places.iter().map(ground).collect();
        let highest = around(&grounds, |near| {
            near.iter().copied().fold(f64::NAN, f64::max)
        });
        let smooth = around(&highest, |near| {
            near.iter().sum::<f64>() / near.len() as f64
        });
        let clearance = clearance * self.spacing;
        let heading = [0, 1].map(|axis| ends[1][axis] - ends[0][axis]);
        let planes = [clearance / 20.0, 4.0 * self.longest_side()];
        let shots = places.iter().zip(smooth).map(|(&[x, y], ground)| {
            let ground = if ground.is_nan() {
                self.middle_height
            } else {
                ground
            };
            Shot::new([x, y, ground + clearance], heading, dip, planes)
        });
        let shots = shots.collect();
        Flight { name, shots }
    }

    /// A full circle high above, looking to the middle.
    fn circle(&self, name: &'static str, frames: u32) -> Flight {
        let side = self.longest_side();
        let size = self.finest.size();
        let last = size.map(|side| (side - 1) as f64 / 2.0);
        let [x, y] = self.finest.frame().grid_to_world(last[0], last[1]);
        let height = self.middle_height + 0.5 * side;
        let radius = 0.5 * side / DIPS[2].to_radians().tan();
        let shots = (0..frames).map(|frame| {
            let turn = f64::from(frame) / f64::from(frames) * std::f64::consts::TAU;
            let out = [turn.sin(), -turn.cos()];
            let eye = [x + radius * out[0], y + radius * out[1], height];
            Shot::new(
                eye,
                out.map(|axis| -axis),
                DIPS[2],
                [side / 100.0, 4.0 * side],
            )
        });
        let shots = shots.collect();
        Flight { name, shots }
    }
}

fn between([a, b]: [[f64; 2]; 2], share: f64) -> [f64; 2] {
    [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]))
}

/// For each value one of those around it.
fn around(values: &[f64], pick: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let near =
        |at: usize| &values[at.saturating_sub(SMOOTHING)..(at + SMOOTHING + 1).min(values.len())];
    (0..values.len()).map(|at| pick(near(at))).collect()
}

/// Highest less lowest sample of a block; `None` where there is a void or the block has no area.
fn relief(finest: &Finest, at: [usize; 2]) -> Option<f64> {
    let size = finest.size();
    let [columns, rows] = [0, 1].map(|axis| {
        let end = |k: usize| k * (size[axis] - 1) / BLOCKS;
        end(at[axis])..end(at[axis] + 1) + 1
    });
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    for row in rows {
        for column in columns.clone() {
            let z = finest.sample(column, row);
            if z.is_nan() {
                return None;
            }
            ends = [ends[0].min(z), ends[1].max(z)];
        }
    }
    Some(ends[1] - ends[0])
}
