//! Visits of a city: what a viewer draws, and rays against it.

use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use super::boundary::{
    Failure, Handle, Outcome, SizedStruct, array, boundary, input_struct, output, output_array,
    output_struct,
};
use super::city::{KMB_NO_NODE, described, kmb_blockmap, kmb_city};
use super::cut::{chosen_threads, kmb_budget, kmb_stats, kmb_view};
use super::frame::frame;
use super::query::KMB_UNLIMITED;
use super::ray::kmb_ray;
use super::status::kmb_status;
use crate::blockmap::{CityHit, CityRays, Ray, Visit, VisitStats};

/// Rays that are made ready at a time.
const RAYS: usize = 64;

/// A block to draw.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_drawn {
    /// sizeof(kmb_city_drawn).
    pub struct_size: u32,
    /// Which node's.
    pub node: u32,
    /// Which quarters of it: 1 south-west, 2 south-east, 4 north-west, 8 north-east, or their sum. In the
    /// others finer blocks are drawn.
    pub quarters: u32,
    /// 0.
    pub reserved: u32,
    /// Its error on the screen, in pixels; may be infinite.
    pub pixels: f64,
}

/// What an update did, and what is drawn now.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_stats {
    /// sizeof(kmb_city_stats).
    pub struct_size: u32,
    /// 1 where a budget kept out what the tolerance asks for, or blocks have yet to come; else 0.
    pub cut_short: u32,
    /// Entries that kmb_city_visit_drawn gives.
    pub drawn: u64,
    /// Of these, blocks of which only some quarters are drawn.
    pub partial: u64,
    /// Blocks held.
    pub resident: u64,
    /// Bytes of these.
    pub bytes: u64,
    /// Blocks that came.
    pub loaded: u64,
    /// Bytes of these.
    pub upload_bytes: u64,
    /// Blocks that went.
    pub dropped: u64,
    /// Blocks that should be drawn and have not come.
    pub awaited: u64,
    /// Blocks that cannot be read, since the visit was made; the log callback was told each once.
    pub failed: u64,
    /// Largest error on the screen of what is drawn, in pixels; may be infinite.
    pub largest_error: f64,
    /// Time of the update, in microseconds.
    pub microseconds: f64,
}

/// Where a ray meets a city.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_hit {
    /// sizeof(kmb_city_hit).
    pub struct_size: u32,
    /// Whose block; KMB_NO_NODE where the ray meets nothing, and then all that follows is 0 but the distance, which is infinite.
    pub node: u32,
    /// The place is origin + distance * direction.
    pub distance: f64,
    /// Column and row of the texel in the block.
    pub texel: [u32; 2],
    /// z of the place.
    pub height: f32,
    /// 1 for a wall, 0 for a roof or the ground.
    pub is_wall: u32,
    /// Unit normal there, about.
    pub normal: [f32; 3],
    /// Red, green, blue, and ambient occlusion: 255 sees all of the sky.
    pub colour: [u8; 4],
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_city_drawn {
    const NAME: &'static str = "kmb_city_drawn";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_city_stats {
    const NAME: &'static str = "kmb_city_stats";
}
// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_city_hit {
    const NAME: &'static str = "kmb_city_hit";
}

/// The blocks that a viewer draws, kept from frame to frame.
pub struct kmb_city_visit {
    broken: AtomicBool,
    visit: Visit,
    /// What is drawn as C sees it, since the last update.
    drawn: Vec<kmb_city_drawn>,
    /// For rays, from the first that is cast after an update.
    rays: OnceLock<CityRays>,
}

impl Handle for kmb_city_visit {
    const NAME: &'static str = "visit";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Makes a visit of a city and gives a handle, which kmb_city_visit_destroy frees. It holds the root's block from the start, and has
/// nothing to draw until its first update. `threads` decode for it, at most 64; with 0, updates decode for themselves, within
/// their budgets. The city may be closed before the visit is destroyed.
///
/// May be called with the same city from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_IO, KMB_DAMAGED (the root's block), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_create(
    city: *const kmb_city,
    threads: u32,
    visit: *mut *mut kmb_city_visit,
) -> kmb_status {
    boundary!(shared city: kmb_city, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output(visit, "visit") }?;
        let made = kmb_city_visit {
            broken: AtomicBool::new(false),
            visit: Visit::new(city.city.clone(), chosen_threads(threads)?)?,
            drawn: Vec::new(),
            rays: OnceLock::new(),
        };
        out.write(Box::into_raw(Box::new(made)));
        Ok(())
    })
}

