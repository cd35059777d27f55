//! An opened repository of heights or of colours: the file, its lattice and its codec in one.

use super::shared::Shared;
use super::source::Summary;
use crate::codec::{
    BlockCodec, ColourUnits, Components, ErrorCode, Matrix, Model, Outline, RangeCode, Refined,
    RootCodec, Units,
};
use crate::geo::RasterInfo;
use crate::lattice::{Diamond, Lattice};
use crate::store::{Access, DomainKind, EntropyKind, Header, Kind, Store};
use crate::{Error, Result};
use std::path::Path;

/// Samples in a repository, decoded diamond by diamond. Any number of threads may share one.
pub struct Layer {
    store: Store,
    lattice: Lattice,
    components: Components,
    codec: BlockCodec,
    root: Matrix,
    shared: Option<Shared>,
}

impl Layer {
    /// Opens a repository and decodes its root.
    ///
    /// # Errors
    ///
    /// Those of [`Store::open`]; [`Error::Version`] for kinds, transforms and coders that this version
    /// does not know; [`Error::Damaged`] where header and content contradict each other.
    pub fn open(path: &Path, access: Access) -> Result<Layer> {
        Layer::of_store(Store::open(path, access)?)
    }

    /// As [`open`](Layer::open), a repository that is only bytes; `name` stands for its path in errors.
    pub fn of_bytes(name: &Path, bytes: Vec<u8>) -> Result<Layer> {
        Layer::of_store(Store::of_bytes(name, bytes)?)
    }

    /// As [`open`](Layer::open), also a file that was cut off behind its index ([`Store::open_damaged`]).
    pub fn open_damaged(path: &Path) -> Result<Layer> {
        Layer::of_store(Store::open_damaged(path)?)
    }

    fn of_store(store: Store) -> Result<Layer> {
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
        let components =
            components_of(header).map_err(|error| damaged(format!("header: {error}")))?;
        let cells = lattice.cells();
        let transforms = components.transforms(header.transform, cells);
        let root = RootCodec::new(&lattice, components.quantisers(&transforms, None))
            .decode(store.roots())
            .map_err(|error| damaged(format!("roots: {error}")))?;
        let matrices = transforms
            .iter()
            .map(|transform| transform.matrices())
            .sum();
        let model =
            match header.entropy {
                EntropyKind::Gamma => None,
                EntropyKind::Rans => {
                    let (tables, count) = (store.tables(), components.count());
                    let model = Model::from_bytes(tables, lattice.levels(), matrices, count);
                    let model = model.filter(|model| count == 1 || model.listed.is_none());
                    Some(model.ok_or_else(|| {
                        damaged("tables: they are not what a builder writes".into())
                    })?)
                }
            };
        let listed = model.as_ref().and_then(|model| model.listed.clone());
        let quantisers = components.quantisers(&transforms, listed);
        let mut codec = BlockCodec::new(cells, header.void_samples > 0, transforms);
        if let Some(model) = model {
            let symbols = components.coders(cells, quantisers, model.adaptive);
            codec = codec.with_symbols(symbols).with_model(model);
        }
        Ok(Layer {
            lattice,
            components,
            codec,
            root,
            store,
            shared: None,
        })
    }

    /// Keeps up to so many bytes of decoded diamonds for all that use the layer, beside what they hold themselves; 0 for
    /// none.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a number of bytes that cannot be.
    pub fn sharing(mut self, bytes: u64) -> Result<Layer> {
        let each = self.lattice.cells().pow(2) * self.components.count() * size_of::<i32>();
        self.shared = match bytes {
            0 => None,
            _ => Some(Shared::new(bytes, each as u64)?),
        };
        Ok(self)
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

    /// What codes and decodes its blocks.
    pub fn codec(&self) -> &BlockCodec {
        &self.codec
    }

    /// From integer units to samples.
    pub fn components(&self) -> &Components {
        &self.components
    }

    /// The raster that the repository was built from.
    pub fn raster_info(&self) -> &RasterInfo {
        &self.header().raster
    }

    /// The diamonds that there are.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The root's vertex matrix.
    pub fn root(&self) -> &Matrix {
        &self.root
    }

    /// Error and range of a refinable diamond, as [`DiamondSource::summary`](super::DiamondSource); of
    /// colours, the error is the largest of the components', and the range the luma's.
    ///
    /// # Errors
    ///
    /// Those of reading the index.
    pub fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary> {
        let record = self.store.record(self.lattice.rank(diamond))?;
        let range = RangeCode {
            low: record.low_code,
            high: record.high_code,
        };
        Ok(Summary {
            error: ErrorCode(record.error_code).value(),
            range: range.range(parent_range),
            is_missing: record.is_missing,
        })
    }

    /// The samples of a refinable diamond on the next level, given its vertex matrix.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] where the block was lost in a repair, else whatever keeps it from being read or decoded.
    pub fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        match &self.shared {
            Some(shared) => shared.get(diamond, || self.decode(diamond, vertices)),
            None => self.decode(diamond, vertices),
        }
    }

    fn decode(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
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

impl std::fmt::Debug for Layer {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_tuple("Layer").field(&self.store.path()).finish()
    }
}

fn require_known(path: &Path, header: &Header) -> Result<()> {
    let known = header.kind != Kind::City && header.domain == DomainKind::Planar;
    if known {
        return Ok(());
    }
    Err(Error::Version {
        path: path.to_path_buf(),
        message: format!(
            "this version reads planar heights and colours, not {:?} {:?}",
            header.domain, header.kind
        ),
    })
}

fn components_of(header: &Header) -> Result<Components> {
    if header.kind == Kind::Colours {
        let bound = header.bound_units as i32;
        return ColourUnits::with_bound(&header.raster, bound).map(Components::Colour);
    }
    Ok(Components::Height(Units {
        scale: header.unit_scale,
        offset: header.unit_offset,
        range: [header.unit_min, header.unit_max],
        sample_range: [header.sample_min, header.sample_max],
        bound: header.bound_units as i32,
        sample_type: header.raster.sample_type,
        nodata: header.raster.nodata,
    }))
}
