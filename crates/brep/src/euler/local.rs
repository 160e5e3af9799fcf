//! Local operators: a vertex, an edge or a face is moved, or an edge is cut off by a plane.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use super::body::EulerBody;
use crate::exact::vector::{dot, subtract};
use crate::{Grid, format_position};
use spinney_base::{Error, Result};

/// Element that a local change changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    Vertex,
    Edge,
    Face,
    Chamfer,
}

/// A local change of an exact model: the position of a vertex, edge or face, and a vector.
///
/// ```
/// # use spinney::raw::brep::euler::LocalChange;
/// let change: LocalChange = "move-face=5,5,10,0,0,2".parse()?;
/// assert_eq!(change.to_string(), "move-face=5,5,10,0,0,2");
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalChange {
    what: What,
    position: [f64; 3],
    vector: [f64; 3],
}

/// Names of local changes.
const NAMES: [(&str, What); 4] = [
    ("move-vertex", What::Vertex),
    ("move-edge", What::Edge),
    ("move-face", What::Face),
    ("chamfer", What::Chamfer),
];

/// Maximum distance of an edge or face from the position that denotes it, in grid units. Midpoints
/// need not be on the grid.
const REACH: f64 = 1.0;

impl LocalChange {
    /// Returns whether a text has the name of a local change.
    pub fn is_named(text: &str) -> bool {
        text.split_once('=').is_some_and(|(name, _)| NAMES.iter().any(|(known, _)| *known == name))
    }

