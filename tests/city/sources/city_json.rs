//! CityJSON: the city of Delft, and documents made for one question each.

use std::collections::BTreeSet;

use kimberlite::blockmap::source::{SourceOptions, read};
use kimberlite::blockmap::{Paint, Scene};
use serde_json::{Value, json};

use super::{Folder, assert_warned, is_textured, png_image, shipped, total_area};

/// A document with one wall of 10 x 6 metres that looks south.
pub fn wall() -> Value {
    json!({
        "type": "CityJSON",
        "version": "1.0",
        "CityObjects": {
            "house": {
                "type": "Building",
                "geometry": [{"type": "MultiSurface", "lod": 2, "boundaries": [[[0, 1, 2, 3]]]}]
            }
        },
        "vertices": [[0, 0, 0], [10, 0, 0], [10, 0, 6], [0, 0, 6]]
    })
}

fn scene(city: &Value) -> Scene {
    Folder::new()
        .read("small.city.json", city.to_string())
        .unwrap()
}

#[test]
fn delft_keeps_its_buildings_and_bounds_and_has_no_void_triangles() {
    let path = shipped("city/delft_lod1.city.json");
    let file: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let scene = read(&[path], &SourceOptions::default()).unwrap();
    println!("{} triangles, {:#?}", scene.triangles.len(), scene.warnings);
    assert_eq!(scene.crs, "EPSG:7415");
    assert!(
        scene
            .triangles
            .iter()
            .all(|triangle| triangle.normal().is_some())
    );
    let seed = |paint: &Paint| match paint {
        Paint::Facade { seed, .. } => Some(*seed),
        _ => None,
    };
    let seeds: BTreeSet<u32> = scene
        .triangles
        .iter()
        .filter_map(|triangle| seed(&triangle.paint))
        .collect();
    let objects = file["CityObjects"].as_object().unwrap();
    let buildings = objects
        .values()
        .filter(|object| object["type"] == "Building");
    assert_eq!(buildings.clone().count(), 160);
    // Six are too low for windows.
    let tall = buildings.filter(|building| height(building, &file) >= 1.8);
    assert_eq!(seeds.len(), tall.count());
    let extent = file["metadata"]["geographicalExtent"].as_array().unwrap();
    let bounds = scene.bounds().unwrap();
    for (found, wanted) in bounds.iter().flatten().zip(extent) {
        assert!(
            (found - wanted.as_f64().unwrap()).abs() < 0.0015,
            "{bounds:?}"
        );
    }
    // Each surface is a triangle, and four of them have no area.
    let surfaces: usize = objects.values().map(surface_count).sum();
    assert_eq!(scene.triangles.len(), surfaces - 4);
    assert_warned(&scene, &["skipped 4 times"]);
}

/// In metres, of a solid of triangles.
fn height(building: &Value, file: &Value) -> f64 {
    let shell = building["geometry"][0]["boundaries"][0].as_array().unwrap();
    let corners = shell
        .iter()
        .flat_map(|surface| surface[0].as_array().unwrap());
    let heights = corners.map(|corner| {
        let vertex = &file["vertices"][corner.as_u64().unwrap() as usize];
        vertex[2].as_f64().unwrap() * file["transform"]["scale"][2].as_f64().unwrap()
    });
    heights.clone().fold(f64::MIN, f64::max) - heights.fold(f64::MAX, f64::min)
}

fn surface_count(object: &Value) -> usize {
    let boundaries = object["geometry"][0]["boundaries"].as_array().unwrap();
    match object["geometry"][0]["type"].as_str() {
        Some("Solid") => boundaries
            .iter()
            .map(|shell| shell.as_array().unwrap().len())
            .sum(),
        _ => boundaries.len(),
    }
}

