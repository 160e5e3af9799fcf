//! Faces of mesh files on a grid, without a file between.

use std::path::Path;

use spinney::brep::{ExactModel, Face, FaceList, Faces, Grid, ModelBuilder};
use spinney::geometry::Triangulator;
use spinney::import::mesh;
use spinney::io::Output;
use spinney::store::{Metadata, OpenOptions};

/// A file of faces, open.
pub fn model_of(list: &FaceList) -> ExactModel {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.goblin");
    let mut builder =
        ModelBuilder::new(Output::create(&path).unwrap(), list.grid().clone(), 64 << 20).unwrap();
    list.each(&mut |face| builder.push(face)).unwrap();
    let report = builder.finish(&mut Metadata::default(), &(), &mut |_, _| ()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::open(&path, &OpenOptions::new()).unwrap()
}

/// A box of six rectangles, turned inside out for a cavity.
pub fn cuboid(min: [i32; 3], max: [i32; 3], is_cavity: bool) -> Vec<Vec<Vec<[i32; 3]>>> {
    let p = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { min[axis] } else { max[axis] });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let face = |mut quad: [usize; 4]| {
        if is_cavity {
            quad.reverse();
        }
        vec![quad.map(p).to_vec()]
    };
    quads.map(face).to_vec()
}

/// Faces given by their rings.
pub fn list_of(grid: Grid, faces: &[Vec<Vec<[i32; 3]>>]) -> FaceList {
    let mut list = FaceList::new(grid, vec![String::new()]);
    for (number, rings) in (0..).zip(faces) {
        let ends = rings.iter().scan(0, |end, ring| {
            *end += ring.len();
            Some(*end)
        });
        let (points, ring_ends) = (rings.concat(), ends.collect::<Vec<_>>());
        let (points, ring_ends) = (&points, &ring_ends);
        list.push(&Face { number, points, ring_ends, colours: &[], part: 0, source: number });
    }
    list
}

/// The faces of a mesh, each corner at the nearest grid point and cut into triangles; those without area are left out.
pub fn snapped(path: &Path, width: Option<f64>) -> FaceList {
    let mut model = mesh::open(path, 1 << 30).unwrap();
    let grid = Grid::over(model.info().bounds, width).unwrap();
    let mut list = FaceList::new(grid.clone(), vec![String::new()]);
    let mut triangulator = Triangulator::new();
    let mut source = 0;
    model
        .faces(&mut |face| {
            let points: Vec<[i32; 3]> = face.points.iter().map(|point| grid.snap(*point).unwrap()).collect();
            let wide: Vec<[i64; 3]> = points.iter().map(|point| point.map(i64::from)).collect();
            let mut triangles = Vec::new();
            triangulator.triangulate(&wide, face.ring_ends, &mut triangles);
            for corners in triangles {
                let points = corners.map(|corner| points[corner as usize]);
                if area(&points) != [0; 3] {
                    let (points, ring_ends) = (&points, &[3]);
                    list.push(&Face { number: 0, points, ring_ends, colours: &[], part: 0, source });
                }
            }
            source += 1;
            Ok(())
        })
        .unwrap();
    list
}

/// Twice the vector of a triangle's area.
pub fn area(corners: &[[i32; 3]; 3]) -> [i64; 3] {
    let [a, b, c] = corners.map(|corner| corner.map(i64::from));
    let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}
