//! Rasters that are larger than the memory that a build may take.

use crate::kmb;
use crate::kmb::Folder;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

/// A pseudorandom number from -1 to 1 at a lattice point of an octave.
fn noise(x: u64, y: u64, octave: u64) -> f64 {
    let mut bits = x.wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ octave.wrapping_mul(0x1656_67B1_9E37_79F9);
    bits = (bits ^ bits >> 31).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((bits ^ bits >> 31) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Fractal terrain as raw i16: octaves of noise between lattice points 2^12 to 2 samples apart, each with
/// 0.55 times the height of the one before.
fn write_terrain(folder: &Folder, width: u64, height: u64) -> PathBuf {
    let path = folder.path("terrain.raw");
    let mut file = BufWriter::new(std::fs::File::create(&path).unwrap());
    let mut row = vec![0f64; width as usize];
    for y in 0..height {
        row.fill(0.0);
        for octave in 0..12u64 {
            let spacing = 1u64 << (12 - octave);
            let amplitude = 1500.0 * 0.55f64.powi(octave as i32);
            let (cell, v) = (y / spacing, (y % spacing) as f64 / spacing as f64);
            let at = |x: u64| noise(x, cell, octave) * (1.0 - v) + noise(x, cell + 1, octave) * v;
            let mut left = at(0);
            for (x, samples) in row.chunks_mut(spacing as usize).enumerate() {
                let right = at(x as u64 + 1);
                let slope = (right - left) / spacing as f64;
                for (offset, sample) in samples.iter_mut().enumerate() {
                    *sample += amplitude * (left + slope * offset as f64);
                }
                left = right;
            }
        }
        for sample in &row {
            file.write_all(&(*sample as i16).to_le_bytes()).unwrap();
        }
    }
    file.flush().unwrap();
    path
}

/// With KIMBERLITE_SOAK 410 million samples in 256 MiB, which takes 1 GB of disk for them and 7 for what is kept, and
/// 10 GB of memory for the other build.
#[test]
fn a_build_keeps_within_its_memory_and_gives_the_bytes_of_one_without_limit() {
    let folder = Folder::new();
    let is_soak = std::env::var_os("KIMBERLITE_SOAK").is_some();
    let (width, height, memory) = if is_soak {
        (20480, 20000, 256u64)
    } else {
        (2100, 1900, 96)
    };
    let input = write_terrain(&folder, width, height);
    let shape = format!("{width}x{height}xi16");
    let limit = memory.to_string();
    let outputs = ["within.kmb", "without.kmb"].map(|name| folder.path(name));
    let [within, without] = &outputs;
    let run = kmb![
        "build",
        "--raw",
        &shape,
        &input,
        "-o",
        within,
        "--max-error",
        "1",
        "--memory",
        &limit,
        "--json"
    ];
    let run = run.succeeds().json();
    let number = |key: &str| run[key].as_f64().unwrap();
    println!(
        "{} samples in {} s, {:.1} MiB at most, {:.3} bits a sample",
        width * height,
        number("seconds"),
        number("peak_memory_bytes") / (1 << 20) as f64,
        number("bits_per_sample")
    );
    assert!(number("peak_memory_bytes") <= (memory << 20) as f64);
    let run = kmb![
        "build",
        "--raw",
        &shape,
        &input,
        "-o",
        without,
        "--max-error",
        "1",
        "--json"
    ];
    println!("{} s without a limit", run.succeeds().json()["seconds"]);
    let [within, without] = outputs.map(|path| std::fs::read(path).unwrap());
    assert!(
        within == without,
        "{} and {} bytes",
        within.len(),
        without.len()
    );
}
