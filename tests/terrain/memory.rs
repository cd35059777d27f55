//! Builds in little memory: what does not fit goes to temporary files, and the output is the same.

use crate::methods::METHODS;
use crate::rasters::{message, some_error};
use crate::round_trip::rasters;
use kimberlite::build::{BuildOptions, build};
use kimberlite::store::TransformKind;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn a_build_in_temporary_files_gives_the_same_bytes(
        raster in rasters(),
        cells_log2 in 4u32..7,
        threads in 1usize..4,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let (error, samples) = (some_error(&raster), raster.samples.len() as u64);
        for method in METHODS {
            let options = BuildOptions { threads, ..method.options(error, cells_log2) };
            // Enough for filtered levels, not for all that is decoded.
            let little = BuildOptions { memory: Some((48 << 20) + 12 * samples), ..options.clone() };
            let files = [options, little].map(|options| {
                let path = folder.path().join("a.kmb");
                build(&mut raster.source(), &options, &path, &mut |_, _| true).unwrap();
                let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
                assert_eq!(left.len(), 1, "only the output is left");
                std::fs::read(&path).unwrap()
            });
            prop_assert!(files[0] == files[1], "{:?}", method);
        }
    }

    #[test]
    fn filtered_levels_that_do_not_fit_are_refused(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for method in METHODS {
            let options = BuildOptions { memory: Some(1 << 20), ..method.options(some_error(&raster), 4) };
            let built = build(&mut raster.source(), &options, &path, &mut |_, _| true);
            if method.transform == TransformKind::Interpolating {
                prop_assert!(built.is_ok());
            } else {
                let text = message(built);
                prop_assert!(text.contains("MiB of memory"), "{}", text);
            }
        }
    }
}
