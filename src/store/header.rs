//! The header: what it says of the repository, and where the sections lie.

use super::fields::Fields;
use super::index;
use crate::geo::{RasterInfo, Registration, SampleType};
pub use crate::transform::TransformKind;
use crate::{Error, Result};

/// The first bytes of every repository. As in PNG's, a transfer as text breaks them.
pub const MAGIC: [u8; 8] = *b"\x89KMB\r\n\x1a\n";
/// The read version that this library writes, and the only one that it reads.
pub const READ_VERSION: u16 = 1;
/// The write version that this library writes. Files of others are only read.
pub const WRITE_VERSION: u16 = 1;
/// Bytes of the header that this library writes.
pub const HEADER_LENGTH: usize = 304;
/// Most bytes of the roots, of the tables, and of the metadata before and after decompression.
pub const SECTION_LIMIT: u64 = 16 << 20;

/// Bytes up to and including the header length, which every version shares.
pub(super) const PREFIX_LENGTH: usize = 16;
/// Longest header of any version.
const HEADER_LIMIT: u32 = 65536;
const CHECKSUM_LENGTH: usize = 4;
/// Levels of halving between the lattice's root square and its unit.
const LATTICE_BITS: u8 = 30;

const GEOREFERENCED: u16 = 1;
const GEOGRAPHIC: u16 = 2;
const HAS_NODATA: u16 = 4;
const LOSSLESS: u16 = 8;
const HAS_ALPHA: u16 = 16;
const HAS_MISSING: u16 = 32;

macro_rules! from_number {
    ($name:ident, $what:literal, $($variant:ident = $number:literal),+) => {
        impl TryFrom<u8> for $name {
            type Error = Error;

            fn try_from(number: u8) -> Result<$name> {
                match number {
                    $($number => Ok($name::$variant),)+
                    _ => Err(Error::Argument(format!(concat!("unknown ", $what, " {}"), number))),
                }
            }
        }
    };
}

