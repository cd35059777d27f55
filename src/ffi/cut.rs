//! Cuts: what a viewer draws.

use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, SizedStruct, boundary, input_struct, output, output_struct, required, usable,
};
use super::frame::frame;
use super::patch::kmb_patch;
use super::query::KMB_UNLIMITED;
use super::repository::kmb_repository;
use super::status::kmb_status;
use crate::cut::{
    Changes, ColourForm, Colouring, Cut, CutOptions, Detail, Metric, Stats, VertexForm,
};
use crate::schedule::Budget;

/// What a vertex of a patch holds. All are floats without padding between them.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_vertex_form {
    /// 3 floats: height relative to the patch's origin, in height units; then dz/dx and dz/dy of
    /// the surface in world units. The place within the patch comes from kmb_cut_grid.
    KMB_VERTEX_COMPACT = 0,
    /// 6 floats: column, row and height relative to the patch's origin, in columns, rows and height
    /// units; then the unit normal in the world.
    KMB_VERTEX_EXPANDED = 1,
}

/// What a cut's tolerance is about.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_metric {
    /// How far a point of the finest surface may be, on the screen, from the drawn point at the same place. No more
    /// than the scene needs: flat land stays coarse.
    KMB_METRIC_GEOMETRIC = 0,
    /// How large the drawn triangles may be: the side of a square as large as the mean triangle of a half. It bounds no
    /// error.
    KMB_METRIC_SAMPLING = 1,
}

/// What patches have of the colours of a cut.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_colour_form {
    /// A square texture over the patch's whole diamond, texture_side texels a side, row by row without padding, 3 bytes
    /// each: red, green, blue. What lies beyond the patch's long side only serves bilinear filters, which
    /// agree along it with those of the next texture.
    KMB_COLOUR_TEXTURE = 0,
    /// 4 bytes for each vertex: red, green, blue, 255.
    KMB_COLOUR_VERTICES = 1,
}

/// How to make a cut. What is 0 stands for what no options stand for.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_cut_options {
    /// sizeof(kmb_cut_options).
    pub struct_size: u32,
    /// A kmb_vertex_form.
    pub vertex_form: u32,
    /// A kmb_metric.
    pub metric: u32,
    /// Threads that decode for the cut, at most 64. With 0, updates decode for themselves, within their budgets.
    pub threads: u32,
    /// A repository of colours over the same domain (built with --domain-of), or NULL. Its diamonds may have other cells
    /// and be deeper: then those of heights are divided further, and grid coordinates count finer steps. It may be
    /// closed before the cut is destroyed.
    pub colours: *const kmb_repository,
    /// A kmb_colour_form.
    pub colour_form: u32,
    /// 1 where patches are to tell where their vertices came from; else 0.
    pub births: u32,
    /// How large texels may be on the screen, in pixels, before finer ones are taken; 0 for 1.
    pub texel_pixels: f64,
    /// Levels beyond the finest heights, an even number.
    pub detail_levels: u32,
    /// 0.
    pub reserved: u32,
    /// Detail on these levels: the most that a new vertex is moved, up or down, as a part of the edge that it divides,
    /// 0 to 0.3. The moves are random, by the vertex's place: the same everywhere.
    pub roughness: f64,
}

/// A camera, in world coordinates.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_view {
    /// sizeof(kmb_view).
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// The eye.
    pub eye: [f64; 3],
    /// From the world to clip space, column by column; any projection.
    pub world_to_clip: [f64; 16],
    /// Width and height of the picture in pixels.
    pub viewport: [f64; 2],
    /// Largest error on the screen, in pixels by the cut's metric, that need not be refined; above 0.
    pub tolerance: f64,
}

/// Limits of one update. KMB_UNLIMITED lifts any of them.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_budget {
    /// sizeof(kmb_budget).
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Time after which no refinement starts, in microseconds from the start of the update.
    pub microseconds: u64,
    /// Refinements in this update; 0 leaves the cut as it is.
    pub refinements: u64,
    /// Bytes of decoded data that the cut holds, with all masks and lists of triangles that voids and borders may
    /// need, and up to an eighth of it for what its threads decode.
    pub bytes: u64,
    /// Bytes of vertices handed out anew in this update.
    pub upload_bytes: u64,
    /// Patches to draw; a half of a diamond counts as one even if it turns out to be void.
    pub patches: u64,
}

