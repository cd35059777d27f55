//! Triangles against the error on the screen, for both metrics and for uniform resolution.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use kimberlite::cut::{Metric, Terrain};
use kimberlite::schedule::Budget;

use crate::Result;
use crate::csv::{Table, number, quantile};
use crate::cuts::Rule;
use crate::finest::Finest;
use crate::flights::Flight;
use crate::screen::{Screen, Worst};

/// Tolerances of both metrics in pixels.
const TOLERANCES: [f64; 7] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0];
/// The coarsest uniform level.
const COARSEST: u32 = 2;

/// How densely errors are sampled.
pub struct Sampling {
    /// Measured is the first of so many frames.
    pub every: usize,
    /// Pixels from one sample to the next, across and down.
    pub pixels: u32,
    /// Rules that are measured at once.
    pub threads: usize,
}

/// What a rule comes to along a flight, over the frames that were measured.
struct Outcome {
    triangles: f64,
    patches: f64,
    /// Samples of the screen, and other points, of all frames.
    samples: usize,
    points: u64,
    mean: f64,
    p99: f32,
    p999: f32,
    worst: Option<Worst>,
    /// Frames that a budget cut short.
    cut_short: usize,
}

/// One row for each rule.
pub fn measure(
    terrain: &Arc<Terrain>,
    finest: &Finest,
    flight: &Flight,
    sampling: &Sampling,
) -> Result<Table> {
    let rules = rules(terrain.lattice().levels());
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        while let Some(&rule) = rules.get(next.fetch_add(1, Ordering::Relaxed)) {
            let outcome = fly(terrain, finest, flight, rule, sampling);
            if let Ok(mut found) = found.lock() {
                found.push((rule, outcome));
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..sampling.threads {
            scope.spawn(work);
        }
    });
    let mut found = found.into_inner().map_err(|_| "a flight failed")?;
    found.sort_by_key(|(rule, _)| rules.iter().position(|other| other == rule));
    println!("{}:", flight.name);
    let mut table = Table::new(
        "cut,setting,triangles,patches,samples,points,error_mean,error_p99,error_p999,error_max,cut_short",
    );
    for (rule, outcome) in found {
        let outcome = outcome?;
        table.add(&row(rule, &outcome));
        tell_breach(rule, &outcome);
    }
    Ok(table)
}

/// Says where the geometric metric did not keep its tolerance, should that be.
fn tell_breach(rule: Rule, outcome: &Outcome) {
    let (Rule::Metric(Metric::Geometric, tolerance), Some(worst)) = (rule, outcome.worst) else {
        return;
    };
    if worst.pixels > tolerance && outcome.cut_short == 0 {
        let Worst {
            pixels,
            frame,
            place,
        } = worst;
        eprintln!(
            "flights: {pixels} pixels at a tolerance of {tolerance}: frame {frame}, drawn point and finest height {place:?}"
        );
    }
}

fn rules(levels: u32) -> Vec<Rule> {
    let by = |metric: Metric| TOLERANCES.map(|tolerance| Rule::Metric(metric, tolerance));
    let uniform = (COARSEST.min(levels)..=levels).map(Rule::Uniform);
    [by(Metric::Geometric), by(Metric::Sampling)]
        .into_iter()
        .flatten()
        .chain(uniform)
        .collect()
}

fn row(rule: Rule, outcome: &Outcome) -> Vec<String> {
    let (name, setting) = rule.name();
    vec![
        name.to_owned(),
        number(setting),
        number(outcome.triangles),
        number(outcome.patches),
        outcome.samples.to_string(),
        outcome.points.to_string(),
        number(outcome.mean),
        number(f64::from(outcome.p99)),
        number(f64::from(outcome.p999)),
        number(outcome.worst.map_or(0.0, |worst| worst.pixels)),
        outcome.cut_short.to_string(),
    ]
}

fn fly(
    terrain: &Arc<Terrain>,
    finest: &Finest,
    flight: &Flight,
    rule: Rule,
    sampling: &Sampling,
) -> kimberlite::Result<Outcome> {
    let (mut cut, tolerance) = rule.cut(terrain)?;
    let mut screen = Screen::new(finest, sampling.pixels);
    let (mut triangles, mut patches, mut measured, mut cut_short) = (0, 0, 0, 0);
    for (frame, shot) in flight.shots.iter().enumerate() {
        let stats = cut.update(&shot.with_tolerance(tolerance), &Budget::UNLIMITED)?;
        cut.take_changes();
        cut_short += usize::from(stats.cut_short);
        if frame % sampling.every == 0 {
            // The leaf level is the finest surface.
            if rule != Rule::Uniform(terrain.lattice().levels()) {
                screen.measure(&cut, shot, frame);
            }
            triangles += stats.triangles;
            patches += stats.patches;
            measured += 1;
        }
    }
    let mean = |sum: u64| sum as f64 / f64::from(measured);
    let sum = screen
        .errors
        .iter()
        .fold(0.0, |sum, &error| sum + f64::from(error));
    let samples = screen.errors.len();
    if samples == 0 {
        screen.errors.push(0.0);
    }
    Ok(Outcome {
        triangles: mean(triangles),
        patches: mean(patches),
        samples,
        points: screen.points,
        mean: sum / samples.max(1) as f64,
        p99: quantile(&mut screen.errors, 0.99),
        p999: quantile(&mut screen.errors, 0.999),
        worst: screen.worst,
        cut_short,
    })
}
