//! Other samples in a part of a repository.

use super::Progress;
use super::bands::Bands;
use crate::build::source::RasterSource;
use crate::build::{BuildOptions, Predecessor, Replacement, build, replace};
use crate::codec::Components;
use crate::cut::{Layer, Window};
use crate::geo::RasterInfo;
use crate::store::{Access, FileSink, Header, TransformKind};
use crate::{Error, Result};
use std::path::Path;

/// What to update, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// The samples of the finest level that get new values.
    pub region: Window,
    /// The RMS error that the repository was built with, which it does not tell; `None` for any other.
    pub rms_error: Option<f64>,
    /// Bytes of memory that a build of all samples may take, about; no limit if `None`.
    pub memory: Option<u64>,
    /// Worker threads; 0 for all that the machine has.
    pub threads: usize,
}

/// New samples, and where in the repository's raster they lie.
pub struct Placed<'a> {
    /// The samples.
    pub source: &'a mut dyn RasterSource,
    /// Column and row of its first one.
    pub at: [i64; 2],
}

/// What an update did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateReport {
    /// Diamonds that were coded again.
    pub diamonds_recomputed: u64,
    /// All diamonds.
    pub diamonds: u64,
    /// Bytes of the file.
    pub bytes: u64,
}

impl Placed<'_> {
    /// Places a source by its georeference; one without lies where a raster of its size must: it has all of the
    /// raster's samples, or those of the region.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] where it does not fit the raster's grid.
    pub fn by_georeference<'a>(
        source: &'a mut dyn RasterSource,
        raster: &RasterInfo,
        region: Window,
    ) -> Result<Placed<'a>> {
        let info = source.info();
        let size = [info.width, info.height];
        let at = if info.georeferenced && raster.georeferenced {
            crate::build::source::position(raster, info)
                .map_err(|cause| Error::Argument(format!("the new samples: {cause}")))?
        } else if size == [raster.width, raster.height] {
            [0, 0]
        } else if size == [region.width, region.height] {
            [region.column, region.row].map(i64::from)
        } else {
            return Err(Error::Argument(format!(
                "{} x {} new samples without a georeference have neither the size of the raster, {} x {}, nor \
                 that of the region, {} x {}",
                size[0], size[1], raster.width, raster.height, region.width, region.height
            )));
        };
        Ok(Placed { source, at })
    }

    /// Refuses samples of another kind than the raster's, or that do not cover a window of it; `need` says why
    /// they must.
    fn check(&self, raster: &RasterInfo, window: Window, need: &str) -> Result<()> {
        let info = self.source.info();
        let kinds = [info, raster].map(|info| (info.sample_type, info.bands));
        if kinds[0] != kinds[1] {
            let [new, old] =
                kinds.map(|(kind, bands)| format!("{} with {bands} bands", kind.name()));
            return Err(Error::Argument(format!(
                "the new samples are {new}, and the repository's {old}"
            )));
        }
        let covers = |axis: usize, first: u32, count: u32, own: u32| {
            self.at[axis] <= i64::from(first)
                && self.at[axis] + i64::from(own) >= i64::from(first) + i64::from(count)
        };
        if covers(0, window.column, window.width, info.width)
            && covers(1, window.row, window.height, info.height)
        {
            return Ok(());
        }
        let [column, row] = self.at;
        Err(Error::Argument(format!(
            "{need} {} x {} samples from column {}, row {} on are needed, and {} x {} from column {column}, row {row} \
             on are given",
            window.width, window.height, window.column, window.row, info.width, info.height
        )))
    }
}

