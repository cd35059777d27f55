//! The subcommands: each asks the library, and reports what it answers.

use crate::arguments::{self, Command};
use crate::cities;
use crate::progress::Progress;
use crate::report::Report;
use kimberlite::build::source::{RasterSource, Resampled, open_all, texels_per_sample};
use kimberlite::build::{self, BuildOptions};
use kimberlite::codec::Model;
use kimberlite::cut::{ColourForm, Colouring, CutOptions, Detail, Layer, Metric, Query, Terrain};
use kimberlite::geo::Registration;
use kimberlite::store::{Access, DomainKind, EntropyKind, Kind, TransformKind};
use kimberlite::tool::{self, Extract, Flight, Placed, Update, Verdict, peak_memory_bytes};
use kimberlite::{Error, Result};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Decoded data that one height may hold.
const QUERY_BYTES: u64 = 64 << 20;

/// What a command found.
pub struct Outcome {
    pub report: Report,
    /// Why the check failed, if it did.
    pub failure: Option<String>,
}

impl From<Report> for Outcome {
    fn from(report: Report) -> Outcome {
        Outcome {
            report,
            failure: None,
        }
    }
}

pub fn run(command: &Command) -> Result<Outcome> {
    match command {
        Command::Build(arguments) => build(arguments).map(Outcome::from),
        Command::Info { file } => info(file).map(Outcome::from),
        Command::Verify {
            file,
            against,
            domain_of,
            source,
        } => verify(file, against, domain_of.as_deref(), source),
        Command::Repair { file, output } => repair(file, output.as_deref()).map(Outcome::from),
        Command::Update(arguments) => update(arguments).map(Outcome::from),
        Command::Extract(arguments) => extract(arguments).map(Outcome::from),
        Command::Fly(arguments) => fly(arguments).map(Outcome::from),
        Command::Bench { file } => bench(file).map(Outcome::from),
        Command::Clean { output } => clean(output).map(Outcome::from),
        Command::BuildCity(arguments) => cities::build(arguments).map(Outcome::from),
        Command::RenderCity(arguments) => cities::render(arguments).map(Outcome::from),
        Command::Height { file, x, y } => height(file, *x, *y).map(Outcome::from),
    }
}

fn open(file: &Path) -> Result<Layer> {
    Layer::open(file, Access::Map)
}

pub fn open_heights(file: &Path) -> Result<Arc<Terrain>> {
    Terrain::open(file, Access::Map).map(Arc::new)
}

pub fn start_progress(task: &'static str, file: &Path) -> Result<Progress> {
    Progress::start(task).map_err(Error::io(file, "cannot watch for Ctrl-C"))
}

fn build(arguments: &arguments::Build) -> Result<Report> {
    let start = Instant::now();
    let transform = match arguments.transform() {
        arguments::Transform::Interpolating => TransformKind::Interpolating,
        arguments::Transform::Lifted => TransformKind::Lifted,
        arguments::Transform::TwoStage => TransformKind::TwoStage,
    };
    let options = BuildOptions {
        transform,
        max_error: arguments.max_error.unwrap_or(0.0),
        rms_error: arguments.rms,
        entropy: match arguments.entropy {
            arguments::Entropy::Gamma => EntropyKind::Gamma,
            arguments::Entropy::Rans => EntropyKind::Rans,
        },
        adaptive: arguments
            .prediction
            .map(|rule| matches!(rule, arguments::Prediction::Adaptive)),
        tables: arguments
            .tables_from
            .as_deref()
            .map(|file| tables_of(file, transform))
            .transpose()?,
        cells_log2: arguments.cells as u32,
        memory: arguments.memory.map(|mebibytes| mebibytes << 20),
        resume: Some(identity_of(arguments)?),
        threads: arguments.threads,
    };
    let output = &arguments.output;
    let options_of_source = arguments.source.options(arguments.colour);
    let source = open_all(&arguments.inputs, &options_of_source)?;
    let (mut source, texels) = match &arguments.domain_of {
        Some(heights) => {
            let (resampled, texels) = resample(&arguments.inputs, source, heights)?;
            (resampled, Some(texels))
        }
        None => (source, None),
    };
    let progress = start_progress("building", output)?;
    let mut step = |done, total| progress.step(done, total);
    let built = build::build(source.as_mut(), &options, output, &mut step)?;
    Ok(Report::default()
        .with("samples", built.samples)
        .with("bytes", built.bytes)
        .with(
            "bits_per_sample",
            bits_per_sample(built.bytes, built.samples, built.void_samples),
        )
        .with("max_error", built.max_error)
        .with("rms_error", built.rms_error)
        .with("texels_per_sample", texels)
        .with("resumed_levels", built.resumed_levels)
        .with("seconds", start.elapsed().as_secs_f64())
        .with("peak_memory_bytes", peak_memory_bytes()))
}

