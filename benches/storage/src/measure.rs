//! How long what takes.

use std::fs::File;
use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use crate::engine::{Engine, Result, Session};

/// Look-ups between two looks at the clock.
const BATCH: usize = 32;
/// Look-ups of a thread in a round, and in each of the slices that threads begin together.
const LOOK_UPS: usize = 40 * SLICE;
const SLICE: usize = 160 * BATCH;
/// Look-ups that are timed one by one in a round.
const SINGLE: usize = 50_000;
/// Look-ups after the file left the page cache.
const COLD: usize = 200;
/// Look-ups of blocks that were not used since the file was opened.
const FIRST: usize = 20_000;
/// How often a file is opened.
const OPENED: usize = 300;

/// A small generator of numbers (xorshift64*); every engine gets the same sequence.
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 16
    }

    fn ranks(&mut self, count: usize, blocks: u64) -> Vec<u64> {
        (0..count).map(|_| self.next() % blocks).collect()
    }
}

/// What was measured of one engine. Times in nanoseconds.
#[derive(Default)]
pub struct Figures {
    pub name: &'static str,
    /// Of the file, less roots and tables of ours.
    pub bytes: u64,
    /// Until the root's values are there; of other engines, the first block.
    pub open: Vec<f64>,
    pub first_touch: Vec<f64>,
    /// Means of batches, of one thread alone and of one of two.
    pub gets: [Vec<f64>; 2],
    pub single: Vec<f64>,
    /// Look-ups a second of one and of two threads.
    pub rates: [Vec<f64>; 2],
    /// Empty where the page cache did not give the file up.
    pub cold: Vec<f64>,
    /// Bytes a second.
    pub scans: Vec<f64>,
}

/// Median cost of looking at the clock.
fn clock() -> f64 {
    let mut looks: Vec<f64> = (0..10_000)
        .map(|_| Instant::now().elapsed().as_nanos() as f64)
        .collect();
    quantile(&mut looks, 0.5)
}

/// The number that this share of all does not exceed.
pub fn quantile(numbers: &mut [f64], share: f64) -> f64 {
    numbers.sort_by(f64::total_cmp);
    let place = (numbers.len() as f64 * share).ceil() as usize;
    numbers
        .get(place.saturating_sub(1))
        .copied()
        .unwrap_or(f64::NAN)
}

/// Reads every byte.
fn touch(bytes: &[u8]) {
    let (words, rest) = bytes.as_chunks::<8>();
    let words = words.iter().map(|word| u64::from_ne_bytes(*word));
    let rest = rest.iter().map(|&byte| u64::from(byte));
    black_box(words.chain(rest).fold(0, u64::wrapping_add));
}

/// Times of single look-ups that read the whole block, less the clock's cost.
fn read_singly(session: &mut impl Session, ranks: &[u64]) -> Result<Vec<f64>> {
    let clock = clock();
    let mut times = Vec::with_capacity(ranks.len());
    for &rank in ranks {
        let start = Instant::now();
        session.get(rank, touch)?;
        times.push((start.elapsed().as_nanos() as f64 - clock).max(0.0));
    }
    Ok(times)
}

/// Opens a file again and again, then uses blocks for the first time since.
pub fn open<E: Engine>(path: &Path, blocks: u64, figures: &mut Figures) -> Result<()> {
    for _ in 0..OPENED {
        let start = Instant::now();
        let engine = E::open(path)?;
        engine.read(|session| session.get(0, |block| _ = black_box(block.first())))?;
        figures.open.push(start.elapsed().as_nanos() as f64);
    }
    // Far enough from each other that no two share a checksum.
    let count = (blocks / 64).clamp(1, FIRST as u64);
    let mut ranks: Vec<u64> = (0..count).map(|place| place * (blocks / count)).collect();
    let mut random = Random(3);
    for last in (1..ranks.len()).rev() {
        ranks.swap(last, random.next() as usize % (last + 1));
    }
    E::open(path)?.read(|session| {
        // SQLite reads its schema with the first of all.
        session.get(blocks - 1, touch)?;
        figures.first_touch = read_singly(session, &ranks)?;
        Ok(())
    })
}

/// Uses every block, so that pages are mapped and ours verified.
pub fn warm<E: Engine>(engine: &E, blocks: u64) -> Result<()> {
    engine.read(|session| {
        (0..blocks).try_for_each(|rank| session.get(rank, touch))?;
        session.scan(touch)
    })
}

