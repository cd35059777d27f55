//! The builder: samples to blocks, level by level, each going on from what the decoder returns.

use super::coding::{Coded, Coding, check_model, list_heights, list_of_tables};
use super::descent::{Descent, Input};
use super::filtered::Filtered;
use super::leaf::walk_tiles;
use super::levels::Levels;
use super::plane::Plane;
use super::rms::greatest_bound;
use super::source::RasterSource;
use super::summaries::summarise;
use super::working_store::{Identity, WorkingStore};
use super::workspace::{Workspace, folder_of};
use crate::codec::{
    BlockCodec, ColourUnits, Components, Model, RootCodec, Units, block_length_unit,
};
use crate::geo::RasterInfo;
use crate::lattice::Lattice;
use crate::schedule::thread_count;
use crate::store::{DomainKind, EntropyKind, FileSink, Header, Kind, Sink, TransformKind, Writer};
use crate::transform::ListedHeights;
use crate::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Bytes of memory that a build takes whatever the raster.
const OTHER_BYTES: u64 = 48 << 20;
/// Bytes that what is decoded and coded of a component takes, about.
const DECODED_BYTES: u64 = 16;

/// How to build.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// How samples become coefficients.
    pub transform: TransformKind,
    /// Largest |decoded - input| of any valid sample, in the raster's own units, of colours in each of red,
    /// green and blue; 0 for lossless. Lifted takes no other.
    pub max_error: f64,
    /// Instead of `max_error`, which is 0 then: the largest root mean square of decoded - input, of colours
    /// over red, green and blue. Lifted alone takes it; the max error that comes with it is measured and stored.
    pub rms_error: Option<f64>,
    /// How coefficients become bytes.
    pub entropy: EntropyKind,
    /// Whether [`EntropyKind::Rans`] comes with the trained predictor, unless the file is smaller without. Else the transform's fixed rule is all,
    /// as it is by default for the heights of lifted and two-stage, whose papers have it so.
    pub adaptive: Option<bool>,
    /// Weights and tables to use instead of trained ones, from data with as many levels.
    pub tables: Option<Model>,
    /// log2 of the cells along a diamond's side: 4 to 7.
    pub cells_log2: u32,
    /// Bytes of memory that the process may take, about; what does not fit goes to temporary files in the folder
    /// of the output. The output does not depend on it. `None` keeps all in memory.
    pub memory: Option<u64>,
    /// What the input is told by (files with their sizes and times). With it a build that does not fit its memory
    /// keeps a working store beside the output, from which a rerun with the same input and options goes on
    /// after the process was killed or the build cancelled. Its success removes the store.
    pub resume: Option<Identity>,
    /// Worker threads; 0 for all that the machine has. The output does not depend on it.
    pub threads: usize,
}

impl Default for BuildOptions {
    fn default() -> BuildOptions {
        BuildOptions {
            transform: TransformKind::Interpolating,
            max_error: 0.0,
            rms_error: None,
            entropy: EntropyKind::Rans,
            adaptive: None,
            tables: None,
            cells_log2: 6,
            memory: None,
            resume: None,
            threads: 0,
        }
    }
}

impl BuildOptions {
    /// Says which options cannot be met, whatever the raster.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`].
    pub fn check(&self) -> Result<()> {
        let is_lifted = self.transform == TransformKind::Lifted;
        let limit = |name: &str, number: f64| {
            let message = format!("the {name} error must be a number from 0 up, not {number}");
            (number.is_nan() || number < 0.0).then_some(message)
        };
        let wrong_limit = limit("maximum", self.max_error)
            .or_else(|| self.rms_error.and_then(|number| limit("RMS", number)));
        let message = if !(4..=7).contains(&self.cells_log2) {
            let cells = 1u64 << self.cells_log2.min(63);
            format!("cells must be 16, 32, 64 or 128, not {cells}")
        } else if let Some(message) = wrong_limit {
            message
        } else if self.rms_error.is_some() && !is_lifted {
            "an RMS error needs the transform lifted".to_owned()
        } else if self.rms_error.is_some() && self.max_error != 0.0 {
            "either a maximum error or an RMS error, not both".to_owned()
        } else if is_lifted && self.max_error != 0.0 {
            let max_error = self.max_error;
            format!(
                "lifted keeps no maximum error of {max_error}: give 0 for lossless, or an RMS error"
            )
        } else {
            return Ok(());
        };
        Err(Error::Argument(message))
    }
}

