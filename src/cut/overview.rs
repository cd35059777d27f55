//! Ranges of the squares around tiles, kept where rays find them at once.

use crate::lattice::Lattice;

/// Most squares of one size along a side of the table: those of neighbouring tiles do not displace each other.
const SIDE: usize = 128;
/// The same of the largest squares.
const LEAST_SIDE: usize = 8;

/// A square that was asked for.
#[derive(Clone, Copy)]
pub(super) struct Square {
    key: u64,
    /// Least and greatest world height in it.
    pub range: [f32; 2],
    /// Where its tile is kept, if it is one.
    pub tile: usize,
}

/// Squares of 2^step cells a side: those of the even levels' diamonds. Each has one slot, which it shares with others far away.
pub(super) struct Overview {
    squares: Box<[Square]>,
    /// First slot of each size, and the bits of its side.
    sections: Vec<(usize, u32)>,
    finest: u32,
    /// Least and greatest world height of all.
    pub range: [f64; 2],
}

impl Overview {
    pub(super) fn new(lattice: &Lattice, range: [f64; 2]) -> Overview {
        let depth = lattice.levels() / 2;
        let mut count = 0;
        let sections = (0..=depth).map(|coarser| {
            let most = (SIDE >> coarser.min(31)).max(LEAST_SIDE).ilog2();
            let bits = most.min(depth - coarser);
            count += 1usize << (2 * bits);
            (count - (1 << (2 * bits)), bits)
        });
        let sections = sections.collect();
        let none = Square {
            key: u64::MAX,
            range: [0.0; 2],
            tile: usize::MAX,
        };
        Overview {
            squares: vec![none; count].into_boxed_slice(),
            sections,
            finest: lattice.cells_log2(),
            range,
        }
    }

    fn slot(&self, step: u32, cell: [i32; 2]) -> (usize, u64) {
        let [x, y] = cell.map(|along| (along >> step) as u64);
        let (first, bits) = self.sections[(step - self.finest) as usize];
        let mask = (1u64 << bits) - 1;
        let index = first + (((y & mask) << bits) | (x & mask)) as usize;
        (index, (u64::from(step) << 58) | (y << 29) | x)
    }

    /// What is known of the square around a cell.
    #[inline]
    pub(super) fn get(&mut self, step: u32, cell: [i32; 2]) -> Option<&mut Square> {
        let (index, key) = self.slot(step, cell);
        let square = &mut self.squares[index];
        (square.key == key).then_some(square)
    }

    pub(super) fn put(&mut self, step: u32, cell: [i32; 2], range: [f32; 2]) -> &Square {
        let (index, key) = self.slot(step, cell);
        self.squares[index] = Square {
            key,
            range,
            tile: usize::MAX,
        };
        &self.squares[index]
    }
}
