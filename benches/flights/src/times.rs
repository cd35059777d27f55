//! What takes time: a frame, by its patches, and the way back to full quality after a jump.

use std::sync::Arc;

use kimberlite::cut::{Metric, Terrain};
use kimberlite::schedule::Budget;

use crate::Result;
use crate::csv::{Table, number, quantile};
use crate::cuts;
use crate::flights::Flight;

/// Patches at which the sweep of frame times ends.
const MOST_PATCHES: u64 = 4000;
/// Patches at which it begins, or at the first tolerance that has more.
const LEAST_PATCHES: u64 = 40;
/// From the coarsest tolerance on, in pixels, each is the one before divided by the factor.
const COARSEST: f64 = 256.0;
const FACTOR: f64 = 1.25;
const FINEST: f64 = 0.01;
/// Where a finer tolerance does not add patches by this factor, all that can be seen is refined.
const GROWTH: f64 = 1.02;
/// Updates that settle a cut before frames are timed.
const SETTLING: usize = 3;
/// Budgets of the frames after a jump, in microseconds.
const BUDGETS: [u64; 4] = [500, 1000, 4000, Budget::NO_LIMIT];
/// Seconds from one frame to the next, or longer if the update takes longer.
const FRAME: f64 = 1.0 / 60.0;
/// Frames after which a jump counts as one that does not end.
const MOST_FRAMES: usize = 20_000;
/// Tolerance after the jump, in pixels.
const TOLERANCE: f64 = 1.0;

fn flight<'a>(flights: &'a [Flight], name: &str) -> Result<&'a Flight> {
    let found = flights.iter().find(|flight| flight.name == name);
    found.ok_or_else(|| format!("there is no flight {name}").into())
}

/// Times of updates along the overview, one row for each tolerance, in microseconds.
pub fn frames(terrain: &Arc<Terrain>, flights: &[Flight]) -> Result<Table> {
    let flight = flight(flights, "overview")?;
    let mut table = Table::new("tolerance,patches,fixed_p50,update_p50,update_p99,refined_mean");
    let (mut tolerance, mut most) = (COARSEST, 0);
    while tolerance >= FINEST && most < MOST_PATCHES {
        let mut cut = cuts::cut(terrain.clone(), Metric::Geometric)?;
        for _ in 0..SETTLING {
            cut.update(
                &flight.shots[0].with_tolerance(tolerance),
                &Budget::UNLIMITED,
            )?;
        }
        let [mut patches, mut fixed, mut update] = [(); 3].map(|()| Vec::new());
        let mut refined = 0;
        for shot in &flight.shots {
            let stats = cut.update(&shot.with_tolerance(tolerance), &Budget::UNLIMITED)?;
            cut.take_changes();
            patches.push(stats.patches as f64);
            fixed.push(stats.fixed_microseconds);
            update.push(stats.microseconds);
            refined += stats.refined;
        }
        let middle = quantile(&mut patches, 0.5);
        if most >= LEAST_PATCHES && middle < GROWTH * most as f64 {
            break;
        }
        most = middle as u64;
        if most >= LEAST_PATCHES {
            table.add(&[
                number(tolerance),
                number(middle),
                number(quantile(&mut fixed, 0.5)),
                number(quantile(&mut update, 0.5)),
                number(quantile(&mut update, 0.99)),
                number(refined as f64 / flight.shots.len() as f64),
            ]);
        }
        tolerance /= FACTOR;
    }
    if most < MOST_PATCHES {
        println!("frame: this terrain shows at most {most} patches; the chart ends there");
    }
    Ok(table)
}

/// From the first view of the overview to the middle of the low flight: what is left to refine, frame by frame.
pub fn jump(terrain: &Arc<Terrain>, flights: &[Flight]) -> Result<Table> {
    let from = flight(flights, "overview")?.shots[0].with_tolerance(TOLERANCE);
    let low = &flight(flights, "low")?.shots;
    let to = low[low.len() / 2].with_tolerance(TOLERANCE);
    let mut table =
        Table::new("budget,frame,milliseconds,update_microseconds,largest_error,refined");
    for microseconds in BUDGETS {
        let mut cut = cuts::cut(terrain.clone(), Metric::Geometric)?;
        for _ in 0..SETTLING {
            cut.update(&from, &Budget::UNLIMITED)?;
        }
        // What the old cut is worth in the new view.
        let frozen = Budget {
            refinements: 0,
            ..Budget::UNLIMITED
        };
        let name = match microseconds {
            Budget::NO_LIMIT => "unlimited".to_owned(),
            limit => limit.to_string(),
        };
        let before = cut.update(&to, &frozen)?.largest_error;
        let mut row = |frame: usize, seconds: f64, update: f64, error: f64, refined: u64| {
            let numbers = [1e3 * seconds, update, error].map(number);
            let [milliseconds, update, error] = numbers;
            let (frame, refined) = (frame.to_string(), refined.to_string());
            table.add(&[name.clone(), frame, milliseconds, update, error, refined]);
        };
        row(0, 0.0, 0.0, before, 0);
        let (mut seconds, mut refined) = (0.0f64, 0);
        let budget = Budget {
            microseconds,
            ..Budget::UNLIMITED
        };
        for frame in 1..=MOST_FRAMES {
            let stats = cut.update(&to, &budget)?;
            cut.take_changes();
            refined += stats.refined;
            let update = stats.microseconds;
            // What a frame refines is on the screen when its update is done.
            row(
                frame,
                seconds + 1e-6 * update,
                update,
                stats.largest_error,
                refined,
            );
            seconds += FRAME.max(1e-6 * update);
            if !stats.cut_short && stats.refined == 0 {
                break;
            }
        }
    }
    Ok(table)
}
