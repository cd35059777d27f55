//! Building repositories from rows.

use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, Outcome, SizedStruct, array, boundary, input_struct, output, output_struct,
    path, text,
};
use super::status::kmb_status;
use crate::build::source::RowSource;
use crate::build::source::samples::stored_value;
use crate::build::{BuildOptions, BuildReport, build};
use crate::geo::{RasterInfo, Registration, SampleType};
use crate::store::{EntropyKind, TransformKind};
use crate::{Error, Result};

/// Fills `samples` with `row_count` rows of the raster from row `first_row` on, row by row: a
/// double each (three for a colour: red, green, blue), NaN for a void (in all three), any other value a sample of the raster's type (it is rounded to a
/// float for KMB_SAMPLE_F32). Rows are asked for from the top, each once. Calls come one after the
/// other, from any thread. An answer other than 0 ends the build with KMB_INPUT. Nothing may unwind
/// out of it.
pub type kmb_rows_callback = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        first_row: u32,
        row_count: u32,
        samples: *mut f64,
    ) -> i32,
>;

/// Learns how far a long call has come: `done` of `total` steps. Calls come one after the other,
/// from any thread. An answer other than 0 asks to stop; the call then returns KMB_CANCELLED.
/// Nothing may unwind out of it.
pub type kmb_progress_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, done: u64, total: u64) -> i32>;

/// How a raster becomes levels, and what its error is.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_transform {
    /// Coarse levels are samples of the finest. No vertex of any level is off by more than the
    /// maximum error.
    KMB_TRANSFORM_INTERPOLATING = 0,
    /// Coarse levels are filtered. Lossless, or within a root mean square error.
    KMB_TRANSFORM_LIFTED = 1,
    /// Coarse levels are filtered. No sample is off by more than the maximum error, nor any vertex
    /// of a coarser level from the filtered one.
    KMB_TRANSFORM_TWO_STAGE = 2,
}

/// How coefficients become bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_entropy {
    /// In contexts, by tables that are trained on the raster.
    KMB_ENTROPY_RANS = 0,
    /// A quadtree of Elias gamma codes: larger, and nothing is trained.
    KMB_ENTROPY_GAMMA = 1,
}

/// What to build.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_builder_options {
    /// sizeof(kmb_builder_options).
    pub struct_size: u32,
    /// A kmb_sample_type.
    pub sample_type: u32,
    /// Samples a row; at least 2.
    pub width: u32,
    /// Rows; at least 2.
    pub height: u32,
    /// Largest allowed difference between a decoded sample and the input's, in sample units; 0 is
    /// lossless for integers. KMB_TRANSFORM_LIFTED takes only 0.
    pub max_error: f64,
    /// Cells along a side of a diamond: 16, 32, 64 or 128; 0 for 64.
    pub cells: u32,
    /// Threads to use, or 0 for one a core. The file does not depend on it.
    pub threads: u32,
    /// A kmb_transform.
    pub transform: u32,
    /// A kmb_entropy.
    pub entropy: u32,
    /// For KMB_TRANSFORM_LIFTED: largest allowed root mean square difference, in sample units, or 0
    /// for lossless. The largest difference that comes with it is in the report and in the file.
    pub rms_error: f64,
    /// Numbers of a sample: 0 or 1 for heights; 3 for colours (red, green, blue), which are of
    /// KMB_SAMPLE_U8 or KMB_SAMPLE_U16. Errors are then those of each of the three.
    pub bands: u32,
    /// Memory that the process may take, in MiB, about: what does not fit goes to temporary files in the folder of
    /// the output. 0 for no limit. The file does not depend on it.
    pub memory: u32,
}

/// What a build made.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_build_report {
    /// sizeof(kmb_build_report).
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Samples, valid and void.
    pub samples: u64,
    /// Samples without data.
    pub void_samples: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Largest difference between a decoded sample and the input's, as measured from the bytes
    /// written.
    pub max_error: f64,
    /// Root of the mean square difference.
    pub rms_error: f64,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_builder_options {
    const NAME: &'static str = "kmb_builder_options";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_build_report {
    const NAME: &'static str = "kmb_build_report";
}

