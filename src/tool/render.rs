//! Pictures of a city by rays, and of the triangles that it was built from, to compare.

use super::Progress;
use crate::blockmap::{CityHit, CityRays, Ray, Scene, Seen, Visit, local};
use crate::geo::View;
use crate::schedule::{Budget, map_in_order, thread_count};
use crate::{Error, Result};
use glam::{DVec3, Mat4, Vec3, Vec4};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::Instant;

/// Circles of eyes around the city.
const RINGS: usize = 3;
/// Tangent of half the field of view, upright.
const HALF_VIEW: f64 = 0.45;
/// Share of the light that comes from all around.
const AMBIENT: f32 = 0.45;
const SKY: [u8; 3] = [150, 190, 235];
/// Blocks that are held from view to view.
const RESIDENT_BYTES: u64 = 2 << 30;
/// Decibels of pictures that are equal.
const EQUAL: f64 = 99.0;

/// What to look at.
#[derive(Clone, Copy, Debug)]
pub struct Render {
    /// How many views, a third on each ring: far, middle, near.
    pub views: usize,
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Largest error of a block on the screen, in pixels; 0 for the finest blocks.
    pub tolerance: f64,
}

/// The ground's distance along a ray, in lengths of its direction, and its normal.
pub type GroundRay<'a> = &'a (dyn Fn(&Ray) -> Option<(f64, [f32; 3])> + Sync);

/// What a city was built from.
pub struct Original<'a> {
    /// Its triangles.
    pub scene: &'a Scene,
    /// What they stand on.
    pub ground: GroundRay<'a>,
    /// Its colour.
    pub ground_colour: [u8; 3],
}

/// What was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rendered {
    /// Rays of all views.
    pub rays: u64,
    /// Rays a second, on all threads.
    pub rays_per_second: f64,
    /// Rays that met the floor of the city, inside its square, and nothing above it.
    pub holes: u64,
    /// Likeness to the originals, where there are any.
    pub likeness: Option<Likeness>,
}

/// How alike pictures and originals are, over the pixels that show something in either.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Likeness {
    /// Mean over the views of the peak signal-to-noise ratio, in dB.
    pub psnr_mean: f64,
    /// That of the worst view.
    pub psnr_min: f64,
    /// Mean difference of distances along a ray where both show something, in metres.
    pub depth_error_mean: f64,
    /// Mean PSNR and depth error of each ring: far, middle, near; NaN without views.
    pub rings: [[f64; 2]; RINGS],
}

/// An eye and what its pixels see.
struct Camera {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    size: [usize; 2],
}

/// A pixel: distance in lengths of its ray's direction, or infinity, and colour.
type Pixel = (f64, [u8; 3]);

/// Renders views of a city into a folder, `view_000.png` and on, beside each its original, `view_000_original.png`, if there is one.
/// With an original both are shaded by their normals alone; without, ambient occlusion darkens the pictures.
///
/// # Errors
///
/// [`Error::Argument`] for no views or a size that no picture has; [`Error::Io`]; those of reading the city; [`Error::Cancelled`].
pub fn render(
    visit: &mut Visit,
    original: Option<&Original>,
    what: &Render,
    folder: &Path,
    progress: Progress,
) -> Result<Rendered> {
    if what.views == 0 || what.size.iter().any(|side| !(1..=16384).contains(side)) {
        let [width, height] = what.size;
        let message = format!("{} views of {width} x {height} pixels", what.views);
        return Err(Error::Argument(message));
    }
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot create"))?;
    let mut rendered = Rendered::default();
    let mut likeness: Vec<(f64, f64, u64)> = Vec::new();
    let mut seconds = 0.0;
    for number in 0..what.views {
        let camera = Camera::on_ring(visit, number, what);
        let budget = Budget {
            bytes: RESIDENT_BYTES,
            ..Budget::UNLIMITED
        };
        visit.update(&camera.view(what.tolerance), &budget)?;
        let rays = CityRays::of_visit(visit);
        rays.prepare();
        let start = Instant::now();
        let hits = cast(&camera, &rays);
        seconds += start.elapsed().as_secs_f64();
        rendered.rays += hits.len() as u64;
        rendered.holes += holes(&camera, visit, &hits);
        let shades = original.is_none();
        let picture: Vec<Pixel> = hits
            .iter()
            .enumerate()
            .map(|(index, hit)| shown(&camera.ray(index), hit.as_ref(), shades))
            .collect();
        write(
            &folder.join(format!("view_{number:03}.png")),
            what.size,
            &picture,
        )?;
        if let Some(original) = original {
            let other = see(&camera, original, visit);
            write(
                &folder.join(format!("view_{number:03}_original.png")),
                what.size,
                &other,
            )?;
            likeness.push(compare(&camera, &picture, &other));
        }
        if !progress(number as u64 + 1, what.views as u64) {
            return Err(Error::Cancelled);
        }
    }
    rendered.rays_per_second = rendered.rays as f64 / seconds.max(1e-9);
    rendered.likeness = (!likeness.is_empty()).then(|| mean(&likeness));
    Ok(rendered)
}

