//! Repositories of sources in memory.

use super::memory::MemorySource;
use kimberlite::build::source::RowSource;
use kimberlite::build::{BuildOptions, build};
use kimberlite::cut::{DiamondSource, Terrain};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::store::Access;
use kimberlite::tool;
use std::path::Path;
use std::sync::Arc;

/// The repository of a source's raster, in the same world.
pub fn repository(source: &MemorySource, options: &BuildOptions) -> Arc<Terrain> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    build_at(&path, source, options);
    let terrain = Terrain::open(&path, Access::Map).unwrap();
    assert_eq!(terrain.frame(), source.frame());
    assert_eq!(terrain.height_to_world(), source.height_to_world());
    Arc::new(terrain)
}

/// Builds the same at a path.
pub fn build_at(path: &Path, source: &MemorySource, options: &BuildOptions) {
    let raster = &source.raster;
    let mut info = RasterInfo::new(raster.width, raster.height, SampleType::I16);
    let (frame, [offset, scale]) = (source.frame(), source.height_to_world());
    let ([x, y], [dx, dy]) = (frame.origin, frame.step);
    info.geotransform = [x, dx, 0.0, y, 0.0, dy];
    (info.value_offset, info.value_scale) = (offset, scale);
    let sample = |sample: &Option<i32>| sample.map_or(f64::NAN, f64::from);
    let samples: Vec<f64> = raster.samples.iter().map(sample).collect();
    let width = raster.width as usize;
    let fill = move |row: u32, rows: &mut [f64]| {
        rows.copy_from_slice(&samples[row as usize * width..][..rows.len()]);
        Ok(())
    };
    let mut rows = RowSource::new(info, Box::new(fill));
    build(&mut rows, options, path, &mut |_, _| true).unwrap();
}

/// The same after some of its bytes, in these parts of the blocks, were changed, and a repair.
pub fn repaired_repository(
    source: &MemorySource,
    options: &BuildOptions,
    places: &[f64],
) -> Arc<Terrain> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    build_at(&path, source, options);
    let mut bytes = std::fs::read(&path).unwrap();
    let blocks = u64::from_le_bytes(bytes[272..280].try_into().unwrap()) as usize;
    for place in places {
        let place = blocks + ((bytes.len() - blocks) as f64 * place) as usize;
        if let Some(byte) = bytes.get_mut(place) {
            *byte ^= 1;
        }
    }
    std::fs::write(&path, bytes).unwrap();
    tool::repair(&path, &path, &mut |_, _| true).unwrap();
    Arc::new(Terrain::open(&path, Access::Map).unwrap())
}
