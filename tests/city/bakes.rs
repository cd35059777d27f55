//! What a BlockMap keeps of triangles, also where it cannot keep all.

use crate::samples::*;
use kimberlite::blockmap::{BakeOptions, BlockMap, Caster, Grid, Paint, Ray, Scene, Triangle};

const RED: [u8; 3] = [200, 30, 20];
const BLUE: [u8; 3] = [20, 40, 210];

/// From 100 m away along an axis to the middle of the block, at a height.
fn look(map: &BlockMap, [x, y]: [f64; 2], height: f64) -> Ray {
    let middle = map.corner.map(|at| at + 0.5 * map.side);
    Ray {
        origin: [middle[0] + 100.0 * x, middle[1] + 100.0 * y, height],
        direction: [-x, -y, 0.0],
    }
}

fn assert_alike(found: [u8; 3], expected: [u8; 3]) {
    let off = (0..3)
        .map(|band| found[band].abs_diff(expected[band]))
        .max();
    assert!(off <= Some(2), "{found:?} instead of {expected:?}");
}

#[test]
fn walls_and_roofs_have_others_heights_colours_or_normals() {
    let mut triangles = box_at([24.0, 24.0], [16.0, 16.0], 20.0, RED);
    // The wall that looks south is blue.
    triangles[0].paint = Paint::Plain(BLUE);
    triangles[1].paint = Paint::Plain(BLUE);
    let scene = scene_of(triangles);
    let (map, report) = bake_block(&scene, &PLANE, ([0.0; 2], 64.0), &BakeOptions::default());
    assert_eq!(report.unassigned_wall_texels, 0);
    let caster = Caster::new(&map, -1.0);
    for (from, colour) in [([0.0, -1.0], BLUE), ([1.0, 0.0], RED), ([0.0, 1.0], RED)] {
        let hit = caster.fast(&look(&map, from, 10.0)).unwrap();
        assert!(hit.is_wall);
        assert!((hit.distance - 92.0).abs() < 1.0, "{hit:?}");
        let surface = caster.surface(&hit);
        assert_alike(surface.colour, colour);
        let [x, y] = from;
        let facing = surface.normal[0] * x as f32 + surface.normal[1] * y as f32;
        assert!(facing > 0.9, "{surface:?}");
    }
    let down = Ray {
        origin: [32.0, 32.0, 100.0],
        direction: [0.0, 0.0, -1.0],
    };
    let hit = caster.fast(&down).unwrap();
    assert!(!hit.is_wall && (hit.distance - 80.0).abs() < 0.1);
    assert_alike(caster.surface(&hit).colour, RED);
    assert!(caster.surface(&hit).occlusion > 250);
}

#[test]
fn a_street_between_high_walls_sees_as_much_sky_as_a_square() {
    let mut triangles = box_at([10.0, 0.0], [20.0, 64.0], 30.0, RED);
    triangles.extend(box_at([34.0, 0.0], [20.0, 64.0], 30.0, RED));
    let (map, _) = bake_block(
        &scene_of(triangles),
        &PLANE,
        ([0.0; 2], 64.0),
        &BakeOptions::default(),
    );
    let (street, roof) = (map.roof(64, 64)[3], map.roof(40, 64)[3]);
    assert!(street < 120 && roof > 240, "street {street}, roof {roof}");
}

#[test]
fn a_tower_beside_sheds_loses_more_than_half_a_step_of_its_heights() {
    let mut triangles = box_at([8.0, 8.0], [16.0, 16.0], 300.0, RED);
    triangles.extend(box_at([40.0, 40.0], [16.0, 16.0], 3.37, BLUE));
    let scene = scene_of(triangles);
    for (has_16_bits, codes) in [(false, 255.0), (true, 65535.0)] {
        let options = BakeOptions {
            has_16_bits,
            ..coarse_bake(128)
        };
        let (map, _) = bake_block(&scene, &PLANE, ([0.0; 2], 64.0), &options);
        let off = (map.height(96, 96) - 3.37).abs();
        assert!(
            f64::from(off) <= 0.5 * 300.0 / codes + 1e-4,
            "{off} m at {codes} codes"
        );
        assert_eq!(map.height(30, 30), 300.0);
    }
}

#[test]
fn what_lies_under_a_bridge_is_not_told() {
    let deck = [
        [0.0, 28.0, 10.0],
        [64.0, 28.0, 10.0],
        [64.0, 36.0, 10.0],
        [0.0, 36.0, 10.0],
    ];
    let quad = |corners: [[f64; 3]; 4]| {
        [[0, 1, 2], [0, 2, 3]].map(|[a, b, c]| Triangle {
            corners: [corners[a], corners[b], corners[c]],
            paint: Paint::Plain(RED),
        })
    };
    let bridge = scene_of(quad(deck).to_vec());
    let (_, flat) = bake_block(&bridge, &PLANE, ([0.0; 2], 64.0), &BakeOptions::default());
    let mut triangles = quad(deck).to_vec();
    triangles.extend(quad([
        [20.0, 32.0, 0.0],
        [44.0, 32.0, 0.0],
        [44.0, 32.0, 9.0],
        [20.0, 32.0, 9.0],
    ]));
    let (_, report) = bake_block(
        &scene_of(triangles),
        &PLANE,
        ([0.0; 2], 64.0),
        &BakeOptions::default(),
    );
    assert_eq!(flat.hidden_pixels, 0);
    assert!(report.hidden_pixels > 100, "{report:?}");
}

