//! Files with bytes changed or cut off are read or refused, and never end the process.

use kimberlite::Error;
use proptest::prelude::*;

use super::Folder;
use super::city_json::wall;
use super::gltf::{binary, square};

fn files() -> [(&'static str, Vec<u8>); 4] {
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 1\no a\nf 1/1 2/1 3/1\nf -3 -2 -1\n";
    let mut city = wall();
    city["transform"] = serde_json::json!({"scale": [1, 1, 1], "translate": [0, 0, 0]});
    let geometry = &mut city["CityObjects"]["house"]["geometry"][0];
    geometry["semantics"] =
        serde_json::json!({"surfaces": [{"type": "RoofSurface"}], "values": [0]});
    geometry["texture"] = serde_json::json!({"a": {"values": [[[0, 0, 1, 2, 3]]]}});
    city["appearance"] = serde_json::json!({
        "textures": [{"type": "PNG", "image": "none.png"}],
        "vertices-texture": [[0, 0], [1, 0], [1, 1], [0, 1]]
    });
    [
        ("a.obj", obj.as_bytes().to_vec()),
        ("a.city.json", city.to_string().into_bytes()),
        ("a.gltf", square().to_string().into_bytes()),
        ("a.glb", binary(square())),
    ]
}

fn assert_told(name: &str, bytes: &[u8], folder: &Folder) {
    if let Err(error) = folder.read(name, bytes) {
        assert!(matches!(error, Error::Input { .. }), "{error:?}");
    }
}

#[test]
fn files_cut_off_anywhere_are_told() {
    let folder = Folder::new();
    for (name, bytes) in files() {
        for length in 0..bytes.len() {
            assert_told(name, &bytes[..length], &folder);
        }
    }
}

/// Random cases; KIMBERLITE_CASES asks for another number.
fn cases() -> u32 {
    let asked = std::env::var("KIMBERLITE_CASES").ok();
    asked.map_or(500, |number| number.parse().unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    #[test]
    fn changed_bytes_are_told(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), b'0'..=b'9']), 1..4),
    ) {
        let folder = Folder::new();
        for (name, mut bytes) in files() {
            for (place, byte) in &changes {
                let place = place.index(bytes.len());
                bytes[place] = *byte;
            }
            assert_told(name, &bytes, &folder);
        }
    }
}
