//! The builder: samples to blocks, level by level, each going on from what the decoder returns.

use super::descent::{Descent, Input, disagreement};
use super::levels::Levels;
use super::plane::Plane;
use super::source::RasterSource;
use super::summaries::summary_codes;
use super::workers::thread_count;
use crate::codec::{BlockCodec, Refined, RootCodec, Units, block_length_unit};
use crate::lattice::Lattice;
use crate::store::{DomainKind, EntropyKind, FileSink, Header, Kind, TransformKind, Writer};
use crate::transform::Interpolating;
use crate::{Error, Result};
use std::path::Path;

/// How to build.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// Largest |decoded - input| of any valid sample, in the raster's own units; 0 for lossless.
    pub max_error: f64,
    /// log2 of the cells along a diamond's side: 4 to 7.
    pub cells_log2: u32,
    /// Worker threads; 0 for all that the machine has. The output does not depend on it.
    pub threads: usize,
}

impl Default for BuildOptions {
    fn default() -> BuildOptions {
        BuildOptions {
            max_error: 0.0,
            cells_log2: 6,
            threads: 0,
        }
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
}

/// Builds the repository of a raster's heights at `output`, written beside it and renamed when whole.
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
    let info = source.info().clone();
    let lattice = Lattice::new(info.width, info.height, options.cells_log2)?;
    if !(4..=7).contains(&options.cells_log2) {
        let cells = lattice.cells();
        return Err(Error::Argument(format!(
            "cells must be 16, 32, 64 or 128, not {cells}"
        )));
    }
    // First of all, so that an output that cannot be written is found before the input is read.
    let sink = Box::new(FileSink::create(output)?);
    // Each sample is read once, coded once, and measured once for each level's error.
    let samples = u64::from(info.width) * u64::from(info.height);
    let total = samples * (2 + u64::from(lattice.levels()));
    let plane = Plane::read(source, |done| progress(done, total))?;
    let unit = match options.max_error {
        0.0 if !info.sample_type.is_integer() => Some(lossless_unit(&plane, &info)?),
        _ => None,
    };
    let units = Units::new(&info, plane.sample_range, options.max_error, unit)?;
    let header = Header {
        kind: Kind::Heights,
        domain: DomainKind::Planar,
        transform: TransformKind::Interpolating,
        entropy: EntropyKind::Gamma,
        cells_log2: options.cells_log2 as u8,
        levels: lattice.levels() as u8,
        lossless: units.bound == 0 && (unit.is_some() || info.sample_type.is_integer()),
        block_length_unit: block_length_unit(lattice.cells()),
        bound_units: units.bound as u32,
        unit_min: units.range[0],
        unit_max: units.range[1],
        unit_scale: units.scale,
        unit_offset: units.offset,
        sample_min: units.sample_range[0],
        sample_max: units.sample_range[1],
        max_error_bound: options.max_error,
        max_error: 0.0,
        rms_error: 0.0,
        samples,
        void_samples: plane.void_samples,
        block_count: lattice.diamond_count(),
        raster: info,
    };
    let threads = thread_count(options.threads);
    let mut done = samples;
    let mut step = |samples: u64| {
        done += samples;
        if progress(done.min(total), total) {
            Ok(())
        } else {
            Err(Error::Cancelled)
        }
    };
    let transform =
        Interpolating::new(lattice.cells(), units.quantiser());
    let codec = BlockCodec::new(lattice.cells(), plane.void_samples > 0, Box::new(transform));
    let levels = Levels::new(
        &lattice,
        &plane,
        &units,
        codec.transform(),
        threads,
        &mut step,
    )?;
    let root_codec = RootCodec::new(&lattice, units.bound, units.range);
    let (mut descent, roots) = Descent::new(&levels, &root_codec, threads)?;
    let mut writer = Writer::with_sink(output, sink, &header, &roots, &[])?;
    for level in 0..lattice.levels() {
        let code = |input: Input| code_block(&codec, input);
        descent.code_level(level, code, |block, samples| {
            writer.push(&block)?;
            step(samples)
        })?;
    }
    let codes = summary_codes(&levels, &descent, units.range, threads, &mut step)?;
    let (max_error, rms_error) = measured_error(&plane, &units, &descent.heights);
    let bytes = writer.finish(
        &Header {
            max_error,
            rms_error,
            ..header
        },
        &codes,
    )?;
    progress(total, total);
    Ok(BuildReport {
        samples,
        void_samples: plane.void_samples,
        bytes,
        max_error,
        rms_error,
    })
}

/// The unit of which all samples of a float raster are multiples.
fn lossless_unit(plane: &Plane, info: &crate::geo::RasterInfo) -> Result<f64> {
    Units::common_unit(info.sample_type, &plane.samples).ok_or_else(|| {
        let magnitude = plane.sample_range[0].abs().max(plane.sample_range[1].abs());
        Error::Argument(format!(
            "maximum error 0 needs {} samples that are multiples of one power of ten or of two, and these are not: \
             give a maximum error above {:e}",
            info.sample_type.name(),
            magnitude * f64::from(f32::EPSILON),
        ))
    })
}

/// A diamond's block, and what it decodes to.
fn code_block(codec: &BlockCodec, input: Input) -> Result<(Vec<u8>, Refined)> {
    let (vertices, outline) = (input.vertices, input.outline);
    let block = codec.encode(vertices, outline, input.target, input.voids);
    let refined = codec
        .decode(vertices, outline, &block)
        .map_err(|error| disagreement("a block", error))?;
    Ok((block, refined))
}

/// Largest and root mean square |decoded - input| over the valid samples.
fn measured_error(plane: &Plane, units: &Units, heights: &[i32]) -> (f64, f64) {
    let (mut largest, mut sum, mut count) = (0f64, 0f64, 0u64);
    for (&sample, &unit) in plane.samples.iter().zip(heights) {
        if !sample.is_nan() {
            let error = (units.to_sample(unit) - sample).abs();
            largest = largest.max(error);
            sum += error * error;
            count += 1;
        }
    }
    (largest, (sum / count.max(1) as f64).sqrt())
}
