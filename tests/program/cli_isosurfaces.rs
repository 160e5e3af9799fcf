//! `spinney contours` of octrees: files of isosurfaces.

use std::fs;
use std::path::Path;

use spinney::{DataKind, Frame, Rule, SampleType};
use tempfile::TempDir;

use crate::common::command::{complaint, spinney, stderr, stdout};
use crate::common::mesh_file::{Read, read_off, read_ply, read_stl};
use crate::common::{made, oct, write_goblin};

/// Returns a ball in 40 x 36 x 44 cells with a frame: values decrease from its centre by 1 per
/// cell.
fn ball() -> (TempDir, String) {
    let form = oct(SampleType::F32, 1);
    let cells = made(form, [40, 36, 44], |cell| {
        let away: f64 =
            cell.iter().zip([19.8, 18.1, 20.3]).map(|(at, middle)| (*at as f64 - middle).powi(2)).sum();
        Some(form.value.nearest(|_| 20.0 - away.sqrt()))
    });
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("ball.goblin");
    let matrix = [[0.5, 0.0, 0.0, 100.0], [0.0, -0.5, 0.0, 200.0], [0.0, 0.0, 0.5, 300.0]];
    write_goblin(&path, &cells, (Rule::Mean, DataKind::Continuous), Frame { matrix, ..Frame::identity() });
    (directory, path.to_str().unwrap().into())
}

fn check_ball(read: &Read, radius: f64) {
    read.check_closed("ball");
    let expected = std::f64::consts::PI * radius.powi(3) * 4.0 / 3.0;
    assert!((read.volume() / expected - 1.0).abs() < 0.01, "{}, not {expected}", read.volume());
    let middle = [100.0 + 0.5 * 20.3, 200.0 - 0.5 * 18.6, 300.0 + 0.5 * 20.8];
    for point in &read.points {
        let away: f64 = point.iter().zip(middle).map(|(at, middle)| (at - middle).powi(2)).sum();
        assert!((away.sqrt() - radius).abs() < 0.05, "{point:?}");
    }
}

#[test]
fn all_formats_have_the_same_surface() {
    let (directory, file) = ball();
    let run = |name: &str| {
        let out = directory.path().join(name);
        spinney(&["-q", "contours", &file, "--at", "6", "-o", out.to_str().unwrap()]).success();
        fs::read(out).unwrap()
    };
    let (ply, off, stl) = (read_ply(&run("a.ply")), read_off(&run("a.off")), read_stl(&run("a.stl")));
    [&ply, &off, &stl].into_iter().for_each(|read| check_ball(read, 7.0));
    assert_eq!((ply.faces.len(), &ply.faces), (stl.faces.len(), &off.faces));
    let text = stdout(&["contours", &file, "--at", "6", "-o", "-", "--format", "obj"]);
    assert_eq!(text.as_bytes(), run("a.obj"));
    assert_eq!(text.lines().filter(|line| line.starts_with("f ")).count(), ply.faces.len());
}

#[test]
fn several_surfaces_are_distinguished() {
    let (directory, file) = ball();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    spinney(&["-q", "contours", &file, "--at", "11.5,6.5", "-o", &path("a.obj")]).success();
    let text = fs::read_to_string(path("a.obj")).unwrap();
    let parts: Vec<&str> = text.lines().filter(|line| line.starts_with("o ")).collect();
    assert_eq!(parts, ["o level_6.5", "o level_11.5"]);
    spinney(&["-q", "contours", &file, "--at", "11.5,6.5", "-o", &path("a.ply")]).success();
    let bytes = fs::read(path("a.ply")).unwrap();
    let head = String::from_utf8_lossy(&bytes[..400]).into_owned();
    assert!(head.contains("vertex_indices\nproperty float level\nend_header\n"), "{head}");
    let last = |bytes: &[u8]| f32::from_le_bytes(bytes[bytes.len() - 4..].try_into().unwrap());
    assert_eq!(last(&bytes), 11.5);
    // A coarser level, a window, and a value that is never reached.
    let more = ["--level", "4", "--ends", "close", "--view", "window=0,0,0,20,36,44"];
    let out = path("b.ply");
    let words = [&["-q", "contours", &file, "--at", "6", "-o", &out], &more[..]].concat();
    spinney(&words).success();
    let part = read_ply(&fs::read(&out).unwrap());
    part.check_closed("part");
    let text = stderr(spinney(&["-q", "contours", &file, "--at", "1000", "-o", &out]).success());
    assert!(text.contains("has no triangles"), "{text}");
    assert!(read_ply(&fs::read(&out).unwrap()).faces.is_empty());
}

#[test]
fn what_cannot_be_done_leaves_no_file() {
    let (directory, file) = ball();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let out = path("out.ply");
    let refused = |words: &[&str], code: i32| {
        let text = complaint(&[&["contours"], words].concat(), code);
        let left = fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name());
        assert!(left.into_iter().all(|name| !name.to_str().unwrap().starts_with("out")), "{words:?}");
        text
    };
    let of = |more: &[&str]| refused(&[&[&file as &str, "-o", &out], more].concat(), 1);
    for option in ["--filled", "--3d", "--smooth=2"] {
        let text = of(&["--at", "6", option]);
        assert!(text.contains(option.split('=').next().unwrap()) && text.contains("octree"), "{text}");
    }
    assert!(of(&["--at", "6", "--ends", "extend"]).contains("open or close"));
    assert!(of(&["--every", "1e-9"]).contains("fewer levels"));
    assert!(of(&["--at", "nan"]).contains("--at: got NaN"));
    assert!(of(&["--at", "6,inf"]).contains("--at: got"));
    assert!(of(&["--at", "6", "--level", "30"]).contains("--level"));
    assert!(of(&["--at", "6", "--max-bytes", "100"]).contains("100"));
    for name in ["out.geojson", "out.city.json", "out.glb"] {
        let text = refused(&[&file, "--at", "6", "-o", &path(name)], 1);
        assert!(text.contains(".ply, .obj, .stl or .off"), "{text}");
    }
    for name in ["out.stl", "out.off"] {
        assert!(refused(&[&file, "--at", "6,7", "-o", &path(name)], 1).contains("PLY or OBJ"));
    }
    // A truncated file.
    let bytes = fs::read(&file).unwrap();
    for length in [0, 50, bytes.len() / 2, bytes.len() - 1] {
        fs::write(path("bad.goblin"), &bytes[..length]).unwrap();
        refused(&[&path("bad.goblin"), "--at", "6", "-o", &out], 1);
    }
    // The tree is not a valid output.
    assert!(refused(&[&file, "--at", "6", "-o", &file, "--format", "ply"], 1).contains("is an input"));
    assert!(Path::new(&file).exists());
}
