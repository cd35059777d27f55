//! Repositories: opening, what is known of them, coordinates.

use std::ffi::{CString, c_char};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, SizedStruct, boundary, input_struct, output, output_struct, path, text,
};
use super::status::kmb_status;
use crate::cut::{Layer, Terrain};
use crate::geo::Frame;
use crate::store::{Access, Kind};

/// What a repository holds.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_kind {
    /// One height a sample.
    KMB_KIND_HEIGHTS = 0,
    /// Three colour components a sample.
    KMB_KIND_COLOURS = 1,
    /// City blocks.
    KMB_KIND_CITY = 2,
}

/// How a repository's bytes are read. Both ways give the same answers.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_access {
    /// By a memory map. The file must not be truncated or written to while it is open, or the
    /// system may end the process; replacing it by a rename is safe.
    KMB_ACCESS_MAP = 0,
    /// By positioned reads; a file that is truncated meanwhile gives an error.
    KMB_ACCESS_POSITIONED = 1,
}

/// The type of a raster's samples, as the input stored them.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_sample_type {
    /// Unsigned 8-bit integer.
    KMB_SAMPLE_U8 = 0,
    /// Signed 8-bit integer.
    KMB_SAMPLE_I8 = 1,
    /// Unsigned 16-bit integer.
    KMB_SAMPLE_U16 = 2,
    /// Signed 16-bit integer.
    KMB_SAMPLE_I16 = 3,
    /// Unsigned 32-bit integer.
    KMB_SAMPLE_U32 = 4,
    /// Signed 32-bit integer.
    KMB_SAMPLE_I32 = 5,
    /// 32-bit float.
    KMB_SAMPLE_F32 = 6,
    /// 64-bit float.
    KMB_SAMPLE_F64 = 7,
}

/// What a geotransform's origin is.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_registration {
    /// The outer corner of the upper left sample, which stands for the cell around it.
    KMB_REGISTRATION_AREA = 0,
    /// The upper left sample itself.
    KMB_REGISTRATION_POINT = 1,
}

/// How to open a repository.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_open_options {
    /// sizeof(kmb_open_options).
    pub struct_size: u32,
    /// A kmb_access.
    pub access: u32,
    /// Bytes of decoded diamonds kept for all cuts and queries of the repository, beside what they hold themselves, so that
    /// what one has decoded another need not. 0 keeps none; KMB_UNLIMITED all.
    pub shared_bytes: u64,
}

/// What is known of a repository. Errors and ranges are in the raster's own units, those of its
/// samples.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_repository_info {
    /// sizeof(kmb_repository_info).
    pub struct_size: u32,
    /// A kmb_kind.
    pub kind: u32,
    /// Samples a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Cells along a side of a diamond.
    pub cells: u32,
    /// The finest level; an even number.
    pub levels: u32,
    /// Diamonds that the file holds.
    pub diamonds: u64,
    /// Samples, valid and void.
    pub samples: u64,
    /// Samples without data.
    pub void_samples: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Largest difference between a decoded sample of the finest level and the input, as measured.
    pub max_error: f64,
    /// The largest difference that the build was allowed.
    pub max_error_bound: f64,
    /// Root of the mean square difference, as measured.
    pub rms_error: f64,
    /// 1 where the decoded samples equal the input's, else 0.
    pub lossless: u32,
    /// The input's kmb_sample_type.
    pub sample_type: u32,
    /// Least valid sample.
    pub sample_min: f64,
    /// Greatest valid sample.
    pub sample_max: f64,
    /// Physical height = value_scale * sample + value_offset. World z is the physical height.
    pub value_scale: f64,
    /// See value_scale.
    pub value_offset: f64,
    /// The value of a void in the input, where has_nodata is 1; else 0.
    pub nodata: f64,
    /// 1 where the input had such a value, else 0.
    pub has_nodata: u32,
    /// 1 where the input said where it lies, else 0.
    pub georeferenced: u32,
    /// 1 where the reference system's coordinates are degrees of longitude and latitude, else 0.
    pub geographic: u32,
    /// A kmb_registration.
    pub registration: u32,
    /// X = g[0] + column g[1] + row g[2], Y = g[3] + column g[4] + row g[5], in the reference
    /// system; for the sample itself, or for its outer corner, as registration says.
    pub geotransform: [f64; 6],
    /// World x and y of the sample in column 0 of row 0.
    pub world_origin: [f64; 2],
    /// World units of one column, along x, and of one row, along y (negative where row 0 is the
    /// north).
    pub world_step: [f64; 2],
    /// The coordinate reference system: WKT, "EPSG:n", or empty. Lives until the repository is
    /// closed.
    pub crs: *const c_char,
    /// The unit of physical heights, or empty. Lives until the repository is closed.
    pub units: *const c_char,
    /// Count of metadata entries.
    pub metadata_count: u64,
    /// Numbers of a sample: 1 for heights, 3 for colours (red, green, blue).
    pub bands: u32,
    /// 1 where detail is missing since a repair, else 0. Errors of the samples there are larger than
    /// those above.
    pub missing_detail: u32,
}