/// Frees a visit with its blocks. NULL is allowed. No other call may use the handle at the same
/// time, or afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_destroy(visit: *mut kmb_city_visit) {
    let _ = boundary!({
        if !visit.is_null() {
            // SAFETY: the caller gives back what kmb_city_visit_create gave, once.
            drop(unsafe { Box::from_raw(visit) });
        }
        Ok(())
    });
}

/// Finds what to draw of a view, whose world is the city's reference system, and loads what is missing for it within the budget:
/// `refinements` limits the blocks that come in this update, `bytes` those held, `upload_bytes` those that come, `patches` the
/// entries to draw. `budget` may be NULL: no limits. `stats` may be NULL; otherwise the caller sets stats->struct_size. The view's
/// tolerance may be 0 here: the finest blocks.
///
/// What is drawn covers all that the frustum meets of the city, each place once, whatever ends the update: where blocks have not
/// come, coarser ones are drawn. With a still view and the same budget it settles. Ends the life of what kmb_city_visit_drawn,
/// kmb_city_visit_added, kmb_city_visit_removed and kmb_city_visit_block gave before.
///
/// A terrain and a city are drawn under one budget by kmb_cut_update with the budget, kmb_budget_rest, and kmb_city_visit_update with the
/// rest.
///
/// Exclusive: no other call may use the visit at the same time.
///
/// Returns KMB_OK; KMB_BUDGET_TOO_SMALL (the budget does not hold the root's block: it is drawn all the same, and `stats` is
/// written); KMB_INVALID_ARGUMENT (also for a view with a number that is not finite, with an empty viewport, or with a tolerance
/// below 0: the visit stays as it was); KMB_INVALID_STRUCT_SIZE; KMB_PANIC. A block that cannot be read is no failure: coarser ones
/// are drawn there, and the log callback is told once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_update(
    visit: *mut kmb_city_visit,
    view: *const kmb_view,
    budget: *const kmb_budget,
    stats: *mut kmb_city_stats,
) -> kmb_status {
    boundary!(exclusive visit: kmb_city_visit, {
        // SAFETY: the caller passes pointers as the header asks.
        let (view, budget, out) = unsafe { frame(view, budget, stats) }?;
        visit.rays.take();
        let stats = visit.visit.update(&view, &budget)?;
        visit.list_drawn();
        if let Some(out) = out {
            out.write(told(&stats, visit.visit.block_bytes()));
        }
        if stats.budget_too_small {
            let message = "the budget does not hold the coarsest block";
            return Err(Failure::new(kmb_status::KMB_BUDGET_TOO_SMALL, message));
        }
        Ok(())
    })
}

impl kmb_city_visit {
    fn list_drawn(&mut self) {
        self.drawn.clear();
        let drawn = self.visit.drawn().iter();
        self.drawn.extend(drawn.map(|entry| kmb_city_drawn {
            struct_size: size_of::<kmb_city_drawn>() as u32,
            node: entry.node,
            quarters: u32::from(entry.quarters),
            reserved: 0,
            pixels: entry.pixels,
        }));
    }
}

fn told(stats: &VisitStats, block_bytes: u64) -> kmb_city_stats {
    kmb_city_stats {
        struct_size: size_of::<kmb_city_stats>() as u32,
        cut_short: u32::from(stats.cut_short),
        drawn: stats.drawn,
        partial: stats.partial,
        resident: stats.resident,
        bytes: stats.bytes,
        loaded: stats.loaded,
        upload_bytes: stats.loaded * block_bytes,
        dropped: stats.dropped,
        awaited: stats.awaited,
        failed: stats.failed,
        largest_error: stats.largest_error,
        microseconds: stats.microseconds,
    }
}

