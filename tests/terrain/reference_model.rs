//! The reference model by itself: the lattice's structure, and what makes a legal cut crack-free.

use std::collections::{BTreeMap, BTreeSet};

use crate::reference::lattice::{Diamond, Lattice, Point};
use crate::reference::model::{Decoder, Model, Raster, encode};
use proptest::prelude::*;
use proptest::sample::Index as Choice;

/// Width, height and log2 of the cells of domains that exercise the borders.
const AWKWARD: [(usize, usize, u32); 10] = [
    (17, 17, 2),
    (33, 33, 3),
    (21, 27, 2),
    (20, 33, 3),
    (33, 2, 2),
    (2, 40, 3),
    (11, 6, 2),
    (2, 2, 2),
    (5, 5, 1),
    (6, 5, 1),
];

fn awkward_lattices() -> impl Iterator<Item = Lattice> {
    AWKWARD
        .into_iter()
        .map(|(width, height, log2)| Lattice::new(width, height, log2))
}

fn point(diamond: Diamond) -> Point {
    (diamond.x, diamond.y)
}

#[test]
fn every_centre_names_one_diamond_and_tells_its_level() {
    for lattice in awkward_lattices() {
        let diamonds = lattice.diamonds();
        let centres: BTreeSet<Point> = diamonds.iter().copied().map(point).collect();
        assert_eq!(centres.len(), diamonds.len());
        for diamond in diamonds {
            assert_eq!(
                Lattice::level_of(point(diamond)),
                Some(diamond.level),
                "{diamond:?}"
            );
        }
    }
}

#[test]
fn parents_are_those_whose_child_one_is() {
    for lattice in awkward_lattices() {
        let mut parents: BTreeMap<Diamond, BTreeSet<Diamond>> = BTreeMap::new();
        for parent in lattice.diamonds() {
            for child in lattice.children(parent) {
                parents.entry(child).or_default().insert(parent);
            }
        }
        for diamond in lattice.diamonds() {
            let found: Vec<Diamond> = lattice.parents(diamond).into_iter().flatten().collect();
            assert_eq!(
                found.len(),
                parents.get(&diamond).map_or(0, BTreeSet::len),
                "{diamond:?}"
            );
            assert!(
                found
                    .iter()
                    .all(|parent| parents[&diamond].contains(parent)),
                "{diamond:?}"
            );
            assert_eq!(found.is_empty(), diamond.level == 0, "{diamond:?}");
        }
        let levels = (0..=lattice.leaf_level()).flat_map(|level| lattice.level(level));
        assert!(
            parents
                .keys()
                .copied()
                .collect::<BTreeSet<_>>()
                .is_subset(&levels.collect())
        );
    }
}

#[test]
fn a_child_half_is_made_of_its_parents_vertices_and_centres() {
    for lattice in awkward_lattices() {
        for child in lattice.diamonds() {
            for (half, parent) in lattice.parents(child).into_iter().enumerate() {
                let Some(parent) = parent else { continue };
                let vertices = lattice.vertex_indices().into_iter();
                let centres = lattice.centre_indices().into_iter();
                let grid: BTreeSet<Point> = vertices
                    .map(|index| lattice.vertex(parent, index))
                    .chain(centres.map(|index| lattice.centre(parent, index)))
                    .collect();
                for index in lattice.vertex_indices() {
                    if lattice.half_has_vertex(child, half, index) {
                        assert!(
                            grid.contains(&lattice.vertex(child, index)),
                            "{child:?} {index:?}"
                        );
                    }
                }
                assert_eq!(
                    lattice.vertex(child, lattice.apexes(child)[half]),
                    point(parent)
                );
            }
        }
    }
}

#[test]
fn the_hypotenuse_splits_a_square_into_two_halves_alike() {
    let lattice = Lattice::new(21, 27, 2);
    for diamond in lattice.diamonds() {
        let [first, second] = lattice.apexes(diamond);
        assert_eq!(first.1, 0, "half 0 has the apex with j = 0");
        assert_eq!(lattice.reflection(diamond, first), second);
        for half in 0..2 {
            let centres = lattice.centre_indices().into_iter();
            let inside = centres.filter(|index| lattice.half_has_centre(diamond, half, *index));
            assert_eq!(inside.count(), 10, "N (N + 1) / 2");
            let triangles = lattice.triangles(diamond, half);
            assert_eq!(triangles.len(), 16, "N^2");
            let step = |(a, b): (Point, Point)| ((a.0 - b.0).abs(), (a.1 - b.1).abs());
            let across = step((
                lattice.vertex(diamond, first),
                lattice.vertex(diamond, second),
            ));
            for [from, to, _] in triangles {
                let (x, y) = step((from, to));
                assert_eq!(
                    x * across.0,
                    y * across.1,
                    "long edges cross the line of the apexes"
                );
            }
        }
    }
}