// SAFETY: repr(C) with struct_size first, and integers only.
unsafe impl SizedStruct for kmb_open_options {
    const NAME: &'static str = "kmb_open_options";
}
// SAFETY: repr(C) with struct_size first, and integers, floats and raw pointers only.
unsafe impl SizedStruct for kmb_repository_info {
    const NAME: &'static str = "kmb_repository_info";
}

/// An open repository of heights or of colours. Cuts and queries made from it share what they need of
/// it, so that it may be closed before them.
pub struct kmb_repository {
    broken: AtomicBool,
    pub(super) layer: Arc<Layer>,
    crs: CString,
    units: CString,
    metadata_keys: Vec<CString>,
}

impl kmb_repository {
    /// The surface of a repository of heights.
    pub(super) fn terrain(&self) -> Result<Arc<Terrain>, Failure> {
        let not_heights =
            || Failure::argument("the repository holds colours, and heights are needed");
        match self.layer.header().kind {
            Kind::Heights => Ok(Arc::new(Terrain::of(self.layer.clone())?)),
            Kind::Colours | Kind::City => Err(not_heights()),
        }
    }
}

impl Handle for kmb_repository {
    const NAME: &'static str = "repository";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Opens the repository of heights or of colours at `path` (bytes as the system has them; UTF-8 on Windows) and
/// gives a handle, which kmb_repository_close frees. `options` may be NULL: a memory map.
///
/// Reads the header, the tables and the roots; blocks are read, and their checksums checked, when
/// they are used. May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_IO, KMB_DAMAGED (the file is
/// no repository, or its bytes are not as they were written), KMB_UNSUPPORTED_VERSION, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_open(
    path: *const c_char,
    options: *const kmb_open_options,
    repository: *mut *mut kmb_repository,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (path, out) = unsafe { (self::path(path)?, output(repository, "repository")?) };
        let (mut access, mut shared_bytes) = (Access::Map, 0);
        if !options.is_null() {
            // SAFETY: as above.
            let options = unsafe { input_struct(options) }?;
            (access, shared_bytes) = (chosen_access(options.access)?, options.shared_bytes);
        }
        let layer = Layer::open(&path, access)?.sharing(shared_bytes)?;
        let info = &layer.header().raster;
        let opened = kmb_repository {
            broken: AtomicBool::new(false),
            crs: c_string(&info.crs),
            units: c_string(&info.units),
            metadata_keys: info.metadata.keys().map(|key| c_string(key)).collect(),
            layer: Arc::new(layer),
        };
        out.write(Box::into_raw(Box::new(opened)));
        Ok(())
    })
}

pub(super) fn chosen_access(number: u32) -> Result<Access, Failure> {
    match number {
        number if number == kmb_access::KMB_ACCESS_MAP as u32 => Ok(Access::Map),
        number if number == kmb_access::KMB_ACCESS_POSITIONED as u32 => Ok(Access::Positioned),
        _ => Err(Failure::argument(format!("access {number} is unknown"))),
    }
}

pub(super) fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// Frees a repository. NULL is allowed. No other call may use the handle at the same time, or
/// afterwards; cuts and queries made from it stay usable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_close(repository: *mut kmb_repository) {
    let _ = boundary!({
        if !repository.is_null() {
            // SAFETY: the caller gives back what kmb_repository_open gave, once.
            drop(unsafe { Box::from_raw(repository) });
        }
        Ok(())
    });
}

/// Says what is known of a repository. The caller sets info->struct_size; its strings belong to the
/// repository and live until it is closed.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_describe(
    repository: *const kmb_repository,
    info: *mut kmb_repository_info,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(info) }?;
        out.write(described(repository));
        Ok(())
    })
}

