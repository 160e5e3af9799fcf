//! PLY.

use super::mesh_files::*;

/// The cube as text, with additional properties.
pub(crate) fn text_cube() -> String {
    let mut text = String::from(
        "ply\nformat ascii 1.0\ncomment a cube\nelement vertex 8\nproperty float x\nproperty float y\n\
         property float z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n",
    );
    for [x, y, z] in cube_points() {
        text += &format!("{x} {y} {z}\n");
    }
    for [a, b, c, d] in CUBE {
        text += &format!("4 {a} {b} {c} {d}\n");
    }
    text
}

/// Returns a number as bytes: type name, value, whether it is big-endian.
fn bytes(scalar: &str, value: f64, big: bool) -> Vec<u8> {
    let mut bytes = match scalar {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
        "short" => (value as i16).to_le_bytes().to_vec(),
        "ushort" => (value as u16).to_le_bytes().to_vec(),
        "int" => (value as i32).to_le_bytes().to_vec(),
        "uint" => (value as u32).to_le_bytes().to_vec(),
        "float" => (value as f32).to_le_bytes().to_vec(),
        "double" => value.to_le_bytes().to_vec(),
        _ => panic!("{scalar}"),
    };
    if big {
        bytes.reverse();
    }
    bytes
}

/// Returns the cube in binary. `coordinate` is the coordinates' type; with `list`, vertices have a
/// list before x; lists of vertices have types of length and items, with other properties before
/// and after them.
fn binary_cube(big: bool, coordinate: &str, list: bool, [length, item]: [&str; 2]) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let before = if list { "property list uchar short neighbours\n" } else { "property uchar flags\n" };
    let mut file = format!(
        "ply\r\nformat binary_{order}_endian 1.0\r\nelement thing 2\nproperty list int double weights\n\
         element vertex 8\n{before}property {coordinate} z\nproperty {coordinate} x\nproperty {coordinate} y\n\
         property float quality\nelement nothing 4000000000000\nelement face 6\nproperty short group\n\
         property list {length} {item} vertex_index\nproperty list uchar float texcoord\nend_header\r\n"
    )
    .into_bytes();
    let mut put = |scalar, value| file.extend(bytes(scalar, value, big));
    for weights in [0, 3] {
        put("int", weights.into());
        (0..weights).for_each(|i| put("double", i.into()));
    }
    for [x, y, z] in cube_points() {
        put("uchar", 2.0);
        if list {
            put("short", -1.0);
            put("short", 300.0);
        }
        [z, x, y, 0.5]
            .iter()
            .zip([coordinate, coordinate, coordinate, "float"])
            .for_each(|(v, s)| put(s, *v));
    }
    for side in CUBE {
        put("short", -7.0);
        put(length, 4.0);
        side.iter().for_each(|i| put(item, *i as f64));
        put("uchar", 2.0);
        put("float", 0.0);
        put("float", 1.0);
    }
    file
}

#[test]
fn text() {
    let files = Files::new();
    assert_eq!(files.faces("a.ply", text_cube()).unwrap(), cube());
    let model = files.open("a.ply", text_cube()).unwrap();
    let info = model.info();
    assert_eq!(info.bounds, [[0.0; 3], [2.0; 3]]);
    assert_eq!((info.faces, info.is_coloured, info.parts.len()), (Some(6), false, 1));
    assert_eq!(info.format, "PLY, text");
    assert_eq!(info.bytes, text_cube().len() as u64);
    for end in ["\r\n", "\r"] {
        assert_eq!(files.faces("a.ply", text_cube().replace('\n', end)).unwrap(), cube());
    }
}

#[test]
fn binary() {
    let files = Files::new();
    for big in [false, true] {
        for coordinate in ["float", "double", "short", "uint8"] {
            for list in [false, true] {
                for corners in [["uchar", "int"], ["int", "ushort"], ["uint8", "uint"], ["short", "char"]] {
                    let file = binary_cube(big, coordinate, list, corners);
                    let faces = files.faces("a.ply", file).unwrap();
                    assert_eq!(faces, cube(), "{big} {coordinate} {list} {corners:?}");
                }
            }
        }
    }
}

#[test]
fn faces_before_vertices() {
    let text = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_index\nelement vertex 3\n\
                property double x\nproperty double y\nproperty double z\nend_header\n3 0 1 2\n0 0 0\n1 0 0\n0 0.1 0";
    let faces = Files::new().faces("a.ply", text).unwrap();
    assert_eq!(faces[0].points, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.1, 0.0]]);
}