/// What is to be built: a raster's description, and how to code it.
pub struct kmb_builder {
    broken: AtomicBool,
    raster: RasterInfo,
    options: BuildOptions,
}

impl Handle for kmb_builder {
    const NAME: &'static str = "builder";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Makes a builder and gives a handle, which kmb_builder_destroy frees. The raster has no
/// georeference until it gets one: its samples are one unit apart, north up, the lower left one at
/// 0, 0.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for errors that the transform cannot keep),
/// KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_create(
    options: *const kmb_builder_options,
    builder: *mut *mut kmb_builder,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (options, out) = unsafe { (input_struct(options)?, output(builder, "builder")?) };
        let sample_type = sample_type(options.sample_type)?;
        let made = kmb_builder {
            broken: AtomicBool::new(false),
            raster: RasterInfo {
                bands: bands(options.bands, sample_type)?,
                ..RasterInfo::new(options.width, options.height, sample_type)
            },
            options: BuildOptions {
                transform: transform_kind(options.transform)?,
                max_error: options.max_error,
                rms_error: (options.rms_error != 0.0).then_some(options.rms_error),
                cells_log2: cells_log2(options.cells)?,
                memory: (options.memory != 0).then_some(u64::from(options.memory) << 20),
                threads: options.threads as usize,
                entropy: entropy_kind(options.entropy)?,
                ..BuildOptions::default()
            },
        };
        check_shape(&made)?;
        out.write(Box::into_raw(Box::new(made)));
        Ok(())
    })
}

pub(super) fn sample_type(number: u32) -> std::result::Result<SampleType, Failure> {
    let known = u8::try_from(number).ok().and_then(SampleType::from_number);
    known.ok_or_else(|| Failure::argument(format!("sample type {number} is unknown")))
}

pub(super) fn cells_log2(cells: u32) -> std::result::Result<u32, Failure> {
    match cells {
        0 => Ok(6),
        16 | 32 | 64 | 128 => Ok(cells.ilog2()),
        _ => Err(Failure::argument(format!(
            "{cells} cells: 16, 32, 64 or 128 are needed"
        ))),
    }
}

fn bands(number: u32, sample_type: SampleType) -> std::result::Result<u8, Failure> {
    match (number, sample_type) {
        (0 | 1, _) => Ok(1),
        (3, SampleType::U8 | SampleType::U16) => Ok(3),
        (3, _) => Err(Failure::argument(format!(
            "colours are u8 or u16, not {}",
            sample_type.name()
        ))),
        _ => Err(Failure::argument(format!(
            "{number} bands: heights have 1, colours 3"
        ))),
    }
}

/// The number of an entropy coder at the boundary, which is not that of the file.
pub(super) fn entropy_number(kind: EntropyKind) -> kmb_entropy {
    match kind {
        EntropyKind::Rans => kmb_entropy::KMB_ENTROPY_RANS,
        EntropyKind::Gamma => kmb_entropy::KMB_ENTROPY_GAMMA,
    }
}

pub(super) fn entropy_kind(number: u32) -> std::result::Result<EntropyKind, Failure> {
    match number {
        n if n == kmb_entropy::KMB_ENTROPY_RANS as u32 => Ok(EntropyKind::Rans),
        n if n == kmb_entropy::KMB_ENTROPY_GAMMA as u32 => Ok(EntropyKind::Gamma),
        _ => Err(Failure::argument(format!(
            "entropy coder {number} is unknown"
        ))),
    }
}

pub(super) fn transform_kind(number: u32) -> std::result::Result<TransformKind, Failure> {
    let kind = u8::try_from(number)
        .ok()
        .and_then(|number| TransformKind::try_from(number).ok());
    kind.ok_or_else(|| Failure::argument(format!("transform {number} is unknown")))
}

