//! A whole raster as the bytes of a repository in memory, and back.

use std::path::Path;

use crate::build::source::InMemory;
use crate::build::{BuildOptions, BuildReport, build_into};
use crate::cut::{DiamondSource, Terrain, Window, read_window};
use crate::geo::{RasterInfo, Sample};
use crate::store::MemorySink;
use crate::{Error, Result};

/// What stands for the path of bytes in memory.
const NAME: &str = "(bytes)";

/// The bytes of the repository of a raster of heights in memory: those of a file.
///
/// # Errors
///
/// Those of [`InMemory::new`] and [`build_into`].
pub fn pack<T: Sample>(
    info: RasterInfo,
    samples: &[T],
    options: &BuildOptions,
) -> Result<(Vec<u8>, BuildReport)> {
    let mut source = InMemory::new(info, samples)?;
    let sink = MemorySink::default();
    let into = Box::new(sink.clone());
    let report = build_into(&mut source, options, Path::new(NAME), into, &mut |_, _| {
        true
    })?;
    Ok((sink.take(), report))
}

/// The repository that bytes are.
///
/// # Errors
///
/// Those of [`Terrain::of_bytes`].
pub fn open_packed(bytes: &[u8]) -> Result<Terrain> {
    let mut own = Vec::new();
    own.try_reserve_exact(bytes.len())
        .map_err(|_| Error::Argument(format!("{} bytes exceed the memory", bytes.len())))?;
    own.extend_from_slice(bytes);
    Terrain::of_bytes(Path::new(NAME), own)
}

/// All samples of a repository's finest level, row by row. A void becomes the raster's nodata value, or NaN where it
/// has none.
///
/// # Errors
///
/// [`Error::Argument`] where `samples` are of another type or count, or cannot hold a void; [`Error::Missing`] where
/// detail is missing, so that the promised error cannot be kept; those of reading and decoding blocks.
pub fn unpack<T: Sample>(terrain: &Terrain, samples: &mut [T]) -> Result<()> {
    let info = terrain.raster_info();
    let count = info.row_length() as u64 * u64::from(info.height);
    if T::TYPE != info.sample_type || samples.len() as u64 != count {
        return Err(Error::Argument(format!(
            "{} {} for {count} {} samples",
            samples.len(),
            T::TYPE.name(),
            info.sample_type.name()
        )));
    }
    let void = match info.nodata {
        Some(nodata) => nodata,
        None if T::TYPE.is_integer() && terrain.header().void_samples > 0 => {
            return Err(Error::Argument(format!(
                "{} samples have no value for voids, of which there are some",
                T::TYPE.name()
            )));
        }
        None => f64::NAN,
    };
    let mut values = Vec::new();
    values
        .try_reserve_exact(samples.len())
        .map_err(|_| Error::Argument(format!("{count} samples exceed the memory")))?;
    values.resize(samples.len(), 0.0);
    let window = Window {
        column: 0,
        row: 0,
        width: info.width,
        height: info.height,
    };
    let coarse = read_window(terrain, terrain.lattice().levels(), window, &mut values)?;
    if coarse.count() > 0 {
        return Err(Error::Missing {
            path: terrain.store().path().to_path_buf(),
            message: format!("the detail of {} samples", coarse.count()),
        });
    }
    for (sample, value) in samples.iter_mut().zip(values) {
        *sample = T::nearest(if value.is_nan() { void } else { value });
    }
    Ok(())
}