/// One round of warm measurements.
pub fn round<E: Engine>(
    engine: &E,
    [blocks, payload]: [u64; 2],
    seed: u64,
    figures: &mut Figures,
) -> Result<()> {
    for threads in 1..=2 {
        let (times, rate) = run(engine, blocks, threads, seed)?;
        figures.gets[threads - 1].extend(times);
        figures.rates[threads - 1].push(rate);
    }
    engine.read(|session| {
        let clock = clock();
        for rank in Random(seed).ranks(SINGLE, blocks) {
            let start = Instant::now();
            session.get(rank, |block| _ = black_box(block))?;
            let time = start.elapsed().as_nanos() as f64 - clock;
            figures.single.push(time.max(0.0));
        }
        let start = Instant::now();
        session.scan(touch)?;
        let seconds = start.elapsed().as_secs_f64();
        figures.scans.push(payload as f64 / seconds);
        Ok(())
    })
}

/// Mean times of batches, of all threads, and look-ups a second of all threads together in the fastest slice: what
/// others do on the machine only ever slows one down.
fn run<E: Engine>(engine: &E, blocks: u64, threads: usize, seed: u64) -> Result<(Vec<f64>, f64)> {
    let arrived = AtomicUsize::new(0);
    let one = |thread: u64| {
        let ranks = Random(seed + 77 * thread).ranks(LOOK_UPS, blocks);
        let done = engine.read(|session| {
            let slices = ranks.chunks_exact(SLICE).enumerate();
            let slices = slices.map(|(slice, ranks)| {
                // All begin together, without sleeping.
                arrived.fetch_add(1, Ordering::Relaxed);
                while arrived.load(Ordering::Relaxed) < threads * (slice + 1) {
                    std::hint::spin_loop();
                }
                look_up(session, ranks)
            });
            slices.collect::<Result<Vec<_>>>()
        });
        if done.is_err() {
            arrived.store(usize::MAX / 2, Ordering::Relaxed);
        }
        done
    };
    let all = std::thread::scope(|scope| {
        let one = &one;
        let workers: Vec<_> = (0..threads as u64)
            .map(|thread| scope.spawn(move || one(thread)))
            .collect();
        let results = workers.into_iter().map(|worker| worker.join());
        results
            .map(|result| result.map_err(|_| "a thread panicked")?)
            .collect::<Result<Vec<_>>>()
    })?;
    let seconds = (0..LOOK_UPS / SLICE).filter_map(|slice| {
        let begin = all.iter().map(|slices| slices[slice].1).min()?;
        let end = all.iter().map(|slices| slices[slice].2).max()?;
        Some((end - begin).as_secs_f64())
    });
    let fastest = seconds.fold(f64::INFINITY, f64::min);
    let times = all.into_iter().flatten().flat_map(|(times, ..)| times);
    Ok((times.collect(), (threads * SLICE) as f64 / fastest))
}

/// Mean times of batches, and when the first began and the last ended.
fn look_up(session: &mut impl Session, ranks: &[u64]) -> Result<(Vec<f64>, Instant, Instant)> {
    let mut times = Vec::with_capacity(ranks.len() / BATCH);
    let begin = Instant::now();
    let mut last = begin;
    for batch in ranks.chunks_exact(BATCH) {
        for &rank in batch {
            session.get(rank, |block| _ = black_box(block))?;
        }
        let now = Instant::now();
        times.push((now - last).as_nanos() as f64 / BATCH as f64);
        last = now;
    }
    Ok((times, begin, last))
}

/// Look-ups in a file that nobody else has open, each after asking the system to forget what it can of the file: the system reads
/// ahead, and would soon have it all.
pub fn cold<E: Engine>(path: &Path, blocks: u64, figures: &mut Figures) -> Result<()> {
    let file = File::open(path)?;
    file.sync_all()?;
    let forget = || rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed);
    forget()?;
    let before = bytes_read();
    let engine = E::open(path)?;
    let times = engine.read(|session| {
        let mut times = Vec::with_capacity(COLD);
        for rank in Random(5).ranks(COLD, blocks) {
            forget()?;
            let start = Instant::now();
            session.get(rank, touch)?;
            times.push(start.elapsed().as_nanos() as f64);
        }
        Ok(times)
    })?;
    // Where hardly anything came from the medium, the pages were still there.
    let read = bytes_read().zip(before).map_or(0, |(now, then)| now - then);
    if read >= COLD as u64 / 2 * 4096 {
        figures.cold = times;
    }
    Ok(())
}

/// Bytes that this process caused to be read from a medium.
fn bytes_read() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/io").ok()?;
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("read_bytes: "))?;
    line.parse().ok()
}
