//! Cities: opening, what is known of them, single blocks.

use std::ffi::{CString, c_char};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, SizedStruct, boundary, output, output_array, output_struct, path,
};
use super::repository::{c_string, chosen_access};
use super::status::kmb_status;
use crate::blockmap::{BlockMap, City, Node, image_bytes};
use crate::geo::SampleType;

/// Stands for no node: the parent of the root, the first child of a leaf, the node of a ray that met
/// nothing.
pub const KMB_NO_NODE: u32 = u32::MAX;

/// What is known of a city. Lengths are in the units of its reference system.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_info {
    /// sizeof(kmb_city_info).
    pub struct_size: u32,
    /// Texels along a block, K: 32, 64 or 128.
    pub side_texels: u32,
    /// Nodes of its quadtree, each with a block. Node 0 is the root.
    pub nodes: u32,
    /// Nodes without children.
    pub leaves: u32,
    /// Levels of nodes; the root is of level 0.
    pub levels: u32,
    /// Bits of its blocks' heights: 8 or 16.
    pub height_bits: u32,
    /// West and south edge of its square.
    pub corner: [f64; 2],
    /// Length of an edge of it.
    pub side: f64,
    /// Down to where the prisms over all texels reach: z.
    pub floor: f64,
    /// Least and greatest height: z.
    pub heights: [f64; 2],
    /// Bytes of a block's image: (2 K + 256) K 4.
    pub image_bytes: u64,
    /// Bytes of the low halves of a block's heights of 16 bits, K K; 0 where they have 8.
    pub low_height_bytes: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// The coordinate reference system: WKT, "EPSG:n", or empty. Lives until the city is closed.
    pub crs: *const c_char,
}

/// A square of a city.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_node {
    /// sizeof(kmb_city_node).
    pub struct_size: u32,
    /// 0 for the root.
    pub level: u32,
    /// Column and row among the squares of its level, from the south-west.
    pub place: [u32; 2],
    /// KMB_NO_NODE for the root.
    pub parent: u32,
    /// The first of its four children, which follow each other: south-west, south-east, north-west,
    /// north-east. KMB_NO_NODE for a leaf.
    pub first_child: u32,
    /// West and south edge.
    pub corner: [f64; 2],
    /// Length of an edge. Squares that touch have the same edges, bit for bit.
    pub side: f64,
    /// Least and greatest height of its block and of all blocks below it: z.
    pub heights: [f64; 2],
    /// How far it is from the leaves, as a length that kmb_city_visit_update compares with the tolerance: height_error, or a texel where
    /// its colours are wrong.
    pub error: f64,
    /// Largest difference of its heights from those of its children, at most a texel; at least theirs.
    pub height_error: f64,
    /// Root of the mean square difference of its roofs' colours from those of its children, of 255; at least theirs.
    pub colour_error: f64,
}

/// A block of a city as an image of (2 K + 256) x K texels, four bytes each, row by row without padding. Row 0 is the
/// southernmost, column 0 the westernmost.
///
/// Columns 0 to K - 1: height (the high byte of 16 bits), wall column (0 for no wall), and x and y of the roof's unit normal.
/// Columns K to 2 K - 1: red, green and blue of the roof or of the ground, and ambient occlusion (255: sees all of the sky).
/// Columns 2 K to 2 K + 255: the same of the walls. A component of a normal is (byte - 127) / 127.
///
/// The rows are parted into `slices` equal slices of R = K / slices rows. The wall of a texel in row r whose wall column is w has its
/// colours in column 2 K + w, upwards from row first = r / R R: at height z in row
/// first + min(floor((z - heights[0]) / (heights[1] - heights[0]) (R - 1)), R - 2). In row first + R - 1 it has its mean normal, three bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_blockmap {
    /// sizeof(kmb_blockmap).
    pub struct_size: u32,
    /// Texels along it, K.
    pub side_texels: u32,
    /// Slices of its walls: a power of two.
    pub slices: u32,
    /// Bits of its heights: 8 or 16.
    pub height_bits: u32,
    /// West and south edge.
    pub corner: [f64; 2],
    /// Length of an edge.
    pub side: f64,
    /// Heights of code 0 and of the greatest code, 255 or 65535; codes between are evenly spaced.
    pub heights: [f32; 2],
    /// A texel has a wall where it stands more than so much above one of its four neighbours.
    pub exposure: f32,
    /// Steepest roof, as rise over run: a ray that comes over the edge of a texel with a wall meets it if the step there is
    /// higher than roof_slope side / K, and meets a roof otherwise.
    pub roof_slope: f32,
    /// The image.
    pub image: *const u8,
    /// Bytes at `image`.
    pub image_bytes: usize,
    /// The low bytes of 16-bit heights, one a texel, K x K, row by row; NULL where they are not there.
    pub low_heights: *const u8,
    /// Bytes at `low_heights`.
    pub low_height_bytes: usize,
}

