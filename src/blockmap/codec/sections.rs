//! The planes of a block in the order of their bytes, and what the shape tells of the others.

use super::rows::{Coder, NOWHERE, Places, Plane, ZONE_CONTEXTS, guide, mask, pass};
use crate::blockmap::layout::{BlockMap, WALL_COLUMNS};
use crate::vectors::widened;

/// Planes of a block: heights, wall columns, two of roof normals, and four of roofs, walls, and normals of walls.
pub const PLANES: usize = 16;
/// A wall column's code where the shape told of a wall but there is none.
const NO_WALL: u8 = 0x80;
/// Zones of a plane.
const ZONES: usize = 4;

/// Contexts of each plane.
pub fn contexts() -> [usize; PLANES] {
    [ZONES * usize::from(ZONE_CONTEXTS); PLANES]
}

/// What is stored of a block beside its planes.
#[derive(Clone, Copy, Debug)]
pub struct Hints {
    /// Codes of height by which a texel stands above a neighbour where a wall is foreseen: more than so many.
    pub step: u16,
    /// Whether columns of walls that no texel has are stored too; else they are 0.
    pub has_all_columns: bool,
}

/// Passes all planes of a block: reads them from its image and writes them back.
pub fn walk<C: Coder>(coder: &mut C, map: &mut BlockMap, hints: Hints) {
    let side = map.side_texels;
    let shape = walk_shape(coder, map, hints.step);
    let mut section = read::<C>(map, side, side, &every_row(map), true);
    let mut before: Option<usize> = None;
    for channel in [1, 0, 2, 3] {
        let mut plane = std::mem::replace(&mut section[channel], Plane::new(0, 0, 8));
        // Occlusion has more to do with heights than with colours.
        let companion = before
            .filter(|_| channel != 3)
            .map(|before| &section[before]);
        pass(
            coder,
            &mut plane,
            &shape.places,
            companion.or(Some(&shape.heights)),
        );
        section[channel] = plane;
        before = Some(channel);
    }
    write(map, side, side, &every_row(map), true, &section);
    walk_walls(coder, map, hints.has_all_columns);
}

struct Shape {
    heights: Plane,
    places: Places,
}

fn every_row(map: &BlockMap) -> Vec<usize> {
    (0..map.side_texels).collect()
}

/// One zone for all.
fn anywhere(width: usize, rows: usize) -> Places {
    Places {
        zones: vec![0; width * rows],
        guides: vec![guide::LEFT; width * rows],
        period: rows,
    }
}

fn walk_shape<C: Coder>(coder: &mut C, map: &mut BlockMap, step: u16) -> Shape {
    let side = map.side_texels;
    let bits = if map.low_heights.is_some() { 16 } else { 8 };
    let mut heights = Plane::new(side, side, bits);
    if C::KNOWS {
        for (index, height) in heights.values.iter_mut().enumerate() {
            *height = map.height_code(index % side, index / side);
        }
    }
    pass(coder, &mut heights, &anywhere(side, side), None);
    let mut columns = Plane::new(side, side, 8);
    let expected = expected_walls(&heights.values, side, step);
    if C::KNOWS {
        put_columns(map, &expected, &mut columns.values);
    }
    let mut places = anywhere(side, side);
    for (zone, &is_expected) in places.zones.iter_mut().zip(&expected) {
        *zone = u8::from(is_expected);
    }
    // A texel at the border may stand above one outside.
    for along in 0..side {
        for index in [
            along,
            side * (side - 1) + along,
            side * along,
            side * along + side - 1,
        ] {
            places.zones[index] |= 2;
        }
    }
    pass(coder, &mut columns, &places, None);
    let places = surroundings(&heights.values, side, bits);
    let mut section = read::<C>(map, 0, side, &every_row(map), false);
    take_columns(
        side * map.slice_rows(),
        &expected,
        &columns.values,
        &mut section[1].values,
    );
    let (shape, normals) = section.split_at_mut(2);
    let (across, along) = normals.split_at_mut(1);
    pass(coder, &mut across[0], &places, Some(&heights));
    pass(coder, &mut along[0], &places, Some(&across[0]));
    for (index, &code) in heights.values.iter().enumerate() {
        let [high, low] = code.to_be_bytes();
        shape[0].values[index] = u16::from(if bits == 16 { high } else { low });
        if let Some(plane) = &mut map.low_heights {
            plane[index] = low;
        }
    }
    write(map, 0, side, &every_row(map), false, &section);
    Shape { heights, places }
}

/// Texels that stand more than `step` codes above one of their neighbours in the block.
fn expected_walls(heights: &[u16], side: usize, step: u16) -> Vec<bool> {
    let mut expected = vec![false; heights.len()];
    let rows = heights
        .chunks_exact(side)
        .zip(expected.chunks_exact_mut(side));
    for (own, expected) in rows {
        mark_higher(&own[..side - 1], &own[1..], step, expected);
        mark_higher(&own[1..], &own[..side - 1], step, &mut expected[1..]);
    }
    let (south, north) = (&heights[..side * (side - 1)], &heights[side..]);
    mark_higher(south, north, step, &mut expected);
    mark_higher(north, south, step, &mut expected[side..]);
    expected
}