/// What was built; errors are measured from the decoded bytes, in the raster's own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildReport {
    /// Samples, valid and void.
    pub samples: u64,
    /// Void samples.
    pub void_samples: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Largest |decoded - input|.
    pub max_error: f64,
    /// Root of the mean squared difference over the valid samples.
    pub rms_error: f64,
    /// Levels that were taken over from a build that was killed.
    pub resumed_levels: u32,
}

/// Builds the repository of a raster's heights, or of an image's colours, at `output`, written beside it and
/// renamed when whole.
///
/// `progress` gets (done, total) in steps of work and returns false to cancel.
///
/// # Errors
///
/// Those of the source; [`Error::Argument`] for options or samples that cannot be built;
/// [`Error::Io`] for the output; [`Error::Cancelled`]. After an error nothing has the output's name.
pub fn build(
    source: &mut dyn RasterSource,
    options: &BuildOptions,
    output: &Path,
    progress: &mut dyn FnMut(u64, u64) -> bool,
) -> Result<BuildReport> {
    check(source.info(), options)?;
    // First of all, so that an output that cannot be written is found before the input is read.
    let sink = Box::new(FileSink::create(output)?);
    build_into(source, options, output, sink, progress)
}

/// As [`build`], into a sink; `output` only names it in errors.
///
/// # Errors
///
/// Those of [`build`], and of the sink.
pub fn build_into(
    source: &mut dyn RasterSource,
    options: &BuildOptions,
    output: &Path,
    sink: Box<dyn Sink>,
    progress: &mut dyn FnMut(u64, u64) -> bool,
) -> Result<BuildReport> {
    let lattice = check(source.info(), options)?;
    let workspace = choose_workspace(source.info(), options, output)?;
    let built = build_in(
        &workspace,
        source,
        options,
        (output, sink),
        &lattice,
        progress,
    );
    match built {
        // A rerun goes on, or says the same until the store is removed.
        Err(Error::Cancelled | Error::Damaged { .. }) => built,
        _ => {
            let removed = workspace.remove();
            built.and_then(|report| removed.map(|()| report))
        }
    }
}

fn build_in(
    workspace: &Workspace,
    source: &mut dyn RasterSource,
    options: &BuildOptions,
    (output, sink): (&Path, Box<dyn Sink>),
    lattice: &Lattice,
    progress: &mut dyn FnMut(u64, u64) -> bool,
) -> Result<BuildReport> {
    let info = source.info().clone();
    // Each sample is read once, filtered once if at all, coded once and measured once.
    let samples = u64::from(info.width) * u64::from(info.height);
    let is_filtering = options.transform != TransformKind::Interpolating;
    let total = samples * (3 + u64::from(is_filtering));
    let threads = thread_count(options.threads);
    let plane = Plane::read(source, workspace, threads, |done| progress(done, total))?;
    let mut done = samples;
    let mut step = |samples: u64| {
        done += samples;
        if progress(done.min(total), total) {
            Ok(())
        } else {
            Err(Error::Cancelled)
        }
    };
    let (mut components, is_exact) = choose_components(&plane, &info, options)?;
    let filters = components.transforms(options.transform, lattice.cells());
    let levels = Levels::new(lattice, &plane, &components, &filters, threads, &mut step)?;
    if let Some(limit) = options.rms_error {
        let step = &mut step;
        let bound =
            bound_for_rms_error(limit, &levels, &components, &info, workspace, threads, step)?;
        components = components.with_common_bound(bound);
    }
    let coded = code(&levels, &components, options, workspace, &mut step)?;
    let descent = &coded.descent;
    let header = header(&levels, options, &info, &components, is_exact);
    let tables = coded.model.as_ref().map_or_else(Vec::new, Model::to_bytes);
    let mut writer = Writer::with_sink(output, sink, &header, &coded.roots, &tables)?;
    let mut scratch = Vec::new();
    for rank in 0..coded.blocks.count() {
        writer.push(coded.blocks.get(rank, &mut scratch)?)?;
    }
    let (summaries, deviation) = summarise(descent, &components, threads, &mut step)?;
    let (max_error, rms_error) = (deviation.largest, deviation.rms());
    let [unit_min, unit_max] = summaries.range;
    let header = Header {
        unit_min,
        unit_max,
        max_error,
        rms_error,
        // Where only the RMS error was asked for, the max error is promised once it is known.
        max_error_bound: options.rms_error.map_or(options.max_error, |_| max_error),
        ..header
    };
    let bytes = writer.finish(&header, &summaries.codes)?;
    progress(total, total);
    Ok(BuildReport {
        samples,
        void_samples: plane.void_samples,
        bytes,
        max_error,
        rms_error,
        resumed_levels: coded.resumed_levels,
    })
}

