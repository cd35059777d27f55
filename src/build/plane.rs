//! The whole raster, in memory or in a temporary file.

use super::source::RasterSource;
use super::workspace::{Spill, Workspace};
use crate::geo::{RasterInfo, SampleType};
use crate::lattice::CentreRun;
use crate::schedule::map_taken;
use crate::vectors::widened;
use crate::{Error, Result};

/// Samples as their source gave them, row by row; a void is NaN in all bands.
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Numbers of a sample.
    pub(super) bands: usize,
    /// `[sample * bands + band]`.
    numbers: Spill,
    /// Numbers are kept as f32, which holds all of their type.
    is_narrow: bool,
    /// Least and greatest number of any valid sample; zeros when there is none.
    pub(super) sample_range: [f64; 2],
    pub(super) void_samples: u64,
}

/// Memory for samples that are read; its content means nothing.
#[derive(Default)]
pub(super) struct Scratch {
    bytes: Vec<u8>,
    numbers: Vec<f64>,
}

/// What the samples are called in a working store, and what is told of them.
const NUMBERS: &str = "samples";
const SAVED: &str = "plane";
/// Samples asked of a source at a time: in `f64` they stay in a processor's own cache.
const BAND_SAMPLES: usize = 1 << 15;

impl Plane {
    /// Bytes that a number of this type is kept in.
    pub(super) fn number_bytes(sample_type: SampleType) -> u64 {
        let is_wide = matches!(
            sample_type,
            SampleType::U32 | SampleType::I32 | SampleType::F64
        );
        if is_wide { 8 } else { 4 }
    }

    /// Reads a source to its end, unless that was done before; `progress` gets the samples read so far and
    /// returns false to cancel.
    pub(super) fn read(
        source: &mut dyn RasterSource,
        workspace: &Workspace,
        threads: usize,
        mut progress: impl FnMut(u64) -> bool,
    ) -> Result<Plane> {
        if let Some(saved) = workspace.load(SAVED)? {
            return Plane::restore(source.info(), workspace, &saved);
        }
        let info = source.info();
        let (width, height) = (info.width as usize, info.height as usize);
        let bands = usize::from(info.bands);
        let number_bytes = Plane::number_bytes(info.sample_type);
        let exceeded = || Error::Argument(format!("{width} x {height} samples exceed the memory"));
        let count = width.checked_mul(height).ok_or_else(exceeded)?;
        let bytes = (count as u64).checked_mul(bands as u64 * number_bytes);
        let mut plane = Plane {
            width,
            height,
            bands,
            numbers: Spill::new(workspace, NUMBERS, bytes.ok_or_else(exceeded)?)?,
            is_narrow: number_bytes == 4,
            sample_range: [f64::INFINITY, f64::NEG_INFINITY],
            void_samples: 0,
        };
        plane.read_all(source, threads, &mut progress)?;
        if plane.void_samples == count as u64 {
            plane.sample_range = [0.0, 0.0];
        }
        let told: &[u8] = bytemuck::cast_slice(&plane.sample_range);
        let seal = plane.numbers.seal()?;
        let saved = [told, &plane.void_samples.to_ne_bytes(), &seal].concat();
        workspace.save(vec![(SAVED.to_owned(), saved)])?;
        Ok(plane)
    }

    /// The plane that was saved.
    fn restore(info: &RasterInfo, workspace: &Workspace, saved: &[u8]) -> Result<Plane> {
        let (told, seal) = saved.split_at(24.min(saved.len()));
        let told = told.as_chunks::<8>().0;
        let told = |place: usize| told.get(place).copied().unwrap_or_default();
        Ok(Plane {
            width: info.width as usize,
            height: info.height as usize,
            bands: usize::from(info.bands),
            numbers: Spill::restore(workspace, NUMBERS, seal)?,
            is_narrow: Plane::number_bytes(info.sample_type) == 4,
            sample_range: [0, 1].map(|end| f64::from_ne_bytes(told(end))),
            void_samples: u64::from_ne_bytes(told(2)),
        })
    }

