//! How far points on the screen are from where the finest surface has them.
//!
//! A drawn point and the point of the finest surface at the same x and y are both projected; their distance in pixels is the
//! error there. Twice a frame:
//!
//! - *On a grid of pixels*: the drawn triangles are rasterised with depth at every n-th pixel, so that each sample is the
//!   drawn point that is seen there, and stands for an equal part of the screen. Quantiles are taken over these.
//! - *On every patch*: vertices of the finest surface and random points of each drawn patch, seen or hidden behind
//!   others, where the drawn or the finest point lies in the picture. Only the largest error counts.

use glam::DVec3;
use kimberlite::cut::{Cut, GridToWorld, Patch};

use crate::camera::{Lens, Shot, VIEWPORT, in_picture};
use crate::finest::{Finest, Random};

/// Random points, and as many vertices of the finest surface, of each patch.
const POINTS: usize = 128;

/// Measures frames.
pub struct Screen<'a> {
    finest: &'a Finest,
    /// Pixels from one sample to the next.
    pixels: f64,
    columns: usize,
    rows: usize,
    /// 1/w of the nearest drawn point under each sample; 0 where nothing is drawn.
    nearness: Vec<f64>,
    /// Errors at the samples of all frames, pixels.
    pub errors: Vec<f32>,
    /// The largest error of all points.
    pub worst: Option<Worst>,
    /// Points measured on patches.
    pub points: u64,
    random: Random,
    /// Vertices of a patch in clip space, and where they are among the samples.
    clip: Vec<DVec3>,
    spots: Vec<Spot>,
}

/// Column and row among the samples, and 1/w.
type Spot = [f64; 3];

/// The largest error, and where it is.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    pub pixels: f64,
    pub frame: usize,
    /// World coordinates of the drawn point, and z of the finest.
    pub place: [f64; 4],
}

impl<'a> Screen<'a> {
    pub fn new(finest: &'a Finest, pixels: u32) -> Screen<'a> {
        let count = |size: f64| (size / f64::from(pixels)) as usize;
        let (columns, rows) = (count(VIEWPORT[0]), count(VIEWPORT[1]));
        Screen {
            finest,
            pixels: f64::from(pixels),
            columns,
            rows,
            nearness: vec![0.0; columns * rows],
            errors: Vec::new(),
            worst: None,
            points: 0,
            random: Random(0),
            clip: Vec::new(),
            spots: Vec::new(),
        }
    }

    /// Measures what a cut draws of a view.
    pub fn measure(&mut self, cut: &Cut, shot: &Shot, frame: usize) {
        let lens = Lens::new(shot);
        self.nearness.fill(0.0);
        for patch in cut.patches() {
            self.rasterise(cut, patch, &lens);
        }
        for sample in 0..self.nearness.len() {
            if self.nearness[sample] > 0.0 {
                let place = lens.place(self.pixel(sample), 1.0 / self.nearness[sample]);
                if let Some(pixels) = self.error(place, &lens, frame) {
                    self.errors.push(pixels as f32);
                }
            }
        }
        let (map, grid) = (cut.grid_to_world(), cut.grid());
        let cells = grid.last().map_or(0, |last| last[1] as usize);
        for patch in cut.patches() {
            for _ in 0..POINTS {
                let inside = self.random_place();
                let on_vertex = on_vertex(patch, self.random_place(), cells);
                for place in [Some(inside), on_vertex].into_iter().flatten() {
                    let drawn = drawn_point(patch, &map, cells, place);
                    self.points += u64::from(self.error(drawn, &lens, frame).is_some());
                }
            }
        }
    }

    /// The pixel of a sample.
    fn pixel(&self, sample: usize) -> [f64; 2] {
        [sample % self.columns, sample / self.columns].map(|at| (at as f64 + 0.5) * self.pixels)
    }

    /// The error at a drawn point; `None` where there is no finest one, where one of both is not in front of the near plane, or both
    /// are beside the picture.
    fn error(&mut self, drawn: DVec3, lens: &Lens, frame: usize) -> Option<f64> {
        let z = self.finest.height_at_world([drawn.x, drawn.y])?;
        let a = lens.project(drawn)?;
        let b = lens.project(DVec3::new(drawn.x, drawn.y, z))?;
        if !in_picture(a) && !in_picture(b) {
            return None;
        }
        let pixels = (a[0] - b[0]).hypot(a[1] - b[1]);
        if self.worst.is_none_or(|worst| pixels > worst.pixels) {
            self.worst = Some(Worst {
                pixels,
                frame,
                place: [drawn.x, drawn.y, drawn.z, z],
            });
        }
        Some(pixels)
    }

    /// Shares of both legs, evenly over a half.
    fn random_place(&mut self) -> [f64; 2] {
        let [p, q] = [self.random.share(), self.random.share()];
        if p + q <= 1.0 {
            [p, q]
        } else {
            [1.0 - p, 1.0 - q]
        }
    }

    fn rasterise(&mut self, cut: &Cut, patch: &Patch, lens: &Lens) {
        let map = cut.grid_to_world();
        let mut clip = std::mem::take(&mut self.clip);
        let mut spots = std::mem::take(&mut self.spots);
        clip.clear();
        spots.clear();
        for (&[p, q], vertex) in cut.grid().iter().zip(patch.vertices.chunks_exact(3)) {
            let place = world(patch, &map, [p, q].map(f64::from), f64::from(vertex[0]));
            clip.push(lens.clip(place));
        }
        spots.extend(clip.iter().map(|&corner| self.spot(corner)));
        let list = patch.indices.as_deref().unwrap_or(cut.triangle_list());
        for triangle in list.chunks_exact(3) {
            let triangle = [0, 1, 2].map(|corner| usize::from(triangle[corner]));
            if triangle.iter().all(|&corner| clip[corner].z >= lens.near) {
                self.fill(triangle.map(|corner| spots[corner]));
            } else {
                let (polygon, count) = in_front(triangle.map(|corner| clip[corner]), lens.near);
                let spots = polygon.map(|corner| self.spot(corner));
                for last in 2..count {
                    self.fill([spots[0], spots[last - 1], spots[last]]);
                }
            }
        }
        (self.clip, self.spots) = (clip, spots);
    }

    /// Of a point in front of the near plane; of others it means nothing.
    fn spot(&self, clip: DVec3) -> Spot {
        let [x, y] = Lens::pixel(clip).map(|pixel| pixel / self.pixels - 0.5);
        [x, y, 1.0 / clip.z]
    }

    /// Marks the samples that a triangle in front of the near plane covers.
    fn fill(&mut self, [a, b, c]: [Spot; 3]) {
        let range = |axis: usize, count: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0);
            let high = a[axis].max(b[axis]).max(c[axis]).floor();
            (low <= high && high >= 0.0).then(|| low as usize..(high as usize + 1).min(count))
        };
        let (Some(rows), Some(columns)) = (range(1, self.rows), range(0, self.columns)) else {
            return;
        };
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 {
            return;
        }
        for row in rows {
            for column in columns.clone() {
                let (x, y) = (column as f64, row as f64);
                let side =
                    |p: Spot, q: Spot| ((p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x)) / area;
                let weights = [side(b, c), side(c, a), side(a, b)];
                if weights.iter().all(|weight| *weight >= 0.0) {
                    let nearness = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                    let sample = &mut self.nearness[row * self.columns + column];
                    *sample = sample.max(nearness);
                }
            }
        }
    }
}