/// Replaces the samples of a region of a repository. It is written beside the old file and takes its name when it is
/// whole; whoever has the old file open goes on with that. Its bytes are those of a build of the whole raster with
/// the same options and the old file's tables.
///
/// A lossless repository has all other samples itself, so that `new` need only cover the region; what it has
/// beside that is not used. Of heights with the transform interpolating only those diamonds are then coded again
/// that the region reaches, unless what holds for all of them changes ([`replace`]). All others keep too little of
/// their originals: every diamond is predicted from what others decode to, and the measured errors are
/// those of all samples. There `new` must have the whole raster, which outside the region must be within the
/// repository's error.
///
/// # Errors
///
/// [`Error::Argument`] for a region outside the raster, samples that do not cover what they must, that differ from the
/// repository's outside the region, or that cannot be built; [`Error::Version`] for a file that a later
/// version wrote; those of reading and building; [`Error::Cancelled`]. The old file is then as it was.
pub fn update(
    file: &Path,
    new: Placed,
    options: &Update,
    progress: Progress,
) -> Result<UpdateReport> {
    let layer = Layer::open(file, Access::Map)?;
    layer.store().check_writable()?;
    let raster = layer.raster_info();
    let whole = Window {
        column: 0,
        row: 0,
        width: raster.width,
        height: raster.height,
    };
    let region = options.region;
    let ends = [
        u64::from(region.column) + u64::from(region.width),
        u64::from(region.row) + u64::from(region.height),
    ];
    let is_inside = ends[0] <= u64::from(raster.width) && ends[1] <= u64::from(raster.height);
    if region.width == 0 || region.height == 0 || !is_inside {
        return Err(Error::Argument(format!(
            "the region of {} x {} samples from column {}, row {} on is not inside the raster of {} x {}",
            region.width, region.height, region.column, region.row, raster.width, raster.height
        )));
    }
    let build_options = options_of(&layer, options)?;
    let has_all_samples = layer.header().lossless && !layer.store().has_missing();
    if !has_all_samples {
        let need = match layer.header().lossless {
            true => "blocks of the repository are missing, so that the original",
            false => "the repository is not lossless, so that the original",
        };
        new.check(raster, whole, need)?;
        return rebuild(
            &layer,
            Merged::of_originals(&layer, region, new),
            &build_options,
            file,
            progress,
        );
    }
    new.check(raster, region, "the")?;
    let samples = samples_of(new, region, raster)?;
    let first = [region.column, region.row];
    let replacement = Replacement::new(layer.header(), first, region.width, samples.clone());
    if let Components::Height(units) = layer.components() {
        let old = Predecessor {
            store: layer.store(),
            lattice: layer.lattice(),
            units,
            codec: layer.codec(),
            root: layer.root(),
        };
        let sink = Box::new(FileSink::create(file)?);
        let replaced = replace(&old, &replacement?, (file, sink), options.threads, progress)?;
        if let Some(replaced) = replaced {
            return Ok(UpdateReport {
                diamonds_recomputed: replaced.diamonds,
                diamonds: layer.lattice().diamond_count(),
                bytes: replaced.bytes,
            });
        }
    }
    rebuild(
        &layer,
        Merged::of_region(&layer, region, samples),
        &build_options,
        file,
        progress,
    )
}

/// What the repository was built with.
fn options_of(layer: &Layer, options: &Update) -> Result<BuildOptions> {
    let header: &Header = layer.header();
    let has_rms_error = header.transform == TransformKind::Lifted && !header.lossless;
    if has_rms_error && options.rms_error.is_none() {
        return Err(Error::Argument(
            "it was built with an RMS error, which it does not tell: give that too".into(),
        ));
    }
    if !has_rms_error && options.rms_error.is_some() {
        return Err(Error::Argument("it was built without an RMS error".into()));
    }
    Ok(BuildOptions {
        transform: header.transform,
        max_error: if has_rms_error {
            0.0
        } else {
            header.max_error_bound
        },
        rms_error: options.rms_error,
        entropy: header.entropy,
        adaptive: layer.model().map(|model| model.adaptive),
        tables: layer.model().cloned(),
        cells_log2: u32::from(header.cells_log2),
        memory: options.memory,
        resume: None,
        threads: options.threads,
    })
}

fn rebuild(
    layer: &Layer,
    mut merged: Merged,
    options: &BuildOptions,
    file: &Path,
    progress: Progress,
) -> Result<UpdateReport> {
    let built = build(&mut merged, options, file, progress)?;
    let diamonds = layer.lattice().diamond_count();
    Ok(UpdateReport {
        diamonds_recomputed: diamonds,
        diamonds,
        bytes: built.bytes,
    })
}

/// The new samples of the region, row by row.
fn samples_of(new: Placed, region: Window, raster: &RasterInfo) -> Result<Vec<f64>> {
    let bands = usize::from(raster.bands);
    let mut line = vec![f64::NAN; new.source.info().row_length()];
    let skipped = (i64::from(region.row) - new.at[1]) as u64;
    for _ in 0..skipped {
        new.source.read_rows(&mut line)?;
    }
    let start = (i64::from(region.column) - new.at[0]) as usize * bands;
    let length = region.width as usize * bands;
    let mut samples = Vec::with_capacity(length * region.height as usize);
    for _ in 0..region.height {
        new.source.read_rows(&mut line)?;
        samples.extend_from_slice(&line[start..start + length]);
    }
    make_voids(raster, &mut samples);
    Ok(samples)
}

