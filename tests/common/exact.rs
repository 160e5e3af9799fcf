//! Exact models for tests.

use spinney::brep::{Face, Faces, Grid};
use spinney::raw::brep::{BuildReport, FaceList, LEAF_SIZE, ModelBuilder};
use spinney::raw::import::mesh::open;
use spinney::{ExactModel, Metadata, Output};

use super::shared_data;

pub type Ring = Vec<[i32; 3]>;

/// Returns a grid with steps of 1.
pub fn whole_grid() -> Grid {
    Grid::over([[0.0; 3], [1000.0; 3]], Some(1.0)).unwrap()
}

/// Returns a model of faces without colours. Each face is a list of rings.
pub fn model(faces: &[Vec<Ring>]) -> FaceList {
    model_on(whole_grid(), faces)
}

/// Returns a model on a grid; otherwise as [`model`].
pub fn model_on(grid: Grid, faces: &[Vec<Ring>]) -> FaceList {
    let mut list = FaceList::new(grid, vec!["solid".into()]);
    for rings in faces {
        push(&mut list, rings, 0, None);
    }
    list
}

/// Builds a file from faces and opens it.
pub fn file_of(list: &FaceList) -> ExactModel {
    let (bytes, report) = built(list, 64 << 20, LEAF_SIZE);
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(bytes.unwrap()).unwrap()
}

/// Builds a file with a memory limit in bytes and a maximum number of faces per undivided cell.
/// Returns its bytes; `None` if the faces bound no solid.
pub fn built(list: &FaceList, memory: u64, leaf_size: usize) -> (Option<Vec<u8>>, BuildReport) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("model.goblin");
    let output = Output::create(&path).unwrap();
    let mut builder = ModelBuilder::new(output, list.grid().clone(), memory).unwrap().leaf_size(leaf_size);
    list.each(&mut |face| builder.push(face)).unwrap();
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    (std::fs::read(&path).ok(), report)
}

pub fn push(list: &mut FaceList, rings: &[Ring], part: u32, colour: Option<[u8; 3]>) {
    let points = rings.concat();
    let mut ring_ends = Vec::new();
    rings.iter().for_each(|ring| ring_ends.push(ring_ends.last().unwrap_or(&0) + ring.len()));
    let colours = vec![colour.unwrap_or_default(); if colour.is_some() { points.len() } else { 0 }];
    let number = list.len();
    list.push(&Face {
        number,
        points: &points,
        ring_ends: &ring_ends,
        colours: &colours,
        part,
        source: number,
    });
}

/// Returns the faces of a prism over rings that are counterclockwise seen from above. The base may
/// have a hole.
pub fn prism(rings: &[Vec<[i32; 2]>], bottom: i32, top: i32) -> Vec<Vec<Ring>> {
    let at = |z: i32| move |[x, y]: &[i32; 2]| [*x, *y, z];
    let mut faces = vec![rings.iter().map(|ring| ring.iter().map(at(top)).collect()).collect::<Vec<Ring>>()];
    faces.push(rings.iter().map(|ring| ring.iter().rev().map(at(bottom)).collect()).collect());
    for ring in rings {
        for (i, &[x, y]) in ring.iter().enumerate() {
            let [u, v] = ring[(i + 1) % ring.len()];
            faces.push(vec![vec![[x, y, bottom], [u, v, bottom], [u, v, top], [x, y, top]]]);
        }
    }
    faces
}

/// The faces of a box.
pub fn cuboid(min: [i32; 3], max: [i32; 3]) -> Vec<Vec<Ring>> {
    let ring = vec![[min[0], min[1]], [max[0], min[1]], [max[0], max[1]], [min[0], max[1]]];
    prism(&[ring], min[2], max[2])
}

/// Flips the orientation of faces: a solid becomes a cavity.
pub fn turned(mut faces: Vec<Vec<Ring>>) -> Vec<Vec<Ring>> {
    faces.iter_mut().flatten().for_each(|ring| ring.reverse());
    faces
}

/// Builds a file of a model with the names of its parts, with a memory limit in bytes.
pub fn built_with_parts(list: &FaceList, memory: u64) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("parts.goblin");
    let output = Output::create(&path).unwrap();
    let mut builder = ModelBuilder::new(output, list.grid().clone(), memory).unwrap();
    list.each(&mut |face| builder.push(face)).unwrap();
    list.parts().iter().for_each(|name| builder.part(name, None).unwrap());
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(report.defects, []);
    std::fs::read(&path).unwrap()
}

/// Returns a model of the test data, snapped to a grid; `None` if it is missing. `is_wanted`
/// selects faces by their part.
pub fn snapped(name: &str, is_wanted: &dyn Fn(u32) -> bool) -> Option<FaceList> {
    let path = shared_data()?.join("mesh").join(name);
    if !path.exists() {
        println!("skipped: no {}", path.display());
        return None;
    }
    let mut file = open(&path, 1 << 30).unwrap();
    let info = file.info().clone();
    let grid = Grid::over(info.bounds, None).unwrap();
    let mut list = FaceList::new(grid.clone(), info.parts);
    file.faces(&mut |face| {
        if is_wanted(face.part) {
            let points: Ring = face.points.iter().map(|point| grid.snap(*point).unwrap()).collect();
            let (ring_ends, part) = (face.ring_ends, face.part);
            list.push(&Face {
                number: 0,
                points: &points,
                ring_ends,
                colours: face.colours,
                part,
                source: 0,
            });
        }
        Ok(())
    })
    .unwrap();
    Some(list)
}

/// A torus of 2nm triangles with bumps, on a grid of at least 16 bits.
pub fn bumpy_torus(n: i32, m: i32, grid: Grid) -> FaceList {
    let at = |i: i32, j: i32| {
        let [u, v] =
            [(i, n), (j, m)].map(|(at, of)| f64::from(at % of) / f64::from(of) * std::f64::consts::TAU);
        let r = 1.0 + 0.05 * (12.0 * u).sin() * (7.0 * v).cos();
        let wide = 3.0 + r * v.cos();
        [wide * u.cos(), wide * u.sin(), r * v.sin()].map(|at| ((at + 4.2) * 7000.0) as i32)
    };
    let mut list = FaceList::new(grid, vec!["torus".into()]);
    for i in 0..n {
        for j in 0..m {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            push(&mut list, &[vec![a, b, c]], 0, None);
            push(&mut list, &[vec![a, c, d]], 0, None);
        }
    }
    list
}
