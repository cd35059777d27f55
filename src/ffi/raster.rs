//! Rasters as bytes in memory, without any file.

use std::ffi::c_void;

use super::boundary::{
    Failure, Outcome, SizedStruct, array, boundary, input_struct, output, output_array,
    output_struct,
};
use super::builder::{cells_log2, entropy_kind, entropy_number, sample_type, transform_kind};
use super::codec::{deliver, room};
use super::status::kmb_status;
use crate::build::{BuildOptions, longest_repository};
use crate::cut::Terrain;
use crate::geo::{RasterInfo, SampleType};
use crate::tool::{open_packed, pack, unpack};

/// How a whole raster becomes bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_raster_options {
    /// sizeof(kmb_raster_options).
    pub struct_size: u32,
    /// A kmb_sample_type, that of the samples in memory.
    pub sample_type: u32,
    /// Samples a row; at least 2.
    pub width: u32,
    /// Rows; at least 2.
    pub height: u32,
    /// Largest allowed difference between a decoded sample and the one that was given, in sample units;
    /// 0 is lossless for integers. KMB_TRANSFORM_LIFTED takes only 0.
    pub max_error: f64,
    /// For KMB_TRANSFORM_LIFTED: largest allowed root mean square difference, in sample units, or 0
    /// for lossless.
    pub rms_error: f64,
    /// The sample value of a void, where has_nodata is 1. NaN is a void in any case.
    pub nodata: f64,
    /// 1 where there is such a value, else 0.
    pub has_nodata: u32,
    /// Cells along a side of a diamond: 16, 32, 64 or 128; 0 for 64.
    pub cells: u32,
    /// A kmb_transform.
    pub transform: u32,
    /// A kmb_entropy.
    pub entropy: u32,
    /// Threads to use, or 0 for one a core. The bytes do not depend on it.
    pub threads: u32,
    /// 0.
    pub reserved: u32,
}

/// What the bytes of a raster say of it. Errors and ranges are in sample units.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_raster_info {
    /// sizeof(kmb_raster_info).
    pub struct_size: u32,
    /// A kmb_sample_type.
    pub sample_type: u32,
    /// Samples a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples, valid and void.
    pub samples: u64,
    /// Samples without data.
    pub void_samples: u64,
    /// Bytes of one sample in memory.
    pub sample_bytes: u32,
    /// 1 where the decoded samples equal those that were given, else 0.
    pub lossless: u32,
    /// Largest difference between a decoded sample and the one that was given, as measured.
    pub max_error: f64,
    /// The largest difference that was allowed.
    pub max_error_bound: f64,
    /// Root of the mean square difference, as measured.
    pub rms_error: f64,
    /// Least valid sample.
    pub sample_min: f64,
    /// Greatest valid sample.
    pub sample_max: f64,
    /// The sample value of a void, where has_nodata is 1; else 0.
    pub nodata: f64,
    /// 1 where there is such a value, else 0.
    pub has_nodata: u32,
    /// Cells along a side of a diamond.
    pub cells: u32,
    /// A kmb_transform.
    pub transform: u32,
    /// A kmb_entropy.
    pub entropy: u32,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_raster_options {
    const NAME: &'static str = "kmb_raster_options";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_raster_info {
    const NAME: &'static str = "kmb_raster_info";
}

/// Gives the most bytes that kmb_codec_encode_raster can need for a raster with these options,
/// whatever its samples.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for errors that the transform cannot keep),
/// KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_raster_bound(
    options: *const kmb_raster_options,
    size: *mut usize,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (options, out) = unsafe { (input_struct(options)?, output(size, "size")?) };
        let (raster, build) = chosen(&options)?;
        let longest = longest_repository(raster.width, raster.height, &build)?;
        let longest = usize::try_from(longest)
            .map_err(|_| Failure::argument(format!("{longest} bytes exceed the memory")))?;
        out.write(longest);
        Ok(())
    })
}

/// Turns a whole raster into bytes, those of a repository: in a file they can be opened by
/// kmb_repository_open. `samples` are options->height rows of options->width samples from the top,
/// without gaps, in the machine's own form of options->sample_type and aligned to it; a void is NaN
/// or the nodata value. `bytes` has room for `capacity` bytes; kmb_codec_raster_bound gives a capacity
/// that is always enough. `size` is the count of bytes written. All memory is the caller's, and none
/// of it is kept.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`size` is the capacity that is needed, and nothing else is
/// written); KMB_INVALID_ARGUMENT (also for a maximum error too small for the samples);
/// KMB_INVALID_STRUCT_SIZE; KMB_INPUT (a sample is infinite); KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_encode_raster(
    options: *const kmb_raster_options,
    samples: *const c_void,
    bytes: *mut u8,
    capacity: usize,
    size: *mut usize,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (options, out) = unsafe { (input_struct(options)?, output(size, "size")?) };
        let (raster, build) = chosen(&options)?;
        // SAFETY: as above.
        let bytes = unsafe { room(bytes, capacity, "bytes") }?;
        // SAFETY: as above.
        let made = unsafe { encoded(raster, &build, samples) }?;
        deliver(&made, bytes, out)
    })
}

/// Says what the bytes of a raster hold. The caller sets info->struct_size. Header and tables are
/// checked, not yet what is decoded from them.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_INPUT (the bytes are no
/// repository), KMB_DAMAGED, KMB_UNSUPPORTED_VERSION, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_raster_describe(
    bytes: *const u8,
    size: usize,
    info: *mut kmb_raster_info,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (bytes, out) = unsafe { (array(bytes, size, "bytes")?, output_struct(info)?) };
        out.write(told(&open_packed(bytes)?));
        Ok(())
    })
}

