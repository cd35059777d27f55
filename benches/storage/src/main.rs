//! The blocks of a repository, in its own file, in LMDB, in redb and in SQLite: what the file costs, and what a look-up.

mod engine;
mod grow;
mod lmdb;
mod measure;
mod redb_file;
mod report;
mod repository;
mod sqlite;

use std::path::{Path, PathBuf};

use clap::Parser;
use kimberlite::cut::Layer;
use kimberlite::store::Access;

use engine::{Blocks, Engine, Result};
use measure::Figures;
use report::Report;

/// Rounds of the warm measurements, engine after engine.
const ROUNDS: u64 = 7;

#[derive(Parser)]
struct Options {
    /// The repository whose blocks are stored.
    file: PathBuf,
    /// Instead of the file, one of so many MiB of its blocks, repeated.
    #[arg(long, value_name = "MIB")]
    grow: Option<u64>,
    /// Where the files are made, and removed afterwards.
    #[arg(long, default_value = "target/storage")]
    folder: PathBuf,
    /// Also writes the figures here.
    #[arg(long)]
    csv: Option<PathBuf>,
}

fn main() {
    if let Err(error) = run(&Options::parse()) {
        eprintln!("storage: {error}");
        std::process::exit(2);
    }
}

fn run(options: &Options) -> Result<()> {
    std::fs::create_dir_all(&options.folder)?;
    let folder = tempfile::tempdir_in(&options.folder)?;
    let file = match options.grow {
        None => options.file.clone(),
        Some(mib) => {
            let grown = folder.path().join("grown.kmb");
            grow::grow(&Layer::open(&options.file, Access::Map)?, mib << 20, &grown)?;
            grown
        }
    };
    let report = measure_all(&file, folder.path())?;
    print!("{}", report.table());
    if let Some(csv) = &options.csv {
        std::fs::write(csv, report.csv())?;
    }
    Ok(())
}

/// All blocks of a repository, and what else its file holds.
fn read(file: &Path) -> Result<(Blocks, Report)> {
    let layer = Layer::open(file, Access::Map)?;
    let (store, header) = (layer.store(), layer.header());
    let mut blocks = Blocks {
        bytes: Vec::new(),
        ends: Vec::new(),
    };
    let mut scratch = Vec::new();
    for rank in 0..header.block_count {
        blocks.bytes.extend(store.block(rank, &mut scratch)?);
        blocks.ends.push(blocks.bytes.len());
    }
    let report = Report {
        file_bytes: store.file_bytes(),
        roots_and_tables: (store.roots().len() + store.tables().len()) as u64,
        payload: blocks.bytes.len() as u64,
        blocks: header.block_count,
        valid_samples: header.samples - header.void_samples,
        cells: 1 << header.cells_log2,
        engines: Vec::new(),
    };
    Ok((blocks, report))
}

fn measure_all(file: &Path, folder: &Path) -> Result<Report> {
    let (blocks, mut report) = read(file)?;
    if report.blocks == 0 {
        return Err("it has no blocks".into());
    }
    let [lmdb, redb, sqlite] = ["lmdb", "redb", "sqlite"].map(|name| folder.join(name));
    lmdb::Lmdb::write(&lmdb, &blocks)?;
    redb_file::Redb::write(&redb, &blocks)?;
    sqlite::Sqlite::write(&sqlite, &blocks)?;
    drop(blocks);
    let size = [report.blocks, report.payload];
    let mut all = [
        begin::<repository::Repository>(file, size)?,
        begin::<lmdb::Lmdb>(&lmdb, size)?,
        begin::<redb_file::Redb>(&redb, size)?,
        begin::<sqlite::Sqlite>(&sqlite, size)?,
    ];
    all[0].bytes -= report.roots_and_tables;
    {
        let ours = warm::<repository::Repository>(file, size)?;
        let lmdb = warm::<lmdb::Lmdb>(&lmdb, size)?;
        let redb = warm::<redb_file::Redb>(&redb, size)?;
        let sqlite = warm::<sqlite::Sqlite>(&sqlite, size)?;
        let [first, second, third, fourth] = &mut all;
        for seed in 1..=ROUNDS {
            measure::round(&ours, size, seed, first)?;
            measure::round(&lmdb, size, seed, second)?;
            measure::round(&redb, size, seed, third)?;
            measure::round(&sqlite, size, seed, fourth)?;
        }
    }
    let [first, second, third, fourth] = &mut all;
    measure::cold::<repository::Repository>(file, report.blocks, first)?;
    measure::cold::<lmdb::Lmdb>(&lmdb, report.blocks, second)?;
    measure::cold::<redb_file::Redb>(&redb, report.blocks, third)?;
    measure::cold::<sqlite::Sqlite>(&sqlite, report.blocks, fourth)?;
    report.engines = all.into();
    Ok(report)
}

/// The figures of a file that is not open.
fn begin<E: Engine>(path: &Path, [blocks, _]: [u64; 2]) -> Result<Figures> {
    let mut figures = Figures {
        name: E::NAME,
        bytes: std::fs::metadata(path)?.len(),
        ..Figures::default()
    };
    measure::open::<E>(path, blocks, &mut figures)?;
    Ok(figures)
}

fn warm<E: Engine>(path: &Path, [blocks, _]: [u64; 2]) -> Result<E> {
    let engine = E::open(path)?;
    measure::warm(&engine, blocks)?;
    Ok(engine)
}
