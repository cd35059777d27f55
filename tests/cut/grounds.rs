//! Cuts with colours on their heights, and with detail beyond them.

use crate::properties::Surface;
use crate::scenes::*;
use crate::support::memory::MemorySource;
use kimberlite::Error;
use kimberlite::build::source::RowSource;
use kimberlite::build::{BuildOptions, build};
use kimberlite::cut::{
    ColourForm, Colouring, Cut, CutOptions, Detail, DiamondSource, Layer, Patch, View,
};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::lattice::{Apex, Lattice};
use kimberlite::schedule::Budget;
use kimberlite::store::{Access, EntropyKind, TransformKind};
use kimberlite::tool::count_cracks;
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// An image over a scene: texels from one sample to the next, and cells of its diamonds, as powers of two.
#[derive(Clone, Copy, Debug)]
struct Picture {
    finer_log2: u32,
    cells_log2: u32,
    transform: TransformKind,
    /// Some of it is void.
    has_holes: bool,
}

fn pictures() -> impl Strategy<Value = Picture> {
    let transforms = prop_oneof![
        3 => Just(TransformKind::Interpolating),
        1 => Just(TransformKind::Lifted)
    ];
    (0u32..3, 4u32..7, transforms, any::<bool>()).prop_map(
        |(finer_log2, cells_log2, transform, has_holes)| Picture {
            finer_log2,
            cells_log2,
            transform,
            has_holes,
        },
    )
}

/// The pixel there: smooth and rough, with a part of one colour.
fn pixel([column, row]: [i64; 2]) -> [u8; 3] {
    if column < 24 && row > 30 {
        return [10, 20, 30];
    }
    let mixed = (column * 7919 + row * 104_729) % 61;
    [column * 3, row * 2, 40 * (column / 16 + row / 16) + mixed]
        .map(|number| number.rem_euclid(256) as u8)
}

impl Picture {
    fn is_void(&self, [column, row]: [i64; 2]) -> bool {
        self.has_holes
            && ((column - 30).pow(2) + (row - 9).pow(2) < 60 || (column + 3 * row) % 67 == 0)
    }

    fn lattice(&self, source: &MemorySource) -> Lattice {
        let [width, height] = self.size(source);
        Lattice::new(width, height, self.cells_log2).unwrap()
    }

    fn size(&self, source: &MemorySource) -> [u32; 2] {
        [source.raster.width, source.raster.height].map(|side| ((side - 1) << self.finer_log2) + 1)
    }

    fn build(&self, source: &MemorySource, path: &Path) {
        let [width, height] = self.size(source);
        let mut info = RasterInfo::new(width, height, SampleType::U8);
        info.bands = 3;
        let (frame, finer) = (source.frame(), f64::from(1u32 << self.finer_log2));
        let ([x, y], [dx, dy]) = (frame.origin, frame.step.map(|step| step / finer));
        info.geotransform = [x, dx, 0.0, y, 0.0, dy];
        let own = *self;
        let fill = move |row: u32, numbers: &mut [f64]| {
            for (index, number) in numbers.iter_mut().enumerate() {
                let place = [
                    index / 3 % width as usize,
                    row as usize + index / 3 / width as usize,
                ];
                let place = place.map(|along| along as i64);
                *number = match own.is_void(place) {
                    true => f64::NAN,
                    false => f64::from(pixel(place)[index % 3]),
                };
            }
            Ok(())
        };
        let options = BuildOptions {
            max_error: 0.0,
            cells_log2: self.cells_log2,
            transform: self.transform,
            // Nothing has to be trained for it.
            entropy: EntropyKind::Gamma,
            threads: 1,
            ..BuildOptions::default()
        };
        let mut rows = RowSource::new(info, Box::new(fill));
        build(&mut rows, &options, path, &mut |_, _| true).unwrap();
    }

    fn colouring(&self, source: &MemorySource, form: ColourForm) -> Colouring {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("colours.kmb");
        self.build(source, &path);
        Colouring {
            layer: Arc::new(Layer::open(&path, Access::Map).unwrap()),
            form,
            texel_pixels: 1.0,
        }
    }
}

fn details() -> impl Strategy<Value = Detail> {
    let roughness = prop_oneof![Just(0.0), 0.0f64..0.3];
    (0u32..3, roughness).prop_map(|(halvings, roughness)| Detail {
        levels: 2 * halvings,
        roughness,
    })
}

/// Cracks of a cut whose grid may be finer than the source's samples.
fn cracks_of(cut: &Cut, source: &MemorySource) -> u64 {
    let has_voids = source.raster.samples.iter().any(|sample| sample.is_none());
    let step = source.lattice().sample_step() / cut.lattice().sample_step();
    let patches = cut.all_patches().map(|patch| &**patch);
    count_cracks(patches, cut.lattice(), |a, b| {
        let low = [0, 1].map(|axis| a[axis].min(b[axis]).div_euclid(step));
        let high = [0, 1].map(|axis| -(-a[axis].max(b[axis])).div_euclid(step));
        has_voids && may_be_open(&source.raster, low, high)
    })
}