#[test]
fn every_sample_is_a_root_vertex_or_one_centre() {
    for lattice in awkward_lattices() {
        let mut seen = BTreeSet::new();
        for index in lattice.vertex_indices() {
            seen.extend(lattice.sample(lattice.vertex(lattice.root(), index)));
        }
        for diamond in lattice.diamonds() {
            for index in lattice.centre_indices() {
                let refinable = diamond.level < lattice.leaf_level();
                if refinable && lattice.is_predicted(diamond, index) {
                    let sample = lattice.sample(lattice.centre(diamond, index));
                    assert!(
                        sample.is_none_or(|sample| seen.insert(sample)),
                        "{diamond:?} {index:?}"
                    );
                }
            }
        }
        assert_eq!(seen.len() as i64, lattice.width * lattice.height);
    }
}

/// Height at column x and row y, or a void, on a 17 x 17 raster in diamonds of 8 cells.
fn surface(height: impl Fn(i64, i64) -> Option<i64>) -> Model {
    let samples = (0..17 * 17)
        .map(|sample| height(sample % 17, sample / 17))
        .collect();
    encode(&Raster::new(17, 17, samples), 3, 0)
}

/// The coefficients of whole diamonds, of their inner or of their outer centres.
fn coefficients(model: &Model, inner: bool) -> Vec<i32> {
    let lattice = &model.lattice;
    let mut found = Vec::new();
    for (diamond, record) in &model.diamonds {
        for ((i, j), coefficient) in lattice
            .centre_indices()
            .into_iter()
            .zip(&record.coefficients)
        {
            let is_inner =
                (1..lattice.cells - 1).contains(&i) && (1..lattice.cells - 1).contains(&j);
            if lattice.present(*diamond) == [true, true] && is_inner == inner {
                found.extend(*coefficient);
            }
        }
    }
    found
}

#[test]
fn order_4_predicts_cubics_and_order_2_planes_without_a_residual() {
    let cubic = surface(|x, y| Some(x * x * x - 2 * x * x * y + 5 * x * y + 7 * y * y - y * y * y));
    assert!(coefficients(&cubic, true).iter().all(|k| *k == 0));
    assert!(coefficients(&cubic, false).iter().any(|k| *k != 0));
    let plane = surface(|x, y| Some(3 * x - 11 * y + 40));
    assert!(coefficients(&plane, false).iter().all(|k| *k == 0));
    assert!(plane.errors().values().all(|error| *error == 0.0));
}

#[test]
fn root_vertices_that_are_not_valid_take_the_nearest_valid_one() {
    let root_values = |width, height, samples: &[Option<i64>]| -> Vec<i64> {
        let model = encode(&Raster::new(width, height, samples.to_vec()), 1, 0);
        model.diamonds[&model.lattice.root()]
            .vertices
            .iter()
            .map(|vertex| vertex.value)
            .collect()
    };
    // The middle of the first row is as near to its left as to its right: lowest index.
    let samples = [Some(1), None, Some(3), Some(4), Some(5), Some(6)];
    assert_eq!(root_values(3, 2, &samples), [1, 1, 3, 4, 5, 6, 4, 5, 6]);
    let mut samples = vec![None; 25];
    assert_eq!(root_values(5, 5, &samples), [0; 9]);
    (samples[1], samples[3]) = (Some(-2), Some(7));
    assert_eq!(
        root_values(5, 5, &samples),
        [2; 9],
        "valid samples, but not at the root"
    );
}

#[test]
fn half_a_diamond_is_predicted_from_its_reflection() {
    let mut samples = vec![Some(0); 25];
    samples[6] = Some(10);
    let model = encode(&Raster::new(5, 5, samples), 1, 0);
    let middle = model.lattice.root().x;
    let record = &model.diamonds[&Diamond {
        level: 1,
        x: middle,
        y: 0,
    }];
    // At (1, 0): 0 and 0 on the border, 10 below it and the same 10 above. At (3, 0): only zeros.
    let coded: Vec<i32> = record.coefficients.iter().flatten().copied().collect();
    let sum: i32 = coded.iter().sum();
    assert_eq!(
        coded.len(),
        3,
        "of four, the one beyond the border is not coded"
    );
    assert_eq!(coded.iter().min(), Some(&-5));
    // At (2, 1), between 10, 0, 0 and 0: (10 + 2) >> 2.
    assert_eq!(sum, -5 - 3);
}

