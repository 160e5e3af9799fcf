//! Faces of mesh files on a grid, without a file between.

use std::path::Path;

use spinney::brep::{Face, FaceList, Grid};
use spinney::geometry::Triangulator;
use spinney::import::mesh;

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
