//! Codecs: the heights of one diamond as bytes, without any repository.

use std::mem::MaybeUninit;
use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, Outcome, SizedStruct, array, boundary, input_struct, output, output_array,
};
use super::builder::{cells_log2, entropy_kind};
use super::status::kmb_status;
use crate::codec::{DiamondCodec, DiamondOptions, DiamondView, Matrix};
use crate::store::EntropyKind;

/// How a codec codes diamonds. Heights are integers in units that the caller chooses.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_codec_options {
    /// sizeof(kmb_codec_options).
    pub struct_size: u32,
    /// N, the cells along a side of a diamond: 16, 32, 64 or 128; 0 for 64.
    pub cells: u32,
    /// Least height.
    pub minimum: i32,
    /// Greatest height.
    pub maximum: i32,
    /// Largest allowed difference between a decoded centre and the one that was given; 0 for lossless.
    /// At most 2^30 - 1.
    pub max_error: u32,
    /// A kmb_entropy.
    pub entropy: u32,
}

// SAFETY: repr(C) with struct_size first, and integers only.
unsafe impl SizedStruct for kmb_codec_options {
    const NAME: &'static str = "kmb_codec_options";
}

/// Codes diamonds: N^2 new heights, the centres of cells, in the knowledge of (N+1)^2 old ones, their
/// corners, the vertices.
pub struct kmb_codec {
    broken: AtomicBool,
    codec: DiamondCodec,
}

impl Handle for kmb_codec {
    const NAME: &'static str = "codec";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Makes a codec of diamonds and gives a handle, which kmb_codec_destroy frees. With KMB_ENTROPY_RANS it codes
/// by a standard model, the same for ever in this version of the format, until it gets another one by
/// kmb_codec_train or kmb_codec_set_model. Both ends need the same options and the same model.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_create(
    options: *const kmb_codec_options,
    codec: *mut *mut kmb_codec,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (options, out) = unsafe { (input_struct(options)?, output(codec, "codec")?) };
        let made = DiamondCodec::new(DiamondOptions {
            cells_log2: cells_log2(options.cells)?,
            bound: i32::try_from(options.max_error).unwrap_or(i32::MAX),
            range: [options.minimum, options.maximum],
            in_contexts: entropy_kind(options.entropy)? == EntropyKind::Rans,
        })?;
        out.write(Box::into_raw(Box::new(kmb_codec {
            broken: AtomicBool::new(false),
            codec: made,
        })));
        Ok(())
    })
}

/// Frees a codec. NULL is allowed. No other call may use the handle at the same time, or afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_destroy(codec: *mut kmb_codec) {
    let _ = boundary!({
        if !codec.is_null() {
            // SAFETY: the caller gives back what kmb_codec_create gave, once.
            drop(unsafe { Box::from_raw(codec) });
        }
        Ok(())
    });
}

/// Gives the most bytes that kmb_codec_encode_diamond can need, whatever the heights.
///
/// May be called with the same codec from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_diamond_bound(
    codec: *const kmb_codec,
    size: *mut usize,
) -> kmb_status {
    boundary!(shared codec: kmb_codec, {
        // SAFETY: the caller passes pointers as the header asks.
        unsafe { output(size, "size") }?.write(codec.codec.longest());
        Ok(())
    })
}

