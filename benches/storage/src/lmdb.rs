//! LMDB, with its own integer keys.

use std::path::Path;

use heed::types::Bytes;
use heed::{Database, Env, EnvFlags, EnvOpenOptions, IntegerComparator, PutFlags, RoTxn, WithTls};

use crate::engine::{Blocks, Engine, Result, Session};

/// The ranks are integers of the machine, which LMDB compares as such.
type Ranked = Database<Bytes, Bytes, IntegerComparator>;

pub struct Lmdb {
    env: Env<WithTls>,
    blocks: Ranked,
}

fn open(path: &Path, size: usize, flags: EnvFlags) -> Result<Env<WithTls>> {
    let mut options = EnvOpenOptions::new();
    let page = 4096;
    options.map_size(size.next_multiple_of(page)).max_dbs(1);
    // SAFETY: the bench made the file, and nothing else writes to it while it is open.
    unsafe { options.flags(EnvFlags::NO_SUB_DIR | flags) };
    Ok(unsafe { options.open(path) }?)
}

impl Engine for Lmdb {
    const NAME: &'static str = "LMDB";
    type Session<'a> = Reader<'a>;

    fn write(path: &Path, blocks: &Blocks) -> Result<()> {
        let pages = blocks.bytes.len() + 3 * 4096 * (blocks.ends.len() + 1024);
        let env = open(path, pages, EnvFlags::empty())?;
        let mut transaction = env.write_txn()?;
        let database: Ranked = env
            .database_options()
            .types()
            .name("blocks")
            .key_comparator::<IntegerComparator>()
            .create(&mut transaction)?;
        for (rank, block) in blocks.iter() {
            let key = (rank as usize).to_ne_bytes();
            // In order, which fills its pages.
            database.put_with_flags(&mut transaction, PutFlags::APPEND, &key, block)?;
        }
        transaction.commit()?;
        env.prepare_for_closing().wait();
        Ok(())
    }

    fn open(path: &Path) -> Result<Lmdb> {
        let size = std::fs::metadata(path)?.len() as usize;
        let env = open(path, size, EnvFlags::READ_ONLY)?;
        let transaction = env.read_txn()?;
        let blocks = env
            .database_options()
            .types()
            .name("blocks")
            .key_comparator::<IntegerComparator>()
            .open(&transaction)?
            .ok_or("no blocks")?;
        transaction.commit()?;
        Ok(Lmdb { env, blocks })
    }

    fn read<R>(&self, run: impl FnOnce(&mut Reader<'_>) -> Result<R>) -> Result<R> {
        run(&mut Reader {
            transaction: self.env.read_txn()?,
            blocks: self.blocks,
        })
    }
}

pub struct Reader<'a> {
    transaction: RoTxn<'a, WithTls>,
    blocks: Ranked,
}

impl Session for Reader<'_> {
    fn get(&mut self, rank: u64, take: impl FnOnce(&[u8])) -> Result<()> {
        let key = (rank as usize).to_ne_bytes();
        take(
            self.blocks
                .get(&self.transaction, &key)?
                .ok_or("no block")?,
        );
        Ok(())
    }

    fn scan(&mut self, mut take: impl FnMut(&[u8])) -> Result<()> {
        for entry in self.blocks.iter(&self.transaction)? {
            take(entry?.1);
        }
        Ok(())
    }
}
