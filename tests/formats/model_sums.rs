//! Sums that are stored with exact models: they are those of the faces, and measures come from them
//! without reading faces.

use std::path::Path;
use std::sync::Arc;

use spinney::brep::{MassProperties, Motion, TransformOptions, transform};
use spinney::raw::brep::FaceList;
use spinney::raw::brep::query::PartMeasures;
use spinney::{ExactModel, OpenOptions, Output, Result};

use super::attack_model::{house, tetrahedron};
use super::ranges::far;
use crate::common::Random;
use crate::common::brep_file::BrepFile;
use crate::common::exact::{cuboid, push};
use crate::common::sets::{Body, combined, grid};

const MEMORY: u64 = 16 << 20;

/// All that is computed from sums.
type Measures = (MassProperties, Vec<PartMeasures>, [[f64; 3]; 2]);

fn measures(model: &ExactModel) -> Result<Measures> {
    Ok((MassProperties::of(model, &())?, model.part_measures(MEMORY, &())?, model.bounds()?))
}

/// Returns the file without sums.
fn without_sums(file: &[u8]) -> Vec<u8> {
    let mut file = BrepFile::of(file);
    file.sums.clear();
    file.bytes()
}

/// Returns a file of boxes, of which each row is a part. The faces of the parts alternate.
fn rows(parts: u32, boxes: i32) -> Vec<u8> {
    let mut list = FaceList::new(grid(20), (0..parts).map(|part| format!("row {part}")).collect());
    for column in 0..boxes {
        for part in 0..parts {
            let [x, y] = [4 * column, 4 * part as i32];
            for rings in cuboid([x, y, 0], [x + 3, y + 2, 5 + column % 7]) {
                push(&mut list, &rings, part, None);
            }
        }
    }
    crate::common::exact::built_with_parts(&list, 1 << 20)
}

fn moved(file: &[u8], rows: [[f64; 4]; 3]) -> Vec<u8> {
    let model = ExactModel::from_bytes(file.to_vec()).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("moved.goblin");
    let motion = Motion::from_rows(rows).unwrap();
    transform(&model, &motion, &TransformOptions::new(MEMORY), Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(&path).unwrap()
}

/// Files with holes, cavities, parts, off-grid vertices, packed chunks, and complements.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let fixture = |name: &str| {
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1").join(name)).unwrap()
    };
    let mut files = vec![
        ("house", house(4)),
        ("tetrahedron", tetrahedron(26)),
        ("rows", rows(9, 5)),
        ("rows beyond the memory of their sums", rows(300, 2)),
    ];
    for name in ["chapel.goblin", "chapel_packed.goblin", "crossing.goblin", "crossing_packed.goblin"] {
        files.push((name, fixture(name)));
    }
    let [chapel, crossing] = [4, 6].map(|file: usize| Body::of_bytes(files[file].1.clone()));
    let rows = Body::of_bytes(files[2].1.clone());
    files.push(("complement", combined(12, &[&rows]).bytes));
    files.push(("off-grid complement", combined(12, &[&crossing]).bytes));
    files.push(("union", combined(7, &[&rows, &crossing]).bytes));
    files.push(("difference", combined(2, &[&crossing, &rows]).bytes));
    for (name, body) in [("mirrored", &crossing), ("mirrored chapel", &chapel)] {
        let mirrored = [[-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]];
        files.push((name, moved(&body.bytes, mirrored)));
    }
    files
}

#[test]
fn stored_sums_are_those_of_the_faces() {
    let mut off_grid = 0;
    for (name, file) in files() {
        let [stored, computed] =
            [file.clone(), without_sums(&file)].map(|file| ExactModel::from_bytes(file).unwrap());
        assert_eq!(measures(&stored).unwrap(), measures(&computed).unwrap(), "{name}");
        for model in [&stored, &computed] {
            assert_eq!(model.verify(MEMORY, &()).unwrap(), [], "{name}");
        }
        off_grid += usize::from(stored.exact_faces().0 > 0);
        let parts = stored.part_measures(MEMORY, &()).unwrap();
        assert_eq!(
            parts.iter().map(|part| part.measures.faces).sum::<u64>(),
            spinney::brep::Faces::len(&stored)
        );
    }
    assert!(off_grid >= 5, "{off_grid}");
}

/// Any changed byte of sums is an error or a finding, and causes no panic.
#[test]
fn changed_sums_are_found() {
    let mut random = Random(5);
    for file in [house(4), include_bytes!("../../fixtures/v1/crossing.goblin").to_vec()] {
        let good = BrepFile::of(&file);
        let check = |changed: BrepFile, what: &str| {
            let model = ExactModel::from_bytes(changed.bytes()).unwrap();
            let _ = (measures(&model), model.part_measures(1 << 10, &()));
            let findings = model.verify(MEMORY, &()).unwrap();
            let is_found = findings.iter().any(|finding| finding.place.starts_with("sums"));
            assert!(is_found || !findings.is_empty() && what.contains("head"), "{what}: {findings:?}");
        };
        for at in 0..good.sums.len() {
            for bit in [0, 7, random.below(7)] {
                let mut changed = good.clone();
                changed.sums[at] ^= 1 << bit;
                check(changed, &format!("byte {at} of the sums"));
            }
        }
        let chunk = good.others[1].iter().position(|(key, _)| key >> 32 == 7).unwrap();
        let length = good.others[1][chunk].1.len();
        for at in (0..length).step_by(3) {
            let mut changed = good.clone();
            changed.others[1][chunk].1[at] ^= 1 << random.below(8);
            check(changed, &format!("byte {at} of a part's sums{}", if at < 16 { ", the head" } else { "" }));
        }
        // Without the sums of the parts.
        let mut changed = good.clone();
        changed.others[1].remove(chunk);
        check(changed, "no sums of parts");
        // Longer than any record.
        let mut changed = good;
        changed.sums.resize(400, 0);
        check(changed, "long sums");
    }
}

/// Measures of a remote file are computed from a few kilobytes, whatever its number of faces.
#[test]
fn measures_read_no_faces() {
    let file = Arc::new(rows(20, 400));
    let opened = |file: &Arc<Vec<u8>>| {
        let (backend, batches) = far(file, 64 << 20);
        let model =
            ExactModel::from_backend(Path::new("far"), Box::new(backend), &OpenOptions::new()).unwrap();
        (model, batches)
    };
    let bytes_of = |file: &Arc<Vec<u8>>| {
        let (model, batches) = opened(file);
        let before: u64 = batches.lock().unwrap().iter().map(|(_, bytes)| bytes).sum();
        let found = measures(&model).unwrap();
        let after: u64 = batches.lock().unwrap().iter().map(|(_, bytes)| bytes).sum();
        (found, before, after - before)
    };
    let (stored, to_open, bytes) = bytes_of(&file);
    assert!(to_open < file.len() as u64 / 4, "{to_open} bytes of {}", file.len());
    assert!(bytes < 8 << 10, "{bytes} bytes of {}", file.len());
    let stripped = Arc::new(without_sums(&file));
    let (computed, _, bytes) = bytes_of(&stripped);
    assert!(bytes > stripped.len() as u64 / 2, "{bytes} bytes of {}", stripped.len());
    assert_eq!(stored, computed);
}
