//! OBJ: read whole and streamed.

use super::mesh_files::*;
use spinney::raw::import::mesh::{Model, open};

/// A memory limit so low that files are streamed.
const LITTLE: u64 = 1;

pub(crate) fn text_cube() -> String {
    let mut text = String::from("# a cube\n");
    for [x, y, z] in cube_points() {
        text += &format!("v {x} {y} {z}\n");
    }
    for [a, b, c, d] in CUBE.map(|side| side.map(|i| i + 1)) {
        text += &format!("f {a} {b} {c} {d}\n");
    }
    text
}

/// Returns a file's faces, which must not depend on how it is read, and its part names.
fn both(files: &Files, text: &str) -> (Vec<OwnedFace>, Vec<String>) {
    let path = files.write("a.obj", text);
    let mut models = [ENOUGH, LITTLE].map(|memory| open(&path, memory).unwrap());
    let [whole, streamed] = models.each_mut().map(|model: &mut Box<dyn Model>| {
        let read = faces(&mut **model).unwrap();
        assert_eq!(faces(&mut **model).unwrap(), read);
        (read, model.info().clone(), model.degenerate())
    });
    assert_eq!(whole.0, streamed.0, "{text}");
    assert_eq!(format!("{:?}", whole.1), format!("{:?}", streamed.1));
    assert_eq!(whole.2, streamed.2);
    (whole.0, whole.1.parts)
}

#[test]
fn ways_to_write_a_face() {
    let files = Files::new();
    assert_eq!(both(&files, &text_cube()).0, cube());
    assert_eq!(files.open("a.obj", text_cube()).unwrap().info().faces, Some(6));
    for (from, to) in [
        ("f 1 5 7 3", "f 1/1 5/1 7/1 3/1"),
        ("f 1 5 7 3", "f 1/1/1 5/1/1 7/1/1 3/1/1"),
        ("f 1 5 7 3", "f 1//1 5//1 7//1 3//1"),
        ("f 1 5 7 3", "f -8 -4/7 -2//9 -6"),
        ("f 1 5 7 3", "f 1 5 \\\n 7 3 # a side"),
        ("f 1 5 7 3", "\tf  1\t5 7 3 \r"),
        ("f 1 5 7 3", "f 1 5\\\r\n7 3"),
        ("f 1 5 7 3", "l 1 2 3\np 1\nf 1 5 7 3\ns off\nvt 0 0\nvn 0 0 1\nunknown 7"),
        ("v 2 2 2", "v 4 4 4 2"),
        ("v 2 2 2", "v 2 2 2 # last"),
        ("v 2 2 2", "v 2 \\\n 2 2"),
    ] {
        assert!(text_cube().contains(from));
        assert_eq!(both(&files, &text_cube().replace(from, to)).0, cube(), "{to}");
    }
}

#[test]
fn vertices_between_and_after_faces() {
    let files = Files::new();
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nf -1 1 2\nf 1 2 5\nv 0 7 0\n";
    let (faces, _) = both(&files, text);
    assert_eq!(faces[1].points, [[5.0, 0.0, 0.0], [0.0; 3], [1.0, 0.0, 0.0]]);
    assert_eq!(faces[2].points, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 7.0, 0.0]]);
}

#[test]
fn faces_that_cover_nothing() {
    let files = Files::new();
    let text = text_cube() + "f\nf 1\nf 1 2\nf 1 1 2\nf 1 2 3\nf 1 2 1 2\nf\n";
    assert_eq!(both(&files, &text).0.len(), 7);
    let mut model = files.open("a.obj", text).unwrap();
    faces(&mut *model).unwrap();
    assert_eq!(model.degenerate(), 6);
}

#[test]
fn objects_or_groups_are_parts() {
    let files = Files::new();
    let triangle = "f 1 2 3\n";
    let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let parts = |text: &str| {
        let (faces, names) = both(&files, &(start.to_owned() + text));
        faces.iter().map(|face| names[face.part as usize].clone()).collect::<Vec<_>>()
    };
    assert_eq!(parts(triangle), ["mesh"]);
    assert_eq!(parts(&format!("g a b\n{triangle}g c\n{triangle}g a b\n{triangle}")), ["a b", "c", "a b"]);
    assert_eq!(
        parts(&format!("{triangle}o x\ng a\n{triangle}g b\n{triangle}o  y \n{triangle}")),
        ["mesh", "x", "x", "y"]
    );
}

