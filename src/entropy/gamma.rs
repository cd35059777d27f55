//! Square matrices of integers as a quadtree with Elias gamma codes (Di Benedetto 2011, 3.4.1).
//!
//! The tree is walked depth first: upper left, upper right, lower left, lower right quadrant. Each
//! quadrant, from the whole matrix down to 2 x 2, begins with one bit: 0 when it holds only
//! zeros, which ends it. A 2 x 2 quadrant that goes on has its entries row by row, each
//! mapped 0, -1, 1, -2, ... to 1, 2, 3, 4, ... and written as an Elias gamma code.
//!
//! Both sides may know a mask of the entries that are coded. The others decode as 0 and cost
//! nothing, nor does a quadrant that has none that is coded.

use super::Error;
use super::bits::{BitReader, BitWriter};

/// Appends a row-major matrix of `side` x `side` coefficients. `coded`, of the same shape, is not 0
/// where an entry is coded; without it all are.
///
/// # Panics
/// If `side` is not a power of two from 2 to 2^15, or a slice is not `side` x `side`.
pub fn encode(coefficients: &[i32], side: usize, coded: Option<&[u8]>, out: &mut BitWriter) {
    let tree = Tree::new(side, &[Some(coefficients.len()), coded.map(<[u8]>::len)]);
    let is_coded = |entry: usize| coded.is_none_or(|mask| mask[entry] != 0);
    let some_coded = coded.map(|mask| tree.any(|entry| mask[entry] != 0));
    let some_nonzero = tree.any(|entry| coefficients[entry] != 0 && is_coded(entry));
    let mut next = Some(tree.root());
    while let Some(quadrant) = next {
        let node = tree.node(quadrant);
        if some_coded.as_ref().is_some_and(|some| !some[node]) {
            next = tree.after(quadrant);
            continue;
        }
        out.put(u64::from(some_nonzero[node]), 1);
        if some_nonzero[node] && quadrant.level > 0 {
            next = Some(quadrant.first_child());
            continue;
        }
        if some_nonzero[node] {
            for entry in tree.entries(quadrant) {
                if is_coded(entry) {
                    put_gamma(coefficients[entry], out);
                }
            }
        }
        next = tree.after(quadrant);
    }
}

/// Reads what [`encode`] wrote with the same `side` and `coded` into `coefficients`. Takes time
/// bounded by the matrix, whatever the bytes; does not check that nothing follows
/// ([`BitReader::finish`] does).
///
/// # Errors
/// [`Error::Truncated`], [`Error::Overlong`]; `coefficients` then hold anything.
///
/// # Panics
/// As [`encode`].
pub fn decode(
    input: &mut BitReader,
    side: usize,
    coded: Option<&[u8]>,
    coefficients: &mut [i32],
) -> Result<(), Error> {
    let tree = Tree::new(side, &[Some(coefficients.len()), coded.map(<[u8]>::len)]);
    let is_coded = |entry: usize| coded.is_none_or(|mask| mask[entry] != 0);
    let some_coded = coded.map(|mask| tree.any(|entry| mask[entry] != 0));
    coefficients.fill(0);
    let mut next = Some(tree.root());
    while let Some(quadrant) = next {
        let skipped = some_coded
            .as_ref()
            .is_some_and(|some| !some[tree.node(quadrant)]);
        if skipped || input.get(1) == 0 {
            next = tree.after(quadrant);
        } else if quadrant.level > 0 {
            next = Some(quadrant.first_child());
        } else {
            let mut window = Window::new(input);
            for entry in tree.entries(quadrant) {
                if is_coded(entry) {
                    coefficients[entry] = window.get_gamma(input)?;
                }
            }
            next = tree.after(quadrant);
        }
    }
    if input.exhausted() {
        Err(Error::Truncated)
    } else {
        Ok(())
    }
}

#[inline]
fn put_gamma(value: i32, out: &mut BitWriter) {
    let zigzag = ((value << 1) ^ (value >> 31)) as u32;
    let number = u64::from(zigzag) + 1;
    let zeros = number.ilog2();
    if zeros < 32 {
        out.put(number, 2 * zeros + 1);
    } else {
        out.put(0, zeros);
        out.put(number, zeros + 1);
    }
}

/// Bits of the input at hand, so that several short codes need one look at it.
struct Window {
    /// The next bits, from the top.
    bits: u64,
    /// How many of them are sure to be there.
    sure: u32,
}

impl Window {
    fn new(input: &BitReader) -> Window {
        Window {
            bits: input.peek(),
            sure: BitReader::PEEKED,
        }
    }