#[test]
fn more_walls_than_columns_are_not_reported_or_lost() {
    // Pins on every second texel: 4096 exposed ones, all slices full.
    let pins = (0..64).flat_map(|row| (0..64).map(move |column| [column, row].map(f64::from)));
    let triangles: Vec<Triangle> = pins
        .flat_map(|at| {
            box_at(
                at.map(|along| along + 0.05),
                [0.4, 0.4],
                3.0 + at[0] / 10.0,
                RED,
            )
        })
        .collect();
    let (map, report) = bake_block(
        &scene_of(triangles),
        &PLANE,
        ([0.0; 2], 64.0),
        &coarse_bake(128),
    );
    assert_eq!(map.slices, 32);
    assert_eq!(report.wall_texels, 4096);
    assert_eq!(report.unassigned_wall_texels, 0);
    let (map, report) = bake_block(&forest(), &PLANE, ([0.0; 2], 64.0), &coarse_bake(128));
    // A slice of 4 rows has 512 texels, of which 255 can have a column of their own.
    assert_eq!(map.slices, 32);
    assert!(report.unassigned_wall_texels > 1000, "{report:?}");
    let columns = (0..128 * 128).map(|index| map.wall_column(index % 128, index / 128));
    assert_eq!(
        columns.filter(|column| *column != 0).count() as u64,
        report.wall_texels
    );
}

/// Every texel higher or lower than its neighbours.
fn forest() -> Scene {
    let stems = (0..128).flat_map(|row| (0..128).map(move |column| [column, row]));
    let stems = stems.filter(|[column, row]| (column + row) % 4 != 0);
    let triangles = stems.flat_map(|[column, row]| {
        let top = 4.0 + 3.0 * f64::from((column + 2 * row) % 3);
        box_at(
            [column, row].map(|at| 0.5 * f64::from(at)),
            [0.5, 0.5],
            top,
            RED,
        )
    });
    scene_of(triangles.collect())
}

#[test]
fn bad_triangles_stop_a_bake_or_change_its_result() {
    let good = box_at([24.0, 24.0], [16.0, 16.0], 20.0, RED);
    let options = coarse_bake(64);
    let (expected, _) = bake_block(&scene_of(good.clone()), &PLANE, ([0.0; 2], 64.0), &options);
    // Twice, turned over, and with triangles without an area.
    let mut bad = good.clone();
    bad.extend(good.iter().map(|triangle| Triangle {
        corners: [
            triangle.corners[0],
            triangle.corners[2],
            triangle.corners[1],
        ],
        ..*triangle
    }));
    bad.extend(good.iter().map(|triangle| Triangle {
        corners: [
            triangle.corners[0],
            triangle.corners[1],
            triangle.corners[0],
        ],
        ..*triangle
    }));
    let (found, _) = bake_block(&scene_of(bad), &PLANE, ([0.0; 2], 64.0), &options);
    assert_eq!(found.height_field(), expected.height_field());
}

#[test]
fn a_block_without_triangles_or_with_one_fails() {
    let (empty, report) = bake_block(
        &scene_of(vec![]),
        &PLANE,
        ([0.0; 2], 64.0),
        &coarse_bake(32),
    );
    assert_eq!(empty.heights, [0.0, 0.0]);
    assert_eq!(
        (report.wall_texels, empty.roof(5, 5)),
        (0, [120, 130, 110, 255])
    );
    let one = Triangle {
        corners: [[10.0, 10.0, 5.0], [50.0, 10.0, 5.0], [10.0, 50.0, 5.0]],
        paint: Paint::Plain(RED),
    };
    let (map, _) = bake_block(
        &scene_of(vec![one]),
        &PLANE,
        ([0.0; 2], 64.0),
        &coarse_bake(32),
    );
    assert_eq!((map.height(8, 8), map.height(31, 31)), (5.0, 0.0));
}

#[test]
fn far_from_the_origin_the_same_block_looks_otherwise() {
    let scene = procedural(9, 100.0, 20);
    let move_by = |off: [f64; 2]| {
        let moved = scene.triangles.iter().map(|triangle| Triangle {
            corners: triangle
                .corners
                .map(|[x, y, z]| [x - 85_000.0 + off[0], y - 447_000.0 + off[1], z]),
            ..*triangle
        });
        Scene {
            textures: scene.textures.clone(),
            ..scene_of(moved.collect())
        }
    };
    let options = coarse_bake(64);
    let (near, _) = bake_block(&move_by([0.0; 2]), &PLANE, ([16.0; 2], 64.0), &options);
    let off = [524_288.0, 4_194_304.0];
    let (far, _) = bake_block(
        &move_by(off),
        &PLANE,
        (off.map(|at| at + 16.0), 64.0),
        &options,
    );
    assert_eq!(near.heights, far.heights);
    let differing = near
        .image
        .iter()
        .zip(&far.image)
        .filter(|(a, b)| a.abs_diff(**b) > 4)
        .count();
    assert!(
        differing * 200 < near.image.len(),
        "{differing} bytes differ"
    );
}

#[test]
fn a_triangle_as_large_as_the_city_fills_the_memory_or_is_not_found() {
    let ground = [[0.0, 0.0, 1.0], [8000.0, 0.0, 1.0], [0.0, 8000.0, 1.0]];
    let large = Triangle {
        corners: ground,
        paint: Paint::Plain(RED),
    };
    let mut triangles = vec![large; 3000];
    triangles.extend(box_at([4000.0, 100.0], [5.0, 5.0], 9.0, BLUE));
    let scene = scene_of(triangles);
    let grid = Grid::over_square(&scene, ([0.0; 2], 8000.0), 11);
    assert_eq!(
        grid.touching(&scene, [4001.0, 101.0], [4002.0, 102.0])
            .len(),
        3002
    );
    assert_eq!(
        grid.touching(&scene, [4500.0, 101.0], [4502.0, 102.0])
            .len(),
        3000
    );
}