/// Of views in the order of their rings: PSNR, sum of differences of distances, and how many.
fn mean(views: &[(f64, f64, u64)]) -> Likeness {
    let figures = |views: &[(f64, f64, u64)]| {
        let depths: u64 = views.iter().map(|view| view.2).sum();
        let psnr = views.iter().map(|view| view.0).sum::<f64>() / views.len() as f64;
        [
            psnr,
            views.iter().map(|view| view.1).sum::<f64>() / depths.max(1) as f64,
        ]
    };
    let [psnr_mean, depth_error_mean] = figures(views);
    let mut rings = [[f64::NAN; 2]; RINGS];
    let each = views.len().div_ceil(RINGS);
    for (ring, views) in rings.iter_mut().zip(views.chunks(each)) {
        *ring = figures(views);
    }
    Likeness {
        psnr_mean,
        psnr_min: views
            .iter()
            .map(|view| view.0)
            .fold(f64::INFINITY, f64::min),
        depth_error_mean,
        rings,
    }
}

impl Camera {
    /// The eye of a view: a third of all on each of three rings around the city's middle, above all that is in it.
    fn on_ring(visit: &Visit, number: usize, what: &Render) -> Camera {
        let tree = visit.city().tree();
        let [low, high] = tree.nodes[0].heights.map(f64::from);
        let middle = DVec3::new(
            tree.corner[0] + 0.5 * tree.side,
            tree.corner[1] + 0.5 * tree.side,
            low,
        );
        // Radius, height and the distance of what is looked at from the middle, in sides of the city.
        let rings: [[f64; 3]; RINGS] = [[1.1, 0.6, 0.0], [0.55, 0.25, 0.05], [0.2, 0.06, 0.15]];
        let each = what.views.div_ceil(RINGS);
        let [radius, rise, beyond] = rings[number / each];
        let turn = (number % each) as f64 / each as f64 + 0.03;
        let around = DVec3::new(
            (std::f64::consts::TAU * turn).cos(),
            (std::f64::consts::TAU * turn).sin(),
            0.0,
        );
        let eye = middle
            + around * (radius * tree.side)
            + DVec3::Z * (rise * tree.side + 0.5 * (high - low));
        let target = middle - around * (beyond * tree.side);
        let forward = (target - eye).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let aspect = what.size[0] as f64 / what.size[1] as f64;
        Camera {
            eye,
            right: right * (HALF_VIEW * aspect),
            up: right.cross(forward) * HALF_VIEW,
            forward,
            size: what.size,
        }
    }