/// What is a void in the repository's raster is one.
fn make_voids(raster: &RasterInfo, samples: &mut [f64]) {
    for sample in samples.chunks_exact_mut(usize::from(raster.bands)) {
        if sample.iter().all(|&number| Some(number) == raster.nodata) {
            sample.fill(f64::NAN);
        }
    }
}

/// The whole raster with new samples in the region.
struct Merged<'a, 'b> {
    info: RasterInfo,
    region: Window,
    /// Rows of the repository.
    old: Bands<'a>,
    given: Given<'b>,
    /// Most that a sample of the originals may differ from the repository's, if that can be told.
    max_error: Option<f64>,
    next_row: u32,
}

enum Given<'a> {
    /// New samples of the region; all others are the repository's.
    Region(Vec<f64>),
    /// Samples of the whole raster, and a row of them.
    Originals(Placed<'a>, Vec<f64>),
}

impl<'a, 'b> Merged<'a, 'b> {
    fn new(layer: &'a Layer, region: Window, given: Given<'b>) -> Merged<'a, 'b> {
        let info = layer.raster_info().clone();
        let window = Window {
            column: 0,
            row: 0,
            width: info.width,
            height: info.height,
        };
        Merged {
            info,
            region,
            old: Bands::new(layer, layer.lattice().levels(), window),
            given,
            max_error: None,
            next_row: 0,
        }
    }

    fn of_region(layer: &'a Layer, region: Window, samples: Vec<f64>) -> Merged<'a, 'b> {
        Merged::new(layer, region, Given::Region(samples))
    }

    fn of_originals(layer: &'a Layer, region: Window, new: Placed<'b>) -> Merged<'a, 'b> {
        let line = vec![f64::NAN; new.source.info().row_length()];
        let max_error = (!layer.store().has_missing()).then_some(layer.header().max_error);
        Merged {
            max_error,
            ..Merged::new(layer, region, Given::Originals(new, line))
        }
    }

    fn read_row(&mut self, samples: &mut [f64]) -> Result<()> {
        let row = self.next_row;
        self.next_row += 1;
        let bands = usize::from(self.info.bands);
        let Window { column, width, .. } = self.region;
        let columns = column as usize * bands..(column + width) as usize * bands;
        let inside = row
            .checked_sub(self.region.row)
            .filter(|&inside| inside < self.region.height);
        match &mut self.given {
            Given::Region(new) => {
                samples.copy_from_slice(self.old.row(row)?);
                if let Some(inside) = inside {
                    let start = inside as usize * columns.len();
                    samples[columns.clone()].copy_from_slice(&new[start..start + columns.len()]);
                }
            }
            Given::Originals(new, line) => {
                while new.at[1] < i64::from(row) {
                    new.source.read_rows(line)?;
                    new.at[1] += 1;
                }
                new.source.read_rows(line)?;
                new.at[1] += 1;
                let start = -new.at[0] as usize * bands;
                samples.copy_from_slice(&line[start..start + samples.len()]);
                make_voids(&self.info, samples);
                if let Some(max_error) = self.max_error {
                    let old = self.old.row(row)?;
                    let is_new = |place: usize| inside.is_some() && columns.contains(&place);
                    compare(samples, old, max_error, is_new).map_err(|place| {
                        Error::Argument(format!(
                            "the sample at column {}, row {row} is {}, and the repository has {} there: outside the \
                             region samples must be those that it was built from",
                            place / bands, samples[place], old[place]
                        ))
                    })?;
                }
            }
        }
        Ok(())
    }
}

/// The first place where originals and decoded samples are further apart than they may be.
fn compare(
    originals: &[f64],
    decoded: &[f64],
    max_error: f64,
    is_new: impl Fn(usize) -> bool,
) -> std::result::Result<(), usize> {
    let differs = |&place: &usize| {
        let (original, decoded) = (originals[place], decoded[place]);
        let is_near =
            (original - decoded).abs() <= max_error || original.is_nan() && decoded.is_nan();
        !is_near && !is_new(place)
    };
    (0..originals.len()).find(differs).map_or(Ok(()), Err)
}

impl RasterSource for Merged<'_, '_> {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()> {
        let length = self.info.row_length();
        samples
            .chunks_exact_mut(length)
            .try_for_each(|row| self.read_row(row))
    }
}