fn check_shape(builder: &kmb_builder) -> Outcome {
    let (width, height) = (builder.raster.width, builder.raster.height);
    if width < 2 || height < 2 {
        return Err(Failure::argument(format!(
            "a raster of {width} x {height} samples: at least 2 x 2 are needed"
        )));
    }
    Ok(builder.options.check()?)
}

/// Frees a builder. NULL is allowed. No other call may use the handle at the same time, or
/// afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_destroy(builder: *mut kmb_builder) {
    let _ = boundary!({
        if !builder.is_null() {
            // SAFETY: the caller gives back what kmb_builder_create gave, once.
            drop(unsafe { Box::from_raw(builder) });
        }
        Ok(())
    });
}

/// Says where the raster lies: six numbers, X = g[0] + column g[1] + row g[2] and Y = g[3] + column
/// g[4] + row g[5], what its origin is (`registration`, a kmb_registration), and whether X and Y
/// are degrees of longitude and latitude (`geographic`, 0 or 1). The numbers are copied.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for numbers that are not finite or have no inverse),
/// KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_set_geotransform(
    builder: *mut kmb_builder,
    geotransform: *const f64,
    registration: u32,
    geographic: u32,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        let given = unsafe { array(geotransform, 6, "geotransform") }?;
        let mut numbers = [0.0; 6];
        numbers.copy_from_slice(given);
        let [_, a, b, _, c, d] = numbers;
        let determinant: f64 = a * d - b * c;
        let finite = numbers.iter().all(|number| number.is_finite()) && determinant.is_finite();
        if !finite || determinant == 0.0 {
            let message = format!("the geotransform {numbers:?} has no inverse");
            return Err(Failure::argument(message));
        }
        let registration = match registration {
            0 => Registration::Area,
            1 => Registration::Point,
            _ => return Err(Failure::argument(format!("registration {registration} is unknown"))),
        };
        if geographic > 1 {
            return Err(Failure::argument(format!("geographic is {geographic}, not 0 or 1")));
        }
        builder.raster.geotransform = numbers;
        builder.raster.registration = registration;
        builder.raster.geographic = geographic == 1;
        builder.raster.georeferenced = true;
        Ok(())
    })
}

/// Names the coordinate reference system: WKT, "EPSG:n", or empty for none. The string is copied.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_set_crs(
    builder: *mut kmb_builder,
    crs: *const c_char,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        builder.raster.crs = unsafe { text(crs, "crs") }?.to_owned();
        Ok(())
    })
}

/// Names the unit of physical heights, or empty for none. The string is copied.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_set_units(
    builder: *mut kmb_builder,
    units: *const c_char,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        builder.raster.units = unsafe { text(units, "units") }?.to_owned();
        Ok(())
    })
}

/// Says how samples become physical heights: value_scale * sample + value_offset. They are 1 and 0
/// until set.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for numbers that are not finite, or a scale of 0),
/// KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_set_value_scale(
    builder: *mut kmb_builder,
    value_scale: f64,
    value_offset: f64,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        if !value_scale.is_finite() || value_scale == 0.0 || !value_offset.is_finite() {
            return Err(Failure::argument(format!(
                "value scale {value_scale} and offset {value_offset} must be finite, the scale not 0"
            )));
        }
        builder.raster.value_scale = value_scale;
        builder.raster.value_offset = value_offset;
        Ok(())
    })
}

/// Says which sample value is a void, beside NaN. No valid sample is ever decoded to it.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_set_nodata(
    builder: *mut kmb_builder,
    nodata: f64,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        builder.raster.nodata = Some(nodata);
        Ok(())
    })
}

/// Keeps `length` bytes of any kind under a key, in place of what was there. Both are copied. Keys
/// that begin with "tiff." are for GeoTIFF tags.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_set_metadata(
    builder: *mut kmb_builder,
    key: *const c_char,
    value: *const u8,
    length: usize,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        let (key, value) = unsafe { (text(key, "key")?, array(value, length, "value")?) };
        builder.raster.metadata.insert(key.to_owned(), value.to_vec());
        Ok(())
    })
}

struct User(*mut c_void);
// SAFETY: the header lets the callbacks, and so their `user`, be used from any thread, one call at
// a time.
unsafe impl Send for User {}

