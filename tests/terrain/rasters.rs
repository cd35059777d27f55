//! Small rasters and the repositories made of them.

use kimberlite::build::source::RowSource;
use kimberlite::build::{BuildOptions, BuildReport, build};
use kimberlite::codec::{Matrix, Refined, child_vertices};
use kimberlite::cut::{DiamondSource, Terrain, Window, read_window};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::lattice::Diamond;
use kimberlite::store::Access;
use kimberlite::{Error, Result};
use std::collections::HashMap;
use std::path::Path;

/// A raster in memory; NaN is a void.
#[derive(Clone)]
pub struct Raster {
    pub info: RasterInfo,
    pub samples: Vec<f64>,
}

impl std::fmt::Debug for Raster {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(
            f,
            "{} x {} {:?}",
            self.info.width, self.info.height, self.info.sample_type
        )
    }
}

impl Raster {
    pub fn new(width: u32, height: u32, sample_type: SampleType, samples: Vec<f64>) -> Raster {
        assert_eq!(samples.len(), (width * height) as usize);
        Raster {
            info: RasterInfo::new(width, height, sample_type),
            samples,
        }
    }

    pub fn build(&self, path: &Path, max_error: f64, cells_log2: u32) -> Result<BuildReport> {
        self.build_with(
            path,
            &BuildOptions {
                max_error,
                cells_log2,
                ..BuildOptions::default()
            },
        )
    }

    pub fn build_with(&self, path: &Path, options: &BuildOptions) -> Result<BuildReport> {
        let options = BuildOptions {
            threads: 2,
            ..options.clone()
        };
        build(&mut self.source(), &options, path, &mut |_, _| true)
    }

    pub fn source(&self) -> RowSource {
        let (samples, width) = (self.samples.clone(), self.info.width as usize);
        let fill = move |row: u32, rows: &mut [f64]| -> Result<()> {
            rows.copy_from_slice(&samples[row as usize * width..][..rows.len()]);
            Ok(())
        };
        RowSource::new(self.info.clone(), Box::new(fill))
    }
}

/// All samples of the finest level.
pub fn decode(path: &Path, access: Access) -> Result<Vec<f64>> {
    let terrain = Terrain::open(path, access)?;
    let info = terrain.raster_info();
    let window = Window {
        column: 0,
        row: 0,
        width: info.width,
        height: info.height,
    };
    let mut samples = vec![0.0; (info.width * info.height) as usize];
    read_window(&terrain, terrain.lattice().levels(), window, &mut samples)?;
    Ok(samples)
}

/// Every diamond's vertices on its own level and, but for leaves, what refining it gives.
pub fn decode_diamonds(terrain: &Terrain) -> HashMap<Diamond, (Matrix, Option<Refined>)> {
    let lattice = terrain.lattice();
    let mut all: HashMap<Diamond, (Matrix, Option<Refined>)> = HashMap::new();
    for level in 0..=lattice.levels() {
        for diamond in lattice.diamonds(level) {
            let vertices = if level == 0 {
                terrain.root().clone()
            } else {
                let parents = lattice.parents(diamond).map(|parent| {
                    let (vertices, refined) = &all[&parent?];
                    let refined = refined.as_ref()?;
                    Some((refined.vertices(vertices), &refined.centres))
                });
                child_vertices(lattice, diamond, parents)
            };
            let refined =
                (level < lattice.levels()).then(|| terrain.refine(diamond, &vertices).unwrap());
            all.insert(diamond, (vertices, refined));
        }
    }
    all
}

/// Largest |a - b|; panics where only one is void.
pub fn max_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let mut largest = 0f64;
    for (index, (&a, &b)) in a.iter().zip(b).enumerate() {
        assert_eq!(
            a.is_nan(),
            b.is_nan(),
            "void mismatch at sample {index}: {a} against {b}"
        );
        if !a.is_nan() {
            largest = largest.max((a - b).abs());
        }
    }
    largest
}

/// The message of an error, which must be there.
pub fn message<T>(result: std::result::Result<T, Error>) -> String {
    match result {
        Ok(_) => panic!("an error was expected"),
        Err(error) => error.to_string(),
    }
}

/// A hundredth of the greatest magnitude of a sample, and of 1.
pub fn some_error(raster: &Raster) -> f64 {
    let valid = raster.samples.iter().filter(|sample| !sample.is_nan());
    0.01 * valid.fold(1.0f64, |a, sample| a.max(sample.abs()))
}
