//! Floor 2: the packed repository, one file of blocks by rank (`docs/format.md`). Knows neither what
//! the bytes of a block mean nor which diamond has which rank.
//!
//! | file | duty |
//! |---|---|
//! | `header.rs` | the header: what it says, and where the sections lie |
//! | `metadata.rs` | the compressed metadata section |
//! | `index.rs` | the layout of the index's pages |
//! | `fields.rs` | little-endian fields of untrusted bytes |
//! | `bytes.rs` | a file that is read by ranges: the trait, and opening |
//! | `map.rs`, `positioned.rs` | its two implementations |
//! | `memory.rs` | a repository that is only bytes, to read and to write |
//! | `reader.rs` | the reader |
//! | `verify.rs` | the check of a whole repository |
//! | `repair.rs` | a copy without what is damaged |
//! | `sink.rs` | a file that comes under its name only when it is whole |
//! | `writer.rs` | the writer |

mod bytes;
mod fields;
mod header;
mod index;
mod map;
mod memory;
mod metadata;
mod positioned;
mod reader;
mod repair;
mod sink;
mod verify;
mod writer;

pub use bytes::Access;
pub use header::{
    DomainKind, EntropyKind, HEADER_LENGTH, Header, Kind, MAGIC, READ_VERSION, SECTION_LIMIT,
    TransformKind, WRITE_VERSION,
};
pub use index::{BLOCKS_PER_GROUP, BLOCKS_PER_PAGE, Record};
pub use memory::MemorySink;
pub use reader::Store;
pub use repair::{Kept, Repaired};
pub use sink::{FileSink, Sink};
pub use verify::{Damage, DamagedPart, Verification};
pub use writer::{Writer, file_length};