/// Asserts that all texels, or vertices' colours, of a patch that are pixels of the image have their colours.
fn assert_pixels(cut: &Cut, patch: &Patch, picture: Picture, colours: &Lattice) {
    let own = patch.colours.as_ref().unwrap();
    let heights = cut.lattice();
    let deep = colours.finer(heights.levels() - colours.levels()).unwrap();
    let finer = colours.sample_step() / deep.sample_step();
    let apex = heights.apexes(patch.diamond)[usize::from(patch.half)];
    let cells = match own.texture_side {
        0 => heights.cells(),
        side => side - 1,
    };
    let placement = deep.placement(patch.diamond);
    let stride = colours.cells() / cells;
    let vertices = (0..=cells).flat_map(|q| (0..=cells - q).map(move |p| (p, q)));
    for (order, (p, q)) in vertices.enumerate() {
        let (i, j) = apex.vertex(cells, p, q);
        let place = placement.vertex(i * stride, j * stride);
        if place.iter().any(|along| along % finer != 0) || !deep.in_raster(place) {
            continue;
        }
        let found = match own.texture_side {
            0 => &own.bytes[4 * order..][..3],
            side => &own.bytes[3 * (j * side + i)..][..3],
        };
        let is_final = patch.level >= colours.levels();
        if picture.is_void(place.map(|along| along / finer)) {
            continue;
        }
        if picture.transform == TransformKind::Interpolating || is_final {
            assert_eq!(
                found,
                pixel(place.map(|along| along / finer)),
                "at {place:?}"
            );
        }
        if own.texture_side > 0 {
            assert_filters_meet(&own.bytes, apex, cells, [i, j]);
        }
    }
}

/// Asserts that in a cell that the hypotenuse divides a bilinear filter is linear along it, as far as bytes let it be.
fn assert_filters_meet(texels: &[u8], apex: Apex, cells: usize, [i, j]: [usize; 2]) {
    let (a, b) = apex.mirrored(cells, i, j);
    if a.abs_diff(i) != 1 {
        return;
    }
    for band in 0..3 {
        let texel = |i: usize, j: usize| i32::from(texels[3 * (j * (cells + 1) + i) + band]);
        let beyond = texel(a, j) + texel(i, b) - texel(i, j);
        assert_eq!(texel(a, b), beyond.clamp(0, 255));
    }
}

fn deep_look(cut: &mut Cut, source: &MemorySource, tolerance: f64, refinements: u64) {
    let budget = Budget {
        refinements,
        ..Budget::UNLIMITED
    };
    cut.update(&overview(source, tolerance), &budget).unwrap();
}

