//! Malicious files, and what all formats share.

use super::mesh_files::*;
use super::{cityjson, gltf, obj, off, ply, stl};
use spinney::Error;
use spinney::raw::import::mesh::open;

#[test]
fn the_same_cube_in_all_formats() {
    let files = Files::new();
    for (name, text) in [
        ("a.ply", ply::text_cube()),
        ("a.obj", obj::text_cube()),
        ("a.off", off::text_cube()),
        ("a.json", cityjson::text_cube()),
    ] {
        assert_eq!(files.faces(name, text).unwrap(), cube(), "{name}");
    }
    let expected = volume_and_area(&cube());
    assert_eq!(expected, [8.0, 24.0]);
    assert_eq!(volume_and_area(&files.faces("a.stl", stl::text_cube()).unwrap()), expected);
}

#[test]
fn content_counts_more_than_the_name() {
    let files = Files::new();
    for name in ["a", "a.obj", "a.ply", "a.txt", "a.off", "a.JSON"] {
        for text in [ply::text_cube(), off::text_cube(), cityjson::text_cube()] {
            assert_eq!(files.faces(name, text).unwrap(), cube(), "{name}");
        }
        assert_eq!(files.faces(name, stl::text_cube()).unwrap().len(), 12, "{name}");
        assert_eq!(files.faces(name, stl::binary_cube("solid")).unwrap().len(), 12, "{name}");
    }
    for name in ["a", "a.OBJ", "a.txt"] {
        assert_eq!(files.faces(name, obj::text_cube()).unwrap(), cube(), "{name}");
    }
}

#[test]
fn byte_order_marks_are_no_text() {
    let files = Files::new();
    let marked = |text: String| format!("\u{feff}{text}");
    for (name, text) in [
        ("a.ply", ply::text_cube()),
        ("a.obj", obj::text_cube()),
        ("a.off", off::text_cube()),
        ("a.json", cityjson::text_cube()),
    ] {
        // Also under a name without an extension.
        for name in [name, "a"] {
            assert_eq!(files.faces(name, marked(text.clone())).unwrap(), cube(), "{name}");
        }
    }
    assert_eq!(
        files.faces("a.obj", "\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n").unwrap().len(),
        1
    );
    let facets = files.faces("a.stl", stl::text_cube()).unwrap();
    assert_eq!(files.faces("a.stl", marked(stl::text_cube())).unwrap(), facets);
    // In a binary file these bytes are among 80 arbitrary ones.
    assert_eq!(files.faces("a.stl", stl::binary_cube("\u{feff}solid")).unwrap(), facets);
}

#[test]
fn no_mesh_at_all() {
    let files = Files::new();
    for name in ["a.ply", "a.obj", "a.stl", "a.off", "a.json", "a.glb", "a.gltf", "a"] {
        assert!(files.error(name, "").contains("no bytes"), "{name}");
        files.error(name, [0u8; 1000]);
        files.error(name, [0xffu8; 84]);
    }
    let error = files.error("a.txt", "hello");
    assert!(
        ["PLY", "OBJ", "STL", "OFF", "glTF", "CityJSONSeq"].iter().all(|format| error.contains(format)),
        "{error}"
    );
    let directory = tempfile::tempdir().unwrap();
    assert!(matches!(open(directory.path(), ENOUGH), Err(Error::Io { .. })));
    assert!(matches!(open(&directory.path().join("a.ply"), ENOUGH), Err(Error::Io { .. })));
}

#[test]
fn deep_nesting() {
    let files = Files::new();
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let deep = format!("{}0{}", open.repeat(300_000), close.repeat(300_000));
        let text = cityjson::text_cube();
        let _ = files.faces("a.json", &deep);
        assert_eq!(
            files.faces("a.json", text.replace("[[null]]", &deep)).ok(),
            Some(cube()),
            "an unused member"
        );
        files.error("a.json", text.replacen("[[0, 4, 6, 2]]", &deep, 1));
        files.error("a.json", text.replacen("[0, 0, 0]", &deep, 1));
        files.error("a.json", text[..text.len() - 1].replacen("[[null]]", open, 1));
    }
}

#[test]
fn endless_lines() {
    let files = Files::new();
    let long = |byte: u8| vec![byte; 100 << 20];
    for (name, start) in
        [("a.ply", "ply\n"), ("a.obj", "v "), ("a.off", "OFF\n"), ("a.stl", "solid "), ("a.json", "{\"")]
    {
        for byte in [b'1', b' '] {
            let file = [start.as_bytes(), &long(byte)].concat();
            files.error(name, file);
        }
    }
    let words = b"f 1 ".iter().chain(b"1 ".iter().cycle().take(8 << 20)).copied().collect::<Vec<u8>>();
    let file = [b"v 0 0 0\n", words.as_slice()].concat();
    assert!(files.error("a.obj", file).contains("2^20"));
}

#[test]
fn too_many_names() {
    let files = Files::new();
    let mut text = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    for i in 0..20_000 {
        text += &format!("g {i:0100}\nf 1 2 3\n");
    }
    let path = files.write("a.obj", &text);
    assert!(matches!(open(&path, 1 << 20).map(|_| ()), Err(Error::TooLarge { .. })));
    assert_eq!(open(&path, ENOUGH).unwrap().info().parts.len(), 20_000);
}

#[test]
fn errors_of_the_caller_end_reading() {
    let files = Files::new();
    for (name, text) in [
        ("a.ply", ply::text_cube()),
        ("a.obj", obj::text_cube()),
        ("a.off", off::text_cube()),
        ("a.stl", stl::text_cube()),
        ("a.json", cityjson::text_cube()),
        ("a.gltf", gltf::File::cube().embedded()),
    ] {
        let mut count = 0;
        let outcome = files.open(name, text).unwrap().faces(&mut |_| {
            count += 1;
            if count == 3 { Err(Error::Interrupted) } else { Ok(()) }
        });
        assert!(matches!(outcome, Err(Error::Interrupted)), "{name}");
        assert_eq!(count, 3, "{name}");
    }
}
