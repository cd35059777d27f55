//! Which texels are walls, and which column of walls each has (thesis, ch. 4.2.1 and "slicing").

use super::layout::{BlockMap, WALL_COLUMNS};

/// Fewest rows of a slice: three of colours and one of normals.
const LEAST_SLICE_ROWS: usize = 4;
/// Columns of a slice.
const COLUMNS: usize = WALL_COLUMNS - 1;

/// A texel that stands above a neighbour.
#[derive(Clone, Copy, Debug)]
pub struct Exposed {
    /// Column and row.
    pub texel: [usize; 2],
    /// The neighbour that it stands above most, as a direction.
    pub outward: [i32; 2],
    /// Height of that neighbour.
    pub below: f32,
    /// How far above it, in metres.
    pub step: f32,
    /// Its column of walls; 0 before it has one.
    pub wall_column: u8,
}

/// The exposed texels of a block whose heights and exposure are set, row by row; `heights` has one texel more on each side.
pub fn exposed(map: &BlockMap, heights: &[f32]) -> Vec<Exposed> {
    let side = map.side_texels;
    let outer = side + 2;
    let mut found = Vec::new();
    for row in 0..side {
        for column in 0..side {
            let own = map.height(column, row);
            let neighbour = |[across, down]: [i32; 2]| {
                let (c, r) = (column as i32 + across, row as i32 + down);
                let inside = 0..side as i32;
                if inside.contains(&c) && inside.contains(&r) {
                    map.height(c as usize, r as usize)
                } else {
                    heights[(r + 1) as usize * outer + (c + 1) as usize]
                }
            };
            let mut lowest = ([0, 0], f32::INFINITY);
            for direction in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                let height = neighbour(direction);
                if height < lowest.1 {
                    lowest = (direction, height);
                }
            }
            let step = own - lowest.1;
            if step > map.exposure {
                found.push(Exposed {
                    texel: [column, row],
                    outward: lowest.0,
                    below: lowest.1,
                    step,
                    wall_column: 0,
                });
            }
        }
    }
    found
}

/// Parts the block into as few slices as give each exposed texel a column, and numbers the columns. Where there are not
/// enough, the least visible texels share the column of the one before them; returns how many do.
pub fn assign(map: &mut BlockMap, exposed: &mut [Exposed]) -> usize {
    map.slices = 1;
    while most_in_a_slice(map, exposed) > COLUMNS && map.slice_rows() / 2 >= LEAST_SLICE_ROWS {
        map.slices *= 2;
    }
    let rows = map.slice_rows();
    let mut shared = 0;
    for slice in exposed.chunk_by_mut(|one, other| one.texel[1] / rows == other.texel[1] / rows) {
        let excess = slice.len().saturating_sub(COLUMNS);
        // The first has a column of its own, so that there is one to share.
        let mut by_step: Vec<usize> = (1..slice.len()).collect();
        by_step.sort_by(|&one, &other| slice[one].step.total_cmp(&slice[other].step));
        let mut is_shared = vec![false; slice.len()];
        by_step[..excess]
            .iter()
            .for_each(|&index| is_shared[index] = true);
        shared += excess;
        let mut next = 0u8;
        for (texel, is_shared) in slice.iter_mut().zip(is_shared) {
            if !is_shared {
                next += 1;
            }
            texel.wall_column = next;
        }
    }
    for texel in exposed {
        let [column, row] = texel.texel;
        let [height, _, x, y] = map.at(column, row);
        map.set(column, row, [height, texel.wall_column, x, y]);
    }
    shared
}

fn most_in_a_slice(map: &BlockMap, exposed: &[Exposed]) -> usize {
    let mut counts = vec![0; map.slices];
    for texel in exposed {
        counts[texel.texel[1] / map.slice_rows()] += 1;
    }
    counts.into_iter().max().unwrap_or(0)
}
