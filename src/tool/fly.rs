//! A flight without a picture: what every frame costs, and whether its surface has cracks.

use super::bands::Bands;
use super::cracks::count_cracks;
use super::{Progress, flight, quantile};
use crate::cut::{Cut, CutOptions, DiamondSource, Stats, Terrain, Window};
use crate::lattice::Lattice;
use crate::schedule::Budget;
use crate::{Error, Result};
use std::sync::Arc;
use std::time::Instant;

/// How to fly.
pub struct Flight {
    /// Number of frames.
    pub frames: u32,
    /// Width and height of the picture in pixels.
    pub viewport: [u32; 2],
    /// Largest error on screen that need not be refined, in pixels.
    pub tolerance: f64,
    /// How to make the cut.
    pub options: CutOptions,
    /// Time for refinement in a frame; `None` sets no limit.
    pub budget_microseconds: Option<u64>,
}

/// What a flight cost. Times are in microseconds a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightReport {
    /// Number of frames.
    pub frames: u64,
    /// Median of the whole update.
    pub update_us_p50: f64,
    /// What 99 in 100 updates do not exceed.
    pub update_us_p99: f64,
    /// The longest update.
    pub update_us_max: f64,
    /// Median of the time that the present cut's new priorities took.
    pub fixed_us_p50: f64,
    /// What 99 in 100 frames do not exceed of it.
    pub fixed_us_p99: f64,
    /// Frames in which a refinement began after the deadline.
    pub budget_overruns: u64,
    /// Triangles to draw, in the mean.
    pub triangles_mean: f64,
    /// Patches to draw, in the mean.
    pub patches_mean: f64,
    /// Cracks over all frames.
    pub cracks: u64,
    /// Diamonds refined over all frames.
    pub refined_diamonds: u64,
}

/// Flies over a terrain along a fixed path, and checks every frame's whole surface for cracks.
///
/// # Errors
///
/// [`Error::Argument`] for no frames or no pixels, or a tolerance that is no positive number; those of
/// the update; [`Error::Cancelled`].
pub fn fly(terrain: &Arc<Terrain>, flight: &Flight, progress: Progress) -> Result<FlightReport> {
    check(flight)?;
    let views = flight::views(terrain, flight.frames, flight.viewport, flight.tolerance)?;
    let mut cut = Cut::new(terrain.clone(), flight.options.clone())?;
    let budget = Budget {
        microseconds: flight.budget_microseconds.unwrap_or(u64::MAX),
        ..Budget::UNLIMITED
    };
    let voids = Voids::new(terrain, cut.lattice())?;
    let mut log = Log::default();
    for (frame, view) in views.iter().enumerate() {
        if !progress(frame as u64, views.len() as u64) {
            return Err(Error::Cancelled);
        }
        let start = Instant::now();
        let stats = cut.update(view, &budget)?;
        let microseconds = start.elapsed().as_secs_f64() * 1e6;
        // As a program that draws would, so that the lists of changes do not pile up.
        cut.take_changes();
        let patches = cut.all_patches().map(Arc::as_ref);
        let cracks = count_cracks(patches, cut.lattice(), |a, b| voids.may_border(a, b));
        log.add(&stats, microseconds, cracks);
    }
    Ok(log.report())
}

fn check(flight: &Flight) -> Result<()> {
    let problem = if flight.frames == 0 {
        "a flight needs at least one frame".to_owned()
    } else if flight.viewport.contains(&0) {
        format!(
            "a picture of {} x {} has no pixels",
            flight.viewport[0], flight.viewport[1]
        )
    } else if !(flight.tolerance > 0.0 && flight.tolerance.is_finite()) {
        format!(
            "the tolerance must be a positive number of pixels, not {}",
            flight.tolerance
        )
    } else {
        return Ok(());
    };
    Err(Error::Argument(problem))
}