/// What an update did, and what is drawn now.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_stats {
    /// sizeof(kmb_stats).
    pub struct_size: u32,
    /// 1 where a budget ended refinement while an error was above the tolerance, or details have yet to come; else 0.
    pub cut_short: u32,
    /// Diamonds refined.
    pub refined: u64,
    /// Diamonds coarsened.
    pub coarsened: u64,
    /// Patches that kmb_cut_patches gives.
    pub patches: u64,
    /// Their triangles.
    pub triangles: u64,
    /// Patches that came into the cut.
    pub added: u64,
    /// Patches that left the cut.
    pub removed: u64,
    /// Bytes of decoded data that the cut holds, counted as its budget counts them.
    pub bytes: u64,
    /// Refinements begun after the deadline; always 0.
    pub late_refinements: u64,
    /// Largest error of a patch to draw, in pixels; may be infinite. Above the tolerance while cut_short
    /// is 0: detail is missing or damaged there.
    pub largest_error: f64,
    /// Time of the part whose cost does not depend on the budget, in microseconds.
    pub fixed_microseconds: f64,
    /// Time of the whole update, in microseconds.
    pub microseconds: f64,
    /// Diamonds whose details the cut's threads were asked for and have not given; updates go on without.
    pub awaited: u64,
    /// Bytes of vertices of the patches that came into the cut, counted as its budget counts them.
    pub upload_bytes: u64,
}

/// From grid coordinates (column, row, height unit) to the world, axis by axis: world[i] =
/// origin[i] + step[i] * grid[i].
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_grid_to_world {
    /// sizeof(kmb_grid_to_world).
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// World coordinates of column 0, row 0, height unit 0.
    pub origin: [f64; 3],
    /// World units of a column (along x), of a row (along y) and of a height unit (along z).
    pub step: [f64; 3],
}

// SAFETY: repr(C) with struct_size first, and integers, floats and a raw pointer only.
unsafe impl SizedStruct for kmb_cut_options {
    const NAME: &'static str = "kmb_cut_options";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_view {
    const NAME: &'static str = "kmb_view";
}
// SAFETY: repr(C) with struct_size first, and integers only.
unsafe impl SizedStruct for kmb_budget {
    const NAME: &'static str = "kmb_budget";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_stats {
    const NAME: &'static str = "kmb_stats";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_grid_to_world {
    const NAME: &'static str = "kmb_grid_to_world";
}

/// Threads of one cut, or of one visit of a city.
const MOST_THREADS: usize = 64;

/// The patches that a viewer draws, kept from frame to frame.
pub struct kmb_cut {
    broken: AtomicBool,
    cut: Cut,
    /// The cut's patches as C sees them, since the last update.
    patches: Vec<*const kmb_patch>,
    /// Holds what the last kmb_cut_changes gave.
    changes: Changes,
    added: Vec<*const kmb_patch>,
}

impl Handle for kmb_cut {
    const NAME: &'static str = "cut";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Makes a cut of a repository and gives a handle, which kmb_cut_destroy frees. It has no patches
/// to draw until its first update. `options` may be NULL: KMB_VERTEX_EXPANDED, KMB_METRIC_GEOMETRIC,
/// no threads.
/// The repository may be closed before the cut is destroyed.
///
/// May be called with the same repository from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_IO, KMB_DAMAGED, KMB_INPUT
/// (the colours are not over the heights' domain, or have too few texels), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_create(
    repository: *const kmb_repository,
    options: *const kmb_cut_options,
    cut: *mut *mut kmb_cut,
) -> kmb_status {
    boundary!(shared repository: kmb_repository, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output(cut, "cut") }?;
        let chosen = match options.is_null() {
            true => CutOptions::default(),
            // SAFETY: as above.
            false => chosen(&unsafe { input_struct(options) }?)?,
        };
        let cut = Cut::new(repository.terrain()?, chosen)?;
        let mut made = kmb_cut {
            broken: AtomicBool::new(false),
            cut,
            patches: Vec::new(),
            changes: Changes::default(),
            added: Vec::new(),
        };
        made.list_patches();
        out.write(Box::into_raw(Box::new(made)));
        Ok(())
    })
}

fn chosen(options: &kmb_cut_options) -> Result<CutOptions, Failure> {
    Ok(CutOptions {
        vertex_form: chosen_form(options.vertex_form)?,
        metric: chosen_metric(options.metric)?,
        threads: chosen_threads(options.threads)?,
        colours: chosen_colours(options)?,
        detail: Detail {
            levels: options.detail_levels,
            roughness: options.roughness,
        },
        births: options.births != 0,
    })
}

