//! Three flights over a repository: triangles against the error on the screen, the time of a frame against its patches,
//! and how a cut recovers from a jump.

mod camera;
mod csv;
mod cuts;
mod finest;
mod flights;
mod screen;
mod sweep;
mod times;

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Parser, ValueEnum};
use kimberlite::cut::Terrain;
use kimberlite::store::Access;

use finest::Finest;
use flights::Stage;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Triangles against the error on the screen.
    Screen,
    /// Time of an update against patches.
    Frame,
    /// Recovery from a jump.
    Jump,
}

#[derive(Parser)]
struct Options {
    /// The repository to fly over.
    file: PathBuf,
    /// Folder of the figures; their names end in that of the repository.
    #[arg(long, default_value = "docs/charts")]
    out: PathBuf,
    /// What to measure.
    #[arg(long, value_delimiter = ',', default_value = "screen,frame,jump")]
    parts: Vec<Part>,
    /// Frames of a flight.
    #[arg(long, default_value_t = 600)]
    frames: u32,
    /// The error on the screen is measured in the first of so many frames.
    #[arg(long, default_value_t = 10)]
    every: usize,
    /// Pixels from one sample of the screen to the next, across and down.
    #[arg(long, default_value_t = 2)]
    pixels: u32,
    /// Threads that fly, for what is not timed.
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

fn main() {
    if let Err(error) = run(&Options::parse()) {
        eprintln!("flights: {error}");
        std::process::exit(2);
    }
}

fn run(options: &Options) -> Result<()> {
    if options.frames < 2 || options.every == 0 || options.pixels == 0 || options.threads == 0 {
        return Err("a flight has at least two frames, and counts are at least 1".into());
    }
    let terrain = Arc::new(Terrain::open(&options.file, Access::Map)?);
    let finest = Finest::read(&terrain)?;
    finest.agrees_with_queries(&terrain)?;
    let flights = Stage::new(&terrain, &finest)?.flights(options.frames);
    let stem = options.file.file_stem().unwrap_or_default();
    let stem = stem.to_string_lossy().into_owned();
    std::fs::create_dir_all(&options.out)?;
    let path = |kind: &str| options.out.join(format!("{kind}_{stem}.csv"));
    for part in &options.parts {
        match part {
            Part::Screen => {
                for flight in &flights {
                    let sampling = sweep::Sampling {
                        every: options.every,
                        pixels: options.pixels,
                        threads: options.threads,
                    };
                    let table = sweep::measure(&terrain, &finest, flight, &sampling)?;
                    table.write(&path(&format!("flight_{}", flight.name)))?;
                }
            }
            Part::Frame => times::frames(&terrain, &flights)?.write(&path("frame"))?,
            Part::Jump => times::jump(&terrain, &flights)?.write(&path("jump"))?,
        }
    }
    Ok(())
}
