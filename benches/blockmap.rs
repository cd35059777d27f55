//! Rays against one BlockMap, and the decoding of its image.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use kimberlite::blockmap::source::{ProceduralCity, generate};
use kimberlite::blockmap::{
    BakeOptions, BlockMap, Caster, Grid, Ground, Ray, Scene, bake, decode, encode,
};
use std::hint::black_box;

/// Pixels along a picture.
const PIXELS: usize = 256;
const SIDE: f64 = 64.0;

fn city() -> Scene {
    let city = ProceduralCity {
        seed: 5,
        corner: [1000.0, 2000.0],
        side: 256.0,
        buildings: 120,
    };
    generate(&city, &|_| Some(0.0))
}

fn block(scene: &Scene, side_texels: usize) -> BlockMap {
    let corner = [1000.0 + SIDE, 2000.0 + SIDE];
    let grid = Grid::new(scene, corner, SIDE, [1, 1]);
    let ground = Ground {
        height: &|_| 0.0,
        spacing: f64::INFINITY,
        colour: [120; 3],
    };
    let options = BakeOptions::of(side_texels);
    bake(scene, &grid, &ground, (corner, SIDE), &options)
        .unwrap()
        .0
}

/// All pixels of pictures from around the block, which takes half of them.
fn primary(map: &BlockMap) -> Vec<Ray> {
    let top = f64::from(map.heights[1]);
    let middle = DVec3::new(
        map.corner[0] + 0.5 * SIDE,
        map.corner[1] + 0.5 * SIDE,
        0.4 * top,
    );
    let mut rays = Vec::new();
    for view in 0..8 {
        let (sin, cos) = (0.3 + 0.785 * f64::from(view)).sin_cos();
        let towards = DVec3::new(cos, sin, [0.4, 0.8, 1.6][view as usize % 3]).normalize();
        let eye = middle + towards * 140.0;
        let right = DVec3::Z.cross(towards).normalize();
        let up = towards.cross(right);
        let at = |pixel: usize| ((pixel as f64 + 0.5) / PIXELS as f64 * 2.0 - 1.0) * 0.3;
        rays.extend((0..PIXELS * PIXELS).map(|pixel| Ray {
            origin: eye.to_array(),
            direction: (right * at(pixel % PIXELS) + up * at(pixel / PIXELS) - towards).to_array(),
        }));
    }
    rays
}

fn rays(criterion: &mut Criterion) {
    let scene = city();
    let map = block(&scene, 128);
    let caster = Caster::new(&map, -1.0);
    let rays = primary(&map);
    let hits = rays.iter().filter(|ray| caster.fast(ray).is_some()).count();
    println!("{hits} of {} rays meet the block", rays.len());
    let mut group = criterion.benchmark_group("primary rays");
    group
        .throughput(Throughput::Elements(rays.len() as u64))
        .sample_size(20);
    group.bench_function("exact", |bencher| {
        bencher.iter(|| {
            rays.iter()
                .filter(|ray| black_box(caster.exact(ray)).is_some())
                .count()
        });
    });
    group.bench_function("fast, many at once", |bencher| {
        bencher.iter(|| {
            let mut hits = 0;
            caster.fast_each(&rays, |_, hit| {
                hits += usize::from(black_box(hit).is_some())
            });
            hits
        });
    });
    group.bench_function("fast, one by one", |bencher| {
        bencher.iter(|| {
            rays.iter()
                .filter(|ray| black_box(caster.fast(ray)).is_some())
                .count()
        });
    });
    group.finish();
}

/// Bytes a second are those of the images.
fn images(criterion: &mut Criterion) {
    let scene = city();
    let mut group = criterion.benchmark_group("images");
    for side_texels in [32, 64, 128] {
        let map = block(&scene, side_texels);
        let bytes = encode(&map).unwrap();
        println!(
            "{side_texels}: {} bytes of {}",
            bytes.len(),
            map.image.len()
        );
        group.throughput(Throughput::Bytes(map.image.len() as u64));
        group.bench_function(format!("decode {side_texels}"), |bencher| {
            bencher.iter(|| decode(black_box(&bytes), (map.corner, map.side)).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, rays, images);
criterion_main!(benches);
