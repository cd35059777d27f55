//! A generated city on a terrain, and a flight through it. Writes one row a frame.

use clap::Parser;
use glam::DVec3;
use glam::dcamera::rh::{proj::opengl, view};
use kimberlite::blockmap::source::{ProceduralCity, generate};
use kimberlite::blockmap::{BARE_GROUND, BakeOptions, City, CityOptions, Ground, Visit, build_city};
use kimberlite::cut::{DiamondSource, Query, Terrain};
use kimberlite::geo::View;
use kimberlite::schedule::Budget;
use kimberlite::store::Access;
use kimberlite::{Error, Result};
use std::cell::RefCell;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Decoded terrain that heights may hold.
const QUERY_BYTES: u64 = 64 << 20;
const FRAME: Duration = Duration::from_micros(16_667);

/// Builds a city of so many buildings around the middle of a terrain unless its file is there, flies through it, and writes
/// a row a frame.
#[derive(Parser)]
struct Arguments {
    /// A repository of heights
    terrain: PathBuf,
    /// The city's file
    city: PathBuf,
    #[arg(long, default_value_t = 20_000)]
    buildings: usize,
    #[arg(long, default_value_t = 1)]
    seed: u32,
    /// Metres along the city
    #[arg(long, default_value_t = 4000.0)]
    side: f64,
    /// Texels along a block
    #[arg(long, default_value_t = 64)]
    k: usize,
    /// Memory of the build, in MiB
    #[arg(long, default_value_t = 1024)]
    memory: u64,
    /// Memory of the flight, in MiB
    #[arg(long, default_value_t = 64)]
    held: u64,
    #[arg(long, default_value_t = 600)]
    frames: u32,
    /// Decoding threads; with 0, frames decode
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// The table to write
    #[arg(long)]
    csv: PathBuf,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let terrain = Arc::new(Terrain::open(&arguments.terrain, Access::Map)?);
    if !arguments.city.exists() {
        build(&arguments, &terrain)?;
    }
    let city = Arc::new(City::open(&arguments.city, Access::Map)?);
    let table = fly(&arguments, &city)?;
    std::fs::write(&arguments.csv, table).map_err(Error::io(&arguments.csv, "cannot write"))
}

fn build(arguments: &Arguments, terrain: &Arc<Terrain>) -> Result<()> {
    let start = Instant::now();
    let frame = terrain.frame();
    let (lattice, side) = (terrain.lattice(), arguments.side);
    let middle = [lattice.width(), lattice.height()].map(|samples| f64::from(samples - 1) / 2.0);
    let middle = frame.grid_to_world(middle[0], middle[1]);
    let what = ProceduralCity {
        seed: arguments.seed,
        corner: middle.map(|at| at - 0.5 * side),
        side,
        buildings: arguments.buildings,
    };
    let heights = RefCell::new(Query::new(terrain.clone(), QUERY_BYTES));
    let height = |[x, y]: [f64; 2]| {
        let found = heights.borrow_mut().height_at_world(x, y);
        found.ok().flatten().map(|height| height.height)
    };
    let scene = generate(&what, &height);
    let lowest = scene.bounds().map_or(0.0, |[low, _]| low[2]);
    let query = Mutex::new(Query::new(terrain.clone(), QUERY_BYTES));
    let ground_height = |[x, y]: [f64; 2]| {
        let mut query = query.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let found = query.height_at_world(x, y).ok().flatten();
        found.map_or(lowest, |height| height.height)
    };
    let ground = Ground {
        height: &ground_height,
        spacing: frame.step[0].abs().min(frame.step[1].abs()),
        colour: BARE_GROUND,
    };
    let options = CityOptions {
        bake: BakeOptions::of(arguments.k),
        memory: Some(arguments.memory << 20),
        ..CityOptions::default()
    };
    let built = build_city(&scene, &ground, &options, &arguments.city, &mut |_, _| true)?;
    println!(
        "{} buildings, {} triangles: {} blocks, {} leaves, {} bytes, {} of {} wall texels without a column, {:.1} s",
        arguments.buildings,
        scene.triangles.len(),
        built.blocks,
        built.leaves,
        built.bytes,
        built.baked.unassigned_wall_texels,
        built.baked.wall_texels,
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

/// In from the south, low through the middle, turning, and up and away.
fn camera(city: &City, share: f64) -> View {
    let tree = city.tree();
    let [low, high] = tree.nodes[0].heights.map(f64::from);
    let at = |x: f64, y: f64, z: f64| {
        DVec3::new(
            tree.corner[0] + x * tree.side,
            tree.corner[1] + y * tree.side,
            low + 0.5 * (high - low) + z,
        )
    };
    let height = 80.0 + 0.4 * tree.side * (2.0 * share - 1.0).powi(4);
    let turn = 1.57 + 2.5 * (share * 4.0).sin();
    let eye = at(0.5 + 0.15 * (share * 6.0).sin(), 1.6 * share - 0.3, height);
    let ahead = DVec3::new(turn.cos(), turn.sin(), -0.25 - 0.3 * height / tree.side);
    let lens = opengl::perspective(0.9, 1.25, 1.0, 8.0 * tree.side);
    let camera = view::look_to_mat4(eye, ahead.normalize(), DVec3::Z);
    View {
        eye: eye.to_array(),
        world_to_clip: (lens * camera).to_cols_array(),
        viewport: [1280.0, 1024.0],
        tolerance: 1.0,
    }
}

fn fly(arguments: &Arguments, city: &Arc<City>) -> Result<String> {
    let mut visit = Visit::new(city.clone(), arguments.threads)?;
    let budget = Budget {
        bytes: arguments.held << 20,
        microseconds: 4000,
        ..Budget::UNLIMITED
    };
    let mut table = String::from("frame,microseconds,drawn,partial,resident_bytes,loaded,awaited,largest_error\n");
    let mut times = Vec::new();
    let (mut drawn, mut partial, mut most) = (0, 0, 0);
    for frame in 0..arguments.frames {
        let begin = Instant::now();
        let view = camera(city, f64::from(frame) / f64::from(arguments.frames));
        let stats = visit.update(&view, &budget)?;
        times.push(stats.microseconds);
        (drawn, partial) = (drawn + stats.drawn, partial + stats.partial);
        most = stats.bytes.max(most);
        let error = if stats.largest_error.is_finite() { stats.largest_error } else { 1e9 };
        let _ = writeln!(
            table,
            "{frame},{:.1},{},{},{},{},{},{error:.3}",
            stats.microseconds, stats.drawn, stats.partial, stats.bytes, stats.loaded, stats.awaited
        );
        std::thread::sleep(FRAME.saturating_sub(begin.elapsed()));
    }
    times.sort_by(f64::total_cmp);
    let quantile = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!(
        "{} frames: p50 {:.0} us, p99 {:.0} us, largest {:.0} us; {drawn} drawn, {:.2} % partial; at most {:.1} of {} MiB",
        arguments.frames,
        quantile(0.5),
        quantile(0.99),
        quantile(1.0),
        100.0 * partial as f64 / drawn.max(1) as f64,
        most as f64 / f64::from(1 << 20),
        arguments.held
    );
    Ok(table)
}
