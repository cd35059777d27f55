//! What the bench asks of a file that holds blocks by their ranks.

use std::path::Path;

/// Any failure; the bench only prints it.
pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// All blocks of a repository, by rank.
pub struct Blocks {
    pub bytes: Vec<u8>,
    /// Where each block ends.
    pub ends: Vec<usize>,
}

impl Blocks {
    pub fn iter(&self) -> impl Iterator<Item = (u64, &[u8])> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        let ranges = starts.zip(&self.ends).enumerate();
        ranges.map(|(rank, (start, &end))| (rank as u64, &self.bytes[start..end]))
    }
}

/// An open file, shared by threads.
pub trait Engine: Sized + Sync {
    const NAME: &'static str;

    /// What one thread reads through.
    type Session<'a>: Session
    where
        Self: 'a;

    /// Puts all blocks into a new file, as densely as the engine can.
    fn write(path: &Path, blocks: &Blocks) -> Result<()>;

    /// Opens the file for reading.
    fn open(path: &Path) -> Result<Self>;

    /// Lets one thread read.
    fn read<R>(&self, run: impl FnOnce(&mut Self::Session<'_>) -> Result<R>) -> Result<R>;
}

/// One thread's way to the blocks. What outlives a look-up (transaction, prepared statement) is made once.
pub trait Session {
    /// Gives `take` the block of a rank, which must exist, without a copy where the engine has it in one piece.
    fn get(&mut self, rank: u64, take: impl FnOnce(&[u8])) -> Result<()>;

    /// Gives `take` every block, by rank.
    fn scan(&mut self, take: impl FnMut(&[u8])) -> Result<()>;
}