    #[inline]
    fn get_gamma(&mut self, input: &mut BitReader) -> Result<i32, Error> {
        let mut length = 2 * self.bits.leading_zeros() + 1;
        if length > self.sure {
            *self = Window::new(input);
            length = 2 * self.bits.leading_zeros() + 1;
            if length > self.sure {
                let number = get_long(input, self.bits.leading_zeros())?;
                *self = Window::new(input);
                return Ok(unmap(number));
            }
        }
        let number = self.bits >> (64 - length);
        self.bits <<= length;
        self.sure -= length;
        input.skip(length);
        Ok(unmap(number))
    }
}

/// The coefficient that a number from 1 to 2^32 stands for.
#[inline]
fn unmap(number: u64) -> i32 {
    let zigzag = (number - 1) as u32;
    (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
}

#[cold]
fn get_long(input: &mut BitReader, zeros: u32) -> Result<u64, Error> {
    let position = input.position();
    input.skip(zeros.min(33));
    let number = input.get(zeros.min(32) + 1);
    if input.exhausted() {
        Err(Error::Truncated)
    } else if zeros > 32 || number > 1 << 32 {
        Err(Error::Overlong { position })
    } else {
        Ok(number)
    }
}

/// A square quadrant of 4^level leaves of 2 x 2 entries.
#[derive(Clone, Copy)]
struct Quadrant {
    level: u32,
    /// Its first leaf, in Morton order.
    leaf: usize,
}

impl Quadrant {
    fn first_child(self) -> Quadrant {
        Quadrant {
            level: self.level - 1,
            leaf: self.leaf,
        }
    }
}

/// The quadtree over a matrix. Leaves in Morton order make every quadrant a run of leaves, so that
/// the walk needs no stack.
struct Tree {
    side: usize,
    levels: u32,
}

impl Tree {
    fn new(side: usize, lengths: &[Option<usize>]) -> Tree {
        assert!(
            side.is_power_of_two() && (2..=1 << 15).contains(&side),
            "side {side}"
        );
        for length in lengths.iter().flatten() {
            assert_eq!(*length, side * side, "entries of a matrix of side {side}");
        }
        Tree {
            side,
            levels: side.ilog2() - 1,
        }
    }

    fn leaves(&self) -> usize {
        1 << (2 * self.levels)
    }

    fn root(&self) -> Quadrant {
        Quadrant {
            level: self.levels,
            leaf: 0,
        }
    }

    /// The quadrant that follows when `quadrant` and all inside it are done: the largest that begins
    /// there, since whatever is larger has begun earlier.
    #[inline]
    fn after(&self, quadrant: Quadrant) -> Option<Quadrant> {
        let leaf = quadrant.leaf + (1 << (2 * quadrant.level));
        (leaf < self.leaves()).then(|| Quadrant {
            level: leaf.trailing_zeros() / 2,
            leaf,
        })
    }

    /// Index in an array of all quadrants, coarse to fine, where node n has the children 4n + 1 to
    /// 4n + 4.
    #[inline]
    fn node(&self, quadrant: Quadrant) -> usize {
        nodes_above(self.levels - quadrant.level) + (quadrant.leaf >> (2 * quadrant.level))
    }

    /// The four entries of a leaf in the matrix, row by row.
    #[inline]
    fn entries(&self, leaf: Quadrant) -> [usize; 4] {
        let (row, column) = (2 * even_bits(leaf.leaf >> 1), 2 * even_bits(leaf.leaf));
        let first = row * self.side + column;
        [first, first + 1, first + self.side, first + self.side + 1]
    }

    /// For every node, whether it has an entry with this property.
    fn any(&self, property: impl Fn(usize) -> bool) -> Vec<bool> {
        let inner = nodes_above(self.levels);
        let mut some = vec![false; inner + self.leaves()];
        for leaf in 0..self.leaves() {
            let entries = self.entries(Quadrant { level: 0, leaf });
            some[inner + leaf] = entries.into_iter().any(&property);
        }
        for node in (0..inner).rev() {
            some[node] = some[4 * node + 1..4 * node + 5].contains(&true);
        }
        some
    }
}

/// Nodes of a quadtree in its first `depth` levels: (4^depth - 1) / 3.
#[inline]
fn nodes_above(depth: u32) -> usize {
    0x5555_5555 & ((1 << (2 * depth)) - 1)
}

/// Bits 0, 2, 4, ... of a number below 2^32, moved together.
#[inline]
fn even_bits(number: usize) -> usize {
    let mut bits = number & 0x5555_5555;
    bits = (bits | (bits >> 1)) & 0x3333_3333;
    bits = (bits | (bits >> 2)) & 0x0f0f_0f0f;
    bits = (bits | (bits >> 4)) & 0x00ff_00ff;
    (bits | (bits >> 8)) & 0x0000_ffff
}
