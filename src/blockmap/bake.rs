//! A BlockMap out of triangles (thesis, ch. 4.3.2; cityscapes paper, 5): heights and roofs from above, walls from all around.

use super::beams::Ray;
use super::cast::Caster;
use super::columns::{self, Exposed};
use super::layout::{BlockMap, direction_byte};
use super::orthographic::{Orthographic, hemisphere};
use super::raster::{NOTHING, Seen};
use super::scene::Scene;
use super::surroundings::{Grid, Local, local};
use super::walls::Walls;
use crate::Result;
use glam::{DVec3, Mat4, Vec3};

/// Samples of a texel along one side, from above. An odd number has one in its middle.
const SAMPLES: usize = 3;
/// A surface less upright than this is a roof: the z of its unit normal.
const ROOF_NORMAL: f32 = 0.7;
/// Texels by which prisms may be off what they stand for.
const TOLERANCE: f32 = 2.5;

/// How blocks are baked.
#[derive(Clone, Copy, Debug)]
pub struct BakeOptions {
    /// Texels along a block: 32, 64 or 128.
    pub side_texels: usize,
    /// Views of a block, evenly over the upper hemisphere.
    pub views: usize,
    /// Pixels along a view.
    pub view_pixels: usize,
    /// Whether heights have 16 bits, not 8.
    pub has_16_bits: bool,
    /// Steps higher than this, in metres, are walls.
    pub exposure: f32,
}

impl BakeOptions {
    /// As it is done by default with so many texels along a block: 64 views with two pixels a texel, heights of 8 bits.
    pub fn of(side_texels: usize) -> BakeOptions {
        BakeOptions {
            side_texels,
            views: 64,
            view_pixels: 2 * side_texels,
            has_16_bits: false,
            exposure: 1.5,
        }
    }
}

impl Default for BakeOptions {
    fn default() -> BakeOptions {
        BakeOptions::of(128)
    }
}

/// The colour of bare ground.
pub const BARE_GROUND: [u8; 3] = [126, 128, 112];

/// What the city stands on.
pub struct Ground<'a> {
    /// Its height at a place, in metres.
    pub height: &'a (dyn Fn([f64; 2]) -> f64 + Sync),
    /// Metres from one of its samples to the next; infinite for a plane. Between places so far apart it is interpolated.
    pub spacing: f64,
    /// Its colour.
    pub colour: [u8; 3],
}

/// What could not be kept in a block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BakeReport {
    /// Texels of walls.
    pub wall_texels: u64,
    /// Of these, those without a column of their own: they share another's.
    pub unassigned_wall_texels: u64,
    /// Pixels of all views that see the block's triangles.
    pub seen_pixels: u64,
    /// Of these, those whose surface lies more than 2.5 texels behind the prisms: under bridges and overhangs.
    pub hidden_pixels: u64,
}

impl BakeReport {
    /// Adds another block's.
    pub fn add(&mut self, other: &BakeReport) {
        self.wall_texels += other.wall_texels;
        self.unassigned_wall_texels += other.unassigned_wall_texels;
        self.seen_pixels += other.seen_pixels;
        self.hidden_pixels += other.hidden_pixels;
    }
}

/// One block in the making. Places are relative to `middle`.
struct Bake<'a> {
    scene: &'a Scene,
    options: &'a BakeOptions,
    ground: &'a Ground<'a>,
    middle: [f64; 3],
    triangles: Vec<Local>,
    map: BlockMap,
    /// With one texel more on each side.
    outer_heights: Vec<f32>,
}

/// Bakes the square block at `corner` with edges of `side` metres. Triangles within a side's length around it shade it.
///
/// # Errors
///
/// Those of [`BlockMap::new`].
pub fn bake(
    scene: &Scene,
    grid: &Grid,
    ground: &Ground,
    (corner, side): ([f64; 2], f64),
    options: &BakeOptions,
) -> Result<(BlockMap, BakeReport)> {
    let [low, high] = [corner.map(|at| at - side), corner.map(|at| at + 2.0 * side)];
    let numbers = grid.touching(scene, low, high);
    let [x, y] = corner.map(|at| at + 0.5 * side);
    let middle = [x, y, (ground.height)([x, y]).floor()];
    let mut map = BlockMap::new(options.side_texels, corner, side)?;
    map.exposure = options.exposure;
    map.roof_slope = options.exposure / map.texel() as f32;
    let mut bake = Bake {
        scene,
        options,
        ground,
        middle,
        triangles: local(scene, &numbers, middle),
        map,
        outer_heights: Vec::new(),
    };
    bake.paint_from_above();
    let mut exposed = columns::exposed(&bake.map, &bake.outer_heights);
    let mut report = BakeReport {
        wall_texels: exposed.len() as u64,
        unassigned_wall_texels: columns::assign(&mut bake.map, &mut exposed) as u64,
        ..BakeReport::default()
    };
    bake.paint_from_around(&exposed, &mut report);
    Ok((bake.map, report))
}