proptest! {
    #![proptest_config(config(64))]

    #[test]
    fn no_random_legal_cut_with_colours_detail_and_births_has_a_crack_or_a_wrong_pixel(
        (scene, seed) in (scenes(), any::<u64>()),
        picture in pictures(),
        (detail, has_births, threads) in (details(), any::<bool>(), 0usize..2),
        form in prop_oneof![Just(ColourForm::Texture), Just(ColourForm::Vertices)],
        steps in prop::collection::vec((1u64..120, 0.1f64..2000.0), 1..4),
    ) {
        let mut source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        source.random_errors = Some(seed);
        let (source, lattice) = (Arc::new(source), picture.lattice(&Arc::new(scene.source())));
        let options = CutOptions {
            colours: Some(picture.colouring(&source, form)),
            detail,
            births: has_births,
            threads,
            ..EXPANDED
        };
        let made = Cut::new(source.clone(), options);
        let too_few = form == ColourForm::Vertices && picture.cells_log2 < scene.cells_log2;
        if !lattice.has_domain_of(source.lattice()) || too_few {
            let is_refused = matches!(made, Err(Error::Input { .. }));
            prop_assert!(is_refused);
            return Ok(());
        }
        let mut cut = made.unwrap();
        for (refinements, tolerance) in steps {
            deep_look(&mut cut, &source, tolerance, refinements);
            prop_assert_eq!(cracks_of(&cut, &source), 0);
            for patch in cut.all_patches() {
                assert_pixels(&cut, patch, picture, &lattice);
            }
        }
    }

    #[test]
    fn detail_beyond_the_heights_leaves_them_or_moves_them_further_than_told(
        scene in scenes(),
        detail in details(),
        tolerance in 0.5f64..40.0,
    ) {
        let source = Arc::new(scene.source());
        let plain = surface_of(&source, Detail::default(), &overview(&source, 1e-12));
        let finest = surface_of(&source, detail, &overview(&source, 1e-12));
        let coarse = {
            let options = CutOptions { detail, ..EXPANDED };
            let mut cut = Cut::new(source.clone(), options).unwrap();
            settle(&mut cut, &overview(&source, tolerance), &Budget::UNLIMITED);
            cut
        };
        let finer = 1i64 << (detail.levels / 2);
        let units = coarse.grid_to_world().step[2] / source.height_to_world()[1];
        for row in 0..i64::from(scene.size[1]) {
            for column in 0..i64::from(scene.size[0]) {
                let place = [column, row];
                let moved = finest.height(place.map(|along| along * finer));
                let (moved, own) = (moved.map(|height| height * units), plain.height(place));
                // Beside voids either of the two may draw no triangle where the other does.
                let is_open = may_be_open(&source.raster, place, [column + 1, row + 1]);
                if !is_open || moved.is_some() && own.is_some() {
                    prop_assert_eq!(own, moved);
                }
            }
        }
        let (twist, scale) = (greatest_twist(&source), coarse.grid_to_world().step[2].abs());
        let moved = 0.9 * detail.roughness * 30.0 * 2f64.sqrt() * 3.5;
        for patch in coarse.all_patches() {
            let own = Surface::new(std::slice::from_ref(patch), &coarse);
            for (place, height) in own.places() {
                let Some(finest) = finest.height(place) else { continue };
                let is_sample = place.iter().all(|along| along % finer == 0);
                let beside = if is_sample { 0.0 } else { twist / 2.0 + moved };
                let distance = (finest - height).abs() * scale;
                prop_assert!(distance <= patch.error + beside + 1e-6, "{place:?}: {distance}");
            }
        }
    }

    #[test]
    fn vertices_do_not_come_from_the_middle_of_their_edge(scene in scenes(), tolerance in 0.5f64..100.0) {
        let source = Arc::new(scene.source());
        let options = CutOptions { births: true, ..EXPANDED };
        let mut cut = Cut::new(source.clone(), options).unwrap();
        settle(&mut cut, &overview(&source, tolerance), &Budget::UNLIMITED);
        for patch in cut.all_patches().filter(|patch| patch.level > 0) {
            assert_births(patch, 1 << scene.cells_log2);
        }
    }
}

/// Asserts that vertices that a patch's level brought come from the middle of their neighbours along one leg, the same for
/// all, and the others from coarser levels.
fn assert_births(patch: &Patch, cells: usize) {
    let index = |p: usize, q: usize| (0..q).map(|row| cells + 1 - row).sum::<usize>() + p;
    let height = |p: usize, q: usize| f64::from(patch.vertices[6 * index(p, q) + 2]);
    let births = patch.births.as_ref().unwrap();
    let new = (0..=cells).flat_map(|q| (0..=cells - q).map(move |p| (p, q)));
    let mut along = [true, true];
    for (p, q) in new {
        let [coarse, level] = births[index(p, q)];
        assert_eq!(level == patch.level as f32, (p + q) % 2 == 1, "{p} {q}");
        assert!(level <= patch.level as f32);
        if (p + q) % 2 == 0 {
            continue;
        }
        if p > 0 {
            along[0] &= (height(p - 1, q) + height(p + 1, q)) / 2.0 == f64::from(coarse);
        }
        if q > 0 {
            along[1] &= (height(p, q - 1) + height(p, q + 1)) / 2.0 == f64::from(coarse);
        }
    }
    assert!(along[0] || along[1], "level {}", patch.level);
}

/// The largest |a + c - b - d| of four samples around a cell, in the world.
fn greatest_twist(source: &MemorySource) -> f64 {
    let raster = &source.raster;
    let [_, unit] = source.height_to_world();
    let places = (0..i64::from(raster.height))
        .flat_map(|row| (0..i64::from(raster.width)).map(move |column| [column, row]));
    let twists = places.filter_map(|[x, y]| {
        let sum = |one: [i64; 2], other: [i64; 2]| Some(raster.at(one)? + raster.at(other)?);
        Some((sum([x, y], [x + 1, y + 1])? - sum([x + 1, y], [x, y + 1])?).abs())
    });
    f64::from(twists.max().unwrap_or(0)) * unit.abs()
}

/// What a cut that has settled draws.
fn surface_of(source: &Arc<MemorySource>, detail: Detail, view: &View) -> Surface {
    let options = CutOptions { detail, ..EXPANDED };
    let mut cut = Cut::new(source.clone(), options).unwrap();
    settle(&mut cut, view, &Budget::UNLIMITED);
    let patches: Vec<Arc<Patch>> = cut.all_patches().cloned().collect();
    Surface::new(&patches, &cut)
}

