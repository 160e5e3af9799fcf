//! Rays against a test of all faces: through vertices and edges, along faces, from a distance.

use super::Line;
use super::testing::{Body, Random, Ring, cuboid};
use crate::{ExactModel, FaceList, Faces, Grid, LEAF_SIZE, ModelBuilder};
use spinney_base::io::Output;
use spinney_container::Metadata;

fn file_of(list: &FaceList) -> ExactModel {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("model.goblin");
    let builder = ModelBuilder::new(Output::create(&path).unwrap(), list.grid().clone(), 64 << 20).unwrap();
    let mut builder = builder.leaf_size(LEAF_SIZE);
    list.each(&mut |face| builder.push(face)).unwrap();
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap()
}

/// A torus of triangles.
fn torus(n: i32, m: i32, size: f64) -> Vec<Vec<Ring>> {
    let at = |i: i32, j: i32| {
        let [u, v] =
            [(i, n), (j, m)].map(|(at, of)| f64::from(at % of) / f64::from(of) * std::f64::consts::TAU);
        let wide = 3.0 + v.cos();
        [wide * u.cos(), wide * u.sin(), v.sin()].map(|at| ((at + 4.1) * size / 8.2) as i32)
    };
    let quads = (0..n).flat_map(|i| (0..m).map(move |j| (i, j)));
    let halves = quads.flat_map(|(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [vec![vec![a, b, c]], vec![vec![a, c, d]]]
    });
    halves.collect()
}

/// Closed meshes: rays from outside through their vertices, edges and faces never pass them, and
/// rays next to their triangles hit nothing. Results are those of all faces, with and without what
/// earlier rays have left in the cache.
#[test]
fn rays_aimed_at_vertices_and_edges_hit_as_all_faces() {
    let grid = |bits| Grid { bits, origin: [-50, 7, 0], step: 0.5, divisor: 1.0 };
    let hall = cuboid([3, 5, 7], [120, 90, 100], false);
    let lists = [
        Body::new(20).with(torus(24, 12, f64::from(1 << 20))).list_on(grid(20)),
        Body::new(26).with(torus(5, 40, f64::from(1 << 26))).list_on(grid(26)),
        Body::new(7).with(hall).with(cuboid([10; 3], [30, 30, 31], true)).list_on(grid(7)),
    ];
    for list in lists {
        let model = file_of(&list);
        let grid = list.grid();
        let all: Vec<_> = (0..list.len() as usize).map(|number| list.get(number)).collect();
        let far = (1u64 << grid.bits) as f64;
        let (mut random, mut rays) = (Random(12), model.rays());
        let (mut queries, mut results, mut crossed, mut met) = (Vec::new(), Vec::new(), 0, 0);
        for case in 0..400 {
            let corners = all[random.below(all.len() as u64) as usize].points;
            // A vertex, the middle of an edge, or a point within: exact in doubles.
            let weights = [[4, 0, 0], [2, 2, 0], [1, 1, 2]][case % 3];
            let target = [0, 1, 2].map(|axis| {
                (0..3).map(|at| f64::from(weights[at]) * f64::from(corners[at][axis])).sum::<f64>() / 4.0
            });
            let mut direction = [0.0; 3];
            match case % 7 {
                // Along an axis, along an edge, in the plane of a face, and in any direction.
                0 | 1 => direction[random.below(3) as usize] = if random.below(2) == 0 { 1.0 } else { -1.0 },
                2 => direction = [0, 1, 2].map(|axis| f64::from(corners[1][axis] - corners[0][axis])),
                3 => direction = [0, 1, 2].map(|axis| f64::from(corners[2][axis]) - target[axis]),
                _ => direction = [0; 3].map(|_| random.below(1 << 16) as f64 - 32768.5),
            }
            let longest = direction.iter().fold(0.0, |most: f64, along| most.max(along.abs()));
            if longest == 0.0 {
                continue;
            }
            // From outside, also from a great distance, and from the surface.
            let back = [2.0, 2.0, 1024.0, 0.0][case % 4] * far / longest;
            let from = grid.to_world_between([0, 1, 2].map(|axis| target[axis] - back * direction[axis]));
            let direction = direction.map(|along| along * grid.width());
            let line = Line::ray(grid, grid.to_grid(from), direction.map(|along| along / grid.width()));
            let crossing = |line: &Line| {
                all.iter().filter_map(|face| Some((face.number, line.crossing(face)?))).collect()
            };
            let mut expected: Vec<_> = line.as_ref().map(crossing).unwrap_or_default();
            expected.sort_by(|a, b| a.1.share.total_cmp(&b.1.share).then(a.0.cmp(&b.0)));
            let found = rays.first(from, direction).unwrap();
            let first = expected.first().map(|(face, it)| (*face, it.share, it.is_entry));
            assert_eq!(found.map(|hit| (hit.face, hit.share, hit.is_entry)), first, "{from:?} {direction:?}");
            assert_eq!(model.ray(from, direction).unwrap().0, found);
            assert_eq!(model.ray_crossings(from, direction).unwrap().len(), expected.len());
            if back != 0.0 {
                assert!(expected.len().is_multiple_of(2), "{from:?} {direction:?}");
                let is_through_face = case % 3 == 2 && case % 7 > 3;
                crossed += usize::from(is_through_face);
                met += usize::from(is_through_face && found.is_some());
            }
            queries.push([from, direction]);
            results.push(found);
        }
        assert!(crossed > 30 && met == crossed, "{met} of {crossed}");
        assert_eq!(rays.first_of(&queries).unwrap(), results);
        assert_eq!(model.rays().first_of(&queries).unwrap(), results, "with an empty cache");
    }
}