/// The lattice of a raster, after a check of what can be checked before it is read.
fn check(info: &RasterInfo, options: &BuildOptions) -> Result<Lattice> {
    let lattice = Lattice::new(info.width, info.height, options.cells_log2)?;
    options.check()?;
    if let Some(model) = &options.tables {
        let components = usize::from(info.bands);
        check_model(model, lattice.levels(), options.transform, components)?;
    }
    Ok(lattice)
}

/// Where what a build has no use for at once is kept, by the memory that there may be.
fn choose_workspace(info: &RasterInfo, options: &BuildOptions, output: &Path) -> Result<Workspace> {
    let Some(memory) = options.memory else {
        return Ok(Workspace::Memory);
    };
    let samples = u64::from(info.width) * u64::from(info.height);
    let (bands, is_filtering) = (
        u64::from(info.bands),
        options.transform != TransformKind::Interpolating,
    );
    // Heights of the input; decoded vertices and centres of all levels, drafts of the last one, and blocks.
    let filtered = if is_filtering { Filtered::BYTES } else { 0 };
    let number = Plane::number_bytes(info.sample_type) + filtered + DECODED_BYTES;
    let needed = |number: u64| OTHER_BYTES.saturating_add(samples.saturating_mul(bands * number));
    if needed(number) <= memory {
        return Ok(Workspace::Memory);
    }
    if is_filtering && needed(filtered) > memory {
        return Err(Error::Argument(format!(
            "the filtered levels of {samples} samples need {} MiB of memory, and may have {}: give more, or the \
             transform interpolating",
            needed(filtered) >> 20,
            memory >> 20
        )));
    }
    let Some(input) = &options.resume else {
        return Ok(Workspace::Folder(folder_of(output)));
    };
    let identity = [&identity(info, options)[..], input].concat();
    let store = WorkingStore::open(output, &identity)?;
    Ok(Workspace::Store(Arc::new(store), "source"))
}

/// What tells builds apart, but for their inputs.
fn identity(info: &RasterInfo, options: &BuildOptions) -> Identity {
    let tables = options.tables.as_ref();
    let tables = tables.map(|model| crc32fast::hash(&model.to_bytes()));
    let told = [
        ("Kimberlite", env!("CARGO_PKG_VERSION").to_owned()),
        ("transform", format!("{:?}", options.transform)),
        ("maximum error", options.max_error.to_string()),
        ("RMS error", format!("{:?}", options.rms_error)),
        ("coder", format!("{:?}", options.entropy)),
        ("trained prediction", format!("{:?}", options.adaptive)),
        ("tables", format!("{tables:?}")),
        ("cells", (1u64 << options.cells_log2).to_string()),
        ("raster", format!("{info:?}")),
    ];
    told.map(|(name, value)| (name.to_owned(), value)).to_vec()
}

