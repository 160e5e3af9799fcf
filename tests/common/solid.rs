//! Models for tests, solids built from them, and brute-force winding numbers.

use std::path::PathBuf;

use spinney::import::mesh::{Resolution, SolidOptions, plan_models};
use spinney::raw::import::mesh::{MeshFace, Model, ModelInfo, SolidReport};
use spinney::raw::store::goblin::Goblin;
use spinney::tree::Source;
use spinney::{Frame, OpenOptions, Output, Result, Value};

use super::{Random, cells_of, with};

pub type Point = [f64; 3];
pub type Triangle = [Point; 3];

/// A face of a model as rings of vertices: the outer ring, then the holes.
#[derive(Clone)]
pub struct Polygon {
    pub rings: Vec<Vec<Point>>,
    pub part: u32,
    pub colour: [u8; 3],
}

/// A model from a list of faces.
pub struct Polygons {
    info: ModelInfo,
    faces: Vec<Polygon>,
}

impl Polygons {
    pub fn of_faces(faces: Vec<Polygon>) -> Box<dyn Model> {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for point in faces.iter().flat_map(|face| face.rings.iter().flatten()) {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(point[axis]);
                bounds[1][axis] = bounds[1][axis].max(point[axis]);
            }
        }
        let parts = faces.iter().map(|face| face.part + 1).max().unwrap_or(1);
        let info = ModelInfo {
            path: PathBuf::from("test"),
            format: "polygons".into(),
            faces: Some(faces.len() as u64),
            bounds,
            crs: None,
            unit: None,
            step: None,
            parts: (0..parts).map(|part| format!("part {part}")).collect(),
            is_grouped: false,
            is_z_up: false,
            attributes: Default::default(),
            is_coloured: true,
            bytes: 0,
        };
        Box::new(Polygons { info, faces })
    }

    /// Returns triangles, each with a part and a colour, as a model.
    pub fn of_triangles(faces: Vec<(Triangle, u32, [u8; 3])>) -> Box<dyn Model> {
        let face = |(triangle, part, colour): (Triangle, u32, [u8; 3])| Polygon {
            rings: vec![triangle.to_vec()],
            part,
            colour,
        };
        Polygons::of_faces(faces.into_iter().map(face).collect())
    }
}

impl Model for Polygons {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        self.faces.iter().try_for_each(|face| {
            let points: Vec<Point> = face.rings.concat();
            let ring_ends: Vec<usize> = face
                .rings
                .iter()
                .scan(0, |end, ring| {
                    *end += ring.len();
                    Some(*end)
                })
                .collect();
            each(&MeshFace {
                points: &points,
                ring_ends: &ring_ends,
                colours: &[face.colour],
                part: face.part,
                values: &[],
            })
        })
    }
}

pub fn plain(triangles: &[Triangle]) -> Box<dyn Model> {
    Polygons::of_triangles(triangles.iter().map(|triangle| (*triangle, 0, [0; 3])).collect())
}

/// Builds a tree and opens it.
pub fn build(model: Box<dyn Model>, options: &SolidOptions) -> (Goblin, SolidReport) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("solid.goblin");
    let report =
        plan_models(vec![model], options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
    let tree = Goblin::open(&path, &OpenOptions::new()).unwrap();
    assert_eq!(tree.verify(64 << 20, &()).unwrap(), [], "what was built is a good file");
    (tree, report)
}

/// Options for cells whose side is one model unit.
pub fn unit_cells(depth: u8) -> SolidOptions {
    with(SolidOptions::new(), |it| it.resolution = Resolution::Like(Frame::identity(), depth))
}

/// Returns all cells; x varies fastest, then y, then z.
pub fn cells<S: Source>(tree: &S) -> Vec<Option<Value>> {
    let side = 1 << tree.depth();
    cells_of(tree, [side; 3]).cells
}

/// Returns the box between two opposite corners, oriented outward.
pub fn cuboid([x0, y0, z0]: Point, [x1, y1, z1]: Point) -> Vec<Triangle> {
    let p = |i: usize| [[x0, x1][i & 1], [y0, y1][i >> 1 & 1], [z0, z1][i >> 2]];
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.into_iter().flat_map(|[a, b, c, d]| [[p(a), p(b), p(c)], [p(a), p(c), p(d)]]).collect()
}

/// Returns the winding number of a point, computed from solid angles.
pub fn winding(triangles: &[Triangle], at: Point) -> f64 {
    let dot = |a: Point, b: Point| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = |a: Point, b: Point| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let angle = |triangle: &Triangle| {
        let [a, b, c] = triangle.map(|p| [p[0] - at[0], p[1] - at[1], p[2] - at[2]]);
        let [la, lb, lc] = [a, b, c].map(|p| dot(p, p).sqrt());
        let under = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        2.0 * dot(a, cross(b, c)).atan2(under)
    };
    triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Returns random tetrahedra: some overlap, some are inside out.
pub fn tetrahedra(random: &mut Random, count: usize, side: f64, grid: f64) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    for _ in 0..count {
        let mut point =
            || -> Point { std::array::from_fn(|_| (random.below((side / grid) as u64 + 1) as f64) * grid) };
        let [a, b, c, d] = [point(), point(), point(), point()];
        triangles.extend([[a, c, b], [a, b, d], [b, c, d], [c, a, d]]);
    }
    triangles
}
