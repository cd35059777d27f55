//! The metadata section: reference system, unit and free metadata, compressed.

use super::fields::Fields;
use super::header::SECTION_LIMIT;
use crate::geo::RasterInfo;

/// Slow and small: the section is written once and is short.
const COMPRESSION_LEVEL: i32 = 19;

/// The section that says `raster.crs`, `raster.units` and `raster.metadata`.
pub(super) fn encode(raster: &RasterInfo) -> Result<Vec<u8>, String> {
    if raster.crs.is_empty() && raster.units.is_empty() && raster.metadata.is_empty() {
        return Ok(Vec::new());
    }
    let mut plain = Vec::new();
    put(&mut plain, raster.crs.as_bytes())?;
    put(&mut plain, raster.units.as_bytes())?;
    for (key, value) in &raster.metadata {
        put(&mut plain, key.as_bytes())?;
        put(&mut plain, value)?;
    }
    let frame = zstd::bulk::compress(&plain, COMPRESSION_LEVEL)
        .map_err(|error| format!("metadata cannot be compressed: {error}"))?;
    let mut section = (plain.len() as u32).to_le_bytes().to_vec();
    section.extend(frame);
    Ok(section)
}

fn put(plain: &mut Vec<u8>, bytes: &[u8]) -> Result<(), String> {
    if (plain.len() + 4 + bytes.len()) as u64 > SECTION_LIMIT {
        return Err(format!("metadata has more than {SECTION_LIMIT} bytes"));
    }
    plain.extend((bytes.len() as u32).to_le_bytes());
    plain.extend(bytes);
    Ok(())
}

/// The inverse of [`encode`]. The message says what is wrong inside the section.
pub(super) fn decode(section: &[u8], raster: &mut RasterInfo) -> Result<(), String> {
    if section.is_empty() {
        return Ok(());
    }
    let mut fields = Fields(section);
    let length = fields.u32()?;
    if u64::from(length) > SECTION_LIMIT {
        return Err(format!(
            "decompresses to {length} bytes, more than {SECTION_LIMIT}"
        ));
    }
    let plain = zstd::bulk::decompress(fields.0, length as usize)
        .map_err(|error| format!("cannot be decompressed: {error}"))?;
    if plain.len() != length as usize {
        return Err(format!(
            "decompresses to {} bytes instead of {length}",
            plain.len()
        ));
    }
    let mut fields = Fields(&plain);
    raster.crs = fields.string()?;
    raster.units = fields.string()?;
    while !fields.0.is_empty() {
        let key = fields.string()?;
        let value = fields.bytes()?.to_vec();
        if raster
            .metadata
            .last_key_value()
            .is_some_and(|(last, _)| *last >= key)
        {
            return Err(format!("key {key:?} is out of order"));
        }
        raster.metadata.insert(key, value);
    }
    Ok(())
}