/// Gives what an update of a cut left of a budget, for an update of a visit in the same frame: each limit less what `used` tells of it,
/// at least 0; KMB_UNLIMITED stays. With a `bytes` of 0 left the city's coarsest block is still drawn. The caller sets
/// rest->struct_size; `rest` may be `budget`.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_budget_rest(
    budget: *const kmb_budget,
    used: *const kmb_stats,
    rest: *mut kmb_budget,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let (budget, used, out) = unsafe {
            (
                input_struct(budget)?,
                input_struct(used)?,
                output_struct(rest)?,
            )
        };
        let less = |limit: u64, used: u64| match limit {
            KMB_UNLIMITED => KMB_UNLIMITED,
            limit => limit.saturating_sub(used),
        };
        out.write(kmb_budget {
            // A number that is none counts as 0.
            microseconds: less(budget.microseconds, used.microseconds.ceil() as u64),
            refinements: less(budget.refinements, used.refined),
            bytes: less(budget.bytes, used.bytes),
            upload_bytes: less(budget.upload_bytes, used.upload_bytes),
            patches: less(budget.patches, used.patches),
            ..budget
        });
        Ok(())
    })
}

/// Gives what to draw, front to back. The array belongs to the visit and lives until its next update or its end.
///
/// May be called with the same visit from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_drawn(
    visit: *const kmb_city_visit,
    drawn: *mut *const kmb_city_drawn,
    count: *mut usize,
) -> kmb_status {
    boundary!(shared visit: kmb_city_visit, {
        // SAFETY: the caller passes pointers as the header asks.
        unsafe { write_list(&visit.drawn, (drawn, "drawn"), count) }
    })
}

/// Gives the nodes whose blocks came with the last update; that of the root came with
/// the first. With
/// kmb_city_visit_removed, a GPU cache is a map from nodes to textures. The array belongs to the
/// visit and lives until its next update or its end.
///
/// May be called with the same visit from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_added(
    visit: *const kmb_city_visit,
    nodes: *mut *const u32,
    count: *mut usize,
) -> kmb_status {
    boundary!(shared visit: kmb_city_visit, {
        // SAFETY: the caller passes pointers as the header asks.
        unsafe { write_list(visit.visit.added(), (nodes, "nodes"), count) }
    })
}

/// Gives the nodes whose blocks went with the last update: those that came in one before. The array
/// belongs to the visit and lives until its next update or its end.
///
/// May be called with the same visit from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_removed(
    visit: *const kmb_city_visit,
    nodes: *mut *const u32,
    count: *mut usize,
) -> kmb_status {
    boundary!(shared visit: kmb_city_visit, {
        // SAFETY: the caller passes pointers as the header asks.
        unsafe { write_list(visit.visit.removed(), (nodes, "nodes"), count) }
    })
}

/// Gives a list that belongs to a visit.
///
/// # Safety
///
/// The pointers are NULL, misaligned, or point to memory for a pointer and for a count, which nothing else uses.
unsafe fn write_list<T>(
    list: &[T],
    (pointer, name): (*mut *const T, &str),
    count: *mut usize,
) -> Outcome {
    // SAFETY: as the caller promises.
    let (out, count) = unsafe { (output(pointer, name)?, output(count, "count")?) };
    out.write(list.as_ptr());
    count.write(list.len());
    Ok(())
}

/// Gives the block of a node that the visit holds: all that are drawn, and others. The caller sets
/// block->struct_size; the image and the low heights belong to the visit and live until its next
/// update or its end.
///
/// May be called with the same visit from several threads at once, not during an update.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_INVALID_STRUCT_SIZE, KMB_NOT_FOUND (it is not held),
/// KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_block(
    visit: *const kmb_city_visit,
    node: u32,
    block: *mut kmb_blockmap,
) -> kmb_status {
    boundary!(shared visit: kmb_city_visit, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output_struct(block) }?;
        let Some(map) = visit.visit.block(node) else {
            let message = format!("the block of node {node} is not held");
            return Err(Failure::new(kmb_status::KMB_NOT_FOUND, message));
        };
        out.write(described(map));
        Ok(())
    })
}

