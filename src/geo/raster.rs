//! What is known of a raster beside its samples.

use std::collections::BTreeMap;

/// The type of a raster's samples, as its file stores them. The numbers are those of the file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum SampleType {
    /// Unsigned 8-bit integer.
    U8 = 0,
    /// Signed 8-bit integer.
    I8 = 1,
    /// Unsigned 16-bit integer.
    U16 = 2,
    /// Signed 16-bit integer.
    I16 = 3,
    /// Unsigned 32-bit integer.
    U32 = 4,
    /// Signed 32-bit integer.
    I32 = 5,
    /// 32-bit IEEE float.
    F32 = 6,
    /// 64-bit IEEE float.
    F64 = 7,
}

impl SampleType {
    /// All types, in the order of their numbers.
    pub const ALL: [SampleType; 8] = [
        SampleType::U8,
        SampleType::I8,
        SampleType::U16,
        SampleType::I16,
        SampleType::U32,
        SampleType::I32,
        SampleType::F32,
        SampleType::F64,
    ];

    /// The type with this number, if there is one.
    pub fn from_number(number: u8) -> Option<SampleType> {
        SampleType::ALL.get(usize::from(number)).copied()
    }

    /// Whether samples are integers, so that `max error 0` means lossless.
    pub fn is_integer(self) -> bool {
        !matches!(self, SampleType::F32 | SampleType::F64)
    }

    /// Bytes of one sample.
    pub fn size(self) -> usize {
        match self {
            SampleType::U8 | SampleType::I8 => 1,
            SampleType::U16 | SampleType::I16 => 2,
            SampleType::U32 | SampleType::I32 | SampleType::F32 => 4,
            SampleType::F64 => 8,
        }
    }

    /// Whether a finite number is a sample of this type without rounding.
    pub fn holds(self, sample: f64) -> bool {
        // All these types fit i64.
        let is_whole = (sample as i64) as f64 == sample;
        let within = |low: f64, high: f64| is_whole && (low..=high).contains(&sample);
        match self {
            SampleType::U8 => within(0.0, f64::from(u8::MAX)),
            SampleType::I8 => within(f64::from(i8::MIN), f64::from(i8::MAX)),
            SampleType::U16 => within(0.0, f64::from(u16::MAX)),
            SampleType::I16 => within(f64::from(i16::MIN), f64::from(i16::MAX)),
            SampleType::U32 => within(0.0, f64::from(u32::MAX)),
            SampleType::I32 => within(f64::from(i32::MIN), f64::from(i32::MAX)),
            SampleType::F32 => f64::from(sample as f32) == sample,
            SampleType::F64 => sample.is_finite(),
        }
    }

    /// The greatest finite sample of this type.
    pub fn greatest(self) -> f64 {
        match self {
            SampleType::U8 => f64::from(u8::MAX),
            SampleType::I8 => f64::from(i8::MAX),
            SampleType::U16 => f64::from(u16::MAX),
            SampleType::I16 => f64::from(i16::MAX),
            SampleType::U32 => f64::from(u32::MAX),
            SampleType::I32 => f64::from(i32::MAX),
            SampleType::F32 => f64::from(f32::MAX),
            SampleType::F64 => f64::MAX,
        }
    }

    /// Lower-case name: `u8` ... `f64`.
    pub fn name(self) -> &'static str {
        ["u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64"][self as usize]
    }
}

/// A number that a raster's samples may be stored as.
pub trait Sample: Copy + Sync {
    /// Its type.
    const TYPE: SampleType;

    /// Its value; exact.
    fn value(self) -> f64;

    /// The sample nearest to a value; 0 for NaN where the type has none.
    fn nearest(value: f64) -> Self;
}

macro_rules! samples {
    ($($number:ident $type:ident),+) => {
        $(impl Sample for $number {
            const TYPE: SampleType = SampleType::$type;

            fn value(self) -> f64 {
                f64::from(self)
            }

            fn nearest(value: f64) -> $number {
                value as $number
            }
        })+
    };
}

samples!(u8 U8, i8 I8, u16 U16, i16 I16, u32 U32, i32 I32, f32 F32, f64 F64);

/// Whether a sample stands for a point or for the cell around it. It only moves the geotransform by
/// half a sample; the lattice treats both alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Registration {
    /// The geotransform's origin is the upper left sample's outer corner.
    #[default]
    Area = 0,
    /// The geotransform's origin is the upper left sample itself.
    Point = 1,
}