    /// Keeps all samples of a source, and what is to be said of them. One thread at a time reads rows; what it
    /// read it looks at by itself.
    fn read_all(
        &mut self,
        source: &mut dyn RasterSource,
        threads: usize,
        progress: &mut impl FnMut(u64) -> bool,
    ) -> Result<()> {
        let info = source.info().clone();
        let (width, height) = (self.width, self.height);
        let band_rows = (BAND_SAMPLES / width).max(1);
        let mut has_failed = false;
        let bands = (0..height).step_by(band_rows).map_while(|row| {
            let rows = band_rows.min(height - row);
            let mut band = vec![f64::NAN; rows * info.row_length()];
            let read = source.read_rows(&mut band);
            let before = std::mem::replace(&mut has_failed, read.is_err());
            (!before).then(|| read.map(|()| band))
        });
        let shape = Shape {
            width,
            is_narrow: self.is_narrow,
            info: &info,
        };
        let work = |index: usize, band: Result<Vec<f64>>| {
            let band = band?;
            let told = shape.look(&band, index * band_rows * width)?;
            Ok((told, shape.to_bytes(&band), band.len() / self.bands))
        };
        let ([mut low, mut high], mut voids, mut done) = (self.sample_range, 0, 0);
        let numbers = &mut self.numbers;
        map_taken(threads, bands, work, |_, made| {
            let (([least, greatest], own_voids), bytes, samples) = made?;
            (low, high) = (low.min(least), high.max(greatest));
            voids += own_voids;
            done += samples as u64;
            numbers.append(&bytes)?;
            if progress(done) {
                Ok(())
            } else {
                Err(Error::Cancelled)
            }
        })?;
        (self.sample_range, self.void_samples) = ([low, high], voids);
        Ok(())
    }

    /// How many samples there are, valid and void.
    pub(super) fn count(&self) -> usize {
        self.width * self.height
    }

