//! A colour raster on the grid of a height raster.

use std::collections::VecDeque;
use std::path::Path;

use super::samples::{not_colours, rows_asked};
use super::{RasterSource, geokeys};
use crate::geo::RasterInfo;
use crate::log::{LogLevel, log};
use crate::{Error, Result};

/// Most texels along a side from one height sample to the next.
pub const MOST_TEXELS: u32 = 64;

/// How far, in pixels, a texel may lie beside a pixel, or beyond the image's edge, and count as on it:
/// coordinates come with rounding errors.
const TOLERANCE: f64 = 1e-6;

/// The least power of two of texels from one height sample to the next, at most [`MOST_TEXELS`], that is
/// not coarser than the image along either axis.
pub fn texels_per_sample(image: &RasterInfo, heights: &RasterInfo) -> u32 {
    let ratio = |axis: usize| (heights.geotransform[axis] / image.geotransform[axis]).abs();
    let needed = ratio(1).max(ratio(5)) * (1.0 - TOLERANCE);
    let mut texels = 1;
    while texels < MOST_TEXELS && f64::from(texels) < needed {
        texels *= 2;
    }
    texels
}

/// An image resampled to texels that lie on and between the samples of a height raster:
/// texel (i, j) has the place of height sample (i / f, j / f), f being the texels from one sample to
/// the next, so that there are (W - 1) f + 1 by (H - 1) f + 1 of them.
///
/// Along each axis a texel is the mean of the pixels around it with the weights of a triangle whose half
/// width is the larger of the distances between pixels and between texels: bilinear interpolation where
/// texels are the closer, a low-pass filter where pixels are. Inside the image the weights are those of a
/// straight line fitted with the triangle's, which differ from the triangle's only where the
/// half width is no whole number of pixels; a linear ramp thus stays what it is. Void pixels have no weight;
/// a texel is void when more than half of its weight is void, or when it lies outside the image (its
/// pixels' areas, or the hull of its points). Sums run in a fixed order, so that every machine
/// gets the same texels.
pub struct Resampled {
    image: Box<dyn RasterSource>,
    info: RasterInfo,
    columns: Vec<Taps>,
    rows: Axis,
    /// Image rows resampled along the columns, the last of which precedes the image's next one:
    /// for each texel the weighted sums of red, green and blue, and of the weights that are not void.
    lines: VecDeque<Vec<[f64; 4]>>,
    next_line: usize,
    next_row: u32,
    /// One row of the image.
    pixels: Vec<f64>,
}

impl Resampled {
    /// Puts an image, whose errors are reported under `name`, on the grid of `heights` with `texels`
    /// texels from one sample to the next: a power of two up to [`MOST_TEXELS`]. Both are taken to have
    /// the same reference system where one of them does not say which it has.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for another number of texels, too many of them, and a rotated height
    /// raster; [`Error::Input`] for an image that has no georeference or another reference system,
    /// is rotated or upside down against the heights, or lies elsewhere.
    pub fn new(
        name: &Path,
        image: Box<dyn RasterSource>,
        heights: &RasterInfo,
        texels: u32,
    ) -> Result<Resampled> {
        check(name, image.info(), heights)?;
        let given = image.info();
        let mut info = texel_grid(given, heights, texels)?;
        let columns = Axis::new(given, &info, 0);
        let rows = Axis::new(given, &info, 1);
        if rows.step < 0.0 {
            let text = "its rows run from south to north, those of the heights from north to south, \
                        or the other way round";
            return Err(Error::input(name, text));
        }
        let covered = [columns.covered(info.width), rows.covered(info.height)];
        if covered.contains(&Covered::Nothing) {
            let text = "the image does not cover any height sample";
            return Err(Error::input(name, text));
        }
        info.alpha = given.alpha || given.nodata.is_some() || covered != [Covered::Everything; 2];
        let pixels = zeros(given.row_length())?;
        Ok(Resampled {
            columns: (0..info.width).map(|texel| columns.taps(texel)).collect(),
            rows,
            image,
            info,
            lines: VecDeque::new(),
            next_line: 0,
            next_row: 0,
            pixels,
        })
    }