/// World position of a place of a patch, given as steps along its legs and its height.
fn world(patch: &Patch, map: &GridToWorld, [p, q]: [f64; 2], height: f64) -> DVec3 {
    let legs = patch.legs.map(|leg| leg.map(f64::from));
    let grid = [
        patch.origin[0] + p * legs[0][0] + q * legs[1][0],
        patch.origin[1] + p * legs[0][1] + q * legs[1][1],
        patch.origin[2] + height,
    ];
    DVec3::from([0, 1, 2].map(|axis| map.origin[axis] + map.step[axis] * grid[axis]))
}

/// The drawn point at shares of a patch's legs.
fn drawn_point(patch: &Patch, map: &GridToWorld, cells: usize, place: [f64; 2]) -> DVec3 {
    let [p, q] = place.map(|share| share * cells as f64);
    let i = (p as usize).min(cells - 1);
    let j = (q as usize).min(cells - 1 - i);
    let (a, b) = (p - i as f64, q - j as f64);
    let at = |i: usize, j: usize| {
        let index = j * (cells + 1) + i - j * j.saturating_sub(1) / 2;
        f64::from(patch.vertices[3 * index])
    };
    let height = if a + b <= 1.0 || i + j + 2 > cells {
        (1.0 - a - b) * at(i, j) + a * at(i + 1, j) + b * at(i, j + 1)
    } else {
        (a + b - 1.0) * at(i + 1, j + 1) + (1.0 - a) * at(i, j + 1) + (1.0 - b) * at(i + 1, j)
    };
    world(patch, map, [p, q], height)
}

/// The vertex of the finest surface nearest to a place of a patch, if it lies in the patch.
fn on_vertex(patch: &Patch, [p, q]: [f64; 2], cells: usize) -> Option<[f64; 2]> {
    let [a, b] = patch
        .legs
        .map(|leg| leg.map(|step| f64::from(step) * cells as f64));
    let determinant = a[0] * b[1] - a[1] * b[0];
    let x = (p * a[0] + q * b[0]).round();
    let y = (p * a[1] + q * b[1]).round();
    let place = [
        (x * b[1] - y * b[0]) / determinant,
        (a[0] * y - a[1] * x) / determinant,
    ];
    (place[0] >= 0.0 && place[1] >= 0.0 && place[0] + place[1] <= 1.0).then_some(place)
}

/// The part of a triangle in front of the near plane, a convex polygon of so many corners.
fn in_front(corners: [DVec3; 3], near: f64) -> ([DVec3; 4], usize) {
    let (mut polygon, mut count) = ([DVec3::ZERO; 4], 0);
    for (k, &from) in corners.iter().enumerate() {
        let to = corners[(k + 1) % 3];
        let mut push = |corner: DVec3| {
            polygon[count] = corner;
            count += 1;
        };
        if from.z >= near {
            push(from);
        }
        if (from.z >= near) != (to.z >= near) {
            let mut cut = from.lerp(to, (near - from.z) / (to.z - from.z));
            cut.z = near;
            push(cut);
        }
    }
    (polygon, count)
}
