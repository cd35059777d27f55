//! Building cities from triangles and files.

use std::ffi::{c_char, c_void};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use super::boundary::{
    Failure, Handle, Outcome, SizedStruct, array, boundary, input_struct, output, output_struct,
    path, text,
};
use super::builder::kmb_progress_callback;
use super::status::kmb_status;
use crate::Error;
use crate::blockmap::source::{SourceOptions, read};
use crate::blockmap::{
    BARE_GROUND, BakeOptions, CityOptions, CityReport, FAR, Ground, Paint, Scene, Texture,
    Triangle, build_city,
};
use crate::log::{LogLevel, log};

/// Gives the height z of the ground at x, y, in the city's reference system, and answers 0; or answers anything else where there is
/// none, so that the plane's is taken. Calls come one after the other, from any thread. Nothing may unwind out of it.
pub type kmb_ground_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, x: f64, y: f64, height: *mut f64) -> i32>;

/// What is painted on triangles.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_paint_kind {
    /// One colour.
    KMB_PAINT_PLAIN = 0,
    /// A texture of the builder, which repeats. Its coordinates are 0, 0 at the image's lower left corner and 1, 1 at
    /// its upper right one.
    KMB_PAINT_TEXTURE = 1,
    /// A facade that is made up. Its coordinates count windows along the wall, and storeys above the ground.
    KMB_PAINT_FACADE = 2,
}

/// How to build a city. What is 0 stands for what no options stand for.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_options {
    /// sizeof(kmb_city_options).
    pub struct_size: u32,
    /// Texels along a block: 32, 64 or 128; 0 for 128.
    pub side_texels: u32,
    /// Views of a block from which its walls are taken, 1 to 4096; 0 for 64.
    pub views: u32,
    /// Bits of heights: 8 or 16; 0 for 8.
    pub height_bits: u32,
    /// Edge of the finest blocks, at most, 1 to 4096 metres; 0 for 64.
    pub leaf_side: f64,
    /// Steps higher than this, in metres, are walls; 0 for 1.5.
    pub exposure: f64,
    /// Threads to use, or 0 for one a core. The file does not depend on it.
    pub threads: u32,
    /// Memory that triangles and textures may take, in MiB; 0 for no limit.
    pub memory: u32,
    /// 1 where buildings of files without textures and colours get facades that are made up; else 0: they are plain.
    pub has_facades: u32,
    /// The seed of these facades.
    pub facades: u32,
    /// Red, green, blue of bare ground; 0, 0, 0 for a grey. The fourth is 0.
    pub ground_colour: [u8; 4],
    /// 0.
    pub reserved: u32,
}

/// Paint for triangles.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_paint {
    /// sizeof(kmb_city_paint).
    pub struct_size: u32,
    /// A kmb_paint_kind.
    pub kind: u32,
    /// For KMB_PAINT_PLAIN: red, green, blue. The fourth is 0.
    pub colour: [u8; 4],
    /// For KMB_PAINT_TEXTURE: what kmb_city_builder_add_texture gave.
    pub texture: u32,
    /// For KMB_PAINT_FACADE: tells the facade of one building from that of another.
    pub seed: u32,
    /// 0.
    pub reserved: u32,
    /// But for KMB_PAINT_PLAIN: 6 floats for each triangle, two for each corner.
    pub coordinates: *const f32,
}

/// What was built.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kmb_city_report {
    /// sizeof(kmb_city_report).
    pub struct_size: u32,
    /// Levels of blocks.
    pub levels: u32,
    /// Blocks.
    pub blocks: u64,
    /// Those made from triangles; the others are made from four finer ones.
    pub leaves: u64,
    /// Triangles that it was built from.
    pub triangles: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Texels of walls in the leaves.
    pub wall_texels: u64,
    /// Of these, those that share another's wall column, as there are no more.
    pub unassigned_wall_texels: u64,
    /// Pixels of all views that see the leaves' triangles.
    pub seen_pixels: u64,
    /// Of these, those whose surface lies more than 2.5 texels behind the prisms: under bridges and overhangs.
    pub hidden_pixels: u64,
}