// SAFETY: repr(C) with struct_size first, and integers, floats and a raw pointer only.
unsafe impl SizedStruct for kmb_city_info {
    const NAME: &'static str = "kmb_city_info";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_city_node {
    const NAME: &'static str = "kmb_city_node";
}
// SAFETY: repr(C) with struct_size first, and integers, floats and raw pointers only.
unsafe impl SizedStruct for kmb_blockmap {
    const NAME: &'static str = "kmb_blockmap";
}

/// An open city. Visits made from it share what they need of it, so that it may be closed before
/// them.
pub struct kmb_city {
    broken: AtomicBool,
    pub(super) city: Arc<City>,
    crs: CString,
}

impl Handle for kmb_city {
    const NAME: &'static str = "city";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Opens the city at `path` (bytes as the system has them; UTF-8 on Windows) and gives a handle,
/// which kmb_city_close frees. `access` is a kmb_access.
///
/// Reads the header, the tables and the tree; blocks are read, and their checksums checked, when
/// they are used. May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_IO, KMB_INPUT (the repository holds something else),
/// KMB_DAMAGED (the file is no repository, or its bytes are not as they were written),
/// KMB_UNSUPPORTED_VERSION, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_open(
    path: *const c_char,
    access: u32,
    city: *mut *mut kmb_city,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (path, out) = unsafe { (self::path(path)?, output(city, "city")?) };
        let city = City::open(&path, chosen_access(access)?)?;
        let opened = kmb_city {
            broken: AtomicBool::new(false),
            crs: c_string(&city.store().header().raster.crs),
            city: Arc::new(city),
        };
        out.write(Box::into_raw(Box::new(opened)));
        Ok(())
    })
}

/// Frees a city. NULL is allowed. No other call may use the handle at the same time, or afterwards;
/// visits made from it stay usable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_close(city: *mut kmb_city) {
    let _ = boundary!({
        if !city.is_null() {
            // SAFETY: the caller gives back what kmb_city_open gave, once.
            drop(unsafe { Box::from_raw(city) });
        }
        Ok(())
    });
}

/// Says what is known of a city. The caller sets info->struct_size; its string belongs to the city
/// and lives until it is closed.
///
/// May be called with the same city from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_describe(
    city: *const kmb_city,
    info: *mut kmb_city_info,
) -> kmb_status {
    boundary!(shared city: kmb_city, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(info) }?;
        let (open, tree) = (&city.city, city.city.tree());
        let side = open.side_texels();
        let is_8_bits = open.store().header().raster.sample_type == SampleType::U8;
        out.write(kmb_city_info {
            struct_size: size_of::<kmb_city_info>() as u32,
            side_texels: side as u32,
            nodes: tree.nodes.len() as u32,
            leaves: tree.leaves() as u32,
            levels: tree.depth() + 1,
            height_bits: if is_8_bits { 8 } else { 16 },
            corner: tree.corner,
            side: tree.side,
            floor: tree.floor,
            heights: tree.nodes[0].heights.map(f64::from),
            image_bytes: image_bytes(side) as u64,
            low_height_bytes: if is_8_bits { 0 } else { (side * side) as u64 },
            bytes: open.store().file_bytes(),
            crs: city.crs.as_ptr(),
        });
        Ok(())
    })
}

