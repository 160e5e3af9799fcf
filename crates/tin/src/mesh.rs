//! Constrained Delaunay triangulations of the plane.

use robust::{Coord, orient2d};
use spade::{
    ConstrainedDelaunayTriangulation, HasPosition, InsertionError, Point2, Triangulation,
    handles::FixedVertexHandle,
};
use spinney_base::{Error, Result};

/// Marks an edge without an adjacent triangle.
pub(crate) const NONE: u32 = u32::MAX;
/// Number of a vertex that was created where two lines cross.
const MADE: u32 = u32::MAX;

/// A triangulation of the plane.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub points: Vec<[f64; 2]>,
    /// Vertex indices of each triangle, counterclockwise.
    pub triangles: Vec<[u32; 3]>,
    /// Adjacent triangle at each edge; edge `i` leads from vertex `i` to the next one.
    pub neighbours: Vec<[u32; 3]>,
    /// Constraint edges, each with its lower index first, in ascending order.
    pub constraints: Vec<[u32; 2]>,
}

/// Side of the line from `a` to `b` on which a point lies: positive on the left. The sign is exact.
pub(crate) fn side(a: [f64; 2], b: [f64; 2], p: [f64; 2]) -> f64 {
    let at = |[x, y]: [f64; 2]| Coord { x, y };
    orient2d(at(a), at(b), at(p))
}

struct Vertex {
    position: Point2<f64>,
    number: u32,
}

impl HasPosition for Vertex {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.position
    }
}

/// Lines that become edges of the triangulation, by the indices of their ends.
pub(crate) struct Lines<'a> {
    /// Segments that must not cross others.
    pub breaklines: &'a [[u32; 2]],
    /// Segments that may cross others: a vertex is created at the crossing.
    pub outlines: &'a [[u32; 2]],
}

/// Creates the error for an invalid coordinate.
fn refused(error: InsertionError, [x, y]: [f64; 2]) -> Error {
    let expected = match error {
        InsertionError::TooSmall => "coordinates that are 0 or at least 2^-142 in magnitude",
        InsertionError::TooLarge => "coordinates below 2^201 in magnitude",
        InsertionError::NAN => "finite coordinates",
    };
    Error::invalid("point", format!("{x}, {y}"), expected)
}

/// Returns the indices of three points that are not collinear.
///
/// # Errors
/// If there are none; if a coordinate is too large, too small or NaN.
fn check_spread(points: &[[f64; 2]]) -> Result<[u32; 3]> {
    for point in points {
        for coordinate in point {
            spade::validate_coordinate(*coordinate).map_err(|error| refused(error, *point))?;
        }
    }
    let second = points.iter().position(|point| *point != points[0]);
    let third = second.and_then(|second| {
        let third = points.iter().position(|point| side(points[0], points[second], *point) != 0.0)?;
        Some([0, second as u32, third as u32])
    });
    third.ok_or_else(|| {
        let found = format!("{} on one line or at one position", points.len());
        Error::invalid("points of a surface", found, "at least 3 that are not on one line")
    })
}