// SAFETY: repr(C) with struct_size first, and integers and floats only.
unsafe impl SizedStruct for kmb_city_options {
    const NAME: &'static str = "kmb_city_options";
}
// SAFETY: repr(C) with struct_size first, and integers and a raw pointer only.
unsafe impl SizedStruct for kmb_city_paint {
    const NAME: &'static str = "kmb_city_paint";
}
// SAFETY: repr(C) with struct_size first, and integers only.
unsafe impl SizedStruct for kmb_city_report {
    const NAME: &'static str = "kmb_city_report";
}

/// A city in the making: triangles, textures, the ground, and how to build it.
pub struct kmb_city_builder {
    broken: AtomicBool,
    scene: Scene,
    options: CityOptions,
    sources: SourceOptions,
    ground_colour: [u8; 3],
    plane: Option<f64>,
    relief: Option<Relief>,
}

/// A ground that a callback tells.
struct Relief {
    callback: unsafe extern "C" fn(*mut c_void, f64, f64, *mut f64) -> i32,
    user: Mutex<User>,
    spacing: f64,
}

struct User(*mut c_void);
// SAFETY: the header lets the callback, and so its `user`, be used from any thread, one call at a time.
unsafe impl Send for User {}

impl Relief {
    fn height(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let user = self.user.lock().unwrap_or_else(PoisonError::into_inner);
        let mut height = f64::NAN;
        // SAFETY: the caller gave a function that may be called so, with this `user`, one call at a time.
        let answer = unsafe { (self.callback)(user.0, x, y, &raw mut height) };
        (answer == 0 && height.abs() < FAR).then_some(height)
    }
}

impl Handle for kmb_city_builder {
    const NAME: &'static str = "city builder";

    fn broken(&self) -> &AtomicBool {
        &self.broken
    }
}

/// Makes a builder of a city and gives a handle, which kmb_city_builder_destroy frees. `options` may be NULL. It begins without
/// triangles, and on a plane through the lowest of their corners.
///
/// May be called from any thread at any time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for options out of range), KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_create(
    options: *const kmb_city_options,
    builder: *mut *mut kmb_city_builder,
) -> kmb_status {
    boundary!({
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output(builder, "builder") }?;
        let mut made = kmb_city_builder {
            broken: AtomicBool::new(false),
            scene: Scene::default(),
            options: CityOptions::default(),
            sources: SourceOptions {
                facades: None,
                ..SourceOptions::default()
            },
            ground_colour: BARE_GROUND,
            plane: None,
            relief: None,
        };
        if !options.is_null() {
            // SAFETY: as above.
            made.choose(&unsafe { input_struct(options) }?)?;
        }
        out.write(Box::into_raw(Box::new(made)));
        Ok(())
    })
}

impl kmb_city_builder {
    fn choose(&mut self, options: &kmb_city_options) -> Outcome {
        let or = |number: u32, otherwise: usize| match number {
            0 => otherwise,
            number => number as usize,
        };
        let usual = BakeOptions::of(match options.side_texels {
            0 => 128,
            texels => texels as usize,
        });
        let has_16_bits = match options.height_bits {
            0 | 8 => false,
            16 => true,
            bits => {
                return Err(Failure::argument(format!(
                    "heights of {bits} bits: 8 or 16 are possible"
                )));
            }
        };
        let exposure = if options.exposure == 0.0 {
            usual.exposure
        } else {
            options.exposure as f32
        };
        self.options = CityOptions {
            bake: BakeOptions {
                views: or(options.views, usual.views),
                has_16_bits,
                exposure,
                ..usual
            },
            leaf_side: options.leaf_side,
            memory: (options.memory != 0).then_some(u64::from(options.memory) << 20),
            threads: options.threads as usize,
        };
        self.options.check()?;
        if options.has_facades > 1 {
            return Err(Failure::argument(format!(
                "has_facades is {}, not 0 or 1",
                options.has_facades
            )));
        }
        let most = usize::try_from(self.options.most_triangles()).unwrap_or(usize::MAX);
        self.sources.max_triangles = self.sources.max_triangles.min(most);
        self.sources.facades = (options.has_facades == 1).then_some(options.facades);
        let [red, green, blue, _] = options.ground_colour;
        if [red, green, blue] != [0; 3] {
            self.ground_colour = [red, green, blue];
        }
        Ok(())
    }

