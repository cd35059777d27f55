//! Properties of the diamond graph that every other room relies on.

use kimberlite::lattice::{Apex, Diamond, Lattice, PatchGrid, gather_half, reflect_absent_half};
use proptest::prelude::*;
use std::collections::{HashMap, HashSet};

fn lattices() -> impl Strategy<Value = Lattice> {
    (2u32..140, 2u32..140, 2u32..4)
        .prop_map(|(width, height, cells)| Lattice::new(width, height, cells).unwrap())
}

fn vertices(lattice: &Lattice, diamond: Diamond) -> Vec<[i64; 2]> {
    let placement = lattice.placement(diamond);
    let side = lattice.cells() + 1;
    (0..side * side)
        .map(|k| placement.vertex(k % side, k / side))
        .collect()
}

fn centres(lattice: &Lattice, diamond: Diamond) -> Vec<[i64; 2]> {
    let placement = lattice.placement(diamond);
    let side = lattice.cells();
    (0..side * side)
        .map(|k| placement.centre(k % side, k / side))
        .collect()
}

proptest! {
    #[test]
    fn ranks_number_the_diamonds_of_every_level_without_gap(lattice in lattices()) {
        let mut next = 0;
        for level in 0..=lattice.levels() {
            let diamonds = lattice.diamonds(level);
            prop_assert_eq!(diamonds.iter().collect::<HashSet<_>>().len(), diamonds.len());
            for &diamond in &diamonds {
                prop_assert!(lattice.contains(diamond));
                prop_assert_eq!(diamond.level(), level);
                if level < lattice.levels() {
                    prop_assert_eq!(lattice.rank(diamond), next);
                    prop_assert_eq!(lattice.diamond(next), diamond);
                    next += 1;
                }
            }
        }
        prop_assert_eq!(next, lattice.diamond_count());
    }

    #[test]
    fn parents_and_children_name_each_other(lattice in lattices()) {
        for level in 0..=lattice.levels() {
            let mut reached = HashSet::new();
            for diamond in lattice.diamonds(level) {
                if level > 0 {
                    prop_assert!(lattice.halves(diamond).contains(&true));
                }
                for parent in lattice.parents(diamond).into_iter().flatten() {
                    prop_assert_eq!(parent.level() + 1, level);
                    prop_assert!(lattice.children(parent).contains(&Some(diamond)));
                }
                for child in lattice.children(diamond).into_iter().flatten() {
                    prop_assert!(lattice.parents(child).contains(&Some(diamond)));
                    reached.insert(child);
                }
            }
            if level < lattice.levels() {
                prop_assert_eq!(reached, lattice.diamonds(level + 1).into_iter().collect());
            }
        }
    }

    #[test]
    fn every_sample_is_a_root_vertex_or_one_centre_of_one_diamond(lattice in lattices()) {
        let mut owners: HashMap<[i64; 2], u32> = HashMap::new();
        for point in vertices(&lattice, lattice.root()) {
            *owners.entry(point).or_default() += 1;
        }
        for level in 0..lattice.levels() {
            for diamond in lattice.diamonds(level) {
                for point in centres(&lattice, diamond) {
                    *owners.entry(point).or_default() += 1;
                }
            }
        }
        for row in 0..i64::from(lattice.height()) {
            for column in 0..i64::from(lattice.width()) {
                prop_assert_eq!(owners.get(&[column, row]), Some(&1));
            }
        }
    }

    #[test]
    fn a_child_gathers_the_vertices_at_its_own_positions(lattice in lattices()) {
        for level in 1..=lattice.levels() {
            for child in lattice.diamonds(level) {
                let expected = vertices(&lattice, child);
                let mut gathered = vec![[i64::MIN; 2]; expected.len()];
                for (half, parent) in lattice.parents(child).into_iter().enumerate() {
                    let Some(parent) = parent else { continue };
                    let (v, c) = (vertices(&lattice, parent), centres(&lattice, parent));
                    gather_half(&lattice, parent, (&v, &c), child, half, &mut gathered);
                }
                let halves = lattice.halves(child);
                for (index, (got, want)) in gathered.iter().zip(&expected).enumerate() {
                    let side = lattice.cells() + 1;
                    let (i, j) = (index % side, index / side);
                    let present = (0..2).any(|half| halves[half] && in_half(&lattice, child, half, i, j));
                    if present {
                        prop_assert_eq!(got, want);
                    } else {
                        prop_assert_eq!(got, &[i64::MIN; 2]);
                    }
                }
                if let Some(absent) = (0..2).find(|&half| !halves[half]) {
                    reflect_absent_half(lattice.cells(), lattice.apexes(child)[absent], &mut gathered);
                    prop_assert!(gathered.iter().all(|point| point[0] != i64::MIN));
                }
            }
        }
    }
}

fn in_half(lattice: &Lattice, diamond: Diamond, half: usize, i: usize, j: usize) -> bool {
    let (first, last) = lattice.apexes(diamond)[half].row(lattice.cells() as i64, j as i64);
    (first..=last).contains(&(i as i64))
}

/// Triangles as sets of positions with their orientation, so that list and strip compare.
fn normalised(triangle: [u16; 3]) -> [u16; 3] {
    let least = (0..3).min_by_key(|&k| triangle[k]).unwrap();
    [
        triangle[least],
        triangle[(least + 1) % 3],
        triangle[(least + 2) % 3],
    ]
}

#[test]
fn strip_and_list_are_the_same_triangles_and_cover_the_half() {
    for (cells, flipped) in [(4, false), (8, true), (64, true), (128, false)] {
        let grid = PatchGrid::new(cells, flipped);
        let list: HashSet<_> = grid
            .triangle_list()
            .chunks(3)
            .map(|t| normalised([t[0], t[1], t[2]]))
            .collect();
        let strip = grid.triangle_strip();
        let mut stripped = HashSet::new();
        for k in 0..strip.len() - 2 {
            let (a, b, c) = (strip[k], strip[k + 1], strip[k + 2]);
            if a != b && b != c && c != a {
                let triangle = if k % 2 == 0 { [a, b, c] } else { [b, a, c] };
                assert!(
                    stripped.insert(normalised(triangle)),
                    "a triangle twice in the strip"
                );
            }
        }
        assert_eq!(list.len(), cells * cells);
        assert_eq!(list, stripped);
        for apex in [Apex::Origin, Apex::Right, Apex::Far, Apex::Bottom] {
            let order = grid.matrix_indices(apex);
            assert_eq!(
                order.iter().collect::<HashSet<_>>().len(),
                grid.vertex_count()
            );
            let side = cells as i64 + 1;
            let position = |v: u16| {
                let index = i64::from(order[usize::from(v)]);
                [index % side, index / side]
            };
            let doubled: i64 = list
                .iter()
                .map(|&[a, b, c]| {
                    let (a, b, c) = (position(a), position(b), position(c));
                    let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
                    assert_eq!(area.abs(), 1);
                    assert_eq!(area < 0, flipped);
                    area.abs()
                })
                .sum();
            assert_eq!(doubled, (cells * cells) as i64);
        }
    }
}

#[test]
fn rasters_without_area_are_refused() {
    for (width, height) in [(1, 1), (1, 50), (50, 1), (0, 7)] {
        let message = Lattice::new(width, height, 6).unwrap_err().to_string();
        assert!(message.contains("both sides need at least 2"), "{message}");
    }
    assert!(Lattice::new(2, 1_000_000, 6).is_ok());
}