    /// Makes `lines` hold the image rows from `first` up to `end`.
    fn advance(&mut self, first: usize, end: usize) -> Result<()> {
        while self.next_line - self.lines.len() < first && !self.lines.is_empty() {
            self.lines.pop_front();
        }
        while self.next_line < end {
            self.image.read_rows(&mut self.pixels)?;
            if self.next_line >= first {
                let line = self.columns.iter().map(|taps| taps.along(&self.pixels));
                self.lines.push_back(line.collect());
            }
            self.next_line += 1;
        }
        Ok(())
    }

    fn read_row(&mut self, texels: &mut [f64]) -> Result<()> {
        texels.fill(f64::NAN);
        let taps = self.rows.taps(self.next_row);
        self.next_row += 1;
        if taps.weights.is_empty() {
            return Ok(());
        }
        let end = taps.first + taps.weights.len();
        self.advance(taps.first, end)?;
        let greatest = self.info.sample_type.greatest();
        let (texels, _) = texels.as_chunks_mut::<3>();
        for (index, texel) in texels.iter_mut().enumerate() {
            let mut sums = [0.0; 4];
            for (weight, line) in taps.weights.iter().zip(&self.lines) {
                for (sum, number) in sums.iter_mut().zip(line[index]) {
                    *sum += weight * number;
                }
            }
            if sums[3] >= 0.5 - TOLERANCE {
                *texel = [sums[0], sums[1], sums[2]]
                    .map(|sum| (sum / sums[3]).round().clamp(0.0, greatest));
            }
        }
        Ok(())
    }
}

impl RasterSource for Resampled {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()> {
        rows_asked(&self.info, self.next_row, samples)?;
        samples
            .chunks_exact_mut(self.info.row_length())
            .try_for_each(|row| self.read_row(row))
    }
}

fn zeros(count: usize) -> Result<Vec<f64>> {
    let mut numbers = Vec::new();
    numbers
        .try_reserve_exact(count)
        .map_err(|_| Error::Argument(format!("{count} numbers a row exceed the memory")))?;
    numbers.resize(count, 0.0);
    Ok(numbers)
}

fn check(name: &Path, image: &RasterInfo, heights: &RasterInfo) -> Result<()> {
    let refuse = |text: String| Err(Error::input(name, text));
    if image.bands != 3 {
        return refuse(not_colours(u64::from(image.bands)));
    }
    if !image.georeferenced {
        return refuse("it has no georeference: give its bounds".to_string());
    }
    let rotated = |info: &RasterInfo| info.geotransform[2] != 0.0 || info.geotransform[4] != 0.0;
    if rotated(image) {
        return refuse("it is rotated against its reference system".to_string());
    }
    if rotated(heights) {
        let text = "the heights are rotated against their reference system";
        return Err(Error::Argument(text.to_string()));
    }
    if image.crs.is_empty() || heights.crs.is_empty() || image.crs == heights.crs {
        return Ok(());
    }
    let has_code = |info: &RasterInfo| info.crs.starts_with("EPSG:");
    if image.geographic != heights.geographic || has_code(image) && has_code(heights) {
        return refuse(format!(
            "its reference system is {} and not {}, that of the heights",
            image.crs, heights.crs
        ));
    }
    let text = "its reference system has another name than that of the heights; taken for the same";
    log(LogLevel::Warning, &format!("{}: {text}", name.display()));
    Ok(())
}

/// What is known of the texels, but whether some are void.
fn texel_grid(image: &RasterInfo, heights: &RasterInfo, texels: u32) -> Result<RasterInfo> {
    if !texels.is_power_of_two() || texels > MOST_TEXELS {
        return Err(Error::Argument(format!(
            "{texels} texels a height sample; it must be a power of two up to {MOST_TEXELS}"
        )));
    }
    let along = |samples: u32| samples.checked_sub(1)?.checked_mul(texels)?.checked_add(1);
    let (Some(width), Some(height)) = (along(heights.width), along(heights.height)) else {
        return Err(Error::Argument(format!(
            "{} x {} height samples with {texels} texels each are too many",
            heights.width, heights.height
        )));
    };
    let mut info = heights.on_grid([0.0, 0.0], 1.0 / f64::from(texels), [width, height]);
    info.sample_type = image.sample_type;
    info.bands = image.bands;
    info.nodata = None;
    (info.value_scale, info.value_offset) = (1.0, 0.0);
    info.units = String::new();
    let georeference = [
        geokeys::GEO_KEY_DIRECTORY,
        geokeys::GEO_DOUBLE_PARAMS,
        geokeys::GEO_ASCII_PARAMS,
    ]
    .map(geokeys::metadata_key);
    info.metadata.retain(|key, _| georeference.contains(key));
    Ok(info)
}