fn chosen_colours(options: &kmb_cut_options) -> Result<Option<Colouring>, Failure> {
    let form = match options.colour_form {
        number if number == kmb_colour_form::KMB_COLOUR_TEXTURE as u32 => ColourForm::Texture,
        number if number == kmb_colour_form::KMB_COLOUR_VERTICES as u32 => ColourForm::Vertices,
        number => {
            let message = format!("colour form {number} is unknown");
            return Err(Failure::argument(message));
        }
    };
    if options.colours.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller passes a repository that lives.
    let repository = unsafe { required(options.colours, "colours") }?;
    usable(repository)?;
    Ok(Some(Colouring {
        layer: repository.layer.clone(),
        form,
        texel_pixels: match options.texel_pixels {
            0.0 => 1.0,
            pixels => pixels,
        },
    }))
}

fn chosen_form(number: u32) -> Result<VertexForm, Failure> {
    match number {
        number if number == kmb_vertex_form::KMB_VERTEX_COMPACT as u32 => Ok(VertexForm::Compact),
        number if number == kmb_vertex_form::KMB_VERTEX_EXPANDED as u32 => Ok(VertexForm::Expanded),
        _ => Err(Failure::argument(format!(
            "vertex form {number} is unknown"
        ))),
    }
}

fn chosen_metric(number: u32) -> Result<Metric, Failure> {
    match number {
        number if number == kmb_metric::KMB_METRIC_GEOMETRIC as u32 => Ok(Metric::Geometric),
        number if number == kmb_metric::KMB_METRIC_SAMPLING as u32 => Ok(Metric::Sampling),
        _ => Err(Failure::argument(format!("metric {number} is unknown"))),
    }
}

pub(super) fn chosen_threads(number: u32) -> Result<usize, Failure> {
    match usize::try_from(number) {
        Ok(threads) if threads <= MOST_THREADS => Ok(threads),
        _ => Err(Failure::argument(format!(
            "{number} threads are more than {MOST_THREADS}"
        ))),
    }
}

impl kmb_cut {
    fn list_patches(&mut self) {
        self.patches.clear();
        let patches = self.cut.patches().iter();
        self.patches.extend(patches.map(kmb_patch::shown));
    }
}

/// Frees a cut, and its patches but for those that kmb_patch_retain holds. NULL is allowed. No
/// other call may use the handle at the same time, or afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_destroy(cut: *mut kmb_cut) {
    let _ = boundary!({
        if !cut.is_null() {
            // SAFETY: the caller gives back what kmb_cut_create gave, once.
            drop(unsafe { Box::from_raw(cut) });
        }
        Ok(())
    });
}

/// Moves the cut towards a view: refines where the error on the screen is above the view's
/// tolerance, and coarsens where it need not be so fine, within the budget. `budget` may be NULL:
/// no limits. `stats` may be NULL; otherwise the caller sets stats->struct_size.
///
/// The cut is whole and without cracks whatever ends the update. With a still view and the same
/// budget it settles, and then changes nothing. Ends the life of what kmb_cut_patches and
/// kmb_cut_changes gave before.
///
/// Exclusive: no other call may use the cut at the same time. Patches that are retained may be
/// used.
///
/// Returns KMB_OK; KMB_BUDGET_TOO_SMALL (the budget is below the coarsest patches: they are shown
/// all the same, and `stats` is written); KMB_INVALID_ARGUMENT (also for a view with a number that
/// is not finite, with an empty viewport, or with a tolerance that is not above 0: the cut stays as
/// it was); KMB_INVALID_STRUCT_SIZE; KMB_PANIC. A block that cannot be read or is damaged is no
/// failure: the surface stays coarser there, and the log callback is told once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_update(
    cut: *mut kmb_cut,
    view: *const kmb_view,
    budget: *const kmb_budget,
    stats: *mut kmb_stats,
) -> kmb_status {
    boundary!(exclusive cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let (view, budget, out) = unsafe { frame(view, budget, stats) }?;
        let updated = cut.cut.update(&view, &budget);
        cut.list_patches();
        let stats = updated?;
        if let Some(out) = out {
            out.write(told(&stats));
        }
        if stats.budget_too_small {
            let message = "the budget does not hold the coarsest patches";
            return Err(Failure::new(kmb_status::KMB_BUDGET_TOO_SMALL, message));
        }
        Ok(())
    })
}

const _: () = assert!(KMB_UNLIMITED == Budget::NO_LIMIT);

fn told(stats: &Stats) -> kmb_stats {
    kmb_stats {
        struct_size: size_of::<kmb_stats>() as u32,
        cut_short: u32::from(stats.cut_short),
        refined: stats.refined,
        coarsened: stats.coarsened,
        patches: stats.patches,
        triangles: stats.triangles,
        added: stats.added,
        removed: stats.removed,
        bytes: stats.bytes,
        late_refinements: stats.late_refinements,
        largest_error: stats.largest_error,
        fixed_microseconds: stats.fixed_microseconds,
        microseconds: stats.microseconds,
        awaited: stats.awaited,
        upload_bytes: stats.uploaded,
    }
}

