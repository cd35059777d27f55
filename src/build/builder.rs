//! The builder: samples to blocks, level by level, each going on from what the decoder returns.

use super::plane::Plane;
use super::source::RasterSource;
use super::surface::LeafSurface;
use super::workers::{map_in_order, thread_count};
use crate::codec::{
    BlockCodec, ErrorCode, Matrix, RangeCode, RootCodec, Units, block_length_unit, child_vertices,
    codable_centres,
};
use crate::lattice::{Diamond, Lattice};
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
    let mut work = Build::new(&lattice, &plane, &units, threads);
    let roots = work.code_root()?;
    let mut writer = Writer::with_sink(output, sink, &header, &roots, &[])?;
    let mut done = samples;
    let mut step = |samples: u64| {
        done += samples;
        if progress(done.min(total), total) {
            Ok(())
        } else {
            Err(Error::Cancelled)
        }
    };
    for level in 0..lattice.levels() {
        work.code_level(level, &mut writer, &mut step)?;
    }
    let codes = work.codes(&mut step)?;
    let (max_error, rms_error) = work.measured_error();
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

/// A repository in the making: everything in memory but the finished blocks.
struct Build<'a> {
    lattice: &'a Lattice,
    plane: &'a Plane,
    units: &'a Units,
    codec: BlockCodec,
    threads: usize,
    /// Vertex matrices of all refinable levels, in the order of ranks.
    vertices: Vec<Matrix>,
    /// Centre matrices of the level coded last.
    centres: Vec<Matrix>,
    /// Decoded units of all samples.
    heights: Vec<i32>,
}

