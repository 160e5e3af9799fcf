//! Octrees as glTF and back: the files that we write are read in world coordinates.

use std::collections::HashMap;
use std::path::Path;

use spinney::export::{GltfOptions, MeshFormat, MeshRequest, export_glb, export_mesh};
use spinney::import::mesh::{ExactOptions, Resolution, SolidOptions, import_exact, plan_models};
use spinney::raw::dataset;
use spinney::raw::import::mesh::open;
use spinney::{DataKind, Dataset, Frame, OpenOptions, Output, Rule};

use super::mesh_files::*;
use crate::common::{OCT, byte, dataset as dataset_of, made, opened, with, write_goblin};

/// Writes a tree as binary glTF, and reads its faces and bounds.
fn read_back(tree: &Dataset, smooth: bool, meshopt: bool, path: &Path) -> (Vec<OwnedFace>, [[f64; 3]; 2]) {
    let request = with(MeshRequest::new(), |it| it.smooth = smooth);
    let options = with(GltfOptions::new(), |it| it.meshopt = meshopt);
    let count = export_glb(tree, &request, &options, Output::create(path).unwrap(), &()).unwrap();
    let mut model = open(path, ENOUGH).unwrap();
    assert_eq!((model.info().faces, &model.info().parts[..]), (Some(count), &["mesh".to_string()][..]));
    assert!(model.remarks().is_empty());
    let bounds = model.info().bounds;
    (faces(&mut *model).unwrap(), bounds)
}

/// Number of edges that do not have as many faces in one direction as in the other, by exact
/// positions.
fn open_edges(faces: &[OwnedFace]) -> usize {
    let mut edges = HashMap::new();
    for face in faces {
        let bits = |corner: usize| face.points[corner % face.points.len()].map(f64::to_bits);
        for corner in 0..face.points.len() {
            let [a, b] = [bits(corner), bits(corner + 1)];
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += if a < b { 1 } else { -1 };
        }
    }
    edges.values().filter(|sum| **sum != 0).count()
}

#[test]
fn cells_of_several_blocks_are_one_closed_surface() {
    let side = 100;
    let centre = 50.3;
    let cells = made(OCT, [side; 3], |cell| {
        let distance: f64 = cell.iter().map(|at| (*at as f64 + 0.5 - centre).powi(2)).sum();
        (distance < 45.0f64.powi(2)).then(|| byte(255))
    });
    let filled = dataset_of(&cells, Rule::Occupancy, DataKind::Continuous);
    let files = Files::new();
    let path = files.write("ball.glb", "");
    let compressions: &[bool] = if cfg!(feature = "meshopt") { &[false, true] } else { &[false] };
    for meshopt in compressions {
        for smooth in [false, true] {
            std::fs::remove_file(&path).unwrap();
            let (faces, bounds) = read_back(&filled, smooth, *meshopt, &path);
            let volume = volume_and_area(&faces)[0];
            let expected = 4.0 / 3.0 * std::f64::consts::PI * 45.0f64.powi(3);
            assert!((volume / expected - 1.0).abs() < 0.01, "{volume}, not {expected}");
            assert_eq!(open_edges(&faces), 0, "{smooth}");
            for (corner, expected) in bounds.iter().zip([5.3, 95.3]) {
                assert!(corner.iter().all(|found| (found - expected).abs() < 1.0), "{bounds:?}");
            }
        }
    }
}