/// With KIMBERLITE_DATA, a folder that has the sample of Rotterdam, of whose images all but one are missing.
#[test]
fn rotterdam_has_the_texture_that_is_there_and_warnings_for_the_others() {
    let named = std::env::var_os("KIMBERLITE_DATA").map(std::path::PathBuf::from);
    let path = named
        .unwrap_or_default()
        .join("city/rotterdam/rotterdam_subset.city.json");
    if !path.exists() {
        println!("passed over: KIMBERLITE_DATA has no city/rotterdam");
        return;
    }
    let scene = read(&[path], &SourceOptions::default()).unwrap();
    let textured = scene
        .triangles
        .iter()
        .filter(|triangle| is_textured(triangle))
        .count();
    println!(
        "{textured} of {} triangles textured, {:#?}",
        scene.triangles.len(),
        scene.warnings
    );
    assert_eq!(scene.textures.len(), 1);
    assert!(textured > 0);
    assert_warned(&scene, &["0320_7_8.jpg"]);
    assert!(
        scene
            .warnings
            .iter()
            .all(|line| !line.contains("0320_4_15.jpg"))
    );
}

#[test]
fn a_texture_is_laid_on_its_surface_and_a_missing_one_is_warned_of_once() {
    let folder = Folder::new();
    folder.write("there.png", png_image());
    folder.write("broken.jpg", [0xff, 0xd8, 0xff, 0xe0, 0, 1]);
    let mut city = wall();
    city["vertices"] = json!([[0, 0, 0], [10, 0, 0], [10, 0, 6], [0, 0, 6]]);
    city["appearance"] = json!({
        "textures": [
            {"type": "PNG", "image": "there.png"},
            {"type": "PNG", "image": "missing.png"},
            {"type": "JPG", "image": "broken.jpg"},
            {"type": "JPG", "image": "never used.jpg"}
        ],
        "vertices-texture": [[0, 0], [1, 0], [1, 0.5], [0, 0.5]]
    });
    let geometry = &mut city["CityObjects"]["house"]["geometry"][0];
    geometry["boundaries"] = json!([
        [[0, 1, 2, 3]],
        [[0, 1, 2, 3]],
        [[0, 1, 2, 3]],
        [[0, 1, 2, 3]],
        [[0, 1, 2, 3]]
    ]);
    geometry["texture"] = json!({"summer": {"values": [
        [[0, 0, 1, 2, 3]], [[1, 0, 1, 2, 3]], [[1, 0, 1, 2, 3]], [[2, 0, 1, 2, 3]], [[null]]
    ]}});
    let scene = folder.read("textured.city.json", city.to_string()).unwrap();
    assert_eq!(
        scene.triangles.iter().map(is_textured).collect::<Vec<_>>()[..3],
        [true, true, false]
    );
    assert_eq!(
        scene
            .triangles
            .iter()
            .filter(|triangle| is_textured(triangle))
            .count(),
        2
    );
    assert_eq!(scene.warnings.len(), 2, "{:#?}", scene.warnings);
    assert_warned(
        &scene,
        &["textured.city.json", "missing.png", "No such file"],
    );
    assert_warned(&scene, &["broken.jpg"]);
    for triangle in scene
        .triangles
        .iter()
        .filter(|triangle| is_textured(triangle))
    {
        let Paint::Texture { at, .. } = triangle.paint else {
            continue;
        };
        for (corner, [u, v]) in triangle.corners.iter().zip(at) {
            assert_eq!(
                [corner[0] / 10.0, corner[2] / 12.0],
                [f64::from(u), f64::from(v)]
            );
        }
    }
    assert!(matches!(scene.triangles[2].paint, Paint::Facade { .. }));
}

#[test]
fn only_the_highest_level_of_detail_with_surfaces_is_taken() {
    let mut city = wall();
    city["CityObjects"]["house"]["geometry"] = json!([
        {"type": "MultiSurface", "lod": "1.2", "boundaries": [[[0, 1, 2, 3]]]},
        {"type": "MultiSurface", "lod": "2.2", "boundaries": [[[0, 1, 2]]]},
        {"type": "MultiLineString", "lod": 3, "boundaries": [[0, 1]]},
        {"type": "Solid", "lod": "4", "boundaries": []}
    ]);
    assert_eq!(total_area(&scene(&city)), 30.0);
}

