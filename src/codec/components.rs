//! What a sample is inside: a height in units, or the three components of a colour.

use super::colour::{component_bounds, component_ranges, from_components, to_components};
use super::{SymbolCoder, Units};
use crate::geo::{RasterInfo, SampleType};
use crate::transform::{ListedHeights, Quantiser, Transform, TransformKind};
use crate::{Error, Result};

/// From the numbers of a sample to integer components and back.
#[derive(Clone, Debug, PartialEq)]
pub enum Components {
    /// One height.
    Height(Units),
    /// Red, green and blue as Y, Co and Cg.
    Colour(ColourUnits),
}

/// Colours of u8 or u16 with a bound on the error of red, green and blue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColourUnits {
    /// The type's greatest number.
    greatest: i32,
    /// What the bounds of the components follow from.
    bound: i32,
    /// What red, green and blue of a valid colour never all are.
    nodata: Option<i32>,
}

impl ColourUnits {
    /// Colours of a raster whose decoded red, green and blue are within `max_error` of the input's, where the
    /// transform keeps bounds.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for sample types other than u8 and u16, and for a `max_error` that is
    /// negative or not a number.
    pub fn new(info: &RasterInfo, max_error: f64) -> Result<ColourUnits> {
        if max_error.is_nan() || max_error < 0.0 {
            return Err(Error::Argument(format!(
                "the maximum error must be a number from 0 up, not {max_error}"
            )));
        }
        let mut units = ColourUnits::with_bound(info, 0)?;
        let greatest = f64::from(units.greatest);
        let bound = max_error.floor().min(greatest) as i32;
        // A colour that would become the nodata value is moved by one.
        units.bound = bound - i32::from(bound > 0 && units.nodata.is_some());
        Ok(units)
    }

    /// The same with the bound that the components' follow from, as a file states it.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for sample types other than u8 and u16.
    pub fn with_bound(info: &RasterInfo, bound: i32) -> Result<ColourUnits> {
        if !matches!(info.sample_type, SampleType::U8 | SampleType::U16) {
            return Err(Error::Argument(format!(
                "colours are u8 or u16, not {}",
                info.sample_type.name()
            )));
        }
        let held = |number: &f64| info.sample_type.holds(*number);
        Ok(ColourUnits {
            greatest: info.sample_type.greatest() as i32,
            bound,
            nodata: info.nodata.filter(held).map(|number| number as i32),
        })
    }

    /// Red, green and blue of decoded components in 8 bits, the greatest number of the sample type being 255.
    pub fn to_bytes(&self, components: [i32; 3]) -> [u8; 3] {
        let colour = self.to_colour(components);
        match self.greatest {
            255 => colour.map(|number| number as u8),
            greatest => colour.map(|number| ((number * 255 + greatest / 2) / greatest) as u8),
        }
    }

    fn to_colour(&self, components: [i32; 3]) -> [i32; 3] {
        let ranges = component_ranges(self.greatest);
        let within = |i: usize| components[i].clamp(ranges[i][0], ranges[i][1]);
        let mut colour = from_components([0, 1, 2].map(within), self.greatest);
        if self.nodata.is_some_and(|nodata| colour == [nodata; 3]) {
            colour[1] += if colour[1] < self.greatest { 1 } else { -1 };
        }
        colour
    }
}

impl Components {
    /// How many there are: 1 or 3.
    pub fn count(&self) -> usize {
        match self {
            Components::Height(_) => 1,
            Components::Colour(_) => 3,
        }
    }

    /// What the bounds of all components follow from; that of a height is its own.
    pub fn common_bound(&self) -> i32 {
        match self {
            Components::Height(units) => units.bound,
            Components::Colour(units) => units.bound,
        }
    }

    /// The same with another [`common_bound`](Self::common_bound).
    pub fn with_common_bound(mut self, bound: i32) -> Components {
        match &mut self {
            Components::Height(units) => units.bound = bound,
            Components::Colour(units) => units.bound = bound,
        }
        self
    }

    /// The quantiser's bound for a component.
    pub fn bound(&self, component: usize) -> i32 {
        match self {
            Components::Height(units) => units.bound,
            Components::Colour(units) => component_bounds(units.bound)[component],
        }
    }

