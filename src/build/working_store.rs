//! The working store of a build that does not fit its memory: a folder beside the output, from which a build
//! that was killed goes on. redb keeps what is known to be whole in its files.

use crate::{Error, Result};
use redb::{Database, DatabaseError, TableDefinition, TableError};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What an input and the options are told by: names and values.
pub type Identity = Vec<(String, String)>;

const ENTRIES: TableDefinition<&str, &[u8]> = TableDefinition::new("entries");
/// The entry of the identity.
const IDENTITY: &str = "identity";
/// The file of the entries.
const DATABASE: &str = "store.redb";
/// Bytes of memory for redb.
const CACHE: usize = 4 << 20;

/// An open working store. One process at a time has it.
pub(super) struct WorkingStore {
    pub(super) folder: PathBuf,
    database: Database,
}

impl WorkingStore {
    /// Opens the store of the output, which must be of the same identity, or begins one.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] where another build has it or an unfinished one of another identity left it, and says
    /// what differs; [`Error::Io`]; [`Error::Damaged`].
    pub(super) fn open(output: &Path, identity: &Identity) -> Result<WorkingStore> {
        let folder = folder_for(output);
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder, "cannot make the folder"))?;
        let path = folder.join(DATABASE);
        let create = || Database::builder().set_cache_size(CACHE).create(&path);
        let opened = match create() {
            Err(error) if !is_in_use(&error) && is_just_begun(&folder) => {
                std::fs::remove_file(&path).map_err(Error::io(&path, "cannot remove"))?;
                create()
            }
            opened => opened,
        };
        let database = opened.map_err(|error| {
            if is_in_use(&error) {
                return Error::Argument(format!("{}: another build is using it", folder.display()));
            }
            damaged(&folder, error)
        })?;
        let store = WorkingStore { folder, database };
        match store.get(IDENTITY)? {
            None => store.put(&[(IDENTITY.to_owned(), lines(identity).into_bytes())])?,
            Some(found) => store.compare(&String::from_utf8_lossy(&found), identity)?,
        }
        Ok(store)
    }

    fn compare(&self, found: &str, identity: &Identity) -> Result<()> {
        let given = lines(identity);
        if found == given {
            return Ok(());
        }
        let differs = |(a, b): &(&str, &str)| a != b;
        let pairs = found.lines().zip(given.lines()).filter(differs);
        let mut pairs = pairs.map(|(found, given)| format!("it has {found}, not {given}"));
        let differences = match pairs.next() {
            Some(first) => pairs.fold(first, |all, next| format!("{all}; {next}")),
            None => "it has other inputs".to_owned(),
        };
        Err(Error::Argument(format!(
            "{} holds an unfinished build of other data: {differences}: finish that one, or remove it by kmb clean",
            self.folder.display()
        )))
    }

    /// An entry.
    pub(super) fn get(&self, key: &str) -> Result<Option<Vec<u8>>> {
        let transaction = self.database.begin_read();
        let transaction = transaction.map_err(|error| self.damaged(error))?;
        let table = match transaction.open_table(ENTRIES) {
            Err(TableError::TableDoesNotExist(_)) => return Ok(None),
            table => table.map_err(|error| self.damaged(error))?,
        };
        let value = table.get(key).map_err(|error| self.damaged(error))?;
        Ok(value.map(|value| value.value().to_vec()))
    }

    /// Puts entries, all or none of them.
    pub(super) fn put(&self, entries: &[(String, Vec<u8>)]) -> Result<()> {
        let transaction = self.database.begin_write();
        let transaction = transaction.map_err(|error| self.damaged(error))?;
        {
            let table = transaction.open_table(ENTRIES);
            let mut table = table.map_err(|error| self.damaged(error))?;
            for (key, value) in entries {
                let put = table.insert(&**key, &**value);
                put.map_err(|error| self.damaged(error))?;
            }
        }
        transaction.commit().map_err(|error| self.damaged(error))
    }

    fn damaged(&self, error: impl Into<redb::Error>) -> Error {
        damaged(&self.folder, error)
    }
}

/// Removes the folder of a working store. The database is the first to go: a removal that is cut short leaves files that
/// mean nothing, and the next build begins anew among them.
pub(super) fn remove(folder: &Path) -> Result<()> {
    let database = folder.join(DATABASE);
    let removed = match std::fs::remove_file(&database) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        removed => removed,
    };
    removed
        .and_then(|()| std::fs::remove_dir_all(folder))
        .map_err(Error::io(folder, "cannot remove"))
}

/// Removes what unfinished builds of an output left: the working store, and temporary files with its name. Not for
/// while one is running: only a working store tells that. Returns what was removed.
///
/// # Errors
///
/// [`Error::Argument`] where a build is using the store; [`Error::Io`].
pub fn clean(output: &Path) -> Result<Vec<PathBuf>> {
    let (folder, parent) = (folder_for(output), super::workspace::folder_of(output));
    let mut removed = Vec::new();
    if folder.is_dir() {
        let path = folder.join(DATABASE);
        if path.exists() && Database::open(&path).is_err_and(|error| is_in_use(&error)) {
            let message = format!("{}: a build is using it", folder.display());
            return Err(Error::Argument(message));
        }
        remove(&folder)?;
        removed.push(folder);
    }
    let prefix = dotted(output, ".");
    let entries = std::fs::read_dir(&parent).map_err(Error::io(&parent, "cannot list"))?;
    for entry in entries {
        let path = entry.map_err(Error::io(&parent, "cannot list"))?.path();
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        let middle = name.strip_prefix(prefix.as_encoded_bytes());
        let middle = middle.and_then(|rest| rest.strip_suffix(b".part"));
        // A dot would be one of another output's name.
        if middle.is_some_and(|middle| !middle.contains(&b'.')) {
            std::fs::remove_file(&path).map_err(Error::io(&path, "cannot remove"))?;
            removed.push(path);
        }
    }
    Ok(removed)
}

/// The folder of an output's working store.
pub(super) fn folder_for(output: &Path) -> PathBuf {
    super::workspace::folder_of(output).join(dotted(output, ".work"))
}

fn is_in_use(error: &DatabaseError) -> bool {
    matches!(error, DatabaseError::DatabaseAlreadyOpen)
}

/// Whether nothing but the database is there: its maker was killed before it put anything, perhaps half-way.
fn is_just_begun(folder: &Path) -> bool {
    let mut entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.all(|entry| entry.file_name() == DATABASE)
}

/// `.NAME` and an end.
fn dotted(output: &Path, end: &str) -> OsString {
    let mut name = OsString::from(".");
    name.push(output.file_name().unwrap_or_default());
    name.push(end);
    name
}

fn lines(identity: &Identity) -> String {
    let lines = identity.iter().map(|(name, value)| {
        let value = value.replace('\n', " ");
        format!("{name} {value}\n")
    });
    lines.collect()
}

fn damaged(folder: &Path, error: impl Into<redb::Error>) -> Error {
    match error.into() {
        redb::Error::Io(source) => Error::io(folder, "cannot use the working store")(source),
        error => Error::damaged(
            folder,
            format!("the working store of an unfinished build: {error}: remove it by kmb clean"),
        ),
    }
}
