//! Pairs of faces found through octrees, compared with all pairs whose boxes touch.

use std::collections::BTreeSet;

use super::*;
use crate::arrangement::Contact;
use crate::boxes::{bounds_of, touch};
use crate::{Face, FaceList, Grid, ModelBuilder};
use spinney_base::io::Output;
use spinney_container::Metadata;

type Triangle = [[i32; 3]; 3];

/// A ball of triangles around a point, with dents.
fn ball(middle: [i32; 3], radius: f64, dents: f64) -> Vec<Triangle> {
    const ROWS: i32 = 14;
    let at = |row: i32, column: i32| -> [i32; 3] {
        let (up, around) = (
            f64::from(row) * std::f64::consts::PI / f64::from(ROWS),
            f64::from(column % (2 * ROWS)) * std::f64::consts::PI / f64::from(ROWS),
        );
        let length = radius * (1.0 + dents * (5.0 * around).sin() * (4.0 * up).sin() * up.sin());
        let unit = [up.sin() * around.cos(), up.sin() * around.sin(), up.cos()];
        [0, 1, 2].map(|axis| middle[axis] + (unit[axis] * length).round() as i32)
    };
    let mut all = Vec::new();
    for row in 0..ROWS {
        for column in 0..2 * ROWS {
            let [a, b, c, d] =
                [at(row, column), at(row + 1, column), at(row + 1, column + 1), at(row, column + 1)];
            all.extend([[a, b, c], [a, c, d]].into_iter().filter(|[a, b, c]| a != b && b != c && a != c));
        }
    }
    all
}

fn model(triangles: &[Triangle]) -> ExactModel {
    let grid = Grid { bits: 12, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let mut list = FaceList::new(grid.clone(), vec!["body".into()]);
    for (source, points) in (0..).zip(triangles) {
        list.push(&Face { number: 0, points, ring_ends: &[3], colours: &[], part: 0, source });
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let mut builder = ModelBuilder::new(Output::create(&path).unwrap(), grid, 64 << 20).unwrap().leaf_size(4);
    list.each(&mut |face| builder.push(face)).unwrap();
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap()
}

/// Sources of all pairs of faces with common points, and the face count of the list.
fn pairs(faces: &crate::arrangement::ExactFaces, ends: &[u32], first: u64) -> (BTreeSet<[u64; 2]>, u64) {
    let operands = Operands { ends, far: &[0, 0], are_bodies: true, ..Operands::NONE };
    let surface = Surface::new(faces, &operands, std::path::Path::new("x"), u64::MAX, &()).unwrap();
    let contacts = surface.contacts_of_first(u64::MAX, &()).unwrap();
    let sources = |contact: &Contact| {
        let [a, b] = contact.faces.map(|face| surface.face(face).source);
        [a, b - first]
    };
    (contacts.iter().map(sources).collect(), faces.list.len())
}

#[test]
fn pairs_through_octrees_are_those_of_the_matrix() {
    let a = ball([2000; 3], 900.0, 0.2);
    let (mut count, mut saved) = (0, 0);
    for (middle, radius) in
        [([2500, 2200, 2100], 700.0), ([2000; 3], 850.0), ([3200, 2000, 2000], 500.0), ([600; 3], 400.0)]
    {
        let b = ball(middle, radius, -0.3);
        // The matrix of all pairs: true where boxes touch along all axes.
        let bounds =
            |triangles: &[Triangle]| triangles.iter().map(|points| bounds_of(points, 0)).collect::<Vec<_>>();
        let (of_a, of_b) = (bounds(&a), bounds(&b));
        let matrix: Vec<Vec<bool>> =
            of_a.iter().map(|one| of_b.iter().map(|other| touch(one, other)).collect()).collect();
        let models = [model(&a), model(&b)];
        let near = NearFaces::of([&models[0], &models[1]], 64 << 20, &()).unwrap();
        let (found, read) = pairs(&near.faces, &near.ends, near.first_sources[1]);
        let mut all = near.faces.clone();
        all.list = FaceList::new(near.faces.list.grid().clone(), vec!["body".into()]);
        for (source, points) in (0..).zip(a.iter().chain(&b)) {
            all.list.push(&Face { number: 0, points, ring_ends: &[3], colours: &[], part: 0, source });
        }
        let (expected, whole) = pairs(&all, &[a.len() as u32, (a.len() + b.len()) as u32], a.len() as u64);
        assert_eq!(found, expected);
        assert!(found.iter().all(|[one, other]| matrix[*one as usize][*other as usize]));
        (count, saved) = (count + found.len(), saved + whole - read);
    }
    assert!(count > 300 && saved > 1000, "{count} pairs, {saved} faces not read");
}