/// Where triangles may be missing.
struct Voids {
    width: i64,
    height: i64,
    /// Grid steps of the cut from one sample to the next.
    step: i64,
    /// One bit a sample, row by row; empty where the terrain has no void.
    bits: Vec<u64>,
}

impl Voids {
    fn new(terrain: &Terrain, grid: &Lattice) -> Result<Voids> {
        let info = terrain.raster_info();
        let (width, height) = (i64::from(info.width), i64::from(info.height));
        let mut voids = Voids {
            width,
            height,
            step: terrain.lattice().sample_step() / grid.sample_step(),
            bits: Vec::new(),
        };
        if terrain.header().void_samples == 0 {
            return Ok(voids);
        }
        voids.bits = vec![0; (width * height) as usize / 64 + 1];
        let window = Window {
            column: 0,
            row: 0,
            width: info.width,
            height: info.height,
        };
        let mut bands = Bands::new(terrain, terrain.lattice().levels(), window);
        for row in 0..info.height {
            let first = i64::from(row) * width;
            for (column, sample) in bands.row(row)?.iter().enumerate() {
                let place = first as usize + column;
                voids.bits[place / 64] |= u64::from(sample.is_nan()) << (place % 64);
            }
        }
        Ok(voids)
    }

    /// Whether one side of the segment between two vertices may be open: a triangle of samples is missing
    /// where any of its vertices is void, a coarser one only where all are.
    fn may_border(&self, a: [i64; 2], b: [i64; 2]) -> bool {
        if self.bits.is_empty() {
            return false;
        }
        let low = [0, 1].map(|axis| a[axis].min(b[axis]).div_euclid(self.step));
        let above = |place: i64| (place + self.step - 1).div_euclid(self.step);
        let high = [0, 1].map(|axis| above(a[axis].max(b[axis])));
        if high[0] - low[0] > 1 || high[1] - low[1] > 1 {
            let [a, b] = [a, b].map(|end| end.map(|along| along / self.step));
            return self.is_void(a) && self.is_void(b);
        }
        let rows = low[1] - 1..=high[1] + 1;
        rows.flat_map(|row| (low[0] - 1..=high[0] + 1).map(move |column| [column, row]))
            .any(|place| self.is_void(place))
    }

    /// Whether a sample is void or outside.
    fn is_void(&self, [column, row]: [i64; 2]) -> bool {
        if !(0..self.width).contains(&column) || !(0..self.height).contains(&row) {
            return true;
        }
        let place = (row * self.width + column) as usize;
        self.bits[place / 64] >> (place % 64) & 1 != 0
    }
}

/// What the frames so far came to.
#[derive(Default)]
struct Log {
    updates: Vec<f64>,
    fixed: Vec<f64>,
    overruns: u64,
    triangles: u64,
    patches: u64,
    cracks: u64,
    refined: u64,
}

impl Log {
    fn add(&mut self, stats: &Stats, microseconds: f64, cracks: u64) {
        self.updates.push(microseconds);
        self.fixed.push(stats.fixed_microseconds);
        self.overruns += u64::from(stats.late_refinements > 0);
        self.triangles += stats.triangles;
        self.patches += stats.patches;
        self.cracks += cracks;
        self.refined += stats.refined;
    }

    fn report(mut self) -> FlightReport {
        self.updates.sort_by(f64::total_cmp);
        self.fixed.sort_by(f64::total_cmp);
        let frames = self.updates.len() as u64;
        let mean = |sum: u64| sum as f64 / frames as f64;
        FlightReport {
            frames,
            update_us_p50: quantile(&self.updates, 0.5),
            update_us_p99: quantile(&self.updates, 0.99),
            update_us_max: quantile(&self.updates, 1.0),
            fixed_us_p50: quantile(&self.fixed, 0.5),
            fixed_us_p99: quantile(&self.fixed, 0.99),
            budget_overruns: self.overruns,
            triangles_mean: mean(self.triangles),
            patches_mean: mean(self.patches),
            cracks: self.cracks,
            refined_diamonds: self.refined,
        }
    }
}