    /// Through the middle of a pixel, the lowest row first; as long as the picture is far.
    fn ray(&self, index: usize) -> Ray {
        let at = [index % self.size[0], index / self.size[0]];
        let [x, y] =
            [0, 1].map(|axis| (at[axis] as f64 + 0.5) / self.size[axis] as f64 * 2.0 - 1.0);
        Ray {
            origin: self.eye.to_array(),
            direction: (self.forward + self.right * x + self.up * y).to_array(),
        }
    }

    /// World to clip coordinates, row by row, relative to the eye.
    fn rows(&self) -> [DVec3; 3] {
        let across = self.right / self.right.length_squared();
        let along = self.up / self.up.length_squared();
        [across, along, self.forward]
    }

    fn view(&self, tolerance: f64) -> View {
        let [x, y, w] = self.rows();
        let mut matrix = [0.0; 16];
        for (row, axis) in [(0, x), (1, y), (2, w), (3, w)] {
            let numbers = [axis.x, axis.y, axis.z, -axis.dot(self.eye)];
            for (column, number) in numbers.into_iter().enumerate() {
                matrix[4 * column + row] = number;
            }
        }
        View {
            eye: self.eye.to_array(),
            world_to_clip: matrix,
            viewport: self.size.map(|side| side as f64),
            tolerance,
        }
    }
}

fn cast(camera: &Camera, rays: &CityRays) -> Vec<Option<CityHit>> {
    let [width, height] = camera.size;
    let row = |row: usize| -> Vec<Option<CityHit>> {
        let pixels = row * width..(row + 1) * width;
        let pixels: Vec<Ray> = pixels.map(|index| camera.ray(index)).collect();
        let mut hits = Vec::with_capacity(width);
        rays.cast_each(&pixels, |_, hit| hits.push(hit));
        hits
    };
    let mut hits = Vec::with_capacity(width * height);
    let collect =
        |_, row: Vec<Option<CityHit>>| -> std::result::Result<(), std::convert::Infallible> {
            hits.extend(row);
            Ok(())
        };
    match map_in_order(thread_count(0), height, row, collect) {
        Ok(()) => hits,
        Err(never) => match never {},
    }
}

/// Rays that fall through the floor of the city.
fn holes(camera: &Camera, visit: &Visit, hits: &[Option<CityHit>]) -> u64 {
    let tree = visit.city().tree();
    let falls = |index: &usize| {
        let ray = camera.ray(*index);
        let [x, y, z] = ray.origin;
        let distance = (tree.floor - z) / ray.direction[2];
        let at = [
            x + distance * ray.direction[0],
            y + distance * ray.direction[1],
        ];
        let inside = |axis: usize| {
            let along = at[axis] - tree.corner[axis];
            along > 0.0 && along < tree.side
        };
        distance > 0.0 && inside(0) && inside(1)
    };
    let missed = (0..hits.len()).filter(|&index| hits[index].is_none());
    missed.filter(falls).count() as u64
}

fn shown(ray: &Ray, hit: Option<&CityHit>, shades: bool) -> Pixel {
    let Some(CityHit { hit, surface, .. }) = hit else {
        return (f64::INFINITY, SKY);
    };
    let occlusion = if shades {
        f32::from(surface.occlusion) / 255.0
    } else {
        1.0
    };
    let colour = lit(surface.colour, Vec3::from(surface.normal), ray, occlusion);
    (hit.distance, colour)
}

fn lit(colour: [u8; 3], normal: Vec3, ray: &Ray, occlusion: f32) -> [u8; 3] {
    let light = Vec3::new(0.45, -0.35, 0.82);
    let direction = Vec3::from(ray.direction.map(|along| along as f32));
    let facing = if normal.dot(direction) > 0.0 {
        -normal
    } else {
        normal
    };
    let share = AMBIENT * occlusion + (1.0 - AMBIENT) * facing.dot(light).max(0.0);
    colour.map(|band| (f32::from(band) * share).round().min(255.0) as u8)
}

