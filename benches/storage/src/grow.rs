//! A repository of any size, of the blocks of a smaller one again and again. Its terrain is nonsense; its header, root, tables,
//! index and blocks are as long and as sound as those of a real one.

use std::path::Path;

use kimberlite::codec::{Model, RootCodec};
use kimberlite::cut::Layer;
use kimberlite::lattice::Lattice;
use kimberlite::store::{Header, Writer};

use crate::engine::Result;

/// Writes a repository of about `bytes` at `path`. Returns its length.
pub fn grow(source: &Layer, bytes: u64, path: &Path) -> Result<u64> {
    let (header, store) = (source.header(), source.store());
    let factor = (bytes as f64 / store.file_bytes() as f64).sqrt();
    let [width, height] = [header.raster.width, header.raster.height]
        .map(|side| (f64::from(side) * factor).round() as u32);
    let lattice = Lattice::new(width, height, u32::from(header.cells_log2))?;
    let mut header = Header {
        levels: lattice.levels() as u8,
        block_count: lattice.diamond_count(),
        samples: u64::from(width) * u64::from(height),
        ..header.clone()
    };
    (header.raster.width, header.raster.height) = (width, height);
    let tables = source.model().map_or_else(Vec::new, |model| {
        let last = model.levels() - 1;
        let groups =
            (0..lattice.levels()).map(|level| (model.level(level.min(last)).clone(), level + 1));
        let (listed, components) = (model.listed.clone(), model.components());
        Model::new(model.adaptive, listed, components, groups.collect()).to_bytes()
    });
    let mut writer = Writer::create(path, &header, &root(source, &lattice), &tables)?;
    let mut codes = Vec::with_capacity(header.block_count as usize);
    let mut scratch = Vec::new();
    for rank in 0..header.block_count {
        let rank = rank % store.header().block_count;
        writer.push(store.block(rank, &mut scratch)?)?;
        let record = store.record(rank)?;
        codes.push([record.error_code, record.low_code, record.high_code]);
    }
    Ok(writer.finish(&header, &codes)?)
}

/// The source's root over a larger raster.
fn root(source: &Layer, lattice: &Lattice) -> Vec<u8> {
    let components = source.components();
    let transforms = components.transforms(source.header().transform, lattice.cells());
    let codec = RootCodec::new(lattice, components.quantisers(&transforms, None));
    let (root, side) = (source.root(), lattice.cells() + 1);
    let spacing = 1i64 << (lattice.levels() / 2);
    codec.encode(|component, at| {
        let [column, row] = at.map(|place| (place / spacing) as usize);
        Some(root.values[(component * side + row) * side + column])
    })
}