#[test]
fn fixtures_return_to_world_coordinates() {
    let tree = dataset::open(Path::new("fixtures/v1/ball.goblin"), &OpenOptions::new()).unwrap();
    let files = Files::new();
    let path = files.write("ball.glb", "");
    std::fs::remove_file(&path).unwrap();
    let (faces, bounds) = read_back(&tree, false, false, &path);
    // The same surface as a PLY file.
    let ply = path.with_extension("ply");
    let format = MeshFormat::Ply;
    let request = with(MeshRequest::new(), |it| it.smooth = false);
    export_mesh(&tree, &request, Output::create(&ply).unwrap(), format, &()).unwrap();
    let mut model = open(&ply, ENOUGH).unwrap();
    let expected = self::faces(&mut *model).unwrap();
    let [volume, area] = volume_and_area(&faces);
    let [other_volume, other_area] = volume_and_area(&expected);
    assert!((volume - other_volume).abs() < 1e-9 * volume.abs(), "{volume}, not {other_volume}");
    assert!((area - other_area).abs() < 1e-9 * area);
    for (found, expected) in bounds.as_flattened().iter().zip(model.info().bounds.as_flattened()) {
        assert!((found - expected).abs() < 1e-9 * area.sqrt(), "{bounds:?}");
    }

    // The cells and an exact model of the surface have its volume.
    let solid = path.with_extension("goblin");
    let options = with(SolidOptions::new(), |it| it.resolution = Resolution::Cells(24));
    let plan = plan_models(vec![open(&path, ENOUGH).unwrap()], &options).unwrap();
    plan.build(Output::create(&solid).unwrap(), &()).unwrap();
    assert!(dataset::open(&solid, &OpenOptions::new()).is_ok());
    let exact = path.with_extension("exact.goblin");
    let models = vec![open(&path, ENOUGH).unwrap()];
    import_exact(models, &ExactOptions::new(), Output::create(&exact).unwrap(), &()).unwrap();
    let exact = self::faces(&mut *open(&exact, ENOUGH).unwrap()).unwrap();
    assert!((volume_and_area(&exact)[0] / volume - 1.0).abs() < 1e-6);
}

#[test]
fn blocks_meet_exactly_at_large_coordinates() {
    let cells = made(OCT, [140, 10, 12], |[x, y, z]| ((x + y + z) % 7 > 0).then(|| byte(255)));
    // Cells whose width is not a binary fraction.
    let [x, y, z] = [4_500_000.7, 5_600_000.3, 300.1];
    let matrix = [[0.1, 0.0, 0.0, x], [0.0, 0.1, 0.0, y], [0.0, 0.0, 0.3, z]];
    let tree = opened(|path| {
        let frame = Frame { matrix, ..Frame::identity() };
        write_goblin(path, &cells, (Rule::Occupancy, DataKind::Continuous), frame);
    });
    let files = Files::new();
    let path = files.write("cells.glb", "");
    std::fs::remove_file(&path).unwrap();
    let (faces, bounds) = read_back(&tree, false, false, &path);
    assert_eq!(open_edges(&faces), 0);
    let expected = [[x, y, z], [x + 14.0, y + 1.0, z + 3.6]];
    for (found, expected) in bounds.as_flattened().iter().zip(expected.as_flattened()) {
        assert!((found - expected).abs() < 1e-8, "{bounds:?}");
    }
}

#[cfg(feature = "meshopt")]
#[test]
fn corrupt_compressed_files_are_harmless() {
    let cells = made(OCT, [6, 5, 4], |_| Some(byte(255)));
    let files = Files::new();
    let path = files.write("box.glb", "");
    std::fs::remove_file(&path).unwrap();
    let faces = read_back(&dataset_of(&cells, Rule::Occupancy, DataKind::Continuous), false, true, &path).0;
    assert_eq!(volume_and_area(&faces)[0], 120.0);
    let bytes = std::fs::read(&path).unwrap();
    let mut state = 1u64;
    for _ in 0..2000 {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mut changed = bytes.clone();
        // (Most bytes are JSON; compressed ones are at the end.)
        let at = bytes.len() - 1 - (state >> 40) as usize % (bytes.len() / 3);
        changed[at] = (state >> 32) as u8;
        if let Ok(mut model) = open(&files.write("changed.glb", &changed), ENOUGH) {
            let _ = model.faces(&mut |_| Ok(()));
        }
    }
    // A view that says it is large.
    let text = String::from_utf8_lossy(&bytes[..bytes.len() / 2]).into_owned();
    let start = text.find("\"count\":").unwrap();
    let mut large = bytes.clone();
    let end = start + text[start..].find([',', '}']).unwrap();
    large[end - 1] = b'9';
    assert!(open(&files.write("changed.glb", &large), ENOUGH).is_err());
}
