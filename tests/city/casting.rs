//! Rays against one BlockMap.

use crate::samples::config;
use glam::DVec3;
use kimberlite::blockmap::{BlockMap, Caster, Hit, Ray};
use proptest::prelude::*;

const FLOOR: f64 = -1.0;

/// Blocks with towers, steps and flats, some of whose exposed texels have walls.
fn blocks() -> impl Strategy<Value = BlockMap> {
    let sides = prop_oneof![Just(32usize), Just(64)];
    (sides, any::<u64>(), 0.5f64..100.0, any::<bool>(), 0u32..8).prop_map(
        |(texels, seed, side, has_16_bits, roughness)| {
            let mut map = BlockMap::new(texels, [1000.0, -2000.0], side).unwrap();
            let mut state = seed | 1;
            let mut random = move || {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 40) as f32 / (1u64 << 24) as f32
            };
            let mut heights = vec![0.0; texels * texels];
            for _ in 0..3 * roughness {
                let [x, y, w, h] = [0; 4].map(|_| (random() * texels as f32) as usize);
                let top = random() * 2.0 * side as f32;
                for row in y..(y + h / 3).min(texels) {
                    for column in x..(x + w / 3).min(texels) {
                        heights[row * texels + column] = top;
                    }
                }
            }
            if roughness % 2 == 1 {
                heights.iter_mut().for_each(|height| *height += random());
            }
            map.set_heights(&heights, has_16_bits);
            map.roof_slope = 2.0;
            for index in 0..texels * texels {
                let (column, row) = (index % texels, index / texels);
                let [height, _, x, y] = map.at(column, row);
                map.set(column, row, [height, (random() * 3.0) as u8, x, y]);
            }
            map
        },
    )
}

/// Directions: any, along an axis, diagonal, grazing.
fn directions() -> impl Strategy<Value = DVec3> {
    let any = || -1.0f64..1.0;
    prop_oneof![
        4 => (any(), any(), any()).prop_map(|(x, y, z)| DVec3::new(x, y, z)),
        1 => (0u32..4, any()).prop_map(|(turn, z)| {
            let quarter = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y][turn as usize];
            quarter + DVec3::Z * (z * 0.1).min(0.0)
        }),
        1 => (0u32..4).prop_map(|turn| {
            DVec3::new(f64::from(turn % 2) * 2.0 - 1.0, f64::from(turn / 2) * 2.0 - 1.0, -0.02)
        }),
        1 => Just(DVec3::NEG_Z),
        1 => Just(DVec3::Z),
        1 => (any(), any()).prop_map(|(x, y)| DVec3::new(x, y, 0.0)),
    ]
    .prop_filter("a direction", |direction| direction.length() > 1e-3)
}

/// A place in the block or around it, often on a line between texels.
fn places() -> impl Strategy<Value = (DVec3, bool)> {
    let along = || -0.3f64..1.3;
    ((along(), along(), -0.1f64..2.2), any::<bool>())
        .prop_map(|((x, y, z), on_line)| (DVec3::new(x, y, z), on_line))
}

fn ray(map: &BlockMap, (place, on_line): (DVec3, bool), direction: DVec3) -> Ray {
    let texel = map.texel();
    let along = |share: f64| {
        let at = share * map.side;
        if on_line {
            (at / texel).round() * texel
        } else {
            at
        }
    };
    Ray {
        origin: [
            map.corner[0] + along(place.x),
            map.corner[1] + along(place.y),
            place.z * map.side,
        ],
        direction: direction.to_array(),
    }
}

/// The nearest prism that a ray meets, by a look at each; prisms are shrunk by a margin.
fn nearest_of_all(map: &BlockMap, ray: &Ray, margin: f64) -> Option<f64> {
    let texel = map.texel();
    let mut nearest: Option<f64> = None;
    for index in 0..map.side_texels * map.side_texels {
        let (column, row) = (index % map.side_texels, index / map.side_texels);
        let low = [
            map.corner[0] + column as f64 * texel + margin,
            map.corner[1] + row as f64 * texel + margin,
            FLOOR,
        ];
        let high = [
            low[0] + texel - 2.0 * margin,
            low[1] + texel - 2.0 * margin,
            f64::from(map.height(column, row)) - margin,
        ];
        let (mut start, mut end) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
            if direction == 0.0 {
                if origin < low[axis] || origin > high[axis] {
                    end = -1.0;
                }
                continue;
            }
            let ends = [
                (low[axis] - origin) / direction,
                (high[axis] - origin) / direction,
            ];
            start = start.max(ends[0].min(ends[1]));
            end = end.min(ends[0].max(ends[1]));
        }
        if start <= end {
            nearest = Some(nearest.map_or(start, |other| other.min(start)));
        }
    }
    nearest
}

