//! STL.

use super::mesh_files::*;

/// Returns the cube's facets: each side is a fan of two triangles.
fn facets() -> Vec<[[f64; 3]; 3]> {
    let sides = cube();
    sides
        .iter()
        .flat_map(|side| [[0, 1, 2], [0, 2, 3]].map(|fan| fan.map(|i: usize| side.points[i])))
        .collect()
}

pub(crate) fn text_cube() -> String {
    let mut text = String::from("solid a cube\n");
    for corners in facets() {
        text += "  facet normal 0 0 nan\n    outer loop\n";
        for [x, y, z] in corners {
            text += &format!("      vertex {x} {y:e} {z:.3}\n");
        }
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid a cube\n"
}

pub(crate) fn binary_cube(header: &str) -> Vec<u8> {
    let mut file = vec![b' '; 80];
    file[..header.len()].copy_from_slice(header.as_bytes());
    file.extend((facets().len() as u32).to_le_bytes());
    for corners in facets() {
        file.extend([0; 12]);
        corners.as_flattened().iter().for_each(|number| file.extend((*number as f32).to_le_bytes()));
        file.extend([0x34, 0x12]);
    }
    file
}

fn points(faces: &[OwnedFace]) -> Vec<Vec<[f64; 3]>> {
    faces.iter().map(|face| face.points.clone()).collect()
}

#[test]
fn text_and_binary() {
    let files = Files::new();
    let expected: Vec<_> = facets().iter().map(|corners| corners.to_vec()).collect();
    assert_eq!(points(&files.faces("a.stl", text_cube()).unwrap()), expected);
    assert_eq!(points(&files.faces("a.stl", text_cube().to_uppercase()).unwrap()), expected);
    for header in ["", "COLOR=abcd", "solid that is binary", "solid x\nfacet normal 0 0 0\n"] {
        assert_eq!(points(&files.faces("a.stl", binary_cube(header)).unwrap()), expected, "{header}");
    }
    let model = files.open("a.stl", binary_cube("")).unwrap();
    let info = model.info();
    assert_eq!(
        (info.faces, info.bounds, info.format.as_str()),
        (Some(12), [[0.0; 3], [2.0; 3]], "STL, binary")
    );
    assert_eq!(files.open("a.stl", text_cube()).unwrap().info().format, "STL, text");
}

#[test]
fn solids_are_parts() {
    let files = Files::new();
    let text = text_cube() + &text_cube().replace("a cube", "other") + &text_cube();
    let mut model = files.open("a.stl", text).unwrap();
    assert_eq!(model.info().parts, ["a cube", "other"]);
    let parts: Vec<u32> = faces(&mut *model).unwrap().iter().map(|face| face.part).collect();
    assert_eq!(parts, [[0; 12], [1; 12], [0; 12]].concat());
}

#[test]
fn variants_of_text() {
    let files = Files::new();
    let expected: Vec<_> = facets().iter().map(|corners| corners.to_vec()).collect();
    let long = "name ".repeat(2000);
    for text in [
        text_cube().replace("endsolid", "end solid"),
        text_cube().replace("endloop", "end loop").replace("endfacet", "END FACET"),
        text_cube().replace("a cube", ""),
        text_cube().replace("a cube", long.trim_end()),
        text_cube().replace("a cube\n  facet", "a cube\n# facets\ncolor 1 0 0\n  facet"),
        format!("# made by hand\n{}", text_cube()),
        text_cube().replace("  facet", "\n\t; remark\n// another\n  facet"),
        text_cube().replace('\n', " "),
        text_cube().replace('\n', "\r"),
    ] {
        assert_eq!(points(&files.faces("a.stl", &text).unwrap()), expected, "{}", &text[..200]);
    }
    let one_line = (text_cube() + &text_cube().replace("a cube", "solid rock")).replace('\n', " ");
    assert_eq!(files.open("a.stl", one_line).unwrap().info().parts.len(), 2);
}

#[test]
fn bytes_after_the_declared_facets() {
    let files = Files::new();
    let expected: Vec<_> = facets().iter().map(|corners| corners.to_vec()).collect();
    // Concatenated files are separate solids.
    let twice = [binary_cube("a"), binary_cube("b")].concat();
    let mut model = files.open("a.stl", &twice).unwrap();
    assert_eq!((model.info().parts.len(), faces(&mut *model).unwrap().len()), (2, 24));
    assert!(model.remarks().is_empty());
    // Facets that the header does not count are reported.
    let mut file = binary_cube("");
    file[80..84].copy_from_slice(&10u32.to_le_bytes());
    let mut model = files.open("a.stl", &file).unwrap();
    assert_eq!(points(&faces(&mut *model).unwrap()), expected[..10]);
    let remarks = model.remarks();
    assert!(remarks[0].contains("10 facets") && remarks[0].contains("2 facets"), "{remarks:?}");
}

#[test]
fn broken() {
    let files = Files::new();
    for (from, to, expected) in [
        ("vertex 2", "vertex inf", "line 18"),
        ("vertex 2", "vertex", "line 18"),
        ("vertex 2", "", "line 18"),
        ("endfacet", "", "line 9"),
        ("outer loop", "vertex 0 0 0", "line 6"),
        ("endsolid a cube\n", "", "the end of the file"),
    ] {
        let found = files.error("a.stl", text_cube().replacen(from, to, 1));
        assert!(found.contains(expected), "{from} -> {to}: {found}");
    }
    let mut file = binary_cube("");
    file[84 + 50 + 12 + 4..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(files.error("a.stl", &file).contains("facet 1, byte 134"));
    let mut file = binary_cube("");
    file[80..84].copy_from_slice(&[0xff; 4]);
    assert!(files.error("a.stl", &file).contains("4294967295 facets"));
}

#[test]
fn truncated() {
    // The name and the line feed after `endsolid` are optional.
    assert_eq!(read_truncated("a.stl", text_cube().as_bytes()), 8);
    assert_eq!(read_truncated("a.stl", &binary_cube("")), 0);
}
