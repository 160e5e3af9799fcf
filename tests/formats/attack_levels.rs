//! Sets fields of levels of detail to malicious values with valid checksums. An error or a harmless
//! result is required.

use std::time::{Duration, Instant};

use spinney::brep::{Faces, Grid, ModelSurface, SurfaceDetail, Viewpoint, add_levels};
use spinney::raw::brep::FaceList;
use spinney::{Error, ExactModel, Output};

use super::attack_goblin::{Field, changed, fields};
use crate::common::command::{is_alone, own_peak_memory};
use crate::common::exact::{built, cuboid, push};
use crate::targets::seal::{self, SECTION, TRAILER};

/// Returns a file of 30 boxes with levels of detail. The first has slivers.
fn city() -> Vec<u8> {
    let grid = Grid { bits: 8, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let mut list = FaceList::new(grid, vec!["mesh".into()]);
    for number in 0..30 {
        let min = [40 * (number % 6), 40 * (number / 6), 0];
        let size = [5 + number % 7, 6, 4 + number * number % 23];
        for rings in cuboid(min, [0, 1, 2].map(|axis| min[axis] + size[axis])) {
            push(&mut list, &rings, 0, None);
        }
    }
    for ring in [[[0, 0, 0], [2, 0, 0], [5, 0, 0]], [[5, 0, 0], [2, 0, 0], [0, 0, 0]]] {
        push(&mut list, &[ring.to_vec()], 0, None);
    }
    let model = ExactModel::from_bytes(built(&list, 1 << 20, 3).0.unwrap()).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("city.goblin");
    add_levels(&model, (Output::create(&path).unwrap(), model.codec()), 64 << 20, &()).unwrap();
    std::fs::read(&path).unwrap()
}

/// Returns a section's offset and length.
fn section(file: &[u8], tag: &[u8; 4]) -> (usize, usize) {
    let first = seal::trailer(file).unwrap() + TRAILER;
    let at = (first..).step_by(SECTION).find(|at| file[*at..].starts_with(tag)).unwrap();
    (seal::long(file, at + 8) as usize, seal::long(file, at + 16) as usize)
}

/// Returns offset and length of each chunk of a list, and the fields of its entries.
fn chunks(file: &[u8], tag: &[u8; 4], all: &mut Vec<Field>) -> Vec<(usize, usize)> {
    let (start, length) = section(file, tag);
    let mut found = Vec::new();
    for entry in (start..start + length).step_by(24) {
        all.extend(fields("an entry", entry, &[8, 8, 4, 4]));
        found.push((seal::long(file, entry + 8) as usize, seal::short(file, entry + 16) as usize));
    }
    found
}

/// Returns all fields of levels and list entries, and a sample of those of clusters and blocks.
fn level_fields(file: &[u8], every: usize) -> Vec<Field> {
    let mut all = Vec::new();
    let (start, length) = section(file, b"LEVS");
    (start..start + length).step_by(48).for_each(|at| all.extend(fields("a level", at, &[8; 6])));
    for (start, length) in chunks(file, b"LEVC", &mut all) {
        let sizes = [&[4, 4, 1, 1, 2, 4, 4, 4][..], &[4; 6], &[8, 8]].concat();
        // (One in seven of 16 fields per cluster: any seven consecutive clusters have all of them.)
        let clusters = (start..start + length).step_by(64);
        all.extend(clusters.flat_map(|at| fields("a cluster", at, &sizes)).step_by(7));
    }
    for (start, length) in chunks(file, b"LEVF", &mut all) {
        all.extend(fields("a block", start, &[4; 5]));
        let sizes = vec![2; (length - 20) / 2];
        all.extend(fields("a coarse face", start + 20, &sizes).into_iter().step_by(every));
    }
    all
}

/// Reads surfaces of all levels, and for several errors and numbers of faces.
fn query_levels(file: Vec<u8>) {
    let Ok(model) = ExactModel::from_bytes(file) else { return };
    let levels = (0..model.levels().len() as u8).map(SurfaceDetail::Level);
    let errors = [0.0, 3.0, 25.0, 1e300, f64::INFINITY].map(SurfaceDetail::Error);
    let numbers = [0, 100, u64::MAX].map(SurfaceDetail::Faces);
    let within = [[30.0, 0.0, 0.0], [90.0, 60.0, 10.0]];
    let check = |surface: &ModelSurface<'_>| {
        assert!(!surface.error().is_nan() && surface.error() >= 0.0);
        let mut faces = 0;
        let read = surface.each(&mut |face| {
            assert_eq!(face.number, faces);
            assert!((face.part as usize) < model.parts().len());
            assert!(face.points.as_flattened().iter().all(|at| (0..1 << 8).contains(at)));
            faces += 1;
            Ok(())
        });
        assert!(matches!(read, Ok(()) | Err(Error::Corrupt { .. })), "{read:?}");
        assert!(faces <= 4000, "{faces} faces");
    };
    for detail in levels.chain(errors).chain(numbers) {
        for within in [None, Some(within)] {
            model.surface(detail, within, &()).iter().for_each(check);
        }
    }
    let half = vec![[1.0, 0.0, 0.0, -60.0]];
    for (tolerance, faces, half_spaces) in [(0.0, u64::MAX, vec![]), (0.1, 500, vec![]), (0.02, 2000, half)] {
        let view = Viewpoint { eye: [40.0, 70.0, 20.0], tolerance, half_spaces, faces };
        let Ok(surface) = model.at_view(&view) else { continue };
        check(&surface);
        model.of_clusters(surface.numbers()).iter().for_each(check);
        surface.by_cluster().iter().flatten().for_each(check);
    }
    model.verify(64 << 20, &()).unwrap();
}

#[test]
fn fields_of_levels() {
    if !is_alone("attack_levels::fields_of_levels") {
        return;
    }
    let file = city();
    let model = ExactModel::from_bytes(file.clone()).unwrap();
    assert!(model.levels().len() > 2);
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    let (mut cases, start) = (0u64, Instant::now());
    for field in level_fields(&file, 37) {
        changed(&file, &field, &mut |mut file, what| {
            let case = Instant::now();
            seal::goblin(&mut file);
            let queried = std::panic::catch_unwind(|| query_levels(file));
            assert!(queried.is_ok(), "{what}");
            assert!(case.elapsed() < Duration::from_secs(10), "{what} took {:?}", case.elapsed());
            cases += 1;
        });
    }
    println!("{cases} cases in {:?}", start.elapsed());
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}