/// Gives the nearest place at which each of `count` rays, in the city's reference system, meets what the visit draws. `rays` has `count`
/// rays, all with their struct_size; `hits` has room for as many, and the caller sets hits[0].struct_size. A ray from outside
/// does not slip between two blocks, of whatever levels; outside the view's frustum it may meet nothing. After an update with a tolerance of 0, without limits, and with a view of
/// the whole city, these are the finest blocks of all of it.
///
/// The first ray that comes to a block makes it ready, which takes as long as some thousand rays, for all that come before the next update; until
/// then it holds 4 more bytes a texel of its heights, which no budget counts. Neighbours in `rays` that go almost the same way, as the pixels of
/// a row do, are cast several times as fast as others.
///
/// May be called with the same visit from several threads at once, not during an update.
///
/// Returns KMB_OK (also where rays meet nothing); KMB_INVALID_ARGUMENT (also for numbers that are not finite but `longest`, no
/// direction, or a `longest` below 0); KMB_INVALID_STRUCT_SIZE; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_visit_cast(
    visit: *const kmb_city_visit,
    count: usize,
    rays: *const kmb_ray,
    hits: *mut kmb_city_hit,
) -> kmb_status {
    boundary!(shared visit: kmb_city_visit, {
        if count == 0 {
            return Ok(());
        }
        // SAFETY: the caller passes pointers as the header asks.
        unsafe { input_struct(rays) }?;
        // SAFETY: as above.
        unsafe { output_struct(hits) }?;
        // SAFETY: as above; any bits are a ray or a hit.
        let (rays, hits) =
            unsafe { (array(rays, count, "rays")?, output_array(hits, count, "hits")?) };
        for (index, ray) in rays.iter().enumerate() {
            check(index, ray)?;
        }
        let city = visit.rays.get_or_init(|| CityRays::of_visit(&visit.visit));
        for (rays, hits) in rays.chunks(RAYS).zip(hits.chunks_mut(RAYS)) {
            let mut ready = [Ray { origin: [0.0; 3], direction: [0.0; 3] }; RAYS];
            for (ready, ray) in ready.iter_mut().zip(rays) {
                *ready = Ray { origin: ray.origin, direction: ray.direction };
            }
            city.cast_each(&ready[..rays.len()], |index, hit| {
                let hit = hit.filter(|hit| hit.hit.distance <= rays[index].longest);
                hits[index] = match hit {
                    Some(hit) => hit_told(hit),
                    None => NO_HIT,
                };
            });
        }
        Ok(())
    })
}

fn check(index: usize, ray: &kmb_ray) -> Outcome {
    if ray.struct_size as usize != size_of::<kmb_ray>() {
        let (size, right) = (ray.struct_size, size_of::<kmb_ray>());
        return Err(Failure::new(
            kmb_status::KMB_INVALID_STRUCT_SIZE,
            format!("struct_size of ray {index} is {size} where {right} is right"),
        ));
    }
    let is_finite = ray
        .origin
        .iter()
        .chain(&ray.direction)
        .all(|number| number.is_finite());
    let is_still = ray.direction == [0.0; 3];
    if !is_finite || is_still || ray.longest.is_nan() || ray.longest < 0.0 {
        let message = format!("ray {index} is none: {ray:?}");
        return Err(Failure::argument(message));
    }
    Ok(())
}

#[inline]
fn hit_told(CityHit { node, hit, surface }: CityHit) -> kmb_city_hit {
    let [red, green, blue] = surface.colour;
    kmb_city_hit {
        struct_size: size_of::<kmb_city_hit>() as u32,
        node,
        distance: hit.distance,
        texel: [u32::from(hit.texel[0]), u32::from(hit.texel[1])],
        height: hit.height,
        is_wall: u32::from(hit.is_wall),
        normal: surface.normal,
        colour: [red, green, blue, surface.occlusion],
    }
}

const NO_HIT: kmb_city_hit = kmb_city_hit {
    struct_size: size_of::<kmb_city_hit>() as u32,
    node: KMB_NO_NODE,
    distance: f64::INFINITY,
    texel: [0; 2],
    height: 0.0,
    is_wall: 0,
    normal: [0.0; 3],
    colour: [0; 4],
};
