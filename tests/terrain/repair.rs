//! Damaged terrains after a repair: what is sound is what it was, the rest is coarser and within its stored error.

use crate::methods::{METHODS, Method};
use crate::rasters::Raster;
use crate::round_trip::rasters;
use kimberlite::cut::{Coarse, DiamondSource, Query, Terrain, Window, level_size, read_window};
use kimberlite::lattice::{Diamond, Lattice};
use kimberlite::store::Access;
use kimberlite::tool::{self, Flight, RepairReport};
use proptest::prelude::*;
use proptest::sample::Index;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

/// Where bytes are changed, by what, how many, and whether in the index.
type Hits = Vec<(Index, u8, usize, bool)>;

fn hits() -> impl Strategy<Value = Hits> {
    let in_index = prop_oneof![4 => Just(false), 1 => Just(true)];
    prop::collection::vec((any::<Index>(), 1u8.., 1usize..4, in_index), 1..6)
}

/// One terrain whole and repaired.
struct Case {
    folder: TempDir,
    whole: Arc<Terrain>,
    repaired: Arc<Terrain>,
    report: RepairReport,
    /// By rank: it cannot be refined.
    blocked: Vec<bool>,
}

fn quiet(_: u64, _: u64) -> bool {
    true
}

fn path(folder: &TempDir, name: &str) -> PathBuf {
    folder.path().join(name)
}

fn open(path: &Path) -> Arc<Terrain> {
    Arc::new(Terrain::open(path, Access::Map).unwrap())
}

fn damage(bytes: &mut [u8], hits: &Hits) {
    let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (index, blocks, end) = (u64_at(256), u64_at(272), bytes.len());
    for (place, change, length, in_index) in hits {
        let (first, end) = if *in_index {
            (index, blocks)
        } else {
            (blocks, end)
        };
        if first < end {
            let start = first + place.index(end - first);
            for byte in &mut bytes[start..end.min(start + length)] {
                *byte ^= change;
            }
        }
    }
}

impl Case {
    fn new(raster: &Raster, method: Method, error: f64, hits: &Hits) -> Option<Case> {
        let folder = tempfile::tempdir().unwrap();
        let [good, bad, out] = ["good.kmb", "bad.kmb", "out.kmb"].map(|name| path(&folder, name));
        raster.build_with(&good, &method.options(error, 4)).ok()?;
        let mut bytes = std::fs::read(&good).unwrap();
        damage(&mut bytes, hits);
        std::fs::write(&bad, &bytes).unwrap();
        let report = tool::repair(&bad, &out, &mut quiet).unwrap();
        let (whole, repaired) = (open(&good), open(&out));
        let lattice = repaired.lattice();
        let mut blocked: Vec<bool> = Vec::new();
        for rank in 0..lattice.diamond_count() {
            let parents = lattice.parents(lattice.diamond(rank)).into_iter().flatten();
            let is_blocked = parents
                .into_iter()
                .any(|parent| blocked[lattice.rank(parent) as usize]);
            blocked.push(is_blocked || repaired.store().record(rank).unwrap().is_missing);
        }
        Some(Case {
            folder,
            whole,
            repaired,
            report,
            blocked,
        })
    }

    fn lattice(&self) -> &Lattice {
        self.repaired.lattice()
    }

    fn is_blocked(&self, diamond: Diamond) -> bool {
        self.blocked[self.lattice().rank(diamond) as usize]
    }

    /// Whether a sample lies inside a diamond that cannot be refined.
    fn is_coarse(&self, at: [i64; 2]) -> bool {
        self.lattice()
            .finest_around(at)
            .is_some_and(|(diamond, _)| self.is_blocked(diamond))
    }