/// Says what is known of node `index`. Children have higher numbers than their parents. The caller
/// sets node->struct_size.
///
/// May be called with the same city from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_NOT_FOUND (there are not so
/// many nodes), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_node_at(
    city: *const kmb_city,
    index: u32,
    node: *mut kmb_city_node,
) -> kmb_status {
    boundary!(shared city: kmb_city, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(node) }?;
        let (found, tree) = (city.node(index)?, city.city.tree());
        let (corner, side) = tree.square(found);
        out.write(kmb_city_node {
            struct_size: size_of::<kmb_city_node>() as u32,
            level: found.level,
            place: found.place,
            parent: found.parent.unwrap_or(KMB_NO_NODE),
            first_child: found.children.unwrap_or(KMB_NO_NODE),
            corner,
            side,
            heights: found.heights.map(f64::from),
            error: found.error_metres(side / f64::from(tree.side_texels as u32)),
            height_error: f64::from(found.error.height),
            colour_error: f64::from(found.error.colour),
        });
        Ok(())
    })
}

impl kmb_city {
    fn node(&self, index: u32) -> Result<&Node, Failure> {
        let nodes = &self.city.tree().nodes;
        nodes.get(index as usize).ok_or_else(|| {
            let message = format!("there is no node {index}, only {}", nodes.len());
            Failure::new(kmb_status::KMB_NOT_FOUND, message)
        })
    }
}

/// Reads and decodes the block of a node into the caller's memory, in one call. `image` has room for `image_length` bytes;
/// image_bytes of kmb_city_info are needed. `low_heights` has room for `low_height_length`; low_height_bytes of
/// kmb_city_info are needed, or it is NULL: heights of 16 bits are then only as good as their high bytes. `block` may be
/// NULL; otherwise the caller sets block->struct_size, and its pointers become those that were passed, low_heights NULL for 8
/// bits.
///
/// May be called with the same city from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_BUFFER_TOO_SMALL, KMB_NOT_FOUND (there are not so many
/// nodes), KMB_IO, KMB_DAMAGED, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_read(
    city: *const kmb_city,
    node: u32,
    image: *mut u8,
    image_length: usize,
    low_heights: *mut u8,
    low_height_length: usize,
    block: *mut kmb_blockmap,
) -> kmb_status {
    boundary!(shared city: kmb_city, {
        city.node(node)?;
        let out = match block.is_null() {
            true => None,
            // SAFETY: the caller passes pointers as the header asks.
            false => Some(unsafe { output_struct(block) }?),
        };
        // SAFETY: as above.
        let bytes = unsafe { output_array(image, image_length, "image") }?;
        let map = city.city.read(node)?;
        let low = match &map.low_heights {
            Some(low) if !low_heights.is_null() => {
                // SAFETY: as above.
                let bytes = unsafe { output_array(low_heights, low_height_length, "low_heights") }?;
                Some((bytes, low))
            }
            _ => None,
        };
        let is_short = low.as_ref().is_some_and(|(bytes, low)| bytes.len() < low.len());
        if bytes.len() < map.image.len() || is_short {
            let (image, low) = (map.image.len(), map.low_heights.as_ref().map_or(0, Vec::len));
            let message = format!("a block is {image} bytes, and {low} of low heights");
            return Err(Failure::new(kmb_status::KMB_BUFFER_TOO_SMALL, message));
        }
        bytes[..map.image.len()].copy_from_slice(&map.image);
        let told = kmb_blockmap { image, ..described(&map) };
        let told = match low {
            Some((bytes, low)) => {
                bytes[..low.len()].copy_from_slice(low);
                kmb_blockmap { low_heights, ..told }
            }
            None => kmb_blockmap { low_heights: std::ptr::null(), low_height_bytes: 0, ..told },
        };
        if let Some(out) = out {
            out.write(told);
        }
        Ok(())
    })
}

/// A block as C sees it, where it is.
pub(super) fn described(map: &BlockMap) -> kmb_blockmap {
    let low = map.low_heights.as_deref();
    kmb_blockmap {
        struct_size: size_of::<kmb_blockmap>() as u32,
        side_texels: map.side_texels as u32,
        slices: map.slices as u32,
        height_bits: if low.is_some() { 16 } else { 8 },
        corner: map.corner,
        side: map.side,
        heights: map.heights,
        exposure: map.exposure,
        roof_slope: map.roof_slope,
        image: map.image.as_ptr(),
        image_bytes: map.image.len(),
        low_heights: low.map_or(std::ptr::null(), <[u8]>::as_ptr),
        low_height_bytes: low.map_or(0, <[u8]>::len),
    }
}