impl<'a> Build<'a> {
    fn new(lattice: &'a Lattice, plane: &'a Plane, units: &'a Units, threads: usize) -> Build<'a> {
        let transform =
            Interpolating::new(lattice.cells(), units.bound, units.range[0], units.range[1]);
        Build {
            lattice,
            plane,
            units,
            codec: BlockCodec::new(lattice.cells(), plane.void_samples > 0, Box::new(transform)),
            threads,
            vertices: Vec::new(),
            centres: Vec::new(),
            heights: vec![0; plane.samples.len()],
        }
    }

    /// Codes the root's vertices and keeps what they decode to.
    fn code_root(&mut self) -> Result<Vec<u8>> {
        let codec = RootCodec::new(self.lattice, self.units.bound, self.units.range);
        let bytes = codec.encode(|at| self.plane.unit(self.units, at));
        let matrix = codec
            .decode(&bytes)
            .map_err(|error| disagreement("the root", error))?;
        let (placement, side) = (
            self.lattice.placement(self.lattice.root()),
            self.lattice.cells() + 1,
        );
        for (index, &height) in matrix.values.iter().enumerate() {
            let at = placement.vertex(index % side, index / side);
            if self.lattice.in_raster(at) {
                self.heights[at[1] as usize * self.plane.width + at[0] as usize] = height;
            }
        }
        self.vertices.push(matrix);
        Ok(bytes)
    }

    /// Codes the diamonds of one level into the writer, and gathers the vertices of the next.
    fn code_level(
        &mut self,
        level: u32,
        writer: &mut Writer,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        let ranks = self.lattice.level_ranks(level);
        let diamonds = self.lattice.diamonds(level);
        let mut centres = Vec::with_capacity(diamonds.len());
        let (codec, plane, lattice, units) = (&self.codec, self.plane, self.lattice, self.units);
        let vertices = &self.vertices[ranks.start as usize..];
        let code = |index: usize| {
            let codable = codable_centres(lattice, diamonds[index]);
            let (samples, voids) = plane.centres_of(lattice, units, diamonds[index], &codable);
            let block = codec.encode(
                &vertices[index],
                codable.as_deref(),
                &samples,
                voids.as_deref(),
            );
            let decoded = codec.decode(&vertices[index], codable.as_deref(), &block);
            (block, codable, decoded)
        };
        let heights = &mut self.heights;
        map_in_order(
            self.threads,
            diamonds.len(),
            code,
            |index, (block, codable, decoded)| {
                let decoded = decoded.map_err(|error| disagreement("a block", error))?;
                writer.push(&block)?;
                let counted = scatter(lattice, plane, diamonds[index], &codable, &decoded, heights);
                centres.push(decoded);
                step(counted)
            },
        )?;
        self.centres = centres;
        if level + 1 < self.lattice.levels() {
            self.gather_level(level + 1)?;
        }
        Ok(())
    }

    fn gather_level(&mut self, level: u32) -> Result<()> {
        let parents_start = self.lattice.level_ranks(level - 1).start;
        let diamonds = self.lattice.diamonds(level);
        let gather = |index: usize| {
            let diamond = diamonds[index];
            let parents = self.lattice.parents(diamond).map(|parent| {
                parent.map(|parent| {
                    let rank = self.lattice.rank(parent);
                    (
                        &self.vertices[rank as usize],
                        &self.centres[(rank - parents_start) as usize],
                    )
                })
            });
            child_vertices(self.lattice, diamond, parents)
        };
        let mut gathered = Vec::with_capacity(diamonds.len());
        map_in_order::<_, Error>(self.threads, diamonds.len(), gather, |_, matrix| {
            gathered.push(matrix);
            Ok(())
        })?;
        self.vertices.append(&mut gathered);
        Ok(())
    }

    /// Error, low and high code of every diamond by rank (`codec::bounds`).
    fn codes(&self, step: &mut dyn FnMut(u64) -> Result<()>) -> Result<Vec<[u8; 3]>> {
        let count = self.lattice.diamond_count() as usize;
        let surface = LeafSurface {
            lattice: self.lattice,
            plane: self.plane,
            heights: &self.heights,
        };
        let mut errors = Vec::with_capacity(count);
        let per_level = self.plane.samples.len() as u64;
        let measure =
            |rank: usize| surface.error_of(self.lattice.diamond(rank as u64), &self.vertices[rank]);
        map_in_order(self.threads, count, measure, |rank, error| {
            errors.push(error);
            let level = self.lattice.diamond(rank as u64).level();
            let ranks = self.lattice.level_ranks(level);
            step(per_level / (ranks.end - ranks.start))
        })?;
        let ranges = self.nest(&mut errors);
        Ok(self.encode_summaries(&errors, &ranges))
    }

    /// Makes every diamond's error and range contain those of its children; returns the ranges.
    fn nest(&self, errors: &mut [f64]) -> Vec<[i32; 2]> {
        let count = errors.len();
        let extremes = |matrix: &Matrix| {
            let least = matrix.values.iter().copied().min().unwrap_or_default();
            let greatest = matrix.values.iter().copied().max().unwrap_or_default();
            [least, greatest]
        };
        let mut ranges: Vec<[i32; 2]> = self.vertices[..count].iter().map(extremes).collect();
        let last_level = self.lattice.levels().saturating_sub(1);
        let last_start = count - self.centres.len().min(count);
        for rank in (0..count).rev() {
            let diamond = self.lattice.diamond(rank as u64);
            if diamond.level() == last_level {
                let inner = extremes(&self.centres[rank - last_start]);
                ranges[rank] = union(ranges[rank], inner);
            }
            for parent in self.lattice.parents(diamond).into_iter().flatten() {
                let parent = self.lattice.rank(parent) as usize;
                errors[parent] = errors[parent].max(errors[rank]);
                ranges[parent] = union(ranges[parent], ranges[rank]);
            }
        }
        ranges
    }

    fn encode_summaries(&self, errors: &[f64], ranges: &[[i32; 2]]) -> Vec<[u8; 3]> {
        let mut decoded: Vec<[i32; 2]> = Vec::with_capacity(ranges.len());
        let mut codes = Vec::with_capacity(ranges.len());
        for (rank, (&error, &range)) in errors.iter().zip(ranges).enumerate() {
            let parents = self.lattice.parents(self.lattice.diamond(rank as u64));
            let reference = match parents.into_iter().flatten().next() {
                Some(parent) => decoded[self.lattice.rank(parent) as usize],
                None => self.units.range,
            };
            let code = RangeCode::covering(range, reference);
            decoded.push(code.range(reference));
            codes.push([ErrorCode::covering(error).0, code.low, code.high]);
        }
        codes
    }

    /// Largest and root mean square |decoded - input| over the valid samples.
    fn measured_error(&self) -> (f64, f64) {
        let (mut largest, mut sum, mut count) = (0f64, 0f64, 0u64);
        for (&sample, &unit) in self.plane.samples.iter().zip(&self.heights) {
            if !sample.is_nan() {
                let error = (self.units.to_sample(unit) - sample).abs();
                largest = largest.max(error);
                sum += error * error;
                count += 1;
            }
        }
        (largest, (sum / count.max(1) as f64).sqrt())
    }
}

/// Puts decoded centres at their places among all samples; returns how many there were.
fn scatter(
    lattice: &Lattice,
    plane: &Plane,
    diamond: Diamond,
    codable: &Option<Box<[u8]>>,
    centres: &Matrix,
    heights: &mut [i32],
) -> u64 {
    let (placement, cells) = (lattice.placement(diamond), lattice.cells());
    let mut count = 0;
    for (index, &height) in centres.values.iter().enumerate() {
        if codable.as_ref().is_none_or(|codable| codable[index] != 0) {
            let [column, row] = placement.centre(index % cells, index / cells);
            heights[row as usize * plane.width + column as usize] = height;
            count += 1;
        }
    }
    count
}

fn union(a: [i32; 2], b: [i32; 2]) -> [i32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// The encoder and the decoder contradict each other, which only a defect of this library can cause.
fn disagreement(what: &str, error: crate::codec::BlockError) -> Error {
    Error::Argument(format!(
        "internal error: {what} just written does not decode: {error}"
    ))
}