    fn name(&self) -> &'static str {
        NAMES[self.what as usize].0
    }

    fn wrong(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::invalid(self.to_string(), found, expected)
    }

    /// Changes a body on a grid. Returns the distance by which the vector was rounded.
    pub(super) fn apply(&self, body: &mut EulerBody, grid: &Grid) -> Result<f64> {
        let width = grid.width();
        let exact = self.vector.map(|at| at * grid.divisor / grid.step);
        let vector = exact.map(f64::round_ties_even);
        if vector.iter().any(|at| at.abs() >= (1u64 << 40) as f64) {
            return Err(self.wrong(format!("a vector of {:?} grid units", exact), "a shorter one"));
        }
        let rounded = (0..3).map(|axis| (vector[axis] - exact[axis]).powi(2)).sum::<f64>().sqrt() * width;
        if vector == [0.0; 3] {
            let expected = format!("one of at least {width}, the grid's unit");
            return Err(self.wrong(format!("the vector {:?}", self.vector), expected));
        }
        let at = grid.to_grid(self.position);
        let moved: BTreeSet<u32> = match self.what {
            What::Vertex => BTreeSet::from([self.vertex(body, at, grid)?]),
            What::Edge => BTreeSet::from(body.ends(2 * self.edge(body, at)?)),
            What::Face => {
                let face = self.face(body, at)?;
                body.half_edges_of_face(face).into_iter().map(|half| body.ends(half)[0]).collect()
            }
            What::Chamfer => {
                let edge = self.edge(body, at)?;
                self.chamfer(body, edge, vector.map(|at| at as i128), grid)?;
                BTreeSet::new()
            }
        };
        for vertex in moved {
            let point = point(body, vertex);
            body.place(vertex, [0, 1, 2].map(|axis| point[axis] + vector[axis]));
        }
        Ok(rounded)
    }

    /// Returns the vertex at a position.
    fn vertex(&self, body: &EulerBody, at: [f64; 3], grid: &Grid) -> Result<u32> {
        let distance = |vertex: u32| distance(point(body, vertex), at);
        let all = || body.vertices.numbers();
        let found: Vec<u32> = all().filter(|vertex| distance(*vertex) < REACH / 2.0).collect();
        match &found[..] {
            [vertex] => Ok(*vertex),
            [] => {
                let nearest = all().min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
                let nearest = nearest.map_or([0.0; 3], |vertex| grid.to_world_between(point(body, vertex)));
                let expected = format!("the position of one; the nearest is at {}", format_position(nearest));
                Err(self.wrong("no vertex there", expected))
            }
            several => {
                let found = format!("{} vertices there, at which surfaces touch", several.len());
                Err(self.wrong(found, "the position of one"))
            }
        }
    }

    /// Returns the edge through a position.
    fn edge(&self, body: &EulerBody, at: [f64; 3]) -> Result<u32> {
        let is_near = |edge: &u32| {
            let [a, b] = body.ends(2 * edge).map(|vertex| point(body, vertex));
            distance_to_edge(a, b, at) < REACH
        };
        let found: Vec<u32> = body.half_edges.numbers().filter(is_near).collect();
        let expected = "a position on one edge, such as its middle";
        match &found[..] {
            [edge] => Ok(*edge),
            [] => Err(self.wrong("no edge within a grid unit", expected)),
            several => Err(self.wrong(format!("{} edges there", several.len()), expected)),
        }
    }

    /// Returns the face through a position.
    fn face(&self, body: &EulerBody, at: [f64; 3]) -> Result<u32> {
        let found: Vec<u32> = body.faces.numbers().filter(|face| is_in_face(body, *face, at)).collect();
        let expected = "a position inside one face";
        match &found[..] {
            [face] => Ok(*face),
            [] => Err(self.wrong("no face within a grid unit", expected)),
            several => Err(self.wrong(format!("{} faces there", several.len()), expected)),
        }
    }

    /// Cuts an edge off by the plane that is perpendicular to a vector, at the vector's end from
    /// the edge.
    ///
    /// The other edges at both ends are divided where they meet the plane. New edges connect these
    /// points in all faces. Then all edges between the plane and the edge are removed.
    fn chamfer(&self, body: &mut EulerBody, edge: u32, vector: [i128; 3], grid: &Grid) -> Result<()> {
        let half = 2 * edge;
        let ends = body.ends(half);
        let wide = |body: &EulerBody, vertex: u32| point(body, vertex).map(|at| at as i128);
        let along = subtract(wide(body, ends[1]), wide(body, ends[0]));
        if dot(along, vector) != 0 {
            let expected = format!("a vector perpendicular to the edge, which has the direction {along:?}");
            return Err(self.wrong("a vector that is not perpendicular to the edge", expected));
        }
        let depth = dot(vector, vector);
        for (vertex, own) in [(ends[0], half), (ends[1], half ^ 1)] {
            let others: Vec<u32> = body.half_edges_of(vertex).filter(|other| *other != own).collect();
            let from = wide(body, vertex);
            for other in others {
                let [_, end] = body.ends(other);
                let way = subtract(wide(body, end), from);
                let height = dot(vector, way);
                if height <= depth {
                    let end = grid.to_world_between(point(body, end));
                    let found = format!(
                        "a plane that does not meet the edge to {} before its end",
                        format_position(end)
                    );
                    return Err(self.wrong(found, "one that divides all edges at both ends of the edge"));
                }
                if way.iter().any(|way| way * depth % height != 0) {
                    let at =
                        [0, 1, 2].map(|axis| from[axis] as f64 + (way[axis] * depth) as f64 / height as f64);
                    let found = format!(
                        "a new vertex at {}, off the grid",
                        format_position(grid.to_world_between(at))
                    );
                    let expected = "vertices on the grid: another vector, or `combine a-b` with a wedge, which keeps such vertices exactly";
                    return Err(self.wrong(found, expected));
                }
                let cut = [0, 1, 2].map(|axis| (from[axis] + way[axis] * depth / height) as f64);
                body.split_edge(other, cut)?;
            }
        }
        // (Both faces of the edge get a strip along it.)
        for side in [half, half ^ 1] {
            let (before, after) = (body.half(side).previous, body.half(body.half(side).next).next);
            body.make_edge_face(before, after)?;
        }
        for (vertex, own) in [(ends[0], half), (ends[1], half ^ 1)] {
            let corners: Vec<u32> = body
                .half_edges_of(vertex)
                .filter(|other| *other != own && body.half(*other).previous != own ^ 1)
                .collect();
            for corner in corners {
                let (before, after) = (body.half(corner).previous, body.half(corner).next);
                body.make_edge_face(before, after)?;
            }
        }
        body.kill_edge_face(half)?;
        for vertex in ends {
            loop {
                let around: Vec<u32> = body.half_edges_of(vertex).collect();
                match &around[..] {
                    [last] => break body.kill_edge_vertex(last ^ 1)?,
                    _ => {
                        let is_between = |half: &&u32| body.face(**half).ok() != body.face(**half ^ 1).ok();
                        let half = around.iter().find(is_between).copied().unwrap_or(u32::MAX);
                        body.kill_edge_face(half)?;
                    }
                }
            }
        }
        Ok(())
    }
}