/// The header but for what only the finished build knows: errors, and the range of lifted heights.
fn header(
    levels: &Levels,
    options: &BuildOptions,
    info: &RasterInfo,
    components: &Components,
    is_exact: bool,
) -> Header {
    let (lattice, plane) = (levels.lattice, levels.plane);
    let ([unit_min, unit_max], [unit_scale, unit_offset]) =
        (components.range(0), components.scale_and_offset());
    Header {
        kind: if info.bands == 1 {
            Kind::Heights
        } else {
            Kind::Colours
        },
        domain: DomainKind::Planar,
        transform: options.transform,
        entropy: options.entropy,
        cells_log2: options.cells_log2 as u8,
        levels: lattice.levels() as u8,
        lossless: components.common_bound() == 0 && is_exact,
        block_length_unit: block_length_unit(lattice.cells()),
        bound_units: components.common_bound() as u32,
        unit_min,
        unit_max,
        unit_scale,
        unit_offset,
        sample_min: plane.sample_range[0],
        sample_max: plane.sample_range[1],
        max_error_bound: options.max_error,
        max_error: 0.0,
        rms_error: 0.0,
        samples: plane.count() as u64,
        void_samples: plane.void_samples,
        block_count: lattice.diamond_count(),
        raster: info.clone(),
    }
}

/// What samples become inside, and whether every one is restored by that alone.
fn choose_components(
    plane: &Plane,
    info: &RasterInfo,
    options: &BuildOptions,
) -> Result<(Components, bool)> {
    match info.bands {
        1 => {
            let (units, is_exact) = choose_units(plane, info, options)?;
            Ok((Components::Height(units), is_exact))
        }
        3 => {
            let units = ColourUnits::new(info, options.max_error)?;
            Ok((Components::Colour(units), true))
        }
        bands => Err(Error::Argument(format!(
            "samples of {bands} bands: heights have one, colours three"
        ))),
    }
}

/// Units for a raster of heights, and whether every sample is a multiple of one.
fn choose_units(plane: &Plane, info: &RasterInfo, options: &BuildOptions) -> Result<(Units, bool)> {
    let is_integer = info.sample_type.is_integer();
    if let Some(rms_error) = options.rms_error {
        let units = Units::for_rms_error(info, plane.sample_range, rms_error)?;
        return Ok((units, is_integer));
    }
    let unit = match options.max_error {
        0.0 if !is_integer => Some(lossless_unit(plane, info)?),
        _ => None,
    };
    let units = Units::new(info, plane.sample_range, options.max_error, unit)?;
    Ok((units, is_integer || unit.is_some()))
}

/// Codes all levels. The fixed rule is tried too where trained weights may cost more than they save, and the
/// smaller taken.
fn code<'a>(
    levels: &'a Levels<'a>,
    components: &Components,
    options: &BuildOptions,
    workspace: &Workspace,
    step: &mut dyn FnMut(u64) -> Result<()>,
) -> Result<Coded<'a>> {
    let adaptive = match &options.tables {
        Some(model) => model.adaptive,
        None => options
            .adaptive
            .unwrap_or_else(|| components.prefers_trained_predictor(options.transform)),
    };
    let code = |adaptive, step: &mut dyn FnMut(u64) -> Result<()>| {
        let workspace = &workspace.part(if adaptive { "trained" } else { "fixed" });
        let coders = Coders::new(levels, components, options, adaptive)?;
        let coding = Coding {
            levels,
            roots: &coders.roots,
            blocks: &coders.blocks,
            workspace,
            threads: thread_count(options.threads),
        };
        match options.entropy {
            EntropyKind::Gamma => coding.gamma(step),
            EntropyKind::Rans => {
                coding.in_contexts(options.tables.as_ref(), adaptive, coders.listed, step)
            }
        }
    };
    let coded = code(adaptive, step)?;
    // Two-stage's details are what filters left: weights often gain nothing there.
    let may_lose = coded.has_dear_tables() || options.transform == TransformKind::TwoStage;
    if !adaptive || options.tables.is_some() || !may_lose {
        return Ok(coded);
    }
    let fixed = code(false, &mut |_| step(0))?;
    Ok(if fixed.bytes() < coded.bytes() {
        fixed
    } else {
        coded
    })
}