    /// Refuses more than fits into the memory.
    fn check_memory(&self, triangles: usize, texture_bytes: usize) -> Outcome {
        let textures: usize = self.scene.textures.iter().map(Texture::bytes).sum();
        let triangles = self.scene.triangles.len().saturating_add(triangles);
        let bytes = textures.saturating_add(texture_bytes);
        Ok(self.options.check_memory(triangles as u64, bytes as u64)?)
    }
}

/// Frees a builder of a city. NULL is allowed. No other call may use the handle at the same time, or
/// afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_destroy(builder: *mut kmb_city_builder) {
    let _ = boundary!({
        if !builder.is_null() {
            // SAFETY: the caller gives back what kmb_city_builder_create gave, once.
            drop(unsafe { Box::from_raw(builder) });
        }
        Ok(())
    });
}

/// Adds an image of width x height pixels, 3 bytes each (red, green, blue), row by row without padding, the uppermost first, and
/// gives its number. The bytes are copied.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for an image without pixels, or one beyond the memory), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_add_texture(
    builder: *mut kmb_city_builder,
    width: u32,
    height: u32,
    rgb: *const u8,
    texture: *mut u32,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        let out = unsafe { output(texture, "texture") }?;
        let impossible = || Failure::argument(format!("an image of {width} x {height} pixels"));
        let length = (width as usize).checked_mul(height as usize).and_then(|count| count.checked_mul(3));
        let length = length.filter(|length| *length > 0).ok_or_else(impossible)?;
        builder.check_memory(0, length)?;
        // SAFETY: as above.
        let pixels = unsafe { array(rgb, length, "rgb") }?;
        let number = u32::try_from(builder.scene.textures.len()).map_err(|_| impossible())?;
        let made = Texture::new(width, height, pixels.to_vec()).ok_or_else(impossible)?;
        builder.scene.textures.push(made);
        out.write(number);
        Ok(())
    })
}

/// Adds `count` triangles, 9 doubles each: x, y, z of three corners, in metres, x east, y north, z up. `paint` may be NULL: a light
/// grey. They may be open, overlap, repeat and have no area; both their sides are seen. All is copied.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for coordinates that are not finite or immensely large, an unknown texture, and more
/// triangles than the memory holds; none is added then), KMB_INVALID_STRUCT_SIZE, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_add_triangles(
    builder: *mut kmb_city_builder,
    count: usize,
    corners: *const f64,
    paint: *const kmb_city_paint,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        let brush = match paint.is_null() {
            true => Brush::Plain([200; 3]),
            // SAFETY: the caller passes pointers as the header asks.
            false => unsafe { brush(&input_struct(paint)?, builder.scene.textures.len(), count) }?,
        };
        builder.check_memory(count, 0)?;
        // SAFETY: as above; three corners are aligned as a double.
        let corners = unsafe { array(corners.cast::<[[f64; 3]; 3]>(), count, "corners") }?;
        let is_near = |at: &f64| at.abs() < FAR;
        if let Some(bad) = corners.iter().position(|three| !three.iter().flatten().all(is_near)) {
            let message = format!("triangle {bad} has impossible corners {:?}", corners[bad]);
            return Err(Failure::argument(message));
        }
        let triangles = corners.iter().enumerate().map(|(index, corners)| Triangle {
            corners: *corners,
            paint: brush.of(index),
        });
        builder.scene.triangles.extend(triangles);
        Ok(())
    })
}

