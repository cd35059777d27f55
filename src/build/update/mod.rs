//! A repository with other samples in a rectangle: of a lossless one, only the diamonds that the rectangle
//! reaches are coded again.

mod changes;
mod decoder;
mod errors;
mod ranges;
mod search;
mod survey;

use self::changes::Changes;
use self::decoder::Decoder;
use crate::codec::{BlockCodec, Matrix, RangeCode, Units};
use crate::lattice::Lattice;
use crate::schedule::thread_count;
use crate::store::{Header, Kind, Sink, Store, TransformKind, Writer};
use crate::{Error, Result};
use std::path::Path;

/// The share of all diamonds above which coding them all anew takes no longer, and how many may always change.
const MOST_CHANGED: u64 = 8;
const FEW_CHANGED: u64 = 32;

/// A repository of heights that is to be changed, and what reads it.
pub struct Predecessor<'a> {
    /// The file.
    pub store: &'a Store,
    /// Its diamonds.
    pub lattice: &'a Lattice,
    /// From samples to units.
    pub units: &'a Units,
    /// What decodes its blocks, with its weights and tables.
    pub codec: &'a BlockCodec,
    /// Its root's vertices.
    pub root: &'a Matrix,
}

/// New samples of a closed rectangle.
pub struct Replacement {
    /// Column and row of the first sample.
    first: [i64; 2],
    /// Column and row of the last one.
    last: [i64; 2],
    /// Row by row; a void is NaN.
    samples: Vec<f64>,
}

/// What a replacement changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replaced {
    /// Diamonds that were coded again.
    pub diamonds: u64,
    /// Bytes of the file.
    pub bytes: u64,
}

impl Replacement {
    /// Samples (row by row, NaN for a void) from column and row `first` on, `width` a row.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a number that is no sample of the raster's type, with its place.
    pub fn new(
        header: &Header,
        first: [u32; 2],
        width: u32,
        samples: Vec<f64>,
    ) -> Result<Replacement> {
        let sample_type = header.raster.sample_type;
        let is_other =
            |number: &f64| !(number.is_nan() || number.is_finite() && sample_type.holds(*number));
        if let Some(place) = samples.iter().position(is_other) {
            return Err(Error::Argument(format!(
                "the sample at column {}, row {} is {}, which is no {} height",
                u64::from(first[0]) + place as u64 % u64::from(width),
                u64::from(first[1]) + place as u64 / u64::from(width),
                samples[place],
                sample_type.name()
            )));
        }
        let first = first.map(i64::from);
        let rows = samples.len() as i64 / i64::from(width);
        Ok(Replacement {
            first,
            last: [first[0] + i64::from(width) - 1, first[1] + rows - 1],
            samples,
        })
    }

    fn corners(&self) -> [[i64; 2]; 2] {
        [self.first, self.last]
    }

    fn contains(&self, at: [i64; 2]) -> bool {
        (0..2).all(|axis| (self.first[axis]..=self.last[axis]).contains(&at[axis]))
    }

    /// The new sample at a place; `None` outside the rectangle.
    fn sample(&self, at: [i64; 2]) -> Option<f64> {
        let width = self.last[0] - self.first[0] + 1;
        let index = (at[1] - self.first[1]) * width + at[0] - self.first[0];
        self.contains(at).then(|| self.samples[index as usize])
    }

    /// The new height at a place, in units: `Some(None)` for a void, `None` outside the rectangle.
    fn height(&self, units: &Units, at: [i64; 2]) -> Option<Option<i32>> {
        let sample = self.sample(at)?;
        Some((!sample.is_nan()).then(|| units.to_unit(sample)))
    }

    /// All places of the rectangle, row by row.
    fn places(&self) -> impl Iterator<Item = [i64; 2]> {
        let [first, last] = self.corners();
        (first[1]..=last[1])
            .flat_map(move |row| (first[0]..=last[0]).map(move |column| [column, row]))
    }
}