widened! {
    fn mark_higher(heights: &[u16], others: &[u16], step: u16, marks: &mut [bool]) {
        for ((mark, &height), &other) in marks.iter_mut().zip(heights).zip(others) {
            *mark |= height.saturating_sub(other) > step;
        }
    }
}

/// Codes of wall columns: 0 where there is a wall or none as expected, and its column is one more than the one before.
fn put_columns(map: &BlockMap, expected: &[bool], codes: &mut [u16]) {
    let (side, slice) = (map.side_texels, map.side_texels * map.slice_rows());
    let mut last = 0;
    for (index, code) in codes.iter_mut().enumerate() {
        if index % slice == 0 {
            last = 0;
        }
        let wall = i32::from(map.wall_column(index % side, index / side));
        let further = (wall - 1 - last + 127).rem_euclid(255) - 127;
        let byte = match (wall, expected[index]) {
            (0, true) => NO_WALL,
            (0, false) => 0,
            (_, true) => further as u8,
            (_, false) => (further + i32::from(further >= 0)) as u8,
        };
        *code = u16::from(byte);
        last = if wall == 0 { last } else { wall };
    }
}

/// The inverse of [`put_columns`], for slices of so many texels.
fn take_columns(slice: usize, expected: &[bool], codes: &[u16], walls: &mut [u16]) {
    for ((codes, expected), walls) in codes
        .chunks(slice)
        .zip(expected.chunks(slice))
        .zip(walls.chunks_mut(slice))
    {
        let mut last = 0;
        for ((&code, &is_expected), wall) in codes.iter().zip(expected).zip(walls) {
            let byte = code as u8;
            let further = match (byte, is_expected) {
                (NO_WALL, true) | (0, false) => {
                    *wall = 0;
                    continue;
                }
                (_, true) => i32::from(byte as i8),
                (NO_WALL, false) => 127,
                (_, false) => i32::from(byte as i8) - i32::from((byte as i8) > 0),
            };
            last = (last + further).rem_euclid(255) + 1;
            *wall = last as u16;
        }
    }
}

/// For each texel the neighbour before it that is as high, and how the heights around differ.
fn surroundings(heights: &[u16], side: usize, bits: u32) -> Places {
    let mut places = anywhere(side, side);
    // Steps of roofs are smaller than those of walls; a 64th of the block's height parts them well enough.
    let small = mask(bits) / 64;
    for row in 1..side {
        let (before, own) = heights[(row - 1) * side..(row + 1) * side].split_at(side);
        let guides = &mut places.guides[row * side..(row + 1) * side];
        let zones = &mut places.zones[row * side..(row + 1) * side];
        for column in 1..side - 1 {
            let height = own[column];
            let left = own[column - 1].abs_diff(height);
            let above = before[column].abs_diff(height);
            let corner = before[column - 1].abs_diff(height);
            let above_right = before[column + 1].abs_diff(height);
            let (mut least, mut best) = (left, guide::LEFT);
            for (away, guide) in [
                (above, guide::ABOVE),
                (corner, guide::CORNER),
                (above_right, guide::ABOVE_RIGHT),
            ] {
                best = if away < least { guide } else { best };
                least = least.min(away);
            }
            guides[column] = best;
            let farther = left.max(above);
            let uneven = 2 + u8::from(least > small);
            zones[column] = if farther > small {
                uneven
            } else {
                u8::from(farther > 0)
            };
        }
        guides[0] = guide::ABOVE;
    }
    places
}

fn walk_walls<C: Coder>(coder: &mut C, map: &mut BlockMap, has_all_columns: bool) {
    let (first, slice_rows) = (2 * map.side_texels, map.slice_rows());
    let is_normal = |row: &usize| row % slice_rows == slice_rows - 1;
    let (normals, colours): (Vec<usize>, Vec<usize>) =
        every_row(map).iter().partition(|row| is_normal(row));
    let columns = slice_columns(map, has_all_columns);
    for (rows, are_colours) in [(colours, true), (normals, false)] {
        let mut places = anywhere(WALL_COLUMNS, rows.len());
        places.period = if are_colours { slice_rows - 1 } else { 1 };
        for (&row, zones) in rows.iter().zip(places.zones.chunks_exact_mut(WALL_COLUMNS)) {
            let within = are_colours.then_some(row % slice_rows);
            for (zone, column) in zones.iter_mut().zip(&columns[row / slice_rows]) {
                *zone = wall_zone(*column, within);
            }
        }
        let mut section = read::<C>(map, first, WALL_COLUMNS, &rows, are_colours);
        let order = if are_colours {
            [1, 0, 2, 3]
        } else {
            [0, 1, 2, 3]
        };
        let mut before: Option<usize> = None;
        for channel in order {
            let mut plane = std::mem::replace(&mut section[channel], Plane::new(0, 0, 8));
            let companion = before.map(|before| &section[before]);
            pass(coder, &mut plane, &places, companion);
            section[channel] = plane;
            before = Some(channel);
        }
        write(map, first, WALL_COLUMNS, &rows, are_colours, &section);
    }
}

