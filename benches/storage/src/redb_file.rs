//! redb, with a cache that holds the whole file.

use std::path::Path;

use redb::{Builder, Database, ReadOnlyTable, ReadableTable, TableDefinition};

use crate::engine::{Blocks, Engine, Result, Session};

const BLOCKS: TableDefinition<u64, &[u8]> = TableDefinition::new("blocks");

pub struct Redb(Database);

/// A cache twice as large as the blocks.
fn builder(bytes: u64) -> Builder {
    let mut builder = Builder::new();
    builder.set_cache_size((2 * bytes as usize).max(64 << 20));
    builder
}

impl Engine for Redb {
    const NAME: &'static str = "redb";
    type Session<'a> = Reader;

    fn write(path: &Path, blocks: &Blocks) -> Result<()> {
        let mut database = builder(blocks.bytes.len() as u64).create(path)?;
        let transaction = database.begin_write()?;
        {
            let mut table = transaction.open_table(BLOCKS)?;
            for (rank, block) in blocks.iter() {
                table.insert(rank, block)?;
            }
        }
        transaction.commit()?;
        database.compact()?;
        Ok(())
    }

    fn open(path: &Path) -> Result<Redb> {
        Ok(Redb(builder(std::fs::metadata(path)?.len()).open(path)?))
    }

    fn read<R>(&self, run: impl FnOnce(&mut Reader) -> Result<R>) -> Result<R> {
        run(&mut Reader(self.0.begin_read()?.open_table(BLOCKS)?))
    }
}

pub struct Reader(ReadOnlyTable<u64, &'static [u8]>);

impl Session for Reader {
    fn get(&mut self, rank: u64, take: impl FnOnce(&[u8])) -> Result<()> {
        take(self.0.get(rank)?.ok_or("no block")?.value());
        Ok(())
    }

    fn scan(&mut self, mut take: impl FnMut(&[u8])) -> Result<()> {
        for entry in self.0.iter()? {
            take(entry?.1.value());
        }
        Ok(())
    }
}
