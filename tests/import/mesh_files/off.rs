//! OFF.

use super::mesh_files::*;

pub(crate) fn text_cube() -> String {
    let mut text = String::from("OFF\n# a cube\n8 6 12\n\n");
    for [x, y, z] in cube_points() {
        text += &format!("{x} {y} {z} # corner\n");
    }
    for [a, b, c, d] in CUBE {
        text += &format!("4 {a} {b} {c} {d}\n");
    }
    text
}

#[test]
fn headers() {
    let files = Files::new();
    for start in
        ["OFF\n# a cube\n8 6 12\n", "OFF 8 6 12\n", "OFF8 6 12\n", "OFF\r\n8 6\r\n", "# cube\nOFF\n8 6 0\n"]
    {
        let text = text_cube().replace("OFF\n# a cube\n8 6 12\n", start);
        assert_eq!(files.faces("a.off", text).unwrap(), cube(), "{start:?}");
    }
    let bare = text_cube().replace("OFF\n", "");
    assert_eq!(files.faces("a.off", bare).unwrap(), cube());
    let model = files.open("a.off", text_cube()).unwrap();
    assert_eq!((model.info().faces, model.info().bounds), (Some(6), [[0.0; 3], [2.0; 3]]));
}

#[test]
fn colours() {
    let files = Files::new();
    let colours = |text: &str| files.faces("a.off", text).unwrap()[0].colours.clone();
    let of_vertices = "COFF\n3 1 0\n0 0 0 255 0 51 255\n1 0 0 1.0 0 0.2 1\n0 1 0 0 0 255 0\n3 0 1 2\n";
    assert_eq!(colours(of_vertices), [[255, 0, 51], [1, 0, 0], [0, 0, 255]]);
    // One range for all colours of a file: 0 to 1 if no number is larger.
    let up_to_1 = "COFF\n3 1 0\n0 0 0 0.5 0.5 0.5 1\n1 0 0 1 1 1 1\n0 1 0 1 0 0 1\n3 0 1 2\n";
    assert_eq!(colours(up_to_1), [[128; 3], [255; 3], [255, 0, 0]]);
    let with_normals =
        "CNOFF\n3 1 0\n0 0 0 0 0 1 1 2 3 4\n1 0 0 0 0 1 1 2 3 4\n0 1 0 0 0 1 5 6 7 8\n3 0 1 2\n";
    assert_eq!(colours(with_normals), [[1, 2, 3], [1, 2, 3], [5, 6, 7]]);
    let of_faces = "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 2 1 1.0 0.2 0\n";
    assert_eq!(colours(of_faces), [[255; 3]; 3]);
    assert_eq!(files.faces("a.off", of_faces).unwrap()[1].colours, [[255, 51, 0]; 3]);
    assert_eq!(colours(&of_faces.replace(" 1.0 0.2 0", " 7")), [[0; 3]; 0]);
}

#[test]
fn line_breaks_and_case() {
    let files = Files::new();
    let plain = text_cube().replace(" # corner", "").replace("# a cube\n", "").replace("\n\n", "\n");
    let numbers = plain.strip_prefix("OFF\n").unwrap().replace("8 6 12\n", "");
    let words = numbers.split_whitespace().collect::<Vec<_>>();
    for text in [
        plain.to_lowercase(),
        format!("OFF\n8\n6\n12\n{numbers}"),
        format!("OFF\n8\n6\n{numbers}"),
        format!("OFF 8 6 12 {}", words.join(" ")),
        format!("OFF\n8 6 12\n{}\n", words.join(" ")),
        format!("OFF\n8\n6\n12\n{}\n", words.join("\n")),
        plain.replace("4 0 4 6 2", "4\n0 4\n6\n2"),
        plain.replace('\n', "\r"),
    ] {
        assert_eq!(files.faces("a.off", &text).unwrap(), cube(), "{text}");
    }
    let coloured = text_cube().replace("OFF", "coff").replace(" # corner", " 1 0 0 1");
    assert_eq!(files.faces("a.off", coloured).unwrap()[0].colours, [[255, 0, 0]; 4]);
}

#[test]
fn broken() {
    let files = Files::new();
    for (from, to, expected) in [
        ("8 6 12", "2147483648 6 12", "at least"),
        ("8 6 12", "8 18446744073709551615 12", "line 3"),
        ("8 6 12", "0 6 12", "no vertices"),
        ("8 6 12", "8 7 12", "face 6"),
        ("OFF\n", "4OFF\n", "is not supported"),
        ("OFF\n", "OFF BINARY\n", "is not supported"),
        ("OFF\n", "COFF\n", "vertex 0, line 5"),
        ("2 2 2", "2 2 nan", "vertex 7, line 12"),
        ("2 2 2", "2 2", "vertex 7, line 12"),
        ("4 0 4 6 2", "4 0 4 6 8", "face 0, line 13"),
        ("4 0 4 6 2", "4 0 4 6 -1", "face 0, line 13"),
        ("4 0 4 6 2", "-4 0 4 6 2", "face 0, line 13"),
        ("4 0 4 6 2", "5 0 4 6 2", "face 0, line 13"),
        ("4 0 4 6 2", "2000000 0 4 6 2", "face 0, line 13"),
    ] {
        assert!(text_cube().contains(from));
        let found = files.error("a.off", text_cube().replace(from, to));
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }
    assert_eq!(read_truncated("a.off", text_cube().as_bytes()), 1);
}
