//! The BlockMap of an inner node, out of its four children's (thesis, ch. 4.3.1: the mipmap of a city).

use super::columns::{self, Exposed};
use super::layout::{BlockMap, WALL_COLUMNS, direction_byte};
use crate::Result;
use glam::{Vec3, Vec4};

/// How far a node is from its children.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeError {
    /// The largest difference of heights, in metres, but at most a texel of the node: a wall further off is one that has moved by a
    /// texel.
    pub height: f32,
    /// Root of the mean square difference of the colours of roofs and ground, of 255.
    pub colour: f32,
}

/// Texels of the children under one of the node.
struct Quad<'a> {
    child: &'a BlockMap,
    texels: [[usize; 2]; 4],
    heights: [f32; 4],
}

impl Quad<'_> {
    /// The second highest: what half of the texel stands at or above.
    fn height(&self) -> f32 {
        let mut sorted = self.heights;
        sorted.sort_by(f32::total_cmp);
        sorted[2]
    }

    /// The texels that stand about as high as this.
    fn alike(&self, height: f32, exposure: f32) -> impl Iterator<Item = [usize; 2]> {
        let is_alike = move |index: &usize| (self.heights[*index] - height).abs() <= exposure;
        (0..4).filter(is_alike).map(|index| self.texels[index])
    }
}

/// The node over four children in the order south-west, south-east, north-west, north-east, how far it is from them, and how many
/// exposed texels share a column.
///
/// # Errors
///
/// Those of [`BlockMap::new`].
pub fn merge(children: [&BlockMap; 4]) -> Result<(BlockMap, NodeError, usize)> {
    let first = children[0];
    let side = first.side_texels;
    let mut map = BlockMap::new(side, first.corner, 2.0 * first.side)?;
    map.exposure = first.exposure;
    map.roof_slope = first.exposure / map.texel() as f32;
    let heights: Vec<f32> = (0..side * side)
        .map(|index| quad(children, index % side, index / side).height())
        .collect();
    map.set_heights(&heights, first.low_heights.is_some());
    let mut error = NodeError::default();
    let mut squares = 0.0f64;
    for row in 0..side {
        for column in 0..side {
            let quad = quad(children, column, row);
            let own = map.height(column, row);
            for height in quad.heights {
                let off = (height - own).abs().min(map.texel() as f32);
                error.height = error.height.max(off);
            }
            let (roof, normal) = roof(&quad, own, map.exposure);
            for [x, y] in quad.texels {
                let child = quad.child.roof(x, y);
                let squared =
                    (0..3).map(|band| f64::from(child[band].abs_diff(roof[band])).powi(2));
                squares += squared.sum::<f64>();
            }
            let [height, wall, ..] = map.at(column, row);
            let [x, y] = [normal.x, normal.y].map(direction_byte);
            map.set(column, row, [height, wall, x, y]);
            map.set(side + column, row, roof);
        }
    }
    error.colour = (squares / (12 * side * side) as f64).sqrt() as f32;
    let mut exposed = exposed(&map, children);
    let shared = columns::assign(&mut map, &mut exposed);
    paint_walls(&mut map, children, &exposed);
    Ok((map, error, shared))
}

fn quad<'a>(children: [&'a BlockMap; 4], column: usize, row: usize) -> Quad<'a> {
    let half = children[0].side_texels / 2;
    let child = children[column / half + 2 * (row / half)];
    let (x, y) = (2 * (column % half), 2 * (row % half));
    let texels = [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]];
    Quad {
        child,
        texels,
        heights: texels.map(|[x, y]| child.height(x, y)),
    }
}

