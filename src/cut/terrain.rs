//! An opened repository as a surface: heights, and where they lie.

use super::layer::Layer;
use super::source::{DiamondSource, Summary};
use crate::codec::{Components, Matrix, Refined, Units};
use crate::geo::{Frame, RasterInfo};
use crate::lattice::{Diamond, Lattice};
use crate::store::Access;
use crate::{Error, Result};
use std::ops::Deref;
use std::path::Path;
use std::sync::Arc;

/// A [`Layer`] of heights. Any number of threads may share one.
pub struct Terrain {
    layer: Arc<Layer>,
    units: Units,
    frame: Frame,
}

impl Terrain {
    /// Opens a repository of heights and decodes its root.
    ///
    /// # Errors
    ///
    /// Those of [`Layer::open`] and of [`of`](Self::of).
    pub fn open(path: &Path, access: Access) -> Result<Terrain> {
        Terrain::of(Arc::new(Layer::open(path, access)?))
    }

    /// As [`open`](Terrain::open), a repository that is only bytes; `name` stands for its path in errors.
    pub fn of_bytes(name: &Path, bytes: Vec<u8>) -> Result<Terrain> {
        Terrain::of(Arc::new(Layer::of_bytes(name, bytes)?))
    }

    /// The surface of a layer.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] for a layer of colours.
    pub fn of(layer: Arc<Layer>) -> Result<Terrain> {
        let units = match layer.components() {
            Components::Height(units) => units.clone(),
            Components::Colour(_) => {
                let text = "it holds colours, and heights are needed";
                return Err(Error::input(layer.store().path(), text));
            }
        };
        Ok(Terrain {
            units,
            frame: Frame::of(layer.raster_info()),
            layer,
        })
    }

    /// The repository.
    pub fn layer(&self) -> &Arc<Layer> {
        &self.layer
    }

    /// From integer units to the raster's samples.
    pub fn units(&self) -> &Units {
        &self.units
    }
}

impl Deref for Terrain {
    type Target = Layer;

    fn deref(&self) -> &Layer {
        &self.layer
    }
}

impl DiamondSource for Terrain {
    fn lattice(&self) -> &Lattice {
        self.layer.lattice()
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn georeference(&self) -> Option<&RasterInfo> {
        Some(self.layer.raster_info())
    }

    fn height_to_world(&self) -> [f64; 2] {
        let info = self.layer.raster_info();
        [
            info.value_offset + info.value_scale * self.units.offset,
            info.value_scale * self.units.scale,
        ]
    }

    fn has_voids(&self) -> bool {
        self.layer.header().void_samples > 0
    }

    fn root(&self) -> &Matrix {
        self.layer.root()
    }

    fn range(&self) -> [i32; 2] {
        self.units.range
    }

    fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary> {
        self.layer.summary(diamond, parent_range)
    }

    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        self.layer.refine(diamond, vertices)
    }
}