    /// The triangles that the finest possible cut draws for diamonds which cannot be refined, and their errors in
    /// units.
    fn coarse_triangles(&self) -> Vec<([[i64; 2]; 3], f64)> {
        let lattice = self.lattice();
        let cells = lattice.cells();
        let mut triangles = Vec::new();
        for rank in (0..lattice.diamond_count()).filter(|&rank| self.blocked[rank as usize]) {
            let diamond = lattice.diamond(rank);
            let error = self
                .repaired
                .summary(diamond, self.repaired.range())
                .unwrap()
                .error;
            for (half, parent) in lattice.parents(diamond).into_iter().enumerate() {
                let has_arrived = diamond == lattice.root()
                    || parent.is_some_and(|parent| !self.is_blocked(parent));
                if has_arrived {
                    let apex = lattice.apexes(diamond)[half];
                    let corners = [(0, 0), (cells, 0), (0, cells)].map(|(p, q)| {
                        let (i, j) = apex.vertex(cells, p, q);
                        lattice.placement(diamond).vertex(i, j)
                    });
                    triangles.push((corners, error));
                }
            }
        }
        triangles
    }
}

fn covers([a, b, c]: [[i64; 2]; 3], at: [i64; 2]) -> bool {
    let cross =
        |a: [i64; 2], b: [i64; 2]| (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0]);
    let sides = [cross(a, b), cross(b, c), cross(c, a)];
    sides.iter().all(|side| *side >= 0) || sides.iter().all(|side| *side <= 0)
}

fn read(terrain: &Terrain, level: u32, window: Window) -> (Vec<f64>, Coarse) {
    let mut samples = vec![-1.0; window.width as usize * window.height as usize];
    let coarse = read_window(terrain, level, window, &mut samples).unwrap();
    (samples, coarse)
}

fn whole_level(terrain: &Terrain, level: u32) -> Window {
    let [width, height] = level_size(terrain, level).unwrap();
    Window {
        column: 0,
        row: 0,
        width,
        height,
    }
}

fn is_same(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan()
}

/// Samples are what they were or, inside what cannot be refined, within the stored error of what is drawn there.
fn check_samples(case: &Case) -> Result<(), TestCaseError> {
    let levels = case.lattice().levels();
    let window = whole_level(&case.whole, levels);
    let (expected, nothing) = read(&case.whole, levels, window);
    prop_assert_eq!(nothing.count(), 0);
    let (found, coarse) = read(&case.repaired, levels, window);
    prop_assert_eq!(coarse.count(), case.report.coarse_samples);
    let (triangles, unit) = (case.coarse_triangles(), case.repaired.units().scale);
    let expected_at = |index: i64| expected[index as usize];
    for (index, (&found, &expected)) in found.iter().zip(&expected).enumerate() {
        let at = [
            index as i64 % i64::from(window.width),
            index as i64 / i64::from(window.width),
        ];
        prop_assert_eq!(coarse.contains(index), case.is_coarse(at), "{:?}", at);
        if !coarse.contains(index) {
            prop_assert!(
                is_same(found, expected),
                "{:?}: {} not {}",
                at,
                found,
                expected
            );
            continue;
        }
        let around = triangles.iter().filter(|(corners, _)| covers(*corners, at));
        let bound = around.map(|(_, error)| *error).fold(f64::NAN, f64::min);
        prop_assert!(!bound.is_nan(), "no triangle at {:?}", at);
        if found.is_nan() && bound.is_finite() {
            // A valid sample without a triangle of the leaf level is no ground.
            let (columns, rows) = (at[0] - 1..=at[0] + 1, at[1] - 1..=at[1] + 1);
            let near = rows.flat_map(|row| columns.clone().map(move |column| [column, row]));
            let mut near = near.filter(|&at| case.lattice().in_raster(at));
            let is_void = |[column, row]: [i64; 2]| {
                expected_at(column + row * i64::from(window.width)).is_nan()
            };
            prop_assert!(near.any(is_void), "no ground at {:?}", at);
        } else if !is_same(found, expected) && bound.is_finite() {
            let limit = (bound + 0.5) * unit + 1e-6 * expected.abs();
            let distance = (found - expected).abs();
            prop_assert!(
                distance <= limit,
                "{:?}: {} for {}, at most {}",
                at,
                found,
                expected,
                limit
            );
        }
    }
    Ok(())
}