    /// Least and greatest unit of a component.
    pub fn range(&self, component: usize) -> [i32; 2] {
        match self {
            Components::Height(units) => units.range,
            Components::Colour(units) => component_ranges(units.greatest)[component],
        }
    }

    /// The transform of each component, for diamonds of `cells` cells.
    pub fn transforms(&self, kind: TransformKind, cells: usize) -> Vec<Box<dyn Transform>> {
        let transform =
            |component| kind.transform(cells, self.bound(component), self.range(component));
        (0..self.count()).map(transform).collect()
    }

    /// The quantiser of each component, in the range that its transform can make; or, where heights are
    /// lossless, one that counts in listed heights.
    pub fn quantisers(
        &self,
        transforms: &[Box<dyn Transform>],
        listed: Option<ListedHeights>,
    ) -> Vec<Quantiser> {
        if let Some(listed) = listed {
            return vec![Quantiser::of_listed(listed)];
        }
        let ranges = transforms.iter().map(|transform| transform.range());
        ranges
            .enumerate()
            .map(|(component, [low, high])| Quantiser::new(self.bound(component), low, high))
            .collect()
    }

    /// What codes the coefficients of each component in contexts, for diamonds of `cells` cells, with its
    /// quantiser; `adaptive` says whether the trained predictor is used.
    pub fn coders(
        &self,
        cells: usize,
        quantisers: Vec<Quantiser>,
        adaptive: bool,
    ) -> Vec<SymbolCoder> {
        let coder = |quantiser| {
            let coder = SymbolCoder::new(cells, quantiser, adaptive, true);
            match self {
                Components::Height(_) => coder,
                Components::Colour(_) => coder.of_colours(),
            }
        };
        quantisers.into_iter().map(coder).collect()
    }

    /// Whether coefficients of a transform can come with the trained predictor.
    pub fn prefers_trained_predictor(&self, kind: TransformKind) -> bool {
        match kind {
            TransformKind::Interpolating => true,
            TransformKind::Lifted => self.count() > 1,
            TransformKind::TwoStage => false,
        }
    }

    /// sample = unit x scale + offset; 1 and 0 for colours.
    pub fn scale_and_offset(&self) -> [f64; 2] {
        match self {
            Components::Height(units) => [units.scale, units.offset],
            Components::Colour(_) => [1.0, 0.0],
        }
    }

    /// The component of this number of a valid sample, which has as many numbers as there are components.
    pub fn to_unit(&self, component: usize, sample: &[f64]) -> i32 {
        match (self, sample) {
            (Components::Height(units), &[height]) => units.to_unit(height),
            (Components::Colour(_), &[red, green, blue]) => {
                to_components([red, green, blue].map(|number| number as i32))[component]
            }
            _ => 0,
        }
    }

    /// As [`to_unit`](Self::to_unit), for as many samples as there are units; voids give any.
    pub fn to_units(&self, component: usize, samples: &[f64], units: &mut [i32]) {
        if let Components::Height(height) = self {
            return height.to_units(samples, units);
        }
        let samples = samples.chunks_exact(self.count());
        for (unit, sample) in units.iter_mut().zip(samples) {
            *unit = self.to_unit(component, sample);
        }
    }

    /// As [`to_sample`](Self::to_sample), for consecutive samples. `units` gives a component of all of them.
    pub fn to_samples<'a>(&self, units: impl Fn(usize) -> &'a [i32], samples: &mut [f64]) {
        if let Components::Height(height) = self {
            return height.to_samples(units(0), samples);
        }
        for (index, sample) in samples.chunks_exact_mut(self.count()).enumerate() {
            self.to_sample(|component| units(component)[index], sample);
        }
    }

    /// The sample of decoded components; never the nodata value. `units` gives each component.
    pub fn to_sample(&self, units: impl Fn(usize) -> i32, sample: &mut [f64]) {
        match self {
            Components::Height(height) => sample.fill(height.to_sample(units(0))),
            Components::Colour(colours) => {
                let colour = colours.to_colour([0, 1, 2].map(units));
                for (number, decoded) in sample.iter_mut().zip(colour) {
                    *number = f64::from(decoded);
                }
            }
        }
    }
}