#[derive(Clone, Copy, PartialEq)]
enum Covered {
    Nothing,
    Something,
    Everything,
}

/// The pixels of an image along one of its axes, as seen from texels.
struct Axis {
    /// Pixel position of texel 0, and pixels a texel.
    start: f64,
    step: f64,
    pixels: usize,
    /// How far the image reaches beyond its outermost samples.
    margin: f64,
}

/// The pixels, from `first` on, that make one texel, with weights whose sum is 1; none outside the image.
struct Taps {
    first: usize,
    weights: Vec<f64>,
}

impl Axis {
    /// Along columns (0) or rows (1) of two unrotated rasters.
    fn new(image: &RasterInfo, texels: &RasterInfo, axis: usize) -> Axis {
        let (origin, step) = ([0, 3][axis], [1, 5][axis]);
        let (from, to) = (&texels.geotransform, &image.geotransform);
        let margin = image.registration_shift();
        let place = from[origin] + texels.registration_shift() * from[step];
        Axis {
            start: (place - to[origin]) / to[step] - margin,
            step: from[step] / to[step],
            pixels: [image.width, image.height][axis] as usize,
            margin,
        }
    }

    fn position(&self, texel: u32) -> f64 {
        let position = self.start + f64::from(texel) * self.step;
        let nearest = position.round();
        if (position - nearest).abs() < TOLERANCE {
            nearest
        } else {
            position
        }
    }

    fn is_inside(&self, position: f64) -> bool {
        let reach = self.margin + TOLERANCE;
        (-reach..=(self.pixels as f64 - 1.0) + reach).contains(&position)
    }

    fn covered(&self, texels: u32) -> Covered {
        let count = (0..texels)
            .filter(|&texel| self.is_inside(self.position(texel)))
            .count();
        match count {
            0 => Covered::Nothing,
            _ if count == texels as usize => Covered::Everything,
            _ => Covered::Something,
        }
    }

    fn taps(&self, texel: u32) -> Taps {
        let position = self.position(texel);
        if !self.is_inside(position) {
            return Taps {
                first: 0,
                weights: Vec::new(),
            };
        }
        let half_width = self.step.abs().max(1.0);
        let low = (position - half_width).floor() + 1.0;
        let high = (position + half_width).ceil() - 1.0;
        let last_pixel = self.pixels as f64 - 1.0;
        let is_whole = low >= 0.0 && high <= last_pixel;
        let (low, high) = (low.max(0.0), high.min(last_pixel));
        let (first, last) = (low as usize, high as usize);
        let distances = (first..=last).map(|pixel| pixel as f64 - position);
        let mut weights: Vec<f64> = distances
            .clone()
            .map(|distance| 1.0 - distance.abs() / half_width)
            .collect();
        let [mut sum, mut mean, mut spread] = [0.0; 3];
        for (distance, weight) in distances.clone().zip(&weights) {
            sum += weight;
            mean += weight * distance;
            spread += weight * distance * distance;
        }
        let fits_line = is_whole && weights.len() > 1;
        for (distance, weight) in distances.zip(&mut weights) {
            *weight *= if fits_line {
                (spread - mean * distance) / (sum * spread - mean * mean)
            } else {
                1.0 / sum
            };
        }
        Taps { first, weights }
    }
}

impl Taps {
    /// Weighted sums of red, green and blue over one row of pixels, and of the weights that are not void.
    fn along(&self, pixels: &[f64]) -> [f64; 4] {
        let (pixels, _) = pixels.as_chunks::<3>();
        let mut sums = [0.0; 4];
        for (weight, &[red, green, blue]) in self.weights.iter().zip(&pixels[self.first..]) {
            if !red.is_nan() {
                for (sum, number) in sums.iter_mut().zip([red, green, blue, 1.0]) {
                    *sum += weight * number;
                }
            }
        }
        sums
    }
}