/// Returns the indices of points in an insertion order in which each point is found quickly from
/// the previous one, whatever their distribution: three points that are not collinear, then a
/// biased randomized insertion order of rounds that double in size (Amenta, Choi, Rote 2003), each
/// along a Z curve.
fn order_of(points: &[[f64; 2]], first: [u32; 3]) -> Vec<u32> {
    let mut ends = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for [x, y] in points {
        ends = [[ends[0][0].min(*x), ends[0][1].min(*y)], [ends[1][0].max(*x), ends[1][1].max(*y)]];
    }
    let spread = |number: f64, axis: usize| {
        let share = (number - ends[0][axis]) / (ends[1][axis] - ends[0][axis]).max(f64::MIN_POSITIVE);
        let mut bits = (share * f64::from(1u32 << 28)) as u64;
        for (shift, mask) in [
            (16, 0x0000_ffff_0000_ffff),
            (8, 0x00ff_00ff_00ff_00ff),
            (4, 0x0f0f_0f0f_0f0f_0f0f),
            (2, 0x3333_3333_3333_3333),
            (1, 0x5555_5555_5555_5555),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    let mut keys: Vec<(u8, u64, u32)> = Vec::with_capacity(points.len());
    for (number, [x, y]) in (0u32..).zip(points) {
        // (The last round has half of all points, the one before a quarter.)
        let mixed = u64::from(number).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let round = u8::MAX - (mixed ^ mixed >> 32).leading_zeros() as u8;
        keys.push((
            if first.contains(&number) { 0 } else { round },
            spread(*x, 0) | spread(*y, 1) << 1,
            number,
        ));
    }
    keys.sort_unstable();
    keys.into_iter().map(|(_, _, number)| number).collect()
}

impl Mesh {
    /// Triangulates distinct points.
    ///
    /// The triangulation is done by spade. Its predicates are exact (Shewchuk) for all valid
    /// coordinates, a million points take seconds, and it can check whether a constraint can be
    /// added. Two things are added here. Spade's bulk loading takes quadratic time if most points
    /// are collinear, so points are inserted individually in the order of `order_of`. And errors
    /// about crossing lines name their positions.
    ///
    /// # Errors
    /// If all points are collinear; if a coordinate is invalid; if breaklines cross.
    pub(crate) fn new(points: &[[f64; 2]], lines: &Lines<'_>) -> Result<Mesh> {
        let first = check_spread(points)?;
        if points.len() >= MADE as usize / 4 {
            return Err(Error::invalid("points of a surface", points.len().to_string(), "fewer than 2^30"));
        }
        let mut cdt = ConstrainedDelaunayTriangulation::<Vertex>::new();
        let mut handles = vec![FixedVertexHandle::from_index(0); points.len()];
        for number in order_of(points, first) {
            let [x, y] = points[number as usize];
            let vertex = cdt.insert(Vertex { position: Point2::new(x, y), number });
            handles[number as usize] = vertex.map_err(|error| refused(error, [x, y]))?;
        }
        for [from, to] in lines.breaklines {
            let [from, to] = [from, to].map(|end| handles[*end as usize]);
            if from != to && !cdt.can_add_constraint(from, to) {
                let position = cdt
                    .get_conflicting_edges_between_vertices(from, to)
                    .next()
                    .map(|edge| edge.positions().map(|end| format!("{}, {}", end.x, end.y)).join(" to "));
                let [a, b] = [from, to].map(|end| cdt.vertex(end).position());
                let found = format!(
                    "the one from {}, {} to {}, {} crosses that from {}",
                    a.x,
                    a.y,
                    b.x,
                    b.y,
                    position.unwrap_or_default()
                );
                return Err(Error::invalid(
                    "breaklines",
                    found,
                    "lines with a common vertex where they cross",
                ));
            }
            if from != to {
                cdt.add_constraint(from, to);
            }
        }
        for [from, to] in lines.outlines {
            let [from, to] = [from, to].map(|end| handles[*end as usize]);
            if from != to {
                cdt.add_constraint_and_split(from, to, |position| Vertex { position, number: MADE });
            }
        }
        let mut mesh = Mesh { points: points.to_vec(), ..Mesh::default() };
        let mut numbers = vec![0; cdt.num_vertices()];
        for vertex in cdt.vertices() {
            let mut number = vertex.data().number;
            if number == MADE {
                number = mesh.points.len() as u32;
                mesh.points.push(vertex.position().into());
            }
            numbers[vertex.fix().index()] = number;
        }
        let number = |vertex: FixedVertexHandle| numbers[vertex.index()];
        mesh.triangles =
            cdt.inner_faces().map(|face| face.vertices().map(|vertex| number(vertex.fix()))).collect();
        for edge in cdt.undirected_edges().filter(|edge| edge.is_constraint_edge()) {
            let [a, b] = edge.vertices().map(|vertex| number(vertex.fix()));
            mesh.constraints.push([a.min(b), a.max(b)]);
        }
        mesh.constraints.sort_unstable();
        mesh.neighbours = neighbours(&mesh.triangles);
        Ok(mesh)
    }

    /// Returns the corners of a triangle.
    pub(crate) fn corners(&self, triangle: usize) -> [[f64; 2]; 3] {
        self.triangles[triangle].map(|corner| self.points[corner as usize])
    }

    /// Whether an edge is a constraint.
    pub(crate) fn is_constraint(&self, [a, b]: [u32; 2]) -> bool {
        self.constraints.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }

    /// Returns the edges with a triangle on one side only.
    pub(crate) fn boundary(&self) -> Vec<[u32; 2]> {
        let edges = self.triangles.iter().zip(&self.neighbours).flat_map(|(corners, beyond)| {
            (0..3).filter(|at| beyond[*at] == NONE).map(|at| [corners[at], corners[(at + 1) % 3]])
        });
        edges.collect()
    }

    /// Returns a triangle that contains a point, possibly on its edge, in a triangulation with a
    /// convex boundary. The walk starts at triangle `near`, which is set to the result.
    pub(crate) fn locate(&self, point: [f64; 2], near: &mut usize) -> Option<usize> {
        let mut at = (*near).min(self.triangles.len().checked_sub(1)?);
        for step in 0..4 * self.triangles.len() {
            let beyond = (0..3).map(|turn| (turn + step) % 3).find(|edge| self.is_beyond(at, *edge, point));
            match beyond.map(|edge| self.neighbours[at][edge]) {
                None => {
                    *near = at;
                    return Some(at);
                }
                Some(NONE) => return None,
                Some(next) => at = next as usize,
            }
        }
        // (A walk in a constrained triangulation may cycle.)
        self.scan(point)
    }

    /// Returns a triangle that contains a point, for any boundary: the walk may leave a concave one
    /// too early.
    pub(crate) fn find(&self, point: [f64; 2], near: &mut usize) -> Option<usize> {
        self.locate(point, near).or_else(|| self.scan(point))
    }

    fn scan(&self, point: [f64; 2]) -> Option<usize> {
        (0..self.triangles.len()).find(|at| !(0..3).any(|edge| self.is_beyond(*at, edge, point)))
    }

    fn is_beyond(&self, triangle: usize, edge: usize, point: [f64; 2]) -> bool {
        let corners = self.corners(triangle);
        side(corners[edge], corners[(edge + 1) % 3], point) < 0.0
    }

    /// Keeps the triangles that match, and the points that they use. Returns the old indices of
    /// these points.
    pub(crate) fn keep(&mut self, is_kept: &dyn Fn(usize) -> bool) -> Vec<u32> {
        let triangles: Vec<[u32; 3]> =
            (0..self.triangles.len()).filter(|at| is_kept(*at)).map(|at| self.triangles[at]).collect();
        let mut numbers = vec![NONE; self.points.len()];
        triangles.iter().flatten().for_each(|corner| numbers[*corner as usize] = 0);
        let mut kept = Vec::new();
        for (old, number) in (0..).zip(&mut numbers) {
            if *number != NONE {
                *number = kept.len() as u32;
                kept.push(old);
            }
        }
        let renumber = |old: u32| numbers[old as usize];
        self.points = kept.iter().map(|old| self.points[*old as usize]).collect();
        self.triangles = triangles.into_iter().map(|corners| corners.map(renumber)).collect();
        self.neighbours = neighbours(&self.triangles);
        // (A constraint outside of the kept triangles is dropped.)
        let mut edges: Vec<[u32; 2]> = self.triangles.iter().flat_map(edges_of).collect();
        edges.sort_unstable();
        let constraints = std::mem::take(&mut self.constraints);
        self.constraints = constraints
            .into_iter()
            .map(|edge| edge.map(renumber))
            .filter(|edge| edges.binary_search(edge).is_ok())
            .collect();
        self.constraints.sort_unstable();
        kept
    }
}

/// Returns the edges of a triangle, each with its lower index first.
fn edges_of(corners: &[u32; 3]) -> [[u32; 2]; 3] {
    let [a, b, c] = *corners;
    [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
}

/// Returns the adjacent triangles at the edges of each triangle.
pub(crate) fn neighbours(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut sides: Vec<([u32; 2], u32, u8)> = Vec::with_capacity(3 * triangles.len());
    for (number, corners) in (0..).zip(triangles) {
        sides.extend((0..).zip(edges_of(corners)).map(|(at, edge)| (edge, number, at)));
    }
    sides.sort_unstable();
    let mut found = vec![[NONE; 3]; triangles.len()];
    for pair in sides.windows(2) {
        let [(edge, triangle, at), (other_edge, other, other_at)] = [pair[0], pair[1]];
        if edge == other_edge {
            found[triangle as usize][at as usize] = other;
            found[other as usize][other_at as usize] = triangle;
        }
    }
    found
}