/// What codes the root and the blocks.
struct Coders<'a> {
    roots: RootCodec<'a>,
    blocks: BlockCodec,
    listed: Option<ListedHeights>,
}

impl<'a> Coders<'a> {
    fn new(
        levels: &Levels<'a>,
        components: &Components,
        options: &BuildOptions,
        adaptive: bool,
    ) -> Result<Coders<'a>> {
        let (lattice, has_voids) = (levels.lattice, levels.plane.void_samples > 0);
        let kind = options.transform;
        let transforms = components.transforms(kind, lattice.cells());
        let roots = RootCodec::new(lattice, components.quantisers(&transforms, None));
        let listed = match (components, kind) {
            (Components::Height(units), TransformKind::Interpolating) if adaptive => {
                match &options.tables {
                    Some(model) => list_of_tables(model, levels.plane, units)?,
                    None => list_heights(levels.plane, units)?,
                }
            }
            _ => None,
        };
        let quantisers = components.quantisers(&transforms, listed.clone());
        let mut blocks = BlockCodec::new(lattice.cells(), has_voids, transforms);
        if options.entropy == EntropyKind::Rans {
            blocks = blocks.with_symbols(components.coders(lattice.cells(), quantisers, adaptive));
        }
        Ok(Coders {
            roots,
            blocks,
            listed,
        })
    }
}

/// The largest bound of the lifted transform's quantiser whose RMS error is at most `limit`.
fn bound_for_rms_error(
    limit: f64,
    levels: &Levels,
    components: &Components,
    info: &RasterInfo,
    workspace: &Workspace,
    threads: usize,
    step: &mut dyn FnMut(u64) -> Result<()>,
) -> Result<i32> {
    let mut measure = |bound: i32| {
        let components = components.clone().with_common_bound(bound);
        let options = BuildOptions {
            transform: TransformKind::Lifted,
            entropy: EntropyKind::Gamma,
            ..BuildOptions::default()
        };
        let coders = Coders::new(levels, &components, &options, false)?;
        let mut descent = Descent::new(levels, &coders.roots, workspace.part("trial"), threads)?.0;
        for _ in 0..levels.lattice.levels() {
            let preview = |input: Input| {
                let (vertices, outline) = (input.vertices, input.outline);
                let blocks = &coders.blocks;
                Ok((
                    (),
                    blocks.preview(vertices, outline, input.target, input.voids),
                ))
            };
            descent.code_level(preview, |(), _| step(0))?;
        }
        let found = walk_tiles(&descent, &components, threads, |_| Ok(()), |(), _| step(0))?;
        Ok(found.rms())
    };
    let [low, high] = components.range(0).map(i64::from);
    let scale = components.scale_and_offset()[0];
    let found = greatest_bound(limit, scale, high - low, &mut measure)?;
    match found {
        Some(bound) => Ok(bound),
        None => Err(Error::Argument(format!(
            "an RMS error of {limit} is too small for {} samples: give more than {:e}",
            info.sample_type.name(),
            measure(0)?
        ))),
    }
}

/// The unit of which all samples of a float raster are multiples.
fn lossless_unit(plane: &Plane, info: &RasterInfo) -> Result<f64> {
    for unit in Units::whole_units() {
        let divides = |&number: &f64| Units::is_multiple(info.sample_type, number, unit);
        if plane.all_rows(|row| row.iter().all(divides))? {
            return Ok(unit);
        }
    }
    Err(Error::Argument(format!(
        "maximum error 0 needs {} samples that are multiples of one unit, 1 to 1e-6 by powers of ten or 1/2 to \
             1/1048576 by powers of two, fewer than 2^29 of it; these are not: give a maximum error above {:e}",
        info.sample_type.name(),
        Units::least_max_error(info, plane.sample_range),
    )))
}