/// Gives the patches to draw, near to far: those of the cut that meet the view's frustum. The array
/// and its patches belong to the cut and live until its next update or its end; a patch lives
/// longer by kmb_patch_retain.
///
/// May be called with the same cut from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_patches(
    cut: *const kmb_cut,
    patches: *mut *const *const kmb_patch,
    count: *mut usize,
) -> kmb_status {
    boundary!(shared cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let (patches, count) = unsafe { (output(patches, "patches")?, output(count, "count")?) };
        patches.write(cut.patches.as_ptr());
        count.write(cut.patches.len());
        Ok(())
    })
}

/// Gives what changed since the last call of this function, or since the cut was made: the patches
/// that came into the cut, in the frustum or not, and the handles of those that left it. A patch
/// that came and left in between is in neither. So a GPU cache is a map from handles to buffers.
///
/// The arrays belong to the cut and live until the next call of this function, the next update, or
/// the cut's end.
///
/// Exclusive: no other call may use the cut at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_changes(
    cut: *mut kmb_cut,
    added: *mut *const *const kmb_patch,
    added_count: *mut usize,
    removed: *mut *const u64,
    removed_count: *mut usize,
) -> kmb_status {
    boundary!(exclusive cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let (added, added_count, removed, removed_count) = unsafe {
            (
                output(added, "added")?,
                output(added_count, "added_count")?,
                output(removed, "removed")?,
                output(removed_count, "removed_count")?,
            )
        };
        cut.changes = cut.cut.take_changes();
        cut.added.clear();
        cut.added.extend(cut.changes.added.iter().map(kmb_patch::shown));
        added.write(cut.added.as_ptr());
        added_count.write(cut.added.len());
        removed.write(cut.changes.removed.as_ptr());
        removed_count.write(cut.changes.removed.len());
        Ok(())
    })
}

/// Gives the triangles that all complete patches share, as a list: three vertex indices each, with
/// the upper side counterclockwise. The array belongs to the cut and lives as long.
///
/// May be called with the same cut from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_triangle_list(
    cut: *const kmb_cut,
    indices: *mut *const u16,
    count: *mut usize,
) -> kmb_status {
    boundary!(shared cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let (indices, count) = unsafe { (output(indices, "indices")?, output(count, "count")?) };
        indices.write(cut.cut.triangle_list().as_ptr());
        count.write(cut.cut.triangle_list().len());
        Ok(())
    })
}

/// Gives the same triangles as one strip, whose rows are joined by triangles without area. The
/// array belongs to the cut and lives as long.
///
/// May be called with the same cut from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_triangle_strip(
    cut: *const kmb_cut,
    indices: *mut *const u16,
    count: *mut usize,
) -> kmb_status {
    boundary!(shared cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let (indices, count) = unsafe { (output(indices, "indices")?, output(count, "count")?) };
        indices.write(cut.cut.triangle_strip().as_ptr());
        count.write(cut.cut.triangle_strip().len());
        Ok(())
    })
}

/// Gives the place (p, q) of every vertex within any patch, two floats each, for vertices of
/// KMB_VERTEX_COMPACT: vertex (p, q) lies at origin + p legs[0] + q legs[1] of its patch.
/// `vertex_count` is that of pairs. The array belongs to the cut and lives as long.
///
/// May be called with the same cut from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_grid(
    cut: *const kmb_cut,
    grid: *mut *const f32,
    vertex_count: *mut usize,
) -> kmb_status {
    boundary!(shared cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let (grid, count) = unsafe {
            (output(grid, "grid")?, output(vertex_count, "vertex_count")?)
        };
        grid.write(cut.cut.grid().as_ptr().cast());
        count.write(cut.cut.grid().len());
        Ok(())
    })
}

/// Gives the map from grid coordinates to the world, one for all patches. The caller sets
/// map->struct_size.
///
/// To keep shared vertices of neighbours together to the last bit, add `origin - anchor` of a patch
/// (integers, exact in floats) to its vertices first, and multiply with one matrix of the frame
/// afterwards; never with a matrix for each patch.
///
/// May be called with the same cut from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_cut_grid_to_world(
    cut: *const kmb_cut,
    map: *mut kmb_grid_to_world,
) -> kmb_status {
    boundary!(shared cut: kmb_cut, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(map) }?;
        let map = cut.cut.grid_to_world();
        out.write(kmb_grid_to_world {
            struct_size: size_of::<kmb_grid_to_world>() as u32,
            reserved: 0,
            origin: map.origin,
            step: map.step,
        });
        Ok(())
    })
}
