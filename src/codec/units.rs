//! Integer units of a raster's samples, and the quantiser's bound in them.

use crate::geo::{RasterInfo, SampleType};
use crate::vectors::widened;
use crate::{Error, Result};

/// `sample = unit * scale + offset`, clamped to the samples' own range.
#[derive(Clone, Debug, PartialEq)]
pub struct Units {
    /// Sample units a unit.
    pub scale: f64,
    /// Sample value of unit 0.
    pub offset: f64,
    /// Least and greatest unit of any valid sample, or of any height of any level where those may be
    /// beyond.
    pub range: [i32; 2],
    /// Least and greatest valid sample.
    pub sample_range: [f64; 2],
    /// The quantiser's bound e, in units.
    pub bound: i32,
    /// How samples are stored.
    pub sample_type: SampleType,
    /// The value that no valid sample may become.
    pub nodata: Option<f64>,
}

/// Largest bound of the quantiser: its step 2e + 1 stays within `i32`.
const GREATEST_BOUND: f64 = ((1 << 30) - 1) as f64;
/// Largest magnitude of a float raster's units, which leaves room for sums in 32 bits.
const GREATEST_FLOAT_UNIT: f64 = (1 << 29) as f64;
/// Units per quantiser step of float rasters: 2m + 1, fine enough that rounding a prediction to units
/// costs nothing measurable.
const FLOAT_BOUND: f64 = 7.0;
/// Units of float rasters in an RMS error, for the same reason.
const RMS_UNITS: f64 = 16.0;

impl Units {
    /// Units for a raster whose valid samples span `sample_range`, so that |decoded - sample| is at most
    /// `max_error` (in sample units) for every valid sample.
    ///
    /// For floats and `max_error` 0 all samples must be multiples of `unit`.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a `max_error` that is negative or not a number, or, with floats, one
    /// too small for 32-bit units or for the sample type, with the least that works.
    pub fn new(
        info: &RasterInfo,
        sample_range: [f64; 2],
        max_error: f64,
        unit: Option<f64>,
    ) -> Result<Units> {
        if max_error.is_nan() || max_error < 0.0 {
            return Err(Error::Argument(format!(
                "the maximum error must be a number from 0 up, not {max_error}"
            )));
        }
        let mut units = Units::ones(info, sample_range);
        if info.sample_type.is_integer() {
            let bound = max_error.floor().min(GREATEST_BOUND) as i32;
            units.bound = bound - i32::from(bound > 0 && units.nodata_is_in_range());
        } else if max_error == 0.0 {
            let unit = unit.ok_or_else(|| {
                Error::Argument(
                    "maximum error 0 on floats needs the unit they are multiples of".into(),
                )
            })?;
            units.scale = unit;
        } else {
            units.choose_float_scale(info, max_error)?;
        }
        units.range = sample_range.map(|sample| units.to_unit(sample));
        Ok(units)
    }

    /// Units fine enough for a root mean square error of `rms_error` (in sample units), with the bound 0.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for an `rms_error` that is negative, not a number, or 0 with floats; for floats
    /// of an infinite extent.
    pub fn for_rms_error(
        info: &RasterInfo,
        sample_range: [f64; 2],
        rms_error: f64,
    ) -> Result<Units> {
        let is_integer = info.sample_type.is_integer();
        if !(rms_error > 0.0 || rms_error == 0.0 && is_integer) {
            return Err(Error::Argument(format!(
                "the RMS error must be a number above 0, not {rms_error}"
            )));
        }
        let mut units = Units::ones(info, sample_range);
        if !is_integer {
            let half_extent = units.centre();
            if !half_extent.is_finite() {
                return Err(Error::Argument(format!(
                    "samples from {} to {} are too far apart for 32-bit units",
                    sample_range[0], sample_range[1]
                )));
            }
            units.scale = (rms_error / RMS_UNITS).max(half_extent / (GREATEST_FLOAT_UNIT - 1.0));
        }
        units.range = sample_range.map(|sample| units.to_unit(sample));
        Ok(units)
    }

    /// Units of one sample unit, without any bound, their range not yet known.
    fn ones(info: &RasterInfo, sample_range: [f64; 2]) -> Units {
        // Only u32 goes beyond i32; it is moved down to it.
        let is_beyond = info.sample_type.is_integer() && sample_range[1] > f64::from(i32::MAX);
        Units {
            scale: 1.0,
            offset: if is_beyond { 2_147_483_648.0 } else { 0.0 },
            range: [0, 0],
            sample_range,
            bound: 0,
            sample_type: info.sample_type,
            nodata: info.nodata,
        }
    }

    /// Puts unit 0 in the middle of the samples; returns the distance to the farthest.
    fn centre(&mut self) -> f64 {
        let [low, high] = self.sample_range;
        self.offset = ((low + high) / 2.0).round();
        (high - self.offset).max(self.offset - low)
    }

    /// What the maximum error of a float raster must be above, other than 0.
    pub fn least_max_error(info: &RasterInfo, sample_range: [f64; 2]) -> f64 {
        let mut units = Units::ones(info, sample_range);
        units.output_rounding() + units.centre() / GREATEST_FLOAT_UNIT
    }