/// Writes a repository like `old`, with other samples in a rectangle, into a sink, which `output` only names in
/// errors. The bytes are those of a build of all samples with the same options and the tables of `old`.
///
/// `None`, and nothing is published, where that build would code other diamonds otherwise too, so that all must be
/// coded again: where the file is not lossless, or colours, or of another transform than interpolating; where the
/// range of all samples changes, or whether there are voids, or the unit of floats; where samples are not
/// in the list of heights that came with the tables; and where the rectangle reaches more than 32 diamonds and an
/// eighth of all.
///
/// # Errors
///
/// Those of reading and decoding `old`, [`Error::Missing`] where a block was lost that is needed;
/// [`Error::Io`] of writing; [`Error::Cancelled`].
pub fn replace(
    old: &Predecessor,
    new: &Replacement,
    (output, sink): (&Path, Box<dyn Sink>),
    threads: usize,
    progress: &mut dyn FnMut(u64, u64) -> bool,
) -> Result<Option<Replaced>> {
    let (header, lattice) = (old.store.header(), old.lattice);
    let threads = thread_count(threads);
    let is_local = header.kind == Kind::Heights
        && header.transform == TransformKind::Interpolating
        && header.lossless
        && lattice.levels() > 0;
    if !is_local {
        return Ok(None);
    }
    let mut before = Decoder::before(old);
    let Some(void_samples) = survey::void_samples_after(old, new, &mut before, threads)? else {
        return Ok(None);
    };
    let count = lattice.diamond_count();
    let most = FEW_CHANGED.max(count / MOST_CHANGED);
    let Some(changes) = Changes::find(old, new, &mut before, most)? else {
        return Ok(None);
    };
    let mut step = |done: u64| match progress(done, 2 * count) {
        true => Ok(()),
        false => Err(Error::Cancelled),
    };
    step(changes.len() as u64)?;
    let header = Header {
        void_samples,
        ..header.clone()
    };
    let roots = changes.roots(old);
    let mut writer = Writer::with_sink(output, sink, &header, roots, old.store.tables())?;
    let mut copy = || {
        let mut scratch = Vec::new();
        for rank in 0..count {
            match changes.block(lattice.diamond(rank)) {
                Some(block) => writer.push(block)?,
                None => writer.push(old.store.block(rank, &mut scratch)?)?,
            }
            if rank.is_multiple_of(1024) {
                step(count + rank)?;
            }
        }
        writer.sync()
    };
    let find = || renewed_codes(old, new, &changes, before, threads);
    // The medium takes the blocks while codes are looked for.
    let (codes, copied) = match threads {
        1 => (find(), copy()),
        _ => std::thread::scope(|scope| {
            let codes = scope.spawn(find);
            let copied = copy();
            (joined(codes), copied)
        }),
    };
    copied?;
    step(2 * count)?;
    let bytes = writer.finish(&header, &codes?)?;
    Ok(Some(Replaced {
        diamonds: changes.len() as u64,
        bytes,
    }))
}

/// Error, low and high code of every diamond by rank.
fn renewed_codes(
    old: &Predecessor,
    new: &Replacement,
    changes: &Changes,
    before: Decoder,
    threads: usize,
) -> Result<Vec<[u8; 3]>> {
    let codes = (0..old.lattice.diamond_count())
        .map(|rank| {
            let record = old.store.record(rank)?;
            Ok([record.error_code, record.low_code, record.high_code])
        })
        .collect::<Result<Vec<[u8; 3]>>>()?;
    let errors = || errors::renewed(old, new, changes, before, &codes);
    let ranges = || ranges::renewed(old, changes, threads, &codes);
    let (errors, ranges) = match threads {
        1 => (errors(), ranges()),
        _ => std::thread::scope(|scope| {
            let errors = scope.spawn(errors);
            let ranges = ranges();
            (joined(errors), ranges)
        }),
    };
    let both = errors?.into_iter().zip(ranges?);
    Ok(both
        .map(|(error, RangeCode { low, high })| [error, low, high])
        .collect())
}

/// What a thread made; its panic goes on here.
fn joined<T>(thread: std::thread::ScopedJoinHandle<T>) -> T {
    thread
        .join()
        .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