/// A 5 x 5 raster in diamonds of 2 cells: the errors of the root and of its upper, left, right and
/// lower child.
fn small_errors(change: impl Fn(&mut [Option<i64>])) -> [f64; 5] {
    let mut samples = vec![Some(0); 25];
    change(&mut samples);
    let model = encode(&Raster::new(5, 5, samples), 1, 0);
    let errors = model.errors();
    let (root, root_point) = (model.lattice.root(), point(model.lattice.root()));
    let middle = root_point.0;
    let child = |x, y| errors[&Diamond { level: 1, x, y }];
    [
        errors[&root],
        child(middle, 0),
        child(0, middle),
        child(2 * middle, middle),
        child(middle, 2 * middle),
    ]
}

#[test]
fn stored_errors_are_those_found_by_hand() {
    assert_eq!(small_errors(|_| ()), [0.0; 5]);
    // A spike at (1, 1), which the upper and left child have as a vertex beside (2, 1) and (1, 2).
    assert_eq!(
        small_errors(|samples| samples[6] = Some(10)),
        [10.0, 5.0, 5.0, 0.0, 0.0]
    );
    let unbounded = f64::INFINITY;
    let holed = [unbounded, unbounded, unbounded, 0.0, 0.0];
    assert_eq!(
        small_errors(|samples| samples[6] = None),
        holed,
        "a void is covered"
    );
}

#[test]
fn ground_between_void_vertices_is_uncovered_and_unbounded() {
    let mut samples = vec![None; 25];
    for sample in [1, 6, 7] {
        samples[sample] = Some(3);
    }
    let model = encode(&Raster::new(5, 5, samples), 1, 0);
    let (root, ground) = (model.lattice.root(), model.ground());
    assert_eq!(ground.len(), 2, "one triangle of two quarters");
    assert!((0..2).all(|half| model.drawn(root, half).is_empty()));
    assert_eq!(model.own_error(root, &ground), f64::INFINITY);
}

#[test]
fn triangles_are_drawn_across_the_domains_edge_but_not_beyond() {
    // The root's vertices are two samples apart, the domain five squares by two.
    let model = encode(&Raster::new(6, 3, (0..18).map(Some).collect()), 2, 0);
    let drawn = |half| model.drawn(model.lattice.root(), half).len();
    assert_eq!((drawn(0), drawn(1)), (5, 1), "two in each of three squares");
    assert_eq!(
        model.ground().len(),
        4 * 5 * 2,
        "four quarters in each square of samples"
    );
    assert!(model.errors().values().all(|error| error.is_finite()));
}

/// A terrain, its void mask, and the settings it is encoded with.
#[derive(Clone, Debug)]
struct Terrain {
    raster: Raster,
    cells_log2: u32,
    bound: i64,
}

fn terrain() -> impl Strategy<Value = Terrain> {
    let domain = prop_oneof![
        proptest::sample::select(AWKWARD.to_vec()),
        (2..30_usize, 2..30_usize, 1..=3_u32),
    ];
    let amplitude = prop_oneof![Just(3_i64), Just(1000), Just(i64::from(i32::MAX))];
    let bound = prop_oneof![Just(0_i64), Just(1), Just(7), 0..5000_i64];
    (domain, amplitude, bound, 0..4_u32).prop_flat_map(
        |((width, height, cells_log2), amplitude, bound, voids)| {
            let height_of = move |(value, noise, band): (i64, u32, bool)| match voids {
                0 => Some(value),
                1 => (noise > 30).then_some(value),
                2 => (!band && noise > 1).then_some(value),
                _ => (noise == 0).then_some(value),
            };
            let sample = (-amplitude - 1..=amplitude, 0..100_u32);
            let samples = proptest::collection::vec(sample, width * height);
            (samples, 0..width, 0..height).prop_map(move |(samples, left, top)| {
                let samples = samples.into_iter().enumerate().map(|(at, (value, noise))| {
                    height_of((value, noise, at % width >= left && at / width >= top))
                });
                let raster = Raster::new(width, height, samples.collect());
                Terrain {
                    raster,
                    cells_log2,
                    bound,
                }
            })
        },
    )
}

