//! Time of one diamond: prediction, coefficients, block, and a height at a point.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use kimberlite::build::source::RowSource;
use kimberlite::build::{BuildOptions, build};
use kimberlite::cut::{DiamondSource, Query, Terrain};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::store::Access;
use std::hint::black_box;
use std::sync::Arc;

/// A 513 x 513 terrain of hills and noise at maximum error 2.
fn terrain(folder: &std::path::Path) -> Arc<Terrain> {
    let info = RasterInfo::new(513, 513, SampleType::I16);
    let fill = |first: u32, rows: &mut [f64]| {
        for (index, sample) in rows.iter_mut().enumerate() {
            let (x, y) = (
                (index % 513) as f64,
                f64::from(first) + (index / 513) as f64,
            );
            let noise = ((x * 12.9898 + y * 78.233).sin() * 43758.5453).fract() * 9.0;
            *sample = ((x * 0.05).sin() * (y * 0.03).cos() * 900.0 + noise).round();
        }
        Ok(())
    };
    let path = folder.join("bench.kmb");
    let options = BuildOptions {
        max_error: 2.0,
        ..BuildOptions::default()
    };
    let mut source = RowSource::new(info, Box::new(fill));
    build(&mut source, &options, &path, &mut |_, _| true).expect("the terrain builds");
    Arc::new(Terrain::open(&path, Access::Map).expect("the terrain opens"))
}

fn one_diamond(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let terrain = terrain(folder.path());
    let root = terrain.lattice().root();
    let samples = (terrain.lattice().cells() * terrain.lattice().cells()) as u64;
    let mut group = criterion.benchmark_group("diamond");
    group.throughput(Throughput::Elements(samples));
    group.bench_function("decode", |bencher| {
        bencher.iter(|| terrain.refine(black_box(root), terrain.root()));
    });
    group.bench_function("predict", |bencher| {
        let mut predictions = vec![0; samples as usize];
        let [low, high] = terrain.range();
        bencher.iter(|| {
            kimberlite::transform::predict(
                terrain.lattice().cells(),
                black_box(&terrain.root().values),
                low,
                high,
                &mut predictions,
            );
        });
    });
    group.finish();
    let mut query = Query::new(terrain.clone(), 64 << 20);
    let mut place = 0.0;
    criterion.bench_function("height, warm", |bencher| {
        bencher.iter(|| {
            place = (place + 7.3) % 500.0;
            query.height_at_grid(black_box(place), 250.5)
        });
    });
}

criterion_group!(benches, one_diamond);
criterion_main!(benches);
