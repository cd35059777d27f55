//! What a cut's diamonds consist of: heights, and colours if it has any.

use super::DiamondSource;
use super::beyond::{Beyond, Detail};
use super::colours::{Colouring, Colours, RefinedTexels, Texels};
use crate::Result;
use crate::codec::{Matrix, Refined};
use crate::lattice::{Diamond, Lattice, gather_half, reflect_absent_half};
use std::sync::Arc;

/// Where a cut's diamonds come from.
#[derive(Clone)]
pub(super) struct Ground {
    pub heights: Arc<dyn DiamondSource>,
    pub colours: Option<Arc<Colours>>,
    /// A mask of vertices of heights, all of them valid.
    all_valid: Arc<[u8]>,
}

/// A diamond on its own level; only halves that have arrived mean anything, and an absent half mirrors them.
#[derive(Clone)]
pub(super) struct Samples {
    pub heights: Matrix,
    pub texels: Option<Texels>,
}

/// A diamond on the next level.
pub(super) struct Finer {
    pub heights: Refined,
    pub texels: Option<RefinedTexels>,
}

impl Ground {
    /// Heights and colours, as deep as both of them and the detail.
    ///
    /// # Errors
    ///
    /// Those of [`Beyond::new`] and [`Colours::new`].
    pub fn of(
        source: Arc<dyn DiamondSource>,
        colouring: Option<&Colouring>,
        detail: Detail,
    ) -> Result<Ground> {
        let own = source.lattice().levels();
        let finest = colouring.map_or(0, |colouring| colouring.layer.lattice().levels());
        let levels = detail.levels.max(finest.saturating_sub(own));
        let colours = colouring.map(|colouring| Colours::new(colouring, &*source, own + levels));
        let side = source.lattice().cells() + 1;
        Ok(Ground {
            colours: colours.transpose()?.map(Arc::new),
            heights: match levels {
                0 => source,
                _ => Arc::new(Beyond::new(source, Detail { levels, ..detail })?),
            },
            all_valid: vec![1; side * side].into(),
        })
    }

    pub fn root(&self) -> Samples {
        Samples {
            heights: self.heights.root().clone(),
            texels: self.colours.as_ref().map(|colours| colours.root()),
        }
    }

    /// Storage for a diamond.
    pub fn empty(&self) -> Samples {
        Samples {
            heights: Matrix {
                values: vec![0; self.all_valid.len()].into(),
                valid: None,
            },
            texels: self.colours.as_ref().map(|colours| colours.empty()),
        }
    }

    /// # Errors
    ///
    /// Those of [`DiamondSource::refine`]; colours that cannot be had are estimated.
    pub fn refine(&self, diamond: Diamond, own: &Samples) -> Result<Finer> {
        let heights = self.heights.refine(diamond, &own.heights)?;
        let both = self.colours.as_ref().zip(own.texels.as_ref());
        let texels = both.map(|(colours, texels)| colours.refine(diamond, texels));
        Ok(Finer { heights, texels })
    }

    /// Fills a half of `to` from its parent's samples on its level, and the absent half by reflection.
    pub fn receive_half(
        &self,
        (from, parent, finer): (Diamond, &Samples, &Finer),
        (to, child): (Diamond, &mut Samples),
        half: usize,
    ) {
        let matrices = (
            finer.heights.vertices(&parent.heights),
            &finer.heights.centres,
        );
        receive_half(
            self.heights.lattice(),
            (from, matrices),
            (to, &mut child.heights),
            half,
            &self.all_valid,
        );
        if let (Some(colours), Some(above), Some(finer), Some(texels)) = (
            &self.colours,
            &parent.texels,
            &finer.texels,
            &mut child.texels,
        ) {
            let matrices = (
                finer.refined.vertices(&above.matrix),
                &finer.refined.centres,
            );
            receive_half(
                colours.lattice(),
                (from, matrices),
                (to, &mut texels.matrix),
                half,
                colours.all_valid(),
            );
            texels.is_estimated |= finer.is_estimated;
        }
    }

    /// Whether there are finer colours of a diamond than those of its own level.
    ///
    /// # Errors
    ///
    /// Those of reading the colours' index.
    pub fn has_finer_texels(&self, diamond: Diamond) -> Result<bool> {
        let colours = self.colours.as_ref();
        colours.map_or(Ok(false), |colours| colours.has_finer(diamond))
    }

    /// Bytes of a diamond on one level, and of its masks.
    pub fn bytes(&self) -> [u64; 2] {
        let heights = self.all_valid.len() as u64;
        let colours = self.colours.as_ref().map(|colours| colours.own_bytes());
        let [values, mask] = colours.unwrap_or_default();
        [heights * size_of::<i32>() as u64 + values, heights + mask]
    }
}

impl Samples {
    /// Makes it storage for another diamond.
    pub fn clear(&mut self) {
        self.heights.valid = None;
        if let Some(texels) = &mut self.texels {
            (texels.matrix.valid, texels.is_estimated) = (None, false);
        }
    }
}

/// Of one matrix, all components.
fn receive_half(
    lattice: &Lattice,
    (from, (vertices, centres)): (Diamond, (&Matrix, &Matrix)),
    (to, child): (Diamond, &mut Matrix),
    half: usize,
    all_valid: &[u8],
) {
    let (cells, count) = (lattice.cells(), all_valid.len());
    let absent = lattice.halves(to).iter().position(|present| !present);
    let absent = absent.map(|half| lattice.apexes(to)[half]);
    let own = vertices.values.chunks_exact(count);
    let sources = own.zip(centres.values.chunks_exact(cells * cells));
    for (sources, values) in sources.zip(child.values.chunks_exact_mut(count)) {
        gather_half(lattice, from, sources, to, half, values);
        if let Some(apex) = absent {
            reflect_absent_half(cells, apex, values);
        }
    }
    let matrices = [vertices, centres, &*child];
    if matrices.iter().all(|matrix| matrix.valid.is_none()) {
        return;
    }
    let mut mask = child.valid.take().unwrap_or_else(|| all_valid.into());
    let vertices = vertices.valid.as_deref().unwrap_or(all_valid);
    let centres = centres.valid.as_deref().unwrap_or(all_valid);
    gather_half(lattice, from, (vertices, centres), to, half, &mut mask);
    if let Some(apex) = absent {
        reflect_absent_half(cells, apex, &mut mask);
    }
    child.valid = Some(mask).filter(|mask| mask.contains(&0));
}