/// Turns bytes back into the raster: all rows from the top, without gaps, in the machine's own form
/// of the sample type that kmb_codec_raster_describe tells, and aligned to it. A void becomes the nodata
/// value, or NaN where there is none. `capacity` is the count of samples that `samples` has room for, at
/// least width * height. All memory is the caller's.
///
/// Bytes from anywhere may be given: they are checked, or lead to other samples, and the memory
/// that is used is bounded by `size` and `capacity`. `samples` hold anything after a failure.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK; KMB_BUFFER_TOO_SMALL; KMB_INVALID_ARGUMENT (also where integers have voids and no
/// nodata value); KMB_INPUT (the bytes are no repository); KMB_DAMAGED (also where detail is missing
/// since a repair, so that the error cannot be kept); KMB_UNSUPPORTED_VERSION;
/// KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_decode_raster(
    bytes: *const u8,
    size: usize,
    samples: *mut c_void,
    capacity: usize,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let terrain = open_packed(unsafe { array(bytes, size, "bytes") }?)?;
        let raster = terrain.raster_info();
        let count = u64::from(raster.width) * u64::from(raster.height);
        let count = usize::try_from(count)
            .ok()
            .filter(|count| *count <= capacity);
        let count = count.ok_or_else(|| {
            Failure::new(
                kmb_status::KMB_BUFFER_TOO_SMALL,
                format!(
                    "{capacity} samples do not hold {} x {}",
                    raster.width, raster.height
                ),
            )
        })?;
        // SAFETY: as above.
        unsafe { decoded(&terrain, samples, count) }
    })
}

/// Runs a body with `$number` standing for the type of samples.
macro_rules! with_type {
    ($sample_type:expr, $number:ident, $body:expr) => {
        match $sample_type {
            SampleType::U8 => {
                type $number = u8;
                $body
            }
            SampleType::I8 => {
                type $number = i8;
                $body
            }
            SampleType::U16 => {
                type $number = u16;
                $body
            }
            SampleType::I16 => {
                type $number = i16;
                $body
            }
            SampleType::U32 => {
                type $number = u32;
                $body
            }
            SampleType::I32 => {
                type $number = i32;
                $body
            }
            SampleType::F32 => {
                type $number = f32;
                $body
            }
            SampleType::F64 => {
                type $number = f64;
                $body
            }
        }
    };
}

/// The bytes of a raster.
///
/// # Safety
///
/// That of [`array`], for the raster's samples as its type.
unsafe fn encoded(
    raster: RasterInfo,
    options: &BuildOptions,
    samples: *const c_void,
) -> Result<Vec<u8>, Failure> {
    let (width, height) = (raster.width as usize, raster.height as usize);
    let count = width.saturating_mul(height);
    with_type!(raster.sample_type, Number, {
        // SAFETY: as the caller promises.
        let samples = unsafe { array(samples.cast::<Number>(), count, "samples") }?;
        Ok(pack(raster, samples, options)?.0)
    })
}

/// Decodes all samples of a raster.
///
/// # Safety
///
/// That of [`output_array`], for `count` samples of the raster's type.
unsafe fn decoded(terrain: &Terrain, samples: *mut c_void, count: usize) -> Outcome {
    with_type!(terrain.raster_info().sample_type, Number, {
        // SAFETY: as the caller promises.
        let samples = unsafe { output_array(samples.cast::<Number>(), count, "samples") }?;
        unpack(terrain, samples)?;
        Ok(())
    })
}

/// The raster and the way to build it that options ask for.
fn chosen(options: &kmb_raster_options) -> Result<(RasterInfo, BuildOptions), Failure> {
    let (width, height) = (options.width, options.height);
    if width < 2 || height < 2 {
        return Err(Failure::argument(format!(
            "a raster of {width} x {height} samples: at least 2 x 2 are needed"
        )));
    }
    let mut raster = RasterInfo::new(width, height, sample_type(options.sample_type)?);
    raster.nodata = match options.has_nodata {
        0 => None,
        1 => Some(options.nodata),
        number => {
            let message = format!("has_nodata is {number}, not 0 or 1");
            return Err(Failure::argument(message));
        }
    };
    let build = BuildOptions {
        transform: transform_kind(options.transform)?,
        max_error: options.max_error,
        rms_error: (options.rms_error != 0.0).then_some(options.rms_error),
        cells_log2: cells_log2(options.cells)?,
        threads: options.threads as usize,
        entropy: entropy_kind(options.entropy)?,
        ..BuildOptions::default()
    };
    build.check()?;
    Ok((raster, build))
}

fn told(terrain: &Terrain) -> kmb_raster_info {
    let header = terrain.header();
    let raster = &header.raster;
    kmb_raster_info {
        struct_size: size_of::<kmb_raster_info>() as u32,
        sample_type: raster.sample_type as u32,
        width: raster.width,
        height: raster.height,
        samples: header.samples,
        void_samples: header.void_samples,
        sample_bytes: raster.sample_type.size() as u32,
        lossless: u32::from(header.lossless),
        max_error: header.max_error,
        max_error_bound: header.max_error_bound,
        rms_error: header.rms_error,
        sample_min: header.sample_min,
        sample_max: header.sample_max,
        nodata: raster.nodata.unwrap_or(0.0),
        has_nodata: u32::from(raster.nodata.is_some()),
        cells: 1 << header.cells_log2,
        transform: header.transform as u32,
        entropy: entropy_number(header.entropy) as u32,
    }
}