/// Any window is a part of its level, and any level has what it can.
fn check_windows(case: &Case, place: [Index; 4]) -> Result<(), TestCaseError> {
    for level in (0..=case.lattice().levels()).step_by(2) {
        let whole = whole_level(&case.repaired, level);
        let (all, all_coarse) = read(&case.repaired, level, whole);
        let (expected, _) = read(&case.whole, level, whole);
        for (index, &sample) in all.iter().enumerate() {
            prop_assert!(all_coarse.contains(index) || is_same(sample, expected[index]));
        }
        let [column, row] = [
            place[0].index(whole.width as usize),
            place[1].index(whole.height as usize),
        ];
        let width = 1 + place[2].index(whole.width as usize - column);
        let height = 1 + place[3].index(whole.height as usize - row);
        let [column, row, width, height] = [column, row, width, height].map(|n| n as u32);
        let (part, coarse) = read(
            &case.repaired,
            level,
            Window {
                column,
                row,
                width,
                height,
            },
        );
        for (index, &sample) in part.iter().enumerate() {
            let at = [column + index as u32 % width, row + index as u32 / width];
            let place = (at[1] * whole.width + at[0]) as usize;
            prop_assert!(is_same(sample, all[place]), "{:?} of level {}", at, level);
            prop_assert_eq!(coarse.contains(index), all_coarse.contains(place));
        }
    }
    Ok(())
}

/// Heights are within the bound that comes with them.
fn check_heights(case: &Case, points: &[[f64; 2]]) -> Result<(), TestCaseError> {
    let mut whole = Query::new(case.whole.clone(), 1 << 20);
    let mut repaired = Query::new(case.repaired.clone(), 1 << 16);
    let (width, height) = (case.lattice().width(), case.lattice().height());
    let levels = case.lattice().levels();
    let somewhere = points
        .iter()
        .map(|[x, y]| [x * f64::from(width - 1), y * f64::from(height - 1)]);
    let samples = (0..width * height)
        .step_by(7)
        .map(|index| [index % width, index / width].map(f64::from));
    for at in somewhere.chain(samples) {
        let expected = whole.height_at_grid(at[0], at[1]).unwrap();
        let Some(found) = repaired.height_at_grid(at[0], at[1]).unwrap() else {
            continue;
        };
        let is_sample = at.iter().all(|along| along.fract() == 0.0);
        if is_sample && case.is_coarse(at.map(|along| along as i64)) {
            prop_assert!(found.level < levels);
        }
        if found.error_bound.is_finite() {
            let Some(expected) = expected else {
                return Err(TestCaseError::fail(format!("{at:?} is void")));
            };
            let limit = match found.level == levels {
                true => 0.0,
                false => found.error_bound + 1e-6 * expected.height.abs(),
            };
            let distance = (found.height - expected.height).abs();
            prop_assert!(
                distance <= limit,
                "{:?}: {:?} for {:?}",
                at,
                found,
                expected
            );
        }
    }
    Ok(())
}

/// Errors and ranges are no tighter than they were, and nest towards the root.
fn check_summaries(case: &Case) -> Result<(), TestCaseError> {
    let lattice = case.lattice();
    let mut ranges: Vec<[[i32; 2]; 2]> = Vec::new();
    let mut errors: Vec<f64> = Vec::new();
    for rank in 0..lattice.diamond_count() {
        let diamond = lattice.diamond(rank);
        let parents: Vec<Diamond> = lattice.parents(diamond).into_iter().flatten().collect();
        let first = match parents.first() {
            Some(&parent) => ranges[lattice.rank(parent) as usize],
            None => [case.whole.range(), case.repaired.range()],
        };
        let whole = case.whole.summary(diamond, first[0]).unwrap();
        let repaired = case.repaired.summary(diamond, first[1]).unwrap();
        prop_assert!(repaired.error >= whole.error);
        prop_assert!(repaired.range[0] <= whole.range[0] && repaired.range[1] >= whole.range[1]);
        prop_assert!(repaired.range[0] >= first[1][0] && repaired.range[1] <= first[1][1]);
        for parent in parents {
            prop_assert!(errors[lattice.rank(parent) as usize] >= repaired.error);
        }
        ranges.push([whole.range, repaired.range]);
        errors.push(repaired.error);
    }
    Ok(())
}