/// Checks one cut: vertices that are shared have one value, the triangles cover the domain once,
/// and every edge inside the domain belongs to two triangles, so that none ends within another.
fn check_cut(decoder: &Decoder) -> Result<(), TestCaseError> {
    let lattice = &decoder.model.lattice;
    let mut values = BTreeMap::new();
    let mut edges: BTreeMap<[Point; 2], usize> = BTreeMap::new();
    let mut covered = BTreeSet::new();
    for ((diamond, half), vertices) in &decoder.halves {
        for (point, value) in vertices {
            prop_assert_eq!(
                values.entry(*point).or_insert(*value),
                value,
                "at {:?}",
                point
            );
        }
        for triangle in lattice.triangles(*diamond, *half) {
            for atom in lattice.atoms(&triangle) {
                prop_assert!(covered.insert(atom), "{:?} overlaps another", triangle);
            }
            let [a, b, c] = triangle;
            for mut edge in [[a, b], [b, c], [c, a]] {
                edge.sort();
                *edges.entry(edge).or_default() += 1;
            }
        }
    }
    prop_assert_eq!(
        covered.len() as i64,
        4 * (lattice.width - 1) * (lattice.height - 1)
    );
    let [_, _, (right, bottom), _] = lattice.domain();
    for ([(x0, y0), (x1, y1)], triangles) in edges {
        let (x, y) = ((x0 + x1) / 2, (y0 + y1) / 2);
        if 0 < x && x < right && 0 < y && y < bottom {
            prop_assert_eq!(triangles, 2, "an edge through {:?}", (x, y));
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_sample_is_decoded_within_the_bound_and_the_range(terrain in terrain()) {
        let model = encode(&terrain.raster, terrain.cells_log2, terrain.bound);
        let mut decoder = Decoder::new(&model);
        while let Some(diamond) = decoder.refinable().pop() {
            decoder.refine(diamond);
        }
        let decoded: BTreeMap<Point, i64> =
            decoder.halves.into_values().flatten().collect();
        let (low, high) = terrain.raster.range;
        prop_assert!(decoded.values().all(|value| (low..=high).contains(value)));
        for (sample, input) in terrain.raster.samples.iter().enumerate() {
            let (row, column) = (sample / terrain.raster.width, sample % terrain.raster.width);
            let value = decoded[&model.lattice.point(column as i64, row as i64)];
            if let Some(input) = input {
                prop_assert!((value - input).abs() <= terrain.bound, "{} for {}", value, input);
            }
        }
    }

    #[test]
    fn a_coefficient_is_stored_for_each_valid_sample_and_no_other(terrain in terrain()) {
        let model = encode(&terrain.raster, terrain.cells_log2, terrain.bound);
        let root = &model.diamonds[&model.lattice.root()];
        let at_root = root.vertices.iter().filter(|vertex| vertex.valid).count();
        let records = model.diamonds.values();
        let coded: usize = records.map(|record| record.coefficients.iter().flatten().count()).sum();
        prop_assert_eq!(at_root + coded, terrain.raster.samples.iter().flatten().count());
    }

    #[test]
    fn any_legal_cut_is_free_of_cracks_and_of_its_history(
        terrain in terrain(),
        choices in proptest::collection::vec(any::<Choice>(), 0..60),
        checks in 1..20_usize,
    ) {
        let model = encode(&terrain.raster, terrain.cells_log2, terrain.bound);
        let mut decoder = Decoder::new(&model);
        check_cut(&decoder)?;
        for (step, choice) in choices.iter().enumerate() {
            let refinable = decoder.refinable();
            if refinable.is_empty() {
                break;
            }
            decoder.refine(refinable[choice.index(refinable.len())]);
            if step % checks == 0 {
                check_cut(&decoder)?;
            }
        }
        check_cut(&decoder)?;
        for (point, value) in decoder.halves.values().flatten() {
            prop_assert_eq!(&model.values[point], value, "at {:?}", point);
        }
    }

    #[test]
    fn a_stored_error_bounds_everything_below_it(terrain in terrain()) {
        let model = encode(&terrain.raster, terrain.cells_log2, terrain.bound);
        let (errors, ground) = (model.errors(), model.ground());
        for (diamond, error) in &errors {
            prop_assert!(model.own_error(*diamond, &ground) <= *error, "{:?}", diamond);
            for child in model.lattice.children(*diamond) {
                prop_assert!(errors[&child] <= *error, "{:?}", diamond);
            }
        }
    }
}