impl FromStr for LocalChange {
    type Err = Error;

    fn from_str(text: &str) -> Result<LocalChange> {
        let (name, numbers) = text.split_once('=').unwrap_or((text, ""));
        let wrong = || Error::invalid(name, numbers, "X,Y,Z,DX,DY,DZ");
        let known = NAMES.iter().find(|(known, _)| *known == name);
        let (_, what) =
            known.ok_or_else(|| Error::invalid("operation", text, "a local one, such as move-vertex="))?;
        let parsed =
            numbers.split(',').map(|number| number.trim().parse::<f64>().ok().filter(|at| at.is_finite()));
        let parsed: Option<Vec<f64>> = parsed.collect();
        let parsed = parsed.and_then(|numbers| <[f64; 6]>::try_from(numbers).ok()).ok_or_else(wrong)?;
        let [x, y, z, dx, dy, dz] = parsed;
        Ok(LocalChange { what: *what, position: [x, y, z], vector: [dx, dy, dz] })
    }
}

impl fmt::Display for LocalChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([x, y, z], [dx, dy, dz]) = (self.position, self.vector);
        write!(f, "{}={x},{y},{z},{dx},{dy},{dz}", self.name())
    }
}

fn point(body: &EulerBody, vertex: u32) -> [f64; 3] {
    body.vertices.get(vertex).map_or([0.0; 3], |vertex| vertex.point)
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

fn product(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let way = difference(a, b);
    product(way, way).sqrt()
}

fn distance_to_edge(a: [f64; 3], b: [f64; 3], at: [f64; 3]) -> f64 {
    let (way, to) = (difference(b, a), difference(at, a));
    let share = (product(way, to) / product(way, way)).clamp(0.0, 1.0);
    distance([0, 1, 2].map(|axis| a[axis] + share * way[axis]), at)
}

/// Returns whether a position is in a face, at most [`REACH`] from its plane.
fn is_in_face(body: &EulerBody, face: u32, at: [f64; 3]) -> bool {
    let edges: Vec<[[f64; 3]; 2]> = body
        .half_edges_of_face(face)
        .into_iter()
        .map(|half| body.ends(half).map(|vertex| difference(point(body, vertex), at)))
        .collect();
    let mut normal = [0.0; 3];
    for [a, b] in &edges {
        for (axis, part) in normal.iter_mut().enumerate() {
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            *part += (a[j] - b[j]) * (a[k] + b[k]);
        }
    }
    let length = product(normal, normal).sqrt();
    let Some([first, _]) = edges.first() else { return false };
    if length == 0.0 || (product(normal, *first) / length).abs() >= REACH {
        return false;
    }
    // (Edges that a ray from the position crosses, seen along the largest axis of the normal.)
    let largest = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(0);
    let (j, k) = ((largest + 1) % 3, (largest + 2) % 3);
    let crosses = |[a, b]: &&[[f64; 3]; 2]| {
        (a[k] > 0.0) != (b[k] > 0.0) && a[j] + (b[j] - a[j]) * (-a[k]) / (b[k] - a[k]) > 0.0
    };
    edges.iter().filter(crosses).count() % 2 == 1
}