fn described(repository: &kmb_repository) -> kmb_repository_info {
    let header = repository.layer.header();
    let raster = &header.raster;
    let frame = Frame::of(raster);
    kmb_repository_info {
        struct_size: size_of::<kmb_repository_info>() as u32,
        kind: header.kind as u32,
        width: raster.width,
        height: raster.height,
        cells: 1 << header.cells_log2,
        levels: u32::from(header.levels),
        diamonds: header.block_count,
        samples: header.samples,
        void_samples: header.void_samples,
        bytes: repository.layer.store().file_bytes(),
        max_error: header.max_error,
        max_error_bound: header.max_error_bound,
        rms_error: header.rms_error,
        lossless: u32::from(header.lossless),
        sample_type: raster.sample_type as u32,
        sample_min: header.sample_min,
        sample_max: header.sample_max,
        value_scale: raster.value_scale,
        value_offset: raster.value_offset,
        nodata: raster.nodata.unwrap_or(0.0),
        has_nodata: u32::from(raster.nodata.is_some()),
        georeferenced: u32::from(raster.georeferenced),
        geographic: u32::from(raster.geographic),
        registration: raster.registration as u32,
        geotransform: raster.geotransform,
        world_origin: frame.origin,
        world_step: frame.step,
        crs: repository.crs.as_ptr(),
        units: repository.units.as_ptr(),
        metadata_count: repository.metadata_keys.len() as u64,
        bands: u32::from(raster.bands),
        missing_detail: u32::from(repository.layer.store().has_missing()),
    }
}

/// Gives metadata entry `index`, counted from 0 in the order of the keys: its key, a string, and
/// its value, `length` bytes of any kind. Both belong to the repository and live until it is
/// closed.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_NOT_FOUND (`index` is not below metadata_count),
/// KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_metadata_at(
    repository: *const kmb_repository,
    index: u64,
    key: *mut *const c_char,
    value: *mut *const u8,
    length: *mut usize,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let (key, value, length) = unsafe {
            (output(key, "key")?, output(value, "value")?, output(length, "length")?)
        };
        let index = usize::try_from(index).unwrap_or(usize::MAX);
        let entries = &repository.layer.header().raster.metadata;
        let (Some(name), Some(bytes)) =
            (repository.metadata_keys.get(index), entries.values().nth(index))
        else {
            let count = entries.len();
            let message = format!("there is no metadata entry {index}, only {count}");
            return Err(Failure::new(kmb_status::KMB_NOT_FOUND, message));
        };
        key.write(name.as_ptr());
        value.write(bytes.as_ptr());
        length.write(bytes.len());
        Ok(())
    })
}

/// Gives the value of a metadata key: `length` bytes of any kind, which belong to the repository
/// and live until it is closed.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_NOT_FOUND, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_repository_metadata(
    repository: *const kmb_repository,
    key: *const c_char,
    value: *mut *const u8,
    length: *mut usize,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let (key, value, length) = unsafe {
            (text(key, "key")?, output(value, "value")?, output(length, "length")?)
        };
        let Some(bytes) = repository.layer.header().raster.metadata.get(key) else {
            let message = format!("there is no metadata under the key {key:?}");
            return Err(Failure::new(kmb_status::KMB_NOT_FOUND, message));
        };
        value.write(bytes.as_ptr());
        length.write(bytes.len());
        Ok(())
    })
}

/// Turns world x and y into coordinates of the raster's reference system (degrees where it is
/// geographic).
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_world_to_crs(
    repository: *const kmb_repository,
    x: f64,
    y: f64,
    crs_x: *mut f64,
    crs_y: *mut f64,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let (out_x, out_y) = unsafe { (output(crs_x, "crs_x")?, output(crs_y, "crs_y")?) };
        let raster = &repository.layer.header().raster;
        let [column, row] = Frame::of(raster).world_to_grid(x, y);
        let [x, y] = raster.sample_to_crs(column, row);
        out_x.write(x);
        out_y.write(y);
        Ok(())
    })
}

/// Turns coordinates of the raster's reference system (degrees where it is geographic) into world x
/// and y.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_OUTSIDE (the geotransform has no inverse), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_crs_to_world(
    repository: *const kmb_repository,
    crs_x: f64,
    crs_y: f64,
    x: *mut f64,
    y: *mut f64,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let (out_x, out_y) = unsafe { (output(x, "x")?, output(y, "y")?) };
        let raster = &repository.layer.header().raster;
        let Some([column, row]) = raster.crs_to_sample(crs_x, crs_y) else {
            let message = "the repository's geotransform has no inverse";
            return Err(Failure::new(kmb_status::KMB_OUTSIDE, message));
        };
        let [x, y] = Frame::of(raster).grid_to_world(column, row);
        out_x.write(x);
        out_y.write(y);
        Ok(())
    })
}
