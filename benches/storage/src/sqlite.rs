//! SQLite, mapped, with a prepared statement for each thread.

use std::path::{Path, PathBuf};

use rusqlite::{CachedStatement, Connection, OpenFlags, params};

use crate::engine::{Blocks, Engine, Result, Session};

pub struct Sqlite {
    path: PathBuf,
    /// That of the thread that opened the file.
    first: std::sync::Mutex<Option<Connection>>,
}

fn connect(path: &Path) -> Result<Connection> {
    let size = std::fs::metadata(path)?.len();
    let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
    connection.pragma_update(None, "mmap_size", size as i64)?;
    Ok(connection)
}

impl Engine for Sqlite {
    const NAME: &'static str = "SQLite";
    type Session<'a> = Reader<'a>;

    fn write(path: &Path, blocks: &Blocks) -> Result<()> {
        let mut connection = Connection::open(path)?;
        let table = "create table blocks (rank integer primary key, bytes blob not null)";
        connection.execute(table, [])?;
        let transaction = connection.transaction()?;
        {
            let mut insert = transaction.prepare("insert into blocks values (?1, ?2)")?;
            for (rank, block) in blocks.iter() {
                insert.execute(params![rank as i64, block])?;
            }
        }
        transaction.commit()?;
        connection.execute("vacuum", [])?;
        Ok(())
    }

    fn open(path: &Path) -> Result<Sqlite> {
        Ok(Sqlite {
            path: path.to_path_buf(),
            first: Some(connect(path)?).into(),
        })
    }

    fn read<R>(&self, run: impl FnOnce(&mut Reader<'_>) -> Result<R>) -> Result<R> {
        let first = self.first.lock().map_or(None, |mut first| first.take());
        let connection = match first {
            Some(connection) => connection,
            None => connect(&self.path)?,
        };
        // Else every look-up would lock the file and unlock it.
        connection.execute_batch("begin")?;
        let get = connection.prepare_cached("select bytes from blocks where rank = ?1")?;
        run(&mut Reader {
            connection: &connection,
            get,
        })
    }
}

pub struct Reader<'a> {
    connection: &'a Connection,
    get: CachedStatement<'a>,
}

impl Session for Reader<'_> {
    fn get(&mut self, rank: u64, take: impl FnOnce(&[u8])) -> Result<()> {
        let mut rows = self.get.query(params![rank as i64])?;
        let row = rows.next()?.ok_or("no block")?;
        take(row.get_ref(0)?.as_blob()?);
        Ok(())
    }

    fn scan(&mut self, mut take: impl FnMut(&[u8])) -> Result<()> {
        let mut scan = self
            .connection
            .prepare("select bytes from blocks order by rank")?;
        let mut rows = scan.query([])?;
        while let Some(row) = rows.next()? {
            take(row.get_ref(0)?.as_blob()?);
        }
        Ok(())
    }
}