/// Turns the centres of one diamond into bytes, by a prediction from its vertices and the transform
/// KMB_TRANSFORM_INTERPOLATING. `vertices` are (N+1)^2 heights, row by row, as the decoder will have
/// them; `centres` are N^2 heights, of which that at column i and row j lies amid vertices (i, j) and
/// (i + 1, j + 1). `vertex_valid` and `centre_valid` hold one byte for each, 0 for a void; NULL says that
/// there is none. A void vertex has a height all the same, any one, which predictions use: the same for
/// the decoder. That of a void centre means nothing. `bytes` has room for `capacity` bytes, and `size`
/// is the count of bytes written, which may be 0. All memory is the caller's, and none of it is kept.
///
/// May be called with the same codec from several threads at once.
///
/// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`size` is the capacity that is needed, and nothing else is
/// written); KMB_INVALID_ARGUMENT (also for a height outside the codec's range); KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_encode_diamond(
    codec: *const kmb_codec,
    vertices: *const i32,
    vertex_valid: *const u8,
    centres: *const i32,
    centre_valid: *const u8,
    bytes: *mut u8,
    capacity: usize,
    size: *mut usize,
) -> kmb_status {
    boundary!(shared codec: kmb_codec, {
        let [corners, cells] = entries(&codec.codec);
        // SAFETY: the caller passes pointers as the header asks.
        let (vertices, centres) = unsafe {
            (
                matrix(vertices, vertex_valid, corners, ["vertices", "vertex_valid"])?,
                matrix(centres, centre_valid, cells, ["centres", "centre_valid"])?,
            )
        };
        // SAFETY: as above.
        let (bytes, out) = unsafe { (room(bytes, capacity, "bytes")?, output(size, "size")?) };
        let view = DiamondView { vertices: &vertices, centres: &centres };
        deliver(&codec.codec.encode(view)?, bytes, out)
    })
}

/// Turns bytes back into the N^2 centres of a diamond, given its vertices as kmb_codec_encode_diamond
/// got them. `centres` has room for N^2 heights. `centre_valid` has room for N^2 bytes, 1 for each centre
/// that is valid and 0 for a void, whose height is then its own prediction; or NULL. All memory is the
/// caller's.
///
/// Bytes from anywhere may be given: they are refused, or lead to other heights within the range.
/// `centres` and `centre_valid` are written only with KMB_OK.
///
/// May be called with the same codec from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for a vertex outside the codec's range), KMB_DAMAGED,
/// KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_decode_diamond(
    codec: *const kmb_codec,
    vertices: *const i32,
    vertex_valid: *const u8,
    bytes: *const u8,
    size: usize,
    centres: *mut i32,
    centre_valid: *mut u8,
) -> kmb_status {
    boundary!(shared codec: kmb_codec, {
        let [corners, cells] = entries(&codec.codec);
        // SAFETY: the caller passes pointers as the header asks.
        let (vertices, bytes) = unsafe {
            (
                matrix(vertices, vertex_valid, corners, ["vertices", "vertex_valid"])?,
                array(bytes, size, "bytes")?,
            )
        };
        // SAFETY: as above.
        let out = unsafe { output_array(centres, cells, "centres") }?;
        let decoded = codec.codec.decode(&vertices, bytes)?;
        if !centre_valid.is_null() {
            // SAFETY: as above.
            let out = unsafe { output_array(centre_valid, cells, "centre_valid") }?;
            match &decoded.valid {
                Some(valid) => out.copy_from_slice(valid),
                None => out.fill(1),
            }
        }
        out.copy_from_slice(&decoded.values);
        Ok(())
    })
}

/// Trains a model on `count` diamonds, which the codec uses from now on: fewer bytes for diamonds like
/// these. `vertices` and `centres` are those of kmb_codec_encode_diamond, one diamond after the other, all
/// valid. kmb_codec_model gives the model for a decoder.
///
/// Exclusive: no other call may use the codec at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for no diamond, for a height outside the codec's range, and
/// for KMB_ENTROPY_GAMMA), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_train(
    codec: *mut kmb_codec,
    count: usize,
    vertices: *const i32,
    centres: *const i32,
) -> kmb_status {
    boundary!(exclusive codec: kmb_codec, {
        let [corners, cells] = entries(&codec.codec);
        let all = |each: usize| count.saturating_mul(each);
        if count == 0 {
            return Err(Failure::argument("there is no diamond to train on"));
        }
        // SAFETY: the caller passes pointers as the header asks.
        let (vertices, centres) = unsafe {
            (
                array(vertices, all(corners), "vertices")?,
                array(centres, all(cells), "centres")?,
            )
        };
        let own = |values: &[i32]| Matrix { values: values.into(), valid: None };
        let pairs = vertices.chunks_exact(corners).zip(centres.chunks_exact(cells));
        let diamonds: Vec<_> = pairs.map(|(v, c)| (own(v), own(c))).collect();
        let views: Vec<_> = diamonds
            .iter()
            .map(|(vertices, centres)| DiamondView { vertices, centres })
            .collect();
        codec.codec.train(&views)?;
        Ok(())
    })
}

