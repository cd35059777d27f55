//! CityJSON that is not what it should be: the message tells where.

use serde_json::{Value, json};

use super::city_json::wall;
use super::{Folder, assert_refused, assert_warned, total_area};

fn changed(change: impl Fn(&mut Value)) -> kimberlite::Result<kimberlite::blockmap::Scene> {
    let mut city = wall();
    change(&mut city);
    Folder::new().read("bad.city.json", city.to_string())
}

#[test]
fn a_bad_boundary_is_named() {
    let place = "bad.city.json: CityObjects.house.geometry[0].boundaries[0]";
    let with = |boundaries: Value| {
        changed(move |city| {
            city["CityObjects"]["house"]["geometry"][0]["boundaries"] = boundaries.clone()
        })
    };
    assert_refused(
        with(json!([[[0, 1, 4]]])),
        &[place, "vertex 4 is missing: there are 4"],
    );
    assert_refused(with(json!([[[0, 1, -1]]])), &[place, "-1"]);
    assert_refused(with(json!([[[0, 1, 2.5]]])), &[place, "2.5"]);
    assert_refused(with(json!([[0, 1, 2]])), &[place, "array of arrays"]);
    assert_refused(with(json!(["text"])), &[place, "\"text\""]);
    assert_refused(
        with(json!("text")),
        &["CityObjects.house.geometry[0].boundaries", "array"],
    );
    let solid = changed(|city| {
        city["CityObjects"]["house"]["geometry"][0] =
            json!({"type": "Solid", "boundaries": [[[[0, 1, 2]], [[0, 1, 2, 3], [0, 1, 9]]]]});
    });
    assert_refused(
        solid,
        &[
            "CityObjects.house.geometry[0].boundaries[0][1][1]",
            "vertex 9",
        ],
    );
}

#[test]
fn a_bad_member_is_named() {
    let geometry = |name: &'static str, value: Value| {
        changed(move |city| city["CityObjects"]["house"]["geometry"][0][name] = value.clone())
    };
    assert_refused(
        geometry("type", json!("Ball")),
        &["geometry[0].type", "Ball"],
    );
    assert_refused(geometry("lod", json!("high")), &["geometry[0].lod"]);
    let semantics = json!({"surfaces": [{"type": "RoofSurface"}], "values": [3]});
    assert_refused(
        geometry("semantics", semantics),
        &["boundaries[0]", "semantics 3"],
    );
    let texture = json!({"theme": {"values": [[[0, 0, 1, 2, 3]]]}});
    assert_refused(
        geometry("texture", texture),
        &["boundaries[0]", "texture 0 is missing"],
    );
    assert_refused(
        changed(|city| city["vertices"][2] = json!([1, 2])),
        &["vertices[2]", "[1,2]"],
    );
    assert_refused(
        changed(|city| city["vertices"][2][1] = json!(null)),
        &["vertices[2]", "null"],
    );
    assert_refused(
        changed(|city| city["CityObjects"] = json!([])),
        &["CityObjects"],
    );
    assert_refused(
        changed(|city| city["type"] = json!("Feature")),
        &["not CityJSON"],
    );
    assert_refused(
        changed(|city| city["version"] = json!("7.0")),
        &["version 7.0"],
    );
    let transform = json!({"scale": [1, 1], "translate": [0, 0, 0]});
    assert_refused(
        changed(|city| city["transform"] = transform.clone()),
        &["transform.scale"],
    );
    let far = changed(|city| {
        city["vertices"][0][0] = json!(1e308);
        city["transform"] = json!({"scale": [1e10, 1, 1], "translate": [0, 0, 0]});
    });
    assert_refused(far, &["vertices[0]", "not finite"]);
}

#[test]
fn malformed_json_names_its_line_and_column() {
    let folder = Folder::new();
    assert_refused(
        folder.read("a.json", "{\n \"type\": NaN}"),
        &["a.json", "line 2 column 10"],
    );
    assert_refused(
        folder.read("b.json", "{\"vertices\": [1e999]}"),
        &["b.json", "line 1"],
    );
    assert_refused(folder.read("c.json", ""), &["c.json", "line 1"]);
    assert_refused(
        folder.read("d.json", "[".repeat(100_000)),
        &["d.json", "recursion"],
    );
}

#[test]
fn an_absent_transform_leaves_vertices_as_they_are() {
    let scene = changed(|_| {}).unwrap();
    assert_eq!(scene.bounds(), Some([[0.0, 0.0, 0.0], [10.0, 0.0, 6.0]]));
    let moved =
        changed(|city| city["transform"] = json!({"scale": [0.1, 1, 0.5], "translate": [7, 8, 9]}));
    assert_eq!(
        moved.unwrap().bounds(),
        Some([[7.0, 8.0, 9.0], [8.0, 8.0, 12.0]])
    );
}

#[test]
fn degenerate_polygons_are_skipped_and_counted() {
    let scene = changed(|city| {
        city["vertices"] = json!([
            [0, 0, 0],
            [10, 0, 0],
            [10, 0, 6],
            [0, 0, 6],
            [5, 0, 0],
            [9, 0, 0]
        ]);
        let geometry = &mut city["CityObjects"]["house"]["geometry"][0];
        // A line, a point, a bow, one that crosses itself with unequal parts, and a good one.
        geometry["boundaries"] = json!([
            [[0, 1, 4]],
            [[0, 0, 0, 0]],
            [[0, 2, 1, 3]],
            [[0, 5, 3, 2]],
            [],
            [[]],
            [[0, 1, 1, 2, 3, 0]]
        ]);
    })
    .unwrap();
    assert_eq!(total_area(&scene), 60.0);
    assert_warned(
        &scene,
        &[
            "skipped 6 times",
            "CityObjects.house.geometry[0].boundaries[0]",
        ],
    );
}
