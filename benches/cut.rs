//! What a frame costs: judging a cut that stays as it is, and refining.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use glam::dcamera::rh::{proj::opengl, view};
use kimberlite::build::source::RowSource;
use kimberlite::build::{BuildOptions, build};
use kimberlite::cut::{Cut, CutOptions, DiamondSource, Terrain, VertexForm, View};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::schedule::Budget;
use kimberlite::store::Access;
use std::sync::Arc;

/// Samples along a side.
const SIDE: u32 = 2049;

/// Hills and noise at maximum error 2.
fn terrain() -> Arc<Terrain> {
    let info = RasterInfo::new(SIDE, SIDE, SampleType::I16);
    let fill = |first: u32, rows: &mut [f64]| {
        for (index, sample) in rows.iter_mut().enumerate() {
            let (row, column) = (index / SIDE as usize, index % SIDE as usize);
            let (x, y) = (column as f64, f64::from(first) + row as f64);
            let noise = ((x * 12.9898 + y * 78.233).sin() * 43758.5453).fract() * 9.0;
            *sample = ((x * 0.05).sin() * (y * 0.03).cos() * 90.0 + noise).round();
        }
        Ok(())
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let options = BuildOptions {
        max_error: 2.0,
        ..BuildOptions::default()
    };
    let mut source = RowSource::new(info, Box::new(fill));
    build(&mut source, &options, &path, &mut |_, _| true).unwrap();
    Arc::new(Terrain::open(&path, Access::Map).unwrap())
}

/// From above the middle, so high that all is seen, `shift` metres to the side.
fn overview(terrain: &Terrain, tolerance: f64, shift: f64) -> View {
    let (lattice, frame) = (terrain.lattice(), terrain.frame());
    let last = [lattice.width(), lattice.height()].map(|side| f64::from(side) - 1.0);
    let [x, y] = frame.grid_to_world(last[0] / 2.0, last[1] / 2.0);
    let side = (last[0] * frame.step[0].abs()).max(last[1] * frame.step[1].abs());
    let eye = DVec3::new(x + shift, y - 0.3 * side, side);
    let ahead = DVec3::new(x, y, 0.0) - eye;
    let lens = opengl::perspective(1.2, 1.25, side / 100.0, 4.0 * side);
    let camera = view::look_to_mat4(eye, ahead.normalize(), DVec3::Z);
    View {
        eye: eye.to_array(),
        world_to_clip: (lens * camera).to_cols_array(),
        viewport: [1280.0, 1024.0],
        tolerance,
    }
}

fn new_cut(terrain: &Arc<Terrain>, vertex_form: VertexForm) -> Cut {
    let options = CutOptions {
        vertex_form,
        ..CutOptions::default()
    };
    Cut::new(terrain.clone(), options).unwrap()
}

fn steady(criterion: &mut Criterion, terrain: &Arc<Terrain>) {
    for patches in [100, 1000] {
        let mut cut = new_cut(terrain, VertexForm::Compact);
        let budget = Budget {
            patches,
            ..Budget::UNLIMITED
        };
        let finest = overview(terrain, 1e-3, 0.0);
        for _ in 0..50 {
            cut.update(&finest, &budget).unwrap();
        }
        let error = cut.update(&finest, &budget).unwrap().largest_error;
        let mut frame = 0;
        criterion.bench_function(&format!("a frame of {patches} patches"), |bencher| {
            bencher.iter(|| {
                frame += 1;
                let shift = 0.01 * f64::from(frame % 8);
                let stats = cut.update(&overview(terrain, 1.1 * error, shift), &Budget::UNLIMITED);
                assert_eq!(stats.unwrap().refined, 0);
            });
        });
    }
}

fn refining(criterion: &mut Criterion, terrain: &Arc<Terrain>) {
    let view = overview(terrain, 1e-6, 0.0);
    for form in [VertexForm::Compact, VertexForm::Expanded] {
        let stats = new_cut(terrain, form).update(&view, &Budget::UNLIMITED);
        let mut group = criterion.benchmark_group("refining");
        group.throughput(Throughput::Elements(stats.unwrap().refined));
        group.sample_size(10);
        group.bench_function(format!("{form:?}"), |bencher| {
            bencher.iter_batched_ref(
                || new_cut(terrain, form),
                |cut| cut.update(&view, &Budget::UNLIMITED).unwrap(),
                BatchSize::PerIteration,
            );
        });
    }
}

fn benches(criterion: &mut Criterion) {
    let terrain = terrain();
    steady(criterion, &terrain);
    refining(criterion, &terrain);
}

criterion_group!(cut, benches);
criterion_main!(cut);