/// Paint for a list of triangles.
enum Brush<'a> {
    Plain([u8; 3]),
    Texture(u32, &'a [[[f32; 2]; 3]]),
    Facade(u32, &'a [[[f32; 2]; 3]]),
}

impl Brush<'_> {
    fn of(&self, triangle: usize) -> Paint {
        match *self {
            Brush::Plain(colour) => Paint::Plain(colour),
            Brush::Texture(index, places) => Paint::Texture {
                index,
                at: places[triangle],
            },
            Brush::Facade(seed, places) => Paint::Facade {
                seed,
                at: places[triangle],
            },
        }
    }
}

/// # Safety
///
/// The coordinates are NULL, misaligned, or 6 * `count` floats that live and do not change during `'a`.
unsafe fn brush<'a>(
    paint: &kmb_city_paint,
    textures: usize,
    count: usize,
) -> Result<Brush<'a>, Failure> {
    let [red, green, blue, _] = paint.colour;
    if paint.kind == kmb_paint_kind::KMB_PAINT_PLAIN as u32 {
        return Ok(Brush::Plain([red, green, blue]));
    }
    // SAFETY: as the caller promises; three pairs are aligned as a float.
    let places = unsafe {
        array(
            paint.coordinates.cast::<[[f32; 2]; 3]>(),
            count,
            "coordinates",
        )
    }?;
    if let Some(bad) = places
        .iter()
        .position(|three| !three.iter().flatten().all(|at| at.is_finite()))
    {
        let message = format!(
            "triangle {bad} has impossible coordinates {:?}",
            places[bad]
        );
        return Err(Failure::argument(message));
    }
    match paint.kind {
        kind if kind == kmb_paint_kind::KMB_PAINT_FACADE as u32 => {
            Ok(Brush::Facade(paint.seed, places))
        }
        kind if kind == kmb_paint_kind::KMB_PAINT_TEXTURE as u32 => {
            if paint.texture as usize >= textures {
                let message = format!("there is no texture {}, only {textures}", paint.texture);
                return Err(Failure::argument(message));
            }
            Ok(Brush::Texture(paint.texture, places))
        }
        kind => Err(Failure::argument(format!(
            "paint of kind {kind} is unknown"
        ))),
    }
}

/// Adds the triangles of a file, with their textures: CityJSON (.json, .jsonl), OBJ (.obj) or glTF (.gltf, .glb), as its extension
/// says; and its reference system, if the builder has none. What can be left out, such as an image that is not there, is: the log
/// callback is told, and kmb_city_builder_warnings counts it.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a file of more triangles than the memory holds); KMB_IO; KMB_INPUT (the file is not
/// what its extension says, has no triangle, or another reference system than the builder); KMB_PANIC. Nothing is added then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_add_file(
    builder: *mut kmb_city_builder,
    path: *const c_char,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        let path = unsafe { self::path(path) }?;
        let read = read(std::slice::from_ref(&path), &builder.sources)?;
        let own = &builder.scene.crs;
        if !own.is_empty() && !read.crs.is_empty() && *own != read.crs {
            let message = format!("its reference system is {}, not {own}", read.crs);
            return Err(Error::input(&path, message).into());
        }
        builder.check_memory(read.triangles.len(), read.textures.iter().map(Texture::bytes).sum())?;
        for warning in &read.warnings {
            log(LogLevel::Warning, warning);
        }
        builder.scene.append(read);
        Ok(())
    })
}

/// Tells how many warnings the files that were added gave.
///
/// May be called with the same builder from several threads at once.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_warnings(
    builder: *const kmb_city_builder,
    count: *mut u64,
) -> kmb_status {
    boundary!(shared builder: kmb_city_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        unsafe { output(count, "count") }?.write(builder.scene.warnings.len() as u64);
        Ok(())
    })
}

/// Names the coordinate reference system, which is metric: WKT, "EPSG:n", or empty for none. The string is copied.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_set_crs(
    builder: *mut kmb_city_builder,
    crs: *const c_char,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        builder.scene.crs = unsafe { text(crs, "crs") }?.to_owned();
        Ok(())
    })
}