macro_rules! numbered {
    ($(#[$docs:meta])* $name:ident, $what:literal,
        $($(#[$variant_docs:meta])* $variant:ident = $number:literal),+) => {
        $(#[$docs])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum $name { $($(#[$variant_docs])* $variant = $number),+ }

        from_number!($name, $what, $($variant = $number),+);
    };
}

numbered! {
    /// What a repository holds. The numbers of this and the other kinds are those of the file.
    Kind, "kind",
    /// One height a sample.
    Heights = 0,
    /// Three colour components a sample.
    Colours = 1,
    /// City blocks as textures.
    City = 2
}
numbered! {
    /// What the diamonds cover.
    DomainKind, "domain",
    /// A rectangle.
    Planar = 0,
    /// The surface of a cube, blown up to a sphere.
    CubeSphere = 1
}
impl Kind {
    /// Numbers of a sample.
    fn bands(self) -> u8 {
        match self {
            Kind::Colours => 3,
            Kind::Heights | Kind::City => 1,
        }
    }
}

from_number!(
    TransformKind,
    "transform",
    Interpolating = 0,
    Lifted = 1,
    TwoStage = 2
);
numbered! {
    /// How coefficients become bits.
    EntropyKind, "entropy coder",
    /// A quadtree with Elias gamma codes.
    Gamma = 0,
    /// Interleaved rANS with static tables.
    Rans = 1
}

/// What the header and the metadata of a repository say. Units, bounds and errors are explained in
/// `docs/design.md`; errors and ranges of samples are in the raster's own units.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// What the repository holds.
    pub kind: Kind,
    /// What its diamonds cover.
    pub domain: DomainKind,
    /// How samples became coefficients.
    pub transform: TransformKind,
    /// How coefficients became bits.
    pub entropy: EntropyKind,
    /// n, where a diamond has N = 2^n cells a side: 1 to 7.
    pub cells_log2: u8,
    /// Levels of refinement, 2K: even, with K + n at most 30.
    pub levels: u8,
    /// Whether the decoded samples equal the input's.
    pub lossless: bool,
    /// Bytes that a block's length is a multiple of: 1, or 4 or 8 where blocks may exceed 65534 bytes or four times as many.
    pub block_length_unit: u8,
    /// The quantiser's bound e, in units; of colours what the bounds of the components follow from.
    pub bound_units: u32,
    /// Least unit of the input, of colours of their luma; for [`TransformKind::Lifted`] of all decoded levels.
    pub unit_min: i32,
    /// Greatest unit of the same.
    pub unit_max: i32,
    /// sample = unit x `unit_scale` + `unit_offset`; finite and above 0.
    pub unit_scale: f64,
    /// See `unit_scale`; finite.
    pub unit_offset: f64,
    /// Least valid sample of the input.
    pub sample_min: f64,
    /// Greatest valid sample of the input.
    pub sample_max: f64,
    /// The max error that the build promised, or where it promised none, measured.
    pub max_error_bound: f64,
    /// The max error measured from the decoded bytes.
    pub max_error: f64,
    /// The root of the mean square error measured from the decoded bytes.
    pub rms_error: f64,
    /// Samples, valid and void.
    pub samples: u64,
    /// Void samples.
    pub void_samples: u64,
    /// Count of blocks; their ranks run from 0 to this.
    pub block_count: u64,
    /// Shape, type, georeference and metadata of the input, as they were given.
    pub raster: RasterInfo,
}

/// A range of the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Section {
    pub(super) offset: u64,
    pub(super) length: u64,
}

/// Where the sections lie, with the checksums of the first three, and whether any block is missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) metadata: Section,
    pub(super) roots: Section,
    pub(super) tables: Section,
    pub(super) index: Section,
    pub(super) blocks: Section,
    pub(super) checksums: [u32; 3],
    pub(super) file_length: u64,
    pub(super) has_missing: bool,
}

impl Layout {
    fn sections(&self) -> [(&'static str, Section); 5] {
        [
            ("metadata", self.metadata),
            ("roots", self.roots),
            ("tables", self.tables),
            ("index", self.index),
            ("blocks", self.blocks),
        ]
    }

    /// Says what contradicts the file's length or the header's numbers.
    fn check(&self, header: &Header, header_length: u64) -> std::result::Result<(), String> {
        let mut end = header_length;
        for (name, section) in self.sections() {
            let Section { offset, length } = section;
            if offset < end {
                return Err(format!(
                    "section {name} at {offset} overlaps what ends at {end}"
                ));
            }
            end = offset
                .checked_add(length)
                .filter(|end| *end <= self.file_length)
                .ok_or_else(|| {
                    let file = self.file_length;
                    format!("section {name}, {length} bytes at {offset}, exceeds the file's {file}")
                })?;
        }
        for (name, section) in self.sections().into_iter().take(3) {
            if section.length > SECTION_LIMIT {
                let length = section.length;
                return Err(format!(
                    "section {name} has {length} bytes, more than {SECTION_LIMIT}"
                ));
            }
        }
        let count = header.block_count;
        if index::section_length(count) != Some(self.index.length) {
            let length = self.index.length;
            return Err(format!(
                "an index of {length} bytes cannot hold {count} blocks"
            ));
        }
        let longest = u64::from(index::LONGEST_UNITS) * u64::from(header.block_length_unit);
        if self.blocks.length > count.saturating_mul(longest) {
            return Err(format!(
                "{count} blocks cannot have {} bytes",
                self.blocks.length
            ));
        }
        Ok(())
    }
}

impl Header {
    /// Says which number the format does not allow.
    pub(super) fn check(&self) -> std::result::Result<(), String> {
        let (cells_log2, levels) = (self.cells_log2, self.levels);
        let (scale, offset) = (self.unit_scale, self.unit_offset);
        let problem = if !(1..=7).contains(&cells_log2) {
            format!("2^{cells_log2} cells a side")
        } else if levels % 2 != 0 || levels / 2 + cells_log2 > LATTICE_BITS {
            format!("{levels} levels of 2^{cells_log2} cells")
        } else if !matches!(self.block_length_unit, 1 | 4 | 8) {
            format!("block length unit {}", self.block_length_unit)
        } else if self.raster.width == 0 || self.raster.height == 0 {
            format!("{} x {} samples", self.raster.width, self.raster.height)
        } else if self.unit_min > self.unit_max {
            format!("units from {} to {}", self.unit_min, self.unit_max)
        } else if !(scale > 0.0 && scale.is_finite() && offset.is_finite()) {
            format!("unit scale {scale}, offset {offset}")
        } else if self.void_samples > self.samples {
            format!("{} voids in {} samples", self.void_samples, self.samples)
        } else {
            return Ok(());
        };
        Err(format!("impossible: {problem}"))
    }

    fn flags(&self) -> u16 {
        let flag = |set: bool, bit: u16| if set { bit } else { 0 };
        flag(self.raster.georeferenced, GEOREFERENCED)
            | flag(self.raster.geographic, GEOGRAPHIC)
            | flag(self.raster.nodata.is_some(), HAS_NODATA)
            | flag(self.lossless, LOSSLESS)
            | flag(self.raster.alpha, HAS_ALPHA)
    }

    pub(super) fn encode(&self, layout: &Layout) -> Vec<u8> {
        let raster = &self.raster;
        let mut out = Vec::with_capacity(HEADER_LENGTH);
        out.extend(MAGIC);
        out.extend(READ_VERSION.to_le_bytes());
        out.extend(WRITE_VERSION.to_le_bytes());
        out.extend((HEADER_LENGTH as u32).to_le_bytes());
        out.extend([
            self.kind as u8,
            self.domain as u8,
            self.transform as u8,
            self.entropy as u8,
        ]);
        out.extend([self.cells_log2, self.levels]);
        out.extend([raster.sample_type as u8, raster.registration as u8]);
        let missing = if layout.has_missing { HAS_MISSING } else { 0 };
        out.extend((self.flags() | missing).to_le_bytes());
        out.extend([self.block_length_unit, 0]);
        for number in [raster.width, raster.height, self.bound_units] {
            out.extend(number.to_le_bytes());
        }
        out.extend(self.unit_min.to_le_bytes());
        out.extend(self.unit_max.to_le_bytes());
        let floats = [
            self.unit_scale,
            self.unit_offset,
            self.sample_min,
            self.sample_max,
            self.max_error_bound,
            self.max_error,
            self.rms_error,
            raster.value_scale,
            raster.value_offset,
        ];
        for number in floats.into_iter().chain(raster.geotransform) {
            out.extend(number.to_le_bytes());
        }
        out.extend(raster.nodata.unwrap_or(0.0).to_le_bytes());
        for number in [
            self.samples,
            self.void_samples,
            self.block_count,
            layout.file_length,
        ] {
            out.extend(number.to_le_bytes());
        }
        for (_, section) in layout.sections() {
            out.extend(section.offset.to_le_bytes());
            out.extend(section.length.to_le_bytes());
        }
        for checksum in layout.checksums {
            out.extend(checksum.to_le_bytes());
        }
        out.extend(crc32fast::hash(&out).to_le_bytes());
        out
    }
}

/// What the first bytes say in every version.
pub(super) enum Prefix {
    /// The header has this many bytes.
    Header(usize),
    /// The bytes are not a repository's.
    Foreign,
    /// They are the beginning of a repository's, but too few.
    Short,
}

/// Judges the first [`PREFIX_LENGTH`] bytes of a file, or all of a shorter one.
pub(super) fn read_prefix(bytes: &[u8]) -> std::result::Result<Prefix, String> {
    let magic = bytes
        .iter()
        .zip(MAGIC)
        .all(|(byte, expected)| *byte == expected);
    if !magic {
        return Ok(Prefix::Foreign);
    }
    if bytes.len() < PREFIX_LENGTH {
        return Ok(Prefix::Short);
    }
    let mut fields = Fields(&bytes[PREFIX_LENGTH - 4..]);
    let length = fields.u32()?;
    if !((PREFIX_LENGTH + CHECKSUM_LENGTH) as u32..=HEADER_LIMIT).contains(&length) {
        return Err(format!("it claims a length of {length} bytes"));
    }
    Ok(Prefix::Header(length as usize))
}

/// Checks the checksum of a whole header of any version; returns its read version.
pub(super) fn read_version(bytes: &[u8]) -> std::result::Result<u16, String> {
    let (body, checksum) = bytes.split_last_chunk().ok_or("no checksum")?;
    if crc32fast::hash(body) != u32::from_le_bytes(*checksum) {
        return Err("checksum mismatch".to_owned());
    }
    Fields(body.get(MAGIC.len()..).unwrap_or_default()).u16()
}

/// The write version of a header whose checksum is right.
pub(super) fn write_version(bytes: &[u8]) -> std::result::Result<u16, String> {
    Fields(bytes.get(MAGIC.len() + 2..).unwrap_or_default()).u16()
}

/// Reads a header of this read version whose checksum is right. The raster's metadata is still empty.
pub(super) fn decode(bytes: &[u8]) -> std::result::Result<(Header, Layout), String> {
    let text = |error: Error| error.to_string();
    let mut fields = Fields(bytes.get(PREFIX_LENGTH..).unwrap_or_default());
    let kind = Kind::try_from(fields.u8()?).map_err(text)?;
    let domain = DomainKind::try_from(fields.u8()?).map_err(text)?;
    let transform = TransformKind::try_from(fields.u8()?).map_err(text)?;
    let entropy = EntropyKind::try_from(fields.u8()?).map_err(text)?;
    let (cells_log2, levels) = (fields.u8()?, fields.u8()?);
    let sample_type = fields.u8()?;
    let sample_type = SampleType::from_number(sample_type)
        .ok_or_else(|| format!("unknown sample type {sample_type}"))?;
    let registration = match fields.u8()? {
        0 => Registration::Area,
        1 => Registration::Point,
        number => return Err(format!("unknown registration {number}")),
    };
    let flags = fields.u16()?;
    let (block_length_unit, _reserved) = (fields.u8()?, fields.u8()?);
    let (width, height, bound_units) = (fields.u32()?, fields.u32()?, fields.u32()?);
    let (unit_min, unit_max) = (fields.i32()?, fields.i32()?);
    let (unit_scale, unit_offset) = (fields.f64()?, fields.f64()?);
    let (sample_min, sample_max) = (fields.f64()?, fields.f64()?);
    let (max_error_bound, max_error, rms_error) = (fields.f64()?, fields.f64()?, fields.f64()?);
    let mut raster = RasterInfo::new(width, height, sample_type);
    raster.registration = registration;
    raster.georeferenced = flags & GEOREFERENCED != 0;
    raster.geographic = flags & GEOGRAPHIC != 0;
    raster.alpha = flags & HAS_ALPHA != 0;
    raster.bands = kind.bands();
    (raster.value_scale, raster.value_offset) = (fields.f64()?, fields.f64()?);
    for number in &mut raster.geotransform {
        *number = fields.f64()?;
    }
    let nodata = fields.f64()?;
    raster.nodata = (flags & HAS_NODATA != 0).then_some(nodata);
    let header = Header {
        kind,
        domain,
        transform,
        entropy,
        cells_log2,
        levels,
        lossless: flags & LOSSLESS != 0,
        block_length_unit,
        bound_units,
        unit_min,
        unit_max,
        unit_scale,
        unit_offset,
        sample_min,
        sample_max,
        max_error_bound,
        max_error,
        rms_error,
        samples: fields.u64()?,
        void_samples: fields.u64()?,
        block_count: fields.u64()?,
        raster,
    };
    let mut layout = decode_layout(&mut fields)?;
    layout.has_missing = flags & HAS_MISSING != 0;
    header.check()?;
    layout.check(&header, bytes.len() as u64)?;
    Ok((header, layout))
}

fn decode_layout(fields: &mut Fields) -> std::result::Result<Layout, String> {
    let file_length = fields.u64()?;
    let mut sections = [Section::default(); 5];
    for section in &mut sections {
        *section = Section {
            offset: fields.u64()?,
            length: fields.u64()?,
        };
    }
    let [metadata, roots, tables, index, blocks] = sections;
    let checksums = [fields.u32()?, fields.u32()?, fields.u32()?];
    Ok(Layout {
        metadata,
        roots,
        tables,
        index,
        blocks,
        checksums,
        file_length,
        has_missing: false,
    })
}