/// Gives the codec's trained model as bytes, for kmb_codec_set_model of a codec with the same options.
/// `bytes` has room for `capacity` bytes, and may be NULL where that is 0; `size` is the count of bytes
/// written.
///
/// May be called with the same codec from several threads at once.
///
/// Returns KMB_OK; KMB_BUFFER_TOO_SMALL (`size` is the capacity that is needed, and nothing else is
/// written); KMB_NOT_FOUND (nothing was trained or set); KMB_INVALID_ARGUMENT; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_model(
    codec: *const kmb_codec,
    bytes: *mut u8,
    capacity: usize,
    size: *mut usize,
) -> kmb_status {
    boundary!(shared codec: kmb_codec, {
        // SAFETY: the caller passes pointers as the header asks.
        let (bytes, out) = unsafe { (room(bytes, capacity, "bytes")?, output(size, "size")?) };
        let model = codec.codec.model_bytes().ok_or_else(|| {
            Failure::new(kmb_status::KMB_NOT_FOUND, "the codec has no trained model")
        })?;
        deliver(&model, bytes, out)
    })
}

/// Makes the codec use a trained model, which kmb_codec_model gave. The bytes are copied.
///
/// Exclusive: no other call may use the codec at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for KMB_ENTROPY_GAMMA), KMB_DAMAGED (the bytes are no
/// model), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_codec_set_model(
    codec: *mut kmb_codec,
    bytes: *const u8,
    size: usize,
) -> kmb_status {
    boundary!(exclusive codec: kmb_codec, {
        // SAFETY: the caller passes pointers as the header asks.
        codec.codec.set_model(unsafe { array(bytes, size, "bytes") }?)?;
        Ok(())
    })
}

/// Vertices and centres of a diamond.
fn entries(codec: &DiamondCodec) -> [usize; 2] {
    let cells = codec.cells();
    [(cells + 1) * (cells + 1), cells * cells]
}

/// A copy of `count` heights, and of the bytes that say which are valid.
///
/// # Safety
///
/// That of [`array`], for both; `valid` may be NULL.
unsafe fn matrix(
    values: *const i32,
    valid: *const u8,
    count: usize,
    names: [&str; 2],
) -> Result<Matrix, Failure> {
    // SAFETY: as the caller promises.
    let values = unsafe { array(values, count, names[0]) }?.into();
    if valid.is_null() {
        return Ok(Matrix {
            values,
            valid: None,
        });
    }
    // SAFETY: as above.
    let valid = unsafe { array(valid, count, names[1]) }?;
    let valid = valid.iter().map(|&valid| u8::from(valid != 0)).collect();
    Ok(Matrix::new(values, valid))
}

/// The place of at most `capacity` bytes, which may be anything when that is 0.
///
/// # Safety
///
/// That of [`output_array`].
pub(super) unsafe fn room<'a>(
    bytes: *mut u8,
    capacity: usize,
    name: &str,
) -> Result<&'a mut [u8], Failure> {
    if capacity == 0 {
        return Ok(&mut []);
    }
    // SAFETY: as the caller promises.
    unsafe { output_array(bytes, capacity, name) }
}

/// Writes bytes to where the caller has room for them, and their count in any case.
pub(super) fn deliver(made: &[u8], bytes: &mut [u8], size: &mut MaybeUninit<usize>) -> Outcome {
    size.write(made.len());
    match bytes.get_mut(..made.len()) {
        Some(place) => {
            place.copy_from_slice(made);
            Ok(())
        }
        None => Err(Failure::new(
            kmb_status::KMB_BUFFER_TOO_SMALL,
            format!("{} bytes do not hold {}", bytes.len(), made.len()),
        )),
    }
}
