//! Repositories to be written, and helpers that all tests of the store share.

use std::path::{Path, PathBuf};

use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::store::{
    Access, DomainKind, EntropyKind, HEADER_LENGTH, Header, Kind, Sink, Store, TransformKind,
    Writer,
};
use kimberlite::{Error, Result};
use tempfile::TempDir;

pub const BOTH: [Access; 2] = [Access::Map, Access::Positioned];

/// Everything that one repository holds.
#[derive(Clone, Debug)]
pub struct Content {
    pub header: Header,
    pub roots: Vec<u8>,
    pub tables: Vec<u8>,
    pub blocks: Vec<Vec<u8>>,
    pub codes: Vec<[u8; 3]>,
}

impl Content {
    /// Blocks of 0 to 12 bytes, no two groups alike.
    pub fn small(block_count: u64) -> Content {
        let blocks = (0..block_count).map(|rank| vec![rank as u8 ^ 0x5a; (rank * 5 % 13) as usize]);
        let codes = (0..block_count).map(|rank| [rank as u8, !rank as u8, rank as u8 ^ 0x33]);
        Content {
            header: header(block_count),
            roots: b"roots".to_vec(),
            tables: b"tables!".to_vec(),
            blocks: blocks.collect(),
            codes: codes.collect(),
        }
    }

    pub fn write(&self, path: &Path) -> Result<u64> {
        let writer = Writer::create(path, &self.header, &self.roots, &self.tables)?;
        self.fill(writer)
    }

    pub fn write_to_sink(&self, path: &Path, sink: Box<dyn Sink>) -> Result<u64> {
        let writer = Writer::with_sink(path, sink, &self.header, &self.roots, &self.tables)?;
        self.fill(writer)
    }

    fn fill(&self, mut writer: Writer) -> Result<u64> {
        for block in &self.blocks {
            writer.push(block)?;
        }
        writer.finish(&self.header, &self.codes)
    }

    /// The file's bytes.
    pub fn bytes(&self) -> Vec<u8> {
        let folder = Folder::new();
        self.write(&folder.file()).unwrap();
        std::fs::read(folder.file()).unwrap()
    }

    /// A block as it is stored, with its padding.
    pub fn padded(&self, rank: usize) -> Vec<u8> {
        let unit = usize::from(self.header.block_length_unit);
        let mut block = self.blocks[rank].clone();
        block.resize(block.len().next_multiple_of(unit), 0);
        block
    }

    /// Whether a store that opened gives back this content, or says `Damaged`. Panics on anything else.
    pub fn assert_right_or_damaged(&self, store: &Store) {
        let mut scratch = Vec::new();
        for rank in 0..self.blocks.len() {
            match store.block(rank as u64, &mut scratch) {
                Ok(block) => assert_eq!(block, self.padded(rank), "block {rank}"),
                Err(error) => assert!(matches!(error, Error::Damaged { .. }), "{error}"),
            }
        }
    }

    /// That a store gives back this content.
    pub fn assert_held_by(&self, store: &Store) {
        assert_eq!(
            format!("{:?}", store.header()),
            format!("{:?}", self.header)
        );
        assert_eq!(store.roots(), self.roots);
        assert_eq!(store.tables(), self.tables);
        let mut scratch = Vec::new();
        for (rank, codes) in self.codes.iter().enumerate() {
            let block = store.block(rank as u64, &mut scratch).unwrap();
            assert_eq!(block, self.padded(rank), "block {rank}");
            let length = block.len();
            let record = store.record(rank as u64).unwrap();
            assert_eq!(record.length as usize, length);
            assert_eq!(
                [record.error_code, record.low_code, record.high_code],
                *codes
            );
        }
        assert!(store.verify().is_sound());
        assert!(matches!(
            store.record(self.header.block_count),
            Err(Error::Argument(_))
        ));
        assert!(matches!(
            store.block(u64::MAX, &mut scratch),
            Err(Error::Argument(_))
        ));
    }
}

pub fn header(block_count: u64) -> Header {
    let mut raster = RasterInfo::new(257, 129, SampleType::I16);
    raster.crs = "EPSG:26910".to_owned();
    raster.units = "dm".to_owned();
    raster
        .metadata
        .insert("tiff.34735".to_owned(), vec![1, 0, 1, 0, 2]);
    raster.nodata = Some(-32768.0);
    Header {
        kind: Kind::Heights,
        domain: DomainKind::Planar,
        transform: TransformKind::Interpolating,
        entropy: EntropyKind::Gamma,
        cells_log2: 6,
        levels: 4,
        lossless: false,
        block_length_unit: 1,
        bound_units: 10,
        unit_min: -5,
        unit_max: 43_000,
        unit_scale: 1.0,
        unit_offset: 0.0,
        sample_min: -5.0,
        sample_max: 43_000.0,
        max_error_bound: 10.5,
        max_error: 10.0,
        rms_error: 3.25,
        samples: 257 * 129,
        void_samples: 7,
        block_count,
        raster,
    }
}

/// A folder of its own, with room for one repository.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Folder {
        Folder(TempDir::new().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn file(&self) -> PathBuf {
        self.0.path().join("terrain.kmb")
    }

    /// Names of all files in the folder.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    /// Opens bytes as a repository.
    pub fn open(&self, bytes: &[u8], access: Access) -> Result<Store> {
        // A new file every time: an older one may still be mapped.
        let _ = std::fs::remove_file(self.file());
        std::fs::write(self.file(), bytes).unwrap();
        Store::open(&self.file(), access)
    }
}

/// The one line that opening these bytes fails with, the same for both readers.
pub fn open_error(bytes: &[u8]) -> String {
    let folder = Folder::new();
    let [map, positioned] = BOTH.map(|access| folder.open(bytes, access).unwrap_err().to_string());
    assert_eq!(map, positioned);
    assert!(!map.contains('\n'));
    let prefix = format!("{}: ", folder.file().display());
    map.strip_prefix(&prefix)
        .expect("the error names the file")
        .to_owned()
}

/// Puts `field` at `offset` of a file's header and makes the header's checksum right again.
pub fn patch_header(bytes: &mut [u8], offset: usize, field: &[u8]) {
    bytes[offset..offset + field.len()].copy_from_slice(field);
    let end = HEADER_LENGTH - 4;
    let checksum = crc32fast::hash(&bytes[..end]);
    bytes[end..end + 4].copy_from_slice(&checksum.to_le_bytes());
}

/// The number at `offset` of a file.
pub fn u64_at(bytes: &[u8], offset: usize) -> u64 {
    u64::from_le_bytes(bytes[offset..offset + 8].try_into().unwrap())
}