fn clean(output: &Path) -> Result<Report> {
    let removed = build::clean(output)?;
    Ok(Report::default().with("removed", removed.len()))
}

/// What tells the input from others: its files with their sizes and times, and how they are read.
fn identity_of(arguments: &arguments::Build) -> Result<build::Identity> {
    let files = arguments.inputs.iter().chain(&arguments.domain_of);
    let mut identity = files
        .map(|path| {
            let cannot = || Error::io(path, "cannot open");
            let metadata = std::fs::metadata(path).map_err(cannot())?;
            let modified = metadata.modified().map_err(cannot())?;
            let path = path.canonicalize().map_err(cannot())?;
            let told = format!("{} bytes, modified {modified:?}", metadata.len());
            Ok((path.display().to_string(), told))
        })
        .collect::<Result<build::Identity>>()?;
    let reading = arguments.source.options(arguments.colour);
    identity.push(("reading".to_owned(), format!("{reading:?}")));
    Ok(identity)
}

/// An image on the samples of a repository of heights and between them, and how many texels lie from one
/// sample to the next.
fn resample(
    inputs: &[PathBuf],
    image: Box<dyn RasterSource>,
    heights: &Path,
) -> Result<(Box<dyn RasterSource>, u32)> {
    let name = inputs.first().map(PathBuf::as_path).unwrap_or(heights);
    let heights = open_heights(heights)?;
    let texels = texels_per_sample(image.info(), heights.raster_info());
    let resampled = Resampled::new(name, image, heights.raster_info(), texels)?;
    Ok((Box::new(resampled), texels))
}

/// What another repository was coded by.
fn tables_of(file: &Path, transform: TransformKind) -> Result<Model> {
    let layer = open(file)?;
    if layer.header().transform != transform {
        let message = "its tables are those of another transform";
        return Err(Error::input(file, message.to_owned()));
    }
    let none = || {
        Error::input(
            file,
            String::from("it has no tables: it was built with --entropy gamma"),
        )
    };
    layer.model().cloned().ok_or_else(none)
}

/// Bits of the file for every valid sample; `None` where there is none.
fn bits_per_sample(bytes: u64, samples: u64, void_samples: u64) -> Option<f64> {
    let valid = samples.saturating_sub(void_samples);
    (valid > 0).then(|| 8.0 * bytes as f64 / valid as f64)
}

fn info(file: &Path) -> Result<Report> {
    if let Some(city) = cities::open_city(file)? {
        return Ok(cities::info(&city));
    }
    let layer = open(file)?;
    let (header, store) = (layer.header(), layer.store());
    let raster = &header.raster;
    let bytes = store.file_bytes();
    let metadata: Map<String, Value> = raster
        .metadata
        .iter()
        .map(|(key, value)| (key.clone(), readable(value).into()))
        .collect();
    let kind = match header.kind {
        Kind::Heights => "heights",
        Kind::Colours => "colours",
        Kind::City => "city",
    };
    let domain = match header.domain {
        DomainKind::Planar => "planar",
        DomainKind::CubeSphere => "cube-sphere",
    };
    let transform = match header.transform {
        TransformKind::Interpolating => "interpolating",
        TransformKind::Lifted => "lifted",
        TransformKind::TwoStage => "two-stage",
    };
    let entropy = match header.entropy {
        EntropyKind::Gamma => "gamma",
        EntropyKind::Rans => "rans",
    };
    let registration = match raster.registration {
        Registration::Area => "area",
        Registration::Point => "point",
    };
    Ok(Report::default()
        .with("kind", kind)
        .with("domain", domain)
        .with("transform", transform)
        .with("entropy", entropy)
        .with("cells", layer.lattice().cells())
        .with("levels", header.levels)
        .with("diamonds", header.block_count)
        .with("samples", header.samples)
        .with("void_samples", header.void_samples)
        .with("bytes", bytes)
        .with("payload_bytes", store.payload_bytes())
        .with(
            "bits_per_sample",
            bits_per_sample(bytes, header.samples, header.void_samples),
        )
        .with("max_error", header.max_error)
        .with("max_error_bound", header.max_error_bound)
        .with("rms_error", header.rms_error)
        .with("lossless", header.lossless)
        .with("missing_detail", store.has_missing())
        .with("width", raster.width)
        .with("height", raster.height)
        .with("sample_type", raster.sample_type.name())
        .with("sample_min", header.sample_min)
        .with("sample_max", header.sample_max)
        .with("crs", raster.crs.as_str())
        .with("geographic", raster.geographic)
        .with("georeferenced", raster.georeferenced)
        .with("geotransform", raster.geotransform.to_vec())
        .with("registration", registration)
        .with("nodata", raster.nodata)
        .with("units", raster.units.as_str())
        .with("value_scale", raster.value_scale)
        .with("value_offset", raster.value_offset)
        .with("metadata", metadata))
}