/// The zone of a column in a row of colours of its slice, or in that of its normal: below its foot, below its top, at it, above.
fn wall_zone(column: Option<[usize; 2]>, row: Option<usize>) -> u8 {
    match (column, row) {
        (None, _) => NOWHERE,
        (Some(_), None) => 0,
        (Some([low, top]), Some(row)) => {
            u8::from(row >= low) + u8::from(row >= top) + u8::from(row > top)
        }
    }
}

/// Of each column of each slice that is stored the rows of its wall's foot and top, by the first texel that has it; what is beyond
/// is never seen. Columns that no texel has reach all over.
fn slice_columns(map: &BlockMap, has_all: bool) -> Vec<[Option<[usize; 2]>; WALL_COLUMNS]> {
    let (side, rows) = (map.side_texels, map.wall_rows());
    let mut slices = vec![[None; WALL_COLUMNS]; map.slices];
    let place = |code: u16| usize::from(code) * rows / usize::from(map.top_code());
    let rows_of_slice = map.slice_rows();
    for row in 0..side {
        let slice = &mut slices[row / rows_of_slice];
        for column in 0..side {
            let wall = usize::from(map.wall_column(column, row));
            if wall == 0 || slice[wall].is_some() {
                continue;
            }
            let around = [
                (column.wrapping_sub(1), row),
                (column + 1, row),
                (column, row.wrapping_sub(1)),
                (column, row + 1),
            ];
            let inside = around.into_iter().filter(|&(c, r)| c < side && r < side);
            let heights = inside.map(|(c, r)| map.height_code(c, r));
            let low = heights.min().unwrap_or(0);
            slice[wall] = Some([place(low), place(map.height_code(column, row))]);
        }
    }
    if has_all {
        let unknown = slices.iter_mut().flatten().filter(|known| known.is_none());
        unknown.for_each(|known| *known = Some([0, rows]));
    }
    slices
}

/// Whether all of the walls that no texel has is 0.
pub fn is_rest_blank(map: &BlockMap) -> bool {
    let columns = slice_columns(map, false);
    (0..map.side_texels).all(|row| {
        let slice = &columns[row / map.slice_rows()];
        let unused = slice
            .iter()
            .enumerate()
            .filter(|(_, column)| column.is_none());
        unused
            .into_iter()
            .all(|(column, _)| map.at(2 * map.side_texels + column, row) == [0; 4])
    })
}

/// The four channels of some columns and rows; red and blue less green where they `are_relative`.
fn read<C: Coder>(
    map: &BlockMap,
    first: usize,
    width: usize,
    rows: &[usize],
    are_relative: bool,
) -> [Plane; 4] {
    let mut planes = [0; 4].map(|_| Plane::new(width, rows.len(), 8));
    if !C::KNOWS {
        return planes;
    }
    for (line, &row) in rows.iter().enumerate() {
        let start = 4 * (row * map.width() + first);
        let texels = map.image[start..start + 4 * width].as_chunks::<4>().0;
        for (column, &[red, green, blue, alpha]) in texels.iter().enumerate() {
            let less = if are_relative { green } else { 0 };
            let values = [
                red.wrapping_sub(less),
                green,
                blue.wrapping_sub(less),
                alpha,
            ];
            for (plane, value) in planes.iter_mut().zip(values) {
                plane.values[line * plane.width + column] = u16::from(value);
            }
        }
    }
    planes
}

/// The inverse of [`read`].
fn write(
    map: &mut BlockMap,
    first: usize,
    width: usize,
    rows: &[usize],
    are_relative: bool,
    planes: &[Plane; 4],
) {
    for (line, &row) in rows.iter().enumerate() {
        let start = 4 * (row * map.width() + first);
        let texels = map.image[start..start + 4 * width].as_chunks_mut::<4>().0;
        let [red, green, blue, alpha] = [0, 1, 2, 3]
            .map(|channel| &planes[channel].values[line * planes[channel].width..][..width]);
        mix(texels, [red, green, blue, alpha], are_relative);
    }
}

widened! {
    fn mix(texels: &mut [[u8; 4]], channels: [&[u16]; 4], are_relative: bool) {
        let [red, green, blue, alpha] = channels.map(|channel| &channel[..texels.len()]);
        let mask = if are_relative { u16::MAX } else { 0 };
        for (column, texel) in texels.iter_mut().enumerate() {
            let less = green[column] & mask;
            *texel = [
                red[column].wrapping_add(less) as u8,
                green[column] as u8,
                blue[column].wrapping_add(less) as u8,
                alpha[column] as u8,
            ];
        }
    }
}
