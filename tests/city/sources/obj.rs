//! OBJ: places on the Earth keep their millimetres; materials.

use kimberlite::blockmap::Paint;

use super::{Folder, assert_refused, assert_warned, is_textured, png_image, total_area};

const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n";

#[test]
fn coordinates_of_a_reference_system_keep_millimetres() {
    let text = "v 84616.468 447422.999 -0.452\nv 84616.469 447422.999 1.001\nv 84617.468 5447423.001 2.5\nf 1 2 3\n";
    let scene = Folder::new().read("city.obj", text).unwrap();
    let wanted = [
        [84616.468, 447422.999, -0.452],
        [84616.469, 447422.999, 1.001],
        [84617.468, 5447423.001, 2.5],
    ];
    assert_eq!(scene.triangles[0].corners, wanted);
}

#[test]
fn a_face_that_is_not_convex_keeps_its_area() {
    let text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\n";
    assert_eq!(
        total_area(&Folder::new().read("roof.obj", text).unwrap()),
        10.0
    );
}

#[test]
fn indices_may_count_backwards_and_lines_go_on() {
    let text = format!("# a comment\r\n{SQUARE}f -4 -3 \\\r\n -2 -1 # all\r\n\r\ns off\r\n");
    let scene = Folder::new().read("a.OBJ", text).unwrap();
    assert_eq!(total_area(&scene), 4.0);
    let texture = format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1/1 2//1 3/-1 4\n");
    assert_eq!(
        total_area(&Folder::new().read("a.obj", texture).unwrap()),
        4.0
    );
}

#[test]
fn materials_colour_the_faces_that_follow() {
    let folder = Folder::new();
    folder.write("wall.png", png_image());
    let materials = "newmtl red\nKd 1 0 0.2\n\nnewmtl wall\nKd 1 1 1\nmap_Kd -clamp on wall.png\n\
        newmtl gone\nmap_Kd pictures\\gone.png\nnewmtl broken\nKd 0.5\n";
    folder.write("some materials.mtl", materials);
    let mut text = format!("mtllib some materials.mtl\n{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\n");
    for name in ["red", "wall", "gone", "broken", "unknown", "unknown"] {
        text += &format!("usemtl {name}\nf 1/1 2/2 3/3\n");
    }
    let scene = folder.read("city.obj", text).unwrap();
    let paints: Vec<Paint> = scene
        .triangles
        .iter()
        .map(|triangle| triangle.paint)
        .collect();
    assert_eq!(paints[0], Paint::Plain([255, 0, 51]));
    let at = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
    assert_eq!(paints[1], Paint::Texture { index: 0, at });
    assert!(!scene.triangles[2..].iter().any(is_textured));
    assert_eq!(scene.warnings.len(), 3, "{:#?}", scene.warnings);
    assert_warned(&scene, &["city.obj", "gone.png", "No such file"]);
    assert_warned(
        &scene,
        &["some materials.mtl", "line 10", "3 numbers are needed"],
    );
    assert_warned(&scene, &["material unknown is missing"]);
}

#[test]
fn missing_materials_are_a_warning() {
    let scene = Folder::new()
        .read("a.obj", format!("mtllib none.mtl\n{SQUARE}f 1 2 3\n"))
        .unwrap();
    assert_warned(&scene, &["none.mtl", "No such file"]);
}

#[test]
fn a_bad_line_is_named() {
    let read = |line: &str| Folder::new().read("bad.obj", format!("{SQUARE}{line}\nf 1 2 3\n"));
    assert_refused(read("v 1 2"), &["bad.obj", "line 5", "3 numbers"]);
    assert_refused(read("v 1 2 nan"), &["line 5", "\"nan\""]);
    assert_refused(read("v 1 2 1e999"), &["line 5", "\"1e999\""]);
    assert_refused(
        read("f 1 2 5"),
        &["line 5", "vertex 5 is missing: there are 4"],
    );
    assert_refused(read("f 1 2 0"), &["line 5", "vertex 0"]);
    assert_refused(read("f 1 2 -5"), &["line 5", "vertex -5"]);
    assert_refused(read("f 1 2 -9223372036854775808"), &["line 5", "vertex -9"]);
    assert_refused(
        read("f 1/1 2/1 3/1"),
        &["line 5", "texture vertex 1 is missing"],
    );
    assert_refused(read("f a b c"), &["line 5", "\"a\""]);
    assert_warned(&read("f 1 2").unwrap(), &["skipped", "line 5"]);
}

#[test]
fn walls_without_a_colour_have_windows() {
    let text =
        "v 0 0 0\nv 10 0 0\nv 10 0 6\nv 0 0 6\nv 10 9 6\nv 0 9 6\no house\nf 1 2 3 4\nf 4 3 5 6\n";
    let scene = Folder::new().read("house.obj", text).unwrap();
    let has_facade = |place: usize| matches!(scene.triangles[place].paint, Paint::Facade { .. });
    assert_eq!([0, 1, 2, 3].map(has_facade), [true, true, false, false]);
}