/// Text as it is, without the zeros that end it; other bytes as hexadecimal digits.
fn readable(bytes: &[u8]) -> String {
    let text = std::str::from_utf8(bytes)
        .ok()
        .map(|text| text.trim_end_matches('\0'));
    match text.filter(|text| !text.contains(|c: char| c.is_control() && !c.is_whitespace())) {
        Some(text) => text.to_owned(),
        None => bytes.iter().map(|byte| format!("{byte:02x}")).collect(),
    }
}

fn verify(
    file: &Path,
    against: &[PathBuf],
    domain_of: Option<&Path>,
    source: &arguments::Source,
) -> Result<Outcome> {
    if let Ok(Some(city)) = cities::open_city(file) {
        return cities::verify(&city, file);
    }
    let layer = match open(file) {
        // Without a sound header there is no saying how many blocks there are.
        Err(Error::Damaged { message, .. }) => {
            let report = Report::default()
                .with("ok", false)
                .with("damaged_blocks", Value::Null)
                .with("missing_blocks", Value::Null)
                .with("damage", vec![message.clone()]);
            return Ok(Outcome {
                report,
                failure: Some(format!("damaged: {message}")),
            });
        }
        opened => opened?,
    };
    let mut source = match against {
        [] => None,
        inputs => {
            let colour = layer.header().kind == Kind::Colours;
            let input = open_all(inputs, &source.options(colour))?;
            Some(match domain_of {
                Some(heights) => resample(against, input, heights)?.0,
                None => input,
            })
        }
    };
    let progress = start_progress("verifying", file)?;
    let mut step = |done, total| progress.step(done, total);
    // The closure shortens the lifetime of the trait object inside the box.
    let against = source.as_mut().map(|source| source.as_mut() as _);
    let verdict = tool::verify(&layer, against, &mut step)?;
    let damage: Vec<&str> = verdict
        .damage
        .iter()
        .map(|d| d.description.as_str())
        .collect();
    let missing: Vec<&str> = verdict
        .missing
        .iter()
        .map(|d| d.description.as_str())
        .collect();
    let mut report = Report::default()
        .with("ok", verdict.ok)
        .with("damaged_blocks", verdict.damaged_blocks())
        .with("missing_blocks", verdict.missing_blocks())
        .with("coarse_samples", verdict.coarse_samples)
        .with("damage", damage)
        .with("missing", missing);
    if source.is_some() {
        let found = verdict.comparison;
        report = report
            .with("max_error", found.map(|found| found.max_error))
            .with("rms_error", found.map(|found| found.rms_error))
            .with("void_mismatches", found.map(|found| found.void_mismatches));
    }
    let failure = failure(&verdict, layer.header().max_error_bound);
    Ok(Outcome { report, failure })
}

fn failure(verdict: &Verdict, bound: f64) -> Option<String> {
    match (verdict.ok, &verdict.damage[..], verdict.comparison) {
        (true, ..) => None,
        (false, [first, ..], _) => Some(format!(
            "{} damaged blocks: {}",
            verdict.damaged_blocks(),
            first.description
        )),
        (false, [], Some(found)) if found.void_mismatches > 0 => Some(format!(
            "{} samples are void only here or only there",
            found.void_mismatches
        )),
        (false, [], found) => {
            let max_error = found.map_or(f64::NAN, |found| found.max_error);
            Some(format!(
                "the max error of {max_error} exceeds the stored bound {bound}"
            ))
        }
    }
}

fn repair(file: &Path, output: Option<&Path>) -> Result<Report> {
    let progress = start_progress("repairing", file)?;
    let mut step = |done, total| progress.step(done, total);
    let repaired = tool::repair(file, output.unwrap_or(file), &mut step)?;
    Ok(Report::default()
        .with("damaged_blocks", repaired.damaged_blocks)
        .with("lost_blocks", repaired.lost_blocks)
        .with("missing_blocks", repaired.missing_blocks)
        .with("blocked_blocks", repaired.blocked_blocks)
        .with("coarse_samples", repaired.coarse_samples)
        .with("coarse_percent", repaired.coarse_percent)
        .with("area_left_coarse", repaired.coarse_percent / 100.0)
        .with("coarsest_level", repaired.coarsest_level)
        .with("bytes", repaired.bytes))
}