#[test]
fn colours() {
    let files = Files::new();
    for (scalar, colour) in [("uchar", "255 51 0"), ("float", "1 0.2 0"), ("ushort", "65535 13107 0")] {
        let of_vertices = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             property {scalar} red\nproperty {scalar} green\nproperty {scalar} blue\nelement face 1\n\
             property list uchar int vertex_indices\nend_header\n\
             0 0 0 {colour}\n1 0 0 {colour}\n0 1 0 {colour}\n3 0 1 2\n"
        );
        let of_faces = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\n\
             property {scalar} red\nproperty {scalar} green\nproperty {scalar} blue\nend_header\n\
             0 0 0\n1 0 0\n0 1 0\n3 0 1 2 {colour}\n"
        );
        for text in [of_vertices, of_faces] {
            assert_eq!(files.faces("a.ply", text).unwrap()[0].colours, [[255, 51, 0]; 3], "{scalar}");
        }
    }
    let mut file =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty uchar red\nproperty float x\n\
        property float y\nproperty uchar blue\nproperty float z\nproperty uchar green\nelement face 1\n\
        property list uchar uchar vertex_indices\nend_header\n"
            .to_vec();
    for i in 0..3u8 {
        file.push(10 + i);
        file.extend(f32::from(i).to_le_bytes());
        file.extend(f32::from(i * i).to_le_bytes());
        file.push(20 + i);
        file.extend(0f32.to_le_bytes());
        file.push(30 + i);
    }
    file.extend([3, 0, 1, 2]);
    let faces = files.faces("a.ply", file).unwrap();
    assert_eq!(faces[0].colours, [[10, 30, 20], [11, 31, 21], [12, 32, 22]]);
    assert_eq!(faces[0].points, [[0.0; 3], [1.0, 1.0, 0.0], [2.0, 4.0, 0.0]]);
}

#[test]
fn faces_that_cover_nothing_are_counted() {
    let files = Files::new();
    let text = text_cube().replace("face 6", "face 9") + "3 1 1 2\n2 0 1\n0\n";
    let mut model = files.open("a.ply", text).unwrap();
    assert_eq!(model.degenerate(), 0);
    for _ in 0..2 {
        assert_eq!(faces(&mut *model).unwrap(), cube());
        assert_eq!(model.degenerate(), 3);
    }
}

#[test]
fn broken_headers() {
    let files = Files::new();
    let error = |from: &str, to: &str| {
        let text = text_cube();
        assert!(text.contains(from));
        files.error("a.ply", text.replace(from, to))
    };
    for (from, to, expected) in [
        ("vertex 8", "vertex 2147483648", "at least"),
        ("vertex 8", "vertex 18446744073709551615", "line 4"),
        ("face 6", "face 9223372036854775807", "at least"),
        ("vertex 8", "vertex -8", "line 4"),
        ("vertex 8", "vertex 0", "no vertices"),
        ("float y", "float v", "x, y and z"),
        ("float y", "quad y", "line 6"),
        ("vertex_indices", "corners", "vertex_index"),
        ("list uchar", "list float", "line 9"),
        ("element vertex 8\n", "", "an `element` line before it"),
        ("format ascii 1.0\n", "", "format"),
        ("format ascii 1.0", "format ascii 2.0", "2.0"),
        ("element face 6\nproperty list uchar int vertex_indices\n", "", "without faces"),
        ("face 6", "tristrips 6", "triangle strips"),
        ("end_header\n", "", "line 10"),
    ] {
        let found = error(from, to);
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }
}

#[test]
fn broken_bodies() {
    let files = Files::new();
    for (from, to, expected) in [
        ("2 2 2\n", "2 nan 2\n", ["vertex 7", "NaN"]),
        ("2 2 2\n", "2 inf 2\n", ["vertex 7", "inf"]),
        ("2 2 2\n", "2 1e400 2\n", ["vertex 7", "line 18"]),
        ("2 2 2\n", "2 two 2\n", ["vertex 7", "\"two\""]),
        ("4 0 4 6 2", "4 0 4 6 8", ["face 0", "vertex 8 of 8"]),
        ("4 0 4 6 2", "4 0 -1 6 2", ["face 0", "vertex -1 of 8"]),
        ("4 0 4 6 2", "-4 0 4 6 2", ["face 0", "a list length of -4"]),
        ("4 0 4 6 2", "2000000 0 4 6 2", ["line 19", "2^20"]),
        ("4 0 4 6 2", "4 0 4.5 6 2", ["face 0", "\"4.5\""]),
        ("4 4 5 7 6", "4 4 5 7", ["face 5", "end of the file"]),
    ] {
        let text = text_cube();
        assert!(text.contains(from));
        let found = files.error("a.ply", text.replace(from, to));
        assert!(expected.iter().all(|expected| found.contains(expected)), "{from} -> {to}: {found}");
    }
    // A coordinate that is NaN, at an offset found by searching the file.
    for list in [false, true] {
        let mut file = binary_cube(false, "float", list, ["uchar", "int"]);
        let two = 2f32.to_le_bytes();
        let at = file.windows(4).rposition(|bytes| bytes == two).unwrap();
        file[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(files.error("a.ply", file).contains("vertex 7"));
    }
    let mut file = binary_cube(true, "float", false, ["int", "int"]);
    let at = file.len() - 6 * (2 + 5 * 4 + 9) + 2;
    file[at] = 0xff;
    assert!(files.error("a.ply", &file).contains("a list length of -"), "negative");
    file[at..at + 4].copy_from_slice(&[0, 0x0f, 0, 0]);
    assert!(files.error("a.ply", &file).contains("the index of a vertex in the file"), "long");
}

#[test]
fn truncated() {
    // All bytes except the last, a line feed, are required.
    assert_eq!(read_truncated("a.ply", text_cube().as_bytes()), 1);
    for list in [false, true] {
        assert_eq!(read_truncated("a.ply", &binary_cube(false, "float", list, ["uchar", "int"])), 0);
    }
}