#[test]
fn colours_that_are_even_are_refined_as_others_are() {
    let scene = Scene {
        size: [129, 129],
        seed: 3,
        voids: Voids::None,
        cells_log2: 4,
    };
    let source = Arc::new(MemorySource::rough(scene.raster(), 4, 0.0));
    let picture = Picture {
        finer_log2: 1,
        cells_log2: 4,
        transform: TransformKind::Interpolating,
        has_holes: false,
    };
    let options = CutOptions {
        colours: Some(picture.colouring(&source, ColourForm::Texture)),
        ..EXPANDED
    };
    let mut cut = Cut::new(source.clone(), options).unwrap();
    settle(&mut cut, &overview(&source, 0.01), &Budget::UNLIMITED);
    let finest = cut.all_patches().map(|patch| patch.level).max().unwrap();
    assert_eq!(finest, cut.lattice().levels());
    let is_even = |patch: &&Arc<Patch>| {
        let bytes = &patch.colours.as_ref().unwrap().bytes;
        bytes.chunks(3).all(|texel| texel == [10, 20, 30])
    };
    let evens = cut.all_patches().filter(is_even);
    assert!(evens.map(|patch| patch.level).min().unwrap() < finest);
}

#[test]
fn a_damaged_block_of_colours_tears_heights_or_changes_other_colours() {
    let scene = Scene {
        size: [129, 129],
        seed: 3,
        voids: Voids::None,
        cells_log2: 4,
    };
    let source = Arc::new(scene.source());
    let picture = Picture {
        finer_log2: 0,
        cells_log2: 4,
        transform: TransformKind::Interpolating,
        has_holes: false,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("colours.kmb");
    picture.build(&source, &path);
    let mut bytes = std::fs::read(&path).unwrap();
    let blocks = u64::from_le_bytes(bytes[272..280].try_into().unwrap()) as usize;
    let middle = blocks + (bytes.len() - blocks) / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let colours = Colouring {
        layer: Arc::new(Layer::open(&path, Access::Map).unwrap()),
        form: ColourForm::Texture,
        texel_pixels: 1.0,
    };
    let options = CutOptions {
        colours: Some(colours),
        ..EXPANDED
    };
    let mut cut = Cut::new(source.clone(), options).unwrap();
    settle(&mut cut, &overview(&source, 0.01), &Budget::UNLIMITED);
    assert_eq!(cracks_of(&cut, &source), 0);
    let leaf = cut.lattice().levels();
    assert!(cut.all_patches().all(|patch| patch.level == leaf));
    let is_wrong = |patch: &&Arc<Patch>| {
        let placement = cut.lattice().placement(patch.diamond);
        let apex = cut.lattice().apexes(patch.diamond)[usize::from(patch.half)];
        let own = patch.colours.as_ref().unwrap();
        let texel = |(i, j): (usize, usize)| &own.bytes[3 * (j * own.texture_side + i)..][..3];
        half(apex, 16).any(|at| texel(at) != pixel(placement.vertex(at.0, at.1)))
    };
    let wrong = cut.all_patches().filter(is_wrong).count();
    let all = cut.all_patches().count();
    assert!(wrong > 0 && wrong < all, "{wrong} of {all}");
}

/// Matrix indices of a half's vertices.
fn half(apex: Apex, cells: usize) -> impl Iterator<Item = (usize, usize)> {
    let vertices = (0..=cells).flat_map(move |q| (0..=cells - q).map(move |p| (p, q)));
    vertices.map(move |(p, q)| apex.vertex(cells, p, q))
}

#[test]
fn colours_of_another_place_or_heights_are_taken() {
    let scene = Scene {
        size: [65, 65],
        seed: 3,
        voids: Voids::None,
        cells_log2: 4,
    };
    let source = Arc::new(scene.source());
    let other = Arc::new(MemorySource::rough(hills(65, 64, 1, Voids::None), 4, 0.0));
    let picture = Picture {
        finer_log2: 1,
        cells_log2: 4,
        transform: TransformKind::Interpolating,
        has_holes: false,
    };
    let refused = |colours: Colouring| {
        let options = CutOptions {
            colours: Some(colours),
            ..EXPANDED
        };
        Cut::new(source.clone(), options).map(|_| ()).unwrap_err()
    };
    let error = refused(picture.colouring(&other, ColourForm::Texture));
    assert!(error.to_string().contains("domain"), "{error}");
    let heights = crate::support::repositories::repository(&source, &BuildOptions::default());
    let error = refused(Colouring {
        layer: heights.layer().clone(),
        form: ColourForm::Texture,
        texel_pixels: 1.0,
    });
    assert!(error.to_string().contains("heights"), "{error}");
    let mut nothing = picture.colouring(&source, ColourForm::Texture);
    nothing.texel_pixels = 0.0;
    assert!(matches!(refused(nothing), Error::Argument(_)));
}