/// The picture of the original.
fn see(camera: &Camera, original: &Original, visit: &Visit) -> Vec<Pixel> {
    let mut seen = Seen::new(camera.size, true);
    let [x, y, w] = camera.rows().map(|row| row.as_vec3().extend(0.0));
    let to_clip = Mat4::from_cols(x, y, Vec4::ZERO, w).transpose();
    let all: Vec<u32> = (0..original.scene.triangles.len() as u32).collect();
    let triangles = local(original.scene, &all, camera.eye.to_array());
    for triangle in &triangles {
        seen.draw(&to_clip, &triangle.corners, triangle.number);
    }
    let tree = visit.city().tree();
    let is_inside = |ray: &Ray, distance: f64| {
        (0..2).all(|axis| {
            let at = ray.origin[axis] + distance * ray.direction[axis] - tree.corner[axis];
            (0.0..=tree.side).contains(&at)
        })
    };
    let pixel = |index: usize| {
        let ray = camera.ray(index);
        let number = seen.triangle(index % camera.size[0], index / camera.size[0]);
        let ground = (original.ground)(&ray).filter(|(distance, _)| is_inside(&ray, *distance));
        let ground = ground.map(|(distance, normal)| {
            let normal = Vec3::from(normal);
            (distance, lit(original.ground_colour, normal, &ray, 1.0))
        });
        let building = triangles.get(number as usize).and_then(|triangle| {
            let direction = Vec3::from(ray.direction.map(|along| along as f32));
            let (distance, weights) = triangle.meet(Vec3::ZERO, direction)?;
            let paint = &original.scene.triangles[number as usize].paint;
            let colour = original.scene.colour(paint, weights);
            let colour = colour.map(|band| band.round() as u8);
            Some((f64::from(distance), lit(colour, triangle.normal, &ray, 1.0)))
        });
        let nearer = |one: Pixel, other: Pixel| if one.0 <= other.0 { one } else { other };
        let nothing = (f64::INFINITY, SKY);
        nearer(building.unwrap_or(nothing), ground.unwrap_or(nothing))
    };
    (0..camera.size[0] * camera.size[1]).map(pixel).collect()
}

/// PSNR, the sum of differences of distances, and how many.
fn compare(camera: &Camera, one: &[Pixel], other: &[Pixel]) -> (f64, f64, u64) {
    let (mut squares, mut pixels, mut depth, mut depths) = (0.0, 0u64, 0.0, 0);
    for (index, ((near, colour), (far, original))) in one.iter().zip(other).enumerate() {
        if near.is_infinite() && far.is_infinite() {
            continue;
        }
        pixels += 1;
        let band = |band: usize| f64::from(colour[band].abs_diff(original[band])).powi(2);
        squares += (0..3).map(band).sum::<f64>();
        if near.is_finite() && far.is_finite() {
            let length = DVec3::from(camera.ray(index).direction).length();
            depth += (near - far).abs() * length;
            depths += 1;
        }
    }
    let mean = squares / (3 * pixels.max(1)) as f64;
    let psnr = if mean == 0.0 {
        EQUAL
    } else {
        (10.0 * (255.0 * 255.0 / mean).log10()).min(EQUAL)
    };
    (psnr, depth, depths)
}

fn write(path: &Path, size: [usize; 2], pixels: &[Pixel]) -> Result<()> {
    let file = File::create(path).map_err(Error::io(path, "cannot create"))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), size[0] as u32, size[1] as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let rows = pixels.chunks_exact(size[0]).rev();
    let bytes: Vec<u8> = rows.flatten().flat_map(|(_, colour)| *colour).collect();
    let mut writer = encoder
        .write_header()
        .map_err(|error| cannot_write(path, error))?;
    writer
        .write_image_data(&bytes)
        .map_err(|error| cannot_write(path, error))?;
    writer.finish().map_err(|error| cannot_write(path, error))
}

fn cannot_write(path: &Path, error: png::EncodingError) -> Error {
    Error::io(path, "cannot write")(std::io::Error::other(error))
}
