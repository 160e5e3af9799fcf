//! Set operations on exact models for tests, and their expected results.

use spinney::brep::{Face, Faces, Grid, Location, MassProperties, combine};
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::brep::{CombineReport, FaceList, LEAF_SIZE};
use spinney::{ExactModel, Output, Result};

use super::exact::{Ring, built, model_on};
use super::{Random, set_operation};

pub type Solid = Vec<Vec<Ring>>;

/// A sufficient memory limit in bytes.
pub const MEMORY: u64 = 256 << 20;

/// A model in memory, with the bytes of its file.
pub struct Body {
    pub model: ExactModel,
    pub bytes: Vec<u8>,
}

/// Returns a grid of 2^bits steps of 1.
pub fn grid(bits: u8) -> Grid {
    Grid { bits, origin: [0; 3], step: 1.0, divisor: 1.0 }
}

impl Body {
    pub fn of_bytes(bytes: Vec<u8>) -> Body {
        Body { model: ExactModel::from_bytes(bytes.clone()).unwrap(), bytes }
    }

    pub fn of_list(list: &FaceList) -> Body {
        let (bytes, report) = built(list, 64 << 20, LEAF_SIZE);
        assert_eq!(report.defects, []);
        Body::of_bytes(bytes.unwrap())
    }

    /// Returns a body on a grid of 2^bits steps of 1.
    pub fn of(faces: &Solid, bits: u8) -> Body {
        Body::of_list(&model_on(grid(bits), faces))
    }

    /// Returns the volume; negative for a complement.
    pub fn volume(&self) -> f64 {
        MassProperties::of(&self.model, &()).unwrap().volume
    }

    /// Returns whether every edge has two faces.
    pub fn is_closed(&self) -> bool {
        let topology = Topology::of(&self.model, &TopologyOptions::default(), &()).unwrap();
        topology.euler().boundaries == 0 && topology.is_closed()
    }

    /// Returns whether each edge is used equally often in both directions.
    pub fn edges_cancel(&self) -> bool {
        let mut edges = Vec::new();
        let mut add = |face: &Face<'_>| {
            for ring in face.rings() {
                edges.extend((0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]));
            }
            Ok(())
        };
        self.model.each(&mut add).unwrap();
        let mut turned: Vec<_> = edges.iter().map(|[from, to]| [*to, *from]).collect();
        edges.sort_unstable();
        turned.sort_unstable();
        edges == turned
    }

    pub fn is_inside(&self, point: [f64; 3]) -> bool {
        self.model.locate(point).unwrap() == Location::Inside
    }

    /// Panics if the surface is open or the file is not valid.
    pub fn check(&self) {
        assert!(self.is_closed() && self.edges_cancel());
        assert_eq!(self.model.verify(64 << 20, &()).unwrap(), []);
    }
}

/// Returns the result of an operation.
pub fn try_combined(operation: u8, bodies: &[&Body]) -> Result<(Body, CombineReport)> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("c.goblin");
    let models: Vec<&ExactModel> = bodies.iter().map(|body| &body.model).collect();
    let result = combine(
        set_operation(operation),
        &models,
        Output::create(&path).unwrap(),
        spinney::Codec::Plain,
        MEMORY,
        &(),
    );
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), usize::from(result.is_ok()));
    result.map(|report| (Body::of_bytes(std::fs::read(&path).unwrap()), report))
}

pub fn combined(operation: u8, bodies: &[&Body]) -> Body {
    let (body, report) =
        try_combined(operation, bodies).unwrap_or_else(|error| panic!("operation {operation}: {error}"));
    assert_eq!((report.after, report.is_unbounded), (body.model.len(), body.model.is_unbounded()));
    body
}

/// Returns the operation with its operands exchanged.
pub fn exchanged(operation: u8) -> u8 {
    operation & 9 | (operation & 2) << 1 | (operation & 4) >> 1
}

/// Returns whether a point belongs to the result, given which of the two bodies contain it.
pub fn holds(operation: u8, [a, b]: [bool; 2]) -> bool {
    let bit = match (a, b) {
        (true, true) => 0,
        (true, false) => 1,
        (false, true) => 2,
        (false, false) => 3,
    };
    operation >> bit & 1 == 1
}

/// Returns the tetrahedron of four points, oriented outward; `None` if it has no volume.
pub fn tetrahedron([a, b, c, d]: [[i32; 3]; 4]) -> Option<Solid> {
    let to = |p: [i32; 3]| [0, 1, 2].map(|axis| i128::from(p[axis]) - i128::from(a[axis]));
    let (u, v, w) = (to(b), to(c), to(d));
    let across = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let six = (0..3).map(|axis| across[axis] * w[axis]).sum::<i128>();
    let (b, c) = if six > 0 { (b, c) } else { (c, b) };
    let faces = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
    (six != 0).then(|| faces.iter().map(|ring| vec![ring.to_vec()]).collect())
}

/// Returns convex faces without holes as triangles.
pub fn triangulated(faces: &Solid) -> Solid {
    let fan = |ring: &Vec<[i32; 3]>| -> Solid {
        (2..ring.len()).map(|i| vec![vec![ring[0], ring[i - 1], ring[i]]]).collect()
    };
    faces.iter().flat_map(|rings| fan(&rings[0])).collect()
}

/// Splits triangles at random points of their edges, independently of their neighbours, and adds
/// faces without area that join the split edges to the whole ones. Edge vectors are multiples of
/// `parts`.
pub fn cut_at_edges(faces: &Solid, parts: i32, random: &mut Random) -> Solid {
    let cut = |rings: &Vec<Ring>| {
        let [a, b, c] = [0, 1, 2].map(|corner| rings[0][corner]);
        let place = 1 + random.below(parts as u64 - 1) as i32;
        let at = [0, 1, 2].map(|axis| a[axis] + (b[axis] - a[axis]) / parts * place);
        [vec![vec![at, b, c]], vec![vec![a, at, c]], vec![vec![a, b, at]]]
    };
    faces.iter().flat_map(cut).collect()
}
