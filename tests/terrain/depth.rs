//! The error at the end of many levels.

use crate::pyramid::Pyramid;
use kimberlite::lattice::Lattice;
use kimberlite::store::TransformKind;

/// A strip 2^(K + 4) samples long: 2K levels of diamonds of 16 cells, few on each.
fn strip(half_levels: u32, kind: TransformKind) -> Pyramid {
    let lattice = Lattice::new((16 << half_levels) + 1, 17, 4).unwrap();
    assert_eq!(lattice.levels(), 2 * half_levels);
    Pyramid::new(lattice, kind, |column, row| {
        let mut hash = (column as u64) << 32 | row as u64;
        for shift in [31, 29] {
            hash = (hash ^ (hash >> shift)).wrapping_mul(0x94d0_49bb_1331_11eb);
        }
        let wave = 3000.0 * (column as f64 / 200.0).sin() * (row as f64 / 9.0).cos();
        wave as i32 + (hash >> 54) as i32
    })
}

#[test]
fn the_error_of_those_that_promise_it_does_not_grow_with_depth() {
    for kind in [TransformKind::Interpolating, TransformKind::TwoStage] {
        let pyramid = strip(10, kind);
        for bound in [0, 1, 7, 40] {
            let errors = pyramid.errors(bound);
            assert!(
                errors.iter().all(|&error| error <= i64::from(bound)),
                "{kind:?}: {errors:?}"
            );
            assert_eq!(errors[20], i64::from(bound), "{kind:?}: {errors:?}");
        }
    }
}

#[test]
fn blocks_in_contexts_keep_the_error_at_every_depth() {
    for (kind, adaptive) in [
        (TransformKind::Interpolating, true),
        (TransformKind::Interpolating, false),
        (TransformKind::TwoStage, false),
    ] {
        let pyramid = strip(10, kind);
        for bound in [0, 1, 7, 40] {
            let errors = pyramid.errors_in_contexts(bound, adaptive);
            let bound = i64::from(bound);
            let is_kept = errors.iter().all(|&error| error <= bound) && errors[20] == bound;
            assert!(is_kept, "{kind:?} {adaptive}: {errors:?}");
        }
    }
}

#[test]
fn the_error_of_lifted_is_nothing_without_a_bound_and_grows_with_one() {
    println!("e,level,max_error");
    let pyramid = strip(10, TransformKind::Lifted);
    assert!(pyramid.errors(0).iter().all(|&error| error == 0));
    for bound in [1, 7, 40] {
        let errors = pyramid.errors(bound);
        for (level, error) in errors.iter().enumerate() {
            println!("{bound},{level},{error}");
        }
        assert!(errors[20] > i64::from(bound), "{errors:?}");
        assert!(errors[20] > 2 * errors[4], "{errors:?}");
    }
}
