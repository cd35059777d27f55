//! An opened repository of heights: the file, its lattice and its codec in one.

use super::source::{DiamondSource, Summary};
use crate::codec::{
    BlockCodec, ErrorCode, Matrix, Model, Outline, RangeCode, Refined, RootCodec, SymbolCoder,
    Units,
};
use crate::geo::{Frame, RasterInfo};
use crate::lattice::{Diamond, Lattice};
use crate::store::{Access, DomainKind, EntropyKind, Header, Kind, Store};
use crate::{Error, Result};
use std::path::Path;

/// Heights in a repository, decoded diamond by diamond. Any number of threads may share one.
pub struct Terrain {
    store: Store,
    lattice: Lattice,
    units: Units,
    codec: BlockCodec,
    frame: Frame,
    root: Matrix,
}

impl Terrain {
    /// Opens a repository and decodes its root.
    ///
    /// # Errors
    ///
    /// Those of [`Store::open`]; [`Error::Version`] for kinds, transforms and coders that this version
    /// does not know; [`Error::Damaged`] where header and content contradict each other.
    pub fn open(path: &Path, access: Access) -> Result<Terrain> {
        Terrain::of_store(Store::open(path, access)?)
    }

    /// As [`open`](Terrain::open), a repository that is only bytes; `name` stands for its path in errors.
    pub fn of_bytes(name: &Path, bytes: Vec<u8>) -> Result<Terrain> {
        Terrain::of_store(Store::of_bytes(name, bytes)?)
    }

    fn of_store(store: Store) -> Result<Terrain> {
        let (path, header) = (store.path(), store.header());
        require_known(path, header)?;
        let info = &header.raster;
        let damaged = |message: String| Error::damaged(path, message);
        let lattice = Lattice::new(info.width, info.height, u32::from(header.cells_log2))
            .map_err(|error| damaged(format!("header: {error}")))?;
        let consistent = lattice.levels() == u32::from(header.levels)
            && lattice.diamond_count() == header.block_count
            && header.unit_min <= header.unit_max
            && header.bound_units < 1 << 30;
        if !consistent {
            return Err(damaged("header: its numbers contradict each other".into()));
        }
        let units = units_of(header);
        let (kind, cells) = (header.transform, lattice.cells());
        let transform = kind.transform(cells, units.bound, units.range);
        let root = RootCodec::new(&lattice, units.bound, transform.range())
            .decode(store.roots())
            .map_err(|error| damaged(format!("roots: {error}")))?;
        let mut codec = BlockCodec::new(cells, header.void_samples > 0, transform);
        if header.entropy == EntropyKind::Rans {
            let model = Model::from_bytes(store.tables(), lattice.levels(), codec.matrices())
                .ok_or_else(|| damaged("tables: they are not what a builder writes".into()))?;
            let quantiser = units.quantiser(model.listed.clone());
            let symbols = SymbolCoder::new(cells, quantiser, model.adaptive, true);
            codec = codec.with_symbols(symbols).with_model(model);
        }
        let frame = Frame::of(info);
        Ok(Terrain {
            lattice,
            units,
            codec,
            frame,
            root,
            store,
        })
    }

    /// What the file says of itself.
    pub fn header(&self) -> &Header {
        self.store.header()
    }

    /// The file.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The trained weights and tables, if it has any.
    pub fn model(&self) -> Option<&Model> {
        self.codec.model()
    }

    /// From integer units to the raster's samples.
    pub fn units(&self) -> &Units {
        &self.units
    }

    /// The raster that the repository was built from.
    pub fn raster_info(&self) -> &RasterInfo {
        &self.header().raster
    }
}

impl DiamondSource for Terrain {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn height_to_world(&self) -> [f64; 2] {
        let info = self.raster_info();
        [
            info.value_offset + info.value_scale * self.units.offset,
            info.value_scale * self.units.scale,
        ]
    }

    fn root(&self) -> &Matrix {
        &self.root
    }

    fn range(&self) -> [i32; 2] {
        self.units.range
    }

    fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary> {
        let record = self.store.record(self.lattice.rank(diamond))?;
        let range = RangeCode {
            low: record.low_code,
            high: record.high_code,
        };
        Ok(Summary {
            error: ErrorCode(record.error_code).value(),
            range: range.range(parent_range),
        })
    }

    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        let mut scratch = Vec::new();
        let block = self.store.block(self.lattice.rank(diamond), &mut scratch)?;
        let outline = Outline::of(&self.lattice, diamond);
        self.codec
            .decode(vertices, &outline, block)
            .map_err(|error| {
                let (level, Diamond { x, y, .. }) = (diamond.level(), diamond);
                let message = format!("the block of diamond ({x}, {y}) of level {level}: {error}");
                Error::damaged(self.store.path(), message)
            })
    }
}

fn require_known(path: &Path, header: &Header) -> Result<()> {
    let known = header.kind == Kind::Heights && header.domain == DomainKind::Planar;
    if known {
        return Ok(());
    }
    Err(Error::Version {
        path: path.to_path_buf(),
        message: format!(
            "this version reads planar heights, not {:?} {:?}",
            header.domain, header.kind
        ),
    })
}

fn units_of(header: &Header) -> Units {
    Units {
        scale: header.unit_scale,
        offset: header.unit_offset,
        range: [header.unit_min, header.unit_max],
        sample_range: [header.sample_min, header.sample_max],
        bound: header.bound_units as i32,
        sample_type: header.raster.sample_type,
        nodata: header.raster.nodata,
    }
}
