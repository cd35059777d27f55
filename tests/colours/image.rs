//! Images in memory.

use kimberlite::build::source::RowSource;
use kimberlite::build::{BuildOptions, BuildReport, build};
use kimberlite::cut::{Layer, Window, level_size, read_window};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::store::Access;
use kimberlite::{Error, Result};
use std::path::Path;

#[derive(Clone, Debug)]
pub struct Image {
    pub info: RasterInfo,
    /// Red, green and blue of each pixel; NaN in all where it is void.
    pub numbers: Vec<f64>,
}

impl Image {
    pub fn new(
        width: u32,
        height: u32,
        sample_type: SampleType,
        pixel: impl Fn(u32, u32) -> Option<[u16; 3]>,
    ) -> Image {
        let mut info = RasterInfo::new(width, height, sample_type);
        info.bands = 3;
        let places = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let pixels = places.map(|(column, row)| pixel(column, row));
        let numbers = pixels.flat_map(|pixel| match pixel {
            Some(colour) => colour.map(f64::from),
            None => [f64::NAN; 3],
        });
        let numbers = numbers.collect();
        Image { info, numbers }
    }

    pub fn voids(&self) -> u64 {
        let pixels = self.numbers.chunks_exact(3);
        pixels.filter(|pixel| pixel[0].is_nan()).count() as u64
    }

    pub fn build(&self, path: &Path, options: &BuildOptions) -> Result<BuildReport> {
        let (numbers, mut next) = (self.numbers.clone(), 0);
        let rows = move |_: u32, samples: &mut [f64]| {
            samples.copy_from_slice(&numbers[next..next + samples.len()]);
            next += samples.len();
            Ok::<(), Error>(())
        };
        let mut source = RowSource::new(self.info.clone(), Box::new(rows));
        build(&mut source, options, path, &mut |_, _| true)
    }

    /// Largest |decoded - given| of red, green and blue; panics where only one of both is void.
    pub fn largest_error(&self, decoded: &[f64]) -> f64 {
        assert_eq!(decoded.len(), self.numbers.len());
        let pairs = decoded.iter().zip(&self.numbers);
        let errors = pairs.map(|(decoded, given)| {
            assert_eq!(decoded.is_nan(), given.is_nan());
            (decoded - given).abs()
        });
        errors.filter(|error| !error.is_nan()).fold(0.0, f64::max)
    }
}

/// All pixels of an even level, `None` for the finest.
pub fn decode(path: &Path, level: Option<u32>) -> Result<Vec<f64>> {
    let layer = Layer::open(path, Access::Map)?;
    let level = level.unwrap_or(layer.lattice().levels());
    let [width, height] = level_size(&layer, level)?;
    let mut numbers = vec![0.0; 3 * width as usize * height as usize];
    let window = Window {
        column: 0,
        row: 0,
        width,
        height,
    };
    read_window(&layer, level, window, &mut numbers)?;
    Ok(numbers)
}