impl User {
    fn pointer(&self) -> *mut c_void {
        self.0
    }
}

/// Builds the repository at `path` from rows that `rows` gives, and reports what it made.
/// `progress` may be NULL; so may `report`, otherwise the caller sets report->struct_size. The file
/// appears under its name only when it is whole, in place of what was there; after any failure
/// nothing is left of it. The builder may be used again.
///
/// Exclusive: no other call may use the builder at the same time, the callbacks included.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a maximum error too small for the samples);
/// KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_INPUT (`rows` failed, or gave an infinite sample or one
/// that the sample type does not have); KMB_CANCELLED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_builder_write(
    builder: *mut kmb_builder,
    rows: kmb_rows_callback,
    rows_user: *mut c_void,
    progress: kmb_progress_callback,
    progress_user: *mut c_void,
    path: *const c_char,
    report: *mut kmb_build_report,
) -> kmb_status {
    boundary!(exclusive builder: kmb_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        let path = unsafe { self::path(path) }?;
        let out = match report.is_null() {
            true => None,
            // SAFETY: as above.
            false => Some(unsafe { output_struct(report) }?),
        };
        // SAFETY: the caller gave a function that may be called with this `user`.
        let mut source = unsafe { row_source(builder.raster.clone(), rows, rows_user) }?;
        let mut go_on = |done: u64, total: u64| {
            // SAFETY: the caller gave a function that may be called so, with this `user`.
            progress.is_none_or(|progress| unsafe { progress(progress_user, done, total) } == 0)
        };
        let made = build(&mut source, &builder.options, &path, &mut go_on)?;
        if let Some(out) = out {
            out.write(told(&made));
        }
        Ok(())
    })
}

/// A raster whose rows a callback gives.
///
/// # Safety
///
/// The callback may be called with `rows_user`, from any thread, for as long as the raster is there.
pub(super) unsafe fn row_source(
    raster: RasterInfo,
    rows: kmb_rows_callback,
    rows_user: *mut c_void,
) -> std::result::Result<RowSource, Failure> {
    let rows = rows.ok_or_else(|| Failure::argument("rows is NULL"))?;
    let (row_length, user) = (raster.row_length(), User(rows_user));
    let (bands, sample_type) = (usize::from(raster.bands), raster.sample_type);
    let next_rows = move |first_row: u32, samples: &mut [f64]| -> Result<()> {
        let row_count = (samples.len() / row_length) as u32;
        // SAFETY: the caller gave a function that may be called so, with this `user`.
        let answer = unsafe { rows(user.pointer(), first_row, row_count, samples.as_mut_ptr()) };
        if answer == 0 {
            return as_stored(sample_type, [row_length, bands], first_row, samples);
        }
        let message = format!("row {first_row}: the rows callback answered {answer}");
        Err(Error::input(Path::new("(rows)"), message))
    };
    Ok(RowSource::new(raster, Box::new(next_rows)))
}

/// Rounds samples to their type, and refuses those that it does not have.
fn as_stored(
    sample_type: SampleType,
    [row_length, bands]: [usize; 2],
    first_row: u32,
    samples: &mut [f64],
) -> Result<()> {
    for (index, sample) in samples
        .iter_mut()
        .enumerate()
        .filter(|(_, sample)| !sample.is_nan())
    {
        *sample = stored_value(*sample, sample_type).ok_or_else(|| {
            let column = index % row_length / bands;
            let row = first_row as usize + index / row_length;
            let name = sample_type.name();
            let message = format!("the sample {sample} at column {column}, row {row} is no {name}");
            Error::input(Path::new("(rows)"), message)
        })?;
    }
    Ok(())
}

fn told(made: &BuildReport) -> kmb_build_report {
    kmb_build_report {
        struct_size: size_of::<kmb_build_report>() as u32,
        reserved: 0,
        samples: made.samples,
        void_samples: made.void_samples,
        bytes: made.bytes,
        max_error: made.max_error,
        rms_error: made.rms_error,
    }
}