fn check_report(case: &Case, raster: &Raster) -> Result<(), TestCaseError> {
    let report = case.report;
    let verdict = tool::verify(&case.repaired, Some(&mut raster.source()), &mut quiet).unwrap();
    prop_assert!(verdict.ok, "{:?}", verdict);
    prop_assert_eq!(verdict.missing_blocks(), report.missing_blocks);
    prop_assert_eq!(verdict.coarse_samples, Some(report.coarse_samples));
    prop_assert_eq!(report.lost_blocks, report.missing_blocks);
    let blocked = case.blocked.iter().filter(|blocked| **blocked).count();
    prop_assert_eq!(report.blocked_blocks, blocked as u64);
    let first = case.blocked.iter().position(|blocked| *blocked);
    let level = first.map(|rank| case.lattice().diamond(rank as u64).level());
    prop_assert_eq!(report.coarsest_level, level);
    let samples = raster.samples.len() as f64;
    prop_assert_eq!(
        report.coarse_percent,
        100.0 * report.coarse_samples as f64 / samples
    );
    let flight = Flight {
        frames: 4,
        viewport: [640, 480],
        tolerance: 0.5,
        options: kimberlite::cut::CutOptions::default(),
        budget_microseconds: None,
    };
    prop_assert_eq!(
        tool::fly(&case.repaired, &flight, &mut quiet)
            .unwrap()
            .cracks,
        0
    );
    Ok(())
}

/// A repair of what was repaired, and of what was never damaged, changes nothing.
fn check_repetition(case: &Case) -> Result<(), TestCaseError> {
    let again = path(&case.folder, "again.kmb");
    for name in ["out.kmb", "good.kmb"] {
        let file = path(&case.folder, name);
        let report = tool::repair(&file, &again, &mut quiet).unwrap();
        let bytes = std::fs::read(&file).unwrap();
        prop_assert_eq!(
            (report.damaged_blocks, report.bytes),
            (0, bytes.len() as u64)
        );
        prop_assert!(bytes == std::fs::read(&again).unwrap());
    }
    // In place, under a reader that goes on with what it has.
    let bad = path(&case.folder, "bad.kmb");
    let reader = Terrain::open(&bad, Access::Map).unwrap();
    let before = reader.store().verify();
    tool::repair(&bad, &bad, &mut quiet).unwrap();
    prop_assert!(
        std::fs::read(&bad).unwrap() == std::fs::read(path(&case.folder, "out.kmb")).unwrap()
    );
    prop_assert_eq!(reader.store().verify(), before);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_repaired_terrain_has_wrong_ground(
        raster in rasters(),
        method in prop::sample::select(&METHODS[..]),
        share in prop_oneof![Just(0.0), 0.001f64..0.1],
        hits in hits(),
        place in any::<[Index; 4]>(),
        points in prop::collection::vec([0.0f64..1.0, 0.0f64..1.0], 100),
    ) {
        let amplitude = raster.samples.iter().filter(|s| !s.is_nan()).fold(1.0f64, |a, s| a.max(s.abs()));
        let error = if raster.info.sample_type.is_integer() { (share * amplitude).floor() } else { (share + 1e-3) * amplitude };
        let Some(case) = Case::new(&raster, method, error, &hits) else { return Ok(()) };
        check_report(&case, &raster)?;
        check_samples(&case)?;
        check_windows(&case, place)?;
        check_heights(&case, &points)?;
        check_summaries(&case)?;
        check_repetition(&case)?;
    }
}

#[test]
fn a_raster_out_of_repaired_bytes_pretends_to_be_whole() {
    let samples = (0..80 * 80)
        .map(|index| f64::from((index % 80) * (index / 80) % 97))
        .collect();
    let raster = Raster::new(80, 80, kimberlite::geo::SampleType::I16, samples);
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "a.kmb");
    raster.build(&file, 0.0, 4).unwrap();
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, &bytes).unwrap();
    tool::repair(&file, &file, &mut quiet).unwrap();
    let terrain = tool::open_packed(&std::fs::read(&file).unwrap()).unwrap();
    let error = tool::unpack(&terrain, &mut vec![0i16; 80 * 80]).unwrap_err();
    assert!(
        error.to_string().contains("missing: the detail of"),
        "{error}"
    );
}
