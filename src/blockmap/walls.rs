//! What the views of a block tell of its walls, and of the sky over all of it.

use super::cast::Hit;
use super::columns::Exposed;
use super::layout::{BlockMap, WALL_COLUMNS, direction_byte};
use super::orthographic::Orthographic;
use super::raster::Seen;
use glam::Vec3;

/// Sums over views.
pub struct Walls {
    /// Of each texel of the section of walls, row by row: colours, and how many.
    colours: Vec<(Vec3, f32)>,
    /// Of each wall column of each slice.
    normals: Vec<Vec3>,
    /// Places that the sky lights.
    places: Vec<Lit>,
}

/// A place on the surface, relative to the block's middle.
struct Lit {
    place: Vec3,
    normal: Vec3,
    /// Column and row in the image.
    texel: [usize; 2],
    sky: f32,
    seen: f32,
}

impl Walls {
    /// Nothing seen yet of a block whose heights, roofs and columns are set. Places are relative to `middle`.
    pub fn new(map: &BlockMap, exposed: &[Exposed], middle: [f64; 3]) -> Walls {
        let side = map.side_texels;
        let (texel, half) = (map.texel() as f32, 0.5 * map.side as f32);
        let base = middle[2] as f32;
        let at = |along: f32| (along + 0.5) * texel - half;
        let mut places = Vec::with_capacity(side * side + exposed.len() * map.wall_rows());
        for row in 0..side {
            for column in 0..side {
                let normal = Vec3::from(map.roof_normal(column, row));
                let height = map.height(column, row) - base;
                let place = Vec3::new(at(column as f32), at(row as f32), height);
                places.push(Lit::new(place, normal, [side + column, row]));
            }
        }
        let mut last = None;
        for wall in exposed {
            let [column, row] = wall.texel;
            let own = (row / map.slice_rows(), wall.wall_column);
            // A texel that shares a column is lit as the first that has it.
            if last.replace(own) == Some(own) {
                continue;
            }
            let [x, y] = wall.outward.map(|along| along as f32);
            let top = map.height(column, row) - base;
            let [low, high] = map.heights.map(|height| height - base);
            for above in 0..map.wall_rows() {
                let height = low + (above as f32 + 0.5) / map.wall_rows() as f32 * (high - low);
                let lowest = (wall.below - base + 0.2).min(top);
                let place = Vec3::new(
                    at(column as f32 + 0.6 * x),
                    at(row as f32 + 0.6 * y),
                    height.clamp(lowest, top),
                );
                let first = own.0 * map.slice_rows();
                let texel = [2 * side + usize::from(wall.wall_column), first + above];
                places.push(Lit::new(place, Vec3::new(x, y, 0.0), texel));
            }
        }
        Walls {
            colours: vec![(Vec3::ZERO, 0.0); side * WALL_COLUMNS],
            normals: vec![Vec3::ZERO; map.slices * WALL_COLUMNS],
            places,
        }
    }

    /// Adds what was seen at a hit on a wall.
    pub fn add(&mut self, map: &BlockMap, hit: &Hit, colour: Vec3, normal: Vec3) {
        let [column, row] = hit.texel.map(usize::from);
        let wall = map.wall_column(column, row);
        let [across, down] = map.wall_place(row, wall, hit.height);
        let sum = &mut self.colours[down * WALL_COLUMNS + across - 2 * map.side_texels];
        *sum = (sum.0 + colour, sum.1 + 1.0);
        self.normals[row / map.slice_rows() * WALL_COLUMNS + usize::from(wall)] += normal;
    }

    /// Adds which places see the sky in the direction of a view. What is nearer by less than `tolerance` does not hide.
    pub fn shade(&mut self, view: &Orthographic, seen: &Seen, size: usize, tolerance: f32) {
        for lit in &mut self.places {
            let facing = lit.normal.dot(view.towards);
            if facing <= 0.0 {
                continue;
            }
            lit.sky += facing;
            let Some(([column, row], nearness)) = view.see(lit.place, size) else {
                lit.seen += facing;
                continue;
            };
            if seen.nearness(column, row) <= nearness + tolerance {
                lit.seen += facing;
            }
        }
    }

    /// Writes the walls and the ambient occlusion. What no view saw of a column is interpolated from above and below; a
    /// column that none saw is like the one before it in its slice, the first like its roof.
    pub fn finish(self, map: &mut BlockMap, exposed: &[Exposed]) {
        let rows = map.wall_rows();
        let mut before: Option<(usize, u8, Vec<Vec3>)> = None;
        for wall in exposed {
            let [column, row] = wall.texel;
            let slice = row / map.slice_rows();
            if before
                .as_ref()
                .is_some_and(|(other, number, _)| (*other, *number) == (slice, wall.wall_column))
            {
                continue;
            }
            let across = usize::from(wall.wall_column);
            let first = slice * map.slice_rows();
            let sums = (0..rows).map(|above| self.colours[(first + above) * WALL_COLUMNS + across]);
            let means: Vec<Option<Vec3>> = sums
                .map(|(sum, count)| (count > 0.0).then(|| sum / count))
                .collect();
            let colours = filled(&means).unwrap_or_else(|| match before.take() {
                Some((other, _, colours)) if other == slice => colours,
                _ => {
                    let [red, green, blue, _] = map.roof(column, row).map(f32::from);
                    vec![Vec3::new(red, green, blue); rows]
                }
            });
            for (above, colour) in colours.iter().enumerate() {
                let [red, green, blue] = colour.to_array().map(|band| band.round() as u8);
                let texel = [red, green, blue, u8::MAX];
                map.set(2 * map.side_texels + across, first + above, texel);
            }
            let [x, y] = wall.outward.map(|along| along as f32);
            let sum = self.normals[slice * WALL_COLUMNS + across];
            let normal = sum.try_normalize().unwrap_or(Vec3::new(x, y, 0.0));
            let [x, y, z] = normal.to_array().map(direction_byte);
            let [place, down] = map.wall_normal_place(row, wall.wall_column);
            map.set(place, down, [x, y, z, u8::MAX]);
            before = Some((slice, wall.wall_column, colours));
        }
        for lit in &self.places {
            let [column, row] = lit.texel;
            let [red, green, blue, _] = map.at(column, row);
            let share = if lit.sky > 0.0 {
                lit.seen / lit.sky
            } else {
                1.0
            };
            let occlusion = (255.0 * share).round() as u8;
            map.set(column, row, [red, green, blue, occlusion]);
        }
    }
}

impl Lit {
    fn new(place: Vec3, normal: Vec3, texel: [usize; 2]) -> Lit {
        Lit {
            place,
            normal,
            texel,
            sky: 0.0,
            seen: 0.0,
        }
    }
}

/// Gaps closed by linear interpolation, and at the ends by the nearest; `None` where there is nothing but a gap.
fn filled(means: &[Option<Vec3>]) -> Option<Vec<Vec3>> {
    let known = |&row: &usize| means.get(row).copied().flatten().map(|mean| (row, mean));
    let fill = |row: usize| {
        let below = (0..=row).rev().find_map(|row| known(&row));
        let above = (row..means.len()).find_map(|row| known(&row));
        match (below, above) {
            (Some((low, one)), Some((high, other))) if high > low => {
                let share = (row - low) as f32 / (high - low) as f32;
                Some(one + share * (other - one))
            }
            (nearest, other) => nearest.or(other).map(|(_, mean)| mean),
        }
    };
    (0..means.len()).map(fill).collect()
}