proptest! {
    #![proptest_config(config(300))]

    #[test]
    fn the_fast_caster_misses_what_the_exact_one_meets(
        map in blocks(),
        rays in prop::collection::vec((places(), directions()), 200),
    ) {
        let caster = Caster::new(&map, FLOOR);
        let rays = rays.into_iter();
        let rays: Vec<Ray> = rays.map(|(place, direction)| ray(&map, place, direction)).collect();
        let mut each = Vec::new();
        caster.fast_each(&rays, |index, hit| each.push((index, hit)));
        prop_assert_eq!(each.len(), rays.len());
        for (number, (ray, (index, hit))) in rays.iter().zip(each).enumerate() {
            let exact = caster.exact(ray);
            prop_assert_eq!(index, number);
            prop_assert_eq!(hit, exact, "{:?} among others", ray);
            prop_assert_eq!(caster.fast(ray), exact, "{:?}", ray);
        }
    }

    #[test]
    fn a_ray_passes_through_a_prism_or_is_stopped_by_none(
        map in blocks(),
        rays in prop::collection::vec((places(), directions()), 20),
    ) {
        let caster = Caster::new(&map, FLOOR);
        for (place, direction) in rays {
            let ray = ray(&map, place, direction);
            let margin = 1e-4 * map.side;
            let found = caster.exact(&ray).map(|hit: Hit| hit.distance);
            // Not before the nearest of slightly larger prisms, and not after that of slightly smaller ones.
            let (earliest, latest) = (
                nearest_of_all(&map, &ray, -margin),
                nearest_of_all(&map, &ray, margin),
            );
            if let Some(latest) = latest {
                let found = found.unwrap_or(f64::INFINITY);
                prop_assert!(found <= latest + 1e-3 * map.side / direction.length(), "{found} after {latest}");
            }
            if let Some(found) = found {
                let earliest = earliest.unwrap_or(f64::INFINITY);
                prop_assert!(found >= earliest - 1e-3 * map.side / direction.length(), "{found} before {earliest}");
            }
        }
    }
}

#[test]
fn a_ray_that_starts_in_a_prism_goes_on() {
    let mut map = BlockMap::new(32, [0.0; 2], 32.0).unwrap();
    map.set_heights(&vec![10.0; 32 * 32], false);
    let caster = Caster::new(&map, FLOOR);
    let ray = Ray {
        origin: [16.5, 16.5, 5.0],
        direction: [1.0, 0.2, 0.3],
    };
    let hit = caster.fast(&ray).unwrap();
    assert_eq!((hit.distance, hit.texel), (0.0, [16, 16]));
}

#[test]
fn the_length_of_a_direction_changes_what_is_met() {
    let mut map = BlockMap::new(32, [0.0; 2], 32.0).unwrap();
    let heights: Vec<f32> = (0..32 * 32).map(|index| (index % 7) as f32).collect();
    map.set_heights(&heights, false);
    let caster = Caster::new(&map, FLOOR);
    let ray = |length: f64| Ray {
        origin: [-10.0, 3.3, 9.0],
        direction: [2.0, 0.3, -0.4].map(|along| along * length),
    };
    let one = caster.fast(&ray(1.0)).unwrap();
    for exponent in [-900, -60, 60, 900] {
        let length = 2f64.powi(exponent);
        let hit = caster.fast(&ray(length)).unwrap();
        assert_eq!((hit.texel, hit.height), (one.texel, one.height));
        assert_eq!(hit.distance, one.distance / length);
    }
}

#[test]
fn a_ray_along_a_bound_of_the_block_goes_through() {
    let mut map = BlockMap::new(32, [1000.0, -64.0], 64.0).unwrap();
    let heights: Vec<f32> = (0..32 * 32).map(|index| (index % 5) as f32).collect();
    map.set_heights(&heights, false);
    let caster = Caster::new(&map, FLOOR);
    let meets = |origin, direction| {
        let ray = Ray { origin, direction };
        assert_eq!(caster.fast(&ray), caster.exact(&ray));
        caster.fast(&ray).is_some()
    };
    for zero in [0.0, -0.0] {
        for x in [1000.0, 1032.0, 1064.0] {
            for y in [-64.0, -32.0, 0.0] {
                assert!(meets([x, y, 9.0], [zero, zero, -1.0]), "down at {x}, {y}");
            }
        }
        assert!(
            meets([900.0, -30.0, 4.0], [1.0, 0.1, zero]),
            "level with the highest roof"
        );
        assert!(
            meets([900.0, 0.0, 1.0], [1.0, zero, zero]),
            "along the northern edge"
        );
        assert!(
            !meets([900.0, 0.1, 1.0], [1.0, zero, zero]),
            "beside the northern edge"
        );
    }
}
