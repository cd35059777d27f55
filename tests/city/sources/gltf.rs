//! glTF: transforms of nodes, y up, kinds of triangles, resources.

use std::f64::consts::FRAC_1_SQRT_2;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use kimberlite::blockmap::{Paint, Scene};
use serde_json::{Value, json};

use super::{Folder, assert_refused, assert_warned, png_image, total_area};

/// Corners of a square in the plane of x and y, which is upright.
const CORNERS: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [2.0, 0.0, 0.0],
    [2.0, 2.0, 0.0],
    [0.0, 2.0, 0.0],
];
const INDICES: [u16; 6] = [0, 1, 2, 0, 2, 3];

fn data(bytes: &[u8]) -> String {
    format!(
        "data:application/octet-stream;base64,{}",
        BASE64_STANDARD.encode(bytes)
    )
}

/// Positions, indices, then texture coordinates.
fn bytes() -> Vec<u8> {
    let mut bytes: Vec<u8> = CORNERS
        .iter()
        .flatten()
        .flat_map(|number| number.to_le_bytes())
        .collect();
    bytes.extend(INDICES.iter().flat_map(|index| index.to_le_bytes()));
    let coordinates: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    bytes.extend(
        coordinates
            .iter()
            .flatten()
            .flat_map(|number| number.to_le_bytes()),
    );
    bytes
}

/// One node with a square of two triangles.
pub fn square() -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "house"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [2, 2, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
            {"buffer": 0, "byteOffset": 60, "byteLength": 32}
        ],
        "buffers": [{"byteLength": 92, "uri": data(&bytes())}]
    })
}

/// As a binary file.
pub fn binary(mut document: Value) -> Vec<u8> {
    document["buffers"] = json!([{"byteLength": 92}]);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let chunk = |kind: &[u8], content: &[u8]| {
        [&(content.len() as u32).to_le_bytes(), kind, content].concat()
    };
    let chunks = [chunk(b"JSON", &text), chunk(b"BIN\0", &bytes())].concat();
    let length = 12 + chunks.len() as u32;
    [
        b"glTF".as_slice(),
        &2_u32.to_le_bytes(),
        &length.to_le_bytes(),
        &chunks,
    ]
    .concat()
}

fn changed(change: impl Fn(&mut Value)) -> kimberlite::Result<Scene> {
    let mut document = square();
    change(&mut document);
    Folder::new().read("city.gltf", document.to_string())
}

#[test]
fn y_up_becomes_z_up() {
    let scene = changed(|_| {}).unwrap();
    let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 2.0]];
    assert_eq!(scene.triangles[0].corners, corners);
    assert_eq!(scene.triangles[0].normal(), Some([0.0, -1.0, 0.0]));
    let north =
        changed(|document| document["nodes"][0]["translation"] = json!([0, 0, -7])).unwrap();
    assert_eq!(north.bounds().unwrap()[0], [0.0, 7.0, 0.0]);
    let binary = Folder::new().read("city.glb", binary(square())).unwrap();
    assert_eq!(binary.triangles[0].corners, corners);
}

#[test]
fn nodes_move_their_children_and_keep_millimetres() {
    let scene = changed(|document| {
        document["nodes"] = json!([
            {"children": [1], "translation": [84616.4687, 12.345, -5447422.9991]},
            {"children": [2], "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2], "scale": [2, 2, 2]},
            {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]}
        ]);
    })
    .unwrap();
    // x of 5 to 7, doubled, turns to -z, which is north.
    let [low, high] = scene.bounds().unwrap();
    let wanted = [
        [84616.4687, 5447432.9991, 12.345],
        [84616.4687, 5447436.9991, 24.345],
    ];
    for (found, wanted) in [low, high].iter().flatten().zip(wanted.iter().flatten()) {
        assert!((found - wanted).abs() < 1e-6, "{low:?} {high:?}");
    }
}

#[test]
fn strips_fans_and_plain_vertices_are_triangles_and_lines_are_not() {
    let with = |mode: u32, is_indexed: bool, order: [u16; 6]| {
        changed(move |document| {
            let primitive = &mut document["meshes"][0]["primitives"][0];
            primitive["mode"] = mode.into();
            if !is_indexed {
                primitive.as_object_mut().unwrap().remove("indices");
            }
            let mut bytes = bytes();
            bytes[48..60].copy_from_slice(&order.map(u16::to_le_bytes).concat());
            document["buffers"][0]["uri"] = data(&bytes).into();
        })
    };
    for (mode, is_indexed, area, count) in [
        (4, true, 4.0, 2),
        (5, true, 4.0, 2),
        (6, false, 4.0, 2),
        (4, false, 2.0, 1),
    ] {
        let order = if mode == 5 {
            [0, 1, 3, 2, 2, 2]
        } else {
            INDICES
        };
        let scene = with(mode, is_indexed, order).unwrap();
        assert_eq!(
            (total_area(&scene), scene.triangles.len()),
            (area, count),
            "mode {mode}"
        );
        assert!(
            scene
                .triangles
                .iter()
                .all(|triangle| triangle.normal() == Some([0.0, -1.0, 0.0]))
        );
    }
    let mut document = square();
    let line = json!({"attributes": {"POSITION": 0}, "mode": 1});
    document["meshes"][0]["primitives"]
        .as_array_mut()
        .unwrap()
        .push(line);
    let scene = Folder::new()
        .read("city.gltf", document.to_string())
        .unwrap();
    assert_warned(
        &scene,
        &["points and lines were left out", "meshes[0].primitives[1]"],
    );
}