    /// The samples at the centres of a run, which lies inside the raster: `[centre * bands + band]`.
    pub(super) fn read_run<'a>(
        &self,
        run: CentreRun,
        scratch: &'a mut Scratch,
    ) -> Result<&'a [f64]> {
        let length = if self.is_narrow { 4 } else { 8 };
        let sample = length * self.bands;
        let start = run.row as u64 * self.width as u64 + run.column as u64;
        let span = (run.count - 1) * run.step as usize + 1;
        let Scratch { bytes, numbers } = scratch;
        let bytes = self
            .numbers
            .read(start * sample as u64, span * sample, bytes)?;
        numbers.clear();
        if self.bands > 1 && run.step > 1 {
            let spaced = bytes.chunks(sample * run.step as usize);
            spaced.for_each(|spaced| self.put_numbers(&spaced[..sample], 1, numbers));
        } else {
            self.put_numbers(bytes, run.step as usize, numbers);
        }
        Ok(numbers)
    }

    /// Every `step`th of the numbers that these bytes keep.
    fn put_numbers(&self, bytes: &[u8], step: usize, numbers: &mut Vec<f64>) {
        let start = numbers.len();
        if !self.is_narrow {
            let own = bytes.as_chunks::<8>().0.iter().step_by(step);
            numbers.extend(own.map(|&bytes| f64::from_ne_bytes(bytes)));
        } else if step == 1 {
            let (own, _) = bytes.as_chunks::<4>();
            numbers.resize(start + own.len(), 0.0);
            widen_numbers(own, &mut numbers[start..]);
        } else {
            let (own, _) = bytes.as_chunks::<4>();
            let places = 0..own.len().div_ceil(step);
            numbers.extend(places.map(|place| f64::from(f32::from_ne_bytes(own[place * step]))));
        }
    }

    /// The samples of a row from one column on.
    pub(super) fn read_row<'a>(
        &self,
        row: i64,
        column: i64,
        count: usize,
        scratch: &'a mut Scratch,
    ) -> Result<&'a [f64]> {
        let run = CentreRun {
            row,
            column,
            step: 1,
            count,
            index: 0,
            stride: 1,
        };
        self.read_run(run, scratch)
    }

    /// Whether all rows have a property, which is told their numbers.
    pub(super) fn all_rows(&self, mut has: impl FnMut(&[f64]) -> bool) -> Result<bool> {
        let mut scratch = Scratch::default();
        for row in 0..self.height as i64 {
            if !has(self.read_row(row, 0, self.width, &mut scratch)?) {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// What the samples of a source are like.
struct Shape<'a> {
    width: usize,
    is_narrow: bool,
    info: &'a RasterInfo,
}

impl Shape<'_> {
    /// Numbers as they are kept.
    fn to_bytes(&self, numbers: &[f64]) -> Vec<u8> {
        if !self.is_narrow {
            return bytemuck::cast_slice(numbers).to_vec();
        }
        let mut bytes = vec![0; 4 * numbers.len()];
        let (narrow, _) = bytes.as_chunks_mut::<4>();
        narrow_numbers(numbers, narrow);
        bytes
    }

    /// Least and greatest number of valid samples, of which the first has this number, and how many are void.
    fn look(&self, numbers: &[f64], start: usize) -> Result<([f64; 2], u64)> {
        let (info, bands) = (self.info, usize::from(self.info.bands));
        if let Some(told) = self.survey(numbers) {
            return Ok(told);
        }
        let what = if bands == 1 { "height" } else { "colour" };
        let ([mut low, mut high], mut voids) = ([f64::INFINITY, f64::NEG_INFINITY], 0);
        for (offset, sample) in numbers.chunks_exact(bands).enumerate() {
            if is_void(sample) {
                voids += 1;
                continue;
            }
            for &number in sample {
                if !number.is_finite() || !info.sample_type.holds(number) {
                    let index = start + offset;
                    return Err(Error::Argument(format!(
                        "the sample at column {}, row {} is {number}, which is no {} {what}",
                        index % self.width,
                        index / self.width,
                        info.sample_type.name(),
                    )));
                }
                low = low.min(number);
                high = high.max(number);
            }
        }
        Ok(([low, high], voids))
    }

    /// The same at once, where nothing is wrong and no colour is void.
    fn survey(&self, numbers: &[f64]) -> Option<([f64; 2], u64)> {
        let own = survey(numbers);
        let mut range = own.range;
        let is_exact = match self.info.sample_type {
            SampleType::F64 => true,
            SampleType::F32 => own.are_single,
            _ => own.are_whole,
        };
        let has_type = |&end: &f64| end.is_finite() && self.info.sample_type.holds(end);
        let is_empty = own.voids == numbers.len() as u64;
        if !is_exact || !is_empty && !range.iter().all(has_type) {
            return None;
        }
        for end in range.iter_mut().filter(|end| **end == 0.0) {
            // Of the two zeros the first one.
            *end = numbers.iter().copied().find(|&number| number == 0.0)?;
        }
        (own.voids == 0 || self.info.bands == 1).then_some((range, own.voids))
    }
}

/// What is said of some numbers.
struct Survey {
    /// Least and greatest of those that are not NaN.
    range: [f64; 2],
    /// How many are NaN.
    voids: u64,
    /// The others are integers, if their sizes are below 2^51.
    are_whole: bool,
    /// The others are exact in 32 bits.
    are_single: bool,
}

/// A sum with it has no bits for fractions.
const WHOLE: f64 = 1.5 * (1u64 << 52) as f64;

widened! {
    fn survey(numbers: &[f64]) -> Survey {
        let (mut low, mut high, mut voids) = (f64::INFINITY, f64::NEG_INFINITY, 0);
        let (mut are_whole, mut are_single) = (true, true);
        for &number in numbers {
            low = if number < low { number } else { low };
            high = if number > high { number } else { high };
            let is_void = number.is_nan();
            voids += u64::from(is_void);
            are_whole &= is_void | ((number + WHOLE) - WHOLE == number);
            are_single &= is_void | (f64::from(number as f32) == number);
        }
        Survey { range: [low, high], voids, are_whole, are_single }
    }
}

widened! {
    fn narrow_numbers(numbers: &[f64], narrow: &mut [[u8; 4]]) {
        for (narrow, &number) in narrow.iter_mut().zip(numbers) {
            *narrow = (number as f32).to_ne_bytes();
        }
    }
}

widened! {
    fn widen_numbers(narrow: &[[u8; 4]], numbers: &mut [f64]) {
        for (number, &narrow) in numbers.iter_mut().zip(narrow) {
            *number = f64::from(f32::from_ne_bytes(narrow));
        }
    }
}

/// Whether a sample is void.
pub(super) fn is_void(sample: &[f64]) -> bool {
    sample.first().is_none_or(|number| number.is_nan())
}
