//! GeoTIFF's tags and keys: the numbers that reader and writer share, and what the keys say.

use crate::geo::Registration;

pub(crate) const MODEL_PIXEL_SCALE: u16 = 33550;
pub(crate) const MODEL_TIEPOINT: u16 = 33922;
pub(crate) const MODEL_TRANSFORMATION: u16 = 34264;
pub(crate) const GEO_KEY_DIRECTORY: u16 = 34735;
pub(crate) const GEO_DOUBLE_PARAMS: u16 = 34736;
pub(crate) const GEO_ASCII_PARAMS: u16 = 34737;
pub(crate) const GDAL_METADATA: u16 = 42112;
pub(crate) const GDAL_NODATA: u16 = 42113;

pub(crate) const MODEL_TYPE: u16 = 1024;
pub(crate) const RASTER_TYPE: u16 = 1025;
pub(crate) const CITATION: u16 = 1026;
pub(crate) const GEOGRAPHIC_TYPE: u16 = 2048;
pub(crate) const GEOGRAPHIC_CITATION: u16 = 2049;
pub(crate) const PROJECTED_TYPE: u16 = 3072;
pub(crate) const PROJECTED_CITATION: u16 = 3073;

pub(crate) const MODEL_PROJECTED: u16 = 1;
pub(crate) const MODEL_GEOGRAPHIC: u16 = 2;
pub(crate) const RASTER_PIXEL_IS_AREA: u16 = 1;
pub(crate) const RASTER_PIXEL_IS_POINT: u16 = 2;
pub(crate) const USER_DEFINED: u16 = 32767;

/// What stands before WKT in a citation.
pub(crate) const WKT_PREFIX: &str = "ESRI PE String = ";

/// The metadata key under which a tag's bytes are kept, in little-endian order.
pub(crate) fn metadata_key(tag: u16) -> String {
    format!("tiff.{tag}")
}

/// The key directory with the text that it points to.
pub(super) struct GeoKeys {
    /// Quadruples: key, tag of the value (0: the value itself), count, value or index.
    directory: Vec<[u16; 4]>,
    ascii: Vec<u8>,
}

impl GeoKeys {
    /// From the bytes of the tags, in little-endian order.
    pub(super) fn new(directory: &[u8], ascii: &[u8]) -> GeoKeys {
        let (quadruples, _) = directory.as_chunks::<8>();
        let short = |low, high| u16::from_le_bytes([low, high]);
        let directory = quadruples
            .iter()
            .skip(1)
            .map(|&[a, b, c, d, e, f, g, h]| [short(a, b), short(c, d), short(e, f), short(g, h)])
            .collect();
        GeoKeys {
            directory,
            ascii: ascii.to_vec(),
        }
    }

    fn entry(&self, key: u16, location: u16) -> Option<[u16; 4]> {
        self.directory
            .iter()
            .copied()
            .find(|entry| entry[0] == key && entry[1] == location)
    }

    fn short(&self, key: u16) -> Option<u16> {
        self.entry(key, 0).map(|entry| entry[3])
    }

    fn text(&self, key: u16) -> Option<String> {
        let [_, _, count, index] = self.entry(key, GEO_ASCII_PARAMS)?;
        let bytes = self
            .ascii
            .get(usize::from(index)..)?
            .get(..usize::from(count))?;
        Some(
            String::from_utf8_lossy(bytes)
                .trim_end_matches(['|', '\0'])
                .to_string(),
        )
    }

    pub(super) fn registration(&self) -> Registration {
        match self.short(RASTER_TYPE) {
            Some(RASTER_PIXEL_IS_POINT) => Registration::Point,
            _ => Registration::Area,
        }
    }

    pub(super) fn geographic(&self) -> bool {
        match self.short(MODEL_TYPE) {
            Some(model) => model == MODEL_GEOGRAPHIC,
            None => self.short(GEOGRAPHIC_TYPE).is_some() && self.short(PROJECTED_TYPE).is_none(),
        }
    }

    /// `EPSG:n` where the system has a code, WKT where a citation has it, else empty.
    pub(super) fn crs(&self) -> String {
        let (code, citation) = if self.short(MODEL_TYPE) == Some(MODEL_PROJECTED) {
            (PROJECTED_TYPE, PROJECTED_CITATION)
        } else {
            (GEOGRAPHIC_TYPE, GEOGRAPHIC_CITATION)
        };
        if let Some(code) = self
            .short(code)
            .filter(|code| (1024..USER_DEFINED).contains(code))
        {
            return format!("EPSG:{code}");
        }
        [citation, CITATION]
            .into_iter()
            .filter_map(|key| self.text(key))
            .find_map(|text| text.strip_prefix(WKT_PREFIX).map(str::to_string))
            .unwrap_or_default()
    }
}