impl Bake<'_> {
    fn half(&self) -> f32 {
        0.5 * self.map.side as f32
    }

    fn texel(&self) -> f32 {
        self.map.texel() as f32
    }

    /// Heights of the ground at the middles of all texels and one more on each side, relative to the block's middle.
    fn ground(&self) -> Vec<f32> {
        let outer = self.map.side_texels + 2;
        let reach = f64::from(self.half() + self.texel());
        let count = (2.0 * reach / self.ground.spacing)
            .ceil()
            .clamp(1.0, outer as f64) as usize;
        let posts: Vec<f32> = (0..=count)
            .flat_map(|row| (0..=count).map(move |column| [column, row]))
            .map(|post| {
                let along = post.map(|at| 2.0 * reach * at as f64 / count as f64 - reach);
                let place = [self.middle[0] + along[0], self.middle[1] + along[1]];
                ((self.ground.height)(place) - self.middle[2]) as f32
            })
            .collect();
        let place = |texel: usize| {
            let along = (texel as f32 + 0.5) / outer as f32 * count as f32;
            let low = (along as usize).min(count - 1);
            (low, along - low as f32)
        };
        let height = |index: usize| {
            let ((column, x), (row, y)) = (place(index % outer), place(index / outer));
            let mix = |row: usize| {
                let first = row * (count + 1) + column;
                posts[first] + x * (posts[first + 1] - posts[first])
            };
            let (south, north) = (mix(row), mix(row + 1));
            south + y * (north - south)
        };
        (0..outer * outer).map(height).collect()
    }

    /// Heights, roof normals and roof colours. A height is that of the texel's middle; colours are those of all samples that
    /// belong to the same roof.
    fn paint_from_above(&mut self) {
        let side = self.map.side_texels;
        let outer = side + 2;
        let reach = self.half() + self.texel();
        let size = outer * SAMPLES;
        let mut seen = Seen::new([size, size], false);
        let above = Mat4::from_scale(Vec3::new(1.0 / reach, 1.0 / reach, -1.0));
        for (number, triangle) in self.triangles.iter().enumerate() {
            seen.draw(&above, &triangle.corners, number as u32);
        }
        let ground = self.ground();
        let middle = |along: usize| along * SAMPLES + SAMPLES / 2;
        let base = self.middle[2] as f32;
        self.outer_heights = (0..outer * outer)
            .map(|index| {
                let top = seen.nearness(middle(index % outer), middle(index / outer));
                base + top.max(ground[index])
            })
            .collect();
        let heights: Vec<f32> = (0..side * side)
            .map(|index| self.outer_heights[(index / side + 1) * outer + index % side + 1])
            .collect();
        self.map.set_heights(&heights, self.options.has_16_bits);
        for row in 0..side {
            for column in 0..side {
                let index = (row + 1) * outer + column + 1;
                let (colour, normal) = self.roof(&seen, [column, row], index, &ground);
                let [height, wall, _, _] = self.map.at(column, row);
                let [x, y] = [normal.x, normal.y].map(direction_byte);
                self.map.set(column, row, [height, wall, x, y]);
                self.map.set(
                    side + column,
                    row,
                    [colour[0], colour[1], colour[2], u8::MAX],
                );
            }
        }
    }

    /// Mean colour and normal of a texel's roof.
    fn roof(
        &self,
        seen: &Seen,
        [column, row]: [usize; 2],
        index: usize,
        ground: &[f32],
    ) -> ([u8; 3], Vec3) {
        let top = self.outer_heights[index] - self.middle[2] as f32;
        let (mut colour, mut normal, mut count) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        let reach = self.half() + self.texel();
        for sample in 0..SAMPLES * SAMPLES {
            let pixel = [
                (column + 1) * SAMPLES + sample % SAMPLES,
                (row + 1) * SAMPLES + sample / SAMPLES,
            ];
            let height = seen.nearness(pixel[0], pixel[1]);
            let is_ground = height <= ground[index];
            if (height.max(ground[index]) - top).abs() > self.options.exposure {
                continue;
            }
            count += 1.0;
            if is_ground {
                colour += Vec3::from(self.ground.colour.map(f32::from));
                normal += self.ground_normal(ground, index);
                continue;
            }
            let triangle = &self.triangles[seen.triangle(pixel[0], pixel[1]) as usize];
            let size = self.texel() / SAMPLES as f32;
            let [x, y] = pixel.map(|along| (along as f32 + 0.5) * size - reach);
            let weights = triangle.meet(Vec3::new(x, y, height), Vec3::NEG_Z);
            let weights = weights.map_or([1.0, 0.0, 0.0], |(_, weights)| weights);
            let paint = &self.scene.triangles[triangle.number as usize].paint;
            colour += Vec3::from(self.scene.colour(paint, weights));
            normal += triangle.normal * triangle.normal.z.signum();
        }
        let colour = (colour / count).to_array().map(|band| band.round() as u8);
        (colour, normal.try_normalize().unwrap_or(Vec3::Z))
    }

    fn ground_normal(&self, ground: &[f32], index: usize) -> Vec3 {
        let outer = self.map.side_texels + 2;
        let run = 2.0 * self.texel();
        let across = (ground[index + 1] - ground[index - 1]) / run;
        let along = (ground[index + outer] - ground[index - outer]) / run;
        Vec3::new(-across, -along, 1.0).normalize()
    }

    /// Walls, and the ambient occlusion of all.
    fn paint_from_around(&mut self, exposed: &[Exposed], report: &mut BakeReport) {
        let mut walls = Walls::new(&self.map, exposed, self.middle);
        let caster = Caster::new(&self.map, f64::from(self.map.heights[0]));
        let size = self.options.view_pixels;
        let mut seen = Seen::new([size, size], false);
        let (half, base) = (self.half(), self.middle[2] as f32);
        let [low, high] = self.map.heights.map(|height| height - base);
        let low = Vec3::new(-half, -half, low);
        let high = Vec3::new(half, half, high);
        for towards in hemisphere(self.options.views) {
            let view = Orthographic::new(towards, low, high);
            seen.clear();
            let to_clip = view.to_clip();
            for (number, triangle) in self.triangles.iter().enumerate() {
                seen.draw(&to_clip, &triangle.corners, number as u32);
            }
            if !exposed.is_empty() {
                self.scatter(&view, &seen, &caster, &mut walls, report);
            }
            walls.shade(&view, &seen, size, TOLERANCE * self.texel());
        }
        walls.finish(&mut self.map, exposed);
    }

    /// Adds the colours of a view where the BlockMap shows walls.
    fn scatter(
        &self,
        view: &Orthographic,
        seen: &Seen,
        caster: &Caster<&BlockMap>,
        walls: &mut Walls,
        report: &mut BakeReport,
    ) {
        let size = self.options.view_pixels;
        let tolerance = TOLERANCE * self.texel();
        let direction = -view.towards;
        let (mut pixels, mut rays) = (Vec::with_capacity(size), Vec::with_capacity(size));
        for row in 0..size {
            pixels.clear();
            pixels.extend(
                (0..size).filter_map(|column| self.seen_wall(view, seen, [column, row], report)),
            );
            rays.clear();
            rays.extend(pixels.iter().map(|pixel| Ray {
                origin: (DVec3::from(self.middle) + pixel.eye.as_dvec3()).to_array(),
                direction: direction.as_dvec3().to_array(),
            }));
            caster.fast_each(&rays, |index, hit| {
                let Some(hit) = hit else {
                    return;
                };
                let SeenWall {
                    eye,
                    distance,
                    triangle,
                } = pixels[index];
                let behind = distance - hit.distance as f32;
                report.hidden_pixels += u64::from(behind > tolerance);
                if !hit.is_wall || behind.abs() > tolerance {
                    return;
                }
                let weights = triangle.meet(eye, direction);
                let weights = weights.map_or([1.0, 0.0, 0.0], |(_, weights)| weights);
                let paint = &self.scene.triangles[triangle.number as usize].paint;
                let colour = Vec3::from(self.scene.colour(paint, weights));
                let facing = triangle.normal * triangle.normal.dot(view.towards).signum();
                walls.add(&self.map, &hit, colour, facing);
            });
        }
    }

    /// The wall that a pixel shows, if it does; counts the pixels that show the block.
    fn seen_wall(
        &self,
        view: &Orthographic,
        seen: &Seen,
        [column, row]: [usize; 2],
        report: &mut BakeReport,
    ) -> Option<SeenWall<'_>> {
        let number = seen.triangle(column, row);
        if number == NOTHING {
            return None;
        }
        let triangle = &self.triangles[number as usize];
        let eye = view.eye([column, row], self.options.view_pixels);
        let distance = eye.dot(view.towards) - seen.nearness(column, row);
        let place = eye - view.towards * distance;
        if place.x.abs().max(place.y.abs()) > self.half() {
            return None;
        }
        report.seen_pixels += 1;
        let is_wall = triangle.normal.z.abs() <= ROOF_NORMAL;
        is_wall.then_some(SeenWall {
            eye,
            distance,
            triangle,
        })
    }
}

/// A wall in a pixel of a view.
#[derive(Clone, Copy)]
struct SeenWall<'a> {
    /// The middle of the pixel.
    eye: Vec3,
    distance: f32,
    triangle: &'a Local,
}
