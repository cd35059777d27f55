//! The tree of a city's file, out of any bytes.

use kimberlite::blockmap::{
    BakeOptions, City, CityOptions, Ground, Paint, Scene, Triangle, build_city,
};
use kimberlite::store::{Access, Header, Writer};
use proptest::prelude::*;
use std::path::Path;

/// Bytes of a node and before the first.
const NODE: usize = 17;
const HEAD: usize = 12;

/// A small city of two levels; its header and its roots, decompressed.
fn small(folder: &Path) -> (Header, Vec<u8>) {
    let mut scene = Scene::default();
    for at in [[0.0, 0.0], [100.0, 90.0]] {
        let corner = |x, y, z| [at[0] + x, at[1] + y, z];
        scene.triangles.push(Triangle {
            corners: [
                corner(0.0, 0.0, 9.0),
                corner(9.0, 0.0, 9.0),
                corner(0.0, 9.0, 7.0),
            ],
            paint: Paint::Plain([90, 80, 70]),
        });
    }
    let ground = Ground {
        height: &|_| 0.0,
        spacing: f64::INFINITY,
        colour: [100; 3],
    };
    let options = CityOptions {
        bake: BakeOptions {
            side_texels: 32,
            views: 2,
            view_pixels: 16,
            ..BakeOptions::default()
        },
        ..CityOptions::default()
    };
    let path = folder.join("small.kmb");
    build_city(&scene, &ground, &options, &path, &mut |_, _| true).unwrap();
    let city = City::open(&path, Access::Map).unwrap();
    let store = city.store();
    let plain = zstd::bulk::decompress(store.roots(), 1 << 20).unwrap();
    (store.header().clone(), plain)
}

/// Opens a city with these roots and as many empty blocks as its header says.
fn opened(folder: &Path, header: &Header, roots: &[u8]) -> Option<usize> {
    let path = folder.join("other.kmb");
    let mut writer = Writer::create(&path, header, roots, &[]).unwrap();
    for _ in 0..header.block_count {
        writer.push(&[]).unwrap();
    }
    let codes = vec![[0; 3]; header.block_count as usize];
    writer.finish(header, &codes).unwrap();
    let city = City::open(&path, Access::Map).ok()?;
    assert!(city.read(0).is_err());
    Some(city.tree().nodes.len())
}

fn compressed(plain: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(plain, 1).unwrap()
}

#[test]
fn every_changed_byte_gives_a_tree_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let (header, plain) = small(folder.path());
    assert_eq!(plain.len(), HEAD + NODE * header.block_count as usize);
    let count = opened(folder.path(), &header, &compressed(&plain));
    assert_eq!(count, Some(header.block_count as usize));
    for at in 0..plain.len() {
        let mut changed = plain.clone();
        changed[at] ^= 0x81;
        let count = opened(folder.path(), &header, &compressed(&changed));
        assert!(count.is_none_or(|count| count as u64 == header.block_count));
        assert!(count.is_none() || (at < 8 || (at >= HEAD && !(at - HEAD).is_multiple_of(NODE))));
    }
    let section = compressed(&plain);
    for length in 0..section.len() {
        assert_eq!(opened(folder.path(), &header, &section[..length]), None);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_bytes_give_a_tree_or_an_error(
        plain in prop::collection::vec(prop_oneof![Just(0u8), Just(1u8), any::<u8>()], 0..400),
        has_count: bool,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let (header, _) = small(folder.path());
        let mut plain = plain;
        if has_count && plain.len() > HEAD {
            let count = (plain.len() - HEAD) / NODE;
            plain.truncate(HEAD + count * NODE);
            plain[8..HEAD].copy_from_slice(&(count as u32).to_le_bytes());
            plain[HEAD..].chunks_mut(NODE).for_each(|node| {
                node[0] &= 1;
                node[1..].fill(0);
            });
        }
        opened(folder.path(), &header, &compressed(&plain));
        opened(folder.path(), &header, &plain);
    }
}