    fn choose_float_scale(&mut self, info: &RasterInfo, max_error: f64) -> Result<()> {
        let [low, high] = self.sample_range;
        let half_extent = self.centre();
        let least = Units::least_max_error(info, self.sample_range);
        if max_error <= least || !half_extent.is_finite() {
            return Err(Error::Argument(format!(
                "a maximum error of {max_error} is too small for {} samples from {low} to {high}: give more than {least:e}",
                self.sample_type.name()
            )));
        }
        let usable = 2.0 * (max_error - self.output_rounding());
        for bound in [FLOAT_BOUND, 1.0, 0.0] {
            self.scale = usable / (2.0 * bound + 1.0);
            self.bound = bound as i32;
            if half_extent / self.scale < GREATEST_FLOAT_UNIT {
                break;
            }
        }
        Ok(())
    }

    /// Most that a decoded value changes when it is written as the sample type.
    fn output_rounding(&self) -> f64 {
        let magnitude = self.sample_range[0].abs().max(self.sample_range[1].abs());
        let ulp = match self.sample_type {
            SampleType::F32 => {
                f64::from((magnitude as f32).next_up()) - f64::from(magnitude as f32)
            }
            _ => magnitude.next_up() - magnitude,
        };
        // Half an ulp to round; the rest for the arithmetic, and for a step off the nodata value.
        let allowance = if self.nodata_is_in_range() { 2.0 } else { 1.0 };
        ulp * allowance
    }

    fn nodata_is_in_range(&self) -> bool {
        self.nodata
            .is_some_and(|nodata| self.sample_range[0] <= nodata && nodata <= self.sample_range[1])
    }

    /// The unit nearest to a valid sample.
    pub fn to_unit(&self, sample: f64) -> i32 {
        ((sample - self.offset) / self.scale).round() as i32
    }

    /// As [`to_unit`](Self::to_unit), for as many samples as there are units; 0 for NaN.
    pub fn to_units(&self, samples: &[f64], units: &mut [i32]) {
        if self.sample_type.is_integer() && self.scale == 1.0 && self.offset == 0.0 {
            whole_units(samples, units);
        } else {
            nearest_units(samples, self.offset, self.scale, units);
        }
    }

    /// As [`to_sample`](Self::to_sample), for as many units as there are samples.
    pub fn to_samples(&self, units: &[i32], samples: &mut [f64]) {
        restore(units, self.scale, self.offset, self.sample_range, samples);
        if self.sample_type == SampleType::F32 {
            samples
                .iter_mut()
                .for_each(|sample| *sample = f64::from(*sample as f32));
        }
        if self.nodata.is_some_and(|nodata| samples.contains(&nodata)) {
            for (sample, &unit) in samples.iter_mut().zip(units) {
                *sample = self.to_sample(unit);
            }
        }
    }

    /// The sample of a decoded unit, in the sample type's own precision; never the nodata value.
    pub fn to_sample(&self, unit: i32) -> f64 {
        let [low, high] = self.sample_range;
        let exact = (f64::from(unit) * self.scale + self.offset).clamp(low, high);
        let value = match self.sample_type {
            SampleType::F32 => f64::from(exact as f32),
            _ => exact,
        };
        if self.nodata != Some(value) {
            return value;
        }
        let (up, down) = match self.sample_type {
            SampleType::F64 => (value.next_up(), value.next_down()),
            SampleType::F32 => {
                let single = value as f32;
                (f64::from(single.next_up()), f64::from(single.next_down()))
            }
            _ => (value + 1.0, value - 1.0),
        };
        if up <= high { up } else { down }
    }

    /// Units that samples of floats may all be multiples of: powers of ten or of two, from 1 down.
    pub fn whole_units() -> impl Iterator<Item = f64> {
        let tens = [1.0, 0.1, 0.01, 0.001, 0.0001, 0.00001, 0.000001];
        let twos = (1..=20).map(|bits| 1.0 / f64::from(1 << bits));
        tens.into_iter().chain(twos)
    }

    /// Whether a sample is a multiple of a unit, exactly as stored. A void is.
    pub fn is_multiple(sample_type: SampleType, sample: f64, unit: f64) -> bool {
        let count = (sample / unit).round();
        let restored = count * unit;
        let restored = match sample_type {
            SampleType::F32 => f64::from(restored as f32),
            _ => restored,
        };
        sample.is_nan() || count.abs() < GREATEST_FLOAT_UNIT && restored == sample
    }
}

widened! {
    fn whole_units(samples: &[f64], units: &mut [i32]) {
        for (unit, &sample) in units.iter_mut().zip(samples) {
            *unit = sample as i32;
        }
    }
}

widened! {
    fn nearest_units(samples: &[f64], offset: f64, scale: f64, units: &mut [i32]) {
        for (unit, &sample) in units.iter_mut().zip(samples) {
            *unit = ((sample - offset) / scale).round() as i32;
        }
    }
}

widened! {
    fn restore(units: &[i32], scale: f64, offset: f64, range: [f64; 2], samples: &mut [f64]) {
        let [low, high] = range;
        for (sample, &unit) in samples.iter_mut().zip(units) {
            *sample = (f64::from(unit) * scale + offset).clamp(low, high);
        }
    }
}
