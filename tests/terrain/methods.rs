//! Transforms with the coders that each goes with, and what every one of them must keep.

use crate::rasters::{Raster, decode, max_difference};
use kimberlite::build::{BuildOptions, BuildReport};
use kimberlite::cut::Terrain;
use kimberlite::store::{Access, EntropyKind, TransformKind};
use kimberlite::tool;
use std::path::Path;

/// How samples become bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    pub transform: TransformKind,
    pub entropy: EntropyKind,
    /// Trained prediction, which goes with rans.
    pub adaptive: bool,
}

const fn method(transform: TransformKind, entropy: EntropyKind, adaptive: bool) -> Method {
    Method {
        transform,
        entropy,
        adaptive,
    }
}

pub const METHODS: [Method; 9] = [
    method(TransformKind::Interpolating, EntropyKind::Rans, true),
    method(TransformKind::Interpolating, EntropyKind::Rans, false),
    method(TransformKind::Interpolating, EntropyKind::Gamma, false),
    method(TransformKind::Lifted, EntropyKind::Rans, false),
    method(TransformKind::Lifted, EntropyKind::Rans, true),
    method(TransformKind::Lifted, EntropyKind::Gamma, false),
    method(TransformKind::TwoStage, EntropyKind::Rans, false),
    method(TransformKind::TwoStage, EntropyKind::Rans, true),
    method(TransformKind::TwoStage, EntropyKind::Gamma, false),
];

impl Method {
    /// Options that keep `error` in the way that the transform can: as the largest, else as the RMS error;
    /// 0 is lossless.
    pub fn options(self, error: f64, cells_log2: u32) -> BuildOptions {
        let is_rms = self.transform == TransformKind::Lifted && error > 0.0;
        BuildOptions {
            transform: self.transform,
            entropy: self.entropy,
            adaptive: Some(self.adaptive),
            max_error: if is_rms { 0.0 } else { error },
            rms_error: is_rms.then_some(error),
            cells_log2,
            threads: 2,
            ..BuildOptions::default()
        }
    }
}

/// Builds a raster, decodes it, and checks what was promised: voids exact, the error within its bound and
/// the one measured, and the file sound against its input.
pub fn round_trip(raster: &Raster, path: &Path, options: &BuildOptions) -> BuildReport {
    let what = || format!("{raster:?} by {options:?}");
    let report = match raster.build_with(path, options) {
        Ok(report) => report,
        Err(error) => panic!("{error}: {}", what()),
    };
    let decoded = decode(path, Access::Map).unwrap();
    let error = max_difference(&decoded, &raster.samples);
    assert_eq!(error, report.max_error, "{}", what());
    match options.rms_error {
        Some(limit) => assert!(report.rms_error <= limit, "{report:?}: {}", what()),
        None => assert!(error <= options.max_error, "{error}: {}", what()),
    }
    let terrain = Terrain::open(path, Access::Map).unwrap();
    let verdict = tool::verify(&terrain, Some(&mut raster.source()), &mut |_, _| true).unwrap();
    assert!(verdict.ok, "{}", what());
    report
}