/// Mean roof of the texels that stand as high as the node's.
fn roof(quad: &Quad, height: f32, exposure: f32) -> ([u8; 4], Vec3) {
    let (mut colour, mut normal, mut count) = (Vec4::ZERO, Vec3::ZERO, 0.0);
    let child = quad.child;
    // None is alike only where quantised heights are further off than a wall.
    let nearest = quad
        .alike(height, exposure.max(child.exposure))
        .collect::<Vec<_>>();
    let texels = if nearest.is_empty() {
        &quad.texels[..]
    } else {
        &nearest[..]
    };
    for &[x, y] in texels {
        colour += Vec4::from(child.roof(x, y).map(f32::from));
        normal += Vec3::from(child.roof_normal(x, y));
        count += 1.0;
    }
    let colour = (colour / count).to_array().map(|band| band.round() as u8);
    (colour, normal.try_normalize().unwrap_or(Vec3::Z))
}

/// Texels that stand above their neighbours; at the border, which has none, those whose children are exposed.
fn exposed(map: &BlockMap, children: [&BlockMap; 4]) -> Vec<Exposed> {
    let side = map.side_texels;
    let outer = side + 2;
    let is_wall = |column: usize, row: usize| {
        let quad = quad(children, column, row);
        let mut alike = quad.alike(map.height(column, row), map.exposure);
        alike.any(|[x, y]| quad.child.wall_column(x, y) != 0)
    };
    let around = |index: usize| {
        let [column, row] = [index % outer, index / outer].map(|at| at.clamp(1, side) - 1);
        let height = map.height(column, row);
        if is_wall(column, row) {
            map.heights[0].min(height)
        } else {
            height
        }
    };
    let outer_heights: Vec<f32> = (0..outer * outer).map(around).collect();
    columns::exposed(map, &outer_heights)
}

/// Columns of walls, each the mean of its children's.
fn paint_walls(map: &mut BlockMap, children: [&BlockMap; 4], exposed: &[Exposed]) {
    let rows = map.wall_rows();
    let [low, high] = map.heights;
    let mut sums = vec![(Vec4::ZERO, 0.0f32); map.side_texels * WALL_COLUMNS];
    let mut normals = vec![Vec3::ZERO; map.slices * WALL_COLUMNS];
    for wall in exposed {
        let [column, row] = wall.texel;
        let (slice, across) = (row / map.slice_rows(), usize::from(wall.wall_column));
        let quad = quad(children, column, row);
        let own = map.height(column, row);
        let faces: Vec<[usize; 2]> = quad
            .alike(own, map.exposure)
            .filter(|&[x, y]| quad.child.wall_column(x, y) != 0)
            .collect();
        let [x, y] = wall.outward.map(|along| along as f32);
        normals[slice * WALL_COLUMNS + across] += 1e-3 * Vec3::new(x, y, 0.0);
        for &[x, y] in &faces {
            let normal = quad.child.wall_normal(y, quad.child.wall_column(x, y));
            normals[slice * WALL_COLUMNS + across] += Vec3::from(normal);
        }
        for above in 0..rows {
            let height = low + (above as f32 + 0.5) / rows as f32 * (high - low);
            let sum = &mut sums[(slice * map.slice_rows() + above) * WALL_COLUMNS + across];
            for &[x, y] in &faces {
                let wall_column = quad.child.wall_column(x, y);
                let [place, down] = quad.child.wall_place(y, wall_column, height);
                sum.0 += Vec4::from(quad.child.at(place, down).map(f32::from));
                sum.1 += 1.0;
            }
            if faces.is_empty() {
                // As faint as to count only where nothing else does.
                sum.0 += 1e-3 * Vec4::from(map.roof(column, row).map(f32::from));
                sum.1 += 1e-3;
            }
        }
    }
    for wall in exposed {
        let slice = wall.texel[1] / map.slice_rows();
        let across = usize::from(wall.wall_column);
        let first = slice * map.slice_rows();
        for above in 0..rows {
            let (sum, count) = sums[(first + above) * WALL_COLUMNS + across];
            let texel = (sum / count).to_array().map(|band| band.round() as u8);
            map.set(2 * map.side_texels + across, first + above, texel);
        }
        let normal = normals[slice * WALL_COLUMNS + across].normalize_or_zero();
        let [x, y, z] = normal.to_array().map(direction_byte);
        let [place, down] = map.wall_normal_place(wall.texel[1], wall.wall_column);
        map.set(place, down, [x, y, z, u8::MAX]);
    }
}