/// A raster's shape, sample type and georeference: all that `extract` must restore. A sample of an image
/// has three numbers, red, green and blue, and is void as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterInfo {
    /// Samples a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How the input stored a sample.
    pub sample_type: SampleType,
    /// Numbers a sample: 1 for heights, 3 for colours.
    pub bands: u8,
    /// Whether the input's file marks voids by a further band that holds zero there (colours only).
    pub alpha: bool,
    /// GDAL's six numbers: `X = g0 + column g1 + row g2`, `Y = g3 + column g4 + row g5`.
    pub geotransform: [f64; 6],
    /// Whether the input said where it lies; otherwise `geotransform` is a default.
    pub georeferenced: bool,
    /// What the geotransform's origin is.
    pub registration: Registration,
    /// Whether X and Y are degrees of longitude and latitude.
    pub geographic: bool,
    /// The coordinate reference system: WKT, or `EPSG:n`, or empty.
    pub crs: String,
    /// The value that marks a void in the input's file, in all bands, if it has one. NaN is a void in any case.
    pub nodata: Option<f64>,
    /// Physical height = `value_scale` x sample + `value_offset`.
    pub value_scale: f64,
    /// See `value_scale`.
    pub value_offset: f64,
    /// Unit of the physical height, as the input names it, or empty.
    pub units: String,
    /// Free metadata. Keys that begin with `tiff.` hold GeoTIFF tags to be restored as they were.
    pub metadata: BTreeMap<String, Vec<u8>>,
}

impl RasterInfo {
    /// A raster without any georeference: samples one unit apart, north up, the lower left one at 0, 0.
    pub fn new(width: u32, height: u32, sample_type: SampleType) -> RasterInfo {
        RasterInfo {
            width,
            height,
            sample_type,
            bands: 1,
            alpha: false,
            geotransform: [0.0, 1.0, 0.0, f64::from(height) - 1.0, 0.0, -1.0],
            georeferenced: false,
            registration: Registration::Point,
            geographic: false,
            crs: String::new(),
            nodata: None,
            value_scale: 1.0,
            value_offset: 0.0,
            units: String::new(),
            metadata: BTreeMap::new(),
        }
    }

    /// Numbers a row: `width` x `bands`.
    pub fn row_length(&self) -> usize {
        self.width as usize * usize::from(self.bands)
    }

    /// The same georeference for `width` x `height` samples, the first of which lies at fractional
    /// column and row `first`, and the others in steps of `stride` columns and rows.
    pub fn on_grid(&self, first: [f64; 2], stride: f64, [width, height]: [u32; 2]) -> RasterInfo {
        let g = &self.geotransform;
        // A sample stays where it is; an area's corner moves, since the area around a sample changes.
        let shift = self.registration_shift() * (1.0 - stride);
        let (column, row) = (first[0] + shift, first[1] + shift);
        RasterInfo {
            width,
            height,
            geotransform: [
                g[0] + column * g[1] + row * g[2],
                g[1] * stride,
                g[2] * stride,
                g[3] + column * g[4] + row * g[5],
                g[4] * stride,
                g[5] * stride,
            ],
            ..self.clone()
        }
    }

    /// Coordinates of the sample at (`column`, `row`) in the raster's reference system.
    pub fn sample_to_crs(&self, column: f64, row: f64) -> [f64; 2] {
        let half = self.registration_shift();
        let (c, r, g) = (column + half, row + half, &self.geotransform);
        [g[0] + c * g[1] + r * g[2], g[3] + c * g[4] + r * g[5]]
    }

    /// The inverse of [`sample_to_crs`](Self::sample_to_crs): fractional column and row, or `None`
    /// where the geotransform has no inverse.
    pub fn crs_to_sample(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let g = &self.geotransform;
        let determinant = g[1] * g[5] - g[2] * g[4];
        if determinant == 0.0 || !determinant.is_finite() {
            return None;
        }
        let (dx, dy, half) = (x - g[0], y - g[3], self.registration_shift());
        Some([
            (dx * g[5] - dy * g[2]) / determinant - half,
            (dy * g[1] - dx * g[4]) / determinant - half,
        ])
    }

    /// How far, in samples, the geotransform's origin lies before the first sample.
    pub fn registration_shift(&self) -> f64 {
        match self.registration {
            Registration::Area => 0.5,
            Registration::Point => 0.0,
        }
    }
}