fn update(arguments: &arguments::Update) -> Result<Report> {
    let start = Instant::now();
    let file = &arguments.file;
    let (raster, is_colour) = {
        let layer = open(file)?;
        let raster = layer.raster_info().clone();
        (raster, layer.header().kind == Kind::Colours)
    };
    let corners = corners_of(&arguments.region);
    let region = tool::window_in_box(&raster, 1, corners)?;
    let mut source = open_all(&arguments.sources, &arguments.source.options(is_colour))?;
    let new = Placed::by_georeference(source.as_mut(), &raster, region)?;
    let options = Update {
        region,
        rms_error: arguments.rms,
        memory: arguments.memory.map(|mebibytes| mebibytes << 20),
        threads: arguments.threads,
    };
    let progress = start_progress("updating", file)?;
    let mut step = |done, total| progress.step(done, total);
    let updated = tool::update(file, new, &options, &mut step)?;
    Ok(Report::default()
        .with("diamonds_recomputed", updated.diamonds_recomputed)
        .with("diamonds", updated.diamonds)
        .with("bytes", updated.bytes)
        .with("seconds", start.elapsed().as_secs_f64()))
}

/// Four numbers as the corners of a box.
fn corners_of(numbers: &[f64]) -> [f64; 4] {
    std::array::from_fn(|place| numbers.get(place).copied().unwrap_or(f64::NAN))
}

fn extract(arguments: &arguments::Extract) -> Result<Report> {
    if let Some(node) = arguments.block {
        return cities::extract(&arguments.file, node, &arguments.output);
    }
    let corners = arguments.bbox.as_deref().map(corners_of);
    let what = Extract {
        level: arguments.level,
        corners,
    };
    let layer = open(&arguments.file)?;
    let progress = start_progress("extracting", &arguments.file)?;
    let mut step = |done, total| progress.step(done, total);
    let extracted = tool::extract(&layer, &arguments.output, &what, &mut step)?;
    Ok(Report::default()
        .with("width", extracted.width)
        .with("height", extracted.height)
        .with("level", extracted.level)
        .with("coarse_samples", extracted.coarse_samples))
}

fn fly(arguments: &arguments::Fly) -> Result<Report> {
    let flight = Flight {
        frames: arguments.frames,
        viewport: arguments.size,
        tolerance: arguments.tolerance,
        options: CutOptions {
            metric: match arguments.metric {
                arguments::Metric::Geometric => Metric::Geometric,
                arguments::Metric::Sampling => Metric::Sampling,
            },
            threads: arguments.threads.into(),
            colours: colouring(arguments)?,
            detail: Detail {
                levels: arguments.detail,
                roughness: arguments.roughness,
            },
            ..CutOptions::default()
        },
        budget_microseconds: arguments.budget_us,
    };
    let terrain = open_heights(&arguments.file)?;
    let progress = start_progress("flying", &arguments.file)?;
    let mut step = |done, total| progress.step(done, total);
    let flown = tool::fly(&terrain, &flight, &mut step)?;
    Ok(Report::default()
        .with("frames", flown.frames)
        .with("update_us_p50", flown.update_us_p50)
        .with("update_us_p99", flown.update_us_p99)
        .with("update_us_max", flown.update_us_max)
        .with("fixed_us_p50", flown.fixed_us_p50)
        .with("fixed_us_p99", flown.fixed_us_p99)
        .with("budget_overruns", flown.budget_overruns)
        .with("triangles_mean", flown.triangles_mean)
        .with("patches_mean", flown.patches_mean)
        .with("cracks", flown.cracks)
        .with("refined_diamonds", flown.refined_diamonds)
        .with("peak_memory_bytes", peak_memory_bytes()))
}

fn colouring(arguments: &arguments::Fly) -> Result<Option<Colouring>> {
    let Some(file) = &arguments.colour else {
        return Ok(None);
    };
    Ok(Some(Colouring {
        layer: Arc::new(open(file)?),
        form: ColourForm::Texture,
        texel_pixels: arguments.texel_pixels,
    }))
}

fn bench(file: &Path) -> Result<Report> {
    let speed = tool::bench(&open(file)?)?;
    Ok(Report::default()
        .with("decode_msamples_per_s", speed.decode_msamples_per_s)
        .with("get_ns_p50", speed.get_ns_p50)
        .with("get_ns_p99", speed.get_ns_p99))
}

fn height(file: &Path, x: f64, y: f64) -> Result<Report> {
    let terrain = open_heights(file)?;
    let mut query = Query::new(terrain.clone(), QUERY_BYTES);
    let Some(found) = query.height_at_crs(x, y)? else {
        let raster = &terrain.header().raster;
        let inside = raster.crs_to_sample(x, y).is_some_and(|[column, row]| {
            (0.0..=f64::from(raster.width) - 1.0).contains(&column)
                && (0.0..=f64::from(raster.height) - 1.0).contains(&row)
        });
        let cause = if inside {
            "is void"
        } else {
            "is outside the raster's samples"
        };
        return Err(Error::Argument(format!("({x}, {y}) {cause}")));
    };
    Ok(Report::default()
        .with("height", found.height)
        .with("error_bound", found.error_bound)
        .with("level", found.level))
}
