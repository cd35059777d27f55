//! Our file.

use std::path::Path;

use kimberlite::cut::Layer;
use kimberlite::store::{Access, Store};

use crate::engine::{Blocks, Engine, Result, Session};

/// A repository, its root decoded.
pub struct Repository(Layer);

impl Engine for Repository {
    const NAME: &'static str = "kimberlite";
    type Session<'a> = Reader<'a>;

    fn write(_: &Path, _: &Blocks) -> Result<()> {
        Err("the repository is what the blocks come from".into())
    }

    fn open(path: &Path) -> Result<Repository> {
        Ok(Repository(Layer::open(path, Access::Map)?))
    }

    fn read<R>(&self, run: impl FnOnce(&mut Reader<'_>) -> Result<R>) -> Result<R> {
        run(&mut Reader {
            store: self.0.store(),
            scratch: Vec::new(),
        })
    }
}

pub struct Reader<'a> {
    store: &'a Store,
    scratch: Vec<u8>,
}

impl Session for Reader<'_> {
    fn get(&mut self, rank: u64, take: impl FnOnce(&[u8])) -> Result<()> {
        take(self.store.block(rank, &mut self.scratch)?);
        Ok(())
    }

    fn scan(&mut self, mut take: impl FnMut(&[u8])) -> Result<()> {
        for rank in 0..self.store.header().block_count {
            take(self.store.block(rank, &mut self.scratch)?);
        }
        Ok(())
    }
}