#[test]
fn solids_of_every_depth_have_their_surfaces() {
    let surfaces = json!([[[0, 1, 2, 3]], [[0, 1, 2]]]);
    let (shells, solids) = (json!([surfaces]), json!([[surfaces], [surfaces]]));
    let kinds = [
        ("MultiSurface", &surfaces, 90.0),
        ("CompositeSurface", &surfaces, 90.0),
        ("Solid", &shells, 90.0),
        ("MultiSolid", &solids, 180.0),
        ("CompositeSolid", &solids, 180.0),
    ];
    for (kind, boundaries, area) in kinds {
        let mut city = wall();
        city["CityObjects"]["house"]["geometry"] =
            json!([{"type": kind, "lod": 1, "boundaries": boundaries}]);
        assert_eq!(total_area(&scene(&city)), area, "{kind}");
    }
}

#[test]
fn a_template_is_turned_and_placed() {
    let mut city = wall();
    city["transform"] = json!({"scale": [0.5, 0.5, 0.5], "translate": [100, 200, 300]});
    city["geometry-templates"] = json!({
        "templates": [{"type": "MultiSurface", "lod": 2, "boundaries": [[[0, 1, 2]]]}],
        "vertices-templates": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    });
    city["CityObjects"]["house"]["geometry"] = json!([{
        "type": "GeometryInstance", "template": 0, "boundaries": [1],
        "transformationMatrix": [0, -2, 0, 7, 2, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    }]);
    let scene = scene(&city);
    let corners = scene.triangles[0].corners;
    assert_eq!(
        corners,
        [
            [112.0, 200.0, 300.0],
            [112.0, 202.0, 300.0],
            [110.0, 200.0, 300.0]
        ]
    );
}

#[test]
fn semantics_and_materials_colour_a_surface() {
    let folder = Folder::new();
    let paint = |kind: &str, material: Option<Value>| {
        let mut city = wall();
        city["vertices"] = json!([[0, 0, 0], [10, 0, 0], [10, 6, 1], [0, 6, 1]]);
        let geometry = &mut city["CityObjects"]["house"]["geometry"][0];
        geometry["semantics"] = json!({"surfaces": [{"type": kind}], "values": [0]});
        if let Some(material) = material {
            geometry["material"] = json!({"winter": material});
            city["appearance"] =
                json!({"materials": [{"name": "red", "diffuseColor": [1.0, 0.2, 0]}]});
        }
        folder.read("one.json", city.to_string()).unwrap().triangles[0].paint
    };
    let kinds = ["RoofSurface", "WallSurface", "GroundSurface"].map(|kind| paint(kind, None));
    assert!(
        kinds[0] != kinds[1] && kinds[1] != kinds[2] && kinds[0] != kinds[2],
        "{kinds:?}"
    );
    assert_eq!(paint("RoofSurface", None), paint("Window", None));
    let red = Paint::Plain([255, 51, 0]);
    assert_eq!(paint("RoofSurface", Some(json!({"value": 0}))), red);
    assert_eq!(paint("RoofSurface", Some(json!({"values": [0]}))), red);
    assert_eq!(
        paint("RoofSurface", Some(json!({"values": [null]}))),
        kinds[0]
    );
}

#[test]
fn a_text_sequence_is_read_line_by_line() {
    let folder = Folder::new();
    let mut head = wall();
    head["CityObjects"] = json!({});
    head["vertices"] = json!([]);
    head["transform"] = json!({"scale": [1, 1, 1], "translate": [1000, 0, 0]});
    let mut feature = wall();
    feature["type"] = "CityJSONFeature".into();
    let text = format!("{head}\n{feature}\n{feature}\n");
    let scene = folder.read("city.jsonl", &text).unwrap();
    assert_eq!(
        (scene.triangles.len(), scene.bounds().unwrap()[0][0]),
        (4, 1000.0)
    );
    super::assert_refused(
        folder.read("bad.jsonl", text + "{\"type\": }"),
        &["bad.jsonl", "line 4, column 10"],
    );
}

#[test]
fn plain_cities_have_no_facades() {
    let options = SourceOptions {
        facades: None,
        ..SourceOptions::default()
    };
    let scene = read(&[shipped("city/delft_lod1.city.json")], &options).unwrap();
    assert!(
        scene
            .triangles
            .iter()
            .all(|triangle| matches!(triangle.paint, Paint::Plain(_)))
    );
}