/// Puts the city on a plane of this height; squares without triangles then stay coarse. Where there is a callback too, the plane is where
/// it gives no height.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for a height that is not finite or immense), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_set_plane(
    builder: *mut kmb_city_builder,
    height: f64,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        if height.is_nan() || height.abs() >= FAR {
            return Err(Failure::argument(format!("a ground at {height}")));
        }
        builder.plane = Some(height);
        Ok(())
    })
}

/// Puts the city on a ground that `ground` tells with `user`, for as long as the builder builds; NULL takes it away. `spacing` is about the
/// distance, in metres, from one of its samples to the next; in between it is interpolated.
///
/// Exclusive: no other call may use the builder at the same time.
///
/// Returns KMB_OK, KMB_INVALID_ARGUMENT (also for a spacing that is not finite or not above 0), KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_set_ground(
    builder: *mut kmb_city_builder,
    ground: kmb_ground_callback,
    user: *mut c_void,
    spacing: f64,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        if ground.is_some() && !(spacing > 0.0 && spacing.is_finite()) {
            return Err(Failure::argument(format!("a ground with samples {spacing} m apart")));
        }
        builder.relief = ground.map(|callback| Relief {
            callback,
            user: Mutex::new(User(user)),
            spacing,
        });
        Ok(())
    })
}

/// Builds the city at `path`, and reports what it made. `progress` may be NULL; so may `report`, otherwise the caller sets
/// report->struct_size. The file appears under its name only when it is whole, in place of what was there; after any failure
/// nothing is left of it. The builder may be used again.
///
/// Exclusive: no other call may use the builder at the same time, the callbacks included.
///
/// Returns KMB_OK; KMB_INVALID_ARGUMENT (also for a builder without triangles, and a city of too many blocks);
/// KMB_INVALID_STRUCT_SIZE; KMB_IO; KMB_CANCELLED; KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_city_builder_build(
    builder: *mut kmb_city_builder,
    path: *const c_char,
    progress: kmb_progress_callback,
    progress_user: *mut c_void,
    report: *mut kmb_city_report,
) -> kmb_status {
    boundary!(exclusive builder: kmb_city_builder, {
        // SAFETY: the caller passes pointers as the header asks.
        let path = unsafe { self::path(path) }?;
        let out = match report.is_null() {
            true => None,
            // SAFETY: as above.
            false => Some(unsafe { output_struct(report) }?),
        };
        let mut go_on = |done: u64, total: u64| {
            // SAFETY: the caller gave a function that may be called so, with this `user`.
            progress.is_none_or(|progress| unsafe { progress(progress_user, done, total) } == 0)
        };
        let lowest = || builder.scene.bounds().map_or(0.0, |[low, _]| low[2]);
        let plane = builder.plane.unwrap_or_else(lowest);
        let relief = builder.relief.as_ref();
        let height = |place| relief.and_then(|relief| relief.height(place)).unwrap_or(plane);
        let ground = Ground {
            height: &height,
            spacing: relief.map_or(f64::INFINITY, |relief| relief.spacing),
            colour: builder.ground_colour,
        };
        let made = build_city(&builder.scene, &ground, &builder.options, &path, &mut go_on)?;
        if let Some(out) = out {
            out.write(told(&made, builder.scene.triangles.len()));
        }
        Ok(())
    })
}

fn told(made: &CityReport, triangles: usize) -> kmb_city_report {
    kmb_city_report {
        struct_size: size_of::<kmb_city_report>() as u32,
        levels: made.levels,
        blocks: made.blocks,
        leaves: made.leaves,
        triangles: triangles as u64,
        bytes: made.bytes,
        wall_texels: made.baked.wall_texels,
        unassigned_wall_texels: made.baked.unassigned_wall_texels,
        seen_pixels: made.baked.seen_pixels,
        hidden_pixels: made.baked.hidden_pixels,
    }
}