#[test]
fn colours() {
    let files = Files::new();
    let coloured = "v 0 0 0 1 0.2 0\nv 1 0 0 0 0 1\nv 0 1 0 1 1 1\nf 1 2 3\n";
    assert_eq!(both(&files, coloured).0[0].colours, [[255, 51, 0], [0, 0, 255], [255; 3]]);
    let some = coloured.replace("0 0 0 1 0.2 0", "0 0 0");
    assert_eq!(both(&files, &some).0[0].colours, [[255; 3], [0, 0, 255], [255; 3]]);
}

#[test]
fn materials() {
    let files = Files::new();
    let text = "mtllib some materials.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl a b\nf 1 2 3\nusemtl c\nf 1 2 3\n";
    assert_eq!(both(&files, text).0[1].colours, [[0; 3]; 0], "no file");
    files.write("some materials.mtl", "newmtl a b\nKd 1 0.2 0\nnewmtl c\nKd 0 0 1\n");
    let (faces, parts) = both(&files, text);
    let colours: Vec<_> = faces.iter().map(|face| face.colours.clone()).collect();
    assert_eq!(colours, [[[255; 3]; 3], [[255, 51, 0]; 3], [[0, 0, 255]; 3]]);
    assert_eq!(parts, ["mesh"]);
    files.write("some materials.mtl", "\u{feff}newmtl a b\nKd 1 0.2 0\nnewmtl c\nKd 0 0 1\n");
    assert_eq!(both(&files, text).0[1].colours, [[255, 51, 0]; 3], "after a byte order mark");
    assert_eq!(
        both(&files, &text.replace("some", "../some")).0[1].colours,
        [[0; 3]; 0],
        "in another directory"
    );
    // Vertex colours take precedence.
    let own = text.replace("v 0 0 0", "v 0 0 0 0 1 0");
    assert_eq!(both(&files, &own).0[1].colours[0], [0, 255, 0]);
    for broken in ["newmtl a\nKd 1\n", "newmtl", "newmtl a\nKd x y z\n", "map_Kd\u{20ac}"] {
        files.write("some materials.mtl", broken);
        assert_eq!(both(&files, text).0[1].colours, [[0; 3]; 0], "{broken}");
    }
}

#[test]
fn broken() {
    let files = Files::new();
    for (from, to, expected) in [
        ("v 2 2 2", "v 2 2 nan", "vertex 8, line 9"),
        ("v 2 2 2", "v 2 2", "vertex 8, line 9"),
        ("v 2 2 2", "v 2 2 2 0", "vertex 8, line 9"),
        ("v 2 2 2", "v 2 2 2 1 1", "vertex 8, line 9"),
        ("v 2 2 2", "v 2 2 2 1 1 red", "vertex 8, line 9"),
        ("f 1 5 7 3", "f 1 5 9 3", "face 0, line 10"),
        ("f 1 5 7 3", "f 1 5 0 3", "face 0, line 10"),
        ("f 1 5 7 3", "f 1 5 -9 3", "face 0, line 10"),
        ("f 1 5 7 3", "f 1 5 /7 3", "face 0, line 10"),
        ("f 1 5 7 3", "f 1 5 seven 3", "\"seven\""),
        ("f 1 5 7 3", "f 1 5 99999999999999999999 3", "face 0, line 10"),
    ] {
        assert!(text_cube().contains(from));
        let found = files.error("a.obj", text_cube().replace(from, to));
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }
    assert!(files.error("a.obj", "f 1 2 3\n").contains("no vertices"));
    // Text without an end mark can be truncated at many positions, but not within a vertex or
    // before the first one.
    let read = read_truncated("a.obj", text_cube().as_bytes());
    assert!((20..text_cube().len() - 40).contains(&read), "{read}");
}

#[test]
fn vertices_beyond_the_memory_go_to_disk() {
    let files = Files::new();
    let mut text = String::new();
    for i in 0..60_000 {
        text += &format!("v {i} {} 0.5\n", i % 7);
    }
    for i in 1..59_999 {
        text += &format!("f {i} {} {}\n", i + 1, i + 2);
    }
    let (faces, _) = both(&files, &text);
    assert_eq!(faces.len(), 59_998);
    assert_eq!(faces[59_997].points[2], [59_999.0, f64::from(59_999 % 7), 0.5]);
}