fn textured(image: Value) -> Value {
    let mut document = square();
    document["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    document["textures"] = json!([{"source": 0}]);
    document["images"] = json!([image]);
    document["meshes"][0]["primitives"][0]["material"] = 0.into();
    document
}

#[test]
fn textures_come_from_files_data_and_buffers() {
    let folder = Folder::new();
    folder.write("a wall.png", png_image());
    let mut embedded = textured(json!({"bufferView": 3, "mimeType": "image/png"}));
    let image = png_image();
    embedded["buffers"][0]["uri"] = data(&[bytes(), image.clone()].concat()).into();
    embedded["buffers"][0]["byteLength"] = (92 + image.len()).into();
    let view = json!({"buffer": 0, "byteOffset": 92, "byteLength": image.len()});
    embedded["bufferViews"].as_array_mut().unwrap().push(view);
    let documents = [
        textured(json!({"uri": "a%20wall.png"})),
        textured(json!({"uri": data(&image)})),
        embedded,
    ];
    for document in documents {
        let scene = folder.read("city.gltf", document.to_string()).unwrap();
        assert_eq!(scene.warnings, [""; 0]);
        // The image's first row is at the top of the square.
        let at = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
        assert_eq!(scene.triangles[0].paint, Paint::Texture { index: 0, at });
    }
}

#[test]
fn a_missing_image_is_a_warning_and_a_missing_buffer_an_error() {
    let folder = Folder::new();
    let missing = textured(json!({"uri": "gone.jpg"}));
    let scene = folder.read("city.gltf", missing.to_string()).unwrap();
    assert_warned(&scene, &["gone.jpg", "No such file"]);
    assert!(matches!(scene.triangles[0].paint, Paint::Facade { .. }));
    let nowhere = textured(json!({"name": "neither"}));
    assert_warned(
        &folder.read("city.gltf", nowhere.to_string()).unwrap(),
        &["images[0]", "neither"],
    );
    let result = changed(|document| document["buffers"][0]["uri"] = "gone.bin".into());
    assert_refused(
        result,
        &["city.gltf", "buffers[0]", "gone.bin", "No such file"],
    );
    let result = changed(|document| document["buffers"][0]["uri"] = data(&[0; 10]).into());
    assert_refused(result, &["buffers[0]", "10 bytes, 92 are needed"]);
}

#[test]
fn a_base_colour_is_stored_as_an_image_would_be() {
    let scene = changed(|document| {
        document["materials"] =
            json!([{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.2140411, 0, 1]}}]);
        document["meshes"][0]["primitives"][0]["material"] = 0.into();
    });
    assert_eq!(
        scene.unwrap().triangles[0].paint,
        Paint::Plain([255, 127, 0])
    );
}

#[test]
fn what_is_out_of_place_is_named() {
    let accessor = |number: usize, name: &'static str, value: Value| {
        changed(move |document| document["accessors"][number][name] = value.clone())
    };
    assert_refused(
        accessor(0, "count", json!(5)),
        &["city.gltf", "meshes[0].primitives[0]", "POSITION", "beyond"],
    );
    assert_refused(accessor(0, "count", json!(0)), &["city.gltf"]);
    assert_refused(accessor(0, "count", json!(1_u64 << 62)), &["city.gltf"]);
    assert_refused(
        accessor(1, "componentType", json!(5126)),
        &["indices", "unexpected type"],
    );
    assert_refused(accessor(1, "byteOffset", json!(2)), &["indices", "beyond"]);
    let view = |name: &'static str, value: Value| {
        changed(move |document| document["bufferViews"][0][name] = value.clone())
    };
    assert_refused(view("byteLength", json!(1_u64 << 60)), &["city.gltf"]);
    assert_refused(view("byteStride", json!(4)), &["city.gltf"]);
    assert_refused(view("buffer", json!(3)), &["city.gltf"]);
    let none = changed(|document| document["accessors"] = json!([]));
    assert_refused(none, &["meshes[0].primitives[0]", "accessor 0 is missing"]);
    let far = changed(|document| {
        let mut bytes = bytes();
        bytes[48] = 9;
        document["buffers"][0]["uri"] = data(&bytes).into();
    });
    assert_refused(
        far,
        &[
            "meshes[0].primitives[0]",
            "vertex 9 is missing: there are 4",
        ],
    );
    let cycle = changed(|document| document["nodes"][0]["children"] = json!([0]));
    assert_refused(cycle, &["nodes[0] has several parents"]);
    let rotation = changed(|document| document["nodes"][0]["rotation"] = json!([0, 0, 0, 0]));
    assert_refused(rotation, &["nodes[0]", "rotation"]);
    assert_refused(
        Folder::new().read("a.gltf", "{\"asset\": }"),
        &["a.gltf", "line 1"],
    );
}
